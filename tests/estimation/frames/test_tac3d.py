"""Tac3D folders are read as they are, and refused with a reason where they cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from estimation.frames.archive import write_archive
from estimation.frames.noise import estimate_noise
from estimation.frames.tac3d import find_reference, read_tac3d
from estimation.output.result_folder import expect_apart
from estimation.sources import find_recordings, read_recording
from tests.cases import find_published

FRAMES = 14
LOADED = slice(4, 10)


def pad(rows: int) -> np.ndarray:
    """Unloaded markers, rows along −y and columns along −x, on a dome."""
    row, column = np.mgrid[:rows, :rows].reshape(2, -1) - (rows - 1) / 2
    return np.stack([-column, -1.05 * row, 11 - (column**2 + row**2) / 60], axis=-1)


def press(rows: int = 4) -> dict[str, np.ndarray]:
    """Arrays as the sensor writes them: unloaded, pressed, unloaded again."""
    markers = rows * rows
    measured = np.random.default_rng(3).normal(0, 1e-3, (FRAMES, markers, 3))
    measured[LOADED, :, 2] -= 0.4
    displacements = np.zeros_like(measured)
    displacements[LOADED] = measured[LOADED]
    return {
        "3D_Positions": pad(rows) + measured,
        "3D_Displacements": displacements,
        "3D_Forces": np.ones((FRAMES, markers, 3)),
        "3D_ResultantForce": np.full((FRAMES, 1, 3), -2.0),
        "3D_ResultantMoment": np.arange(3.0 * FRAMES).reshape(FRAMES, 1, 3),
        "index": np.arange(100, 100 + FRAMES),
        "sendTimestamp": 68.0 + np.arange(FRAMES) / 30,
    }


def write(folder, arrays, **changes):
    """A folder of the arrays, changed, or left out where None."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, array in (arrays | changes).items():
        if array is not None:
            np.save(folder / f"{name}.npy", array, allow_pickle=True)
    return folder


@pytest.mark.parametrize("rows", [16, 20])
def test_reads_square_pads(tmp_path, rows):
    arrays = press(rows)
    recording = read_recording(write(tmp_path / "AD2-0001", arrays))
    assert recording.name == "AD2-0001"
    assert len(recording) == FRAMES
    assert recording.layout.grid_shape == (rows, rows)
    assert recording.flaws == ("",) * FRAMES
    assert recording.valid.all()
    np.testing.assert_array_equal(recording.positions, arrays["3D_Positions"])
    np.testing.assert_array_equal(recording.time, arrays["sendTimestamp"])
    np.testing.assert_array_equal(recording.source_index, arrays["index"])
    np.testing.assert_array_equal(recording.moment, arrays["3D_ResultantMoment"][:, 0])
    np.testing.assert_array_equal(recording.force, arrays["3D_ResultantForce"][:, 0])
    np.testing.assert_array_equal(recording.forces, arrays["3D_Forces"])


def test_the_reference_is_that_of_the_loaded_frames(tmp_path):
    arrays = press()
    recording = read_tac3d(write(tmp_path, arrays))
    # to rounding of position minus displacement; unloaded frames are 1 µm of noise off
    np.testing.assert_allclose(recording.layout.reference, pad(4), atol=1e-12)
    assert recording.notes == ()


def test_without_a_loaded_frame_the_reference_is_the_median(tmp_path):
    arrays = press()
    folder = write(
        tmp_path,
        arrays,
        **{
            "3D_Positions": np.tile(pad(4), (FRAMES, 1, 1)),
            "3D_Displacements": np.zeros((FRAMES, 16, 3)),
        },
    )
    recording = read_tac3d(folder)
    np.testing.assert_array_equal(recording.layout.reference, pad(4))
    assert "no frame is loaded" in recording.notes[0]


def test_displacements_of_zero_under_markers_that_move_are_refused(tmp_path):
    folder = write(tmp_path, press(), **{"3D_Displacements": np.zeros((FRAMES, 16, 3))})
    with pytest.raises(ValueError, match=r"zero in all frames, but the markers move by 0\.4 mm"):
        read_tac3d(folder)


def test_a_drifting_zero_is_noted():
    arrays = press()
    moved = arrays["3D_Displacements"].copy()
    moved[5] += 0.02
    reference, notes = find_reference(arrays["3D_Positions"], moved)
    np.testing.assert_allclose(reference, pad(4), atol=1e-12)
    assert "differs by up to 0.02 mm" in notes[0]


def test_only_the_needed_arrays_are_needed(tmp_path):
    optional = ("3D_Forces", "3D_ResultantForce", "3D_ResultantMoment", "index")
    folder = write(tmp_path, press(), **dict.fromkeys(optional))
    (folder / "overview.csv").write_text("index,timestamp\n")
    (folder / "3D_Normals.npy").write_bytes(b"not even an array")
    recording = read_recording(folder)
    assert recording.force is recording.moment is recording.forces is None
    np.testing.assert_array_equal(recording.source_index, np.arange(FRAMES))


@pytest.mark.parametrize("name", ["3D_Positions", "3D_Displacements", "sendTimestamp"])
def test_missing_arrays_are_named(tmp_path, name):
    with pytest.raises(FileNotFoundError, match=rf"lacks {name}\.npy"):
        read_recording(write(tmp_path, press(), **{name: None}))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"3D_Positions": np.zeros((FRAMES, 16))}, r"3D_Positions\.npy has shape \(14, 16\)"),
        ({"3D_Positions": np.zeros((FRAMES, 16, 2))}, r"3D_Positions\.npy has shape"),
        ({"3D_Displacements": np.zeros((FRAMES - 1, 16, 3))}, "not of one recording"),
        ({"3D_Displacements": np.zeros((FRAMES, 9, 3))}, "not of one recording"),
        ({"sendTimestamp": np.zeros(FRAMES + 1)}, r"sendTimestamp\.npy has shape \(15,\)"),
        ({"index": np.zeros(3)}, r"index\.npy has shape"),
        ({"index": np.full(FRAMES, np.nan)}, r"index\.npy must hold whole numbers"),
        ({"3D_ResultantMoment": np.zeros((FRAMES, 2, 3))}, r"3D_ResultantMoment\.npy has shape"),
        ({"3D_Forces": np.full((FRAMES, 16, 3), "a")}, r"3D_Forces\.npy holds"),
        ({"3D_Forces": np.full((FRAMES, 16, 3), None)}, r"3D_Forces\.npy is not a complete"),
        ({"3D_Positions": np.zeros((0, 16, 3))}, r"3D_Positions\.npy"),
    ],
)
def test_misshapen_arrays_are_named(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        read_recording(write(tmp_path, press(), **changes))


@pytest.mark.parametrize("keep", [0, 5, 100, 700])
def test_truncated_arrays_are_named(tmp_path, keep):
    path = write(tmp_path, press()) / "3D_Displacements.npy"
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError, match=r"3D_Displacements\.npy is not a complete array"):
        read_recording(tmp_path)


def test_a_header_that_is_cut_short_is_named(tmp_path):
    path = write(tmp_path, press()) / "index.npy"
    data = path.read_bytes()
    brace = data.index(b"}")
    path.write_bytes(data[:brace] + b" " + data[brace + 1 :])
    with pytest.raises(ValueError, match=r"index\.npy is not a complete array"):
        read_recording(tmp_path)


def test_an_array_that_claims_to_be_huge_takes_no_memory(tmp_path):
    path = write(tmp_path, press()) / "3D_Positions.npy"
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**9, 400, 3)}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ValueError, match="not a complete array"):
        read_recording(tmp_path)


def test_markers_lost_for_a_while_or_for_good(tmp_path):
    arrays = press()
    for name in ("3D_Positions", "3D_Displacements"):
        arrays[name][7, 3] = np.nan
        arrays[name][:, 15] = np.nan
    recording = read_recording(write(tmp_path, arrays))
    assert recording.valid.shape == (FRAMES, 15)
    assert np.argwhere(~recording.valid).tolist() == [[7, 3]]
    np.testing.assert_allclose(recording.layout.reference, pad(4)[:15], atol=1e-12)
    assert any("1 markers were never seen" in note for note in recording.notes)


def test_frames_of_zeros_keep_their_row(tmp_path):
    arrays = press()
    for name in ("3D_Positions", "3D_Displacements"):
        arrays[name][[0, 6]] = 0
    recording = read_recording(write(tmp_path, arrays))
    assert [i for i, flaw in enumerate(recording.flaws) if flaw] == [0, 6]
    np.testing.assert_allclose(recording.layout.reference, pad(4), atol=1e-12)


def test_only_zeros_are_refused(tmp_path):
    zeros = np.zeros((FRAMES, 16, 3))
    changes = {"3D_Positions": zeros, "3D_Displacements": zeros}
    with pytest.raises(ValueError, match="no marker is ever seen"):
        read_recording(write(tmp_path, press(), **changes))


def test_a_single_frame_is_read(tmp_path):
    one = {name: array[5:6] for name, array in press().items()}
    assert len(read_recording(write(tmp_path, one))) == 1


@settings(max_examples=30)  # files are written for each
@given(seed=st.integers(0, 2**16), damage=st.floats(0, 0.5))
def test_whatever_is_lost_no_frame_is(tmp_path_factory, seed, damage):
    rng = np.random.default_rng(seed)
    arrays = press()
    lost = rng.random((FRAMES, 16)) < damage
    lost[5] = False
    for name in ("3D_Positions", "3D_Displacements"):
        arrays[name][lost] = np.nan
    arrays["sendTimestamp"] = rng.permutation(arrays["sendTimestamp"])
    arrays["sendTimestamp"][rng.random(FRAMES) < damage] = np.nan
    recording = read_recording(write(tmp_path_factory.mktemp("tac3d"), arrays))
    assert len(recording) == len(recording.flaws) == FRAMES
    np.testing.assert_array_equal(recording.valid, ~lost)
    good = [i for i, flaw in enumerate(recording.flaws) if not flaw]
    assert (np.diff(recording.time[good]) > 0).all()


# --- what is at a path ---------------------------------------------------------------------------


def test_a_folder_of_several_gives_all_of_them(tmp_path):
    for name in ("right", "left"):
        write(tmp_path / name, press())
    write_archive(read_tac3d(tmp_path / "left"), tmp_path / "copy.npz")
    (tmp_path / "notes").mkdir()
    found = find_recordings(tmp_path)
    assert [path.name for path in found] == ["copy.npz", "left", "right"]
    assert find_recordings(tmp_path / "left") == [tmp_path / "left"]
    with pytest.raises(ValueError, match=r"holds 3 recordings \(copy.npz, left, right\)"):
        read_recording(tmp_path)
    alone = read_recording(tmp_path / "copy.npz")
    np.testing.assert_array_equal(alone.positions, read_recording(tmp_path / "left").positions)


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere does not exist: give a folder"):
        find_recordings(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="is empty: expected"):
        find_recordings(tmp_path / "empty")
    (tmp_path / "movie.txt").touch()
    with pytest.raises(ValueError, match=r"a file of another kind: .*a video \(\*\.mp4"):
        find_recordings(tmp_path / "movie.txt")
    with pytest.raises(ValueError, match="holds no recording: expected"):
        find_recordings(tmp_path)
    (tmp_path / "outer" / "day 1" / "clip").mkdir(parents=True)
    (tmp_path / "outer" / "day 1" / "clip.npz").touch()
    with pytest.raises(ValueError, match=r"no recording; give its folders that do: .*day 1/:"):
        find_recordings(tmp_path / "outer")
    (tmp_path / "empty" / "1.png").touch()
    with pytest.raises(ValueError, match="it is not an image, or is damaged"):
        find_recordings(tmp_path / "empty" / "1.png")
    Image.new("L", (8, 8)).save(tmp_path / "empty" / "1.png")
    with pytest.raises(ValueError, match=r"a file of another kind; give its folder, .*empty/: "):
        find_recordings(tmp_path / "empty" / "1.png")
    (tmp_path / "empty" / "record.sqlite").touch()
    with pytest.raises(ValueError, match="is the output folder of a run: give the recording"):
        find_recordings(tmp_path / "empty")
    with pytest.raises(ValueError, match=r"is the folder of the recording: write the results to"):
        expect_apart([str(tmp_path / "empty")], tmp_path / "outer" / ".." / "empty")
    expect_apart([str(tmp_path / "empty")], tmp_path / "empty" / "out")
    (tmp_path / "markers.csv").touch()
    with pytest.raises(ValueError, match=r"as examples/markers_table.py does: expected"):
        find_recordings(tmp_path / "markers.csv")
    (tmp_path / "movie.gif").touch()
    with pytest.raises(ValueError, match=r"convert it .* -i movie.gif movie.mp4"):
        find_recordings(tmp_path / "movie.gif")
    with pytest.raises(ValueError, match="save the stream as a video"):
        find_recordings("/dev/null")
    one = write(tmp_path / "one", press()) / "index.npy"
    with pytest.raises(ValueError, match=r"give its folder, .*one"):
        find_recordings(one)


def test_a_file_that_cannot_be_opened_is_an_os_error(tmp_path):
    folder = write(tmp_path, press(), sendTimestamp=None)
    (folder / "sendTimestamp.npy").mkdir()  # a folder in its place: unreadable for any user
    with pytest.raises(OSError, match="sendTimestamp"):
        read_recording(folder)


# --- the published recordings --------------------------------------------------------------------


@pytest.fixture
def published():
    """Reads a published set, or skips."""

    def read(name: str):
        return [read_recording(path) for path in find_recordings(find_published(name))]

    return read


def test_unloaded_frames_of_the_press_are_measured_not_zero(published):
    (recording,) = published("tac3d-press")
    assert recording.notes == (
        "9 frames were dropped at the source (2 gaps in the frame numbers, the largest step 9)",
    )
    displacement = recording.positions - recording.layout.reference
    # what the gel has yet to recover right after the second press, in mm
    assert 0.05 < np.abs(displacement[136]).max() < 0.1
    # and long after: no more than noise and a residue of µm
    assert np.sqrt((displacement[140:160] ** 2).mean()) < 0.01


def test_published_noise_is_about_a_micrometre_in_plane_and_several_along_z(published):
    (press_recording,) = published("tac3d-press")
    still = slice(140, 169)
    rest = replace(
        press_recording,
        **{
            name: getattr(press_recording, name)[still]
            for name in ("positions", "valid", "time", "source_index", "force", "moment", "forces")
        },
        flaws=(),
    )
    # wide bounds: they tell µm from mm and from nm, and one axis from the other
    for recording in (rest, press_recording, *published("tac3d-pivot")):
        noise = estimate_noise(recording)
        assert 0.5e-3 < noise.in_plane < 1.5e-3
        assert 2e-3 < noise.normal < 7e-3
        assert 0.6 < noise.correlation[0] < 0.85
        assert 0.25 < noise.correlation[1] < 0.45


@pytest.mark.parametrize("number", [1e300, 2.5, np.nan])
def test_frame_numbers_that_are_no_whole_numbers_are_refused(tmp_path, number):
    index = np.arange(FRAMES, dtype=float)
    index[3] = number
    with pytest.raises(ValueError, match="whole numbers below"):
        read_recording(write(tmp_path, press(), index=index))
