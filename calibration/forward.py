"""The forward model of experiments: measurements that a contact with unknown numbers predicts.

The numbers of an experiment have names: `shear_modulus`, `thickness`, `twist`. Each is known, or an
`Unknown` between bounds. A `scene` turns them into bodies, shape and path.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.interpolate import make_interp_spline

from contactmodel import (
    AbstractIndenter,
    Contact,
    Cylinder,
    Domed,
    Grid,
    HalfSpace,
    Layer,
    Paraboloid,
    Placed,
    Pose,
    Rigid,
    RoundPunch,
    Sphere,
    SquarePunch,
    solve_path,
)
from contactmodel.common.arrays import AnyArray
from contactmodel.solution import RESULTS

UNITS = {
    "shear_modulus": "MPa",
    "poisson_ratio": "-",
    "thickness": "mm",
    "stiffness_ratio": "-",
    "friction_coefficient": "-",
    "marker_depth": "mm",
    "radius": "mm",
    "width": "mm",
    "edge_radius": "mm",
    "dome_radius": "mm",
    "position": "mm",
    "approach": "mm",
    "shift": "mm",
    "twist": "rad",
}
"""Units of the numbers of `press_and_move`."""

_PRESSES = 4  # steps of pressing at finite strain; in one step friction carries too much
_SOLVER_RTOL = 1e-7  # marker noise is at least 1e-3 of the markers' displacement


@dataclass(frozen=True)
class Unknown:
    """An unknown number, or several, between bounds.

    If both bounds are above 0, the fit varies the logarithm, and errors are relative.

    Attributes:
        start: first guess; an array for several numbers, such as one per frame.
        low: lower bound.
        high: upper bound.
        prior: mean and standard deviation of prior knowledge, if any.

    Raises:
        ValueError: the bounds are not finite and in order, the start is outside them, or the prior
            is not valid.
    """

    start: Float[np.ndarray, "..."] | float
    low: float
    high: float
    prior: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (np.isfinite([self.low, self.high]).all() and self.low < self.high):
            raise ValueError(f"the bounds {self.low}, {self.high} must be finite and in order")
        start = np.asarray(self.start, dtype=float)
        if not ((self.low < start) & (start < self.high)).all():
            raise ValueError(
                f"the start {self.start} must lie between the bounds {self.low} and {self.high}"
            )
        if self.prior is not None and not self.prior[1] > 0.0:
            raise ValueError(
                f"the prior's standard deviation is {self.prior[1]}; it must be above 0"
            )
        if self.prior is not None and self.logarithmic and not self.prior[0] > 0.0:
            raise ValueError(
                f"the prior's mean is {self.prior[0]}; it must be above 0, as both bounds are"
            )

    @property
    def logarithmic(self) -> bool:
        """Whether the fit varies the logarithm."""
        return self.low > 0.0


class Scene(NamedTuple):
    """A contact experiment with numbers filled in, as input of `contactmodel.solve_path`.

    Attributes:
        contact: bodies, shape, friction, grid and depth of the markers.
        path: poses from rest; the last ones are the measured frames.
        origin: where the middle of the contact's grid lies among the markers [mm].
    """

    contact: Contact
    path: Pose
    origin: Float[AnyArray, "2"] | tuple[float, float] = (0.0, 0.0)

    @property
    def axis(self) -> Float[AnyArray, "2"]:
        """Place of the last twist's axis among the markers [mm]."""
        return self.path.centre[-1] + jnp.asarray(self.origin)


MakeScene = Callable[[Mapping[str, Any], Grid], Scene]

_SHAPES: dict[str, Callable[[Mapping[str, Any]], AbstractIndenter]] = {
    "paraboloid": lambda n: Paraboloid(n["radius"]),
    "sphere": lambda n: Sphere(n["radius"]),
    "cylinder": lambda n: Cylinder(n["radius"]),
    "disc": lambda n: RoundPunch(n["radius"], n.get("edge_radius", 0.0)),
    "cube": lambda n: SquarePunch(n["width"], n.get("edge_radius", 0.0)),
}
SHAPES = tuple(_SHAPES)
"""Names of the shapes of `press_and_move`."""


@cache
def press_and_move(shape: str, *, finite_strain: bool = False) -> MakeScene:
    """Make scenes in which an object is pressed to the depth of the first frame, then moved.

    Required numbers are `shear_modulus`, `poisson_ratio`, `friction_coefficient`, `approach`, and
    the `radius` or `width` of the shape. Optional are `thickness` (without it, a half-space),
    `stiffness_ratio` k (without it, a rigid object), `marker_depth`, `dome_radius` of the pad
    (without it, flat), `position` of the object's lowest point, `shift`, `twist` and the shape's
    `edge_radius`. `approach`, `twist` and `shift` may have one value per frame.

    Args:
        shape: name of the shape, one of `SHAPES`.
        finite_strain: whether the gel is neo-Hookean and the poses are corotated, as
            `contactmodel` corrects them. This requires a `thickness`, and excludes
            `stiffness_ratio`, `marker_depth` and `dome_radius`. The grid then follows `position`.

    Returns:
        A function that makes a scene from numbers and a grid.

    Raises:
        ValueError: the shape is unknown; the function, if numbers do not match `finite_strain`.
    """
    if shape not in _SHAPES:
        raise ValueError(f"unknown shape {shape!r}; choose from {', '.join(SHAPES)}")

    def scene(numbers: Mapping[str, Any], grid: Grid) -> Scene:
        if finite_strain:
            _check_finite_strain(numbers)
        modulus, nu = numbers["shear_modulus"], numbers["poisson_ratio"]
        thickness, k = numbers.get("thickness"), numbers.get("stiffness_ratio")
        position = jnp.asarray(numbers.get("position", (0.0, 0.0)))
        origin = position if finite_strain else jnp.zeros(2)  # twists about the grid's middle
        position = position - origin
        indenter: AbstractIndenter = Placed(_SHAPES[shape](numbers), position)
        if "dome_radius" in numbers:
            indenter = Domed(indenter, numbers["dome_radius"])
        path = _make_path(numbers, position, finite_strain)
        contact = Contact(
            HalfSpace(modulus, nu)
            if thickness is None
            else Layer(modulus, nu, thickness, neo_hookean=finite_strain),
            Rigid() if k is None else HalfSpace(modulus / k, nu),
            indenter,
            grid,
            numbers["friction_coefficient"],
            numbers.get("marker_depth"),
        )
        return Scene(contact, path, origin)

    return scene


def _make_path(numbers: Mapping[str, Any], centre: Array, finite_strain: bool) -> Pose:
    """Pressing in one or several steps, then the measured frames."""
    frames = Pose(
        jnp.atleast_1d(jnp.asarray(numbers["approach"])),
        jnp.asarray(numbers.get("shift", (0.0, 0.0))),
        jnp.asarray(numbers.get("twist", 0.0)),
        centre,
        corotated=finite_strain,
    )
    steps = _PRESSES if finite_strain else 1
    share = (jnp.arange(steps) + 1.0) / steps
    pressed = Pose(share * frames.approach[0], centre=centre, corotated=finite_strain)
    return jax.tree.map(lambda *legs: jnp.concatenate(legs), pressed, frames)


def _interpolate(centres: Float[np.ndarray, " c"], at: Float[Array, " n"]) -> Float[Array, "n c"]:
    """Weights of cells in a cubic spline at some places, by the Cox–de Boor recursion."""
    spline = make_interp_spline(centres, np.eye(len(centres)))
    knots, degree = spline.t, spline.k
    at = jnp.clip(at, centres[0], centres[-1])[:, None]
    last = len(knots) - degree - 2
    interval = jnp.clip(jnp.searchsorted(knots, at, side="right") - 1, degree, last)
    basis = jnp.where(jnp.arange(len(knots) - 1) == interval, 1.0, 0.0)
    for k in range(1, degree + 1):
        width = knots[k:] - knots[:-k]
        share = jnp.where(width > 0.0, (at - knots[:-k]) / np.where(width > 0.0, width, 1.0), 0.0)
        basis = share[:, :-1] * basis[:, :-1] + (1.0 - share[:, 1:]) * basis[:, 1:]
    return basis @ spline.c


_UNCORRECTED = ("stiffness_ratio", "marker_depth", "dome_radius")


def _check_finite_strain(numbers: Mapping[str, Any]) -> None:
    """Refuse numbers for which the corrections of finite strain do not exist."""
    if "thickness" not in numbers:
        raise ValueError("finite_strain requires the number thickness: give the gel's thickness")
    for name in _UNCORRECTED:
        if name in numbers:
            raise ValueError(
                f"finite_strain does not cover the number {name}: leave out {name}, or "
                "finite_strain"
            )


def _has_nan(numbers: Any) -> Bool[Array, ""]:
    """Whether any number is NaN, as a wrong one is during a fit (`wrong_is_nan`)."""
    leaves = jax.tree.leaves(eqx.filter(numbers, eqx.is_inexact_array))
    return jnp.any(jnp.stack([jnp.any(jnp.isnan(leaf)) for leaf in leaves]))


class Prediction(NamedTuple):
    """Predicted measurements of a sensor."""

    displacement: Float[AnyArray, "frames n 3"]  # displacements of the markers [mm]
    force: Float[AnyArray, "frames 3"]  # force of the object on the elastomer [N]
    moment: Float[AnyArray, " frames"]  # moment about z through the origin of the grid [N·mm]
    slip_width: Float[AnyArray, ""]  # largest width of the slipping ring in any step [cells]
    radius: Float[AnyArray, ""]  # largest radius of the contact, of the circle of its area [mm]
    covered: Float[AnyArray, ""]  # whether all frames are in the range of the corrections; 1 or 0
    # whether a step of the contact could not be solved, or a number was not valid
    failed: Bool[AnyArray, ""]


class FieldModel(eqx.Module):
    """A scene, its grid and its markers.

    Attributes:
        scene: function that makes the scene from numbers and the grid.
        grid: cells; they must cover all markers, and more than the contact.
        frames: number of measured frames, the last steps of the path.
        markers: positions of the markers in the unloaded elastomer [mm].
    """

    scene: MakeScene = eqx.field(static=True)
    grid: Grid = eqx.field(static=True)
    frames: int = eqx.field(static=True)
    markers: Float[np.ndarray, "n 2"]

    def __init__(
        self, scene: MakeScene, grid: Grid, markers: Float[np.ndarray, "n 2"], frames: int = 1
    ) -> None:
        """Make a model; cubic splines interpolate the fields from the cells to the markers.

        Args:
            scene: function that makes the scene; see `press_and_move`.
            grid: cells.
            markers: positions of the markers in the unloaded elastomer [mm].
            frames: number of measured frames, the last steps of the path.

        Raises:
            ValueError: a marker lies outside the centres of the outermost cells.
        """
        for x, cells, axis in zip(markers.T, (grid.x, grid.y), "xy", strict=True):
            if not (np.abs(x) <= cells[-1]).all():
                raise ValueError(
                    f"markers reach to {np.abs(x).max():.2f} mm along {axis}, the grid's outermost "
                    f"cells to {cells[-1]:.2f} mm: use a larger grid, or leave markers out"
                )
        self.scene, self.grid, self.frames = scene, grid, frames
        self.markers = markers

    def predict(self, numbers: Mapping[str, Any]) -> Prediction:
        """Predict the measurements; differentiable by the numbers."""
        contact, poses, origin = self.scene(numbers, self.grid)
        at = jnp.asarray(self.markers) - jnp.asarray(origin)
        path = solve_path(contact, poses, rtol=_SOLVER_RTOL, throw=False)
        fields = path.elastomer_displacement(contact.marker_depth)[-self.frames :]
        force, centre = path.force[-self.frames :], poses.centre[-self.frames :]
        touching, sticking = (jnp.sum(part, axis=(1, 2)) for part in (path.contact, path.stick))
        radius, stick_radius = jnp.sqrt(touching / jnp.pi), jnp.sqrt(sticking / jnp.pi)
        arm = centre + jnp.asarray(origin)
        lever = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
        return Prediction(
            jnp.einsum(
                "na,nb,fcab->fnc",
                _interpolate(self.grid.x, at[:, 0]),
                _interpolate(self.grid.y, at[:, 1]),
                fields,
            ),
            force,
            path.moment[-self.frames :] + lever,
            jnp.max(radius - stick_radius),
            jnp.max(radius) * jnp.sqrt(self.grid.cell_area),
            jnp.all(path.correction.covered[-self.frames :]).astype(force.dtype),
            jnp.any((path.result != RESULTS.successful) & (path.result != RESULTS.no_contact))
            | _has_nan((contact, poses)),
        )
