"""Recordings refuse what does not fit, lay out their markers, and say what is wrong with them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from estimation.frames.inspection import (
    FROZEN_STEPS,
    LiveInspector,
    disordered_times,
    inspect_recording,
)
from estimation.frames.neighbours import delaunay_neighbours, find_grid, grid_neighbours
from estimation.frames.recording import Frame, MarkerLayout, Recording, layout_markers
from estimation.tracking.observation import Observer


def grid(rows: int = 6, columns: int = 6, pitch: float = 1.0) -> np.ndarray:
    row, column = np.mgrid[:rows, :columns].reshape(2, -1)
    return np.stack([column * pitch, row * pitch, np.full(row.size, 10.0)], axis=-1)


def moving(frames: int = 12, reference: np.ndarray | None = None) -> Recording:
    """Every marker moves in every frame."""
    reference = grid() if reference is None else reference
    shift = -0.01 * np.arange(frames)[:, None, None]
    return Recording(
        layout=layout_markers(reference),
        positions=reference + shift,
        valid=np.ones((frames, len(reference)), dtype=bool),
        time=np.arange(frames) / 30,
        source_index=np.arange(frames),
    )


# --- what fits -----------------------------------------------------------------------------------


def test_iterates_over_frames_with_what_is_known():
    recording = replace(moving(3), moment=np.arange(9.0).reshape(3, 3), flaws=("", "bad", ""))
    frames = list(recording)
    assert len(frames) == len(recording) == 3
    assert [frame.moment for frame in frames] == [2.0, 5.0, 8.0]
    assert [frame.flaw for frame in frames] == ["", "bad", ""]
    assert np.isnan(next(iter(moving(1))).moment)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((12, 35, 3))}, r"`positions` has shape \(12, 35, 3\)"),
        ({"positions": np.zeros((12, 36, 2))}, "`positions`"),
        ({"positions": np.zeros((0, 36, 3))}, "at least one frame"),
        ({"positions": np.zeros((36, 3))}, "`positions`"),
        ({"valid": np.ones((11, 36), dtype=bool)}, "`valid`"),
        ({"time": np.zeros(11)}, "`time`"),
        ({"source_index": np.zeros(13, dtype=int)}, "`source_index`"),
        ({"moment": np.zeros((12, 1))}, "`moment`"),
        ({"force": np.zeros((1, 3))}, "`force`"),
        ({"forces": np.zeros((12, 35, 3))}, "`forces`"),
        ({"flaws": ("",)}, "`flaws`"),
        ({"positions": np.full((12, 36, 3), np.nan)}, "no finite position"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_refuses_what_does_not_fit(change, message):
    with pytest.raises(ValueError, match=message):
        replace(moving(), **change)


@pytest.mark.parametrize(
    ("reference", "neighbours", "shape", "message"),
    [
        (np.zeros((4, 1)), np.zeros((4, 1), dtype=int), None, "`reference`"),
        (np.full((4, 2), np.nan), np.zeros((4, 1), dtype=int), None, "not finite"),
        (np.zeros((4, 2)), np.zeros((3, 1), dtype=int), None, "a row for each of the 4"),
        (np.zeros((4, 2)), np.full((4, 1), 4), None, "−1 or the index"),
        (np.zeros((4, 2)), np.full((4, 1), -2), None, "−1 or the index"),
        (np.zeros((4, 2)), np.full((4, 1), -1), (2, 3), "do not hold 4"),
    ],
)
@pytest.mark.usefixtures("unchecked")
def test_layout_refuses_what_does_not_fit(reference, neighbours, shape, message):
    with pytest.raises(ValueError, match=message):
        MarkerLayout(reference, neighbours, shape)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", ["valid", "contact", "others"])
def test_frame_refuses_a_mask_of_another_length_or_kind(name):
    frame = Frame(np.zeros((4, 2)), 0.0, 0)
    for marks, message in (
        (np.ones(3, dtype=bool), "shape"),
        (np.array([0.0, 1.0, np.nan, 1.0]), "true or false"),
        (np.array([0, 1, 2, 3]), "true or false"),  # as markers by their number
        (["a", "b", "c", "d"], "true or false"),
    ):
        with pytest.raises(ValueError, match=f"`{name}`.*{message}"):
            replace(frame, **{name: marks})


@pytest.mark.usefixtures("unchecked")
def test_masked_positions_are_not_seen():
    hidden = np.array([[False, False], [True, True], [False, False], [False, False]])
    frame = Frame(np.ma.masked_array(np.ones((4, 2)), hidden), 0.0, 0)
    assert frame.valid.tolist() == [True, False, True, True]
    assert np.isnan(frame.positions[1]).all()
    with pytest.raises(ValueError, match="not finite"):
        layout_markers(np.ma.masked_array(np.eye(4, 2), hidden))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("marks", [[0, 1, 1, 0], [0.0, 1.0, 1.0, 0.0], [False, True, True, False]])
def test_zeros_and_ones_are_truth_values(marks):
    frame = Frame(np.zeros((4, 2)), 0.0, 0, contact=np.array(marks))
    assert frame.contact is not None
    assert frame.contact.dtype == bool
    assert frame.contact.tolist() == [False, True, True, False]


# --- topology ------------------------------------------------------------------------------------


def test_grid_neighbours_are_the_four_around():
    neighbours = grid_neighbours((3, 4))
    assert neighbours[5].tolist() == [1, 9, 4, 6]
    assert neighbours[0].tolist() == [-1, 4, -1, 1]
    assert neighbours[11].tolist() == [7, -1, 10, -1]


@given(
    rows=st.integers(2, 9),
    columns=st.integers(2, 9),
    angle=st.floats(0, 2 * np.pi),
    mirrored=st.booleans(),
    seed=st.integers(0, 2**16),
)
def test_finds_a_turned_mirrored_distorted_grid(rows, columns, angle, mirrored, seed):
    points = grid(rows, columns, 1.1)
    points[:, :2] += np.random.default_rng(seed).uniform(-0.05, 0.05, (len(points), 2))
    cos, sin = np.cos(angle), np.sin(angle)
    points[:, :2] @= np.array([[cos, sin], [-sin, cos]])
    points[:, 0] *= -1 if mirrored else 1
    assert find_grid(points) == (rows, columns)


def test_finds_no_grid_in_shuffled_or_scattered_markers():
    rng = np.random.default_rng(0)
    assert find_grid(rng.permutation(grid(16, 16))) is None
    assert find_grid(rng.uniform(0, 10, (100, 2))) is None
    assert find_grid(grid(1, 7)) is None


@given(points=hnp.arrays(float, (12, 2), elements=st.integers(0, 50).map(float), unique=True))
def test_delaunay_neighbours_are_mutual(points):
    try:
        neighbours = delaunay_neighbours(points)
    except ValueError:
        assert np.linalg.matrix_rank(points - points[0]) < 2
        return
    pairs = {(i, int(j)) for i, row in enumerate(neighbours) for j in row if j >= 0}
    assert pairs == {(j, i) for i, j in pairs}
    assert all(i != j for i, j in pairs)
    kept = layout_markers(points).reference
    np.testing.assert_array_equal(kept, points)
    assert not np.shares_memory(kept, points)  # a driver may reuse its buffer


def test_delaunay_leaves_out_edges_across_gaps():
    two_patches = np.concatenate([grid(4, 4), grid(4, 4) + np.array([20.0, 0, 0])])
    neighbours = delaunay_neighbours(two_patches)
    assert neighbours[:16].max() < 16
    assert neighbours[16:][neighbours[16:] >= 0].min() >= 16


@pytest.mark.parametrize("markers", [0, 1, 2, 7])
def test_markers_on_a_line_are_refused(markers):
    with pytest.raises(ValueError, match="not all on one line"):
        layout_markers(grid(1, markers))


def test_unknown_references_are_refused():
    with pytest.raises(ValueError, match="not finite"):
        layout_markers(np.full((4, 2), np.nan))


# --- flaws ---------------------------------------------------------------------------------------


def test_a_sound_recording_has_no_flaws():
    inspected = inspect_recording(moving())
    assert inspected.flaws == ("",) * 12
    assert inspected.notes == ()
    assert inspected.valid.all()


def test_a_single_frame_is_sound():
    assert inspect_recording(moving(1)).flaws == ("",)


def test_a_marker_that_is_not_seen_is_not_valid():
    recording = moving()
    positions, valid = recording.positions.copy(), recording.valid.copy()
    positions[3, 7, 2] = np.nan
    valid[3, 7] = False
    inspected = inspect_recording(replace(recording, positions=positions, valid=valid))
    assert np.argwhere(~inspected.valid).tolist() == [[3, 7]]
    assert inspected.flaws == ("",) * 12
    assert inspected.notes == ("1 marker was not seen at times, in 1 frame",)


def test_a_frozen_marker_is_marked_from_where_it_stops():
    positions = moving(20).positions.copy()
    positions[8:16, 5] = positions[8, 5]
    positions[2:4, 6] = positions[2, 6]  # one repeat is chance
    inspected = inspect_recording(replace(moving(20), positions=positions))
    assert np.flatnonzero(~inspected.valid[:, 5]).tolist() == list(range(8, 16))
    assert np.delete(inspected.valid, 5, axis=1).all()


def test_markers_that_rest_together_are_not_frozen():
    resting = replace(moving(20), positions=np.tile(grid(), (20, 1, 1)))
    assert inspect_recording(resting).valid.all()
    local = resting.positions.copy()  # a noise-free contact that moves a third of the pad
    local[:, :12] += 0.01 * np.arange(20)[:, None, None]
    assert inspect_recording(replace(resting, positions=local)).valid.all()


def test_a_marker_frozen_across_a_rest_is_found():
    positions = moving(20).positions.copy()
    positions[9:13] = positions[9]  # all rest
    positions[13:] -= positions[13] - positions[12] - 0.01
    positions[:, 4] = positions[0, 4]
    assert not inspect_recording(replace(moving(20), positions=positions)).valid[:, 4].any()


def test_frames_of_zeros_and_without_markers_are_flawed():
    recording = moving()
    positions, valid = recording.positions.copy(), recording.valid.copy()
    positions[4] = 0
    positions[6], valid[6] = np.nan, False
    valid[8] = False
    inspected = inspect_recording(replace(recording, positions=positions, valid=valid))
    assert inspected.flaws[4] == "all marker positions are zero"
    assert inspected.flaws[6] == "no marker was seen"
    assert inspected.flaws[8] == "no marker can be used"
    assert sum(flaw != "" for flaw in inspected.flaws) == 3
    assert not inspected.valid[[4, 6, 8]].any()
    assert "1 frame: all marker positions are zero" in inspected.notes


@pytest.mark.parametrize(
    ("time", "bad"),
    [
        ([0, 1, 2, 2, 3], [3]),
        ([0, 1, 0.5, 2, 3], [2]),
        ([0, 900, 1, 2, 3], [1]),
        ([5, 6, 7, 0, 1], [3, 4]),
        ([0, np.nan, 1, 2, 3], [1]),
        ([np.inf, 0, 1, 2, 3], [0]),
        ([1, 1, 1, 1, 1], [1, 2, 3, 4]),
    ],
)
def test_time_stamps_out_of_order_are_flawed(time, bad):
    inspected = inspect_recording(replace(moving(5), time=np.array(time, dtype=float)))
    assert [i for i, flaw in enumerate(inspected.flaws) if flaw] == bad
    assert inspected.valid.all()


@given(hnp.arrays(float, st.integers(1, 30), elements=st.integers(0, 20).map(float)))
def test_the_remaining_time_stamps_increase(time):
    bad = disordered_times(time)
    assert (np.diff(time[~bad]) > 0).all()
    # no single frame can be given back
    for frame in np.flatnonzero(bad):
        kept = ~bad
        kept[frame] = True
        assert not (np.diff(time[kept]) > 0).all()


def test_dropped_frames_are_counted():
    recording = replace(moving(4), source_index=np.array([7, 8, 12, 14]))
    inspected = inspect_recording(recording)
    assert inspected.flaws == ("",) * 4
    assert inspected.notes == (
        "4 frames were dropped at the source (2 gaps in the frame numbers, the largest step 4)",
    )
    backwards = inspect_recording(replace(moving(4), source_index=np.array([7, 8, 8, 3])))
    assert backwards.notes == ("the frame numbers do not increase in 2 places",)


@given(seed=st.integers(0, 2**16))
def test_inspecting_loses_no_frame_and_changes_nothing_twice(seed):
    rng = np.random.default_rng(seed)
    recording = moving(15)
    positions = recording.positions.copy()
    positions[rng.random(positions.shape[:2]) < 0.1] = np.nan
    positions[rng.integers(15)] = 0
    start = rng.integers(15 - FROZEN_STEPS)
    positions[start:, rng.integers(36)] = positions[start, 0]
    broken = replace(
        recording,
        positions=positions,
        valid=np.isfinite(positions).all(axis=-1),
        time=rng.permutation(15) / 30,
        source_index=rng.integers(0, 20, 15),
    )
    once = inspect_recording(broken)
    twice = inspect_recording(once)
    assert len(once) == len(once.flaws) == 15
    assert twice.flaws == once.flaws
    assert twice.notes == once.notes
    np.testing.assert_array_equal(twice.valid, once.valid)
    np.testing.assert_array_equal(once.positions, broken.positions)


def test_a_camera_that_hangs_is_told():
    recording = moving(12)
    positions = recording.positions.copy()
    positions[6:9] = positions[5]
    inspected = inspect_recording(replace(recording, positions=positions))
    assert [i for i, flaw in enumerate(inspected.flaws) if flaw] == [6, 7, 8]
    assert "3 frames: repeats the frame before" in inspected.notes
    positions[:9] = recording.layout.reference  # some sensors report just that while unloaded
    assert not any(inspect_recording(replace(recording, positions=positions)).flaws)


@pytest.mark.parametrize(("hide", "repeats"), [(6, True), (5, False)])
def test_a_repeated_frame_may_hide_markers_but_shows_no_new_one(hide, repeats):
    recording = moving(7)
    positions = recording.positions.copy()
    positions[6] = positions[5]
    positions[hide, 3] = np.nan
    recording = replace(recording, positions=positions, valid=np.isfinite(positions[..., 0]))
    live, reference = LiveInspector(), recording.layout.reference
    observer = Observer(recording.layout, noisy=True)
    for flaws in (
        inspect_recording(recording).flaws,
        [live.inspect(frame, reference).flaw for frame in recording],
        [observer.observe(frame).flaw for frame in recording],
    ):
        assert list(flaws) == [""] * 6 + ["repeats the frame before" if repeats else ""]


@pytest.mark.parametrize("time", [np.ones(12), np.arange(12.0)[::-1]])
def test_a_clock_that_never_advances_is_refused(time):
    with pytest.raises(ValueError, match="clock stands still or runs backwards"):
        inspect_recording(replace(moving(12), time=time))


def test_frames_mostly_out_of_order_are_a_warning():
    recording = moving(12)
    order = np.random.default_rng(0).permutation(12)
    (warning,) = inspect_recording(recording.take(order)).warnings
    assert warning.endswith("are out of order and are not used: sort them by time")
    swapped = np.r_[:5, 6, 5, 7:12]
    assert not inspect_recording(recording.take(swapped)).warnings


@pytest.mark.parametrize(
    ("scale", "hint"), [(1e-3, "0.001 mm apart"), (1e3, "1e\\+03 mm apart"), (1.0, "")]
)
def test_lengths_in_another_unit_are_a_warning(scale, hint):
    warnings = inspect_recording(moving(reference=scale * grid())).warnings
    found = [note for note in warnings if "apart" in note]
    assert len(found) == bool(hint)
    assert not hint or hint.replace("\\", "") in found[0]


def test_values_that_cannot_have_been_measured_count_as_missing():
    recording = moving()
    positions, imprint = recording.positions.copy(), np.zeros((len(recording), 2))
    positions[2, 3, 0], imprint[1] = 1e300, np.inf
    found = inspect_recording(replace(recording, positions=positions, imprint=imprint))
    assert np.isnan(found.positions[2, 3, 0])
    assert found.imprint is not None
    assert np.isnan(found.imprint[1]).all()
    assert not found.valid[2, 3]
    assert found.valid.sum() == found.valid.size - 1
    assert "2 values of `imprint` are 1e+09 or more: left out" in found.notes


def test_an_axis_into_the_pad_is_a_warning():
    def warnings(sign: float):
        recording = moving()
        press = recording.positions.copy()
        press[6:, :20, 2] = 10.0 + sign * 0.5 * np.arange(1, 7)[:, None] / 6
        return " ".join(inspect_recording(replace(recording, positions=press)).warnings)

    assert "does z point out of the elastomer? If not, change the sign of z, and" in warnings(1.0)
    assert not warnings(-1.0)


def test_coarsely_rounded_positions_are_a_warning():
    recording = moving()
    for step, warned in ((0.01, False), (0.1, True)):  # of the markers' distance
        rounded = replace(recording, positions=step * np.round(recording.positions / step))
        warnings = inspect_recording(rounded).warnings
        assert any(f"rounded to {step:.2g} mm" in text for text in warnings) == warned


def test_forces_on_the_object_are_a_warning():
    recording = moving()
    force = np.zeros((len(recording), 3))
    force[:, 2] = np.linspace(0.1, 5.0, len(recording))
    (warning,) = inspect_recording(replace(recording, force=force)).warnings
    assert warning.startswith("the normal force Fz is above 0, up to 5 N")
    for pressing in (-force, 0.03 * force):  # the second is the drift of a sensor at rest
        assert not inspect_recording(replace(recording, force=pressing)).warnings


def test_times_in_another_unit_are_a_warning():
    recording = moving()
    assert not inspect_recording(recording).warnings
    (warning,) = inspect_recording(replace(recording, time=1e3 * recording.time)).warnings
    assert warning.endswith("are the time stamps in s?")


def test_a_frame_refuses_valid_markers_without_a_position():
    positions = grid()
    positions[3] = np.nan
    with pytest.raises(ValueError, match="no finite position"):
        Frame(positions, 0.0, 0, np.ones(len(positions), dtype=bool))


def test_a_frame_takes_the_markers_with_a_position_as_valid():
    positions = grid()
    positions[3, 1] = np.nan
    frame = Frame(positions, 0.0, 0)
    assert np.flatnonzero(~frame.valid).tolist() == [3]
