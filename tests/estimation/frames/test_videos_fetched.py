"""Videos are fetched file by file from a web server, checked, and never twice."""

import functools
import hashlib
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from estimation.__main__ import app
from estimation.frames import datasets
from estimation.sources import find_paths, find_recordings
from tests.estimation.pictures.scenes import REST, picture

FILES = ("tool/lift/camera_0.avi", "tool/lift/camera_2.avi", "ball/lift/camera_0.avi")

FOLDERS = ("tool/lift", "ball/lift", "outside/tool/lift")


class Handler(SimpleHTTPRequestHandler):
    asked: list[str]

    def log_message(self, format, *args):
        pass

    def do_GET(self):
        self.asked.append(self.path)
        super().do_GET()


@pytest.fixture
def server(tmp_path, monkeypatch):
    """A server of three small videos on this machine; what it has been asked for."""
    shop = tmp_path / "shop"
    rng = np.random.default_rng(0)
    for file in FILES:
        (shop / file).parent.mkdir(parents=True, exist_ok=True)
        writer = cv2.VideoWriter(
            str(shop / file), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (320, 240)
        )
        for _ in range(2):
            writer.write(cv2.cvtColor(picture(REST, rng), cv2.COLOR_GRAY2BGR))
        writer.release()
    handler = type("Asked", (Handler,), {"asked": []})
    http = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(handler, directory=str(shop)))
    thread = threading.Thread(target=http.serve_forever, daemon=True)
    thread.start()
    published = {
        "url": f"http://127.0.0.1:{http.server_port}/",
        "local": "clips",
        "shown": "tool/lift",
        "licence": "BSD-2-Clause, from somewhere",
        "files": {f: hashlib.sha256((shop / f).read_bytes()).hexdigest() for f in FILES},
    }
    monkeypatch.setitem(datasets._PUBLISHED_DATA, "sets", {"videos": published})
    monkeypatch.setenv("CONTACTMODEL_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CONTACTMODEL_DATA", raising=False)
    yield shop, handler.asked
    http.shutdown()
    http.server_close()
    thread.join()


def test_fetched_once_with_the_licence_shown(server, tmp_path):
    shop, asked = server
    said = []
    folder = datasets.fetch("videos", log=said.append)
    assert folder == tmp_path / "cache" / "clips" / "tool" / "lift"
    assert any("BSD-2-Clause" in line for line in said)
    for file in FILES:
        kept = tmp_path / "cache" / "clips" / file
        assert kept.read_bytes() == (shop / file).read_bytes()
    assert [one.name for one in find_recordings(folder)] == ["camera_0.avi", "camera_2.avi"]
    assert len(asked) == 3
    assert datasets.fetch("videos") == folder
    assert len(asked) == 3


def test_only_what_is_missing_or_damaged_is_brought_again(server, tmp_path):
    _, asked = server
    datasets.fetch("videos")
    (tmp_path / "cache" / "clips" / FILES[1]).write_bytes(b"damaged")
    datasets.fetch("videos")
    assert asked[3:] == [f"/{FILES[1]}"]


def test_the_users_own_folder_comes_first(server, tmp_path, monkeypatch):
    shop, asked = server
    (tmp_path / "own").mkdir()
    shop.rename(tmp_path / "own" / "clips")
    monkeypatch.setenv("CONTACTMODEL_DATA", str(tmp_path / "own"))
    assert datasets.fetch("videos") == tmp_path / "own" / "clips" / "tool" / "lift"
    assert not asked
    assert not (tmp_path / "cache").exists()


def test_other_content_is_refused(server, tmp_path):
    shop, _ = server
    (shop / FILES[2]).write_bytes(b"something else")
    with pytest.raises(ValueError, match="differs from the published ball/lift/camera_0"):
        datasets.fetch("videos")
    assert not (tmp_path / "cache" / "clips" / FILES[2]).exists()


def test_a_missing_file_says_what_to_do(server, tmp_path):
    shop, _ = server
    (shop / FILES[0]).unlink()
    with pytest.raises(OSError, match="put it at"):
        datasets.fetch("videos")


def test_one_message_ends_many_downloads(server, monkeypatch):
    shop, _ = server
    monkeypatch.setitem(datasets._PUBLISHED_DATA["sets"]["videos"], "at_once", 2)
    for file in FILES:
        (shop / file).unlink()
    with pytest.raises(OSError, match="cannot be downloaded"):
        datasets.fetch("videos")


def test_runs_leave_out_what_another_camera_saw(server, tmp_path, monkeypatch):
    _, asked = server
    published = datasets._PUBLISHED_DATA["sets"]["videos"]
    published["files"][f"outside/{FILES[1]}"] = published["files"].pop(FILES[1])
    monkeypatch.setitem(published, "apart", "outside/")
    monkeypatch.setitem(published, "runs", ["tool/lift", "ball/lift"])
    monkeypatch.delitem(published, "shown")
    said = []
    found = find_paths(["videos"], said.append)
    clips = tmp_path / "cache" / "clips"
    assert found == [clips / FILES[0], clips / FILES[2]]
    assert (clips / "outside" / FILES[1]).is_file()
    assert f"/{FILES[1]}" in asked
    assert said[1:] == [f"downloading 1 file of {one}" for one in FOLDERS]


def test_the_command_names_the_folder(server):
    done = CliRunner().invoke(app, ["fetch", "videos"])
    assert done.exit_code == 0, done.output
    assert done.output.strip().endswith("tool/lift")
