"""The print on the gel: it stays where the object holds, and goes over the gel where it slips."""

import cv2
import numpy as np
import pytest

from estimation.frames.state import load_state, save_state
from estimation.frames.stretches import Span
from estimation.pictures.hold import HoldFollower
from estimation.pictures.imprint.painted import paint_out
from estimation.pictures.imprint.warp import Print
from estimation.pictures.lattice import lay_reference
from estimation.slip.shear import ShearSettings
from tests.estimation.pictures.scenes import PITCH, RADIUS, REST

MIDDLE = np.array([160.0, 120.0])
REFERENCE = lay_reference(REST, "laid")
LEAVE = np.linspace(0.0, 12.0, 9)
"""Shear of the gel, frame by frame [px]."""


def sheared(points, shear):
    """Points of the gel: all the shear under the object, none far from it [px]."""
    far = np.linalg.norm(points - MIDDLE, axis=-1)
    share = np.exp(-((far / 85.0) ** 8))
    return points + shear * share[..., None] * np.array([1.0, 0.0])


@pytest.fixture(scope="module")
def relief():
    rough = np.random.default_rng(4).normal(0.0, 1.0, (240, 400)).astype(np.float32)
    rough = cv2.GaussianBlur(rough, (0, 0), 3.5)
    return 40.0 * rough / rough.std()


def pictured(relief, shear, ahead, rng, reach=62.0):
    """The gel under an object that has gone `ahead` of it, its dots and what the object prints."""
    y, x = np.mgrid[:240, :320]
    near = np.hypot(x - MIDDLE[0] - shear, y - MIDDLE[1]) < reach
    start = 40 - round(shear + ahead)
    grey = 150.0 + near * relief[:, start : start + 320] + rng.normal(0.0, 1.5, (240, 320))
    dots = sheared(REST, shear)
    image = np.clip(grey, 0, 255).astype(np.uint8)
    for column, row in np.rint(16 * dots).astype(int).tolist():
        cv2.circle(image, (column, row), int(16 * RADIUS), 40, -1, shift=4)
    return np.repeat(image[..., None], 3, axis=-1), dots


def follow(relief, ahead, rest=LEAVE, lost=(), reach=62.0, hidden=RADIUS, interval=np.nan):
    follower, rng, holds = HoldFollower(REFERENCE), np.random.default_rng(1), []
    for i, (shear, gone, far) in enumerate(np.broadcast(rest, ahead, reach)):
        image, dots = pictured(relief, shear, gone, rng, far)
        painted = paint_out(image, dots, hidden)
        dots = dots.copy()
        dots[list(lost)] = np.nan
        holds.append(follower.update(painted, dots, dots - REST, time=i * interval))
    return np.array(holds)


def test_print_stays_on_gel_that_holds(relief):
    since, lately, _ = follow(relief, 0.0).T
    assert since.min() > 0.85
    assert lately.min() > 0.85


def test_a_follower_resumes_from_its_saved_state(relief):
    follower, rng, read = HoldFollower(REFERENCE), np.random.default_rng(1), []
    for shear in LEAVE:
        image, dots = pictured(relief, shear, 0.2 * shear, rng)
        read.append((paint_out(image, dots, RADIUS), dots, dots - REST))
    for frame in read[:5]:
        follower.update(*frame)
    resumed = load_state(save_state(follower))
    after, expected = ([one.update(*frame) for frame in read[5:]] for one in (resumed, follower))
    assert np.isfinite(expected).all()
    assert after == expected


@pytest.mark.parametrize(
    ("colours", "strength", "located", "distinct"),
    [
        (1, 1.0, False, True),
        (1, 0.0, True, False),
        (3, 0.0, True, True),
        (3, 0.0, False, False),
        (3, 1.0, False, True),
    ],
)
def test_a_weak_print_may_be_scratches(relief, colours, strength, located, distinct):
    """Scratches cover the gel, and a print is added under the object.

    In colours a weak print counts while it gives the object's position.
    """
    follower, rng, holds = HoldFollower(REFERENCE), np.random.default_rng(1), []
    scratches = 0.2 * relief[:, 60:380]
    for _ in LEAVE:
        image, dots = pictured(strength * relief, 0.0, 0.0, rng)
        image = np.clip(image + scratches[..., None], 0, 255).astype(np.uint8)[..., :colours]
        painted = paint_out(image, dots, RADIUS)
        holds.append(follower.update(painted, dots, dots - REST, located))
    assert min(hold.since for hold in holds) > 0.8
    assert np.isfinite(holds[-1].weakest) == distinct


def test_noise_alone_is_no_print(relief):
    """Nothing touches the pad, whose pictures differ by their noise."""
    unknown = follow(0.0 * relief, 0.0, np.zeros(30))
    assert np.isnan(unknown[2:]).all()


def test_a_print_that_noise_hides_shows_nothing(relief):
    """The noise of the pictures grows until few dots have a print that exceeds it."""
    rng, follower, holds = np.random.default_rng(6), HoldFollower(REFERENCE), []
    for level in (0.0,) * 3 + (12.0,) * 4:
        image, dots = pictured(0.08 * relief, 0.0, 0.0, rng)
        image = np.clip(image + rng.normal(0.0, level, image.shape), 0, 255).astype(np.uint8)
        holds.append(follower.update(paint_out(image, dots, RADIUS), dots, dots - REST))
    assert holds[2].since > 0.8
    assert np.isnan(holds[-1].since)
    assert np.isfinite([holds[-1].lately, holds[-1].weakest]).all()


def test_dots_that_a_mask_cuts_are_no_print(relief):
    """They are not detected, and a mask's edge lies where they are."""
    image, dots = pictured(0.0 * relief, 0.0, 0.0, np.random.default_rng(7))
    seen = np.ones(image.shape[:2], dtype=bool)
    seen[:, : int(REST[:, 0].min()) + 40] = False
    edge = np.flatnonzero(seen[0])[0]
    shown = dots[dots[:, 0] > edge + RADIUS]
    assert len(shown) < len(dots)
    painted = paint_out(image, shown, RADIUS, seen)
    assert not painted.inner[:, : int((edge + 2.0 * RADIUS) / painted.part)].any()
    assert max(abs(plane).max() for plane in painted.planes) < 8.0


def test_noise_that_a_video_freezes_is_no_print():
    """A video renews the noise of a few blocks in each frame, and all of it in none."""
    rng, follower, holds = np.random.default_rng(2), HoldFollower(REFERENCE), []
    frozen = rng.normal(0.0, 1.5, (240, 320, 3))
    for _ in range(40):
        for row, column in rng.integers(0, (15, 20), (12, 2)) * 16:
            frozen[row : row + 16, column : column + 16] = rng.normal(0.0, 1.5, (16, 16, 3))
        image = np.clip(150.0 + frozen, 0, 255).astype(np.uint8)
        holds.append(follower.update(paint_out(image, REST, RADIUS), REST, 0.0 * REST))
    assert np.isnan(holds[2:]).all()


@pytest.mark.parametrize(("slip", "sticks"), [(0.0, True), (3.0, False)])
def test_a_picture_coded_by_itself_shows_partial_slip_only_where_there_is_one(relief, slip, sticks):
    """A video renews the errors of its coding in frame 12, after which an object may slip [px]."""
    rng, follower, weakest, coded = np.random.default_rng(1), HoldFollower(REFERENCE), [], 0.0
    for i in range(20):
        if i % 12 == 0:
            coded = cv2.GaussianBlur(rng.normal(0.0, 10.0, (240, 320)), (0, 0), 1.5)
            coded *= 1.8 / coded.std()
        image, dots = pictured(0.15 * relief, 0.0, slip * np.clip(i - 11, 0, 6) / 6, rng)
        image = np.clip(image + coded[..., None], 0, 255).astype(np.uint8)
        weakest.append(follower.update(paint_out(image, dots, RADIUS), dots, 0.0 * dots).weakest)
    assert min(weakest[6:12]) > ShearSettings().sticking
    assert (min(weakest[12:]) > ShearSettings().sticking) == sticks


def test_print_that_grows_as_the_object_is_pressed_on_stays(relief):
    for smallest, largest, least in ((40.0, 62.0, 0.8), (50.0, 90.0, ShearSettings().kept)):
        since, *_ = follow(relief, 0.0, reach=np.linspace(smallest, largest, len(LEAVE))).T
        assert since.min() > least


def test_print_that_is_pressed_on_bare_gel_has_not_slipped(relief):
    """The gel counts as touched from the first frame on; the object comes later and is held."""
    reach = np.r_[np.zeros(8), np.linspace(10.0, 62.0, 6), np.full(10, 62.0)]
    since, *_ = follow(relief, 0.0, np.zeros(24), reach=reach).T
    assert np.nanmin(since) > ShearSettings().kept
    assert since[-1] > 0.85


def test_print_goes_over_gel_that_is_slipped_over(relief):
    ahead = np.linspace(0.0, PITCH / 2, len(LEAVE))
    since, *_ = follow(relief, ahead).T
    assert since[0] == pytest.approx(1.0)
    assert since[-1] < 0.4


def test_slow_cameras_compare_prints_over_the_same_time(relief):
    def least(interval):
        """The least correlations while the object creeps by two fifths of a pitch in 2 s."""
        creep = 0.2 * PITCH * np.arange(0.0, 2.0, interval)
        return follow(relief, creep, 0.0 * creep, interval=interval)[:, :2].min(axis=0)

    fastest, slowest = least(1 / 25), least(1 / 20)  # cameras whose frames count
    assert (slowest - 0.02 < fastest).all()
    for interval in (1 / 8, 1 / 12):
        assert (slowest - 0.02 < least(interval)).all()


def test_a_number_of_frames_fits_the_time_of_slower_cameras():
    def convert(times):
        span = Span()
        return [span.update(time) for time in times][-1](16)

    assert convert(np.arange(9) / 25.0) == convert(np.full(9, np.nan)) == convert([0.0]) == 16
    assert convert(np.arange(9) / 10.0) == 8
    assert convert(np.arange(9.0)) == 1
    assert convert(np.r_[0.0, 5.0 + np.arange(8) / 30.0]) == 16  # lost frames


def test_gel_that_springs_back_under_an_object_at_rest_is_slipped_over(relief):
    """The imprint stands still in the picture; only the gel moves."""
    still = follow(relief, 0.0, LEAVE[::-1])[:, 0]
    gone = follow(relief, LEAVE[-1] - LEAVE[::-1], LEAVE[::-1])[:, 0]
    assert still.min() > 0.85
    assert gone[-1] < 0.4


def test_a_slip_that_has_ended_is_not_lately(relief):
    ahead = np.concatenate([[0.0, 6.0, 12.0], np.full(6, 12.0)])
    since, lately, weakest = follow(relief, ahead, np.zeros(9)).T
    assert since[-1] < 0.4
    assert lately[3] < 0.4
    assert lately[-1] > 0.9
    assert weakest[-1] > 0.9


def bar(start, stop):
    """A bar along x between two columns of the object, as `relief`."""
    y, x = np.mgrid[:240, :400].astype(np.float32)
    ends = np.exp(-(np.maximum(np.maximum(start - x, x - stop), 0.0) ** 2) / 30.0)
    return 60.0 * ends * np.exp(-(((y - MIDDLE[1]) / 25.0) ** 2))


def test_a_bar_that_goes_along_itself_is_seen_by_its_ends():
    """Half of its dots see no change once it has slipped by a quarter of their distance."""
    held, slid = (follow(bar(140.0, 260.0), ahead, reach=1e3)[:, 0] for ahead in (0.0, LEAVE))
    assert held.min() > 0.9
    assert slid[4] < 0.5
    assert slid[-1] < 0.1


def test_a_bar_along_the_shear_does_not_show_whether_the_object_holds():
    for ahead in (0.0, LEAVE):
        since, lately, weakest = follow(bar(-1e3, 1e3), ahead, reach=1e3).T
        assert since[0] == pytest.approx(1.0)  # before any shear
        assert np.isnan(since[-1])
        assert min(lately[-1], weakest[-1]) > 0.8


def test_print_between_dots_that_are_close_together_counts(relief):
    """Then its structure is unknown, which does not make it uniform."""
    held, slid = (follow(relief, ahead, hidden=1.6 * RADIUS)[:, 0] for ahead in (0.0, LEAVE))
    assert held.min() > 0.85
    assert slid[-1] < 0.5


@pytest.mark.parametrize(("printed", "decides"), [(4, False), (12, True)])
def test_no_single_dot_decides_where_few_show_a_print(printed, decides):
    """The print has changed at one dot, where it is as strong as at all others together."""
    rng, strength = np.random.default_rng(5), np.full(len(REST), 0.5)
    strength[:printed] = 10.0
    strength[0] = 10.0 * printed
    levels = strength[:, None] * rng.normal(0.0, 1.0, (len(REST), 400))
    other = levels.copy()
    other[0] = strength[0] * rng.normal(0.0, 1.0, 400)
    before, now = (
        Print([plane], np.ones(plane.shape, dtype=bool))
        for plane in (levels.astype(np.float32), other.astype(np.float32))
    )
    seen = np.ones(len(REST), dtype=bool)
    compared = HoldFollower(REFERENCE).compare(before, now, seen, 0.0)
    agreement, weight = compared.correlate(), compared.weight
    assert np.count_nonzero(weight) == printed
    assert agreement[0] < 0.2
    assert agreement[1:printed].min() > 0.99
    assert (weight[0] > weight[1:].sum() / 2.0) == decides


def test_lost_dots_leave_the_answer(relief):
    since, *_ = follow(relief, 0.0, lost=(40, 41, 66)).T
    assert since.min() > 0.75


def test_without_dots_nothing_is_said(relief):
    image, dots = pictured(relief, 0.0, 0.0, np.random.default_rng(1))
    painted = paint_out(image, dots, RADIUS)
    assert np.isnan(
        HoldFollower(REFERENCE).update(painted, *np.full((2, *dots.shape), np.nan))
    ).all()
