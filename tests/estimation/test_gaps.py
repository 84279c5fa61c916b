from dataclasses import replace

import numpy as np
import pytest

from estimation.frames.noise import Noise, estimate_noise
from estimation.frames.recording import Frame, layout_markers
from estimation.tracking.gaps import GapFiller
from estimation.tracking.tracker import Tracker, estimate_angles
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot
from tests.cases import in_plane, slow_case

EXACT = Timing(dropped=0.0, jitter=0.0)
NOISE = Noise.from_std(1e-3)


@pytest.fixture(scope="module")
def pivot():
    model = PivotModel(friction_ratio=0.2, grid_angle=0.4)
    legs = {"angles_deg": (0.0, 12.0, 2.0), "frames": (30, 20)}
    return simulate_pivot(model, timing=EXACT, noise_window=1, seed=1, **legs)


def hide(recording, share, seed=0):
    """The recording without a share of the markers in each frame, at random."""
    gone = np.random.default_rng(seed).random(recording.valid.shape) < share
    positions = np.where(gone[..., None], np.nan, recording.positions)
    return replace(recording, positions=positions, valid=~gone), gone


def misread(recording, share, mm, seed=0, mm_z=0.0):
    """The recording with a share of the markers in each frame moved in the plane and along z."""
    rng = np.random.default_rng(seed)
    wrong = rng.random(recording.valid.shape) < share
    way = rng.uniform(0.0, 2.0 * np.pi, wrong.shape)
    off = np.stack([mm * np.cos(way), mm * np.sin(way), np.full_like(way, mm_z)], axis=-1)
    return replace(recording, positions=recording.positions + off * wrong[..., None]), wrong


def test_hidden_markers_follow_those_around_them(pivot):
    recording, _ = pivot
    flickering, gone = hide(recording, 0.15)
    filler = GapFiller(recording.layout)
    filled = np.array([filler.fill(frame).positions for frame in flickering])
    off = (filled - recording.positions)[gone][..., :2]
    assert np.isfinite(off).mean() > 0.95  # but for the first frame
    assert np.nanstd(off) < 3e-3  # mm; the noise of both is 1.4 µm


def test_markers_hidden_for_long_stay_hidden(pivot):
    recording, _ = pivot
    filler = GapFiller(recording.layout)
    visible = []
    for frame in recording.take(np.arange(20)):
        valid = frame.valid.copy()
        valid[210] = frame.source_index < 5
        positions = np.where(valid[:, None], frame.positions, np.nan)
        visible.append(filler.fill(replace(frame, positions=positions, valid=valid)).valid[210])
    assert visible == [True] * (5 + GapFiller.longest) + [False] * (15 - GapFiller.longest)


@pytest.mark.parametrize("view", [lambda recording: recording, in_plane])
@pytest.mark.parametrize("mm", [0.2, 0.08])
def test_only_misread_markers_stand_out(pivot, mm, view):
    recording, _ = pivot
    spoilt, wrong = misread(recording, 0.02, mm)
    wrong_ones = view(spoilt)
    for case, truth in ((view(recording), np.zeros_like(wrong)), (wrong_ones, wrong)):
        filler = GapFiller(case.layout)
        filled = np.array([filler.fill(frame).positions for frame in case])
        changed = (filled != case.positions).any(axis=2)
        assert (changed & ~truth).mean() < 1e-3
        assert (changed & truth).sum() >= 0.95 * truth.sum()
    assert estimate_noise(wrong_ones).in_plane == pytest.approx(1e-3, rel=0.25)


def test_deviations_in_the_plane_and_along_z_count_together(pivot):
    recording, _ = pivot
    noise = np.array([0.01, 0.01, 0.035])  # mm
    rng = np.random.default_rng(2)
    noisy = recording.positions + noise * rng.normal(size=recording.positions.shape)
    case, wrong = misread(replace(recording, positions=noisy), 0.02, 0.095, mm_z=0.2)
    filler = GapFiller(recording.layout)
    changed = np.array([(filler.fill(f).positions != f.positions).any(axis=1) for f in case])
    assert (changed & wrong).sum() >= 0.7 * wrong.sum()
    assert (changed & ~wrong).mean() < 1e-3


def test_misread_neighbours_do_not_hide_each_other(pivot):
    recording, _ = pivot
    spoilt, wrong = misread(recording, 0.05, 1.5)
    filler = GapFiller(recording.layout)
    filled = np.array([filler.fill(frame).positions for frame in spoilt])
    off = np.linalg.norm(filled - recording.positions, axis=2)
    assert (off > 0.3).sum() <= 1e-3 * wrong.sum()  # mm


def test_swapped_markers_are_left_out_as_long_as_they_are_swapped(pivot):
    recording, _ = pivot
    for case in (recording, in_plane(recording)):
        positions = case.positions.copy()
        positions[10:25, [210, 211]] = positions[10:25, [211, 210]]
        filler = GapFiller(case.layout)
        filled = np.array(
            [filler.fill(frame).positions for frame in replace(case, positions=positions)]
        )
        off = np.linalg.norm(filled - case.positions, axis=2)[:, [210, 211]]
        assert np.isnan(off[10 + GapFiller.longest : 25]).all()
        assert np.nanmax(off) < 0.1  # mm; where the markers around them follow the gel
        np.testing.assert_array_equal(off[26:], 0.0)


def test_markers_that_lie_off_their_place_from_the_start_are_left_out(pivot):
    recording, truth = pivot
    positions = recording.positions.copy()
    off = np.array([209, 231])  # under the object
    positions[:, off, :2] += [[0.08, 0.06], [-0.09, 0.05]]
    case = replace(recording, positions=positions)
    filler = GapFiller(recording.layout)
    *_, last = (filler.fill(frame).valid for frame in case)
    np.testing.assert_array_equal(np.flatnonzero(~last), off)
    result = estimate_angles(case, noise=NOISE)
    loaded = truth.contact.sum(axis=1) > 20
    error = np.degrees(result.angle - truth.angle)[loaded]
    assert np.isfinite(error).all()
    assert np.abs(error).max() < 0.2


def test_a_corner_in_the_first_frames_is_no_marker_off_its_place(pivot):
    recording, _ = pivot
    loaded = recording.take(np.arange(20, len(recording)))
    positions = loaded.positions.copy()
    positions[:, 210, 2] -= 0.2  # as under a sharp corner
    filler = GapFiller(recording.layout)
    *_, last = (filler.fill(frame) for frame in replace(loaded, positions=positions))
    assert last.valid.all()


def test_a_marker_that_moves_away_step_by_step_is_read(pivot):
    recording, _ = pivot
    positions = recording.positions.copy()
    positions[:, 210, 2] += np.linspace(0.0, 0.2, len(positions))  # as beside a sharp corner
    filler = GapFiller(recording.layout)
    case = replace(recording, positions=positions)
    filled = np.array([filler.fill(frame).positions for frame in case])
    np.testing.assert_array_equal(filled[:, 210], positions[:, 210])


@pytest.mark.parametrize("spoil", [lambda r: hide(r, 0.15)[0], lambda r: misread(r, 0.02, 0.2)[0]])
def test_flickering_and_misread_markers_cost_no_angle(pivot, spoil):
    recording, truth = pivot
    result = estimate_angles(spoil(recording), noise=NOISE)
    loaded = truth.contact.sum(axis=1) > 20
    error = np.degrees(result.angle - truth.angle)[loaded]
    assert np.isfinite(error).all()
    assert np.abs(error).max() < 0.2


@pytest.mark.parametrize(
    ("mm", "touched"), [(0.2, True), (1.0, False), slow_case(0.2, False), slow_case(1.0, True)]
)
def test_misread_markers_in_the_plane_cost_no_angle(pivot, mm, touched):
    recording, truth = pivot
    spoilt, _ = misread(recording, 0.05, mm)
    contact = truth.contact if touched else None
    clean, spoilt = (replace(in_plane(case), contact=contact) for case in (recording, spoilt))
    known = np.isfinite(estimate_angles(clean, noise=NOISE).angle)
    angle = estimate_angles(spoilt, noise=NOISE).angle
    error = np.degrees(angle - truth.angle)[known]
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmax(np.abs(error)) < 0.2


def test_pictures_leave_out_what_they_misread_themselves(pivot):
    recording, truth = pivot
    spoilt = in_plane(misread(recording, 0.05, 1.0)[0])
    filler = GapFiller(spoilt.layout)
    for frame in replace(spoilt, contact=truth.contact, pictured=True):
        assert filler.fill(frame) is frame


def test_gel_at_rest_around_the_object_is_not_taken_for_it():
    model = PivotModel(friction_ratio=0.2, grid_angle=0.4, noise=1e-2)
    legs = {"angles_deg": (0.0, 14.0, -6.0), "frames": (40, 60)}
    recording, truth = simulate_pivot(model, timing=EXACT, noise_window=1, seed=4, **legs)
    result = estimate_angles(in_plane(recording), noise=Noise.from_std(1e-2))
    outside = np.fmax(result.low - truth.angle, truth.angle - result.high)
    assert np.isfinite(outside).sum() > 40
    assert np.degrees(np.nanmax(outside)) < 0.1


def test_frame_that_repeats_the_last_one_has_no_angle(pivot):
    recording, _ = pivot
    rows = np.repeat(np.arange(len(recording)), np.where(np.arange(len(recording)) % 4, 1, 2))
    repeated = np.diff(rows, prepend=-1) == 0
    doubled = replace(recording.take(rows), time=np.arange(len(rows)) / 40.0)
    tracker = Tracker(recording.layout, noise=NOISE)
    answers = [tracker.update(frame) for frame in doubled]
    plain = estimate_angles(recording, noise=NOISE)
    reasons = {answer.reason for answer, again in zip(answers, repeated, strict=True) if again}
    assert reasons == {"repeats the frame before"}
    angles = [answer.angle for answer, again in zip(answers, repeated, strict=True) if not again]
    np.testing.assert_array_equal(angles, plain.angle)


def test_strained_gel_in_the_first_frame_is_not_misread():
    """On a pad of coarse dots that starts loaded, a small object strains the gel around one dot."""
    rows, columns = np.mgrid[:9, :9].astype(float)
    layout = layout_markers(np.stack([columns.ravel(), rows.ravel()], axis=1))
    moved = 0.3 * np.exp(-((columns - 4.0) ** 2) - (rows - 4.0) ** 2).ravel()
    positions = layout.reference + moved[:, None] * [1.0, 0.0]
    filler = GapFiller(layout)
    for number in range(5):
        assert filler.fill(Frame(positions, float(number), number)).valid.all()
