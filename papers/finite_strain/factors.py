"""Force and moment with and without the corrections of a `Layer`, against `samples.csv`.

`fit_factors` fits the coefficients of `contactmodel.elasticity.corrections` to the covered samples
that are not held out, and `fit_limit` those of the limit of friction (in
`contactmodel.elasticity.reading`) to the contacts of `data/fields.npz` that `fields` does not hold
out. `python -m papers.finite_strain.factors` prints both. Forces on meshes that grow by 1.2 are
reduced by 0.5 %, the difference from a growth of 1.12, measured on a sphere at two depths; by 1.15,
by 0.2 %, which is interpolated.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from contactmodel import ContactSolution, Coulomb, Layer, Pose, solve_path
from contactmodel.elasticity.corrections import (
    Correction,
    Loading,
    narrow,
    stiffen,
)
from contactmodel.elasticity.reading import LIMIT, raise_limit
from contactmodel.indenters import measure_shape
from papers.finite_strain import field_fits, fields
from papers.finite_strain.model import find_scale, make_contact
from papers.finite_strain.samples import Sample, read_samples
from papers.finite_strain.settings import SHEAR_MODULUS
from papers.finite_strain.steps import press_and_turn
from papers.finite_strain.surface import TurnedContact
from papers.items import Track

_PRESSES = 4
_GROWN = {1.12: 0.0, 1.15: 0.002, 1.2: 0.005}


class Errors(NamedTuple):
    """Relative errors of the model by step [-].

    Attributes:
        before: of force and moment without the corrections.
        after: with the corrections.
        covered: whether the corrections cover all steps.
    """

    before: Float[np.ndarray, "2 steps"]
    after: Float[np.ndarray, "2 steps"]
    covered: bool


class _Solved(NamedTuple):
    """The linear contact of a sample on the common grid, and the sample over it."""

    loading: Loading
    depth: Array
    poisson_ratio: Array
    thickness: Array
    pad: Array
    ratio: np.ndarray


def compute(quick: bool = False, track: Track = iter) -> dict[int, Errors]:
    """Solve the samples, by their place in the table; the quick size has two samples."""
    samples = read_samples()
    chosen = [index for index, sample in enumerate(samples) if sample.held_out]
    return {i: compare(samples[i]) for i in track(chosen[4:6] if quick else range(len(samples)))}


def compare(sample: Sample) -> Errors:
    """Errors of force and moment without and with the corrections."""
    scale, path = _solve(sample)
    kept = slice(_PRESSES - 1, None)
    after, reference = _results(path, scale), _reference(sample)
    covered = bool(np.all(np.asarray(path.correction.covered)[kept]))
    before = _results(_solve(sample, corrected=False)[1], scale)
    return Errors(before / reference - 1.0, after / reference - 1.0, covered)


def _reference(sample: Sample) -> Float[np.ndarray, "2 steps"]:
    """Force and moment [N, N·mm]; infinite where no moment acts."""
    moment = np.where(sample.angle_deg == 0.0, np.inf, sample.moment_nmm)
    return np.stack([sample.force_n * (1.0 - _GROWN[sample.growth]), moment])


def _solve(sample: Sample, *, corrected: bool = True) -> tuple[float, ContactSolution]:
    """The scale of lengths, and the solutions: pressed on in steps, then turned."""
    margin = 1.12 if sample.pad_mm > 3.0 * sample.thickness_mm else 1.3
    scale = find_scale(margin * sample.contact_mm, sample.flat_mm, sample.edge_mm)
    flat, edge, depth = (scale * length for length in sample[:3])
    thickness, pad = scale * sample.thickness_mm, scale * sample.pad_mm
    gel = Layer(SHEAR_MODULUS, sample.poisson_ratio, thickness)
    if corrected:
        gel = Layer(SHEAR_MODULUS, sample.poisson_ratio, thickness, pad, neo_hookean=True)
    contact = make_contact(gel, flat, edge, sample.friction)
    steps = len(sample.angle_deg)
    pressed = depth * np.arange(1, _PRESSES + 1) / _PRESSES
    approach = np.concatenate([pressed, np.full(steps - 1, depth)])
    twist = np.radians(np.concatenate([np.zeros(_PRESSES - 1), sample.angle_deg]))
    return scale, solve_path(contact, Pose(approach, twist=twist, corotated=True), rtol=1e-5)


def fit_factors() -> dict[str, Float[np.ndarray, " numbers"]]:
    """Fit the coefficients: first on wide pads, then on narrow ones."""
    kept = [s for s in read_samples() if not s.held_out and compare(s).covered]
    wide = [sample for sample in kept if _is_wide(sample)]
    side = [sample for sample in kept if not _is_wide(sample)]
    known = [(sample, _measure(sample)) for sample in wide]

    def stiffened(solved: _Solved, numbers: np.ndarray) -> np.ndarray:
        args = solved.loading, solved.depth, solved.poisson_ratio, solved.thickness
        return _stack(stiffen(*args, tuple(numbers)))

    def gel_errors(numbers: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                (0.7 if sample.friction != 0.5 else 1.0)
                * (stiffened(solved, numbers) - solved.ratio)[solved.ratio > 0.0]
                / (0.01 if sample.depth_mm < 0.14 * sample.thickness_mm else 0.02)
                for sample, solved in known
            ]
        )

    gel = least_squares(gel_errors, [-0.2, 0.8, 10.0, 0.4, 0.1, 0.3, -0.4, 0.8]).x
    narrowed = [(one, one.ratio / stiffened(one, gel)) for one in map(_measure, side)]

    def side_errors(numbers: np.ndarray) -> np.ndarray:
        pair = tuple(numbers[:5]), tuple(numbers[5:])
        return np.concatenate(
            [
                (
                    _stack(narrow(one.loading, one.poisson_ratio, one.thickness, one.pad, pair))
                    - rest
                )[rest > 0]
                for one, rest in narrowed
            ]
        )

    start = [0.6, 0.2, 1.7, 3.0, 8.0]
    pad = least_squares(side_errors, [*start, *start]).x
    return {"gel": gel, "side, force": pad[:5], "side, moment": pad[5:]}


class Turned(NamedTuple):
    """A stored contact, pressed and turned by 10 and 20°, and the model as shipped."""

    weight: Float[np.ndarray, " points"]  # 2πr dr of the points, up to a factor [mm²]
    true: Float[np.ndarray, "3 points 3"]  # u_r, u_θ and u_z [mm]
    model: Float[np.ndarray, "3 points 3"]
    rubbed: Float[np.ndarray, "2 points"]  # derivative of u_θ by the logarithm of the limit [mm]
    limit: Callable[[tuple[float, float]], float]  # factor on the limit by c₄ and c₅ [-]


def fit_limit() -> Float[np.ndarray, "2"]:
    """Fit c₄ and c₅ to u_θ at 10 and 20°, by a linear estimate of the effect of the limit."""
    held = {c[:4] + c[6:7] for c in fields.CASES if c.held_out and c.second_share == 0.0}
    stored = zip(field_fits.CASES, field_fits.read_fields(), strict=True)
    kept = [(case, one) for case, one in stored if case[:4] + case[6:7] not in held]
    known = [measure_field(case, one) for case, one in kept]

    def errors(numbers: np.ndarray) -> np.ndarray:
        return np.concatenate([twist_errors(one, numbers) for one in known])

    return least_squares(errors, LIMIT, diff_step=1e-3).x


def twist_errors(one: Turned, numbers: np.ndarray) -> np.ndarray:
    """Errors of u_θ since the press at both twists, relative to its norm, with c₄ and c₅ [-]."""
    raised = one.limit((numbers[0], numbers[1])) / one.limit(LIMIT) - 1.0
    true, model = (field[1:, :, 1] - field[0, :, 1] for field in (one.true, one.model))
    error = model + raised * one.rubbed - true
    size = np.sqrt(np.sum(one.weight * true**2, axis=1, keepdims=True))
    return (np.sqrt(one.weight) * error / size).ravel()


def measure_field(case: fields.Case, one: TurnedContact) -> Turned:
    """The model of a stored contact, with the derivative of its twist by the limit of friction."""
    seen = one.surface.radius <= 3.0 * one.contact_mm
    radius = one.surface.radius[seen]
    scale = find_scale(1.1 * one.contact_mm + 0.15, case.flat_mm, case.edge_mm)
    flat, edge, depth, thickness = (scale * case[i] for i in (0, 1, 2, 6))
    gel = Layer(SHEAR_MODULUS, case.poisson_ratio, thickness, neo_hookean=True)
    approach, twist = np.array(press_and_turn(depth, _PRESSES, (5.0, 10.0, 15.0, 20.0))).T
    pose, kept = Pose(approach, twist=twist, corotated=True), [_PRESSES - 1, 5, 7]
    contacts = [make_contact(gel, flat, edge, case.friction * more) for more in (1.0, 1.02)]
    paths = [solve_path(contact, pose, rtol=1e-5) for contact in contacts]
    models = [fields.read_radially(path, scale * radius)[kept] / scale for path in paths]
    points = jnp.asarray(contacts[0].grid.points)
    shape = measure_shape(contacts[0].indenter, points)

    def limit(numbers: tuple[float, float], more: float = 1.0) -> float:
        law = Coulomb(case.friction * more)
        return more * float(raise_limit(law, gel, shape, points, jnp.array(depth), numbers).gain)

    risen = np.log(limit(LIMIT, 1.02) / limit(LIMIT))
    since = [model[1:, :, 1] - model[0, :, 1] for model in models]
    return Turned(
        np.gradient(radius) * radius,
        one.surface.moved[:, seen],
        models[0],
        (since[1] - since[0]) / risen,
        limit,
    )


def _is_wide(sample: Sample) -> bool:
    """Whether the pad's radius is four thicknesses or more."""
    return sample.pad_mm >= 4.0 * sample.thickness_mm


def _measure(sample: Sample) -> _Solved:
    scale, path = _solve(sample)
    kept = slice(_PRESSES - 1, None)
    turned = np.stack([np.ones(len(sample.angle_deg), dtype=bool), sample.angle_deg > 0.0])
    linear = _results(path, scale) / _stack(path.correction)[:, kept]
    ratio = np.where(turned, _reference(sample) / np.where(turned, linear, 1.0), 0.0)
    loading = Loading(*(part[kept] for part in path.loading))
    depth, thickness, pad = (jnp.asarray(scale * sample[i]) for i in (2, 6, 5))
    return _Solved(loading, depth, jnp.asarray(sample.poisson_ratio), thickness, pad, ratio)


def _results(path: ContactSolution, scale: float) -> Float[np.ndarray, "2 steps"]:
    """Force [N] and moment [N·mm] when pressed and turned, at the sample's own scale."""
    kept = slice(_PRESSES - 1, None)
    return np.stack([-path.force[kept, 2] / scale**2, path.moment[kept] / scale**3])


def _stack(correction: Correction) -> Float[np.ndarray, "2 steps"]:
    return np.stack([correction.force, correction.moment])


def tables(result: dict[int, Errors]) -> dict[str, list[dict[str, object]]]:
    """A row for each sample: errors without and with the corrections, in per cent."""
    rows: list[dict[str, object]] = []
    for index, errors in result.items():
        sample = read_samples()[index]
        turned = [np.flatnonzero(sample.angle_deg == angle)[0] for angle in (5.0, 10.0, 20.0)]
        row: dict[str, object] = {
            "object": f"punch {sample.flat_mm:g}" if sample.flat_mm else f"R {sample.edge_mm:g}",
            "thickness [mm]": sample.thickness_mm,
            "pad [mm]": sample.pad_mm,
            "depth/h": round(sample.depth_mm / sample.thickness_mm, 3),
            "ν": sample.poisson_ratio,
            "μ": sample.friction,
            "held out": sample.held_out,
            "covered": errors.covered,
        }
        for name, (force, moment) in (("before", errors.before), ("after", errors.after)):
            row |= {f"force, {name} [%]": round(100.0 * float(force[0]), 1)}
            row |= {f"force, 20°, {name} [%]": round(100.0 * float(force[turned[2]]), 1)}
            for i, angle in zip(turned, (5, 10, 20), strict=True):
                row |= {f"moment, {angle}°, {name} [%]": round(100.0 * float(moment[i]), 1)}
        rows.append(row)
    return {"": rows}


def plot(result: dict[int, Errors]) -> Figure:
    """Largest errors over depth up to 20°; grey: without corrections; open: held out."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained", sharey=True)
    for index, errors in result.items():
        sample = read_samples()[index]
        depth, face = sample.depth_mm / sample.thickness_mm, "none" if sample.held_out else None
        turned = (sample.angle_deg > 0.0) & (sample.angle_deg < 21.0)
        mark = "o" if _is_wide(sample) else "^"
        for values, colour in ((errors.before, "0.7"), (errors.after, "C0")):
            for axis, row in zip(axes, values, strict=True):
                worst = row[turned][np.argmax(np.abs(row[turned]))]
                axis.plot(depth, 100.0 * worst, mark, ms=5, color=colour, mfc=face or colour)
    for axis, name in zip(axes, ("force", "moment"), strict=True):
        axis.set_title(f"{name}; triangles: narrow pads; open: held out; grey: linear", fontsize=10)
        axis.set_xlabel("depth over thickness [-]")
        axis.axhline(0.0, color="k", lw=0.8)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("model over reference − 1 [%]")
    return figure


def main() -> None:
    """Fit all coefficients again, and print them."""
    for name, numbers in ({"limit of friction": fit_limit()} | fit_factors()).items():
        print(f"{name}: {', '.join(f'{number:.3g}' for number in numbers)}", flush=True)


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    main()
