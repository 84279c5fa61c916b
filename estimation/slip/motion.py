"""How far the object has slipped over the pad: the curl of the slip, and in all.

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


class Since(NamedTuple):
    """What the angle of a method counts from.

    Attributes:
        anew: how often it was counted anew since the object touched.
        since: time stamp of the frame that it counts from [s].
    """

    anew: int = 0
    since: float = float("nan")

    def update(self, gel: Measurement, fields: Fields, time: float) -> "Since":
        """The count after the next frame."""
        if not fields.contact.any():
            return Since(0, time)
        return self if gel.anew == self.anew else Since(gel.anew, time)


NO_COUNT = Since()
"""Before the first frame."""


class Count:
    """From where the angle is counted: the unloaded shape, or the frame that set it to zero.

    What sticks now is no measure of slip: after a reversal the region holds markers that have
    slipped before. Where the pad was first seen loaded and the angle is counted from that frame, so
    is φ.

    Attributes:
        start: φ of each marker in the frame that the angle is counted from [rad]; 0 for the
            unloaded shape.
    """

    def __init__(self) -> None:
        """Begin with the unloaded shape."""
        self.start: Float[np.ndarray, " n"] | float = 0.0
        self._anew = 0

    def turned(
        self, state: State, anew: int, rotation: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """How far the gel at each marker has turned since the angle is counted [rad].

        Args:
            state: of the next frame's contact.
            anew: how often the angle has been counted anew since the object touched.
            rotation: φ of each marker [rad].
        """
        if state == State.NO_CONTACT or not anew:
            self.start = 0.0
        elif anew != self._anew:
            self.start = rotation
        self._anew = anew
        return rotation - self.start


def gel_ends(
    turned: Float[np.ndarray, " n"], contact: Bool[np.ndarray, " n"]
) -> tuple[float, float]:
    """Rotation of the gel that has turned furthest either way [rad]; NaN where too few tell.

    The medians of the tenth of the contact's markers, at least `FEWEST`, that have turned furthest;
    noise of φ adds up to twice itself to them.

    Args:
        turned: φ of each marker since the angle is counted [rad]; NaN where unknown.
        contact: markers of the contact region.
    """
    fewest = 5  # markers that tell how far the gel has turned
    known = np.sort(turned[contact & np.isfinite(turned)])
    most = max(len(known) // 10, fewest)
    if len(known) < most:
        return np.nan, np.nan
    rest, lower, upper = len(known) - most, (most - 1) // 2, most // 2
    low, high = known[lower] + known[upper], known[rest + lower] + known[rest + upper]
    return 0.5 * float(low), 0.5 * float(high)


def find_slip_curl(result: Result, frame: int) -> Float[np.ndarray, " n"]:
    """rot(s) at each marker since the angle has been counted ([Li2024] Eq. 9) [rad].

    The object's angle is the estimated one.

    Args:
        result: of one method.
        frame: row of the recording.

    Returns:
        NaN outside the contact region and where the angle is unknown.
    """
    softness = float(result.stiffness_ratio[frame]), float(result.load_term[frame])
    turned = turned_since_counted(result.take(slice(frame + 1)))[frame]
    return slip_curl(turned, result.contact[frame], float(result.angle[frame]), softness)


def turned_since_counted(result: Result) -> Float[np.ndarray, "frames n"]:
    """How far the gel at each marker has turned since the angle is counted, by frame [rad]."""
    count = Count()
    frames = zip(result.state, result.anew.tolist(), result.rotation, strict=True)
    return np.stack([count.turned(*frame) for frame in frames])


def slip_curl(
    turned: Float[np.ndarray, " n"],
    contact: Bool[np.ndarray, " n"],
    angle: float,
    softness: tuple[float, float],
) -> Float[np.ndarray, " n"]:
    """rot(s) at each marker ([Li2024] Eq. 9) [rad]; NaN outside the contact region.

    Args:
        turned: φ since the angle is counted [rad].
        contact: markers of the contact region.
        angle: of the object [rad].
        softness: k and L [-, rad].
    """
    curl = slip_curl_of_rotation(turned, *softness, clockwise=-angle)
    return np.where(contact, np.asarray(curl), np.nan)


def accumulate_slip(track: Track) -> Float[np.ndarray, " frames"]:
    """How far the object has turned over the gel [rad, counter-clockwise].

    The object's angle less that of the gel under it (`follow_gel`), both since the angle has been
    counted: zero while some of the gel has turned as far as the object. NaN without contact and
    where the angle is unknown.
    """
    return track.angle - np.asarray(
        object_rotation(follow_gel(track), track.stiffness_ratio, track.load_term)
    )


def follow_gel(track: Track) -> Float[np.ndarray, " frames"]:
    """Rotation of the gel that has followed the object furthest, since the angle is counted [rad].

    Around what sticks φ falls and changes sign, and after a reversal the rim keeps what it was
    turned before: a mean over the contact says little. Between the gel that has turned furthest
    either way (`gel_ends`) some has turned as the object wants it; beyond them the nearer one is
    the answer, and where the object's angle is unknown the larger one. NaN without contact.
    """
    zero = np.asarray(object_rotation(0.0, track.stiffness_ratio, track.load_term))
    wanted = (track.angle - zero) / (1.0 + track.stiffness_ratio)
    low, high = track.gel_low, track.gel_high
    further = np.where(np.abs(high) > np.abs(low), high, low)
    return np.where(np.isfinite(wanted), np.clip(wanted, low, high), further)


def describe_counts(track: Track) -> tuple[str, ...]:
    """When angles were counted anew after they had been lost, in sentences; none if they were not.

    A contact that is counted from the first frame of the recording is not among them.
    """
    first = track.time[0] if len(track.time) else np.nan
    times = {float(t) for t, n in zip(track.since, track.anew, strict=True) if n and t > first}
    if not times:
        return ()
    shown = ", ".join(f"{time:.2f}" for time in sorted(times)[:5])
    more = ", …" if len(times) > 5 else ""
    return (
        f"The angle was unknown and is counted anew from {shown}{more} s (columns since_s and "
        "counted_anew): earlier rotation is not included.",
    )
