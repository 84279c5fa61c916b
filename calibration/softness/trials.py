"""Trials: grasps of an object whose angle is known from elsewhere, as pairs of two angles."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from calibration.softness.references import Reference
from estimation.estimators.measurement import Z95
from estimation.noise import Noise, estimate_noise
from estimation.recording import Recording
from estimation.result import State
from estimation.softness import disc_radius
from estimation.tracker import estimate_angles

LEAST_STICK = 9
"""Markers that must stick: with fewer the angle hangs on what cannot be seen to slip."""

FEWEST_POINTS = 6
"""Readings of one trial: slope, zero and clock leave three to tell the scatter."""

SLIP_TURN = np.radians(2.0)
SLIP_SHARE = 0.1

METHOD = "incremental"
"""It knows nothing of the object but what sticks to it: `tracked` asks the outline, too."""


@dataclass(frozen=True)
class Trial:
    """The rotation of an elastomer that an object stuck to, and the object's own angle.

    Attributes:
        name: of the recording.
        thing: name of the object.
        start: time of the recording's first frame [s].
        time: of the usable frames [s].
        rotation: φ of what sticks [rad, counter-clockwise].
        error: its standard error [rad].
        normal_force: in those frames [N]; NaN where unknown.
        radius: of the contact in those frames [mm]; NaN where unknown.
        reference: the object's angle.
        excluded: frames that are not used, by why.
        markers: number of the sensor's markers; 0 where unknown.
        pitch: distance between them [mm]; NaN where unknown.
    """

    name: str
    thing: str
    start: float
    time: Float[np.ndarray, " frames"]
    rotation: Float[np.ndarray, " frames"]
    error: Float[np.ndarray, " frames"]
    normal_force: Float[np.ndarray, " frames"]
    radius: Float[np.ndarray, " frames"]
    reference: Reference
    excluded: Mapping[str, int]
    markers: int = 0
    pitch: float = float("nan")


def make_trials(
    recording: Recording,
    reference: Reference,
    *,
    thing: str = "object",
    noise: Noise | None = None,
) -> list[Trial]:
    """The trials of a recording, one for each contact: what sticks, without macro slip.

    Args:
        recording: of an object that turns in the grasp.
        reference: its angle.
        thing: name of the object.
        noise: of the markers; estimated from the recording unless given.

    Raises:
        ValueError: the recording is too short to tell its noise.
    """
    result = estimate_angles(recording, METHOD, noise=noise or estimate_noise(recording))
    touching = np.array([s not in (State.NO_CONTACT, State.UNKNOWN) for s in result.state])
    sticks = result.stick.sum(axis=1)
    usable = touching & result.answered & (sticks >= LEAST_STICK)
    still = usable & stands_still(recording.time, result.angle, reference)
    usable &= ~still
    apart = np.array([state == State.NO_CONTACT for state in result.state])
    contact = np.cumsum(np.diff(apart.astype(int), prepend=0) < 0)
    points = recording.layout.reference
    neighbours = recording.layout.neighbours
    first = neighbours[:, 0]
    edges = np.linalg.norm(points[first] - points, axis=1)[first >= 0]
    contacts = zip(recording.positions[..., :2], result.contact, strict=True)
    radius = np.array([disc_radius(plane[inside]) for plane, inside in contacts])
    force = np.full(len(recording), np.nan) if recording.force is None else -recording.force[:, 2]
    numbers, counts = np.unique(contact[usable], return_counts=True)
    short = counts < FEWEST_POINTS
    touches = numbers[short] if not short.all() else numbers[:0]
    trials = []
    for number in np.setdiff1d(numbers, touches):
        mine = contact == number
        reasons = Counter(
            "in macro slip" if still[i] else _reason(result.state[i], int(sticks[i]))
            for i in np.flatnonzero(mine & ~usable)
        )
        if touched := int((usable & np.isin(contact, touches)).sum()) * (not trials):
            reasons["of a touch too short to fit"] = touched
        rows = np.flatnonzero(mine & usable)
        trials.append(
            Trial(
                name=recording.name
                if len(numbers) - len(touches) == 1
                else f"{recording.name}, contact {len(trials) + 1}",
                thing=thing,
                start=float(recording.time[0]),
                time=recording.time[rows],
                rotation=result.angle[rows],
                error=0.5 * (result.high - result.low)[rows] / Z95,
                normal_force=force[rows],
                radius=radius[rows],
                reference=reference,
                excluded=dict(reasons),
                markers=len(points),
                pitch=float(np.median(edges)) if len(edges) else float("nan"),
            )
        )
    if not trials:
        states = Counter(_reason(s, int(n)) for s, n in zip(result.state, sticks, strict=True))
        shown = ", ".join(f"{count} {reason}" for reason, count in states.items())
        raise ValueError(
            f"{recording.name}: no frame in which {LEAST_STICK} markers stick and their rotation "
            f"is known ({shown}): press harder, or turn less"
        )
    return trials


def stands_still(
    time: Float[np.ndarray, " frames"],
    rotation: Float[np.ndarray, " frames"],
    reference: Reference,
) -> Bool[np.ndarray, " frames"]:
    """Frames in which the object turns and the gel does not: it slips, though nothing moves apart.

    A gel that turns by less than a tenth of what the object does would mean k above 9. Told only
    where the two have one clock, over stretches in which the object turns by 2°.
    """
    still = np.zeros(len(time), dtype=bool)
    known = np.isfinite(reference.angle)
    if not reference.same_clock or known.sum() < 2:
        return still
    there = np.interp(
        time, reference.time[known], reference.angle[known], left=np.nan, right=np.nan
    )
    for first in range(len(time)):
        turned = np.abs(there[first:] - there[first])
        far = np.flatnonzero(turned >= SLIP_TURN)
        if not len(far):
            continue
        last = first + int(far[0])
        gel = rotation[first : last + 1]
        if np.isfinite(gel).any() and np.ptp(gel[np.isfinite(gel)]) < SLIP_SHARE * turned[far[0]]:
            still[first : last + 1] = True
    return still


def _reason(state: State, sticks: int) -> str:
    """Why a frame is not used."""
    if state == State.MACRO_SLIP:
        return "in macro slip"
    if state in (State.NO_CONTACT, State.UNKNOWN):
        return "without contact" if state == State.NO_CONTACT else "unusable"
    return f"held by fewer than {LEAST_STICK} markers" if sticks < LEAST_STICK else "unusable"
