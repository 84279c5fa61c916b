"""Accuracy of the margin's prediction of macro slip, by the angle ahead.

Reversals of round pivots on a half-space, and spheres, ellipsoids and punches on layers (those of
`few_markers`) as they are turned up to 20°. The margin is predicted from the markers alone, and
from moments with noise of 0.5 % of their largest. The true end is the frame in which fewer than
three markers stick; it changes in steps, since markers slip one by one. With moments, the limit of
the moment is predicted as well: the present moment and its margin. In the first turn of each
recording the disc that sticks is compared with the true one, and the friction coefficient, which is
the predicted limit over the normal force and its arm.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.estimators.measurement import Z95, StickDisc
from estimation.estimators.result import Result
from estimation.fields.face import face_arm
from estimation.frames.recording import Recording
from estimation.slip.branch import MarginSettings
from estimation.slip.margin import MarginPath, follow_margin, widen_disc
from estimation.slip.pressures import Face, typical_face
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import Truth, simulate_pivot
from papers.items import Track
from papers.tables import cell, finish
from papers.virtual_pivots import settings
from papers.virtual_pivots.contact_edge import HERTZ_ARM
from papers.virtual_pivots.few_markers import add_noise, shapes, simulate_turn
from papers.virtual_pivots.reversal import draw_model

AHEAD_DEG = (20.0, 15.0, 10.0, 5.0, 2.0)
SLIPPED_SHARES = (0.1, 0.2, 0.3, 0.5, 0.7)
"""Shares of the markers in contact that slip, at which the limit of the moment is predicted."""
MOMENT_NOISE = 0.005
NOISES_MM = tuple(1e-3 * noise for noise in settings.NOISES_UM)
HALF_SPACE = "sphere on a half-space"


class Foretold(NamedTuple):
    """The predictions in a recording by angle ahead; NaN without one."""

    shape: str  # name of the object
    noise: float  # noise of x and y [mm]
    by: str  # what the margin follows from: `markers` or `moments`
    error: Float[np.ndarray, " aheads"]  # predicted minus true remaining angle [deg]
    # lower end of the interval minus the true remaining angle [deg]
    low: Float[np.ndarray, " aheads"]
    # upper end of the interval minus the true remaining angle [deg]
    high: Float[np.ndarray, " aheads"]
    asked: Bool[np.ndarray, " aheads"]  # whether the recording has a frame so far ahead
    # predicted limit of the moment and both ends of its interval, over the true limit, less 1 [-]
    limits: Float[np.ndarray, "3 shares"]
    # c/a less the true one, and its standard error [-]; in the first turn
    discs: Float[np.ndarray, "2 shares"]
    # friction coefficient over the true one, less 1 [-]
    friction: Float[np.ndarray, " shares"]


def compute(quick: bool = False, track: Track = iter) -> list[Foretold]:
    """Simulate the recordings, and predict macro slip in each."""
    draws = (settings.QUICK_DRAWS if quick else settings.DRAWS)["margin"]
    resolution = settings.FEW_COARSE if quick else settings.FEW_FINE
    names = [] if quick else list(shapes())
    cases = [(HALF_SPACE, 0.0, draw) for draw in range(draws)]
    for name in names:
        for friction in settings.FEW_FRICTIONS:
            cases += [(name, friction, draw) for draw in range(draws // 5)]
    return [
        foretold
        for name, friction, draw in track(cases)
        for noise in NOISES_MM
        for foretold in _foretell((name, friction, draw), noise, resolution)
    ]


def _foretell(
    case: tuple[str, float, int], noise_mm: float, resolution: settings.Resolution
) -> Iterator[Foretold]:
    """Follow one draw by the markers, and by moments.

    Args:
        case: name of the object, friction coefficient and draw.
        noise_mm: noise of x and y [mm].
        resolution: resolution of the solved contacts.
    """
    name, friction, draw = case
    rng = np.random.default_rng((1, draw))
    if name == HALF_SPACE:
        model = draw_model(rng)._replace(noise=noise_mm, normal_noise=3.5 * noise_mm)
        recording, truth = simulate_pivot(model, seed=draw)
    else:
        recording, truth = simulate_turn(name, friction, rng, resolution)
        recording = add_noise(recording, noise_mm, rng)
    if not truth.macro_slip.any():
        return
    result = estimate_angles(recording)
    noise = MOMENT_NOISE * np.abs(truth.moment).max() * rng.standard_normal(len(recording))
    loads = {"markers": np.full(len(recording), np.nan), "moments": truth.moment + noise}
    strength = _measure_strength(recording, truth, friction)
    unknown = np.full(len(recording), np.nan)  # only the moment is measured
    for by, moment in loads.items():
        loaded = replace(result, moment=moment, centre_moment=unknown)
        yield _compare((name, noise_mm, by), loaded, truth, strength)


def _measure_strength(recording: Recording, truth: Truth, friction: float) -> float:
    """The true coefficient of friction times the normal force, at the limit [N].

    The force falls by up to 5 % on the way there, since the approach is fixed and friction no
    longer keeps the gel from spreading.
    """
    if not friction:  # a sphere on a half-space: the limit over the arm of Hertz's pressure
        return float(np.abs(truth.moment).max() / (HERTZ_ARM * truth.stick_radius.max()))
    assert recording.force is not None
    return float(-friction * recording.force[np.argmax(truth.macro_slip), 2])


def _compare(
    case: tuple[str, float, str],
    result: Result,
    truth: Truth,
    strength: float,
) -> Foretold:
    """Compare a recording with its truth.

    Args:
        case: name of the object, noise [mm], and what the margin follows from.
        result: angles of the recording, and its moments.
        truth: truth of the recording.
        strength: true coefficient of friction times the normal force, at the limit [N].
    """
    margins = follow_margin(result)
    end = int(np.argmax(truth.macro_slip))
    remaining = np.degrees(np.abs(truth.angle - truth.angle[end]))
    turn = int(np.nanargmax(remaining[: end + 1]))
    error, low, high = foretold = np.full((3, len(AHEAD_DEG)), np.nan)
    asked = np.array([remaining[turn] >= ahead for ahead in AHEAD_DEG])
    for i in np.flatnonzero(asked):
        frame = turn + int(np.argmax(remaining[turn : end + 1] <= AHEAD_DEG[i]))
        foretold[:, i] = np.degrees([values[frame] for values in margins[:3]]) - remaining[frame]
    limits = _compare_limits(margins, result.moment, truth, slice(turn, end))
    discs, friction = _compare_discs(margins, result, truth, strength)
    return Foretold(*case, error, low, high, asked, limits, discs, friction)


def _compare_discs(
    margins: MarginPath, result: Result, truth: Truth, strength: float
) -> tuple[Float[np.ndarray, "2 shares"], Float[np.ndarray, " shares"]]:
    """Errors in the first turn, as in `Foretold.discs` and `Foretold.friction`."""
    discs = np.full((2, len(SLIPPED_SHARES)), np.nan)
    friction = np.full(len(SLIPPED_SHARES), np.nan)
    radius = float(truth.stick_radius.max())
    twisted = np.abs(np.nan_to_num(truth.angle)) > np.radians(0.01)
    touching = truth.contact.sum(axis=1)
    slips = 1.0 - truth.sticking_now.sum(axis=1) / np.maximum(touching, 1)
    slips[~twisted] = 0.0
    last = int(np.nanargmax(np.abs(truth.angle * (np.cumsum(truth.macro_slip) < 1))))
    columns = zip(result.gel_thinness, result.flat_share, result.elongation, strict=True)
    faces = [Face(*map(float, one)) for one in columns]
    for i, slipped in enumerate(SLIPPED_SHARES):
        if not (slips[:last] >= slipped).any():
            continue
        frame = int(np.argmax(slips >= slipped))
        true = truth.stick_radius[frame] / radius
        face = typical_face(faces[: frame + 1])
        disc = StickDisc(float(result.disc_ratio[frame]), float(result.disc_error[frame]))
        discs[:, i] = disc.ratio - true, widen_disc(disc, face, MarginSettings()).error
        predicted = abs(result.moment[frame]) + margins.moment[frame]
        arm = face_arm(face.thinness, face.flat) * result.contact_radius[frame]
        friction[i] = predicted / (strength * arm) - 1.0
    return discs, friction


def _compare_limits(
    margins: MarginPath, moment: Float[np.ndarray, " frames"], truth: Truth, rows: slice
) -> Float[np.ndarray, "3 shares"]:
    """Predicted limits of the moment, as in `Foretold.limits`.

    Args:
        margins: margins of the recording.
        moment: measured moment [N·mm].
        truth: truth of the recording.
        rows: frames from the turn to macro slip.
    """
    limit, first = truth.moment[rows.stop], rows.start
    sticking = truth.sticking_now[rows].sum(axis=1) / truth.contact[rows].sum(axis=1)
    first += int(sticking.argmax())  # the object begins to turn towards this limit
    after = sticking[first - rows.start :]
    limits = np.full((3, len(SLIPPED_SHARES)), np.nan)
    for i, slipped in enumerate(SLIPPED_SHARES):
        if not (after <= 1.0 - slipped).any():
            continue
        frame = first + int(np.argmax(after <= 1.0 - slipped))
        ahead = np.array([values[frame] for values in margins[3:6]])
        limits[:, i] = (np.sign(limit) * moment[frame] + ahead) / abs(limit) - 1.0
    return limits


def tables(result: list[Foretold]) -> dict[str, list[dict[str, object]]]:
    """Rows by noise, in total and for each shape: margins, limits, discs and friction."""
    shown: dict[str, list[dict[str, object]]] = {"": [], "_shapes": [], "_limits": []}
    shown |= {"_limits_shapes": [], "_discs": []}
    for noise in dict.fromkeys(one.noise for one in result):
        chosen = [one for one in result if one.noise == noise]
        about = {"noise [µm]": 1e3 * noise}
        shown[""] += [about | row for row in _tabulate(chosen)]
        shown["_limits"] += [about | row for row in _tabulate_limits(chosen)]
        for name in dict.fromkeys(one.shape for one in chosen):
            some = [one for one in chosen if one.shape == name]
            named = about | {"shape": name}
            shown["_shapes"] += [named | row for row in _tabulate(some)]
            shown["_limits_shapes"] += [named | row for row in _tabulate_limits(some)]
            shown["_discs"] += [named | row for row in _tabulate_discs(some)]
    return shown


def _tabulate_discs(result: list[Foretold]) -> list[dict[str, object]]:
    """Rows by the share of the contact that slips: errors of c/a and of the friction."""
    rows, some = [], [one for one in result if one.by == "moments"]
    for i, slipped in enumerate(SLIPPED_SHARES):
        error, spread = np.array([one.discs[:, i] for one in some]).T
        known, friction = np.isfinite(error), np.array([one.friction[i] for one in some])
        friction = friction[np.isfinite(friction)]
        covered = np.abs(error[known]) <= Z95 * spread[known]
        rows.append(
            {
                "slips [%]": 100.0 * slipped,
                "recordings": len(some),
                "with c/a": int(known.sum()),
                "c/a mean absolute error [-]": cell(np.abs(error[known]), 3),
                "c/a within 0.03 [%]": cell(100.0 * (np.abs(error[known]) <= 0.03), 0),
                "c/a standard error [-]": cell(spread[known], 3),
                "c/a interval holds [%]": cell(100.0 * covered, 0),
                "with μ": len(friction),
                "μ mean absolute error [%]": cell(100.0 * np.abs(friction), 1),
                "μ within 5 % [%]": cell(100.0 * (np.abs(friction) <= 0.05), 0),
            }
        )
    return rows


def _tabulate_limits(result: list[Foretold]) -> list[dict[str, object]]:
    """Rows by the share of the contact that slips: errors of the predicted limit of the moment."""
    rows = []
    limits = np.array([one.limits for one in result if one.by == "moments"])
    limits = limits.reshape(-1, 3, len(SLIPPED_SHARES))
    for i, slipped in enumerate(SLIPPED_SHARES):
        error, low, high = limits[np.isfinite(limits[:, 0, i]), :, i].T
        rows.append(
            {
                "slips [%]": 100.0 * slipped,
                "recordings": len(limits),
                "foretold": len(error),
                "mean absolute error [%]": cell(100.0 * np.abs(error), 1),
                "within 10 % [%]": cell(100.0 * (np.abs(error) <= 0.1), 1),
                "interval holds [%]": cell(100.0 * ((low <= 0) & (high >= 0)), 1),
            }
        )
    return rows


def _tabulate(result: list[Foretold]) -> list[dict[str, object]]:
    rows = []
    for by in dict.fromkeys(one.by for one in result):
        chosen = [one for one in result if one.by == by]
        for i, ahead in enumerate(AHEAD_DEG):
            values = np.array(
                [(one.error[i], one.low[i], one.high[i]) for one in chosen if one.asked[i]]
            ).reshape(-1, 3)
            error, low, high = values[np.isfinite(values[:, 0])].T
            rows.append(
                {
                    "by": by,
                    "ahead [°]": ahead,
                    "recordings": len(values),
                    "foretold": len(error),
                    "bias [°]": cell(error, 2),
                    "mean absolute error [°]": cell(np.abs(error), 2),
                    "half-width [°]": cell(0.5 * (high - low), 2),
                    "interval holds [%]": cell(100.0 * ((low <= 0) & (high >= 0)), 1),
                }
            )
    return rows


def plot(result: list[Foretold]) -> Figure:
    """Errors by the markers, with intervals, over the true remaining angle: a panel each shape.

    The noise is the smallest.
    """
    result = [one for one in result if one.noise == min(NOISES_MM)]
    names = list(dict.fromkeys(one.shape for one in result))
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    size = (3.9 * columns, 3.0 * rows)
    figure, axes = plt.subplots(
        rows, columns, figsize=size, sharex=True, squeeze=False, layout="constrained"
    )
    for axis, name in zip(axes.ravel(), names, strict=False):
        shown = [one for one in result if one.shape == name and one.by == "markers"]
        for i, ahead in enumerate(AHEAD_DEG):
            error, low, high = (
                np.array([getattr(one, key)[i] for one in shown])
                for key in ("error", "low", "high")
            )
            width = np.linspace(-0.5, 0.5, len(error))
            axis.errorbar(
                ahead + width, error, [error - low, high - error], fmt=".", lw=0.5, color="C0"
            )
        axis.axhline(0.0, color="0.6", lw=1)
        finish(axis, title=name, size=9, ylim=(-15.0, 25.0))
    axes[0, 0].invert_xaxis()
    figure.supxlabel("true remaining angle [°]", fontsize=10)
    figure.supylabel("predicted less true [°]", fontsize=10)
    return figure
