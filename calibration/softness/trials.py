"""Trials: grasps of an object with a known angle, as pairs of elastomer and object rotation."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from calibration.softness.references import Reference, median_of_three
from estimation.estimators.measurement import Z95
from estimation.estimators.result import Result, State
from estimation.frames.names import counted
from estimation.frames.noise import Noise, estimate_noise
from estimation.frames.recording import MarkerLayout, Recording
from estimation.softness import RIGID_OBJECT, LayeredSoftness, disc_radius
from estimation.softness.lifting import Seen, displacement_as_seen
from estimation.tracking.tracker import estimate_angles

FEWEST_POINTS = 6
"""Smallest number of readings of a trial: after slope, zero and clock, three remain for scatter."""

FEWEST_ZEROED = 4
"""Smallest number of readings of a trial with known zero and clock: three remain for scatter."""

SLIP_TURN = np.radians(2.0)
SLIP_SHARE = 0.1

MOST_STILL = 2.0 / 3.0
"""Largest share of the frames with sticking markers in which the gel may stand still while the
object turns."""

METHOD = "incremental"
"""This method uses only sticking markers; `tracked` also uses the outline of the contact."""


class Selection(NamedTuple):
    """Conditions for using a frame.

    Attributes:
        least_stick: smallest number of sticking markers; with few markers, unnoticed slip changes
            the angle [-].
        least_turn_deg: smallest rotation of the elastomer [deg].
    """

    least_stick: int = 9
    least_turn_deg: float = 0.0


ALL_FIRM = Selection()


@dataclass(frozen=True)
class Trial:
    """Rotation of an elastomer that sticks to an object, and the object's reference angle.

    Attributes:
        name: name of the recording.
        object_name: name of the object.
        start: time of the recording's first frame [s].
        time: times of the used frames [s].
        rotation: φ of the sticking markers, lifted for `lifted_for` [rad, counter-clockwise].
        error: standard error of φ [rad].
        normal_force: normal force in the used frames [N]; NaN if unknown.
        radius: radius of the contact in the used frames [mm]; NaN if unknown.
        reference: angle of the object.
        excluded: number of unused frames, by reason.
        markers: number of the sensor's markers; 0 if unknown.
        pitch: distance between markers [mm]; NaN if unknown.
        lifted_for: softness for which the frames were lifted; None for a thick elastomer.
        displacements: of the markers in the used frames; empty without lifting.
        stick_markers: number of sticking markers, summed over the used frames; 0 if unknown.

    Examples:
        >>> from calibration import Reference, make_trials
        >>> from estimation import PivotModel, simulate_pivot
        >>> soft = PivotModel(stiffness_ratio=0.5, friction_ratio=0.3)
        >>> recording, truth = simulate_pivot(soft, angles_deg=(0.0, 10.0), frames=(30,))
        >>> error = 1e-3 + 0 * recording.time  # rad
        >>> about = {"zeroed": True, "same_clock": True, "source": "stage"}
        >>> stage = Reference(recording.time, truth.angle, error, **about)
        >>> (trial,) = make_trials(recording, stage)
        >>> ratio = trial.reference.angle[-1] / trial.rotation[-1]
        >>> print(f"the object turned {ratio:.2f} times as far as the gel")  # by 1 + k
        the object turned 1.50 times as far as the gel
    """

    name: str
    object_name: str
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
    lifted_for: LayeredSoftness | None = None
    displacements: tuple[Seen, ...] = ()
    stick_markers: int = 0


def make_trials(
    recording: Recording,
    reference: Reference,
    *,
    object_name: str = "object",
    noise: Noise | None = None,
    lifted_for: LayeredSoftness | None = None,
    selection: Selection = ALL_FIRM,
) -> list[Trial]:
    """Make the trials of a recording, one for each contact, from frames with sticking markers.

    Args:
        recording: recording of an object that turns in the grasp.
        reference: angle of the object.
        object_name: name of the object.
        noise: noise of the markers; None to estimate it from the recording.
        lifted_for: softness for which the frames are lifted before any fit. Without lifting, the
            markers of a thin elastomer seem to slip on a soft object.
        selection: conditions for using a frame.

    Raises:
        ValueError: the recording is too short to estimate its noise, no frame can be used, or the
            gel stands still while the reference turns.

    Examples:
        >>> from calibration import Reference, make_trials
        >>> from estimation import PivotModel, simulate_pivot
        >>> soft = PivotModel(stiffness_ratio=0.5, friction_ratio=0.3)
        >>> recording, truth = simulate_pivot(soft, angles_deg=(0.0, 10.0), frames=(30,))
        >>> error = 1e-3 + 0 * recording.time  # rad
        >>> about = {"zeroed": True, "same_clock": True, "source": "stage"}
        >>> stage = Reference(recording.time, truth.angle, error, **about)
        >>> (trial,) = make_trials(recording, stage)
        >>> print(f"{len(trial.time)} frames, {sum(trial.excluded.values())} excluded")
        44 frames, 0 excluded
    """
    noise, softness = noise or estimate_noise(recording), lifted_for or RIGID_OBJECT
    result = estimate_angles(recording, METHOD, noise=noise, softness=softness)
    frames = _sort_frames(recording, result, reference, selection)
    numbers, counts = _find_contacts(recording, frames, selection, reference)
    short = counts < FEWEST_POINTS
    touches = numbers[short] if not short.all() else numbers[:0]
    contacts = np.setdiff1d(numbers, touches)
    trials = []
    for number in contacts:
        own = frames.contact == number
        rows = np.flatnonzero(own & frames.usable)
        excluded = Counter(frames.reason[i] for i in np.flatnonzero(own & ~frames.usable))
        touched = int((frames.usable & np.isin(frames.contact, touches)).sum())
        if touched and not trials:
            excluded["of a touch too short to fit"] = touched
        place = f", contact {len(trials) + 1}" if len(contacts) > 1 else ""
        about = {"name": recording.name + place, "object_name": object_name, "reference": reference}
        trial = _make_trial(recording, result, rows, lifted_for, excluded=dict(excluded), **about)
        trials.append(trial)
    return trials


def _make_trial(
    recording: Recording,
    result: Result,
    rows: Int[np.ndarray, " rows"],
    lifted_for: LayeredSoftness | None,
    **about: Any,
) -> Trial:
    """The trial from some frames of a recording."""
    return Trial(
        start=float(recording.time[0]),
        time=recording.time[rows],
        **_describe_markers(recording.layout),
        lifted_for=lifted_for,
        stick_markers=int(result.stick[rows].sum()),
        **_columns(recording, result, rows, lifted_for),
        **about,
    )


class _Frames(NamedTuple):
    """Use of each frame: whether it is usable, why not, and its contact."""

    usable: Bool[np.ndarray, " frames"]
    still: Bool[np.ndarray, " frames"]
    reason: list[str]
    contact: Int[np.ndarray, " frames"]


def _sort_frames(
    recording: Recording, result: Result, reference: Reference, selection: Selection
) -> _Frames:
    """Sort frames into usable and unusable ones, with reasons, and number their contacts."""
    rotation = _elastomer_rotation(result)
    sticks = result.stick.sum(axis=1)
    apart = np.array([state == State.NO_CONTACT for state in result.state])
    unknown = np.array([state == State.UNKNOWN for state in result.state])
    firm = ~apart & ~unknown & result.answered & (sticks >= selection.least_stick)
    still = firm & stands_still(recording.time, rotation, reference)
    small = firm & ~still & (np.abs(rotation) < np.radians(selection.least_turn_deg))
    few = f"with fewer than {selection.least_stick} sticking markers"
    reason = [
        few if state in (State.STICK, State.INCIPIENT) and count < selection.least_stick
        else _REASONS.get(state, "without a known rotation of the gel")
        for state, count in zip(result.state, sticks, strict=True)
    ]  # fmt: skip
    for i in np.flatnonzero(still):
        reason[i] = "in macro slip"
    for i in np.flatnonzero(small):
        reason[i] = f"in which the elastomer turns by less than {selection.least_turn_deg:g}°"
    contact = np.cumsum(np.diff(apart.astype(int), prepend=0) < 0)
    return _Frames(firm & ~still & ~small, still, reason, contact)


def _find_contacts(
    recording: Recording, frames: _Frames, selection: Selection, reference: Reference
) -> tuple[Int[np.ndarray, " contacts"], Int[np.ndarray, " contacts"]]:
    """Numbers of the contacts with usable frames, and the number of usable frames of each.

    Raises:
        ValueError: no frame is usable, or the gel stands still while the reference turns.
    """
    still, used = np.count_nonzero(frames.still), np.count_nonzero(frames.usable)
    if still > MOST_STILL * (still + used):
        turned = np.degrees(np.nanmax(reference.angle) - np.nanmin(reference.angle))
        raise ValueError(
            f"{recording.name}: in {still} of {still + used} frames the gel stands still while the "
            f"reference turns, by {turned:.3g}° in all: it does not follow this object, its column "
            "has another unit than its name, or most of the recording is slip. Check the unit, and "
            "that recording and reference belong to one grasp and share a clock, or press harder"
        )
    if not used:
        reasons = Counter(frames.reason).items()
        shown = ", ".join(
            f"{counted(count, 'frame', 'frames')} {reason}" for reason, count in reasons
        )
        raise ValueError(
            f"{recording.name}: no frame has {selection.least_stick} sticking markers and a known "
            f"rotation ({shown}): press harder, or turn less"
        )
    return np.unique(frames.contact[frames.usable], return_counts=True)


_REASONS = {State.MACRO_SLIP: "in macro slip", State.NO_CONTACT: "without contact"}


def _elastomer_rotation(result: Result) -> Float[np.ndarray, " frames"]:
    """Rotation φ of the elastomer, without the applied softness [rad]."""
    return (result.angle + 0.5 * result.load_term) / (1.0 + result.stiffness_ratio)


def _describe_markers(layout: MarkerLayout) -> dict[str, Any]:
    """Number of the sensor's markers, and distance between neighbours."""
    points, first = layout.reference, layout.neighbours[:, 0]
    edges = np.linalg.norm(points[first] - points, axis=1)[first >= 0]
    return {
        "markers": len(points),
        "pitch": float(np.median(edges)) if len(edges) else float("nan"),
    }


def _columns(
    recording: Recording,
    result: Result,
    rows: Int[np.ndarray, " rows"],
    lifted_for: LayeredSoftness | None,
) -> dict[str, Any]:
    """Columns of a trial for the used frames."""
    layout, unknown = recording.layout, np.full(len(rows), np.nan)
    displacements = []
    for row in rows if lifted_for is not None else ():
        positions = recording.positions[row]
        moved = displacement_as_seen(layout, positions, recording.valid[row])
        planar = positions.shape[1] == 2  # without z
        risen = np.full(len(moved), np.nan) if planar else positions[:, 2] - layout.reference[:, 2]
        masks = result.stick[row], result.contact[row]
        displacements.append(Seen.of(layout.reference[:, :2], moved, risen, *masks))
    planes = zip(recording.positions[rows][..., :2], result.contact[rows], strict=True)
    error = 0.5 * (result.high - result.low) / Z95 / (1.0 + result.stiffness_ratio)
    return {
        "rotation": _elastomer_rotation(result)[rows],
        "error": error[rows],
        "normal_force": unknown if recording.force is None else -recording.force[rows, 2],
        "radius": np.array([disc_radius(plane[inside]) for plane, inside in planes]),
        "displacements": tuple(displacements),
    }


def stands_still(
    time: Float[np.ndarray, " frames"],
    rotation: Float[np.ndarray, " frames"],
    reference: Reference,
) -> Bool[np.ndarray, " frames"]:
    """Frames in which the object turns but the gel does not, so that it slips unnoticed.

    A gel that turns by less than a tenth of the object's angle would mean k > 9. This is checked
    only if both share a clock, over stretches in which the object turns by 2°.
    """
    still = np.zeros(len(time), dtype=bool)
    known = np.isfinite(reference.angle)
    if not reference.same_clock or known.sum() < 2:
        return still
    # the median of three readings, since a single wrong one is no turn
    readings = median_of_three(reference.angle[known])
    angle = np.interp(time, reference.time[known], readings, left=np.nan, right=np.nan)
    for first in range(len(time)):
        turned = np.abs(angle[first:] - angle[first])
        far = np.flatnonzero(turned >= SLIP_TURN)
        if not len(far):
            continue
        last = first + int(far[0])
        gel = rotation[first : last + 1]
        if np.isfinite(gel).any() and np.ptp(gel[np.isfinite(gel)]) < SLIP_SHARE * turned[far[0]]:
            still[first : last + 1] = True
    return still
