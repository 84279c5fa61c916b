"""Fit k and L to trials: Eq. (13) if the reference counts from the contact, otherwise Eq. (12).

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (12) and (13).

Eq. (12) for increments differs from Eq. (13) for totals by an unknown start. A reference that does
not count from the contact gets a free zero in every trial; it determines k but not L. For an
elastomer of finite thickness h the same line is fitted to the lifted rotation. h → ∞ gives the
thick elastomer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import scipy

from calibration.softness.checks import (
    check_frames,
    check_line,
    check_points,
    check_trials,
    report_findings,
)
from calibration.softness.clocks import check_clocks, find_clock_offset
from calibration.softness.readings import HALF_SPACE, Layer, Series, make_series
from calibration.softness.references import NO_REFERENCE
from calibration.softness.regression import Columns, Line, Problem, fit_line, total_error
from calibration.softness.scatter import Slope, combine_slopes
from calibration.softness.trials import Trial
from estimation.estimators.measurement import Z95
from estimation.softness import LayeredSoftness, ScalarSoftness, Validity
from estimation.softness.scalar import Covariance


class Candidate(NamedTuple):
    """A model of L and its fit."""

    model: str  # one of `LOAD_MODELS`
    parameters: int  # number of parameters
    # Bayesian information criterion; the lowest is chosen, differences below 2 mean little
    bic: float
    stiffness_ratio: float  # k with this model [-]
    standard_error: float  # standard error of k [-]


class GraspFit(NamedTuple):
    """Fit of one trial alone, with a free zero."""

    name: str  # name of the trial
    object_name: str  # name of the object
    stiffness_ratio: float  # k of this trial [-]; NaN if the object turned too little
    standard_error: float  # standard error of k [-]
    # L of this trial with the common k [rad]; NaN if the reference does not count from the contact
    load_term: float
    clock_offset: float  # the reference's clock minus the recording's [s]
    clock_error: float  # standard error of the clock offset [s]; 0 if the clocks are one
    points: int  # number of readings
    outliers: int  # number of readings without weight
    excluded: Mapping[str, int]  # number of unused frames, by reason


@dataclass(frozen=True)
class SoftnessFit:
    """k and L with their uncertainty, and the fit behind them.

    Attributes:
        softness: softness to apply. Its covariance includes the scatter between grasps and the
            small number of degrees of freedom, and its k is not below 0.
        stiffness_ratio: k as fitted [-].
        low: lower end of the 95 % interval of k [-].
        high: upper end of the 95 % interval of k [-].
        model: chosen model of L.
        candidates: all models of L that the data allow, the best first.
        grasps: fit of each trial alone.
        scatter: standard deviation of k between grasps beyond their errors [-]; 0 without
            significant scatter.
        scatter_p_value: p-value of the disagreement for equal k [-]; NaN for one trial.
        undetermined: quantities that the data cannot determine, in sentences.
        notes: remarks for readers, in sentences.
        line: fit of all trials.

    Examples:
        >>> import numpy as np
        >>> from calibration import Reference, fit_softness, make_trials
        >>> from estimation import PivotModel, estimate_angles, simulate_pivot
        >>> soft = PivotModel(stiffness_ratio=0.5, friction_ratio=0.3)
        >>> recording, truth = simulate_pivot(soft, angles_deg=(0.0, 10.0), frames=(30,))
        >>> error = np.full(len(recording), np.radians(0.05))
        >>> about = {"zeroed": True, "same_clock": True, "source": "stage"}
        >>> stage = Reference(recording.time, truth.angle, error, **about)
        >>> fit = fit_softness(make_trials(recording, stage))
        >>> print(f"95 % interval of k ± {(fit.high - fit.low) / 2:.3f}")
        95 % interval of k ± 0.001
        >>> result = estimate_angles(recording, softness=fit.softness)
        >>> print(f"{np.degrees(result.angle[-1]):.1f}°")  # 10° is true
        10.0°
    """

    softness: ScalarSoftness | LayeredSoftness
    stiffness_ratio: float
    low: float
    high: float
    model: str
    candidates: tuple[Candidate, ...]
    grasps: tuple[GraspFit, ...]
    scatter: float
    scatter_p_value: float
    undetermined: tuple[str, ...]
    notes: tuple[str, ...]
    line: Line


def fit_softness(
    trials: Sequence[Trial],
    *,
    model: str | None = None,
    clock_search: float = 1.0,
    layer: Layer | None = None,
) -> SoftnessFit:
    """Fit k and L of one object, or of a class of objects, to one or more trials.

    The fit includes the errors of both variables (functional relation, [York2004] of `regression`)
    and the offset of two clocks. Readings far off the line get less weight or none.

    Args:
        trials: grasps of the object.
        model: one of `LOAD_MODELS`; None to choose the model with the lowest BIC.
        clock_search: largest offset between two clocks [s].
        layer: the elastomer for which the trials' frames were lifted; it has no load term.
            Thickness and depth are fitted too if they have errors. None for a thick elastomer.

    Raises:
        ValueError: the trials cannot determine k; the message states what to measure instead.

    Examples:
        >>> from calibration import Reference, fit_softness, make_trials
        >>> from estimation import PivotModel, simulate_pivot
        >>> soft = PivotModel(stiffness_ratio=0.5, friction_ratio=0.3)
        >>> recording, truth = simulate_pivot(soft, angles_deg=(0.0, 10.0), frames=(30,))
        >>> error = 1e-3 + 0 * recording.time  # rad
        >>> about = {"zeroed": True, "same_clock": True, "source": "stage"}
        >>> stage = Reference(recording.time, truth.angle, error, **about)
        >>> fit = fit_softness(make_trials(recording, stage))
        >>> print(f"k = {fit.stiffness_ratio:.2f}")  # 0.5 is true
        k = 0.50
    """
    if not trials:
        raise ValueError(f"no trial: {NO_REFERENCE}")
    check_trials(trials)
    check_frames(trials)
    model = model if layer is None else "none"
    pad = layer or HALF_SPACE
    series = [make_series(trial, clock_search) for trial in trials]
    offsets = np.array([find_clock_offset(readings, pad) for readings in series])
    check_points(trials, series, offsets, pad, zeroed=model == "none")
    alone = _set_apart(trials, series, pad, model)
    single = [fit_line(problem, offsets[[number]]) for number, problem in enumerate(alone)]
    for trial, line in zip(trials, single, strict=True):
        check_line(trial, line)
    offsets = np.array([line.clock_offsets[0] for line in single])
    models = _models(trials) if layer is None else {"none": _models(trials)["none"]}
    lines = {name: fit_line(Problem(series, terms, pad), offsets) for name, terms in models.items()}
    candidates = _rank(lines)
    chosen = model or candidates[0].model
    _expect_model(chosen, lines)
    slope = combine_slopes(trials, single, lines[chosen])
    grasps = list(zip(trials, single, strict=True))
    fit = _conclude(grasps, slope, chosen, candidates, lines[chosen], layered=layer is not None)
    return replace(fit, notes=(*fit.notes, *check_clocks(trials, alone, single, clock_search)))


def _set_apart(
    trials: Sequence[Trial], series: Sequence[Series], pad: Layer, model: str | None
) -> list[Problem]:
    """Each trial alone, on an elastomer of known thickness and depth."""
    exact = pad._replace(thickness_error=0.0, depth_error=0.0)
    return [
        Problem([readings], _alone(trial, model), exact)
        for trial, readings in zip(trials, series, strict=True)
    ]


def _expect_model(model: str, lines: Mapping[str, Line]) -> None:
    """Check that a model of L can be fitted to the trials."""
    if model not in lines:
        raise ValueError(
            f"the load term L has no model {model!r} for these trials: choose from "
            f"{', '.join(lines)}. L requires references that count from the contact (--zeroed); "
            "'by force' also requires recorded forces that differ between trials, and 'per grasp' "
            "more than one trial"
        )


def _alone(trial: Trial, model: str | None) -> Columns:
    """Column of a trial alone: its zero, unless the zero is known to be 0."""
    zero_known = model == "none" and trial.reference.zeroed
    return Columns(np.array([-1 if zero_known else 0]), np.ones(1))


def _models(trials: Sequence[Trial]) -> dict[str, Columns]:
    """Columns of every model of L that the trials allow; those of L come first."""
    zeroed = np.array([trial.reference.zeroed for trial in trials])
    count = int(zeroed.sum())
    force = np.array([float(np.mean(trial.normal_force)) for trial in trials])
    no_column = np.full(len(trials), -1)
    groups = {"none": (no_column, 0)}
    factor = np.where(zeroed, -0.5, 1.0)
    factors = {"none": factor, "constant": factor, "per grasp": factor}
    if count:
        groups["constant"] = (np.where(zeroed, 0, -1), 1)
    if count > 1:
        groups["per grasp"] = (np.where(zeroed, np.cumsum(zeroed) - 1, -1), count)
        forces = force[zeroed]
        if np.isfinite(forces).all() and np.ptp(forces) > 0.05 * np.abs(forces).mean():
            groups["by force"] = groups["constant"]
            factors["by force"] = np.where(zeroed, -0.5 * force, 1.0)
    return {
        name: Columns(np.where(zeroed, group, first + np.cumsum(~zeroed) - 1), factors[name])
        for name, (group, first) in groups.items()
    }


def _rank(lines: Mapping[str, Line]) -> tuple[Candidate, ...]:
    """All models of L by BIC, best first; the richest model sets the number of readings."""
    richest = max(lines.values(), key=lambda line: len(line.covariance))
    count = richest.independent
    candidates = []
    for name, line in lines.items():
        parameters = len(line.covariance)
        # −2 ln likelihood up to a constant, with the richest model's errors; outliers count as 9
        error = richest.scale * total_error(line.points, line.slope, richest.found_error)
        misfit = count * float(np.mean(np.minimum((line.residual / error) ** 2, 9.0)))
        candidates.append(
            Candidate(
                model=name,
                parameters=parameters,
                bic=misfit + parameters * float(np.log(count)),
                stiffness_ratio=line.slope - 1.0,
                standard_error=float(np.sqrt(line.covariance[0, 0])),
            )
        )
    return tuple(sorted(candidates, key=lambda candidate: candidate.bic))


def _conclude(
    grasps: Sequence[tuple[Trial, Line]],
    slope: Slope,
    model: str,
    candidates: tuple[Candidate, ...],
    line: Line,
    *,
    layered: bool,
) -> SoftnessFit:
    trials = [trial for trial, _ in grasps]
    half = float(scipy.stats.t.ppf(0.975, slope.freedom) * np.sqrt(slope.variance))
    k = slope.value - 1.0
    zeroed = np.array([trial.reference.zeroed for trial in trials])
    loads = int(zeroed.sum()) if model == "per grasp" else int(model != "none")
    # coefficients follow the slope if the scatter has moved it
    follow = line.covariance[0, 1:] / line.covariance[0, 0]
    moved = line.coefficients + follow[: len(line.coefficients)] * (slope.value - line.slope)
    provenance = {
        "contactmodel": version("contactmodel"),
        "recordings": [trial.name for trial in trials],
        "objects": sorted({trial.object_name for trial in trials}),
        "references": sorted({trial.reference.source for trial in trials}),
        "load_model": model,
        "scatter_between_grasps": slope.scatter,
        "stiffness_ratio_as_fitted": k,
        "stiffness_ratio_95": [k - half, k + half],
    }
    if layered:
        softness = _layered(line, slope, _validity(trials), provenance)
    else:
        load, covariance = _load_term(line, moved[:loads], follow[:loads], slope)
        softness = ScalarSoftness(
            max(k, 0.0), load, covariance, model == "by force", _validity(trials), provenance
        )
    shifts = moved[: 0 if model == "by force" else loads]
    undetermined, notes = report_findings(trials, slope, half, line, loads, shifts)
    shown = moved[np.minimum(np.cumsum(zeroed) - 1, loads - 1)] if loads else np.zeros(len(zeroed))
    return SoftnessFit(
        softness=softness,
        stiffness_ratio=k,
        low=k - half,
        high=k + half,
        model=model,
        candidates=candidates,
        grasps=tuple(
            _grasp(trial, alone, float(shown[i]) if zeroed[i] else float("nan"))
            for i, (trial, alone) in enumerate(grasps)
        ),
        scatter=slope.scatter,
        scatter_p_value=slope.p_value,
        undetermined=undetermined,
        notes=notes,
        line=line,
    )


def _widened(slope: Slope) -> float:
    """Variance of k for the next grasp, widened for the small number of degrees of freedom."""
    widen = (float(scipy.stats.t.ppf(0.975, slope.freedom)) / Z95) ** 2
    return (slope.variance + slope.scatter**2) * widen


def _layered(
    line: Line, slope: Slope, validity: Validity, provenance: Mapping[str, Any]
) -> LayeredSoftness:
    """k, thickness and depth with their covariance, as far as they were fitted."""
    free = np.flatnonzero(line.layer.errors)
    rows = len(line.covariance) - len(free) + np.arange(len(free))
    follow = line.covariance[0, rows] / line.covariance[0, 0]
    values = line.layer.values
    values[free] += follow * (slope.value - line.slope)
    pad = line.layer.at(values) if len(free) else line.layer
    directions = np.zeros((3, 1 + len(free)))  # of k, thickness and depth
    directions[0, 0], directions[1 + free, 0] = 1.0, follow
    directions[1 + free, 1 + np.arange(len(free))] = 1.0
    own = line.covariance[np.ix_(rows, rows)]
    own = own - np.outer(follow, follow) * line.covariance[0, 0]
    whole = scipy.linalg.block_diag(_widened(slope), own) if len(free) else [[_widened(slope)]]
    covariance = directions @ np.asarray(whole) @ directions.T
    return LayeredSoftness(
        stiffness_ratio=max(slope.value - 1.0, 0.0),
        covariance=tuple(map(tuple, (0.5 * (covariance + covariance.T)).tolist())),
        validity=validity,
        provenance=provenance,
        **pad.lengths,
    )


def _load_term(
    line: Line, loads: np.ndarray, follow: np.ndarray, slope: Slope
) -> tuple[float, Covariance]:
    """L and the covariance of (k, L) for the next grasp, with scatter and degrees of freedom."""
    widen = (float(scipy.stats.t.ppf(0.975, slope.freedom)) / Z95) ** 2
    spread = _widened(slope)
    if not len(loads):
        return 0.0, ((spread, 0.0), (0.0, 0.0))
    count = len(loads)
    mean, lean = float(loads.mean()), float(follow.mean())
    inner = line.covariance[1 : 1 + count, 1 : 1 + count]
    inner = inner - np.outer(follow, follow) * line.covariance[0, 0]
    own = float(inner.mean()) * widen
    if count > 1:
        between = float(loads.var(ddof=1)) * (1.0 + 1.0 / count)
        own = max(own, between * (float(scipy.stats.t.ppf(0.975, count - 1)) / Z95) ** 2)
    mixed = lean * spread
    return mean, ((spread, mixed), (mixed, max(own, 0.0) + lean**2 * spread))


def _validity(trials: Sequence[Trial]) -> Validity:
    """Ranges of the contacts that were fitted."""

    def ends(values: np.ndarray) -> tuple[float, float] | None:
        finite = values[np.isfinite(values)]
        return (float(finite.min()), float(finite.max())) if len(finite) else None

    # the regression leaves out small rotations of lifted frames, but k is valid for them too
    rotation = [np.append(trial.rotation, [0.0] * bool(trial.displacements)) for trial in trials]
    others = ([getattr(trial, name) for trial in trials] for name in ("normal_force", "radius"))
    return Validity(*(ends(np.concatenate(column)) for column in (rotation, *others)))


def _grasp(trial: Trial, line: Line, load: float) -> GraspFit:
    free = len(line.covariance) > 1 + len(line.coefficients)
    return GraspFit(
        name=trial.name,
        object_name=trial.object_name,
        stiffness_ratio=line.slope - 1.0,
        standard_error=float(np.sqrt(line.covariance[0, 0])),
        load_term=load,
        clock_offset=float(line.clock_offsets[0]),
        clock_error=float(np.sqrt(line.covariance[-1, -1])) if free else 0.0,
        points=len(line.weight),
        outliers=int((line.weight == 0).sum()),
        excluded=trial.excluded,
    )
