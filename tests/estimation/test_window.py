"""The page of a live run: what it shows; it delays nothing, and serves nothing else."""

import base64
import http.client
import json
import socket
import time
from contextlib import contextmanager
from itertools import islice

import cv2
import numpy as np
import pytest

from estimation.choices import LiveChoices
from estimation.frames.noise import Noise
from estimation.live import server as serving
from estimation.live.feed import Feed
from estimation.live.server import WindowServer, is_own
from estimation.live.window import Window
from estimation.output.scene import MARKER_COLOURS
from estimation.pictures.part import Part
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource
from estimation.pictures.sensor import Sensor
from estimation.pictures.still import Shown
from estimation.settings import Settings
from estimation.tracking.stream import Stream
from tests.browser import Browser
from tests.cases import domed_pad, lift
from tests.estimation.pictures.test_reading import write_folder
from tests.test_examples import pictures as turned_pictures


@pytest.fixture(scope="module")
def recording():
    return lift(np.radians(np.linspace(0.0, 14.0, 20)), unloaded=3, layout=domed_pad((14, 14)))


@pytest.fixture(scope="module")
def answers(recording):
    return list(Stream(recording, Settings(noise=Noise.from_std(1e-3))).answers())


def opened(source):
    return Window(source, Feed("pad", LiveChoices(), print), "tracked")


@contextmanager
def served(window, host="127.0.0.1"):
    server = WindowServer(window, "<pad>", host, 0)
    try:
        yield server.server_address[1]
    finally:
        window.end("ended")
        server.close()


def ask(port, method="GET", path="/", host="127.0.0.1"):
    """Status, headers and content of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20.0)
    connection.putrequest(method, path, skip_host=True)
    if host:
        connection.putheader("Host", host)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read().decode()


def read_frame(window):
    return json.loads(next(window.follow()))


def test_an_event_has_markers_angle_state_and_alert(recording, answers):
    window = opened(recording)
    for answer in answers:
        window.put(answer)
    seen, last = read_frame(window), answers[-1]
    found = last.estimates["tracked"]
    assert (seen["state"], seen["alert"]) == (found.state, last.alert.level)
    assert seen["scene"]["kinds"].count("o") == found.stick.sum()
    assert len(seen["scene"]["spots"]) == 2 * len(seen["scene"]["kinds"]) == 2 * 196
    assert seen["picture"] is None
    values = {name: (value, half) for name, value, half, _ in seen["values"]}
    half = np.degrees(found.high - found.low) / 2.0
    assert values["angle"] == pytest.approx((np.degrees(found.angle), half), abs=1e-3)
    curve = seen["curve"]
    assert [len(column) for column in curve.values()] == [len(answers)] * 5
    assert curve["time"][0] == 0.0
    assert curve["angle"][-1] == pytest.approx(np.degrees(found.angle), abs=1e-3)


def test_a_slow_browser_misses_pictures_but_no_point_of_the_curve(recording, answers):
    window = opened(recording)
    window.put(answers[0])
    events = window.follow()
    first = json.loads(next(events))
    for answer in answers[1:6]:
        window.put(answer)
    second = json.loads(next(events))
    assert second["frame"] == answers[5].frame.source_index
    assert [len(one["curve"]["time"]) for one in (first, second)] == [1, 5]
    assert window.describe() == "window: 4 of 6 frames not shown: the browser was slower"
    window.restart()  # with a better reference the answers are given again
    window.put(answers[0])
    third = json.loads(next(events))
    assert (third["again"], len(third["curve"]["time"])) == (True, 1)
    window.end("it is over")
    assert json.loads(list(islice(events, 2))[-1]) == {"end": "it is over"}
    assert list(events) == []


def test_the_picture_is_the_one_that_the_answer_is_of(tmp_path):
    pictures = list(turned_pictures())[:4]
    height, width = pictures[0].shape[:2]
    part = Part((8, 0, width - 8, height), None)
    known = ImageSettings(Sensor(dark=True), rate=30.0, part=part)
    source = PictureSource(write_folder(tmp_path / "clip", pictures), known)
    window, seen = opened(source), []
    for _ in Stream(source, Settings(noise=Noise.from_std(0.01, "px"), images=known)).answers(
        window
    ):
        seen.append(read_frame(window))
    for one, picture in zip(seen, pictures, strict=True):
        data = base64.b64decode(one["picture"].removeprefix("data:image/jpeg;base64,"))
        shown = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        expected = picture[:, 8:] if picture.ndim == 2 else picture[:, 8:].mean(axis=2)
        assert one["scene"]["size"] == [width - 8, height] == [*shown.shape[::-1]]
        assert abs(shown.astype(float) - expected).mean() < 3.0
        spots = np.round(one["scene"]["spots"]).astype(int).reshape(-1, 2)
        assert picture.max() == 0 or shown[spots[:, 1], spots[:, 0]].mean() < shown.mean() - 20.0


def test_large_pictures_are_shown_smaller_and_markers_go_with_them():
    shown = Shown(np.full((960, 1920), 50_000, np.uint16)).copy
    assert shown.size == (960, 480)
    image = cv2.imdecode(np.frombuffer(shown.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (480, 960)
    assert abs(int(image.mean()) - 50_000 // 257) <= 1
    np.testing.assert_allclose(shown.place(np.array([[[400.0, 200.0]]])), [[[199.75, 99.75]]])


def test_the_page_is_whole_and_nothing_else_is_served(recording, answers):
    window = opened(recording)
    window.put(answers[-1])
    with served(window) as port:
        status, headers, page = ask(port)
        assert status == 200
        assert "&lt;pad&gt;" in page
        assert "function drawMarkers" in page
        assert "http://" not in page.replace("http://www.w3.org", "")
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in headers
        for path in ("/../etc/passwd", "/index.html", "/?a=1", "/favicon.ico", "*"):
            assert ask(port, path=path)[0] == 404, path
        for method in ("HEAD", "POST", "PUT", "DELETE", "OPTIONS", "ANYTHING"):
            assert ask(port, method)[0] == 405, method
        for host in ("evil.example", "127.0.0.1.evil.example", "", "[::1", "evil.example:80"):
            assert ask(port, host=host)[0] == 403, host
            assert ask(port, path="/events", host=host)[0] == 403, host
        for host in ("localhost", f"127.0.0.1:{port}", f"[::1]:{port}"):
            assert ask(port, host=host)[0] == 200, host
        with pytest.raises(OSError, match=r"cannot be served at 127.*--window-port"):
            WindowServer(window, "other", "127.0.0.1", port)
    assert is_own("robot:80", "Robot")


def test_browsers_that_take_nothing_or_are_gone_delay_nothing(recording, answers, monkeypatch):
    monkeypatch.setattr(serving.WindowServer, "most_browsers", 2)
    window = opened(recording)
    with served(window) as port:
        lazy, gone = (socket.create_connection(("127.0.0.1", port)) for _ in range(2))
        for one in (lazy, gone):
            one.sendall(b"GET /events HTTP/1.0\r\nHost: localhost\r\n\r\n")
            assert one.recv(12) == b"HTTP/1.0 200"
        assert ask(port, path="/events")[0] == 503
        gone.close()
        began = time.process_time()
        for answer in answers * 10:
            window.put(answer)
        assert time.process_time() - began < 5.0
        lazy.close()


def test_a_browser_shows_it(recording, answers, tmp_path):
    window = opened(recording)
    for answer in answers:
        window.put(answer)
    shot, page = tmp_path / "window.png", Browser(tmp_path / "profile")
    try:
        with served(window) as port:
            page.open(f"http://127.0.0.1:{port}/", 1200, 760)
            until = time.monotonic() + 60.0
            while not window.events and time.monotonic() < until:
                time.sleep(0.1)
            window.end("ended")
            while page.run("document.getElementById('words').textContent") != "ended":
                assert time.monotonic() < until
                time.sleep(0.1)
        page.shoot(shot)
    finally:
        page.close()
    assert page.complaints == []
    picture = cv2.cvtColor(cv2.imread(str(shot)), cv2.COLOR_BGR2RGB).astype(int)
    for colour in (MARKER_COLOURS["sticks"], MARKER_COLOURS["slips"], "#08306b"):
        shade = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        assert (np.abs(picture - shade).max(axis=2) <= 2).sum() > 50, colour
