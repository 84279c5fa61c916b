"""Data sets are fetched once, checked always, and never write outside their folder."""

import hashlib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from estimation.frames import datasets
from estimation.sources import find_recordings, read_recording
from tests.cases import find_published

WHEEL = datasets._PUBLISHED_DATA["wheel"]
FILES = {"S1/a.npy": b"first", "S1/b.npy": b"second", "S2/a.npy": b"third"}


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def build_wheel(path: Path, members: dict[str, bytes]) -> str:
    """A wheel that pip accepts; returns its sha256."""
    info = "pytac3d-3.3.0.9.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(f"{info}/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-any\n")
        metadata = "Metadata-Version: 2.1\nName: pytac3d\nVersion: 3.3.0.9\n"
        archive.writestr(f"{info}/METADATA", metadata + "Requires-Python: <3.12\n")
        archive.writestr(f"{info}/RECORD", "")
        archive.writestr("PyTac3D/__init__.py", "raise RuntimeError('never imported')")
        for name, content in members.items():
            archive.writestr(name, content)
    return digest(path.read_bytes())


@pytest.fixture
def shop(tmp_path, monkeypatch) -> Path:
    """A published set `toy`, the wheel on a shelf that pip looks at instead of the network."""
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    wheel = shelf / "pytac3d-3.3.0.9-py3-none-any.whl"
    members = {f"PyTac3D/example_data/toy/{name}": content for name, content in FILES.items()}
    escapes = {"../outside.npy": b"x", "/outside.npy": b"x", "PyTac3D/../../outside.npy": b"x"}
    sha256 = build_wheel(wheel, members | escapes)
    manifest = {name: digest(content) for name, content in FILES.items()}
    toy = {"folder": "PyTac3D/example_data/toy", "files": manifest}
    monkeypatch.setitem(datasets._PUBLISHED_DATA, "sets", {"toy": toy})
    monkeypatch.setitem(WHEEL, "sha256", sha256)
    monkeypatch.setenv("CONTACTMODEL_CACHE", str(tmp_path / "home" / "cache"))
    monkeypatch.delenv("CONTACTMODEL_DATA", raising=False)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(shelf))
    return shelf


@pytest.fixture
def no_pip(monkeypatch):
    """Nothing can be downloaded any more."""

    def refuse(published, folder):
        raise AssertionError("downloaded again")

    monkeypatch.setattr(datasets, "_pip_download", refuse)


def holds_all(folder: Path) -> bool:
    found = {str(p.relative_to(folder).as_posix()) for p in folder.rglob("*") if p.is_file()}
    return found == set(FILES) and all((folder / n).read_bytes() == c for n, c in FILES.items())


def test_pip_brings_the_set_and_nothing_else(shop, tmp_path):
    said: list[str] = []
    assert datasets.find("toy") is None
    folder = datasets.fetch("toy", said.append)
    assert folder == tmp_path / "home" / "cache" / "toy" == datasets.find("toy")
    assert holds_all(folder)
    assert sum("no licence is stated" in line for line in said) == 1
    assert {p.name for p in folder.parent.iterdir()} == {
        "toy",
        WHEEL["filename"],
    }
    assert not list(tmp_path.rglob("outside.npy"))
    assert not Path("/outside.npy").exists()


def test_what_is_intact_is_not_fetched_again(shop, no_pip, monkeypatch):
    monkeypatch.setenv("CONTACTMODEL_DATA", str(shop))
    first = datasets.fetch("toy")
    before = {p: p.stat().st_mtime_ns for p in first.rglob("*")}
    said: list[str] = []
    assert datasets.fetch("toy", said.append) == first
    assert said == []
    assert {p: p.stat().st_mtime_ns for p in first.rglob("*")} == before


@pytest.mark.parametrize("harm", ["truncated", "changed", "missing", "folder in its place"])
def test_a_broken_file_is_replaced(shop, no_pip, monkeypatch, harm):
    monkeypatch.setenv("CONTACTMODEL_DATA", str(shop))
    broken = datasets.fetch("toy") / "S1" / "b.npy"
    if harm == "truncated":
        broken.write_bytes(FILES["S1/b.npy"][:-1])
    elif harm == "changed":
        broken.write_bytes(b"secone")
    else:
        broken.unlink()
        if harm.startswith("folder"):
            broken.mkdir()
    said: list[str] = []
    assert datasets.find("toy") is None
    assert holds_all(datasets.fetch("toy", said.append))
    assert "incomplete or damaged" in said[0]


def test_the_data_folder_comes_first_and_is_never_written_to(shop, no_pip, tmp_path, monkeypatch):
    data = tmp_path / "data"
    for name, content in FILES.items():
        (data / "toy" / name).parent.mkdir(parents=True, exist_ok=True)
        (data / "toy" / name).write_bytes(content)
    monkeypatch.setenv("CONTACTMODEL_DATA", str(data))
    assert datasets.fetch("toy") == data / "toy"
    assert not datasets.cache_folder().exists()
    # damaged there: the cache gets a good one, the folder stays as it is
    (data / "toy" / "S2" / "a.npy").write_bytes(b"bad")
    (data / WHEEL["filename"]).write_bytes(next(shop.iterdir()).read_bytes())
    before = {p: (p.stat().st_mtime_ns, p.is_file() and p.read_bytes()) for p in data.rglob("*")}
    assert datasets.fetch("toy") == datasets.cache_folder() / "toy"
    after = {p: (p.stat().st_mtime_ns, p.is_file() and p.read_bytes()) for p in data.rglob("*")}
    assert after == before


def test_a_wheel_put_into_the_cache_will_do(shop, no_pip):
    datasets.cache_folder().mkdir(parents=True)
    wheel = next(shop.iterdir())
    (datasets.cache_folder() / wheel.name).write_bytes(wheel.read_bytes())
    assert holds_all(datasets.fetch("toy"))


def test_a_damaged_wheel_in_the_cache_is_replaced(shop):
    datasets.cache_folder().mkdir(parents=True)
    (datasets.cache_folder() / WHEEL["filename"]).write_bytes(b"half a whe")
    assert holds_all(datasets.fetch("toy"))


def test_another_wheel_of_that_name_is_refused(shop, monkeypatch):
    monkeypatch.setitem(WHEEL, "sha256", "0" * 64)
    with pytest.raises(ValueError, match=r"differs from the published.*nothing of it is used"):
        datasets.fetch("toy")
    assert list(datasets.cache_folder().iterdir()) == []


def test_unlisted_content_is_refused(shop, monkeypatch):
    monkeypatch.setitem(datasets._PUBLISHED_DATA["sets"]["toy"]["files"], "S1/b.npy", "0" * 64)
    with pytest.raises(ValueError, match=r"S1/b.npy in .* is not what was published"):
        datasets.fetch("toy")
    assert not (datasets.cache_folder() / "toy").exists()


def test_offline_the_message_says_what_to_do(shop, monkeypatch):
    monkeypatch.delenv("PIP_FIND_LINKS")
    with pytest.raises(OSError, match=r"pip could not download pytac3d==3.3.0.9") as raised:
        datasets.fetch("toy")
    message = str(raised.value)
    assert "python -m pip download --no-deps --only-binary=:all: --python-version 3.11" in message
    assert f"put {WHEEL['filename']} into {datasets.cache_folder()}" in message
    assert list(datasets.cache_folder().iterdir()) == []


def test_without_pip_the_message_says_what_to_do(shop, tmp_path, monkeypatch):
    (tmp_path / "pip").mkdir()
    (tmp_path / "pip" / "__init__.py").touch()
    (tmp_path / "pip" / "__main__.py").write_text("raise SystemExit('No module named pip')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(OSError, match=r"\(No module named pip\). Where there is a network, run"):
        datasets.fetch("toy")


def test_unknown_names_are_told_the_known_ones(shop):
    with pytest.raises(ValueError, match="no data set 'nought': choose from toy"):
        datasets.fetch("nought")


def test_the_cache_is_the_users_unless_chosen(monkeypatch, tmp_path):
    monkeypatch.delenv("CONTACTMODEL_CACHE", raising=False)
    assert "contactmodel" in str(datasets.cache_folder())
    monkeypatch.setenv("CONTACTMODEL_CACHE", str(tmp_path))
    assert datasets.cache_folder() == tmp_path


def test_the_manifest_names_plain_files_of_whole_recordings():
    for published in datasets.list_names():
        for name, sha256 in datasets.list_files(published).items():
            assert ".." not in name
            assert not name.startswith("/")
            assert name.endswith((".npy", ".avi", ".tiff", ".jpg", ".dat"))
            assert len(sha256) == 64
    sets = {"tac3d-pivot", "tac3d-press", "pivot-videos", "state-videos", "pyvale-rigid-plate"}
    assert set(datasets.list_names()) == sets | {"slip-lifts"}


def test_every_labelled_lift_is_run_and_no_picture_of_the_outside_camera():
    find_published("slip-lifts")
    folders = datasets.fetch_runs("slip-lifts")
    paths = [path for folder in folders for path in find_recordings(folder)]
    assert len(paths) == 36
    assert paths[0].parts[-2:] == ("object001", "066_60_mm")
    assert not any("outside" in path.parts for path in paths)


@pytest.mark.parametrize(("name", "frames"), [("tac3d-pivot", [120, 114]), ("tac3d-press", [252])])
def test_the_published_recordings_are_read(name, frames):
    recordings = [read_recording(path) for path in find_recordings(find_published(name))]
    assert [len(recording) for recording in recordings] == frames
    for recording in recordings:
        assert recording.layout.grid_shape == (20, 20)
        assert recording.valid.all()
        assert not any(recording.flaws)
        # rows along −y, columns along −x, about 1 to 1.1 mm apart, as the reader states
        lattice = recording.layout.reference[:, :2].reshape(20, 20, 2)
        np.testing.assert_allclose(np.diff(lattice, axis=0).mean(axis=(0, 1)), [0, -1.04], atol=0.1)
        np.testing.assert_allclose(np.diff(lattice, axis=1).mean(axis=(0, 1)), [-1.04, 0], atol=0.1)
