"""Cases of the virtual tier: recordings with exact truth, drawn from a seed."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np
from jaxtyping import Int

from estimation.frames.recording import Recording
from estimation.sources import read_recording
from estimation.virtual.clip import VirtualClip, write_pictures
from estimation.virtual.contact import simulate_recording
from estimation.virtual.recording import (
    Camera,
    PivotModel,
    Timing,
    lay_out_markers,
    simulate_pivot,
)
from estimation.virtual.recording import Truth as PivotTruth
from papers.leaderboard import settings
from papers.leaderboard.cases import SLIDING, Case, Truth, count_frames
from papers.marker_images.scenes import draw_scene
from papers.virtual_pivots.elongated import solve_pivot
from papers.virtual_pivots.settings import FINE
from papers.virtual_pivots.solved import place_at_random

COMPLETE = Timing(dropped=0.0)
"""Timing without lost frames: `keep_frames` later drops a fixed number of them."""


def generator(case: Case, seed: int) -> np.random.Generator:
    """The random generator of a case."""
    return np.random.default_rng((seed, crc32(case.name.encode())))


@cache
def simulate(case: Case, seed: int) -> tuple[Recording, Truth]:
    """A virtual pivot, by closed forms or solved on a grid."""
    if case.group == "elongated":
        return _simulate_elongated(case, generator(case, seed))
    return _simulate_pivot(case, settings.CONDITIONS[case.group], generator(case, seed))


@cache
def make_clip(case: Case, seed: int) -> tuple[VirtualClip, Truth]:
    """A rendered clip, whose pictures are drawn only when needed."""
    draw = int(generator(case, seed).integers(2**31))
    clip = VirtualClip(draw_scene(settings.RENDERED, draw))
    return clip, Truth(clip.truth.angle, {case.group: count_frames(clip.truth.holding)})


def read_clip(clip: VirtualClip) -> Recording:
    """The recording of a rendered clip, its markers detected as in any folder of pictures."""
    with TemporaryDirectory() as folder:
        write_pictures(clip, Path(folder))
        return read_recording(Path(folder))


def _simulate_pivot(
    case: Case, condition: settings.Condition, rng: np.random.Generator
) -> tuple[Recording, Truth]:
    model = PivotModel(**condition.model)
    if condition.laid_at_random:
        model = place_at_random(model, rng)
    turn = rng.uniform(0.7, 1.0) * rng.choice([-1.0, 1.0])
    recording, truth = simulate_pivot(
        model,
        angles_deg=(turn * np.array(condition.path["corners_deg"])).tolist(),
        frames=condition.path["frames"],
        unloaded=settings.UNLOADED,
        pressing=settings.PRESSING,
        timing=COMPLETE,
        seed=int(rng.integers(2**31)),
    )
    turned = np.abs(np.diff(np.nan_to_num(truth.angle), prepend=0.0)).cumsum()
    shift = (turned / turned[-1])[:, None, None] * np.array([*condition.shift_mm, 0.0])
    valid = rng.random(recording.valid.shape) >= condition.missing
    positions = np.where(valid[..., None], recording.positions + shift, np.nan)
    observed = replace(recording, positions=positions, valid=valid)
    kept = keep_frames(len(recording), case.frames, rng)
    return observed.take(kept), _judge(case, truth.take(kept))


def _simulate_elongated(case: Case, rng: np.random.Generator) -> tuple[Recording, Truth]:
    model = place_at_random(PivotModel(), rng)
    path = solve_pivot(settings.ELONGATED_FRICTION, FINE)
    camera = Camera(timing=COMPLETE, seed=int(rng.integers(2**31)))
    recording, truth = simulate_recording(path, lay_out_markers(model), camera)
    kept = keep_frames(len(recording), case.frames, rng)
    recording, right = recording.take(kept), _judge(case, truth.take(kept))
    return mirror(recording, right) if rng.random() < 0.5 else (recording, right)


def keep_frames(whole: int, kept: int, rng: np.random.Generator) -> Int[np.ndarray, " kept"]:
    """Random indices of `kept` out of `whole` frames, sorted; the first frame is always kept."""
    return np.sort(np.append(0, 1 + rng.choice(whole - 1, kept - 1, replace=False)))


def mirror(recording: Recording, truth: Truth) -> tuple[Recording, Truth]:
    """The recording and truth seen in a mirror: y and every angle change sign."""
    y, z = np.array([1.0, -1.0, 1.0]), np.array([-1.0, 1.0, -1.0])
    mirrored = replace(
        recording,
        layout=replace(recording.layout, reference=recording.layout.reference * y),
        positions=recording.positions * y,
        force=None if recording.force is None else recording.force * y,
        moment=None if recording.moment is None else recording.moment * z,
    )
    return mirrored, truth._replace(angle=-truth.angle)


def _judge(case: Case, truth: PivotTruth) -> Truth:
    """The truth of a case: frames count while markers stick; of elongated contacts also after."""
    counts = {case.group: count_frames(truth.sticking_now.sum(axis=1))}
    if case.group == "elongated":
        slid = np.logical_or.accumulate(truth.macro_slip)
        counts[SLIDING] = np.isfinite(truth.angle) & slid
    return Truth(truth.angle, counts, softness=truth.stiffness_ratio)
