"""Folders of pictures: in which order they are read, as which frames, and at what times."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from estimation.frames.archive import write_archive
from estimation.frames.names import name_recordings, natural_key, number_pictures
from estimation.pictures.reader import ImageSettings
from estimation.pictures.stream import describe_pictures, read_pictures
from estimation.sources import find_recordings, read_recording
from tests.cases import lift


def write(folder, names):
    """Pictures with these names; each has a grey level of its own, 20 for the first."""
    folder.mkdir()
    for i, name in enumerate(names):
        cv2.imwrite(str(folder / name), np.full((16, 16), 20 + i, np.uint8))
    return folder


def read(folder, rate=None):
    """Grey levels, frame numbers and times of the pictures that can be used."""
    usable = [one for one in read_pictures(folder, rate) if not one.flaw]
    levels = [round(float(one.image.mean())) - 20 for one in usable]
    return levels, [one.number for one in usable], [one.time for one in usable]


def files(*names):
    return sorted(map(Path, names), key=natural_key)


def test_pictures_are_read_in_the_order_of_their_numbers(tmp_path):
    folder = write(tmp_path / "clip", [f"frame{i}.png" for i in range(150)])
    (folder / "._frame3.png").write_bytes(b"what some systems leave on a stick")
    levels, numbers, times = read(folder)
    assert levels == numbers == list(range(150))
    assert times == pytest.approx(np.arange(150) / 30.0)
    (warning,) = describe_pictures(folder)
    assert "30 pictures per second are assumed. All times, time_s included" in warning


def test_videos_beside_pictures_are_named(tmp_path):
    folder = write(tmp_path / "clips", ["empty.png"])
    for name in ("B.MP4", "a.mkv", "c.avi", "d.avi"):
        (folder / name).touch()
    named, _ = describe_pictures(folder)
    assert "also holds videos (B.MP4, a.mkv, c.avi, …), which are not read" in named


def test_a_first_picture_of_another_size_costs_only_itself(tmp_path):
    folder = write(tmp_path / "clip", [f"{i}.png" for i in range(30)])
    cv2.imwrite(str(folder / "0.png"), np.full((24, 32), 99, np.uint8))
    first, *others = read_pictures(folder)
    assert first.flaw == "the picture is 32×24, the others are 16×16"
    assert not any(one.flaw for one in others)


@pytest.mark.parametrize("number", [0, 20])
def test_a_coloured_picture_among_grey_ones_costs_only_itself(tmp_path, number):
    folder = write(tmp_path / "clip", [f"{i}.png" for i in range(30)])
    cv2.imwrite(str(folder / f"{number}.png"), np.full((16, 16, 3), (30, 60, 90), np.uint8))
    flaws = {one.number: one.flaw for one in read_pictures(folder) if one.flaw}
    assert flaws == {number: "the picture is in colour, the others are grey"}


def test_values_of_less_than_16_bit_are_doubted(tmp_path):
    folder = tmp_path / "clip"
    folder.mkdir()
    for bits, factor in ((10, 64), (12, 16), (14, 4)):
        for i in range(3):
            cv2.imwrite(str(folder / f"{i}.png"), np.full((16, 16), 2**bits - 9, np.uint16))
        (doubt,) = describe_pictures(folder, 30.0)
        assert f"no value above {2**bits - 9} of 65535" in doubt
        assert f"If the camera has {bits} bit, multiply the values by {factor}." in doubt
    cv2.imwrite(str(folder / "1.png"), np.full((16, 16), 2**15, np.uint16))
    assert not describe_pictures(folder, 30.0)


def test_a_file_of_many_pictures_is_not_taken_for_its_first(tmp_path):
    pages = [Image.new("L", (16, 16), 20 + 50 * i) for i in range(4)]
    folder = tmp_path / "clip"
    folder.mkdir()
    for suffix in ("tiff", "webp", "png"):
        file = folder / f"movie.{suffix}"
        pages[0].save(file, save_all=True, append_images=pages[1:])
        with pytest.raises(ValueError, match="it holds 4 pictures: convert it to a video or to"):
            find_recordings(file)
        (one,) = read_pictures(folder)
        assert (
            one.flaw == f"movie.{suffix} holds 4 pictures: convert it to a video or to single "
            "pictures"
        )
        file.unlink()
    pages[0].save(folder / "single.webp", lossless=True)
    assert read(folder)[0] == [0]


def test_a_missing_picture_leaves_a_gap_in_the_time(tmp_path):
    names = [f"left_{i:04}_640x480.png" for i in (7, 8, 10, 11, 15)]
    folder = write(tmp_path / "clip", names)
    _, numbers, times = read(folder, rate=10.0)
    assert numbers == [7, 8, 10, 11, 15]
    assert times == pytest.approx([0.7, 0.8, 1.0, 1.1, 1.5])
    (warning,) = describe_pictures(folder, 10.0)
    assert "4 frame numbers are missing in the names of the pictures (9, 12 to 14)" in warning


def test_a_number_that_two_pictures_have_counts_once(tmp_path):
    folder = write(tmp_path / "clip", ["p1.png", "p01.png", "p2.png", "p3.png", "p3.jpg"])
    pictures = list(read_pictures(folder, 30.0))
    assert [one.number for one in pictures] == [1, 1, 2, 3, 3]
    duplicate = "the picture has the same number as the one before"
    assert [one.flaw for one in pictures] == ["", duplicate, "", "", duplicate]
    (warning,) = describe_pictures(folder, 30.0)
    assert "2 pictures have the same number" in warning
    assert "p1.png after p01.png" in warning


@pytest.mark.parametrize(
    ("names", "why"),
    [
        (("left1.png", "left2.png", "right1.png"), "left1.png and right1.png differ in more than"),
        (("12-30-01.png", "12-31-00.png"), "differ in more than one number"),
        (("rest.png", "rest.jpg"), "there is no number in rest.jpg"),
        (("1714562345033.png", "1714562345066.png", "1714562345099.png"), "rise by 33, not by 1"),
        ((f"{2**60}.png", f"{2**60 + 1}.png"), "is too large"),
    ],
)
def test_names_that_do_not_number_pictures_are_counted_and_said(names, why):
    numbering = number_pictures(files(*names))
    assert numbering.numbers == tuple(range(len(names)))
    (warning,) = numbering.warnings
    assert "do not number the pictures" in warning
    assert why in warning


def test_one_picture_needs_no_number():
    assert number_pictures(files("rest.png")) == ((0,), ())
    assert number_pictures(files("rest7.png")) == ((7,), ())


def test_a_table_of_times_goes_by_frame_number(tmp_path):
    folder = write(tmp_path / "clip", ["1.png", "2.png", "3.png"])
    (folder / "times.csv").write_text("frame,time_s\n0,1.0\n1,1.5\n2,1.6\n")
    times = [one.time for one in read_pictures(folder, 5.0)]
    assert times == pytest.approx([1.5, 1.6, np.nan], nan_ok=True)
    unused, ignored = describe_pictures(folder, 5.0)
    assert "times.csv has times of 1 frame without a picture; the first is frame 0" in unused
    assert "5 pictures per second (--fps) is not used: times come from times.csv" in ignored
    (folder / "times.csv").write_text("frame,time_s\n1,0\n2,20\n3,40\n")  # in ms
    assert describe_pictures(folder) == ("the frames are 20 s apart: are the time stamps in s?",)
    (folder / "times.csv").write_text("time,force\n1,0\n")
    with pytest.raises(ValueError, match=r"lacks the columns frame, time_s.*; rename the file"):
        describe_pictures(folder)
    (folder / "times.csv").write_text("frame,time_s\n1,1.0\n2,1.5\n2,1.6\n")
    with pytest.raises(ValueError, match=r"times.csv.*frame 2 has the time 1.6 s here and 1.5 s"):
        list(read_pictures(folder))


def test_a_rate_is_not_used_where_times_are_known(tmp_path):
    write_archive(lift([0.0]), tmp_path / "lift.npz")
    recording = read_recording(tmp_path / "lift.npz", ImageSettings(rate=60.0))
    assert recording.time == pytest.approx(lift([0.0]).time)
    assert "is not used: times come from the recording" in recording.warnings[0]
    (ignored,) = describe_pictures(tmp_path / "clip.avi", 60.0)
    assert "is not used: times come from the video" in ignored
    assert describe_pictures(tmp_path / "clip.avi") == ()


@pytest.mark.parametrize("rate", [0.0, -30.0, np.inf, np.nan])
def test_rates_that_are_none_are_refused(rate):
    with pytest.raises(ValueError, match=r"pictures per second \(--fps\): it must be a number"):
        ImageSettings(rate=rate)


def test_recordings_are_named_by_file_or_folder_and_told_apart(tmp_path):
    write_archive(lift([0.0], name="as it was called"), tmp_path / "mine.npz")
    assert read_recording(tmp_path / "mine.npz").name == "mine"
    clip = write(tmp_path / "clip.v2", ["1.png"])
    assert name_recordings([clip, Path("camera:0")]) == ["clip.v2", "camera-0"]
    paths = [tmp_path / f"{one}/exp_1/camera_0.avi" for one in ("lemon", "avocado")]
    assert name_recordings(paths[:1]) == ["camera_0"]
    names = name_recordings([*paths, tmp_path / "avocado/exp_1/camera_2.avi"])
    assert names == ["lemon-exp_1-camera_0", "avocado-exp_1-camera_0", "camera_2"]
    alike = [Path("one.npz"), Path("one.avi"), Path("two.npz"), Path("./two.npz")]
    assert name_recordings(alike) == ["one.npz", "one.avi", "two-1", "two-2"]


def test_recordings_in_a_folder_are_found_in_natural_order(tmp_path):
    for i in (10, 9, 1):
        write_archive(lift([0.0]), tmp_path / f"lift{i}.npz")
    assert [one.stem for one in find_recordings(tmp_path)] == ["lift1", "lift9", "lift10"]
