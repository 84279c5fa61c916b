"""Noise is recovered from markers that also move, dome included."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from estimation.frames.noise import Noise, estimate_noise
from estimation.frames.recording import Recording, layout_markers
from tests.cases import lift

FRAMES = 60


def pad(scatter: float = 0.0) -> np.ndarray:
    """20×20 markers at 1 mm on a dome, optionally scattered."""
    row, column = np.mgrid[:20, :20].reshape(2, -1) - 9.5
    x, y = -1.05 * column, -1.05 * row
    x, y = np.stack([x, y]) + np.random.default_rng(5).normal(0, scatter, (2, 400))
    return np.stack([x, y, 11 - (x**2 + y**2) / 60], axis=-1)


def noisy_recording(
    *,
    smoothing: int = 3,
    sigma: float = 1e-3,
    drop: float = 0.0,
    scatter: float = 0.0,
    seed: int = 0,
) -> Recording:
    """A press of 1 mm with a twist of 15° and back, noise being a running mean of white noise."""
    rng = np.random.default_rng(seed)
    reference = pad(scatter)
    phase = np.sin(np.pi * np.arange(FRAMES) / FRAMES)[:, None]
    inside = np.exp(-(reference[:, 0] ** 2 + reference[:, 1] ** 2) / 50)
    angle = np.radians(15) * phase * inside
    x, y = reference[:, 0], reference[:, 1]
    moved = np.stack(
        [
            np.cos(angle) * x - np.sin(angle) * y,
            np.sin(angle) * x + np.cos(angle) * y,
            reference[:, 2] - phase * inside,
        ],
        axis=-1,
    )
    white = rng.normal(0, 1, (FRAMES + smoothing - 1, 400, 3))
    running = sum(white[i : i + FRAMES] for i in range(smoothing)) / np.sqrt(smoothing)
    kept = rng.random(FRAMES) >= drop
    return Recording(
        layout=layout_markers(reference),
        positions=(moved + running * sigma * np.array([1, 1, 3.5]))[kept],
        valid=np.ones((kept.sum(), 400), dtype=bool),
        time=np.flatnonzero(kept) / 30,
        source_index=np.flatnonzero(kept),
    )


@pytest.mark.parametrize("drop", [0.0, 0.3])
@pytest.mark.parametrize("scatter", [0.0, 0.1])
@pytest.mark.parametrize("sigma", [1e-3, 1e-2])
def test_recovers_correlated_noise_of_moving_markers(drop, scatter, sigma):
    noise = estimate_noise(noisy_recording(drop=drop, scatter=scatter, sigma=sigma))
    # the brief's bound; thousands of residuals make the statistical error about 1 %
    assert noise.in_plane == pytest.approx(sigma, rel=0.10)
    assert noise.normal == pytest.approx(3.5 * sigma, rel=0.10)
    # a running mean of three has ρ = 2/3, 1/3; variances good to 5 % make them good to about 0.05
    assert noise.correlation == pytest.approx((2 / 3, 1 / 3), abs=0.08)
    assert 0 < noise.frames <= FRAMES


def test_white_noise_is_found_uncorrelated():
    noise = estimate_noise(noisy_recording(smoothing=1))
    assert noise.in_plane == pytest.approx(1e-3, rel=0.10)
    assert noise.correlation == pytest.approx((0, 0), abs=0.08)


@pytest.mark.parametrize("smoothing", [1, 3])
def test_noise_is_correlated_over_the_frames_of_its_smoothing(smoothing):
    noise = estimate_noise(noisy_recording(smoothing=smoothing))
    assert noise.correlated == pytest.approx(smoothing, abs=0.3)


def test_motion_is_not_correlation_of_the_noise():
    """Markers that slip move unlike their surroundings, more over three frames than over one."""
    recording, rng = noisy_recording(smoothing=1), np.random.default_rng(1)
    steps = rng.normal(scale=4e-4, size=recording.positions.shape)
    recording = replace(recording, positions=recording.positions + np.cumsum(steps, axis=0))
    # the motion's second differences have 0.32 of the noise's variance three frames apart
    assert estimate_noise(recording).correlated < 1.25


def test_noise_of_unknown_correlation_counts_as_smoothed():
    assert Noise.from_std(1e-3).correlated == 3.0


@pytest.mark.parametrize("correlation", [0.9, 0.99])
@pytest.mark.parametrize("press", [0.0, 1.0])
def test_noise_that_changes_slowly_shows_while_the_pad_is_unloaded(correlation, press):
    layout, rng = layout_markers(pad()), np.random.default_rng(0)
    steps = rng.normal(size=(FRAMES, 400, 3)) * [1.0, 1.0, 3.5]
    steps[1:] *= np.sqrt(1.0 - correlation**2)
    slow = scipy.signal.lfilter([1.0], [1.0, -correlation], steps, axis=0)
    depth = press * np.clip(np.arange(FRAMES) / 10.0 - 1.0, 0.0, 1.0)[:, None]
    r = np.linalg.norm(layout.reference[:, :2], axis=1)
    pressed = np.stack([0 * r, 0 * r, -1.0 / (1.0 + (r / 3.0) ** 4)], axis=-1)
    recording = replace(noisy_recording(), layout=layout, positions=layout.reference + 1e-2 * slow)
    recording = replace(recording, positions=recording.positions + depth[..., None] * pressed)
    noise = estimate_noise(recording)
    assert noise.in_plane == pytest.approx(1e-2, rel=0.15)  # all frames nearly alike
    assert noise.normal == pytest.approx(3.5e-2, rel=0.15)


def test_is_not_misled_by_lost_markers_jumps_and_frames_without_noise():
    clean = noisy_recording()
    positions, valid = clean.positions.copy(), clean.valid.copy()
    positions[:, ::40] = np.nan
    valid[:, ::40] = False
    positions[20] += 0.5 * np.random.default_rng(1).normal(size=positions[20].shape)
    positions[:10] = clean.layout.reference
    noise = estimate_noise(
        Recording(clean.layout, positions, valid, clean.time, clean.source_index)
    )
    # 3 of the 44 triples hold the jump: half of the residuals is then 0.537 of the good ones,
    # whose quantile lies 9 % higher; 3 % for chance
    assert noise.in_plane == pytest.approx(1.09e-3, rel=0.03)
    assert noise.frames <= FRAMES - 10


def test_markers_that_come_and_go_do_not_hide_the_noise():
    # one in five is missing in each frame, and a third throughout: no neighbourhood is complete
    clean = noisy_recording()
    rng = np.random.default_rng(4)
    valid = clean.valid & (rng.random(clean.valid.shape) > 0.2) & (np.arange(400) % 3 > 0)
    positions = np.where(valid[..., None], clean.positions, np.nan)
    noise = estimate_noise(
        Recording(clean.layout, positions, valid, clean.time, clean.source_index)
    )
    assert noise.in_plane == pytest.approx(1e-3, rel=0.06)


def test_every_second_frame_still_gives_the_noise_but_not_its_neighbours_correlation():
    full = noisy_recording()
    half = Recording(
        full.layout, full.positions[::2], full.valid[::2], full.time[::2], full.source_index[::2]
    )
    noise = estimate_noise(half)
    assert noise.in_plane == pytest.approx(1e-3, rel=0.10)
    assert np.isnan(noise.correlation[0])
    assert noise.correlation[1] == pytest.approx(1 / 3, abs=0.08)


def test_two_dimensions_have_no_normal_noise():
    full = noisy_recording()
    flat = Recording(
        layout_markers(full.layout.reference[:, :2].copy()),
        full.positions[..., :2],
        full.valid,
        full.time,
        full.source_index,
    )
    noise = estimate_noise(flat)
    assert noise.in_plane == pytest.approx(1e-3, rel=0.10)
    assert np.isnan(noise.normal)


def test_too_few_frames_say_what_to_do():
    full = noisy_recording()
    short = Recording(
        full.layout, full.positions[:6], full.valid[:6], full.time[:6], full.source_index[:6]
    )
    with pytest.raises(ValueError, match=r"from 6 frames.*give the noise, or record longer"):
        estimate_noise(short)


def test_markers_that_hardly_move_keep_their_rounding_error():
    step, sigma = 1e-2, 1e-3  # mm; the noise seldom changes the rounded value
    rng = np.random.default_rng(0)
    moved = 1e-4 * np.arange(FRAMES)[:, None, None] + pad(0.1)
    positions = moved + sigma * rng.normal(size=moved.shape)
    still = replace(noisy_recording(), layout=layout_markers(pad(0.1)), positions=positions)
    assert estimate_noise(still).in_plane == pytest.approx(sigma, rel=0.1)
    rounded = replace(still, positions=step * np.round(positions / step))
    error = np.std(rounded.positions - moved)
    assert estimate_noise(rounded).in_plane == pytest.approx(error, rel=0.1)


def test_positions_that_rounding_holds_still_have_its_error():
    recording = lift(np.linspace(0.0, 1.0, 40), noise_mm=1e-3)
    step = 0.1  # mm: most second differences of the rounded positions are 0
    rounded = replace(recording, positions=step * np.round(recording.positions / step))
    assert estimate_noise(rounded).in_plane == pytest.approx(step / np.sqrt(12.0))


def test_too_few_markers_say_what_to_do():
    few = np.random.default_rng(0).uniform(0, 5, (12, 2))
    recording = Recording(
        layout_markers(few),
        np.tile(few, (40, 1, 1)),
        np.ones((40, 12), dtype=bool),
        np.arange(40.0),
        np.arange(40),
    )
    with pytest.raises(ValueError, match=r"12 markers.*give the noise"):
        estimate_noise(recording)


def test_positions_without_scatter_have_no_noise_to_tell():
    still = lift(np.zeros(40), noise_mm=0.0)
    with pytest.raises(ValueError, match="do not scatter"):
        estimate_noise(still)
