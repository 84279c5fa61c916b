"""What the fits of softness are told, as the command line takes it: plain values with units."""

from dataclasses import dataclass, field

from calibration.softness import LOAD_MODELS
from contactmodel.common.options import option


@dataclass(frozen=True)
class ReferenceSettings:
    """How references are read.

    Attributes:
        flip: turn the references' sign.
        zeroed: the references count from the onset of contact: fit L.
        same_clock: CSV and recording have one clock.
    """

    flip: bool = False
    zeroed: bool = False
    same_clock: bool = False


@dataclass(frozen=True)
class SoftnessChoices:
    """How k and L are fitted, and what is known of the elastomer.

    Attributes:
        references: how references are read.
        clock_search: how far clocks may be apart at most [s].
        load: how L is taken.
        noise_um: marker noise per in-plane coordinate [µm].
        second_ratio: two fingers of one grasp, no reference: k on the first over second.
        thickness_mm: of an elastomer that is not thick beside the contact [mm], inf of one that is;
            a finite one needs CSVs with --zeroed and --same-clock.
        depth_mm: of its markers below the surface [mm].
        radius_mm: of a ball, which gives way more where it is held by a larger part [mm]; inf of an
            object with a flat surface. Needs what a finite thickness needs.

    Raises:
        ValueError: the search is below 0, or the radius not above it.
    """

    references: ReferenceSettings = field(default_factory=ReferenceSettings)
    clock_search: float = 1.0
    load: str | None = field(
        default=None, metadata=option("by BIC", more=f" Of {', '.join(LOAD_MODELS)}.")
    )
    noise_um: float | None = field(
        default=None, metadata=option("of --sensor, or from each recording")
    )
    second_ratio: float | None = field(default=None, metadata=option("none"))
    thickness_mm: float | None = field(default=None, metadata=option("of --sensor, or inf"))
    depth_mm: float | None = field(default=None, metadata=option("of --sensor, or 0"))
    radius_mm: float = float("inf")

    def __post_init__(self) -> None:
        """Check the search; the pad checks what is its own."""
        if not self.clock_search >= 0.0:
            raise ValueError(
                f"clocks are searched for {self.clock_search:g} s (--clock-search): 0 or more"
            )
        if not self.radius_mm > 0.0:
            raise ValueError(
                f"the ball has a radius of {self.radius_mm:g} mm (--radius-mm): give one above 0, "
                "or inf for a flat surface"
            )


@dataclass(frozen=True)
class Pressing:
    """What presses, and how a gripper closes.

    Attributes:
        pads: elastomers between the jaws, each pressed alike [-].
        rigid_slope: travel over indentation and pad of a rigid object; more than 1 is the gripper's
            own give and the pad's backing [-].

    Raises:
        ValueError: fewer than one pad.
    """

    pads: int = 2
    rigid_slope: float = 1.0

    def __post_init__(self) -> None:
        """Check the number of pads."""
        if self.pads < 1:
            raise ValueError(f"{self.pads} elastomers between the jaws (--pads): 1 or more")


@dataclass(frozen=True)
class SqueezeChoices:
    """What is known of gripper and bodies.

    Attributes:
        radius_mm: radius of the sphere [mm], for a recording.
        pad_radius_mm: radius of a domed pad [mm].
        pressing: how a gripper closes.
        poisson_ratio: of the elastomer [-].
        object_poisson: least and greatest of the object [-].
    """

    radius_mm: float | None = field(default=None, metadata=option("none"))
    pad_radius_mm: float | None = field(default=None, metadata=option("of --sensor, or flat"))
    pressing: Pressing = field(default_factory=Pressing)
    poisson_ratio: float | None = field(default=None, metadata=option("of --sensor, or 0.48"))
    object_poisson: tuple[float, float] = (0.3, 0.5)
