"""Rendered clips with truth: an object whose texture prints through gel that it slips over."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from estimation.estimators.result import State
from estimation.frames.inspection import Fault
from estimation.frames.noise import Noise
from estimation.pictures.dots.find import DotStyle
from estimation.pictures.dots.reader import DotReader
from estimation.pictures.dots.strokes import find_strokes
from estimation.pictures.dots.style import find_dots
from estimation.pictures.imprint.follower import Imprint
from estimation.pictures.imprint.painted import paint_out
from estimation.pictures.imprint.standing import Standing
from estimation.pictures.lattice import lay_reference
from estimation.pictures.light import find_gain
from estimation.pictures.reader import ImageSettings
from estimation.pictures.region import region_of_print
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import Picture
from estimation.slip.motion import accumulate_slip
from estimation.sources import read_recording
from estimation.tracking.tracker import estimate_angles
from tests.cases import slow_case
from tests.estimation.pictures.scenes import PITCH, RADIUS, REST, picture, twisted

MIDDLE = np.array([160.0, 120.0])
SLOW = np.linspace(0.0, 2.4, 17)
"""The object creeps over gel that follows it by a third [deg]."""
FAST = 2.4 + np.array([3.0, 6.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0])
"""It jumps over gel that stands still, and rests [deg]."""
EMPTY = 9


def printed(object_deg, gel_deg, rng, there=True):
    """A coloured picture of the pad; the object's texture is lit from three sides."""
    fine = np.full((960, 1280), 180, np.uint8)  # four times as fine as the picture
    for x, y in np.rint(16 * (4.0 * twisted(gel_deg, rigid=40.0) + 1.5)).astype(int).tolist():
        cv2.circle(fine, (x, y), int(16 * 4 * RADIUS), 60, -1, shift=4)
    dots = cv2.resize(cv2.GaussianBlur(fine, (0, 0), 4.0), (320, 240), interpolation=cv2.INTER_AREA)
    dots = dots + rng.normal(0.0, 2.0, dots.shape)
    texture = np.random.default_rng(5).normal(0.0, 160.0, (3, 240, 320)).astype(np.float32)
    warp = cv2.getRotationMatrix2D(tuple(MIDDLE), -object_deg, 1.0)
    y, x = np.mgrid[:240, :320]
    touched = np.clip(1.5 - np.hypot(x - MIDDLE[0], y - MIDDLE[1]) / 60.0, 0.0, 1.0) * there
    planes = []
    for light in texture:
        relief = cv2.warpAffine(cv2.GaussianBlur(light, (0, 0), 3.0), warp, (320, 240))
        shown = np.where(dots < 120.0, 0.0, touched * relief)  # dots lie between gel and camera
        planes.append(np.clip(dots + shown, 0.0, 255.0))
    return np.stack(planes, axis=-1).astype(np.uint8)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A recording that starts loaded, and the object's angle while it touches [deg]."""
    folder, rng = tmp_path_factory.mktemp("printed"), np.random.default_rng(3)
    angle = np.concatenate([SLOW, FAST])
    gel = np.concatenate([SLOW / 3.0, np.full(len(FAST), 0.8)])
    frames = [printed(a, g, rng) for a, g in zip(angle, gel, strict=True)]
    frames += [printed(0.0, 0.0, rng, there=False) for _ in range(EMPTY)]
    for i, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{i:03d}.png"), frame)
    recording = read_recording(folder)
    return recording, estimate_angles(recording), angle


def test_slip_slow_and_fast_is_in_the_angle(clip):
    _, result, angle = clip
    found, low, high = (
        np.degrees(v[: len(angle)]) for v in (result.angle, result.low, result.high)
    )
    zero = found[0]
    # two registrations, 0.15° each
    assert np.abs(found - zero - angle).max() < 0.5
    assert ((low - zero <= angle) & (angle <= high - zero)).mean() > 0.93
    assert np.median(0.5 * (high - low)) < 0.6
    slip = np.degrees(accumulate_slip(result))[: len(angle)]
    assert slip[-1] - slip[0] == pytest.approx(angle[-1] - 0.8, abs=0.8)


@pytest.mark.parametrize(("there", "shown"), [(True, 3), (False, 3), (True, len(REST))])
def test_a_print_shows_the_contact_where_dots_are_not_recognised(there, shown):
    rng = np.random.default_rng(8)
    images = [printed(0.0, 0.0, rng, there) for _ in range(2)]
    for row, (x, y) in enumerate(np.rint(REST).astype(int).tolist()):
        if row % shown != 1:  # these dots are hidden
            cv2.circle(images[1], (x, y), int(2.0 * RADIUS), (180,) * 3, -1)
    pictures = [Picture(image, float(row), row) for row, image in enumerate(images)]
    reader = DotReader(pictures[0], ImageSettings(Sensor(dark=True, radius=RADIUS)))
    rows = [reader.read(one) for one in pictures]
    assert "dots were recognised" in rows[1].flaw
    assert not np.isfinite(rows[1].position).any()
    assert [row.contact.any() for row in rows] == [there] * 2
    if there:
        middle = reader.reference.position[rows[1].contact].mean(axis=0)
        assert np.linalg.norm(middle - MIDDLE) < PITCH


def test_a_fast_slip_is_macro_slip_and_the_rest_after_it_is_none(clip):
    _, result, angle = clip
    assert State.MACRO_SLIP not in result.state[: len(SLOW)]
    assert State.MACRO_SLIP in result.state[len(SLOW) : len(SLOW) + 6]
    assert result.state[len(angle) - 1] in (State.STICK, State.INCIPIENT)


def test_pictures_that_repeat_change_no_answer(clip, tmp_path):
    recording, _, _ = clip
    files = sorted(Path(recording.source).iterdir())
    for number, file in enumerate(np.repeat(files, 2).tolist()):
        shutil.copy(file, tmp_path / f"{number:03d}.png")
    stamps = "".join(f"{number},{number / 60.0}\n" for number in range(2 * len(files)))
    (tmp_path / "times.csv").write_text(f"frame,time_s\n{stamps}")
    noise = Noise.from_std(0.05, "px")
    once = estimate_angles(recording, noise=noise)
    twice = estimate_angles(read_recording(tmp_path), noise=noise)
    assert set(twice.reason[1::2]) - set(once.reason) == {Fault.REPEATS}
    assert list(twice.state) == np.repeat(once.state, 2).tolist()
    np.testing.assert_array_equal(twice.angle[::2], once.angle)


def test_an_object_that_is_printed_touches_and_a_pad_without_print_is_empty(clip):
    recording, result, angle = clip
    assert recording.contact[: len(angle)].any(axis=1).all()
    # the dots must rest for five frames before they are the reference
    assert set(result.state[-EMPTY + 6 :]) == {State.NO_CONTACT}


def test_a_scratch_in_the_gel_is_no_print():
    rng = np.random.default_rng(8)
    image = picture(REST, rng)
    cv2.line(image, (170, 100), (180, 112), 100, 2)
    level = paint_out(image[..., None], REST, RADIUS).level(REST, PITCH)
    assert level.max() > 5.0 * level.min()
    assert not region_of_print(lay_reference(REST, ""), level, False).any()


@pytest.mark.parametrize("width", [1, 2])
def test_a_hair_across_the_gel_is_no_print(width):
    """It is dark in every colour, like the dots; a slope faces only one of the lamps."""
    rng = np.random.default_rng(8)
    x = np.arange(30.0, 290.0)
    hair = np.stack([x, 90.0 + 30.0 * np.sin(x / 50.0)], axis=1).astype(np.int32)
    tint = np.array([0.8, 1.0, 0.9])
    images = [(tint * printed(0.0, 0.0, rng, there)).astype(np.uint8) for there in (False, True)]
    for image in images:
        cv2.polylines(image, [hair], isClosed=False, color=(40, 40, 40), thickness=width)
    pictures = [Picture(image, float(row), row) for row, image in enumerate(images)]
    reader = DotReader(pictures[0], ImageSettings(Sensor(dark=True, radius=RADIUS)))
    assert [reader.read(one).contact.any() for one in pictures] == [False, True]


def test_a_dark_picture_shows_as_much_print():
    """The bounds on texture are for pictures exposed as usual."""
    usual = printed(0.0, 0.0, np.random.default_rng(8))
    dark = np.rint(0.2 * usual.astype(float)).astype(np.uint8)
    gain = find_gain(dark)
    assert find_gain(usual) == 1.0
    assert 2.0 < gain < 4.0
    levels = [
        paint_out(one, REST, RADIUS, gain=factor).level(REST, PITCH)
        for one, factor in ((usual, 0.2 * gain), (dark, gain))
    ]
    assert levels[1] == pytest.approx(levels[0], rel=0.1, abs=0.1)  # one grey level is 3


def test_light_that_falls_towards_a_part_that_is_not_read_is_no_print():
    """A mean over the pixels that are read has the light of a place further in."""
    fall = np.linspace(1.0, 0.4, 320)[:, None]
    seen = np.zeros((240, 320), dtype=bool)
    seen[35:-35, 35:-35] = True
    inside = ((REST > 40.0) & (REST < (280.0, 200.0))).all(axis=1)
    ratio = {}
    for there in (False, True):
        image = (fall * printed(0.0, 0.0, np.random.default_rng(8), there)).astype(np.uint8)
        whole, part = (paint_out(image, REST, RADIUS, read) for read in (None, seen))
        ratio[there] = part.level(REST, PITCH)[inside] / whole.level(REST, PITCH)[inside]
    assert ratio[False].max() < 1.1  # 3.0 by a mean
    middle = np.linalg.norm(REST[inside] - MIDDLE, axis=1) < 2.0 * PITCH
    assert ratio[True][middle] == pytest.approx(1.0, abs=0.1)


def test_grey_shows_as_much_print_as_three_equal_colours():
    bare, strong = (printed(0.0, 0.0, np.random.default_rng(8), there) for there in (False, True))
    faint = cv2.addWeighted(bare, 0.8, strong, 0.2, 0.0)  # no spot is as dark as dirt
    grey = cv2.cvtColor(faint, cv2.COLOR_BGR2GRAY)
    three = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    levels = [paint_out(one, REST, RADIUS).level(REST, PITCH) for one in (grey, three)]
    assert levels[0] == pytest.approx(levels[1], rel=1e-4)


def test_a_grey_video_has_three_equal_channels():
    colours = printed(0.0, 0.0, np.random.default_rng(8))
    grey = cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)
    images = {"colours": colours, "grey": grey, "video": cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)}
    settings = ImageSettings(Sensor(marker="dots", dark=True, radius=RADIUS))
    found = {name: DotReader(Picture(one, 0.0, 0), settings).grey for name, one in images.items()}
    assert found == {"colours": False, "grey": True, "video": True}


def add_frame(image):
    """A black frame around the pad."""
    image[:22], image[-22:], image[:, :30], image[:, -30:] = 8, 8, 8, 8


def add_mirrors(image):
    """Mirrors at two sides."""
    image[:, :30] = 0.7 * image[:, 30:60][:, ::-1]
    image[:, -30:] = 0.7 * image[:, -60:-30][:, ::-1]


def add_mirror(image):
    """A mirror at one side, beyond the first row of dots."""
    image[:26] = 0.8 * image[26:52][::-1]


def add_text(image):
    """Lines of text."""
    for x, y in ((6, 16), (6, 34), (120, 230)):
        cv2.putText(image, "2024-05-01 12:00", (x, y), 0, 0.45, (255,) * 3, 1, cv2.LINE_AA)


@pytest.mark.parametrize(
    ("add", "empty"),
    [
        (add_mirror, 0),
        (add_text, 10),
        slow_case(add_frame, 10),
        slow_case(add_mirrors, 10),
    ],
)
def test_what_stands_still_in_the_pictures_is_no_print(tmp_path, add, empty):
    rng = np.random.default_rng(8)
    angle = np.concatenate([np.zeros(8), np.linspace(0.0, 9.0, 19), np.full(6, 9.0)])
    frames = [printed(0.0, 0.0, rng, there=False) for _ in range(empty)]
    frames += [printed(a, a, rng) for a in angle]
    for i, frame in enumerate(frames):
        add(frame)
        cv2.imwrite(str(tmp_path / f"{i:03d}.png"), frame)
    result = estimate_angles(read_recording(tmp_path))
    found, low, high = (np.degrees(v[empty:]) for v in (result.angle, result.low, result.high))
    answered = np.isfinite(found)
    assert answered.mean() > 0.9
    assert np.abs(found - angle)[answered].max() < 0.5
    assert ((low <= angle + 0.05) & (angle - 0.05 <= high))[answered].all()
    assert State.MACRO_SLIP not in result.state


def test_a_time_drawn_over_the_print_does_not_hold_it(tmp_path):
    """It hides dots in part, and its digits change."""
    rng = np.random.default_rng(8)
    angle = np.concatenate([np.zeros(4), np.linspace(0.0, 6.0, 13), np.full(4, 6.0)])
    for i, a in enumerate(angle):
        frame = printed(a, a / 3.0, rng)
        for row in (100, 130):
            cv2.putText(frame, f"12:00:{i / 25.0:05.2f}", (75, row), 0, 0.8, (255,) * 3, 2)
        cv2.imwrite(str(tmp_path / f"{i:03d}.png"), frame)
    result = estimate_angles(read_recording(tmp_path))
    found, low, high = (np.degrees(v) for v in (result.angle, result.low, result.high))
    assert np.abs(found - angle).max() < 0.5
    assert ((low <= angle + 0.05) & (angle - 0.05 <= high)).all()


@pytest.mark.parametrize(
    ("colour", "grey"),
    [
        ((255,) * 3, False),
        ((0, 255, 0), False),
        ((0,) * 3, False),
        ((255,) * 3, True),
        ((0,) * 3, True),
    ],
)
def test_drawn_text_is_no_part_of_a_print(colour, grey):
    plain = (0.6 * printed(0.0, 0.0, np.random.default_rng(8))).astype(np.uint8)
    drawn, text = plain.copy(), np.zeros(plain.shape[:2], np.uint8)
    cv2.putText(drawn, "12:00:00.00", (75, 130), 0, 0.8, colour, 2)
    cv2.putText(text, "12:00:00.00", (75, 130), 0, 0.8, 255, 2)
    without, painted = (
        paint_out(
            frame.mean(axis=-1, keepdims=True).astype(np.uint8) if grey else frame, REST, RADIUS
        )
        for frame in (plain, drawn)
    )
    assert without.without_overlays() is without
    shown = cv2.resize(painted.without_overlays().shown, None, fx=2, fy=2)
    assert shown[text > 0].mean() < 0.05


def test_a_speck_smaller_than_a_dot_is_no_text():
    speckled = printed(0.0, 0.0, np.random.default_rng(8))
    speckled[90:94, 80:84] = (0, 255, 0)
    painted = paint_out(speckled, REST, RADIUS)
    assert painted.without_overlays() is painted


@pytest.mark.parametrize("dark", [True, False])
def test_thin_text_as_dark_as_dots_is_found_and_a_print_is_not(dark):
    plain = printed(0.0, 0.0, np.random.default_rng(8)).mean(axis=-1).astype(np.uint8)
    drawn, text = plain.copy(), np.zeros(plain.shape, np.uint8)
    cv2.putText(drawn, "12:00:00.00", (75, 130), 0, 0.8, 60, 1, cv2.LINE_AA)
    cv2.putText(text, "12:00:00.00", (75, 130), 0, 0.8, 255, 1)
    style, found = DotStyle(dark, RADIUS), []
    for grey in (plain, drawn):
        grey = np.float32(grey if dark else 255 - grey)
        found.append(find_strokes(grey, find_dots(grey, style), style))
    assert found[0] is None
    off = np.linalg.norm(REST[:, None] - np.argwhere(text)[:, ::-1], axis=2).min(axis=0)
    apart = tuple(np.argwhere(text)[off > 2.5 * RADIUS].T)  # from the dots
    assert found[1][apart].mean() > 0.9
    assert found[1].mean() < 0.1


def test_marks_are_not_learnt_again_from_pictures_that_are_read_again():
    """Without a print that was rejected, the first frames of a contact may seem to have none."""
    painted = paint_out(printed(0.0, 0.0, np.random.default_rng(8)), REST, RADIUS)
    first, again = Standing(), Standing()
    again.take_over(Standing())
    for standing in (first, again):
        for _ in range(5):
            standing.learn(painted, touched=False)
    assert first.hidden is not None
    assert again.hidden is None


@pytest.mark.parametrize(("sheared", "strained"), [(False, False), (False, True), (True, False)])
def test_a_print_stands_still_only_if_its_place_and_the_gel_at_rest_are_known(sheared, strained):
    """A search has just found it again, perhaps at a wrong place; or loaded gel relaxes.

    Or gel is sheared around an object at rest, and does not turn as one body.
    """
    reference = lay_reference(REST, "laid")._replace(strained=strained)
    place = (REST - REST.mean(axis=0)) @ np.array([1.0, 1.0j])
    far = np.abs(place) / np.abs(place).max()
    place = place * np.exp(0.09j * (far**2 if sheared else 1.0))
    turned = np.stack([place.real, place.imag], axis=1) + REST.mean(axis=0)
    painted = paint_out(printed(0.0, 0.0, np.random.default_rng(8)), REST, RADIUS)
    contact, place = np.ones(len(REST), dtype=bool), (*REST[0], *REST[0], 0.1, 0.1, 0.0)
    for point, stands in ((place, True), ((np.nan,) * 7, False)):
        standing = Standing()
        standing.find(painted, reference, REST, contact, 0, Imprint(0.0, 0.0, 1.0, place))
        again = Imprint(0.001, 0.05, 0.9, point)
        found = bool(standing.find(painted, reference, turned, contact, 1, again))
        assert found == (stands and not (strained or sheared))


def test_a_print_is_no_contact_where_marks_were_taken_for_one():
    first = Picture(printed(0.0, 0.0, np.random.default_rng(8)), time=0.0, number=0)
    reader = DotReader(first, ImageSettings(Sensor(marker="dots", dark=True, radius=RADIUS)))
    assert reader.read(first).contact.any()
    reader.standing.found = True
    assert not reader.read(first._replace(time=0.1, number=1)).contact.any()


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_print_behind_which_gel_turns_further_is_doubted(share):
    """An object drags gel along, but turns none further than itself: marks hold such a print."""
    rng = np.random.default_rng(8)
    gel = [0.0, 0.0, 0.5, 2.0, 2.3, 2.3]
    frames = [printed(share * a, a, rng) for a in gel]
    pictures = [Picture(frame, 0.04 * i, i) for i, frame in enumerate(frames)]
    reader = DotReader(pictures[0], ImageSettings(Sensor(marker="dots", dark=True, radius=RADIUS)))
    rows = [reader.read(one) for one in pictures[:5]]
    assert np.isfinite([row.imprint for row in rows]).all()
    assert [row.flaw for row in rows][:3] == [""] * 3
    held = share < 1.0
    assert ("the gel turns further than the print" in rows[-1].flaw) == held
    likely = 1.96  # standard errors: the interval reaches beyond the gel
    turned, error = (np.degrees(abs(value)) for value in (rows[-1].imprint, rows[-1].imprint_error))
    assert (turned + likely * error > 2.3 + 1.0) == held


def reflect(image, side, width, bright):
    """The picture with a mirror along a side."""
    turned = np.rot90(image, side).copy()
    turned[:width] = bright * turned[width : 2 * width][::-1]
    return np.ascontiguousarray(np.rot90(turned, -side))


def test_a_clip_that_starts_in_contact_is_read_without_its_mirror(tmp_path):
    rng = np.random.default_rng(8)
    angle = np.concatenate([np.zeros(4), np.linspace(0.0, 6.0, 13), np.full(4, 6.0)])
    for i, a in enumerate(angle):
        frame = reflect(printed(a, a, rng), side=0, width=30, bright=0.85)
        cv2.imwrite(str(tmp_path / f"{i:03d}.png"), frame)
    recording = read_recording(tmp_path)
    assert any("mirrors" in note for note in recording.notes)
    result = estimate_angles(recording)
    found, low, high = (np.degrees(v) for v in (result.angle, result.low, result.high))
    assert np.isfinite(found).mean() > 0.9
    assert np.nanmax(np.abs(found - found[0] - angle)) < 0.3
    assert ((low <= angle + 0.05) & (angle - 0.05 <= high))[np.isfinite(found)].all()
