"""Command line options of softness fits: plain values with units."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.softness import LOAD_MODELS
from contactmodel.common.inputs import RangeWarning
from contactmodel.common.options import expect_none, given_options, option
from estimation.softness.bar import check_edge, radius_of_square

_LOWEST_BAR = 0.5
"""Height of the lowest square bar that was tested, over its width [-]."""


@dataclass(frozen=True)
class ReferenceSettings:
    """Options for reading references.

    Attributes:
        flip: change the sign of the angles in all references.
        zeroed: the reference angles count from the onset of contact; L is fitted too.
        same_clock: reference and recording share a clock; no offset is fitted.
    """

    flip: bool = False
    zeroed: bool = False
    same_clock: bool = False


@dataclass(frozen=True)
class ShapeChoices:
    """Shape of the object at the contact.

    Attributes:
        radius_mm: radius of an object that is a ball, or has a round tip; inf for a flat surface
            [mm].
        height_mm: height of a plate or cylinder from the contact to the grip at its back; inf if
            much more than the contact's size. A higher one turns further [mm].
        side_mm: radius of a cylinder's side, requires --height-mm; inf for a plate. A slimmer one
            turns further [mm].
        width_mm: width of a cube or square bar, in place of --side-mm; requires --height-mm [mm].
        edge_mm: radius of the edge around a cylinder's flat face, at most half of --side-mm; 0 if
            it is sharp or not known. It matters for low cylinders [mm].

    Raises:
        ValueError: a length is not above 0, the height of a cylinder or bar is missing, both a
            side and a width are given, or an edge is given without a cylinder's flat face.
    """

    radius_mm: float = float("inf")
    height_mm: float = float("inf")
    side_mm: float = float("inf")
    width_mm: float = float("inf")
    edge_mm: float = 0.0

    def __post_init__(self) -> None:
        """Check the lengths."""
        for name, meaning in (
            ("radius", "the ball's radius must be above 0, or inf for a flat surface"),
            ("height", "the object's height must be above 0, or inf if it is gripped far away"),
            ("side", "the cylinder's radius must be above 0, or inf for a plate"),
            ("width", "the bar's width must be above 0, or inf for other objects"),
        ):
            if not (value := getattr(self, f"{name}_mm")) > 0.0:
                raise ValueError(f"--{name}-mm is {value:g} mm; {meaning}")
        given = [name for name in ("side", "width") if np.isfinite(getattr(self, f"{name}_mm"))]
        if len(given) > 1:
            raise ValueError(
                "--side-mm and --width-mm are both given: a cylinder has a side, a square bar a "
                "width"
            )
        if given and np.isinf(self.height_mm):
            raise ValueError(
                f"--{given[0]}-mm needs --height-mm: give the object's height from the contact to "
                "the grip"
            )
        check_edge(self.edge_mm, self.side_mm, self.radius_mm)
        if self.height_mm < _LOWEST_BAR * self.width_mm < np.inf:
            warnings.warn(
                f"a square bar {self.width_mm:g} mm wide and {self.height_mm:g} mm high: bars "
                f"lower than {_LOWEST_BAR:g} of their width were not tested",
                RangeWarning,
                stacklevel=2,
            )

    @property
    def lengths(self) -> tuple[float, float, float, float]:
        """Radius, height, side and edge [mm]; of a square bar the side of the cylinder like it."""
        side = min(self.side_mm, radius_of_square(self.width_mm))
        return self.radius_mm, self.height_mm, side, self.edge_mm


@dataclass(frozen=True)
class SoftnessChoices:
    """Options of a fit of k and L, with known properties of elastomer and object.

    Attributes:
        references: options for reading references.
        clock_search: largest offset between the clocks of reference and recording. Larger values
            search longer [s].
        load: model of the load term L.
        noise_um: standard deviation of a marker's in-plane coordinates [µm].
        k_ratio: ratio of the k of the first finger to that of the second. Fits both from one
            grasp, without a reference [-].
        thickness_mm: thickness of the elastomer; inf if it is much thicker than the contact is
            wide. A finite thickness requires CSVs with --zeroed and --same-clock [mm].
        depth_mm: depth of the markers below the surface. Above 0 it requires the same. At a tenth
            of the contact's radius, 1 + k would be 15 to 20 % too large without it [mm].
        shape: shape of the object. It also requires CSVs with --zeroed and --same-clock.

    Raises:
        ValueError: the search is below 0.
    """

    references: ReferenceSettings = field(default_factory=ReferenceSettings)
    clock_search: float = 1.0
    load: str | None = field(
        default=None, metadata=option("by BIC", more=f" One of {', '.join(LOAD_MODELS)}.")
    )
    noise_um: float | None = field(
        default=None, metadata=option("from --sensor, or from each recording")
    )
    k_ratio: float | None = field(default=None, metadata=option("none"))
    thickness_mm: float | None = field(default=None, metadata=option("from --sensor, or inf"))
    depth_mm: float | None = field(default=None, metadata=option("from --sensor, or 0"))
    shape: ShapeChoices = field(default_factory=ShapeChoices)

    def __post_init__(self) -> None:
        """Check the search; pad and shape check their own values."""
        if not self.clock_search >= 0.0:
            raise ValueError(f"--clock-search is {self.clock_search:g} s; it must be 0 or more")

    def expect_used(self, references: Sequence[str], object_names: Sequence[str]) -> None:
        """Check that no option was given without effect beside the others.

        Args:
            references: values of `--reference`.
            object_names: values of `--object`.

        Raises:
            ValueError: one was.
        """
        if self.k_ratio is not None:
            others = {"--reference": references, "--object": object_names}
            used = "--k-ratio", "--clock-search", "--noise-um"
            given = [name for name in given_options(self) if name not in used]
            expect_none([*given, *filter(others.get, others)], "with --k-ratio")
        elif references and set(references) == {"outline"}:
            expect_none(given_options(self.references), "with --reference outline")


@dataclass(frozen=True)
class Pressing:
    """Pads and stiffness of a gripper.

    Attributes:
        pads: number of elastomers between the jaws, all pressed equally [-].
        rigid_slope: travel over indentation, per pad, for a rigid object. Values above 1 account
            for a compliant gripper or backing [-].

    Raises:
        ValueError: there is no pad.
    """

    pads: int = 2
    rigid_slope: float = 1.0

    def __post_init__(self) -> None:
        """Check the number of pads."""
        if self.pads < 1:
            raise ValueError(f"--pads is {self.pads}; the number of elastomers must be 1 or more")


@dataclass(frozen=True)
class SqueezeChoices:
    """Options of a fit by pressing: known properties of gripper, elastomer and object.

    Attributes:
        radius_mm: radius of the sphere, required with a recording [mm].
        pad_radius_mm: radius of a domed pad [mm].
        pressing: pads and stiffness of the gripper.
        poisson_ratio: Poisson's ratio of the elastomer [-].
        object_poisson: smallest and largest Poisson's ratio of the object [-].
    """

    radius_mm: float | None = field(default=None, metadata=option("none"))
    pad_radius_mm: float | None = field(default=None, metadata=option("from --sensor, or flat"))
    pressing: Pressing = field(default_factory=Pressing)
    poisson_ratio: float | None = field(default=None, metadata=option("from --sensor, or 0.48"))
    object_poisson: tuple[float, float] = (0.3, 0.5)

    def expect_used(self, source: str) -> None:
        """Check that no option was given without effect on a CSV or a recording.

        Raises:
            ValueError: one was.
        """
        given = given_options(self)
        spheres = ("--radius-mm", "--pad-radius-mm")
        if source.endswith(".csv"):
            expect_none([name for name in spheres if name in given], "on a CSV of travel")
        else:
            expect_none(given_options(self.pressing), "on a recording")
