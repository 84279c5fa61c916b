"""Shear modulus, thickness and friction from fields: errors, flagged numbers and coverage.

A ball is pressed on a bonded layer and twisted. 400 markers, with noise of 1 µm in the plane and
3 µm along z, show both states; force and moment are measured. Five numbers are fitted from starting
values that are 25 to 50 % off. The fitted fields come from a finer grid, so the errors include that
of the fit's own grid. The coverage of the intervals is counted over many draws of noise, with
fields and fits on one coarse grid.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import equinox as eqx
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from calibration.field_fit import fit_fields
from calibration.field_result import FieldData, FieldFit
from calibration.forward import FieldModel, Prediction, Unknown, press_and_move
from contactmodel import Grid
from papers.items import Track

NOISE_MM = (1e-3, 1e-3, 3e-3)
FORCE_N, MOMENT_NMM = 0.01, 0.05
CELLS, FINE_CELLS, SIZE_MM = 64, 128, 14.0
DRAWS = 3
COVER_CELLS, COVER_DRAWS = 24, 300

SOUGHT = {
    "shear_modulus": Unknown(0.3, 0.02, 2.0),
    "thickness": Unknown(5.0, 1.0, 25.0),
    "friction_coefficient": Unknown(0.4, 0.05, 3.0),
    "radius": Unknown(20.0, 5.0, 60.0),
    "approach": Unknown(0.4, 0.05, 2.0),
}
_TRUTH = {
    "shear_modulus": 0.2,
    "poisson_ratio": 0.45,
    "thickness": 4.0,
    "friction_coefficient": 0.6,
    "radius": 15.0,
    "approach": 0.5,
    "twist": np.radians([0.0, 8.6]),
}


class Experiment(NamedTuple):
    """A contact and its measured quantities."""

    name: str  # description for readers
    changed: Mapping[str, Any] = {}  # numbers that differ from the common truth, by name
    forces: bool = True  # whether force and moment are measured
    along_z: bool = True  # whether the markers' displacement along z is measured

    @property
    def truth(self) -> dict[str, Any]:
        """The true value of every number, by name."""
        return {name: np.asarray(value) for name, value in (_TRUTH | dict(self.changed)).items()}

    @property
    def numbers(self) -> dict[str, Any]:
        """The numbers given to the fit: true values, and start and range of the unknown ones."""
        return self.truth | SOUGHT


EXPERIMENTS = (
    Experiment("pressed and twisted"),
    Experiment("on 2 mm", {"thickness": 2.0}),
    Experiment("on 8 mm", {"thickness": 8.0}),
    Experiment("on 16 mm", {"thickness": 16.0}),
    Experiment("no motion along z", along_z=False),
    Experiment("no forces", forces=False),
    Experiment("pressed only", {"twist": np.zeros(2)}),
    Experiment("all sticks", {"friction_coefficient": 2.0, "twist": np.radians([0.0, 0.5])}),
)
COVERED = (0, 4, 5)
"""Indices of the experiments whose coverage is counted."""


class Result(NamedTuple):
    """Fits of the experiments.

    Attributes:
        fits: fits by experiment, one for each draw of noise.
        inside: by experiment, whether the interval of each draw and number holds the truth; NaN
            without an interval.
    """

    fits: dict[str, list[FieldFit]]
    inside: dict[str, Float[np.ndarray, "draws p"]]


def compute(quick: bool = False, track: Track = iter) -> Result:
    """Fit every experiment, and for the coverage some of them many times."""
    chosen = EXPERIMENTS[5:6] if quick else EXPERIMENTS
    covered = () if quick else tuple(EXPERIMENTS[i] for i in COVERED)
    cells, fine = (COVER_CELLS, COVER_CELLS) if quick else (CELLS, FINE_CELLS)
    jobs = [(experiment, cells, fine, 1 if quick else DRAWS) for experiment in chosen]
    jobs += [(experiment, COVER_CELLS, COVER_CELLS, COVER_DRAWS) for experiment in covered]
    fitted = [_fit(*job) for job in track(jobs)]
    return Result(
        {e.name: fits for e, fits in zip(chosen, fitted[: len(chosen)], strict=True)},
        {
            experiment.name: np.stack([_holds(experiment, fit) for fit in fits])
            for experiment, fits in zip(covered, fitted[len(chosen) :], strict=True)
        },
    )


def _fit(experiment: Experiment, cells: int, fine: int, draws: int) -> list[FieldFit]:
    """Fits on a grid of `cells`² to fields from a grid of `fine`², one for each draw of noise."""
    exact = _predict(plan(fine), experiment.truth)
    return [
        fit_fields(plan(cells), experiment.numbers, measure(exact, experiment, draw))
        for draw in range(draws)
    ]


def _holds(experiment: Experiment, fit: FieldFit) -> Float[np.ndarray, " p"]:
    truth = _sought(experiment)
    return np.where(np.isfinite(fit.low), (fit.low <= truth) & (truth <= fit.high), np.nan)


def _sought(experiment: Experiment) -> Float[np.ndarray, " p"]:
    return np.array([experiment.truth[name] for name in SOUGHT])


_BALL = press_and_move("sphere")
_predict = eqx.filter_jit(FieldModel.predict)


@lru_cache
def plan(cells: int) -> FieldModel:
    """The model of both states, on a grid with `cells` along a side."""
    at = 0.5 * (np.arange(20) - 9.5)
    markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
    return FieldModel(_BALL, Grid((cells, cells), (SIZE_MM, SIZE_MM)), markers, frames=2)


def measure(seen: Prediction, experiment: Experiment, draw: int) -> FieldData:
    """The data of an experiment with a draw of noise.

    Args:
        seen: fields, force and moment without noise.
        experiment: the experiment; it determines which data are NaN.
        draw: seed of the noise.
    """
    rng = np.random.default_rng(draw)
    fields, force, moment = (
        np.asarray(value) + error * rng.normal(size=value.shape)
        for value, error in zip(seen[:3], (np.array(NOISE_MM), FORCE_N, MOMENT_NMM), strict=True)
    )
    if not experiment.along_z:
        fields[..., 2] = np.nan
    if not experiment.forces:
        force[:], moment[:] = np.nan, np.nan
    return FieldData(fields, NOISE_MM, force, FORCE_N, moment, MOMENT_NMM)


def tables(result: Result) -> dict[str, list[dict[str, object]]]:
    """The largest error of each number with its standard error, and the coverage."""
    by_name = {experiment.name: experiment for experiment in EXPERIMENTS}
    fitted: list[dict[str, object]] = []
    for name, fits in result.fits.items():
        row: dict[str, object] = {"experiment": name}
        for i, number in enumerate(SOUGHT):
            row[f"{number} [%]"] = _show(fits, i, _sought(by_name[name])[i])
        row["χ² by freedom"] = round(float(np.median([fit.misfit for fit in fits])), 2)
        fitted.append(row)
    result_tables: dict[str, list[dict[str, object]]] = {"": fitted}
    if result.inside:
        result_tables["_coverage"] = [
            _cover(name, inside) for name, inside in result.inside.items()
        ]
    return result_tables


def _cover(name: str, inside: Float[np.ndarray, "draws p"]) -> dict[str, object]:
    """Share of the draws in which a number's interval holds the truth, for each number."""
    row: dict[str, object] = {"experiment": name, "fits": len(inside)}
    for number, holds in zip(SOUGHT, inside.T, strict=True):
        known = holds[np.isfinite(holds)]
        row[f"{number} [%]"] = round(100 * float(known.mean()), 1) if known.size else "flagged"
        if 0 < known.size < holds.size:
            row[f"{number} [%]"] = f"{row[f'{number} [%]']} ({holds.size - known.size} without)"
    return row


def _show(fits: list[FieldFit], i: int, truth: float) -> str:
    """Largest error of a number and its standard error, in percent; or `flagged`."""
    determined = [fit for fit in fits if fit.determined[i]]
    if not determined:
        return "flagged"
    off = max(abs(fit.values[i] / truth - 1.0) for fit in determined)
    error = np.median([np.sqrt(fit.covariance[i, i]) for fit in determined])
    shown = f"{100 * off:.2f} (± {100 * error:.2f})"
    return (
        shown if len(determined) == len(fits) else f"{shown}, {len(fits) - len(determined)} flagged"
    )


def plot(result: Result) -> Figure:
    """Errors of the determined numbers, with their 95 % intervals."""
    by_name = {experiment.name: experiment for experiment in EXPERIMENTS}
    figure, axes = plt.subplots(
        1, len(SOUGHT), figsize=(12.0, 1.2 + 0.4 * len(result.fits)), sharey=True,
        layout="constrained",
    )  # fmt: skip
    for i, (axis, number) in enumerate(zip(axes, SOUGHT, strict=True)):
        for row, (name, fits) in enumerate(result.fits.items()):
            truth = _sought(by_name[name])[i]
            for j, fit in enumerate(fits):
                place = row + 0.2 * (j - 0.5 * (len(fits) - 1))
                ends = [100 * (value[i] / truth - 1.0) for value in (fit.low, fit.high)]
                axis.plot(ends, [place, place], color="#08306b", lw=1.0)
                axis.plot(100 * (fit.values[i] / truth - 1.0), place, "o", ms=3, color="#08306b")
            if not any(fit.determined[i] for fit in fits):
                axis.text(0.0, row, "flagged", ha="center", va="center", fontsize=8)
        axis.axvspan(-1.0, 1.0, color="0.9", zorder=0)
        axis.set_xlim(-3.0, 3.0)
        axis.set_title(number.replace("_", " "), fontsize=9)
        axis.set_xlabel("error [%]", fontsize=8)
    axes[0].set_yticks(range(len(result.fits)), list(result.fits), fontsize=8)
    axes[0].invert_yaxis()
    return figure
