"""Intervals of `calibration field` with a wrong model: how often they are withheld, or hold.

`python -m tests.benchmarks.misfit [DRAWS]`. A ball on a layer is pressed and twisted, and five
numbers are fitted. The measured contact differs from the model in one respect at a time. The table
shows how often χ² rejects the model, the share of accepted intervals that hold the truth, and the
share of rejected intervals that would hold it if widened by the root of χ².
"""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

from calibration.field_fit import fit_fields
from calibration.field_result import FieldData, FieldFit
from calibration.forward import FieldModel, Scene, Unknown, press_and_move
from contactmodel import Contact, Domed, Ellipsoid, Grid, HalfSpace, Layer, Placed, Pose
from estimation.estimators.measurement import Z95
from tests.benchmarks.arguments import make_parser

GRID = Grid((22, 22), (16.0, 16.0))
NOISE = np.array([1e-3, 1e-3, 3e-3])
FORCE_N, MOMENT_NMM = 0.01, 0.05
BOUNDS = {
    "shear_modulus": (0.02, 2.0),
    "thickness": (1.0, 30.0),
    "friction_coefficient": (0.05, 3.0),
    "radius": (5.0, 80.0),
    "approach": (0.05, 2.0),
}
Numbers = dict[str, Any]
Change = Callable[[Numbers, np.random.Generator], Any]


def main() -> None:
    """Print the table."""
    parser = make_parser(__doc__)
    parser.add_argument("draws", nargs="?", type=int, default=16, help="draws of each misfit")
    draws = parser.parse_args().draws
    jax.config.update("jax_enable_x64", True)
    seen = eqx.filter_jit(FieldModel(wide_scene, GRID, _markers(), frames=2).predict)
    table = Table("misfit", "χ²/freedom", "rejected", "accepted: hold", "rejected: widened hold")
    for name, change in CHANGES.items():
        found = [fit for seed in range(draws) if (fit := fit_one(seen, change, seed))]
        rejected = [pair for pair in found if not pair[0].trusted]
        accepted = [pair for pair in found if pair[0].trusted]
        table.add_row(
            name,
            f"{np.median([fit.misfit for fit, _ in found]):.2g}",
            f"{len(rejected)} of {len(found)}",
            _share([(fit.low <= truth) & (truth <= fit.high) for fit, truth in accepted]),
            _share([_widened(fit, truth) for fit, truth in rejected]),
        )
    Console().print(table)


def fit_one(seen: Callable, change: Change, seed: int) -> tuple[FieldFit, np.ndarray] | None:
    """A fit with the plain model, and the truth; None if the contact leaves the grid."""
    rng = np.random.default_rng(seed)
    true = draw_contact(rng)
    sought = {name: true[name] for name in BOUNDS}
    known = {"poisson_ratio": true["poisson_ratio"], "twist": true["twist"]}
    distort = change(true, rng) or (lambda fields: fields)
    truth = seen({name: jnp.asarray(value) for name, value in true.items()})
    if bool(truth.failed):
        return None
    fields = distort(np.asarray(truth.displacement)) + NOISE * rng.normal(
        size=truth.displacement.shape
    )
    force = np.asarray(truth.force) + FORCE_N * rng.normal(size=(2, 3))
    moment = np.asarray(truth.moment) + MOMENT_NMM * rng.normal(size=2)
    data = FieldData(fields, tuple(NOISE), force, FORCE_N, moment, MOMENT_NMM)
    numbers = {n: Unknown(1.15 * v, *BOUNDS[n]) for n, v in sought.items()}
    model = FieldModel(press_and_move("sphere"), GRID, _markers(), frames=2)
    return fit_fields(model, known | numbers, data), np.array(list(sought.values()))


def draw_contact(rng: np.random.Generator) -> Numbers:
    """A random contact that the plain model describes exactly."""
    radius, thickness = rng.uniform(10.0, 30.0), rng.uniform(2.5, 10.0)
    contact = rng.uniform(0.55, 1.0) * min(4.2, 2.2 * thickness)
    return {
        "shear_modulus": 0.2,
        "thickness": thickness,
        "friction_coefficient": rng.uniform(0.3, 1.0),
        "radius": radius,
        "approach": min(contact**2 / radius, 0.3 * thickness) * rng.uniform(0.8, 1.0),
        "poisson_ratio": 0.45,
        "twist": np.radians([0.0, rng.uniform(4.0, 12.0)]),
        "position": np.zeros(2),
        "shift": np.zeros(2),
        "dome_radius": 1e5,
        "aspect": 1.0,
        "stiffness_ratio": 1e-5,
        "marker_depth": 0.0,
        "weakening": 0.0,
    }


def wide_scene(n: Mapping[str, Any], grid: Grid) -> Scene:
    """A scene with all misfits: dome, soft object, marker depth, friction falling with pressure."""
    at = jnp.asarray(n["position"])
    axes = n["radius"] * jnp.stack([n["aspect"], 1.0 / n["aspect"], jnp.ones(())])
    shape = Domed(Placed(Ellipsoid(axes), at), n["dome_radius"])
    frames = Pose(jnp.full(2, n["approach"]), n["shift"], n["twist"], at)
    pressed = Pose(frames.approach[:1], centre=at)
    square = jnp.sum(jnp.asarray(grid.points) ** 2, axis=0) / (n["radius"] * n["approach"])
    pressure = jnp.sqrt(jnp.maximum(1.0 - square, 0.05)) / 0.7  # Hertz's, by its mean
    contact = Contact(
        Layer(n["shear_modulus"], n["poisson_ratio"], n["thickness"]),
        HalfSpace(n["shear_modulus"] / n["stiffness_ratio"], 0.48),
        shape,
        grid,
        n["friction_coefficient"] * pressure ** -n["weakening"],
        n["marker_depth"],
    )
    return Scene(contact, jax.tree.map(lambda *legs: jnp.concatenate(legs), pressed, frames))


def correlated(_: Numbers, rng: np.random.Generator) -> Callable:
    """Noise correlated over 1 to 4 mm, 2 to 8 times the noise given to the fit."""
    apart = np.sum((_markers()[:, None] - _markers()) ** 2, axis=-1)
    kernel = np.exp(-apart / (2.0 * rng.uniform(1.0, 4.0) ** 2))
    root = np.linalg.cholesky(kernel + 1e-8 * np.eye(len(kernel)))
    smooth = np.einsum("ab,fbc->fac", root, rng.normal(size=(2, len(root), 3)))
    return lambda fields: fields + rng.uniform(2.0, 8.0) * NOISE * smooth


def _set(name: str, draw: Callable[[np.random.Generator], Any]) -> Change:
    """A change of one number of the truth, unknown to the fit."""
    return lambda true, rng: true.update({name: draw(rng)})


def _turn(true: Numbers, rng: np.random.Generator) -> None:
    true["twist"] = true["twist"] * rng.choice([0.9, 0.95, 1.05, 1.1])


def _stretch(axes: tuple[bool, bool, bool], by: tuple[float, ...]) -> Change:
    """Displacements measured with a wrong scale along some axes."""

    def change(_: Numbers, rng: np.random.Generator) -> Callable:
        scale = np.where(axes, rng.choice(by), 1.0)
        return lambda fields: fields * scale

    return change


CHANGES: dict[str, Change] = {
    "none": lambda true, rng: None,
    "ν 0.3 to 0.5 for 0.45": _set("poisson_ratio", lambda rng: rng.choice([0.3, 0.36, 0.49, 0.5])),
    "friction falls with pressure": _set("weakening", lambda rng: rng.uniform(0.15, 0.5)),
    "correlated noise": correlated,
    "markers 0.1 to 0.6 mm deep": _set("marker_depth", lambda rng: rng.uniform(0.1, 0.6)),
    "twist 5 or 10 % off": _turn,
    "soft object, k 0.05 to 0.5": _set("stiffness_ratio", lambda rng: rng.uniform(0.05, 0.5)),
    "elongated, 1.1 to 1.7": _set("aspect", lambda rng: rng.uniform(1.05, 1.3)),
    "0.3 mm off the axis": _set("position", lambda rng: rng.normal(size=2) * 0.3),
    "shifted by 0.05 mm": _set("shift", lambda rng: rng.normal(size=2) * 0.05),
    "lengths 2 or 5 % off": _stretch((True, True, True), (0.95, 0.98, 1.02, 1.05)),
    "z 5 or 10 % off": _stretch((False, False, True), (0.9, 0.95, 1.05, 1.1)),
}


def _markers() -> np.ndarray:
    """Positions of 14 by 14 markers over the whole grid [mm]."""
    at = np.linspace(GRID.x[0], GRID.x[-1], 14) * 0.99
    return np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)


def _widened(fit: FieldFit, truth: np.ndarray) -> np.ndarray:
    """Whether the intervals, widened by the root of χ², hold the truth."""
    error = np.sqrt(np.diag(fit.covariance) * fit.misfit)
    return np.abs(np.log(fit.values / truth)) <= Z95 * error


def _share(held: list[np.ndarray]) -> str:
    """The number of holding intervals, of all."""
    every = np.concatenate(held) if held else np.zeros(0)
    return f"{np.count_nonzero(every)} of {every.size}"


if __name__ == "__main__":
    main()
