"""A slip along the gel, by the gel's shear and by the print on it; labelled lifts."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.estimators.result import State
from estimation.frames.recording import Flaw, Hidden, layout_markers
from estimation.settings import Settings
from estimation.slip.outcome import Outcome, conclude, find_onset, join_outcomes
from estimation.slip.shear import Shear, ShearPath, ShearSettings, ShearWatch
from estimation.slip.slide import Recent, Slide
from estimation.sources import read_recording
from estimation.tracking.stream import Stream
from estimation.tracking.tracker import estimate_angles
from tests.estimation.pictures.scenes import real

REST = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), -1).reshape(-1, 2)
LAYOUT = layout_markers(REST)
TOUCHED = np.linalg.norm(REST - 3.5, axis=1) < 2.5
SHARE = np.exp(-((np.linalg.norm(REST - 3.5, axis=1) / 2.5) ** 4))[:, None]
RISE = np.concatenate([np.linspace(0.0, 0.4, 9), np.full(8, 0.4)])
"""Shear of a lift that is held [pitches]."""
FALL = np.concatenate([RISE[:9], np.linspace(0.36, 0.1, 8)])
SURE = np.full(len(RISE), 0.9)
UNSEEN = Slide()


def watch(shear, hold, contact=TOUCHED):
    watched = ShearWatch(LAYOUT)
    return [
        watched.update(REST + one * SHARE * [1.0, 0.0], contact, (agrees, agrees, agrees), UNSEEN)
        for one, agrees in zip(shear, np.broadcast_to(hold, len(shear)), strict=True)
    ]


def test_shear_is_that_of_the_gel_under_the_object():
    found = watch(RISE, SURE)
    assert found[-1].shear == pytest.approx(0.4 * np.median(np.sort(SHARE[:, 0])[-10:]))
    assert found[-1].fallen == 0.0


def test_held_where_shear_rests_and_the_print_stays():
    found = watch(RISE, SURE)
    assert all(one.holds and not one.slides and not one.sticks for one in found)
    assert found[-1].slip_probability < 0.05


def test_slipped_where_the_shear_falls():
    found = watch(FALL, 0.8)
    assert found[8].slip_probability < 0.05
    assert found[-1].slip_probability > 0.95


@pytest.mark.parametrize(("beyond", "slips"), [(0.1, False), (0.8, True)])
def test_an_object_that_moves_back_with_the_gel_has_not_slipped(beyond, slips):
    still = Recent(np.zeros(len(REST)), np.zeros(len(REST)))
    slide = Slide(0.1 * beyond, 0.1, 0.0, beyond, still)
    watched = ShearWatch(LAYOUT)
    watched.update(REST, TOUCHED, (0.9, 0.9, 0.9), Slide(0.0, 0.1, 0.0, 0.0, still))
    for one in FALL:
        place = REST + one * SHARE * [1.0, 0.0]
        found = watched.update(place, TOUCHED, (0.9, 0.9, 0.9), slide)
    assert found.fallen > 0.5
    assert (found.slip_probability > 0.5) == slips


@pytest.mark.parametrize(("lift", "slips"), [(0.0, False), (1.0, True)])
def test_an_object_that_turns_back_has_not_slipped(lift, slips):
    """A turn about a point beside the contact's middle shears the gel a little on the way."""
    arm = REST - [3.8, 3.5]
    turns = np.radians(np.concatenate([np.linspace(0.0, 12.0, 12), np.linspace(11.0, 0.0, 12)]))
    watched = ShearWatch(LAYOUT)
    for turn in turns:
        moved = turn * SHARE * (arm[:, ::-1] * [-1.0, 1.0] + [lift, 0.0])
        found = watched.update(REST + moved, TOUCHED, (np.nan, 0.8, 0.8), UNSEEN)
    assert found.fallen > 0.3
    assert (found.slip_probability > 0.5) == slips


def test_slipped_where_the_print_goes_over_gel_at_its_limit():
    found = watch(RISE, np.where(np.arange(len(RISE)) > 9, 0.2, 0.95))
    assert found[9].holds
    assert found[-1].slides
    assert found[-1].slip_probability > 0.95


def test_slipped_where_the_print_is_beyond_all_of_the_gel():
    """Ten frames at rest, then it slides by twice its error; what slid long ago is forgotten."""
    watched = ShearWatch(LAYOUT)
    held = [
        watched.update(REST, TOUCHED, (0.9, 0.9, 0.9), Slide(0.1 * far, 0.1, 0.0, far))
        for far in [0.0] * 10 + [2.0] * 40
    ]
    assert held[9].slip_probability < 0.05
    assert held[10].slip_probability > 0.95
    assert held[10].slides
    assert held[-1].slip_probability < 0.05
    assert (held[-1].slip, held[-1].slip_error, held[-1].slip_since) == (0.2, 0.1, 0.0)


@pytest.mark.parametrize(
    ("core", "goes", "state"),
    [
        (True, True, State.INCIPIENT),  # the rim slips around a core
        (False, True, State.MACRO_SLIP),
        (False, False, State.STICK),  # it has come to rest
    ],
)
def test_slow_slip_is_seen_where_the_print_of_a_few_frames_hardly_moves(core, goes, state):
    away = np.linalg.norm(REST - 3.5, axis=1)
    lately = np.where(TOUCHED, 0.1 * (away > 1.0) if core else 0.1, np.nan)
    watched = ShearWatch(LAYOUT)
    for _ in range(5):
        slide = Slide(0.1, 0.2, 0.0, 0.5, Recent(lately, lately / 4.0 if goes else 0.0 * lately))
        found = watched.update(REST, TOUCHED, (0.97, 0.97, 0.97), slide)
    assert found.state == state
    assert (found.slip_probability > 0.95) == (state == State.MACRO_SLIP)
    if goes:
        np.testing.assert_array_equal(watched.strayed, TOUCHED & (away > 1.0 if core else TOUCHED))


@pytest.mark.parametrize("located", [True, False])
def test_what_has_slipped_sticks_again_once_its_print_stays(located):
    """Unless the print does not show where the object is: a ridge may slide along itself."""
    watched = ShearWatch(LAYOUT)
    beyond = 0.5 if located else np.nan
    for row in range(20):
        agrees = 0.5 if row < 16 else 0.99
        since = 0.4  # it has moved over the gel within the last second
        found = watched.update(REST, TOUCHED, (since, agrees, agrees), Slide(0.1, 0.2, 0.0, beyond))
        assert found.slides == (row < 16)
    assert found.slip_probability > 0.8
    assert found.sticks == located
    assert found.rests
    assert found.state == (State.STICK if located else State.INCIPIENT)


def test_a_load_that_is_taken_off_is_no_slip():
    assert watch(FALL, 0.99)[-1].slip_probability < 0.05


def test_a_load_that_was_taken_off_is_no_slip_later():
    shear, hold = np.r_[FALL, FALL[-1:].repeat(5)], np.full(len(FALL) + 5, 0.99)
    hold[-5:] = 0.95
    assert watch(shear, hold)[-1].slip_probability < 0.05


def test_markers_that_turn_are_no_shear_that_falls():
    """By 9°, the left half ahead at first; then they go as far to all sides."""
    arms = (REST - 3.5) @ np.array([1.0, 1.0j])
    watched = ShearWatch(LAYOUT)
    for frame in range(16):
        left, right = min(frame, 9), 9 * (frame > 8)
        turned = arms * np.exp(1j * np.radians(np.where(arms.real < 0.0, left, right)))
        points = 3.5 + np.stack([turned.real, turned.imag], axis=1)
        last = watched.update(points, TOUCHED, (0.8, 0.8, 0.8), UNSEEN)
    assert last.shear < 0.1
    assert last.slip_probability == 0.5  # without an imprint that shows the turn


def test_a_contact_whose_markers_are_not_seen_is_judged_by_those_beside_it():
    watched, unseen = ShearWatch(LAYOUT), np.where(TOUCHED[:, None], np.nan, REST)
    for one in FALL:
        last = watched.update(unseen + np.array([one, 0.0]), TOUCHED, (0.8, 0.8, 0.8), UNSEEN)
    assert last.slip_probability > 0.95


def test_one_wrong_frame_is_no_slip():
    hold = SURE.copy()
    hold[12] = 0.0
    assert max(one.slip_probability for one in watch(RISE, hold)) < 0.5


def test_without_a_print_nothing_is_said():
    found = watch(FALL, np.nan)[-1]
    assert np.isnan(found.slip_probability)
    assert not found.slides
    assert not found.holds
    assert found.fallen > 0.5


@pytest.mark.parametrize(("shear", "slides"), [(RISE, False), (FALL, True)])
def test_a_print_that_is_uniform_along_the_shear_leaves_even_odds(shear, slides, pivot_result):
    watched = ShearWatch(LAYOUT)
    found = [
        watched.update(REST + one * SHARE * [1.0, 0.0], TOUCHED, (np.nan, 0.99, 0.99), UNSEEN)
        for one in shear
    ]
    assert not any(one.holds or one.sticks for one in found)
    assert found[-1].slides == slides
    assert (found[-1].slip_probability > 0.9) if slides else (found[-1].slip_probability == 0.5)
    rows = pivot_result.take(slice(-len(found), None))
    outcome = conclude(ShearPath.of(*found), rows)
    assert outcome.word == ("slipped" if slides else "unknown")


def test_an_object_that_has_left_may_have_slipped_out_unseen(pivot_result):
    rows = pivot_result.take(slice(-5, None))
    path = ShearPath.of(*(Shear(0.1, print_correlation=1.0, slip_probability=0.01),) * 5)
    assert conclude(path, rows).word == "held"
    gone = replace(rows, reason=(*rows.reason[:-1], Flaw.DEPARTED))
    assert conclude(path, gone)[:2] == ("unknown", 0.5)


@pytest.mark.parametrize(
    ("angle", "gel", "word"), [(20.0, 3.0, "unknown"), (20.0, 15.0, "held"), (3.0, 0.5, "held")]
)
def test_an_object_that_has_turned_over_the_gel_was_not_held(angle, gel, word, pivot_result):
    path = ShearPath.of(*(Shear(0.1, slip_probability=0.2),) * 5)
    turned = np.full(5, np.radians(angle))
    rows = replace(
        pivot_result.take(slice(-5, None)),
        angle=turned,
        low=turned - np.radians(0.5),
        high=turned + np.radians(0.5),
        gel_low=np.zeros(5),
        gel_high=np.full(5, np.radians(gel)),
    )
    assert conclude(path, rows).word == word


@pytest.mark.parametrize("hidden", Hidden)
def test_a_contact_that_is_mostly_hidden_has_no_outcome(hidden, pivot_result):
    rows = pivot_result.take(slice(-5, None))
    for probability in (0.01, 0.99):
        path = ShearPath.of(*(Shear(0.1, slip_probability=probability),) * 5)
        words = [
            conclude(path, replace(rows, reason=(hidden,) * n + rows.reason[n:])).word
            for n in (2, 3)
        ]
        assert words == ["held" if probability < 0.5 else "slipped", "unknown"]


@pytest.mark.parametrize(("moves", "word"), [(False, "unknown"), (True, "slipped")])
def test_a_print_that_may_be_scratches_is_no_evidence_until_it_moves(moves, word, pivot_result):
    watched = ShearWatch(LAYOUT)
    found = [
        watched.update(
            REST + one * SHARE * [1.0, 0.0],
            TOUCHED,
            (0.3 if moves and one == RISE[-1] else 0.98, 0.98, np.nan),
            UNSEEN,
        )
        for one in RISE
    ]
    assert found[0].hidden
    assert found[-1].hidden != moves
    rows = pivot_result.take(slice(-len(found), None))
    assert conclude(ShearPath.of(*found), rows).word == word


@pytest.mark.parametrize("followed", [False, True])
def test_a_print_that_is_not_followed_does_not_show_a_turn(followed):
    arm = REST - 3.5
    slide = Slide(0.0, 0.1, 0.0, 0.0) if followed else UNSEEN
    watched = ShearWatch(LAYOUT)
    for turn in np.radians(np.linspace(0.0, 4.0, 9)):
        turned = REST + turn * SHARE * arm[:, ::-1] * [-1.0, 1.0]
        found = watched.update(turned, TOUCHED, (0.99, 0.99, 0.99), slide)
    assert found.hidden != followed
    assert found.holds == found.sticks == followed
    assert (found.slip_probability < 0.05) if followed else (found.slip_probability == 0.5)


def test_a_print_that_changes_at_once_has_slipped():
    watched = ShearWatch(LAYOUT)
    holds = [(0.9, 0.9, 0.9), (0.9, 0.3, 0.0), (0.9, 0.3, 0.0)]  # the oldest print is no help
    found = [watched.update(REST, TOUCHED, hold, UNSEEN) for hold in holds]
    assert [one.slides for one in found] == [False, False, True]


def test_few_frames_with_a_print_do_not_decide(pivot_result):
    told = [Shear()] * (len(pivot_result.time) - 2) + [Shear(slip_probability=0.01)] * 2
    assert np.isnan(conclude(ShearPath.of(*told), pivot_result).probability)


def test_a_frame_without_markers_is_passed_over():
    watched = ShearWatch(LAYOUT)
    watched.update(REST, TOUCHED, (1.0, 1.0, 1.0), UNSEEN)
    unseen = watched.update(np.full_like(REST, np.nan), TOUCHED, (np.nan, np.nan, np.nan), UNSEEN)
    assert np.isnan(unseen.shear)
    assert watched.update(REST + 0.3, TOUCHED, (1.0, 1.0, 1.0), UNSEEN).shear > 0.0


def test_nothing_is_known_without_motion_in_contact(pivot_result):
    touched = int(np.argmax(pivot_result.contact_markers > 0))
    for row in (0, touched):  # no contact, and a single frame of it
        outcome = conclude(ShearPath.of(Shear()), pivot_result.take(slice(row, row + 1)))
        assert (outcome.word, outcome.probability) == ("unknown", 0.5)
    count = len(pivot_result.time)
    unread = replace(pivot_result, state=(State.UNKNOWN,) * count)  # in contact, but not settled
    assert conclude(ShearPath.of(*[Shear()] * count), unread).word == "unknown"


def test_contact_begins_anew():
    watched = ShearWatch(LAYOUT)
    for one in FALL:
        watched.update(REST + np.array([one, 0.0]), TOUCHED, (0.8, 0.8, 0.8), UNSEEN)
    assert watched.update(
        REST, np.zeros_like(TOUCHED), (np.nan, np.nan, np.nan), UNSEEN
    ) == pytest.approx(Shear(), nan_ok=True)
    # as far as from the last frame without contact
    again = watched.update(REST + np.array([0.3, 0.0]), TOUCHED, (1.0, 1.0, 1.0), UNSEEN)
    assert again.shear == pytest.approx(0.3)


def test_even_bets_are_where_the_settings_say():
    settings = ShearSettings()
    found = watch(np.zeros(5), settings.kept)[-1]
    assert found.slip_probability == pytest.approx(0.5, abs=0.01)


def test_states_tell_where_there_is_no_print(pivot_result):
    outcome = conclude(ShearPath.of(*[Shear()] * len(pivot_result.time)), pivot_result)
    slipped = State.MACRO_SLIP in pivot_result.state
    assert outcome.word == ("slipped" if slipped else "held")
    assert np.isnan(outcome.probability)


@pytest.mark.parametrize(
    ("moves", "rests", "onset"),
    [
        (10, 10, 10),
        (10, 6, 10),  # the object rested before it slipped
        (6, 10, 10),  # a part of the contact slipped before
    ],
)
def test_a_slip_began_where_the_print_moved_and_the_gel_rested(moves, rests, onset):
    """The print fades by a tenth a frame, and reaches even odds five frames later."""
    frame, late = np.arange(24), 1  # medians of three frames are a frame late
    shear = np.minimum(np.maximum(frame - late, 0) / rests, 1.0)
    fades = 0.1 * np.maximum(frame - late - moves, 0)
    path = ShearPath.of(
        *(
            Shear(one, print_correlation=1.0 - lost, slip_probability=float(lost > 0.45))
            for one, lost in zip(shear, fades, strict=True)
        )
    )
    reported = int(path.slip_probability.argmax())
    assert reported == moves + late + 5
    assert find_onset(path, reported) == min(onset, reported)
    gone = path._replace(shear=np.where(frame > reported + 1, np.nan, path.shear))
    assert find_onset(gone, reported) == min(onset, reported)
    unseen = path._replace(print_correlation=np.full(len(frame), np.nan))
    assert find_onset(unseen, reported) == reported


SLIPPED, HELD = Outcome("slipped", 0.8, 2.0, 3), Outcome("held", 0.4, np.nan)
UNKNOWN, BY_STATES = Outcome("unknown", 0.5, np.nan), Outcome("slipped", np.nan, 1.0, 1)


@pytest.mark.parametrize(
    ("first", "second", "joint"),
    [
        (SLIPPED, HELD, SLIPPED),
        (SLIPPED, UNKNOWN, SLIPPED),
        (BY_STATES, HELD, BY_STATES),  # the finger that held says nothing about this slip
        (SLIPPED, BY_STATES, Outcome("slipped", 0.8, 1.0, 3)),
        (SLIPPED, SLIPPED._replace(probability=0.6), SLIPPED),
        (HELD, HELD._replace(probability=0.3), HELD),
        (HELD, HELD._replace(probability=np.nan), HELD),
        (HELD, UNKNOWN, UNKNOWN),
        (UNKNOWN, UNKNOWN, UNKNOWN),
    ],
)
def test_two_fingers_have_one_outcome(first, second, joint):
    assert join_outcomes(first, second) == pytest.approx(joint, nan_ok=True)
    assert join_outcomes(second, first) == pytest.approx(joint, nan_ok=True)


@pytest.fixture(scope="module")
def pivot_result():
    from estimation.frames.noise import Noise
    from estimation.virtual.recording import simulate_pivot

    recording, _ = simulate_pivot(seed=0)
    return estimate_angles(recording, noise=Noise.from_std(1e-3))


@pytest.mark.parametrize(
    ("lift", "word"), [("object001/067_30_mm", "slipped"), ("object001/067_10_mm", "held")]
)
def test_labelled_lifts(lift, word):
    stream = Stream(read_recording(real("slip-lifts", lift)), Settings())
    answers = list(stream.answers())
    shears = [answer.shear for answer in answers]
    states = [answer.estimates[Settings().method].state for answer in answers]
    assert (max(shear.slip_probability for shear in shears) > 0.5) == (word == "slipped")
    assert (State.MACRO_SLIP in states) == (word == "slipped")


def test_an_old_slip_that_becomes_known_is_no_new_one():
    """A print that was uniform along a line comes to show slip in all directions."""
    hidden, shown = Slide(np.nan, 9.0, 0.0, 0.1), Slide(1.0, 0.1, 0.0, 4.0)
    sure = Slide(0.02, 0.2, 0.0, 0.1)

    def last(*slides):
        watched = ShearWatch(LAYOUT)
        for slide in slides:
            found = watched.update(REST, TOUCHED, (0.9, 0.9, 0.9), slide)
        return found

    assert not last(*[hidden] * 5, *[shown] * 5).slides
    assert last(*[hidden] * 5, *[shown] * 5).slip_probability < 0.1
    assert last(*[sure] * 5, *[shown] * 5).slip_probability > 0.9
