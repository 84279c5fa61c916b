"""Pictures as recordings: videos, folders, and what can be wrong with them."""

import struct
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from rich.progress import Progress
from typer.testing import CliRunner

from estimation.__main__ import app
from estimation.frames.extras import EXTRA_PACKAGES
from estimation.frames.noise import Noise
from estimation.inputs import Input
from estimation.output import preview
from estimation.output.record import RecordReader
from estimation.output.sinks.lines import LineWriter
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource, read_images
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import read_pictures
from estimation.run import run_all
from estimation.settings import Settings
from estimation.sources import open_source, read_recording
from tests.cases import rows_of
from tests.estimation.pictures.scenes import REST, picture, twisted

ANGLES = (0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0)


@pytest.fixture(scope="module")
def pictures():
    rng = np.random.default_rng(0)
    return [picture(twisted(angle, rigid=50.0), rng) for angle in ANGLES]


def write_folder(folder, images, name="{:04}.png", start=0):
    folder.mkdir()
    for i, image in enumerate(images, start):
        cv2.imwrite(str(folder / name.format(i)), image)
    return folder


def write_video(path, images):
    grey = images[0].ndim == 2
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "gray" if grey else "bgr0"
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="gray" if grey else "bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def rotation_of_the_middle(recording):
    """Rigid rotation of the dots that were turned rigidly [deg]."""
    rest = recording.layout.reference
    inner = np.linalg.norm(rest - np.array([160.0, 120.0]), axis=1) < 50.0
    to_complex = np.array([1.0, 1.0j])
    before = rest[inner] @ to_complex
    after = recording.positions[:, inner] @ to_complex
    arm = before - before.mean()
    return np.degrees(np.angle((np.conj(arm) * (after - after.mean(axis=1)[:, None])).sum(axis=1)))


def test_video_and_folder_give_the_same(pictures, tmp_path):
    video = read_recording(write_video(tmp_path / "clip.mkv", pictures))
    folder = read_recording(write_folder(tmp_path / "clip", pictures))
    assert np.array_equal(video.positions, folder.positions)
    source = PictureSource(str(tmp_path / "clip"))  # as text, as `read_recording` takes it
    assert (source.path, source.name) == (tmp_path / "clip", "clip")
    assert video.unit == "px"
    assert video.time == pytest.approx(np.arange(len(ANGLES)) / 25.0)
    # 13 dots with a lever of 35 px and 0.01 px of noise: 0.005°, five times that
    assert rotation_of_the_middle(video) == pytest.approx(ANGLES, abs=0.025)
    assert "unloaded" in " ".join(video.notes)
    assert not video.contact[0].any()
    assert video.contact[-1].any()


def test_a_loaded_start_is_counted_from_the_rest_that_follows(tmp_path):
    rng = np.random.default_rng(3)
    angles = (8.0, 7.0, *(0.0,) * 6, 3.0)
    images = [picture(twisted(angle, rigid=50.0), rng) for angle in angles]
    settings = ImageSettings(Sensor(dark=True, radius=4.3))
    recording = read_recording(write_folder(tmp_path / "clip", images), settings)
    assert "the reference is frame 6" in " ".join(recording.notes)
    assert recording.contact.any(axis=1)[[0, 1, 6, 7, 8]].tolist() == [
        True,
        True,
        False,
        False,
        True,
    ]
    # against one frame at rest: as above, with noise from both
    assert rotation_of_the_middle(recording) == pytest.approx(angles, abs=0.035)


def test_scale_turns_px_to_mm(pictures, tmp_path):
    folder = write_folder(tmp_path / "clip", pictures[:2])
    in_px = read_images(folder)
    in_mm = read_images(folder, ImageSettings(Sensor(mm_per_px=0.04), unloaded=0))
    assert in_mm.unit == "mm"
    assert in_mm.positions == pytest.approx(0.04 * in_px.positions)


def test_sidecar_gives_the_time(pictures, tmp_path):
    folder = write_folder(tmp_path / "clip", pictures[:3])
    (folder / "times.csv").write_text("frame,time_s\n0,1.0\n1,1.5\n2,1.6\n")
    assert [p.time for p in read_pictures(folder)] == [1.0, 1.5, 1.6]
    (folder / "times.csv").write_text("frame,when\n0,1.0\n")
    with pytest.raises(ValueError, match="time_s"):
        list(read_pictures(folder))


def test_bad_pictures_are_labelled(pictures, tmp_path):
    images = list(pictures)
    images[1] = np.zeros_like(images[1])
    images[2] = np.full_like(images[2], 255)
    images[3] = images[3][:200]
    folder = write_folder(tmp_path / "clip", images)
    (folder / "0004.png").write_bytes(b"no image")
    recording = read_recording(folder)
    words = ["", "black", "saturated", "320×200", "0004.png", "", ""]
    for flaw, word in zip(recording.flaws, words, strict=True):
        assert word in flaw
        assert bool(flaw) == bool(word)
    assert recording.valid[-1].all()


def test_colour_and_16_bit_are_read_like_grey_and_8_bit(pictures, tmp_path):
    grey = pictures[4]
    kinds = {
        "grey": grey,
        "deep": grey.astype(np.uint16) * 257,
        "colour": cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR),
        "deep colour": cv2.cvtColor(grey.astype(np.uint16) * 257, cv2.COLOR_GRAY2BGR),
    }
    settings = ImageSettings(Sensor(dark=True, radius=4.3))
    found = [
        read_images(write_folder(tmp_path / name, [image]), settings).positions
        for name, image in kinds.items()
    ]
    for positions in found[1:]:
        assert positions == pytest.approx(
            found[0], abs=1e-3, nan_ok=True
        )  # single precision's rounding


def test_a_truncated_video_keeps_what_was_read(pictures, tmp_path):
    path = write_video(tmp_path / "clip.mkv", pictures)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.6 * len(content))])
    recording = read_recording(path)
    assert 1 < len(recording) <= len(ANGLES)
    assert recording.valid[0].all()
    assert "missing" in recording.flaws[-1]


def test_what_is_no_video_is_refused(tmp_path):
    path = tmp_path / "clip.avi"
    path.write_bytes(b"not a video" * 100)
    with pytest.raises(ValueError, match=r"no video, empty, or damaged$"):
        read_recording(path)
    broken_off = path.with_suffix(".mp4")
    path.rename(broken_off)
    with pytest.raises(ValueError, match="MP4 and MOV cannot be read if the recording broke off"):
        read_recording(broken_off)


def test_a_bomb_is_refused_before_it_is_decoded(tmp_path):
    folder = tmp_path / "bomb"
    folder.mkdir()
    header = np.zeros((1, 1), np.uint8)
    cv2.imwrite(str(folder / "0.png"), header)
    content = bytearray((folder / "0.png").read_bytes())
    content[16:24] = (30000).to_bytes(4, "big") * 2
    import zlib

    content[29:33] = zlib.crc32(bytes(content[12:29])).to_bytes(4, "big")
    (folder / "0.png").write_bytes(bytes(content))
    with pytest.raises(ValueError, match=r"30000|bomb"):
        read_recording(folder)


@pytest.mark.parametrize("size", [12000, 65000])
def test_a_video_bomb_is_refused_and_one_in_the_middle_ends_the_video(tmp_path, size):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for _ in range(2):
        writer.write(np.full((48, 64, 3), 99, np.uint8))
    writer.release()
    content, own = path.read_bytes(), struct.pack(">HH", 48, 64)
    assert content.count(own) == 2  # in each picture's JPEG header
    claimed = struct.pack(">HH", size, size)
    in_front = content.replace(struct.pack("<ii", 64, 48), struct.pack("<ii", size, size))
    path.write_bytes(in_front.replace(own, claimed))
    with pytest.raises(ValueError, match=f"declares ({size}|no size)"):
        list(read_pictures(path))
    last = content.rindex(own)
    path.write_bytes(content[:last] + claimed + content[last + 4 :])
    first, second = read_pictures(path)
    assert not first.flaw
    assert "damaged from here on" in second.flaw


def test_a_video_without_a_known_codec_or_size_is_refused(pictures, tmp_path):
    path = write_video(tmp_path / "clip.mkv", pictures[:2])
    path.write_bytes(path.read_bytes().replace(b"V_FFV1", b"V_NONE"))
    with pytest.raises(ValueError, match=r"clip\.mkv is damaged: it declares no codec"):
        read_recording(path)


def test_a_picture_too_small_for_markers_is_labelled(pictures, tmp_path):
    folder = write_folder(tmp_path / "clip", [pictures[0][:1], *pictures[:2]])
    small, *others = read_pictures(folder)
    assert small.flaw == "the picture is 320×1, too small to show markers"
    assert not any(one.flaw for one in others)


def test_nothing_usable_is_refused(tmp_path):
    black = [np.zeros((240, 320), np.uint8)] * 2
    with pytest.raises(ValueError, match="black"):
        read_recording(write_folder(tmp_path / "clip", black))
    rng = np.random.default_rng(0)
    nothing = {
        "flat": np.full((240, 320), 99, np.uint8),
        "noise": rng.normal(99.0, 4.0, (240, 320)).astype(np.uint8),
        "few": picture(REST[:7], rng),
    }
    for name, image in nothing.items():
        with pytest.raises(ValueError, match="no rows of dots"):
            read_recording(write_folder(tmp_path / name, [image] * 2))


def test_a_camera_is_answered_picture_by_picture_and_keeps_what_it_gave(
    pictures, monkeypatch, tmp_path, capsys
):
    printed = []

    class Unplugged:
        def __init__(self, device):
            assert device == 0
            self.left = [pictures[0], None, *(pictures[i] for i in (1, 4, 5))]  # a read fails

        def isOpened(self):
            return True

        def read(self):
            image = self.left.pop(0) if self.left else None
            if image is not None or (not self.left and len(printed) < 5):
                printed.append(capsys.readouterr().out)  # what was answered before this picture
            return image is not None, image

        def release(self):
            pass

    monkeypatch.setattr(cv2, "VideoCapture", Unplugged)
    known = ImageSettings(Sensor(dark=True, radius=4.3))
    settings = Settings(images=known, noise=Noise.from_std(0.01, "px"))
    source = open_source(Path("camera:0"), known, "camera")
    lines = [LineWriter(print, "tracked")]
    outcome = run_all([Input(source)], tmp_path, settings, Progress(disable=True), lines)
    assert not outcome.interrupted
    with RecordReader(tmp_path / "record.sqlite") as record:
        assert record.track("tracked").reason[4] == "the camera was disconnected"
    lines = [text.strip().splitlines() for text in (*printed, capsys.readouterr().out)]
    assert lines[0] == []
    assert lines[1][0] == LineWriter.header
    assert [len(one) for one in lines[1:]] == [2, 1, 1, 1, 1]
    cells = [one[-1].split(",") for one in lines[1:]]
    assert [one[2] for one in cells[:2]] == ["no_contact"] * 2
    assert "the camera was disconnected" in cells[4][-1]
    # a dozen dots that stick, 35 px from their middle, 0.01 px each: 0.005°, and some slip unseen
    assert [float(one[3]) for one in cells[2:4]] == pytest.approx([3.0, 4.0], abs=0.1)


def test_a_noise_in_another_unit_is_refused(pictures, tmp_path):
    folder = write_folder(tmp_path / "clip", pictures)
    arguments = ["run", str(folder), "--out", str(tmp_path / "out"), "--noise-um", "10"]
    refused = CliRunner().invoke(app, arguments)
    assert "noise is given in mm, lengths are in px" in str(refused.exception)
    refused = CliRunner().invoke(app, [*arguments, "--noise-px", "0.01"])
    assert "give one of --noise-um, --noise-px" in str(refused.exception)
    assert not (tmp_path / "out").exists()


def test_wrong_settings_are_refused(pictures, tmp_path):
    with pytest.raises(ValueError, match="mm_per_px is -1"):
        Sensor(mm_per_px=-1.0)
    folder = write_folder(tmp_path / "clip", pictures[:2])
    with pytest.raises(ValueError, match="no frame 9"):
        read_images(folder, ImageSettings(unloaded=9))
    with pytest.raises(ValueError, match="dots lie in rows"):
        read_images(folder, ImageSettings(Sensor(dark=False, radius=4.3)))
    with pytest.raises(ValueError, match="25 px at most"):
        read_images(folder, ImageSettings(Sensor(dark=True, radius=200.0)))


def test_a_folder_is_run_in_natural_order_with_warnings_and_a_preview(pictures, tmp_path):
    odd = [one[:-1, :-1] for one in pictures]
    folder = write_folder(tmp_path / "clip", odd, "frame{}.png", start=7)
    (folder / "frame13.png").rename(folder / "frame15.png")
    cv2.imwrite(str(folder / "frame6.png"), odd[0][:60, :80])  # the preview leaves it out
    numbers, out = [7, 8, 9, 10, 11, 12, 15], tmp_path / "out"
    options = ["--out", str(out), "--preview", "--noise-px", "0.01", "--unloaded-frame", "8"]
    done = CliRunner().invoke(app, ["run", str(folder), *options])
    assert done.exit_code == 0, done.output
    small, *rows = rows_of(out / "angles.csv")
    assert small["reason"] == "the picture is 80×60, the others are 319×239"
    assert [int(row["source_index"]) for row in rows] == numbers
    times = np.array(numbers) / 30.0
    assert [float(row["time_s"]) for row in rows] == pytest.approx(times, abs=1e-6)
    # a dozen dots that stick: as for the camera above
    assert [float(row["angle_deg"]) for row in rows][3:] == pytest.approx(ANGLES[3:], abs=0.15)
    for text in (
        done.stderr,
        (out / "summary.json").read_text(),
        (out / "report.html").read_text(),
    ):
        assert "30 pictures per second are assumed" in text
        assert "2 frame numbers are missing" in text
    frames = list(read_pictures(out / "preview.mp4"))
    assert [one.flaw for one in frames] == [""] * len(pictures)
    assert frames[0].image.shape == (3 * 239 + 2 * 29 + 1, 3 * 319 + 1, 3)  # two lines of text
    shown = np.array([one.time for one in frames])
    assert shown[0] == pytest.approx(
        times[0] - 6.0 / 30.0, abs=5e-4
    )  # an MP4 holds its start in ms
    assert shown - shown[0] == pytest.approx(times - times[0], abs=1e-4)
    content = (out / "preview.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")  # plays before it is whole
    with av.open(str(out / "preview.mp4")) as container:
        (stream,) = container.streams
        assert (stream.codec.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert container.duration / av.time_base > times[-1] - times[0]


def test_times_that_are_none_get_a_place_in_a_preview():
    time = np.array([np.nan, 5.0, 5.1, np.nan, 99.0, 5.4, 5.5, 5.0, np.nan])
    ticks = preview.to_ticks(time) / preview.TICKS_PER_SECOND
    assert ticks == pytest.approx(0.1 * np.arange(9), abs=1e-4)
    assert preview.to_ticks(np.full(3, np.nan)) == pytest.approx([0, 3000, 6000])
    assert (np.diff(preview.to_ticks(np.array([0.0, 1e-9, 2e-9]))) > 0).all()


def test_a_preview_that_cannot_be_written_is_refused_before_the_run(monkeypatch, tmp_path):
    monkeypatch.setattr(preview, "H264_ENCODERS", ("no_encoder",))
    with pytest.raises(ValueError, match=r"needs an H.264 encoder, no_encoder; .*--force-reinst"):
        run_all([], tmp_path, Settings(preview=True), Progress(disable=True))
    monkeypatch.setitem(EXTRA_PACKAGES, "video", ("no_package",))
    with pytest.raises(ValueError, match=r"preview.*needs no_package.*contactmodel\[video\]"):
        run_all([], tmp_path, Settings(preview=True), Progress(disable=True))
