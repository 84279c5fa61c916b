"""Videos as they are shown: their times, turns and ends."""

import struct
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from estimation.output.preview import _encode
from estimation.pictures.part import Part
from estimation.pictures.speckle.tracking import _unique_radius
from estimation.pictures.stream import read_pictures

PICTURES = [np.random.default_rng(i).integers(20, 230, (48, 64)).astype(np.uint8) for i in range(7)]
UNEVEN = (0.0, 0.02, 0.1, 0.3, 0.34, 0.36, 0.5)


def write_video(path, times):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"qp": "0"})
        stream.height, stream.width = PICTURES[0].shape
        stream.pix_fmt = "gray"
        stream.codec_context.time_base = Fraction(1, 1000)
        for time, image in zip(times, PICTURES, strict=True):
            frame = av.VideoFrame.from_ndarray(image, format="gray")
            frame.pts = round(1000 * time)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("suffix", ["mkv", "mov"])
@pytest.mark.parametrize("start", [0.0, 100.0])
def test_a_video_of_uneven_rate_is_complete(tmp_path, suffix, start):
    times = [start + time for time in UNEVEN]
    read = list(read_pictures(write_video(tmp_path / f"clip.{suffix}", times)))
    assert [one.flaw for one in read] == [""] * len(PICTURES)
    assert [one.time for one in read] == pytest.approx(times)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows allows no colon in a name")
def test_a_name_with_a_colon_is_no_protocol(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_video(tmp_path / "13:06.mkv", UNEVEN).relative_to(tmp_path)
    assert len(list(read_pictures(path))) == len(PICTURES)
    _encode(iter([(0, np.zeros((48, 64, 3), np.uint8))]), Path("13:07.mp4"))
    assert len(list(read_pictures(Path("13:07.mp4")))) == 1


def test_the_last_row_of_a_truncated_video_follows_in_time(tmp_path):
    path = write_video(tmp_path / "clip.mkv", [100.0 + 0.04 * i for i in range(7)])
    content = path.read_bytes()
    path.write_bytes(content[: int(0.4 * len(content))])
    *_, before, last = read_pictures(path)
    assert last.time == pytest.approx(before.time + 1 / 25)
    assert "s it declares are missing" in last.flaw


@pytest.mark.parametrize(
    ("matrix", "show"),
    [
        ((0, -1, 1, 0), lambda image: np.rot90(image, 1)),
        ((-1, 0, 0, -1), lambda image: np.rot90(image, 2)),
        ((0, 1, -1, 0), lambda image: np.rot90(image, 3)),
        ((-1, 0, 0, 1), np.fliplr),
    ],
    ids=["left", "over", "right", "mirrored"],
)
def test_a_video_is_read_as_it_is_shown(tmp_path, matrix, show):
    path = write_video(tmp_path / "clip.mov", UNEVEN)
    content = bytearray(path.read_bytes())
    place = content.index(b"tkhd") + 44  # of the matrix in a track's header
    a, b, c, d = (n << 16 for n in matrix)
    content[place : place + 20] = struct.pack(">5i", a, b, 0, c, d)
    path.write_bytes(content)
    for read, image in zip(read_pictures(path), PICTURES, strict=True):
        assert read.image is not None
        stored = read.image[..., 0].ravel()  # the codec's grey levels are scaled
        assert np.corrcoef(stored, show(image).ravel())[0, 1] > 0.99


def test_speckle_that_is_black_and_white_everywhere_gives_no_warning():
    clipped = np.where(PICTURES[0] > 120, 255.0, 0.0).astype(np.float32)
    assert _unique_radius(np.tile(clipped, (4, 4)), 8, Part()) > 0
