"""Pictures given one by one are answered as a folder of them is, and errors help."""

import cv2
import numpy as np
import pytest

from estimation.frames.noise import Noise
from estimation.frames.recording import layout_markers
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import PictureSource
from estimation.pictures.sensor import Sensor
from estimation.pictures.still import Still
from estimation.settings import Settings
from estimation.softness import LayeredSoftness
from estimation.tracking.image_tracker import ImageTracker
from estimation.tracking.stream import Stream
from estimation.tracking.tracker import Tracker
from tests.fuzz.inputs import GRID, RADIUS, dots

NOISE = Noise.from_std(0.02, "px")
SENSOR = Sensor(marker="dots", radius=RADIUS, dark=True)


def settings(**images):
    return Settings(noise=NOISE, images=ImageSettings(SENSOR, **images))


def test_pictures_one_by_one_are_a_folder_of_them(tmp_path):
    for i, image in enumerate(dots()):
        cv2.imwrite(str(tmp_path / f"{i}.png"), image)
    source = PictureSource(tmp_path, ImageSettings(SENSOR))
    tracker = ImageTracker(settings())
    found = [tracker.update(image, i / 30.0) for i, image in enumerate(dots())]
    other = Tracker(source.layout, noise=NOISE)
    expected = [other.update(frame) for frame in source]
    assert [one.angle for one in found] == pytest.approx(
        [one.angle for one in expected], abs=0.0, nan_ok=True
    )
    assert [one.source_index for one in found] == list(range(len(found)))
    assert [one.state for one in found] == [one.state for one in expected]


def test_alert_and_shear_are_those_of_a_stream(tmp_path):
    for i, image in enumerate(dots()):
        cv2.imwrite(str(tmp_path / f"{i}.png"), image)
    tracker = ImageTracker(settings())
    assert (tracker.alert.level, tracker.shear.slides) == ("unknown", False)
    found = []
    for i, image in enumerate(dots()):
        tracker.update(image, i / 30.0)
        found.append((tracker.alert, tracker.shear))
    answers = Stream(PictureSource(tmp_path, settings().images), settings()).answers()
    for (alert, shear), expected in zip(found, answers, strict=True):
        assert alert.level == expected.alert.level
        np.testing.assert_allclose(alert[1:], expected.alert[1:], rtol=1e-6)
        np.testing.assert_allclose(shear, expected.shear, rtol=1e-5)
    assert len({alert.level for alert, _ in found}) > 1


def test_an_unloaded_picture_is_the_reference(tmp_path):
    first, *others = dots()
    tracker = ImageTracker(settings(unloaded=Still(tmp_path / "rest.png", first)))
    rest = tracker.reader.layout.reference
    assert len(rest) == len(GRID)
    for i, image in enumerate(others):
        tracker.update(image, i / 30.0)
    np.testing.assert_array_equal(tracker.tracker.layout.reference, rest)
    with pytest.raises(ValueError, match=r"give the unloaded picture, ImageSettings"):
        ImageTracker(settings(unloaded=3))


def test_a_picture_may_have_one_channel():
    one, other = ImageTracker(settings()), ImageTracker(settings())
    for i, image in enumerate(dots()[:2]):
        found = one.update(image[..., None], i / 30.0)
        assert found.state == other.update(image, i / 30.0).state


def test_a_better_reference_takes_the_frames_so_far_with_it():
    tracker = ImageTracker(settings())
    first, second, third, *_ = dots()
    tracker.update(first, 0.0)
    before, reader = tracker.tracker, tracker.reader
    reader.provisional = True
    tracker.update(second, 0.1)
    reader.provisional, reader.layout = False, layout_markers(reader.layout.reference + 0.5)
    answer = tracker.update(third, 0.2)
    assert tracker.tracker is not before
    assert tracker.tracker.layout is reader.layout
    assert answer.source_index == 2


def test_an_unloaded_picture_is_an_array_or_a_file(tmp_path):
    first, second, *_ = dots()
    cv2.imwrite(str(tmp_path / "rest.png"), first)
    angles = []
    for unloaded in (first, tmp_path / "rest.png", str(tmp_path / "rest.png")):
        tracker = ImageTracker(settings(unloaded=unloaded))
        angles.append(tracker.update(second, 0.1).angle)
    assert np.array_equal(angles, angles[:1] * 3, equal_nan=True)
    with pytest.raises(FileNotFoundError, match="given as the unloaded picture"):
        settings(unloaded="nowhere.png")


def test_noise_and_softness_in_another_unit_than_the_lengths_are_refused():
    with pytest.raises(ValueError, match=r"given in mm, but .* in px: use Noise.from_std"):
        ImageTracker(Settings(noise=Noise.from_std(0.02), images=ImageSettings(SENSOR)))
    with pytest.raises(ValueError, match="the pictures: lengths are in px"):
        ImageTracker(Settings(softness=LayeredSoftness(0.5, 3.0), images=ImageSettings(SENSOR)))


@pytest.mark.usefixtures("unchecked")
def test_what_is_no_picture_frame_or_layout_is_named():
    with pytest.raises(ValueError, match=r"settings are expected, got ImageSettings"):
        ImageTracker(ImageSettings(SENSOR))
    tracker = ImageTracker(settings())
    dark = tracker.update(np.zeros((108, 128), np.uint8), 0.0)
    assert (dark.state, dark.reason) == ("unknown", "the picture is black")
    deep = tracker.update(np.full((108, 128), 1900, np.uint16), 0.1)
    assert deep.reason == (
        "the picture is black: no value above 1900 of 65535; multiply values of 10, 12 "
        "or 14 bit by 64, 16 or 4"
    )
    for wrong, got in (
        (3.0, "float"),
        ("clip.avi", "str"),
        (np.zeros(4), r"\(4,\)"),
        (np.zeros((9, 9, 2)), r"\(9, 9, 2\)"),
    ):
        with pytest.raises(ValueError, match=rf"a picture is expected, .* got {got}"):
            tracker.update(wrong, 0.0)
    for light in (dots()[0] / 255.0, dots()[0].astype(np.int64)):
        with pytest.raises(ValueError, match=rf"type {light.dtype}, expected uint8 .*astype"):
            tracker.update(light, 0.0)
    for clock in (np.datetime64("2026-01-01T00:00:00"), np.timedelta64(1, "s"), "0.1"):
        with pytest.raises(ValueError, match=rf"in seconds .* got {type(clock).__name__}"):
            tracker.update(dots()[0], clock)
    assert tracker.update(dots()[0], 0.1).reason
    smaller = tracker.update(dots()[0][:-8], 0.2)
    assert smaller.reason == "the picture is 128×100, the others are 128×108"
    coloured = tracker.update(cv2.cvtColor(dots()[0], cv2.COLOR_GRAY2BGR), 0.3)
    assert coloured.reason == "the picture is in colour, the others are grey"
    with pytest.raises(ValueError, match=r"a layout is expected, got ndarray: .*layout_markers"):
        Tracker(GRID)
    with pytest.raises(ValueError, match=r"a softness is expected, got 0.3: .*ScalarSoftness"):
        Tracker(layout_markers(GRID), softness=0.3)
    with pytest.raises(ValueError, match=r"a frame is expected, got ndarray: .*update_positions"):
        Tracker(layout_markers(GRID)).update(GRID)
    with pytest.raises(ValueError, match=r"has 3 markers, the layout 30: keep a row"):
        Tracker(layout_markers(GRID)).update_positions(GRID[:3], 0.0)


def test_a_first_picture_without_markers_names_the_settings_of_a_loop():
    grey = np.full((120, 160), 128, dtype=np.uint8)
    with pytest.raises(ValueError, match=r"no rows of dots.*Sensor\(marker=…, radius=…"):
        ImageTracker(Settings(images=ImageSettings(Sensor(marker="dots")))).update(grey, 0.0)


def test_a_black_unloaded_picture_is_refused():
    black = ImageSettings(unloaded=np.zeros((120, 160), dtype=np.uint8))
    with pytest.raises(ValueError, match="the unloaded picture shows no markers: the picture is b"):
        ImageTracker(Settings(images=black))
