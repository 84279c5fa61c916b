"""How far the object has slipped over the pad: the curl of the slip, and in all.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (9).
"""

import numpy as np
from jaxtyping import Float, Int

from contactmodel.equations import object_rotation, slip_curl_of_rotation
from estimation.estimators.result import Result, State

FEWEST = 5
"""Markers that tell how far the gel has turned."""


def find_slip_curl(result: Result, frame: int) -> Float[np.ndarray, " n"]:
    """rot(s) at each marker since the angle has been counted ([Li2024] Eq. 9) [rad].

    The object's angle is the estimated one. What sticks now is no measure of it: after a reversal
    the region holds markers that have slipped before. Where the pad was first seen loaded and the
    angle is counted from that frame, so is φ.

    Args:
        result: of one method.
        frame: row of the recording.

    Returns:
        NaN outside the contact region and where the angle is unknown.
    """
    return _slip_curl(result, frame, _count_starts(result)[frame])


def accumulate_slip(
    result: Result, gel: Float[np.ndarray, " frames"] | None = None
) -> Float[np.ndarray, " frames"]:
    """How far the object has turned over the gel [rad, counter-clockwise].

    The object's angle less that of the gel under it (`follow_gel`), both since the angle has been
    counted: zero while some of the gel has turned as far as the object. NaN without contact and
    where the angle is unknown.
    """
    return result.angle - np.asarray(
        object_rotation(follow_gel(result), result.stiffness_ratio, result.load_term)
    )


def follow_gel(result: Result) -> Float[np.ndarray, " frames"]:
    """Rotation of the gel that has followed the object furthest, since the angle is counted [rad].

    Around what sticks φ falls and changes sign, and after a reversal the rim keeps what it was
    turned before: a mean over the contact says little. The ends are the medians of φ over the tenth
    of the contact's markers, at least `FEWEST`, that have turned furthest either way; noise of φ
    adds up to twice itself to them. Between them some gel has turned as the object wants it; beyond
    them the nearer one is the answer, and where the object's angle is unknown the larger one. NaN
    without contact.
    """
    zero = np.asarray(object_rotation(0.0, result.stiffness_ratio, result.load_term))
    wanted = (result.angle - zero) / (1.0 + result.stiffness_ratio)
    start = np.array([len(result.time) if i is None else i for i in _count_starts(result)])
    unloaded = np.zeros((1, result.rotation.shape[1]))
    rotation = result.rotation - np.concatenate([result.rotation, unloaded])[start]
    rotation = np.sort(np.where(result.contact, rotation, np.nan), axis=1)  # NaN at the end
    known = np.isfinite(rotation).sum(axis=1)
    most = np.maximum(known // 10, FEWEST)
    low, high = _median(rotation, 0 * known, most), _median(rotation, known - most, most)
    further = np.where(np.abs(high) > np.abs(low), high, low)
    gel = np.where(np.isfinite(wanted), np.clip(wanted, low, high), further)
    return np.where(known >= most, gel, np.nan)


def describe_counts(result: Result) -> tuple[str, ...]:
    """When angles were counted anew after they had been lost, in sentences; none if they were not.

    A contact that is counted from the first frame of the recording is not among them.
    """
    first = result.time[0] if len(result.time) else np.nan
    times = {float(t) for t, n in zip(result.since, result.anew, strict=True) if n and t > first}
    if not times:
        return ()
    shown = ", ".join(f"{time:.2f}" for time in sorted(times)[:5])
    more = ", …" if len(times) > 5 else ""
    return (
        f"The angle was unknown and is counted anew from {shown}{more} s (columns since_s and "
        "counted_anew): what the object turned before is not in it.",
    )


def _median(
    ordered: Float[np.ndarray, "frames n"],
    first: Int[np.ndarray, " frames"],
    count: Int[np.ndarray, " frames"],
) -> Float[np.ndarray, " frames"]:
    """Of each row the median of so many values from the first on."""
    rows, last = np.arange(len(ordered)), ordered.shape[1] - 1
    middle = np.stack([first + (count - 1) // 2, first + count // 2])
    return ordered[rows, np.clip(middle, 0, last)].mean(axis=0)


def _slip_curl(result: Result, frame: int, start: int | None) -> Float[np.ndarray, " n"]:
    stiffness_ratio = float(result.stiffness_ratio[frame])
    load_term = float(result.load_term[frame])
    rotation = result.rotation[frame] - (0.0 if start is None else result.rotation[start])
    curl = slip_curl_of_rotation(
        rotation, stiffness_ratio, load_term, clockwise=-float(result.angle[frame])
    )
    return np.where(result.contact[frame], np.asarray(curl), np.nan)


def _count_starts(result: Result) -> list[int | None]:
    """For each frame the one from which its angle was counted anew; None for the unloaded shape."""
    starts: list[int | None] = []
    start, before = None, 0
    for i, (state, anew) in enumerate(zip(result.state, result.anew.tolist(), strict=True)):
        if state == State.NO_CONTACT or not anew:
            start = None
        elif anew != before:
            start = i
        before = anew
        starts.append(start)
    return starts
