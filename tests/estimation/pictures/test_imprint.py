"""The imprint, under lamps that do not turn with the object, and with what stays behind."""

import cv2
import numpy as np
import pytest

from estimation.frames.state import load_state, save_state
from estimation.pictures.imprint import follower as following
from estimation.pictures.imprint.follower import Imprint, ImprintFollower
from estimation.pictures.imprint.painted import paint_out
from estimation.pictures.imprint.registration import Keyframe, register, search_motions
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture
from estimation.pictures.imprint.witness import GelWitness
from estimation.pictures.lattice import lay_reference
from estimation.pictures.render import Camera, cover_with_dots, digitise
from estimation.virtual.relief import Lamps, make_relief
from tests.estimation.pictures import scenes

CAMERA = Camera(200, 160, 0.09, background=125.0, contrast=95.0)
RADIUS, PITCH = 4.3, 30.0
GRID = np.stack(np.meshgrid(np.arange(7), np.arange(6)), axis=-1).reshape(-1, 2)
DOTS = GRID * PITCH + np.array([12.0, 3.0])  # the uppermost lie half in view
REGION = DOTS[(np.abs(DOTS - [100.0, 80.0]) < [60.0, 55.0]).all(axis=1)]
Y, X = np.mgrid[:160, :200]
AWAY = np.hypot(X - 99.5, Y - 79.5)
TOUCHED = np.clip((62.0 - AWAY) / 10.0, 0.0, 1.0)
CAP = 1e-4 * np.maximum(62.0**2 - AWAY**2, 0.0)
"""Depth of a ball's contact [mm]."""


def picture(height, rng):
    axes = np.broadcast_to(RADIUS * np.eye(2), (len(DOTS), 2, 2))
    light = Lamps().light(CAMERA, height) * (
        1.0 - 0.76 * cover_with_dots(CAMERA, DOTS, axes)[..., None]
    )
    return digitise(CAMERA, light, rng)


def follow(heights, worn=(), expected=False):
    """What a follower reads; it is given the dots whose middle is well in view, but worn ones.

    If `expected`, it is given the places of these as those of dots that were not detected.
    """
    rng, found = np.random.default_rng(6), np.ones(len(DOTS), dtype=bool)
    found[list(worn)] = False
    seen, missed = DOTS[found & (DOTS[:, 1] > RADIUS)], DOTS[list(worn)] if expected else None
    follower = ImprintFollower()
    return [
        follower.update(paint_out(picture(h, rng), seen, RADIUS, missed=missed), REGION)
        for h in heights
    ]


@pytest.mark.parametrize("kind", ["texture", "edges"])
def test_lamps_do_not_hold_the_imprint_back_and_cut_dots_are_not_read(kind):
    relief = make_relief(kind, 0.15, 20.0, 0.02, np.random.default_rng(4))
    turns = np.arange(0.0, 25.0, 3.0)
    found = follow([TOUCHED * relief.at(CAMERA, np.zeros(2), np.radians(turn)) for turn in turns])
    error = np.degrees([one.angle for one in found]) - turns
    # two keyframes; the strongest colour by itself lags by 0.4°
    assert np.abs(error).max() < 0.2
    assert (np.abs(error) < 2.0 * np.degrees([one.error for one in found])).all()


def test_a_follower_resumes_from_its_saved_state():
    relief = make_relief("texture", 0.15, 20.0, 0.02, np.random.default_rng(4))
    rng, follower = np.random.default_rng(6), ImprintFollower()
    frames = [
        picture(TOUCHED * relief.at(CAMERA, np.zeros(2), np.radians(turn)), rng)
        for turn in (0.0, 1.0, 2.0, 3.0)
    ]
    seen = DOTS[DOTS[:, 1] > RADIUS]
    for frame in frames[:3]:
        follower.update(paint_out(frame, seen, RADIUS), REGION)
    resumed = load_state(save_state(follower))
    assert "template" in vars(follower.keyframes[0])
    assert "template" not in vars(resumed.keyframes[0])  # it is computed again
    after, expected = (
        one.update(paint_out(frames[3], seen, RADIUS), REGION) for one in (resumed, follower)
    )
    assert (after.angle, after.quality) == (expected.angle, expected.quality)
    assert np.degrees(after.angle) == pytest.approx(3.0, abs=0.2)  # as in the test above


def test_a_smooth_ball_says_nothing_of_a_turn():
    found = follow([CAP] * 6)
    # the first frame is what others are compared with; none is begun anew in the next ones
    assert found[0].quality == 1.0
    assert all(np.isnan(one.angle) for one in found[1:])


def test_the_interval_holds_what_light_hides_of_the_turn_of_a_smooth_square():
    def square(degrees):
        turn = np.exp(-1j * np.radians(degrees))
        place = (X - 99.5 + 1j * (Y - 79.5)) * turn
        beside = np.maximum(np.abs(place.real), np.abs(place.imag)) - 36.0
        return cv2.GaussianBlur(0.4 / (1.0 + np.exp(beside / 4.0)), (0, 0), 6.0)

    turns = np.arange(0.0, 13.0, 1.0)
    found = follow([square(turn) for turn in turns])
    error = np.degrees([one.angle for one in found]) - turns
    half_width = 1.96 * np.degrees([one.error for one in found])
    # smaller turns are as uncertain by noise
    assert (np.abs(error) < half_width)[3:].all()
    assert error[-3:].mean() < -0.25


def test_light_may_hide_more_of_a_shift_along_a_smooth_bar_than_across_it():
    """Its middle prints nothing of a shift along it, and its ends little."""

    def bar(far):
        inside = 1.0 - ((X - 99.5 - far) / 50.0) ** 2 - ((Y - 79.5) / 25.0) ** 2
        return cv2.GaussianBlur(0.4 * np.maximum(inside, 0.0), (0, 0), 4.0)

    relief = make_relief("texture", 0.15, 20.0, 0.02, np.random.default_rng(4))
    textured = [
        TOUCHED * relief.at(CAMERA, np.array([CAMERA.mm_per_px * far, 0.0]), 0.0)
        for far in (0.0, 4.0)
    ]
    (smooth,), (rough,) = (
        np.sqrt([one.point[4:6] for one in follow(heights)[1:]])
        for heights in ([bar(0.0), bar(4.0)], textured)
    )
    assert smooth[0] > 1.0  # px
    assert smooth[1] < 0.2
    assert rough.max() < 0.2


def test_a_print_that_a_coarse_quantizer_shows_late_keeps_to_its_interval():
    relief = make_relief("texture", 0.15, 20.0, 0.02, np.random.default_rng(4))
    turns = np.array([0.0, 0.0, 4.0, 8.0, 8.0, 8.0])
    shown = np.array([0.0, 0.0, 0.0, 3.0, 8.0, 8.0])  # the video's pictures come late
    steps = [0.0, 5.0, 250.0, 300.0, 20.0, 5.0]
    follower, rng, found = ImprintFollower(), np.random.default_rng(6), []
    seen = DOTS[DOTS[:, 1] > RADIUS]
    for turn, step in zip(shown, steps, strict=True):
        height = TOUCHED * relief.at(CAMERA, np.zeros(2), np.radians(turn))
        found.append(follower.update(paint_out(picture(height, rng), seen, RADIUS), REGION, step))
    error = np.degrees([one.angle for one in found]) - turns
    half_width = 1.96 * np.degrees([one.error for one in found])
    assert error[2] < -3.8
    assert error[3] < -4.8
    assert (np.abs(error) < half_width).all()
    assert half_width[[1, 5]].max() < 0.5  # and what comes on time is as certain as before


def test_a_print_that_stays_lost_is_searched_at_intervals(monkeypatch):
    searched = []

    def search(*textures):
        searched.append(textures)
        return []

    monkeypatch.setattr(following, "search_motions", search)
    reliefs = [make_relief("texture", 0.15, 20.0, 0.02, np.random.default_rng(k)) for k in (4, 5)]
    held, other = (TOUCHED * relief.at(CAMERA, np.zeros(2), 0.0) for relief in reliefs)
    found = follow([held] * 2 + [other] * 7)
    assert np.isnan([one.angle for one in found]).tolist() == [False] * 2 + [True] * 7
    assert len(searched) == 3


def test_the_place_of_the_imprint_is_followed_and_worn_dots_are_not():
    """Dots that are not found stay where they are, and are darker than all that the object prints.

    Read with them, the print lags behind.
    """
    relief = make_relief("texture", 0.15, 20.0, 0.02, np.random.default_rng(4))
    far = np.linspace(0.0, 1.2, 9)
    way = np.array([0.8, 0.6])
    heights = [TOUCHED * relief.at(CAMERA, one * way, 0.05 * one) for one in far]
    found = follow(heights, worn=(16, 24, 25))
    first, now, spread = np.split(np.array([one.point for one in found]), [2, 4], axis=1)
    arm = CAMERA.mm_per_px * (first - 0.5 * np.array([CAMERA.width - 1, CAMERA.height - 1]))
    c, s = np.cos(0.05 * far), np.sin(0.05 * far)
    turned = np.stack([c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]], axis=1)
    expected = first + (turned - arm + far[:, None] * way) / CAMERA.mm_per_px
    error = np.linalg.norm(now - expected, axis=1)
    assert error.max() < 0.2  # px
    assert (error < 2.5 * np.sqrt(spread[:, :2].max(axis=1)) + 1e-9).all()


def test_a_print_is_lost_where_only_worn_dots_match():
    """Worn dots that are expected are read, and stay where they are while the object slides."""
    reliefs = [make_relief("texture", 0.1, 20.0, 0.02, np.random.default_rng(k)) for k in (4, 5)]
    held, other = (TOUCHED * relief.at(CAMERA, np.zeros(2), 0.0) for relief in reliefs)
    found = follow([held] * 2 + [other] * 2, worn=(16, 24, 25), expected=True)
    assert found[1].worn > 0.5  # they are darker than the print
    assert np.isnan([one.angle for one in found]).tolist() == [False] * 2 + [True] * 2


@pytest.mark.parametrize(("worn", "core"), [(0.9, 70.0), (0.9, 10.0), (0.1, 70.0)])
def test_a_print_of_worn_dots_has_the_gel_that_sticks_as_a_witness(worn, core):
    """Gel within the core turns with the object by 4°; around it, the turn falls to 0."""
    rest = PITCH * np.stack(np.meshgrid(*[np.arange(-4.0, 5.0)] * 2), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(rest, axis=1)
    turn = np.radians(4.0) * np.clip(1.0 - (away - core) / 60.0, 0.0, 1.0)
    c, s = np.cos(turn), np.sin(turn)
    now = np.stack([c * rest[:, 0] - s * rest[:, 1], s * rest[:, 0] + c * rest[:, 1]], axis=1)
    witness, contact = GelWitness(lay_reference(rest, "laid")), away < core + 30.0
    read = Imprint(np.radians(2.0), np.radians(0.1), 0.9, worn=worn)
    witness.check(read._replace(angle=0.0), rest, contact)
    checked = witness.check(read, now, contact)
    if (worn, core) != (0.9, 70.0):  # few dots of a smaller core move as one body
        assert checked == read
        return
    covered = np.degrees(checked.angle + checked.error * np.array([-1.96, 1.96]))
    assert covered == pytest.approx([1.8, 4.2], abs=0.05)


def test_repeated_ridges_do_not_show_how_far_they_go_along_themselves():
    relief = make_relief("stripes", 0.15, 20.0, 0.02, np.random.default_rng(4))
    ridges = relief.at(CAMERA, np.zeros(2), 0.0)
    xx, yy, xy = follow([ridges, ridges])[1].point[4:]
    assert np.sqrt(xx) < 0.1  # px
    assert np.sqrt(yy) > 100.0
    assert abs(xy) < 0.05 * yy


@pytest.mark.parametrize(("offset", "uniform"), [(0.0, True), (10.0, False)])
def test_spots_around_the_dots_are_no_print_of_the_object(offset, uniform):
    """A smooth bar along y. Spots between the dots show how far it goes along itself."""
    rng, still, radius, pitch = np.random.default_rng(5), np.eye(2, 3, dtype=np.float32), 4.0, 20.0
    y, x = np.mgrid[-70:71, -40:41].astype(float)
    from_dot, from_spot = (
        np.hypot(np.abs(x) - 6.0, (y - along + 0.5 * pitch) % pitch - 0.5 * pitch)
        for along in (0.0, offset)
    )
    spots = np.exp(-((np.maximum(from_spot - radius, 0.0) / 1.5) ** 2))
    bar = 10.0 * np.exp(-((x / 8.0) ** 6)) * (1.0 - 0.5 * spots)
    shown = (from_dot > radius) & (np.abs(x) < 14.0) & (np.abs(y) < 64.0)
    mask = np.where(shown, 255, 0).astype(np.uint8)
    first, second = (
        Texture((bar + rng.normal(0.0, 0.1, bar.shape)).astype(np.float32), mask) for _ in range(2)
    )
    keyframe = Keyframe(first, np.eye(3), 0.0, np.zeros((2, 2)))
    match = register(keyframe, second, still, ImprintSettings())
    assert match is not None
    (xx, _), (_, yy) = match.own_spread
    assert np.sqrt(xx) < 0.2  # px
    assert (np.sqrt(yy) > 40.0) == uniform


def test_the_error_of_a_registration_is_that_of_many():
    rng = np.random.default_rng(11)
    relief = make_relief("texture", 0.15, 20.0, 0.02, rng).at(CAMERA, np.zeros(2), 0.0)
    before = cv2.GaussianBlur(relief, (0, 0), 1.0)
    before *= 20.0 / before.std()
    mask = np.where(AWAY < 62.0, 255, 0).astype(np.uint8)
    still, errors, stated = np.eye(2, 3, dtype=np.float32), [], []
    for _ in range(25):
        # a print that differs in places of its own, as where more of the object touches
        changed = cv2.GaussianBlur(rng.normal(size=before.shape), (0, 0), 3.0)
        now = before + 8.0 * changed / changed.std()
        first, second = (Texture(one.astype(np.float32), mask) for one in (before, now))
        keyframe = Keyframe(first, np.eye(3), 0.0, np.zeros((2, 2)))
        found = register(keyframe, second, still, ImprintSettings())
        assert found is not None
        errors.append(found.turned)
        stated.append(found.own_error)
    scatter = np.sqrt(np.mean(np.square(errors)))
    # 25 draws know their scatter to a seventh; the stated error includes the floor of a reading
    assert 0.7 < np.median(stated) / scatter < 1.7


def test_a_lost_print_is_looked_for_under_all_turns_and_shifts():
    rng, size, middle = np.random.default_rng(3), (161, 121), np.array([80.0, 60.0, 1.0])
    level = cv2.GaussianBlur(rng.normal(0.0, 60.0, size[::-1]).astype(np.float32), (0, 0), 3.0)
    mask = np.zeros(level.shape, np.uint8)
    mask[25:95, 40:120] = 255
    motion = cv2.getRotationMatrix2D((80.0, 60.0), -19.0, 1.0)
    motion[:, 2] += [14.0, -9.0]
    now = (cv2.warpAffine(one, motion, size) for one in (level, mask))
    found, *others = search_motions(Texture(level, mask), Texture(*now), ImprintSettings())
    assert len(others) == ImprintSettings().compared - 1
    # turns are tried every 6°, in pictures of half the size
    assert np.degrees(np.arctan2(found[1, 0], found[0, 0])) == pytest.approx(18.0, abs=0.01)
    assert found @ middle == pytest.approx(motion @ middle, abs=2.0)


def find_shifted(period, shear, single=0.0):
    """Follow a pattern that repeats along x and jumps by 20 px between two pictures.

    Args:
        period: of the pattern [px of the picture]; 0 for one that does not repeat.
        shear: of the gel along x while the pattern jumps [px].
        single: a part that does not repeat, over the part that does [-].
    """
    rough = np.random.default_rng(3).normal(0.0, 60.0, (240, 640)).astype(np.float32)
    pattern = cv2.GaussianBlur(rough, (0, 0), 3.0)
    if period:
        repeated = np.tile(pattern[:, :period], -(-640 // period))[:, :640]
        pattern = (repeated + single * pattern) / np.hypot(1.0, single)
    follower = ImprintFollower()
    region = scenes.REST[(np.abs(scenes.REST - [160.0, 120.0]) < [75.0, 65.0]).all(axis=1)]
    for shift, gel in ((0, 0.0), (0, 0.0), (20, shear), (20, shear)):
        image = np.clip(150.0 + pattern[:, 160 - shift : 480 - shift], 0, 255).astype(np.uint8)
        sheared = np.tile([gel, 0.0], (len(region), 1))
        found = follower.update(paint_out(image, scenes.REST, 4.3), region, sheared=sheared)
    return found


@pytest.mark.parametrize(
    ("period", "single", "shear", "place"),
    # the third one's next repetition fits moderately, and is nearer than the right place
    [(0, 0, 4.0, 20.0), (0, 0, -4.0, np.nan), (24, 0.5, 4.0, 20.0), (46, 0, 4.0, np.nan)],
)
def test_a_search_finds_a_print_at_one_place_that_the_gel_allows(period, single, shear, place):
    """A repeated print fits at several places; one that slips drags the gel along."""
    found = find_shifted(period, shear, single)
    assert found.point[2] - found.point[0] == pytest.approx(place, abs=0.2, nan_ok=True)


def test_a_search_whose_best_place_is_wrong_compares_no_other_place(monkeypatch):
    places, registered = [], []

    def search(*textures):
        places.append(search_motions(*textures))
        return places[-1]

    def match(keyframe, texture, start, settings):
        registered.append(start)
        return register(keyframe, texture, start, settings)

    monkeypatch.setattr(following, "search_motions", search)
    monkeypatch.setattr(following, "register", match)
    find_shifted(0, -4.0)
    compared = [sum(start is place for start in registered for place in found) for found in places]
    assert compared == [1]


def follow_pattern(turns, shares, grain=4.0, shaded=0.01):
    """Imprints of a pattern that turns [deg], with shares of another one that does not.

    Its grain is in px. The dots are 24 px apart, and leave gaps of 10 px between them.
    """
    rng = np.random.default_rng(2)
    pattern, other = (
        cv2.GaussianBlur(one.normal(0, 60, (240, 320)).astype(np.float32), (0, 0), grain)
        for one in (rng, np.random.default_rng(3))
    )
    follower = ImprintFollower(ImprintSettings(shaded_grey=shaded))
    dots = scenes.picture(scenes.REST, rng).astype(np.float32)
    region = scenes.REST[(np.abs(scenes.REST - [160.0, 120.0]) < [75.0, 65.0]).all(axis=1)]
    for degrees, share in zip(turns, shares, strict=True):
        # OpenCV counts angles counter-clockwise on the screen: from y to x
        warp = cv2.getRotationMatrix2D((160.0, 120.0), -degrees, 1.0)
        turned = cv2.warpAffine(pattern, warp, (320, 240), borderMode=cv2.BORDER_REFLECT)
        image = np.clip(dots + turned + share * other, 0, 255).astype(np.uint8)
        yield follower.update(paint_out(image, scenes.REST, 4.3), region)


def test_the_imprint_turns_with_the_object_not_with_the_dots():
    turns = np.arange(0.0, 21.0, 4.0)
    found = [np.degrees(one.angle) for one in follow_pattern(turns, np.zeros(6), grain=2.0)]
    # one registration is good to 0.15° here; two keyframes
    assert found == pytest.approx(turns, abs=0.3)


def test_grey_pictures_may_hide_a_tenth_of_a_turn_by_shading():
    turns, shaded = np.arange(0.0, 21.0, 4.0), ImprintSettings().shaded_grey
    found = list(follow_pattern(turns, np.zeros(6), grain=2.0, shaded=shaded))
    assert np.degrees(found[-1].error) == pytest.approx(2.0, abs=0.1)


def test_the_place_where_a_search_finds_a_lost_print_is_open_until_a_second_frame():
    turns = np.array([0.0, 0.0, 0.0, 25.0, 25.0, 0.0, 0.0])
    found = list(follow_pattern(turns, np.zeros(7), grain=2.0))
    angle, error = (
        np.degrees([getattr(one, name) for one in found]) for name in ("angle", "error")
    )
    assert angle == pytest.approx(turns, abs=0.5)
    searched = np.isin(np.arange(7), (3, 5))
    assert (error[searched] >= 3.0).all()
    assert (error[~searched] < 0.5).all()
    assert [np.isnan(one.point[0]) for one in found] == searched.tolist()


def test_an_imprint_that_has_been_drawn_away_is_read_anew_where_it_was_clear():
    """For five frames a third of the picture stays behind, and holds the keyframes back."""
    turns = np.r_[0.0, 4.0, 8.0, np.arange(10.0, 20.0, 2.0), np.full(22, 20.0)]
    shares = np.r_[np.zeros(3), np.full(5, 0.5), np.zeros(22)]
    found = list(follow_pattern(turns, shares))
    error = np.degrees([one.angle for one in found]) - turns
    half_width = 1.96 * np.degrees([one.error for one in found])
    assert error[7] < -1.2  # it has been drawn away
    assert abs(error[-1]) < 0.2  # 0.8° without the keyframes from before
    assert half_width[-1] < 0.8
    assert (np.abs(error)[8:] < half_width[8:]).all()


def test_broad_light_leaves_no_print_that_depends_on_the_places_of_the_dots():
    light = 90.0 + 0.5 * X + 0.2 * Y
    colours = np.repeat(light[..., None], 3, axis=2)
    axes = np.broadcast_to(RADIUS * np.eye(2), (len(DOTS), 2, 2))
    dotted = colours * (1.0 - 0.76 * cover_with_dots(CAMERA, DOTS, axes)[..., None])
    texture = paint_out(dotted.astype(np.float32), DOTS, RADIUS).texture
    # a mean over the pixels between the dots alone leaves 1.5 grey levels
    assert np.abs(texture[30:-30, 30:-30]).max() < 0.8
