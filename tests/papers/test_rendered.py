"""How answers on rendered clips are judged, on made-up ones."""

import numpy as np
import pytest

from estimation.estimators.result import State, Track
from estimation.virtual.clip import ClipTruth
from papers.marker_images.rendered import ClipAnswers, has_right_outcome, judge, judge_states
from papers.marker_images.scenes import CONDITIONS, draw_scene

N = 12
TURNED = np.r_[np.nan, np.nan, np.arange(10.0)]  # of the object, which touches in frame 2 [deg]


def truth(state):
    nothing = np.zeros(N)
    return ClipTruth(
        state=tuple(state),
        holding=np.full(N, 5),
        angle=np.radians(TURNED),
        shift=np.zeros((N, 2)),
        gel_angle=np.radians(np.minimum(TURNED, 4.0)),
        gel_shift=np.zeros((N, 2)),
        slip=nothing,
        stick_ratio=nothing,
        force=np.zeros((N, 3)),
        moment=nothing,
    )


def answers(
    angle, anew=0, since=0.04, state=(State.STICK,) * N, true=(State.STICK,) * N, outcome="held"
):
    angle = np.radians(angle)
    nothing = {name: np.zeros(N, dtype=int) for name in Track.columns()}
    track = Track(
        method="tracked",
        **nothing
        | {
            "reason": ("",) * N,
            "state": tuple(state),
            "angle": angle,
            "low": angle - np.radians(0.5),
            "high": angle + np.radians(0.5),
            "restarts": np.broadcast_to(anew, N),
            "since": np.broadcast_to(float(since) if np.isscalar(since) else since, N),
            "stiffness_ratio": np.zeros(N),
            "load_term": np.zeros(N),
            "gel_low": np.zeros(N),
            "gel_high": np.radians(np.nan_to_num(np.minimum(TURNED, 4.0))),
        },
    )
    return ClipAnswers("made up", truth(true), track, np.full(N, np.nan), outcome)


def test_an_angle_since_the_contact_is_taken_as_it_is():
    found = judge(answers(TURNED + np.where(np.arange(N) > 8, 1.0, 0.2)))
    np.testing.assert_allclose(found.error, np.where(np.arange(2, N) > 8, 1.0, 0.2))
    assert found.inside.tolist() == [True] * 7 + [False] * 3
    assert not found.anew.any()
    assert found.half == pytest.approx(0.5)
    assert found.slip_error[-1] == pytest.approx(1.0)


def test_a_loaded_start_is_judged_by_what_has_turned_since():
    found = judge(answers(TURNED - 3.0, since=np.nan))
    assert found.error == pytest.approx(0.0)


def test_an_angle_that_is_counted_anew_is_told_apart():
    angle = np.r_[TURNED[:6], np.nan, TURNED[7:] - 5.0]
    anew, since = np.repeat([0, 1], [7, 5]), np.repeat([0.04, 0.28], [7, 5])
    found = judge(answers(angle, anew, since))
    assert np.nansum(np.abs(found.error)) == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(found.error[4])
    assert found.anew.tolist() == [False] * 5 + [True] * 5


def test_states_may_be_late_but_not_by_much():
    slip, stick = State.MACRO_SLIP, State.STICK
    true = [stick] * 4 + [slip] * 4 + [stick] * 4
    late = [stick] * 6 + [slip] * 4 + [stick] * 2
    assert judge_states(answers(TURNED, state=late, true=true))[0].all()
    right, called, missed = judge_states(answers(TURNED, state=[slip] * N, true=[stick] * N))
    assert (right.sum(), called, missed) == (0, N, 0)
    assert judge_states(answers(TURNED, state=[stick] * N, true=[slip] * N))[1:] == (0, N)


def test_an_outcome_is_right_if_the_truth_slips_too():
    slips = [State.STICK] * 11 + [State.MACRO_SLIP]
    for outcome, true, right in (
        ("held", None, True),
        ("slipped", None, False),
        ("slipped", slips, True),
        ("unknown", slips, False),
    ):
        clip = answers(TURNED, true=true or [State.STICK] * N, outcome=outcome)
        assert has_right_outcome(clip) == right


@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_makes_scenes_that_differ(condition):
    one, other = (draw_scene(condition, draw) for draw in (0, 1))
    assert one.seed != other.seed
    assert type(one.contact.indenter) is not type(other.contact.indenter)
    assert len(one.path.approach) > one.first + 40
