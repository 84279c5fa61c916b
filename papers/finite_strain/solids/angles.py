"""The default method on markers of gels under cubes and ellipsoids.

Each recording places 20 × 20 markers at random on a surface of `solids.npz`: unloaded, pressed on,
turned to 20° and back.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.frames.recording import Recording
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, lay_out_markers
from papers.finite_strain.solids.cases import (
    Case,
    Field,
    contact_radius,
    make_whole,
    move_on_grid,
)

NOISES_UM = (1.0, 3.0, 10.0)
GROUPS = {"20 or more": (20, 400), "10 to 19": (10, 19), "5 to 9": (5, 9), "0 to 4": (0, 4)}
"""Groups of frames on the way up by the number of markers that have stuck since the turn began."""

_UNLOADED = 12
_NORMAL_NOISE = 3.5
_FIRM = 10


class Followed(NamedTuple):
    """A recording's frames from the turn on.

    Attributes:
        held: number of markers that have stuck since the turn began; −1 on the way back.
        answered: whether there is an angle.
        error: error of the angle [deg].
        half_width: half of the width of its interval [deg].
        inside: whether the interval holds the truth.
        slipping: whether macro slip is reported.
        radius_off: error of the contact's radius when pressed, over the radius [-].
    """

    held: Int[np.ndarray, " frames"]
    answered: Bool[np.ndarray, " frames"]
    error: Float[np.ndarray, " frames"]
    half_width: Float[np.ndarray, " frames"]
    inside: Bool[np.ndarray, " frames"]
    slipping: Bool[np.ndarray, " frames"]
    radius_off: float


def follow_markers(field: Field, noise_um: float, seed: int) -> Followed:
    """Place markers on a surface at random, and estimate the object's angle from them.

    Args:
        field: motion of a gel's top.
        noise_um: noise of the markers in the plane; along z 3.5 times as large [µm].
        seed: of noise and place.
    """
    rng, field = np.random.default_rng(seed), make_whole(field)
    x, y = rng.uniform(-0.5, 0.5, 2).tolist()
    turn = float(rng.uniform(0.0, np.pi / 2))
    layout = lay_out_markers(PivotModel(offset=(x, y), grid_angle=turn))
    displacement, stick = move_on_grid(field, layout.reference[:, :2])
    moved = np.concatenate([np.zeros((_UNLOADED, *displacement.shape[1:])), displacement])
    sizes = 1e-3 * noise_um * np.array([1.0, 1.0, _NORMAL_NOISE])
    positions = layout.reference + moved + rng.normal(size=moved.shape) * sizes
    frames = np.arange(len(positions))
    valid = np.ones(positions.shape[:2], dtype=bool)
    result = estimate_angles(Recording(layout, positions, valid, frames / 30.0, frames))
    pressed, peak = int(np.argmax(field.twist != 0.0)) - 1, int(field.twist.argmax())
    held = np.logical_and.accumulate(stick[pressed:], axis=0).sum(axis=1)
    held[peak + 1 - pressed :] = -1
    since = slice(_UNLOADED + pressed, None)
    truth, radius = field.twist[pressed:], contact_radius(field, pressed)
    low, high = result.low[since], result.high[since]
    return Followed(
        held=held,
        answered=result.answered[since],
        error=np.degrees(result.angle[since] - truth),
        half_width=0.5 * np.degrees(high - low),
        inside=(low <= truth) & (truth <= high),
        slipping=result.slipping[since],
        radius_off=float(result.contact_radius[since][0] / radius - 1.0),
    )


def summarize(case: Case, noise_um: float, draws: list[Followed]) -> list[dict[str, object]]:
    """A row for each group of frames, and one for the way back."""
    rows: list[dict[str, object]] = []
    joined = [np.concatenate(parts) for parts in list(zip(*draws, strict=True))[:6]]
    held, answered, error, half_width, inside, slipping = joined
    for group, (low, high) in {**GROUPS, "way back": (-1, -1)}.items():
        chosen = (held >= low) & (held <= high)
        known = chosen & answered
        off = np.abs(error[known])
        rows.append({
            "object, mm": case.name,
            "depth [mm]": case.depth_mm,
            "noise [µm]": noise_um,
            "markers that stick": group,
            "frames": int(chosen.sum()),
            "answered [%]": _round(100.0 * np.mean(answered[chosen]), 0) if chosen.any() else None,
            "mean error [°]": _round(off.mean(), 3) if known.any() else None,
            "largest error [°]": _round(off.max(), 2) if known.any() else None,
            "half-width [°]": _round(half_width[known].mean(), 2) if known.any() else None,
            "interval holds [%]": _round(100.0 * inside[known].mean(), 0) if known.any() else None,
            "wrong by > 1° outside it": int(np.sum(~inside[known] & (off > 1.0))),
            "macro slip in error": int(np.sum(slipping[chosen])) if low >= _FIRM else None,
        })  # fmt: skip
    return rows


def _round(value: Any, digits: int) -> float:
    return round(float(value), digits)
