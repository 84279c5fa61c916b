"""Archives give back exactly what was written, and refuse everything else."""

import sys
import zipfile
from dataclasses import MISSING, fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from estimation.frames import archive
from estimation.frames.archive import read_archive, write_archive
from estimation.frames.recording import MarkerLayout, Recording, layout_markers
from estimation.frames.source import record_source
from estimation.sources import read_recording
from tests.cases import lift

WORDS = st.text(st.characters(exclude_categories=["Cs", "Cc"]), max_size=12)


@st.composite
def parts(draw) -> dict:
    """Parts of recordings of every shape, with missing markers and odd numbers."""
    frames, markers = draw(st.integers(1, 4)), draw(st.integers(1, 6))
    dimensions = draw(st.sampled_from([2, 3]))
    numbers = {"allow_nan": True, "allow_infinity": True}

    def array(*shape: int, **limits) -> np.ndarray:
        return draw(hnp.arrays(float, shape, elements=st.floats(**(limits or numbers))))

    def optional(*shape: int) -> np.ndarray | None:
        return array(*shape) if draw(st.booleans()) else None

    positions = array(frames, markers, dimensions)
    neighbours = hnp.arrays(int, (markers, 3), elements=st.integers(-1, markers - 1))
    texts = st.lists(WORDS, min_size=frames, max_size=frames).map(tuple)
    return dict(
        layout=MarkerLayout(
            reference=array(markers, dimensions, allow_nan=False, allow_infinity=False),
            neighbours=draw(neighbours),
            grid_shape=draw(st.sampled_from([None, (1, markers)])),
        ),
        positions=positions,
        valid=np.isfinite(positions).all(axis=-1),
        time=array(frames),
        source_index=draw(hnp.arrays(int, frames, elements=st.integers(-(2**63), 2**63 - 1))),
        force=optional(frames, 3),
        moment=optional(frames, 3),
        forces=optional(frames, markers, dimensions),
        flaws=draw(st.sampled_from([()]) | texts),
        contact=draw(st.none() | hnp.arrays(bool, (frames, markers))),
        imprint=optional(frames, 2),
        print_point=optional(frames, 7),
        rotation=optional(frames, markers),
        others=draw(st.none() | hnp.arrays(bool, (frames, markers))),
        pictured=draw(st.booleans()),
        unit=draw(st.sampled_from(["mm", "px"])),
        name=draw(WORDS),
        source=draw(WORDS),
        convention=draw(WORDS),
        notes=tuple(draw(st.lists(WORDS, max_size=3))),
        warnings=tuple(draw(st.lists(WORDS, max_size=3))),
    )


def assert_same(one, other) -> None:
    for part in fields(one):
        left, right = getattr(one, part.name), getattr(other, part.name)
        if isinstance(left, MarkerLayout):
            assert_same(left, right)
        elif isinstance(left, np.ndarray):
            assert left.dtype == right.dtype
            np.testing.assert_array_equal(left, right)
        else:
            assert left == right


@given(parts=parts())
def test_round_trip_is_exact(tmp_path_factory, parts):
    recording = Recording(**parts)
    path = tmp_path_factory.mktemp("archive") / "one.npz"
    write_archive(recording, path)
    assert_same(read_archive(path), recording)


@pytest.fixture
def full(recording) -> Recording:
    """A recording that has everything a recording can have, none of it the default."""
    shape, numbers = recording.positions.shape, np.arange(240.0)
    return replace(
        recording,
        layout=replace(recording.layout, grid_shape=(4, 4)),
        force=numbers[:15].reshape(5, 3),
        moment=numbers[15:30].reshape(5, 3),
        forces=numbers.reshape(shape),
        flaws=("", "a", "", "", "b"),
        contact=numbers[:80].reshape(5, 16) < 9.0,
        imprint=numbers[:10].reshape(5, 2),
        print_point=0.1 * numbers[:35].reshape(5, 7),
        rotation=0.01 * numbers[:80].reshape(5, 16),
        hold=0.1 * numbers[:15].reshape(5, 3),
        others=numbers[:80].reshape(5, 16) > 70.0,
        pictured=True,
        unit="px",
        name="name",
        source="source",
        convention="convention",
        notes=("one", "two"),
        warnings=("three",),
    )


def test_every_declared_field_is_archived_documented_and_cut(full, tmp_path):
    """Whoever adds a field to `Recording` is sent here, to give `full` a value for it."""
    write_archive(full, tmp_path / "one.npz")
    read, head = read_archive(tmp_path / "one.npz"), full.head(2)
    for one in fields(Recording):
        value = getattr(full, one.name)
        assert value is not None
        assert one.default is MISSING or np.any(value != one.default), one.name
        if len(value) == len(full) if isinstance(value, np.ndarray) else one.name == "flaws":
            assert np.array_equal(getattr(head, one.name), value[:2]), one.name
    assert_same(read, full)
    described = archive.write_archive.__doc__
    with np.load(tmp_path / "one.npz") as file:
        assert [name for name in file.files if f"`{name}`" not in described] == []


def test_frames_hold_all_that_a_recording_does(full):
    assert_same(record_source(full, list(full)), full)


def test_archives_of_version_1_are_read(recording, tmp_path):
    first = (
        "positions valid time source_index reference neighbours grid_shape flaws name source "
        "convention notes"
    )
    write_archive(recording, tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as file:
        np.savez(
            tmp_path / "old.npz", format_version=1, **{one: file[one] for one in first.split()}
        )
    assert_same(read_archive(tmp_path / "old.npz"), recording)


@pytest.mark.parametrize("axes", [2, 3])
def test_older_archives_with_a_contact_in_the_plane_are_from_pictures(recording, tmp_path, axes):
    layout = layout_markers(recording.layout.reference[:, :axes])
    positions = recording.positions[..., :axes]
    contact = np.ones(positions.shape[:2], dtype=bool)
    case = replace(recording, layout=layout, positions=positions, contact=contact)
    write_archive(case, tmp_path / "new.npz")
    assert not read_archive(tmp_path / "new.npz").pictured
    with np.load(tmp_path / "new.npz") as file:
        older = {name: file[name] for name in file.files if name != "pictured"}
    np.savez(tmp_path / "old.npz", **older)
    assert read_archive(tmp_path / "old.npz").pictured == (axes == 2)


@pytest.fixture
def recording() -> Recording:
    reference = np.stack([*np.mgrid[:4, :4].astype(float), np.zeros((4, 4))], -1).reshape(-1, 3)
    return Recording(
        layout=layout_markers(reference),
        positions=reference + 0.01 * np.arange(5.0)[:, None, None],
        valid=np.ones((5, 16), dtype=bool),
        time=np.arange(5.0),
        source_index=np.array([0, 1, 2, 4, 5]),
    )


def spoil(path, **changes):
    """Change entries of an archive."""
    with np.load(path) as file:
        np.savez(path, **(dict(file) | changes))


@pytest.mark.parametrize("shape", [[np.inf, np.nan], [np.inf, 16.0], [2**62, 4]])
def test_a_grid_that_is_none_is_refused(recording, tmp_path, shape):
    path = tmp_path / "one.npz"
    write_archive(recording, path)
    spoil(path, grid_shape=np.array(shape))
    with pytest.raises(ValueError, match=r"one\.npz.*grid_shape"):
        read_recording(path)


def test_markers_that_are_too_far_away_are_refused(recording, tmp_path):
    path = tmp_path / "one.npz"
    write_archive(recording, path)
    spoil(path, reference=np.where(recording.layout.reference == 3.0, 1e300, 0.0))
    with pytest.raises(ValueError, match=r"one\.npz: `reference` has positions .* too far away"):
        read_recording(path)


def test_an_archive_without_its_beginning_is_refused(recording, tmp_path):
    path = tmp_path / "one.npz"
    write_archive(recording, path)
    path.write_bytes(path.read_bytes()[-400:])
    seen = sys.version_info >= (3, 14)  # from then on, `is_zipfile` sees it
    what = "not a recording archive, or is truncated" if seen else "damaged"
    with pytest.raises(ValueError, match=rf"one\.npz is {what}"):
        read_recording(path)


def test_what_is_read_by_path_is_inspected(recording, tmp_path):
    write_archive(recording, tmp_path / "one.npz")
    read = read_recording(tmp_path / "one.npz")
    assert read.flaws == ("",) * 5
    assert "1 frame was dropped" in read.notes[0]


def test_opens_without_us_and_without_pickles(recording, tmp_path):
    write_archive(recording, tmp_path / "one.npz")
    with np.load(tmp_path / "one.npz", allow_pickle=False) as file:
        assert file["format_version"] == archive.FORMAT_VERSION
        assert {file[name].dtype.kind for name in file.files} <= set("fibU")


def test_a_name_without_the_suffix_is_refused(recording, tmp_path):
    with pytest.raises(ValueError, match=r"must end in \.npz"):
        write_archive(recording, tmp_path / "one.dat")


def test_failing_to_write_leaves_the_former_file(recording, tmp_path, monkeypatch):
    path = tmp_path / "one.npz"
    write_archive(recording, path)
    before = path.read_bytes()

    def disk_full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", disk_full)
    with pytest.raises(OSError, match="No space left"):
        write_archive(replace(recording, name="other"), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["one.npz"]


def rewrite(path, recording, **changes) -> None:
    """An archive with entries changed, or left out where None."""
    write_archive(recording, path)
    with np.load(path) as file:
        entries = {name: file[name] for name in file.files} | changes
    np.savez(path, **{name: entry for name, entry in entries.items() if entry is not None})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format_version": 3}, r"version 3; .* reads up to 2: update contactmodel"),
        ({"colour": np.zeros(5)}, r"the entry 'colour' is unknown: update contactmodel"),
        ({"format_version": None}, "no `format_version`"),
        ({"format_version": "1"}, "no `format_version`"),
        ({"positions": None}, "lacks the entry 'positions'"),
        ({"notes": None}, "lacks the entry 'notes'"),
        ({"time": np.zeros(3)}, "not consistent"),
        ({"positions": np.zeros((5, 15, 3))}, "not consistent"),
        ({"positions": np.full((5, 16, 3), "far")}, "not consistent"),
        ({"source_index": np.zeros(5)}, "not consistent"),
        ({"grid_shape": np.zeros(3)}, "not consistent"),
        ({"grid_shape": np.array([4.0, np.inf])}, "not consistent"),
        ({"grid_shape": np.array([-4, -4])}, "not consistent"),
        ({"rotation": np.zeros((5, 3))}, "not consistent"),
        ({"name": np.zeros(3)}, "not consistent"),
        ({"positions": np.full((5, 16, 3), None)}, "is damaged"),
    ],
)
def test_contents_that_make_no_recording_are_refused(recording, tmp_path, changes, message):
    path = tmp_path / "one.npz"
    rewrite(path, recording, **changes)
    with pytest.raises(ValueError, match=message):
        read_archive(path)


def test_broken_files_are_refused(recording, tmp_path):
    path = tmp_path / "one.npz"
    write_archive(recording, path)
    whole = path.read_bytes()
    for content in (b"", whole[:-30], whole[: len(whole) // 2], b"time,x,y\n0,1,2\n"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"one\.npz"):
            read_archive(path)
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("readme.txt", "hello")
    with pytest.raises(ValueError, match=r"readme\.txt in it is no array"):
        read_archive(path)


def test_every_flipped_byte_is_either_harmless_or_refused(recording, tmp_path):
    path = tmp_path / "one.npz"
    write_archive(recording, path)
    whole = path.read_bytes()
    for place in np.random.default_rng(0).integers(0, len(whole), 100):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        try:
            read = read_archive(path)
        except ValueError:
            continue
        assert_same(read, recording)


def test_the_documented_version_is_the_written_one(recording, tmp_path):
    assert f"Format version {archive.FORMAT_VERSION} has" in archive.write_archive.__doc__


def test_paths_may_be_text(tmp_path):
    write_archive(lift([0.0]), str(tmp_path / "one.npz"))
    assert len(read_recording(str(tmp_path / "one.npz"))) == len(lift([0.0]))
