"""The default method on virtual pivots that turn back through zero into macro slip.

Each draw is a whole recording with random friction, grid and seed: lift to 10°, hold, reversal to
−30°. It is estimated with the noise measured in it. Errors and answers are over the frames in which
at least ten markers do not slip. The frames of a recording share their markers, so the interval is
judged on one such frame of each draw, picked at random.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure

from estimation.estimators import DEFAULT_METHOD
from estimation.estimators.result import Result
from estimation.frames.noise import Noise, estimate_noise
from estimation.frames.recording import Recording
from estimation.slip.lookback import find_slips, withdraw
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Truth, simulate_pivot
from papers.items import Track
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.tables import cell, finish
from papers.virtual_pivots import settings
from papers.virtual_pivots.solved import place_at_random


class Reversals(NamedTuple):
    """One value per draw.

    Attributes:
        friction_ratio: μp0/2G* [-].
        error: mean absolute error over the frames that count [deg].
        unanswered: share of the frames that count without an answer [-].
        inside: whether the interval holds the truth in a random frame of those with an answer.
        limit: mean absolute error at the Cramér–Rao bound of one frame, from the markers that do
            not slip, over the frames that count [deg].
        late: delay of the live detection after the onset of macro slip; NaN without a detection
            [frames].
        dated: delay of the onset estimated from the whole recording; NaN without one [frames].
        dated_inside: whether the interval of this onset holds the truth, between two frames.
        slid_live: share of the frames from the onset on with a live angle [-].
        slid: share of the frames from the onset on with an angle after looking back [-].
        withdrawn: share of the frames that count whose angle is wrongly withdrawn when looking back
            [-].
        jumps: number of changes of the error by more than `settings.JUMP_DEG` from one answer to
            the next, while at least `settings.FIRM_MARKERS` markers stick.
        late_jumps: number of such changes with fewer sticking markers, before macro slip.
        late_jumps_inside: number of these after which the interval holds the truth.
    """

    friction_ratio: Float[np.ndarray, " draws"]
    error: Float[np.ndarray, " draws"]
    unanswered: Float[np.ndarray, " draws"]
    inside: Bool[np.ndarray, " draws"]
    limit: Float[np.ndarray, " draws"]
    late: Float[np.ndarray, " draws"]
    dated: Float[np.ndarray, " draws"]
    dated_inside: Bool[np.ndarray, " draws"]
    slid_live: Float[np.ndarray, " draws"]
    slid: Float[np.ndarray, " draws"]
    withdrawn: Float[np.ndarray, " draws"]
    jumps: Float[np.ndarray, " draws"]
    late_jumps: Float[np.ndarray, " draws"]
    late_jumps_inside: Float[np.ndarray, " draws"]


def draw_model(rng: np.random.Generator) -> PivotModel:
    """A pivot with random friction and a random place of the markers."""
    ratio = float(rng.uniform(*settings.REVERSAL_FRICTION_RATIOS))
    return place_at_random(PivotModel(friction_ratio=ratio), rng)


def compute(quick: bool = False, track: Track = iter) -> Reversals:
    """Simulate the recordings, and estimate their angles."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["reversal"]
    rows = []
    for draw in track(range(draws)):
        rng = np.random.default_rng((0, draw))
        model = draw_model(rng)
        recording, truth = simulate_pivot(model, seed=draw)
        noise = estimate_noise(recording)
        result = estimate_angles(recording, DEFAULT_METHOD, noise=noise)
        firm = np.nonzero(truth.sticking_now.sum(axis=1) >= settings.FIRM_MARKERS)[0]
        error = np.degrees(result.angle - truth.angle)
        points = recording.layout.reference[:, :2]
        bounds = [angle_limit(points, truth.sticking_now[frame], model.noise) for frame in firm]
        picked = int(rng.choice(firm[result.answered[firm]]))
        slip = result.slipping
        late = np.nan
        if slip.any() and truth.macro_slip.any():
            seen, began = (recording.source_index[np.argmax(s)] for s in (slip, truth.macro_slip))
            late = float(seen - began)
        rows.append(
            (
                model.friction_ratio,
                np.nanmean(np.abs(error[firm])),
                np.mean(~result.answered[firm]),
                result.low[picked] <= truth.angle[picked] <= result.high[picked],
                MEAN_ABSOLUTE * np.degrees(np.mean(bounds)),
                late,
                *_look_back(recording, truth, result, noise, firm),
                *_jumps(truth, result),
            )
        )
    columns = [np.array(column, dtype=float) for column in zip(*rows, strict=True)]
    for flag in ("inside", "dated_inside"):
        place = Reversals._fields.index(flag)
        columns[place] = columns[place].astype(bool)
    return Reversals(*columns)


def _look_back(
    recording: Recording,
    truth: Truth,
    result: Result,
    noise: Noise,
    firm: Int[np.ndarray, " firm"],
) -> tuple[float, bool, float, float, float]:
    """Values of a draw for `dated`, `dated_inside`, `slid_live`, `slid` and `withdrawn`."""
    slips = find_slips(recording, result, noise)
    no_imprint = np.full(len(recording), np.nan)
    back = withdraw(result, slips, no_imprint).answered
    withdrawn = float(np.mean(result.answered[firm] & ~back[firm]))
    dates = [slip for slip in slips if slip.certain]
    if not truth.macro_slip.any():
        return np.nan, False, np.nan, np.nan, withdrawn
    first = int(np.argmax(truth.macro_slip))
    shares = float(result.answered[first:].mean()), float(back[first:].mean()), withdrawn
    if not dates:
        return np.nan, False, *shares
    before, after = recording.time[first - 1], recording.time[first]
    late = (dates[0].onset - after) * settings.RATE
    return float(late), bool(dates[0].low <= after and before <= dates[0].high), *shares


def _jumps(truth: Truth, result: Result) -> tuple[int, int, int]:
    """Values of a draw for `jumps`, `late_jumps` and `late_jumps_inside`."""
    answers = np.flatnonzero(result.answered & ~truth.macro_slip)
    error = np.degrees(result.angle - truth.angle)[answers]
    jumped = answers[1:][np.abs(np.diff(error)) > settings.JUMP_DEG]
    late = jumped[truth.sticking_now[jumped].sum(axis=1) < settings.FIRM_MARKERS]
    inside = (result.low[late] <= truth.angle[late]) & (truth.angle[late] <= result.high[late])
    return len(jumped) - len(late), len(late), int(inside.sum())


def tables(result: Reversals) -> dict[str, list[dict[str, object]]]:
    """One row: pooled error, answers, intervals and macro slip."""
    late = result.late[np.isfinite(result.late)]
    return {
        "": [
            {
                "draws": len(result.error),
                "mean absolute error [°]": cell(result.error, 4),
                "Cramér–Rao bound [°]": cell(result.limit, 4),
                "worst draw [°]": cell(result.error, 4, np.max),
                "unanswered [%]": cell(100 * result.unanswered, 2),
                "interval holds [%]": cell(100 * result.inside, 1),
                "macro slip noticed live [%]": cell(100 * len(late) / len(result.late), 1),
                "late, median [frames]": cell(late, 1, np.median),
                "late, 5 to 95 % [frames]": (
                    " to ".join(f"{q:.0f}" for q in np.percentile(late, [5, 95]))
                    if len(late)
                    else None
                ),
                "within 2 frames [%]": cell(100 * (np.abs(late) <= 2), 1),
                "dated [%]": cell(100 * np.isfinite(result.dated), 1),
                "date, median [frames]": cell(result.dated, 1, np.median),
                "date within 2 frames [%]": cell(100 * (np.abs(result.dated) <= 2.0), 1),
                "date's interval holds [%]": cell(100 * result.dated_inside, 1),
                "angles in macro slip, live [%]": cell(100 * result.slid_live, 1),
                "looking back [%]": cell(100 * result.slid, 1),
                "wrongly withdrawn [%]": cell(100 * result.withdrawn, 1),
                "jumps": int(result.jumps.sum()),
                "jumps, fewer markers": int(result.late_jumps.sum()),
                "of these inside": int(result.late_jumps_inside.sum()),
            }
        ]
    }


def plot(result: Reversals) -> Figure:
    """Left: error over friction, with the bound. Right: delay of macro slip's detection."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    left.semilogy(result.friction_ratio, result.error, ".", ms=4, label=DEFAULT_METHOD)
    left.semilogy(
        result.friction_ratio, result.limit, "k.", ms=2, label="Cramér–Rao bound, a frame"
    )
    error = "mean absolute error [°]"
    finish(left, legend=8, minor=True, xlabel="μp₀/2G* [-]", ylabel=error)
    for values, label in ((result.late, "when seen"), (result.dated, "dated, looking back")):
        known = values[np.isfinite(values)]
        if len(known):
            bins = np.arange(np.floor(known.min()) - 0.5, known.max() + 1.5)
            right.hist(known, bins=bins, alpha=0.6, label=label)
    right.set(xlabel="macro slip found after it began [frames]", ylabel="draws")
    right.legend(frameon=False)
    return figure
