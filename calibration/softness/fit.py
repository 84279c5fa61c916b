"""Fit of k and L to trials: Eq. (13) where the reference counts from the contact, else Eq. (12).

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (12) and (13).

Eq. (12), of increments, differs from Eq. (13), of totals, by an unknown start: a reference with a
zero of its own gets a free zero in every trial, and tells k, not L. On an elastomer of finite
thickness the same line is fitted to what lifting makes of the rotation; h → ∞ is the thick one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import scipy

from calibration.softness.checks import (
    check_frames,
    check_line,
    check_points,
    check_sensors,
    report_findings,
)
from calibration.softness.readings import (
    HALF_SPACE,
    Layer,
    find_clock_offset,
    make_series,
)
from calibration.softness.references import NO_REFERENCE
from calibration.softness.regression import Columns, Line, Problem, fit_line, total_error
from calibration.softness.scatter import Slope, combine_slopes
from calibration.softness.trials import Trial
from estimation.estimators.measurement import Z95
from estimation.softness import LayeredSoftness, ScalarSoftness, Validity
from estimation.softness.scalar import Covariance


class Candidate(NamedTuple):
    """One way to take L.

    Attributes:
        model: one of `LOAD_MODELS`.
        parameters: that it has.
        bic: Bayes information criterion; the lowest is chosen, differences below 2 mean little.
        stiffness_ratio: k by this model [-].
        standard_error: of k [-].
    """

    model: str
    parameters: int
    bic: float
    stiffness_ratio: float
    standard_error: float


class GraspFit(NamedTuple):
    """One trial by itself, its zero free.

    Attributes:
        name: of the trial.
        object_name: name of the object.
        stiffness_ratio: k of this trial [-]; NaN where it turned too little.
        standard_error: of k [-].
        load_term: L of this trial with the common k [rad]; NaN where the reference has no zero.
        clock_offset: reference's clock less the recording's [s].
        clock_error: its standard error [s]; 0 where the clocks are one.
        points: readings used.
        outliers: of them, those given no weight.
        excluded: frames that are not used, by why.
    """

    name: str
    object_name: str
    stiffness_ratio: float
    standard_error: float
    load_term: float
    clock_offset: float
    clock_error: float
    points: int
    outliers: int
    excluded: Mapping[str, int]


@dataclass(frozen=True)
class SoftnessFit:
    """k and L with their uncertainty, and the data behind them.

    Attributes:
        softness: to apply; its covariance holds the scatter between grasps and the few degrees of
            freedom, and k is not below 0.
        stiffness_ratio: k as fitted [-].
        low: lower end of the 95 % interval of k [-].
        high: upper end [-].
        model: how L was taken.
        candidates: all ways that the data allow, the best one first.
        grasps: each trial by itself.
        scatter: standard deviation of k between grasps, beyond their errors [-]; 0 if none is seen.
        scatter_chance: chance of such disagreement were k the same [-]; NaN for one trial.
        undetermined: quantities that the data cannot determine, in sentences.
        notes: remarks for readers, in sentences.
        line: the fit behind it.

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
    scatter_chance: float
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
    """Fit k and L of one object, or of a class of them, to one or more trials.

    Both variables have errors (functional relation, [York2004] of `regression`), readings far
    off count less or not at all, and the clocks of trials that have two are brought together.

    Args:
        trials: grasps of the object.
        model: one of `LOAD_MODELS`; the one with the lowest BIC unless given.
        clock_search: how far two clocks may be apart at most [s].
        layer: the elastomer that the trials' frames were lifted for, which has no load term
            besides; thickness and depth are fitted too as far as they are uncertain. None for a
            thick one.

    Raises:
        ValueError: the trials cannot determine k; the message says what to measure instead.

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
    check_sensors(trials)
    check_frames(trials)
    model = model if layer is None else "none"
    pad = layer or HALF_SPACE
    series = [make_series(trial, clock_search) for trial in trials]
    offsets = np.array([find_clock_offset(one, pad) for one in series])
    check_points(trials, series, offsets, pad, zeroed=model == "none")
    known = pad._replace(thickness_error=0.0, depth_error=0.0)
    single = [
        fit_line(Problem([one], _alone(trial, model), known), np.array([offset]))
        for trial, one, offset in zip(trials, series, offsets, strict=True)
    ]
    for trial, one, line in zip(trials, series, single, strict=True):
        check_line(trial, one, line)
    offsets = np.array([line.clock_offsets[0] for line in single])
    columns = _models(trials) if layer is None else {"none": _models(trials)["none"]}
    lines = {name: fit_line(Problem(series, one, pad), offsets) for name, one in columns.items()}
    candidates = _rank(lines)
    chosen = model or candidates[0].model
    _expect_model(chosen, lines)
    slope = combine_slopes(trials, single, lines[chosen])
    grasps = list(zip(trials, single, strict=True))
    return _conclude(grasps, slope, chosen, candidates, lines[chosen], layered=layer is not None)


def _expect_model(model: str, lines: Mapping[str, Line]) -> None:
    """Check that a model of L can be fitted to the trials."""
    if model not in lines:
        raise ValueError(
            f"there is no model {model!r} of L for these trials, only {', '.join(lines)}: L takes "
            "references that count from the contact; 'by force' takes recorded forces that differ "
            "from trial to trial, 'per grasp' more than one trial"
        )


def _alone(trial: Trial, model: str | None) -> Columns:
    """Beside the slope of a trial by itself: its zero, unless that is known to be 0."""
    known = model == "none" and trial.reference.zeroed
    return Columns(np.array([-1 if known else 0]), np.ones(1))


def _models(trials: Sequence[Trial]) -> dict[str, Columns]:
    """The columns of every way to take L that the trials allow; those of L come first."""
    zeroed = np.array([trial.reference.zeroed for trial in trials])
    count = int(zeroed.sum())
    force = np.array([float(np.mean(trial.normal_force)) for trial in trials])
    nothing = np.full(len(trials), -1)
    groups = {"none": (nothing, 0)}
    factor = np.where(zeroed, -0.5, 1.0)
    factors = {"none": factor, "constant": factor, "per grasp": factor}
    if count:
        groups["constant"] = (np.where(zeroed, 0, -1), 1)
    if count > 1:
        groups["per grasp"] = (np.where(zeroed, np.cumsum(zeroed) - 1, -1), count)
        mine = force[zeroed]
        if np.isfinite(mine).all() and np.ptp(mine) > 0.05 * np.abs(mine).mean():
            groups["by force"] = groups["constant"]
            factors["by force"] = np.where(zeroed, -0.5 * force, 1.0)
    return {
        name: Columns(np.where(zeroed, group, first + np.cumsum(~zeroed) - 1), factors[name])
        for name, (group, first) in groups.items()
    }


def _rank(lines: Mapping[str, Line]) -> tuple[Candidate, ...]:
    """All ways to take L by BIC, best first, counting the readings that the richest finds apart."""
    richest = max(lines.values(), key=lambda line: len(line.covariance))
    count = richest.independent
    found = []
    for name, line in lines.items():
        parameters = len(line.covariance)
        # −2 ln likelihood up to a constant, by the richest one's errors; outliers count as nine
        error = richest.scale * total_error(line.points, line.slope, richest.found_error)
        misfit = count * float(np.mean(np.minimum((line.residual / error) ** 2, 9.0)))
        found.append(
            Candidate(
                model=name,
                parameters=parameters,
                bic=misfit + parameters * float(np.log(count)),
                stiffness_ratio=line.slope - 1.0,
                standard_error=float(np.sqrt(line.covariance[0, 0])),
            )
        )
    return tuple(sorted(found, key=lambda one: one.bic))


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
    # coefficients follow the slope where the scatter has moved it
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
    undetermined, notes = report_findings(trials, slope, half, line, loads)
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
        scatter_chance=slope.chance,
        undetermined=undetermined,
        notes=notes,
        line=line,
    )


def _widened(slope: Slope) -> float:
    """Variance of k for the next grasp, few degrees of freedom included, as normal errors have."""
    widen = (float(scipy.stats.t.ppf(0.975, slope.freedom)) / Z95) ** 2
    return (slope.variance + slope.scatter**2) * widen


def _layered(
    line: Line, slope: Slope, validity: Validity, provenance: Mapping[str, Any]
) -> LayeredSoftness:
    """k, and thickness and depth as far as they were free, with their covariance."""
    free = np.flatnonzero(line.layer.errors)
    rows = len(line.covariance) - len(free) + np.arange(len(free))
    follow = line.covariance[0, rows] / line.covariance[0, 0]
    values = line.layer.values
    values[free] += follow * (slope.value - line.slope)
    pad = line.layer.at(values) if len(free) else line.layer
    ways = np.zeros((3, 1 + len(free)))  # of k, thickness and depth
    ways[0, 0], ways[1 + free, 0] = 1.0, follow
    ways[1 + free, 1 + np.arange(len(free))] = 1.0
    own = line.covariance[np.ix_(rows, rows)]
    own = own - np.outer(follow, follow) * line.covariance[0, 0]
    whole = scipy.linalg.block_diag(_widened(slope), own) if len(free) else [[_widened(slope)]]
    covariance = ways @ np.asarray(whole) @ ways.T
    return LayeredSoftness(
        stiffness_ratio=max(slope.value - 1.0, 0.0),
        thickness=pad.thickness,
        depth=pad.depth,
        covariance=tuple(map(tuple, (0.5 * (covariance + covariance.T)).tolist())),
        validity=validity,
        object_radius=pad.object_radius,
        provenance=provenance,
    )


def _load_term(
    line: Line, loads: np.ndarray, follow: np.ndarray, slope: Slope
) -> tuple[float, Covariance]:
    """L for the next grasp, and the covariance of (k, L), scatter and few freedoms included."""
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
    """The contacts that were fitted."""

    def ends(values: np.ndarray) -> tuple[float, float] | None:
        known = values[np.isfinite(values)]
        return (float(known.min()), float(known.max())) if len(known) else None

    # the regression leaves out small turns of lifted frames, which k holds for as well
    rotation = [np.append(one.rotation, [0.0] * bool(one.seen)) for one in trials]
    others = ([getattr(one, name) for one in trials] for name in ("normal_force", "radius"))
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
