import numpy as np
import pytest

from estimation.estimators.unseen_slide import UnseenSlide

RATE = np.radians(0.8)
CONTACT, MANY, FEW = 79, 40, 4


def follow(slide, angles, stick, error=0.0):
    """The extents after each of some frames."""
    extents = []
    for angle in angles:
        slide.update(float(angle), stick, CONTACT, error)
        extents.append(slide.extent)
    return np.array(extents)


def turned(stick, frames=12):
    """A slide that has seen an object turn steadily, and where it is."""
    slide, angles = UnseenSlide(9), RATE * np.arange(frames)
    follow(slide, angles[: frames // 2], MANY)
    follow(slide, angles[frames // 2 :], stick)
    return slide, angles[-1]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_object_that_few_markers_held_may_go_on(way):
    slide, frames = UnseenSlide(9), 20
    follow(slide, way * RATE * np.arange(8), MANY)
    follow(slide, way * RATE * np.arange(8, 10), FEW)
    extents = follow(slide, np.full(frames, way * RATE * 9), FEW)
    truth = RATE * np.arange(1, frames + 1)  # it goes on as it went
    behind, ahead = extents.T[:: int(way)]
    assert (ahead[2:] >= truth[2:]).all()
    assert ahead[-1] < 1.3 * truth[-1]
    assert not behind.any()
    assert slide.doubtful


def test_object_that_many_markers_hold_rests_with_the_gel():
    slide, last = turned(MANY)
    assert not follow(slide, np.full(30, last), MANY).any()
    assert not slide.doubtful


def test_many_markers_that_stick_at_rest_after_frames_without_any_may_slip():
    """Under a flat face that slides, all of the gel comes to rest and seems to stick."""
    slide, last = turned(MANY)
    for _ in range(2):
        slide.miss()
    extents = follow(slide, np.full(30, last), MANY)
    assert (extents[1:, 1] >= RATE * np.arange(4, 33)).all()
    assert slide.doubtful


def test_few_markers_that_turn_on_are_no_doubt():
    rng = np.random.default_rng(0)
    slide, last = turned(FEW)
    angles = last + RATE * np.arange(1, 30) + 0.1 * RATE * rng.standard_normal(29)
    assert not follow(slide, angles, FEW).any()


def test_all_that_rests_seems_to_stick_and_shows_nothing():
    slide, last = turned(FEW)
    extents = follow(slide, np.full(10, last), CONTACT)
    assert extents[-1, 1] > 8 * RATE


def test_keyframe_that_jumps_is_no_grip():
    slide, last = turned(FEW)
    extents = follow(slide, np.full(10, last - np.radians(1.5)), CONTACT)
    assert extents[-1, 1] > 8 * RATE


def test_reversal_is_a_grip():
    slide, last = turned(FEW)
    extents = follow(slide, last - RATE * np.arange(1, 10), MANY)
    np.testing.assert_allclose(extents[-1], 0.0, atol=1e-12)


def test_what_may_have_slid_before_a_grip_stays_in_doubt():
    slide, last = turned(FEW)
    before = follow(slide, np.full(10, last), CONTACT)[-1]
    extents = follow(slide, last - RATE * np.arange(1, 10), MANY)
    np.testing.assert_allclose(extents[-1], before, atol=1.5 * RATE)
    assert not slide.doubtful  # it holds now
    slide.restart()
    assert not np.any(slide.extent)


def test_few_is_a_share_of_small_contacts():
    slide = UnseenSlide(9)
    for angle in [*RATE * np.arange(8), *np.full(10, 7 * RATE)]:
        slide.update(float(angle), 5, 12, 0.0)
    assert not np.any(slide.extent)


def test_few_markers_at_rest_from_the_start_are_no_doubt():
    slide = UnseenSlide(9)
    assert not follow(slide, np.zeros(20), FEW).any()


def test_contact_that_turns_back_as_one_body_has_held_since():
    extents = []
    for as_one in (False, True):
        slide, last = turned(FEW)
        for frame in range(1, 7):
            along = -3.0 * RATE if as_one and frame >= 3 else 0.0  # over the last three frames
            slide.update(last - RATE * frame, FEW, CONTACT, 0.0, lambda along=along: along)
        extents.append(slide.extent)
    assert extents[0][1] > 6 * RATE
    assert extents[1] == (0.0, 0.0)


def test_noise_of_few_markers_at_rest_is_no_turn():
    error = np.radians(0.2)
    noisy = error * np.random.default_rng(0).standard_normal(1000)
    assert not follow(UnseenSlide(9), noisy, FEW, error).any()


def test_slow_turn_below_the_noise_may_go_on_too():
    slide, error, rate = UnseenSlide(9), np.radians(0.1), np.radians(0.02)
    rng, frames = np.random.default_rng(0), 600
    turned = rate * np.minimum(np.arange(2 * frames), frames)
    angles = turned + error * rng.standard_normal(len(turned))
    extents = follow(slide, angles, FEW, error)
    assert (extents[:frames] > 0.0).mean() < 0.1  # noise seldom looks like a slowdown
    truth = rate * np.arange(frames)[frames // 4 :]  # once the slowdown is clear
    assert (extents[-len(truth) :, 1] > 0.9 * truth).all()
    assert extents[-1, 1] < 2.0 * truth[-1]


def test_what_the_noise_does_not_decide_counts_as_a_possible_slide():
    """Until a slowdown of few markers is clear, the object may rest with them or go on."""
    slide, last = turned(MANY)
    error = RATE  # a step lasts until the turn at half the rate is 4 √2 times as large
    truth = RATE * np.arange(1, 11)
    extents = follow(slide, np.full(10, last), FEW, error)
    assert (extents[3:, 1] > 0.75 * truth[3:]).all()  # once it is clear of 1.96 √2 errors
    assert not extents[:, 0].any()
    slide, last = turned(MANY)
    assert not follow(slide, last + truth, FEW, error).any()


def test_a_grip_does_not_end_the_doubt_of_a_slide_that_noise_hid_before():
    slide, last = turned(MANY)
    error, frames = RATE, 12  # the slide is decided in the last of them
    follow(slide, np.full(frames, last), FEW, error)
    assert slide.update(last - RATE, FEW, CONTACT, error, lambda: -RATE)
    # the object may have slid until three frames before the grip
    assert slide.extent[1] > 0.75 * RATE * (frames - 3)


def test_a_slow_step_counts_until_more_steps_show_a_slowdown():
    """Three steps average out to more than half the rate, though the gel rests in the last."""
    slide, error, turning = UnseenSlide(9), 0.25 * RATE, 8  # a step lasts two frames, or three
    follow(slide, RATE * np.arange(turning), FEW, error)
    truth = RATE * np.arange(1, 11)
    extents = follow(slide, np.full(10, RATE * (turning - 1)), FEW, error)
    assert (extents[:, 1] > 0.9 * truth).all()


def test_markers_that_let_go_are_few_although_noise_lets_many_seem_to_stick():
    slide, angles = UnseenSlide(9), RATE * np.arange(12)
    for angle, stick in zip(angles, np.linspace(MANY, 30, 12), strict=True):
        slide.update(float(angle), int(stick), CONTACT, 0.0)
    truth = RATE * np.arange(1, 11)
    extents = follow(slide, np.full(10, angles[-1]), 14)
    assert (extents[2:, 1] > truth[2:]).all()
    slide, last = turned(14)  # as many as stuck before
    assert not follow(slide, np.full(10, last), 14).any()


def test_gel_that_springs_back_in_a_part_of_the_contact_is_no_grip():
    slide, last = turned(FEW)
    follow(slide, np.full(5, last), FEW)
    back = last - np.radians(0.3) * np.arange(1, 11)
    ahead = follow(slide, back, CONTACT // 3)[:, 1]
    assert (np.diff(ahead) > RATE).all()


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("pace", "grips"), [(0.2, False), (1.0, True)])
def test_gel_that_turns_slowly_under_a_possible_slide_is_no_grip(way, pace, grips):
    """It drifts by degrees, but far slower than the object turned."""
    slide, last = turned(FEW)
    rest = follow(slide, np.full(5, last), CONTACT)[-1, 1]
    ahead = follow(slide, last + way * pace * RATE * np.arange(1, 31), CONTACT)[:, 1]
    truth = rest + RATE * np.arange(1, 31) - way * pace * RATE * np.arange(1, 31)
    assert (ahead > truth).all() != grips
    assert slide.doubtful != grips


def test_drift_within_the_noise_is_no_grip():
    slide, last = turned(FEW)
    error = np.radians(0.3)
    follow(slide, np.full(5, last), FEW)
    ahead = follow(slide, last - error * np.linspace(0.0, 3.0, 20), MANY, error)[:, 1]
    assert ahead[-1] > 20 * RATE


def test_a_jump_to_markers_that_lag_takes_the_possible_slide_along():
    slide, last = turned(FEW)
    follow(slide, np.full(4, last), FEW)
    reach, lag = last + slide.extent[1], np.radians(2.0)
    for frame in range(1, 4):  # they turn back with the object, with most of the contact
        turn, along = -frame * RATE, -3.0 * RATE if frame == 3 else 0.0
        slide.update(last - lag + turn, MANY, CONTACT, 0.0, lambda along=along: along)
    assert last - lag + turn + slide.extent[1] >= reach + turn - 1e-9
