"""What the methods are measured on, and what the right answer is."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.outline import follow_outline
from estimation.frames import datasets
from estimation.frames.extras import MissingExtraError
from estimation.frames.recording import Recording
from estimation.softness import ScalarSoftness
from estimation.sources import find_recordings, read_recording
from estimation.virtual.recording import Camera, Timing, Truth, simulate_pivot
from papers.leaderboard import settings
from papers.limits import MEAN_ABSOLUTE, angle_limit
from papers.virtual_pivots.elongated import simulate_elongated


class Case(NamedTuple):
    """A recording with a reference angle.

    Attributes:
        name: of the recording, as it is exported.
        recording: the recording.
        reference: the object's angle [rad]; NaN where unknown.
        parts: frames that are scored, by the name of the row they are scored in.
        softness: what the methods are told of the object.
        relative: whether the reference is known up to a constant only.
        limit: mean absolute error of the angle at the Cramér–Rao bound of one frame, from the
            markers that do not slip [rad]; None where the truth is not known.
    """

    name: str
    recording: Recording
    reference: Float[np.ndarray, " frames"]
    parts: Mapping[str, Bool[np.ndarray, " frames"]]
    softness: ScalarSoftness = ScalarSoftness()
    relative: bool = False
    limit: Float[np.ndarray, " frames"] | None = None


def virtual_case(condition: str, draw: int) -> Case:
    """One draw of a virtual pivot; its frames after macro slip are scored apart."""
    told = settings.CONDITIONS[condition]
    recording, truth = simulate_pivot(
        told.model, seed=draw, timing=Timing(dropped=told.dropped), **told.path
    )
    turned = np.abs(np.diff(np.nan_to_num(truth.angle), prepend=0.0)).cumsum()
    recording = _spoil(recording, turned / turned[-1], told, draw)
    return _case(condition, draw, recording, truth, told.model.noise)


def elongated_case(draw: int) -> Case:
    """One draw of the elongated contact, which has an outline to follow in macro slip."""
    friction, resolution = settings.ELONGATED
    recording, truth = simulate_elongated(friction, draw, resolution)
    return _case("elongated", draw, recording, truth, Camera().noise[0])


def _case(condition: str, draw: int, recording: Recording, truth: Truth, noise: float) -> Case:
    name = f"{condition}-{draw}"
    known = np.isfinite(truth.angle)
    slipped = np.maximum.accumulate(truth.macro_slip)
    parts = {condition: known & ~slipped}
    if slipped.any():
        parts[f"{condition}, after macro slip"] = known & slipped
    seen = truth.sticking & recording.valid
    points = recording.layout.reference[:, :2]
    limit = [angle_limit(points, frame, noise) for frame in seen]
    return Case(
        name=name,
        recording=replace(recording, name=name),
        reference=truth.angle,
        parts=parts,
        softness=ScalarSoftness(stiffness_ratio=truth.stiffness_ratio),
        limit=MEAN_ABSOLUTE * (1.0 + truth.stiffness_ratio) * np.array(limit),
    )


def _spoil(
    recording: Recording,
    progress: Float[np.ndarray, " frames"],
    told: settings.Condition,
    draw: int,
) -> Recording:
    """The recording with its pad shifted and some markers not seen."""
    rng = np.random.default_rng((draw, 1))
    valid = rng.random(recording.valid.shape) >= told.missing
    moved = recording.positions + progress[:, None, None] * np.array([*told.shift_mm, 0.0])
    positions = np.where(valid[..., None], moved, np.nan)
    return replace(recording, positions=positions, valid=valid)


def real_cases(say: Callable[[str], None] = lambda line: None) -> list[Case]:
    """The published recordings that have been fetched; reference is the contact's outline.

    In clips it is the object's imprint. It is no truth: it is an angle of the object that does not
    come from the markers' twist. Methods that follow the outline themselves (`castano`; ours after
    macro slip) agree with it for that. Recordings without a frame whose outline has a direction are
    left out, and so are videos where the extra `video` is not installed.

    Args:
        say: told, in a line, which recording is left out for want of the extra.
    """
    cases = []
    for name in settings.REAL:
        folder = datasets.find(name)
        for path in find_recordings(folder) if folder else ():
            try:
                recording = read_recording(path)
            except MissingExtraError as error:
                say(f"{name} left out: {error}")
                continue
            reference = follow_outline(recording).angle
            known = np.isfinite(reference)
            if known.any():
                row = f"{name}/{recording.name}"
                cases.append(Case(row, recording, reference, {row: known}, relative=True))
    return cases
