"""The contact region from one view: by how far dots have gone, and by how light has changed."""

import cv2
import numpy as np
import pytest

from estimation.estimators.result import State
from estimation.frames.noise import Noise
from estimation.frames.recording import Flaw
from estimation.pictures.dots.departure import Departure
from estimation.pictures.dots.light_touch import LightTouch
from estimation.pictures.dots.stirred import StirredGel
from estimation.pictures.imprint.painted import Painted, paint_out
from estimation.pictures.lattice import make_reference
from estimation.pictures.reader import ImageSettings
from estimation.pictures.region import (
    Arrival,
    Bare,
    find_unseen_flaw,
    region_of_dispersion,
    region_of_light,
    region_of_shade,
)
from estimation.pictures.sensor import Sensor
from estimation.sources import read_recording
from estimation.tracking.tracker import estimate_angles
from tests.estimation.pictures.scenes import PITCH, REST, picture, twisted
from tests.estimation.pictures.scenes import RADIUS as DOT
from tests.estimation.pictures.test_reading import write_folder

MIDDLE, RADIUS = np.array([160.0, 120.0]), 70.0
REFERENCE = make_reference(REST, (320, 240))


def lit(image, change):
    """The picture with more light where the object touches, its rim as soft as a gel's."""
    spot = np.zeros(image.shape, np.float32)
    cv2.circle(spot, (160, 120), int(RADIUS), 1.0, -1)
    return np.clip(image + change * cv2.GaussianBlur(spot, (0, 0), 6.0), 0, 255).astype(np.uint8)


def test_a_first_frame_that_only_looks_unloaded_is_given_up(tmp_path):
    rng = np.random.default_rng(7)
    arm = REST - MIDDLE
    bump = 0.055 * PITCH * arm / 40.0 * np.exp(0.5 - 0.5 * (arm**2).sum(axis=1) / 40.0**2)[:, None]
    images = [picture(REST + share * bump, rng) for share in (1.0,) * 4 + (0.0,) * 7]
    recording = read_recording(write_folder(tmp_path / "clip", images))
    assert "the reference is frame 8" in " ".join(recording.notes)
    assert recording.contact.any(axis=1).tolist() == [True] * 4 + [False] * 7
    near = np.abs(recording.layout.reference[:, None] - REST).max(axis=2).min(axis=1)
    assert near.max() < 0.1  # px


@pytest.mark.parametrize("change", [25.0, -25.0])
def test_light_tells_where_the_object_touches(change):
    rng = np.random.default_rng(0)
    before, now = picture(REST, rng), lit(picture(REST, rng), change)
    region = region_of_light(REFERENCE, before, now, REFERENCE.position)
    from_middle = np.linalg.norm(REFERENCE.position - MIDDLE, axis=1)
    # the smoothing, half a pitch wide, shifts the rim by less than a pitch
    assert region[from_middle < RADIUS - 0.7 * PITCH].all()
    assert not region[from_middle > RADIUS + 0.7 * PITCH].any()


def test_no_change_of_light_is_no_contact():
    rng = np.random.default_rng(1)
    before, now = picture(REST, rng), picture(REST, rng)
    assert not region_of_light(REFERENCE, before, now, REFERENCE.position).any()
    faint = lit(now, 0.7 * 6.0)
    assert not region_of_light(REFERENCE, before, faint, REFERENCE.position).any()


def test_colour_and_16_bit_tell_the_same():
    rng = np.random.default_rng(2)
    before, now = picture(REST, rng), lit(picture(REST, rng), 25.0)
    grey = region_of_light(REFERENCE, before, now, REFERENCE.position)
    deep = [one.astype(np.uint16) * 257 for one in (before, now)]
    assert np.array_equal(region_of_light(REFERENCE, *deep, REFERENCE.position), grey)
    colour = [np.stack([one, before, before], axis=-1) for one in (before, now)]
    assert np.array_equal(region_of_light(REFERENCE, *colour, REFERENCE.position), grey)


@pytest.mark.parametrize(
    ("bright", "texture", "touched"),
    [
        (lambda near: 20.0 * near, 2.0, True),
        (lambda near: 20.0 * near, 0.5, False),  # the earlier picture showed an object
        (lambda near: 20.0 + 0.0 * near, 2.0, False),  # a lamp
        (lambda near: 4.0 * near, 2.0, False),
    ],
)
def test_shade_in_part_of_the_picture_tells_a_smooth_object(bright, texture, touched):
    near = np.linalg.norm(REST - REST.mean(axis=0), axis=1) < 2.5 * REFERENCE.pitch
    before = Bare(np.full((len(REST), 3), 100.0), np.full(len(REST), 1.0))
    light = before.light + bright(near)[:, None] * [1.0, 0.5, -0.5]
    now = Bare(light, np.where(near, texture, 1.0))
    region = region_of_shade(REFERENCE, before, now)
    assert np.array_equal(region, near & touched)


def spotted(place, rng):
    """A pad with three small spots of an object that touches it between the dots."""
    light = np.zeros((240, 320), np.float32)
    for shift in (-PITCH, 0.0, PITCH):
        x, y = np.rint(np.add(place, [shift + 0.5 * PITCH, 0.5 * PITCH])).astype(int).tolist()
        cv2.circle(light, (x, y), 5, 60.0, -1)
    image = picture(REST, rng) + cv2.GaussianBlur(light, (0, 0), 1.5)
    return np.clip(image, 0, 255).astype(np.uint8)


def lamps(rng):
    """A pad without an object under lamps that are a fifth brighter, more so on one side."""
    light = picture(REST, rng) * np.linspace(1.1, 1.3, 320)
    return np.clip(light, 0, 255).astype(np.uint8)


def find_light_touches(images, touched=0):
    """Dots by frame under light touches, after some frames of another contact."""
    watched = LightTouch()
    painted = [paint_out(image, REST, DOT) for image in images]
    return [watched.find(one, REST, PITCH, row < touched) for row, one in enumerate(painted)]


def test_a_touch_that_moves_no_dot_shows_in_the_light():
    rng = np.random.default_rng(11)
    bare, touch = [picture(REST, rng) for _ in range(8)], spotted(REST[40], rng)
    *before, found, changed, again = find_light_touches([*bare, touch, lamps(rng), touch], 1)
    assert not np.any([*before, changed])
    near = np.linalg.norm(REST - REST[40] - 0.5 * PITCH, axis=1)
    assert found[near < PITCH].all()
    assert not found[near > 2.5 * PITCH].any()
    assert np.array_equal(again, found)
    # without an earlier contact, the first frames may show the touch
    assert not np.any(find_light_touches([*bare, touch]))


def test_a_light_touch_that_was_taken_for_the_bare_gel_is_forgotten():
    rng = np.random.default_rng(12)
    frames = [spotted(REST[40], rng) for _ in range(8)] + [picture(REST, rng) for _ in range(4)]
    *before, found = find_light_touches([*frames, spotted(REST[70], rng)], 1)
    assert not np.any(before)
    assert found[70]
    assert not found[40]


def test_a_light_touch_has_a_contact_but_no_angle_and_ends_the_one_before(tmp_path):
    rng = np.random.default_rng(13)
    turned = [picture(twisted(5.0, rigid=50.0), rng) for _ in range(6)]
    images = [picture(REST, rng), *turned[:3], *(picture(REST, rng) for _ in range(9))]
    images += [*(spotted(REST[40], rng) for _ in range(3)), *turned[3:]]
    recording = read_recording(write_folder(tmp_path / "clip", images))
    assert recording.contact.any(axis=1).tolist() == [False] + [True] * 3 + [False] * 9 + [True] * 6
    assert list(recording.flaws[13:16]) == [Flaw.TOO_LIGHT] * 3
    result = estimate_angles(recording, noise=Noise.from_std(0.1, unit="px"))
    assert result.state[13:16] == (State.UNKNOWN,) * 3
    assert (result.contact_markers[13:16] > 0).all()
    assert not result.answered[13:16].any()
    assert result.contacts.tolist() == [0] + [1] * 15 + [2] * 3
    assert result.angle[16:] == pytest.approx(result.angle[1:4], abs=np.radians(0.5))


def stir(steps, touched=()):
    """Dots found by frame where a part of the gel, all of it or single dots have moved."""
    stirred, rng, found = StirredGel(), np.random.default_rng(17), []
    for row, step in enumerate(steps):
        places = REST + PITCH * (step + rng.normal(0.0, 0.001, REST.shape))
        found.append(stirred.find(places, REFERENCE, row in touched))
    return found


def test_gel_of_which_a_part_moves_is_touched():
    near = np.linalg.norm(REST - REST[40], axis=1) < 2.5 * PITCH
    rest, part = np.zeros_like(REST), np.where(near[:, None], [0.02, 0.0], 0.0)
    moved = [rest] * 20 + [part] * 4
    *before, found = stir(moved[:22])
    assert not np.any(before)
    assert found[near].all()
    assert found.sum() < 1.5 * near.sum()
    lasts = [bool(dots.any()) for dots in stir([*moved, *(part,) * 30])]
    assert lasts.index(True) == 21
    assert 16 <= sum(lasts) <= 22
    shaken = [rest] * 20 + [np.full_like(REST, 0.02)] * 4
    some = (np.arange(len(REST)) % 9 == 0)[:, None]
    single = [rest] * 20 + [np.where(some, [0.02, 0.0], 0.0)] * 4
    for steps, touched in ((shaken, ()), (single, ()), (moved, (10,)), (moved[10:], ())):
        assert not np.any(stir(steps, touched))


def test_a_touch_that_stirs_the_gel_before_any_contact_has_a_contact_but_no_angle(tmp_path):
    rng = np.random.default_rng(18)
    near = np.linalg.norm(REST - REST[40], axis=1) < 2.5 * PITCH
    part = np.where(near[:, None], [0.03 * PITCH, 0.0], 0.0)
    images = [picture(REST, rng) for _ in range(20)] + [picture(REST + part, rng) for _ in range(3)]
    recording = read_recording(write_folder(tmp_path / "clip", images))
    assert recording.contact.any(axis=1).tolist() == [False] * 21 + [True] * 2
    assert list(recording.flaws[21:]) == [Flaw.TOO_LIGHT] * 2
    assert "change of light" not in " ".join(recording.notes)


def uneven(rng, way=1.0, light=1.0, at=(160, 120), dots=REST):
    """A picture of an object that two lamps light from two sides."""
    x, y = (np.indices((240, 320))[::-1] - np.reshape(at, (2, 1, 1))) / 40.0
    slope = way * 60.0 * x * np.exp(-(x**2) - y**2)
    grey = picture(dots, rng).astype(float)
    colours = np.stack([grey + slope, grey, grey - slope], axis=-1)
    return np.clip(light * colours, 0, 255).astype(np.uint8)


def find_departures(images, step=0.0, printed=False):
    """Whether the object has gone, by frame."""
    departure, touched = Departure(), np.ones(len(REST), dtype=bool)
    return [
        departure.find(paint_out(image, REST, DOT), REST + i * step, PITCH, touched, printed)
        for i, image in enumerate(images)
    ]


def test_an_object_has_gone_once_the_light_is_even_and_the_gel_rests():
    rng = np.random.default_rng(14)
    held, bare = [uneven(rng) for _ in range(4)], [uneven(rng, 0.0) for _ in range(4)]
    assert find_departures(held + bare) == [False] * 5 + [True] * 3
    assert not any(find_departures(held + bare, step=0.03 * PITCH))
    assert not any(find_departures(held + bare, printed=True))
    assert not find_departures([*held, *bare, held[0]])[-1]


def test_the_light_is_measured_in_every_fourth_frame_that_shows_the_contact(monkeypatch):
    rng, measured, light = np.random.default_rng(16), [], Painted.light
    monkeypatch.setattr(Painted, "light", lambda *given: measured.append(given) or light(*given))
    departure, touched = Departure(), np.ones(len(REST), dtype=bool)
    held, bare = (paint_out(uneven(rng, way), REST, DOT) for way in (1.0, 0.0))
    for _ in range(8):
        assert not departure.find(held, REST, PITCH, touched, True)
    assert len(measured) == 2
    gone = [departure.find(bare, REST, PITCH, touched, False) for _ in range(3)]
    assert gone == [False, True, True]


def test_an_object_that_turns_moves_or_darkens_has_not_gone():
    rng = np.random.default_rng(15)
    other = [uneven(rng, -0.8), uneven(rng, light=0.4), uneven(rng, at=(200, 140))]
    other.append(np.zeros_like(other[0]))
    assert not any(find_departures([uneven(rng), *(image for image in other for _ in range(3))]))


def test_an_object_that_leaves_a_loaded_clip_ends_its_contact(tmp_path):
    """The dots are printed too irregularly to show that they are at rest."""
    rng = np.random.default_rng(16)
    bare = REST + 0.05 * PITCH * rng.normal(size=REST.shape)
    turned = [bare + twisted(angle, rigid=50.0) - REST for angle in range(3, 9)]
    images = [uneven(rng, dots=loaded) for loaded in turned]
    images += [uneven(rng, 0.0, dots=bare) for _ in range(8)]
    recording = read_recording(write_folder(tmp_path / "clip", images))
    result = estimate_angles(recording, noise=Noise.from_std(0.1, unit="px"))
    assert result.answered[1:6].all()
    gone = np.array(recording.flaws) == Flaw.DEPARTED
    assert gone.tolist() == [False] * 8 + [True] * 6
    assert not recording.contact[gone].any()
    assert set(result.state[8:]) == {State.UNKNOWN}
    assert not result.answered[8:].any()


def test_dispersion_holds_the_middle_of_a_twist():
    points = REFERENCE.position
    region = region_of_dispersion(REFERENCE, twisted(8.0, rigid=50.0) - REST)
    from_middle = np.linalg.norm(points - MIDDLE, axis=1)
    assert region[from_middle < 50.0].all()
    assert not region[from_middle > 118.0 + PITCH].any()
    assert not region_of_dispersion(REFERENCE, np.zeros_like(points)).any()


@pytest.mark.parametrize(("far", "begins", "lasts"), [(0.03, False, False), (0.037, False, True)])
def test_a_light_touch_does_not_flicker(far, begins, lasts):
    near = np.linalg.norm(REST - MIDDLE, axis=1) < 3.0 * PITCH
    moved = np.where(near[:, None], [far * PITCH, 0.0], 0.0)
    assert region_of_dispersion(REFERENCE, moved).any() == begins
    assert region_of_dispersion(REFERENCE, moved, touched=True).any() == lasts


def test_a_dot_that_the_side_cuts_tells_no_contact():
    moved = np.zeros_like(REFERENCE.position)
    cut = REFERENCE.position[:, 0] < 30.0
    moved[np.flatnonzero(cut)[0]] = 0.3 * PITCH
    assert region_of_dispersion(REFERENCE, moved).any()
    assert not region_of_dispersion(REFERENCE, moved, ~cut).any()


def test_the_way_is_chosen_and_told(tmp_path):
    rng = np.random.default_rng(3)
    images = [picture(REST, rng), lit(picture(twisted(4.0, rigid=50.0), rng), 25.0)]
    sensor = Sensor(dark=True, radius=4.3)
    notes = {
        unloaded: " ".join(
            read_recording(
                write_folder(tmp_path / str(unloaded), images), ImageSettings(sensor, unloaded)
            ).notes
        )
        for unloaded in (0, None)
    }
    assert "estimated from the change of light" in notes[0]
    assert "a change of light in part of the picture, else from how far" in notes[None]


def test_a_contact_whose_middle_is_not_seen_is_not_judged():
    from_middle = np.linalg.norm(REFERENCE.position - MIDDLE, axis=1)
    region, blurred = from_middle < 75.0, from_middle < 52.0
    assert not find_unseen_flaw(REFERENCE.position, region, np.ones_like(region))
    few = from_middle < 0.5 * PITCH
    assert not find_unseen_flaw(REFERENCE.position, region & ~few, ~few)
    assert "contact's centre" in find_unseen_flaw(REFERENCE.position, region & ~blurred, ~blurred)
    rim = region & (from_middle > 45.0)  # a jump of a pivot tears it
    ends = from_middle > 60.0
    assert not find_unseen_flaw(REFERENCE.position, region & (~rim | ends), ~rim | ends)


def test_a_contact_that_comes_in_over_the_edge_is_judged_once_it_has_settled():
    x = REFERENCE.position[:, 0]
    none = np.zeros(len(x), dtype=bool)
    coming = [x < edge for edge in np.arange(30.0, 130.0, 10.0)]
    late, loaded, inside = (Arrival(REFERENCE) for _ in range(3))
    assert not late.find_flaw(none)
    assert all("settled" in late.find_flaw(one) for one in coming)
    still = [late.find_flaw(coming[-1]) for _ in range(8)]
    assert still[0]
    assert not still[-1]
    # a clip that starts so, and a contact away from the edge, count at once
    assert not any(loaded.find_flaw(one) for one in coming)
    inside.find_flaw(none)
    middle = np.linalg.norm(REFERENCE.position - MIDDLE, axis=1) < 50.0
    assert not inside.find_flaw(middle)
    # a smooth object's contact seems to shrink as it turns, and nothing new comes into view
    shrinking = Arrival(REFERENCE)
    shrinking.find_flaw(none)
    wide = [x < edge for edge in (*(220.0,) * 6, *np.arange(220.0, 60.0, -10.0))]
    told = [shrinking.find_flaw(one) for one in wide]
    assert all(told[:7])
    assert not any(told[8:])
