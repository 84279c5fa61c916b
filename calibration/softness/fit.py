"""Fit of k and L to trials: Eq. (13) where the reference counts from the contact, else Eq. (12).

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (12) and (13).
[DerSimonian1986] R. DerSimonian, N. Laird, "Meta-analysis in clinical trials", for the scatter
between grasps; [Hartung2001] J. Hartung, G. Knapp, Statistics in Medicine 20, for its interval.

Eq. (12), of increments, differs from Eq. (13), of totals, by an unknown start: a reference with a
zero of its own gets a free zero in every trial, and tells k, not L.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import NamedTuple

import numpy as np
import scipy

from calibration.softness.checks import check_frames, check_line, check_points, check_sensors
from calibration.softness.references import NO_REFERENCE
from calibration.softness.regression import (
    Columns,
    Line,
    Series,
    find_clock_offset,
    fit_line,
    total_error,
)
from calibration.softness.trials import Trial
from estimation.estimators.measurement import Z95
from estimation.softness import ScalarSoftness, Validity
from estimation.softness.scalar import Covariance

MOST_COVERED = 0.5
"""Share of the frames from which a reference counts as long as the recording."""

SCATTER_LEVEL = 0.02
"""Chance of such disagreement between equal grasps below which they count as unequal."""


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
        thing: name of the object.
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
    thing: str
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
    """k and L, how well they are known, and what they were found from.

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
        undetermined: what the data cannot tell, in sentences.
        notes: what a reader should know, in sentences.
        line: the fit behind it.
    """

    softness: ScalarSoftness
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
    trials: Sequence[Trial], *, model: str | None = None, clock_search: float = 1.0
) -> SoftnessFit:
    """Fit k and L of one object, or of a class of them, to one or more trials.

    Both variables have errors (functional relation, [York2004] of `softness_line`), readings far
    off count less or not at all, and the clocks of trials that have two are brought together.

    Args:
        trials: grasps of the object.
        model: one of `LOAD_MODELS`; the one with the lowest BIC unless given.
        clock_search: how far two clocks may be apart at most [s].

    Raises:
        ValueError: what the trials hold cannot give k; the message says what to measure instead.
    """
    if not trials:
        raise ValueError(f"no trial: {NO_REFERENCE}")
    check_sensors(trials)
    check_frames(trials)
    series = [_series(trial, clock_search) for trial in trials]
    offsets = np.array([find_clock_offset(one) for one in series])
    check_points(trials, series, offsets)
    single = [_fit_alone(one, offset) for one, offset in zip(series, offsets, strict=True)]
    for trial, one, line in zip(trials, series, single, strict=True):
        check_line(trial, one, line)
    offsets = np.array([line.clock_offsets[0] for line in single])
    lines = {name: fit_line(series, columns, offsets) for name, columns in _models(trials).items()}
    candidates = _rank(lines)
    chosen = model or candidates[0].model
    if chosen not in lines:
        raise ValueError(
            f"there is no model {chosen!r} of L for these trials, only {', '.join(lines)}: L takes "
            "references that count from the contact; 'by force' takes recorded forces that differ "
            "from trial to trial, 'per grasp' more than one trial"
        )
    return _conclude(trials, single, chosen, candidates, lines[chosen])


def _series(trial: Trial, clock_search: float) -> Series:
    """A trial's points on the recording's clock, at no more readings than there are frames."""
    reference = trial.reference
    origin = trial.start if reference.same_clock else reference.time[0]
    time, angle, error = reference.time - origin, reference.angle, reference.error
    interval = float(np.median(np.diff(trial.time)))
    if np.median(np.diff(time)) < 0.6 * interval:
        bins = np.floor((time - time[0]) / interval).astype(int)
        known = np.isfinite(angle)
        count = np.bincount(bins[known], minlength=bins.max() + 1)
        full = count > 0
        time, angle, error = (
            np.bincount(bins[known], value[known], minlength=len(count))[full] / count[full]
            for value in (time, angle, error)
        )
    return Series(
        time=time,
        reference=angle,
        reference_error=error,
        frame_time=trial.time - trial.start,
        rotation=trial.rotation,
        rotation_error=np.maximum(trial.error, 1e-9),
        search=0.0 if reference.same_clock else clock_search,
    )


def _fit_alone(one: Series, offset: float) -> Line:
    """A trial by itself, its zero free."""
    return fit_line([one], Columns(np.zeros(1, dtype=int), np.ones(1)), np.array([offset]))


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


class _Slope(NamedTuple):
    """Slope over trials: its variance, freedom, the scatter between trials and its chance."""

    value: float
    variance: float
    freedom: float
    scatter: float
    chance: float


def _combine(trials: Sequence[Trial], single: Sequence[Line], line: Line) -> _Slope:
    """The common slope; where trials, or objects, disagree the mean of the scattered ones."""
    common = _Slope(line.slope, float(line.covariance[0, 0]), line.freedom, 0.0, float("nan"))
    things = sorted({trial.thing for trial in trials})
    parts = [
        _average([one for one, trial in zip(single, trials, strict=True) if trial.thing == thing])
        for thing in things
    ]
    whole = parts[0] if len(parts) == 1 else _average(parts)
    if any(part.scatter for part in (*parts, whole)):
        return whole
    return common._replace(chance=whole.chance)


def _average(parts: Sequence[Line | _Slope]) -> _Slope:
    """Mean of slopes, random effects where they disagree ([DerSimonian1986], [Hartung2001])."""
    slopes = np.array([part.slope if isinstance(part, Line) else part.value for part in parts])
    variances = np.array(
        [part.covariance[0, 0] if isinstance(part, Line) else part.variance for part in parts]
    )
    count = len(slopes)
    freedom = float(np.sum([part.freedom for part in parts]))
    weight = 1.0 / variances
    mean = float(weight @ slopes / weight.sum())
    if count == 1:
        return _Slope(mean, float(variances[0]), freedom, 0.0, float("nan"))
    disagreement = float(weight @ (slopes - mean) ** 2)
    chance = float(scipy.stats.chi2.sf(disagreement, count - 1))
    if chance >= SCATTER_LEVEL:
        return _Slope(mean, float(1.0 / weight.sum()), freedom, 0.0, chance)
    excess = disagreement - (count - 1)
    between = excess / float(weight.sum() - (weight**2).sum() / weight.sum())
    weight = 1.0 / (variances + between)
    mean = float(weight @ slopes / weight.sum())
    variance = float(weight @ (slopes - mean) ** 2 / ((count - 1) * weight.sum()))
    return _Slope(mean, variance, count - 1.0, float(np.sqrt(max(between, 0.0))), chance)


def _conclude(
    trials: Sequence[Trial],
    single: Sequence[Line],
    model: str,
    candidates: tuple[Candidate, ...],
    line: Line,
) -> SoftnessFit:
    slope = _combine(trials, single, line)
    half = float(scipy.stats.t.ppf(0.975, slope.freedom) * np.sqrt(slope.variance))
    k = slope.value - 1.0
    zeroed = np.array([trial.reference.zeroed for trial in trials])
    loads = int(zeroed.sum()) if model == "per grasp" else int(model != "none")
    # coefficients follow the slope where the scatter has moved it
    follow = line.covariance[0, 1:] / line.covariance[0, 0]
    moved = line.coefficients + follow[: len(line.coefficients)] * (slope.value - line.slope)
    load, covariance = _load_term(line, moved[:loads], follow[:loads], slope)
    softness = ScalarSoftness(
        stiffness_ratio=max(k, 0.0),
        load_term=load,
        covariance=covariance,
        load_by_force=model == "by force",
        validity=_validity(trials),
        provenance={
            "contactmodel": version("contactmodel"),
            "recordings": [trial.name for trial in trials],
            "objects": sorted({trial.thing for trial in trials}),
            "references": sorted({trial.reference.source for trial in trials}),
            "load_model": model,
            "scatter_between_grasps": slope.scatter,
            "stiffness_ratio_as_fitted": k,
            "stiffness_ratio_95": [k - half, k + half],
        },
    )
    undetermined, notes = _tell(trials, slope, half, line, loads)
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
            for i, (trial, alone) in enumerate(zip(trials, single, strict=True))
        ),
        scatter=slope.scatter,
        scatter_chance=slope.chance,
        undetermined=undetermined,
        notes=notes,
        line=line,
    )


def _load_term(
    line: Line, loads: np.ndarray, follow: np.ndarray, slope: _Slope
) -> tuple[float, Covariance]:
    """L for the next grasp, and the covariance of (k, L), scatter and few freedoms included."""
    widen = (float(scipy.stats.t.ppf(0.975, slope.freedom)) / Z95) ** 2
    spread = (slope.variance + slope.scatter**2) * widen
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
    def ends(values: np.ndarray) -> tuple[float, float]:
        known = values[np.isfinite(values)]
        return (float(known.min()), float(known.max())) if len(known) else (-np.inf, np.inf)

    columns = ([getattr(one, name) for one in trials] for name in
               ("rotation", "normal_force", "radius"))  # fmt: skip
    return Validity(*(ends(np.concatenate(column)) for column in columns))


def _grasp(trial: Trial, line: Line, load: float) -> GraspFit:
    free = len(line.covariance) > 2
    return GraspFit(
        name=trial.name,
        thing=trial.thing,
        stiffness_ratio=line.slope - 1.0,
        standard_error=float(np.sqrt(line.covariance[0, 0])),
        load_term=load,
        clock_offset=float(line.clock_offsets[0]),
        clock_error=float(np.sqrt(line.covariance[2, 2])) if free else 0.0,
        points=len(line.weight),
        outliers=int((line.weight == 0).sum()),
        excluded=trial.excluded,
    )


def _tell(
    trials: Sequence[Trial],
    slope: _Slope,
    half: float,
    line: Line,
    loads: int,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the data cannot tell, and what a reader should know."""
    undetermined, notes = [], []
    if half > 0.5 * slope.value:
        undetermined.append(
            f"k is only known to ±{half:.2g}: turn further without slip, or take more grasps"
        )
    if not any(trial.reference.zeroed for trial in trials):
        undetermined.append(
            "L: the references have zeros of their own, so only changes of the angle were used "
            "(Eq. 12); for L count the reference from the onset of contact"
        )
    errors = np.sqrt(np.diag(line.covariance))
    correlation = np.abs(line.covariance[0, 1:] / (errors[0] * np.maximum(errors[1:], 1e-300)))
    if loads and (correlation[:loads] > 0.99).any():
        undetermined.append(
            "k and L apart: their errors are correlated by more than 0.99; turn both ways from the "
            "zero, and through more angle"
        )
    if loads == 1 and len(line.covariance) > 1 + len(line.coefficients):
        clocks = slice(1 + len(line.coefficients), None)
        mixed = np.abs(line.covariance[1, clocks]) / (errors[1] * errors[clocks])
        if (mixed > 0.99).any():
            undetermined.append(
                "L and the clock offset apart: at a steady rate they are the same; hold the object "
                "still for a moment or turn it back"
            )
    if len(trials) == 1:
        notes.append(
            "one grasp: the interval holds the noise of the readings, not how k differs from grasp "
            "to grasp; take three or more"
        )
    elif slope.scatter > 0.0:
        notes.append(
            f"the grasps disagree (chance {slope.chance:.2g} were k the same): k scatters by "
            f"{slope.scatter:.3g} between them, and the interval is that of their mean"
        )
    else:
        notes.append(f"the grasps agree within their errors (chance {slope.chance:.2g})")
    if slope.value < 1.0:
        notes.append(
            f"k was fitted as {slope.value - 1.0:.3g}, which no object has; 0 lies within its "
            "interval and is applied"
        )
    excluded = Counter[str]()
    for number, trial in enumerate(trials):
        excluded.update(trial.excluded)
        read = line.points.time[line.points.trial == number]
        frames = trial.time - trial.start
        covered = np.mean((frames >= read.min()) & (frames <= read.max()))
        if covered < MOST_COVERED:
            notes.append(
                f"{trial.name}: the reference covers {100.0 * covered:.0f} % of the frames that "
                "stick: record it over the whole recording"
            )
    notes += [f"left out: {count} frames {reason}" for reason, count in excluded.items()]
    if outliers := int((line.weight == 0).sum()):
        notes.append(f"no weight: {outliers} of {len(line.weight)} readings lie far off the line")
    noise = float(np.median(line.points.rotation_error**2) / np.var(line.points.rotation))
    notes.append(
        f"errors of the elastomer's rotation taken into account; least squares without them would "
        f"read 1 + k low by {100.0 * noise:.2g} %"
    )
    return tuple(undetermined), tuple(notes)
