"""Rotational slip of the object over the pad: the curl of the slip at each marker, and its total.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (9).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from contactmodel.equations import object_rotation, slip_curl_of_rotation
from estimation.estimators.measurement import Measurement
from estimation.estimators.result import Result, State, Track
from estimation.fields.measure import Fields
from estimation.fields.stick import MIN_STICK_MARKERS


class Since(NamedTuple):
    """The frame that a method's angle counts from; by default the value before the first frame.

    Attributes:
        restarts: number of restarts of the count since the object touched.
        since: time stamp of the frame that the angle counts from [s].
    """

    restarts: int = 0
    since: float = float("nan")

    def update(self, gel: Measurement, fields: Fields, time: float) -> "Since":
        """The value after the next frame."""
        if not fields.contact.any():
            return Since(0, time)
        return self if gel.restarts == self.restarts else Since(gel.restarts, time)


class Count:
    """Counts φ of the markers from the same frame as the angle.

    Markers that stick now are no measure of slip: after a reversal they include markers that have
    slipped before. If the recording starts with a loaded pad and the angle counts from that frame,
    φ counts from it too.

    Attributes:
        start: φ of each marker in the frame that the angle counts from [rad]; 0 for the unloaded
            shape.
        held: whether markers have stuck in every frame since the object touched.
    """

    def __init__(self) -> None:
        """Begin with the unloaded shape."""
        self.start: Float[np.ndarray, " n"] | float = 0.0
        self.held = True
        self._restarts = 0

    def turned(
        self, state: State, restarts: int, rotation: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Rotation of the gel at each marker since the frame that the angle counts from [rad].

        Args:
            state: state of the next frame's contact.
            restarts: number of restarts of the count since the object touched.
            rotation: φ of each marker [rad].
        """
        free, sticks = state == State.NO_CONTACT, state in (State.STICK, State.INCIPIENT)
        self.held = free or (self.held and sticks)
        if free or not restarts:
            self.start = 0.0
        elif restarts != self._restarts:
            self.start = rotation
        self._restarts = restarts
        return rotation - self.start

    def held_angle(self, gel: Measurement) -> float:
        """Rotation of the markers that have stuck since the object touched [rad]; NaN if few do."""
        few = gel.stick.sum() < MIN_STICK_MARKERS
        return np.nan if few or not self.held else gel.angle


def gel_ends(
    turned: Float[np.ndarray, " n"], contact: Bool[np.ndarray, " n"], held: float = np.nan
) -> tuple[float, float]:
    """Rotation of the gel that has turned furthest in either direction [rad].

    The values are medians over the tenth of the contact's markers, at least five, that have turned
    furthest clockwise and counter-clockwise. Noise of φ shifts them outwards by up to twice itself.

    Args:
        turned: φ of each marker since the frame that the angle counts from [rad]; NaN if unknown.
        contact: markers of the contact region.
        held: rotation of markers that have stuck, which the ends include [rad]; NaN if unknown.

    Returns:
        Clockwise and counter-clockwise end; NaN with fewer than five markers.
    """
    fewest = 5
    turns = np.sort(turned[contact & np.isfinite(turned)])
    most = max(len(turns) // 10, fewest)
    if len(turns) < most:
        return np.nan, np.nan
    rest, lower, upper = len(turns) - most, (most - 1) // 2, most // 2
    low, high = turns[lower] + turns[upper], turns[rest + lower] + turns[rest + upper]
    return float(np.fmin(0.5 * low, held)), float(np.fmax(0.5 * high, held))


def turned_since_counted(result: Result) -> Float[np.ndarray, "frames n"]:
    """Rotation of the gel at each marker since the frame that the angle counts from [rad]."""
    count = Count()
    frames = zip(result.state, result.restarts.tolist(), result.rotation, strict=True)
    return np.stack([count.turned(*frame) for frame in frames])


def slip_curl(
    turned: Float[np.ndarray, " n"],
    contact: Bool[np.ndarray, " n"],
    angle: float,
    softness: tuple[float, float],
) -> Float[np.ndarray, " n"]:
    """rot(s) at each marker ([Li2024] Eq. 9) [rad]; NaN outside the contact region.

    Args:
        turned: φ since the frame that the angle counts from [rad].
        contact: markers of the contact region.
        angle: angle of the object [rad].
        softness: k [-] and L [rad].
    """
    curl = slip_curl_of_rotation(turned, *softness, clockwise=-angle)
    return np.where(contact, np.asarray(curl), np.nan)


def accumulate_slip(track: Track) -> Float[np.ndarray, " frames"]:
    """Rotation of the object over the gel in each frame [rad, counter-clockwise].

    This is the object's angle less that of the gel under it (`follow_gel`), both since the frame
    that the angle counts from. It is zero while some of the gel has turned as far as the object,
    and NaN without contact or angle.
    """
    return track.angle - np.asarray(
        object_rotation(follow_gel(track), track.stiffness_ratio, track.load_term)
    )


def follow_gel(track: Track) -> Float[np.ndarray, " frames"]:
    """Rotation of the gel that has followed the object furthest in each frame [rad].

    It counts from the same frame as the angle. A mean over the contact is of little use: φ falls
    and changes sign around the stick region, and after a reversal the rim keeps its earlier
    rotation. If the object's rotation lies between the two ends of the gel's (`gel_ends`), some gel
    has followed it fully. Beyond them, the nearer end is returned; without an angle, the larger
    end. NaN without contact.
    """
    zero = np.asarray(object_rotation(0.0, track.stiffness_ratio, track.load_term))
    followed = (track.angle - zero) / (1.0 + track.stiffness_ratio)
    low, high = track.gel_low, track.gel_high
    further = np.where(np.abs(high) > np.abs(low), high, low)
    return np.where(np.isfinite(followed), np.clip(followed, low, high), further)


def find_restarts(track: Track) -> list[float]:
    """Times at which the count of a lost angle was restarted, since the first frame [s].

    A contact that counts from the first frame of the recording is not included.
    """
    first = track.time[0] if len(track.time) else np.nan
    times = {float(t) for t, n in zip(track.since, track.restarts, strict=True) if n and t > first}
    return sorted(time - float(first) for time in times)


def describe_counts(track: Track) -> tuple[str, ...]:
    """A sentence with the times at which the count of a lost angle was restarted, if any."""
    times = find_restarts(track)
    if not times:
        return ()
    shown = ", ".join(f"{time:.2f}" for time in times[:5])
    more = ", …" if len(times) > 5 else ""
    return (
        f"The angle was lost and restarted {shown}{more} s after the first frame (columns since_s "
        "and restarts): earlier rotation is not included.",
    )
