"""Macro slip, the rest after it, and the grip after a turn back, live."""

import numpy as np
import pytest

from estimation.estimators.measurement import Measurement
from estimation.estimators.result import RESTS_OR_SLIDES, UNSEEN_TURN, State
from estimation.frames.noise import Noise
from estimation.frames.recording import layout_markers
from estimation.slip.disc import Disc
from estimation.slip.onset import Sight, SlipWatch
from estimation.slip.rest import RestWatch
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot

NONE = Measurement.none(np.zeros(4, dtype=bool))
SLIPS = State.MACRO_SLIP


def test_gel_at_rest_after_a_slip_is_unknown():
    watch, still = RestWatch(), Sight(still=True)
    states = [watch.judge(SLIPS, "", NONE, still) for _ in range(5)]
    assert states[:3] == [(SLIPS, "")] * 3  # the slip is reported in any case
    assert states[3:] == [(State.UNKNOWN, RESTS_OR_SLIDES)] * 2
    # it moves: one frame does not show whether the object slides on or turns the gel with it
    assert watch.judge(SLIPS, "", NONE, Sight()) == (State.UNKNOWN, RESTS_OR_SLIDES)
    assert watch.judge(SLIPS, "", NONE, Sight()) == (SLIPS, "")


def test_gel_that_stops_in_a_slip_is_unknown_at_once():
    watch = RestWatch()
    states = [watch.judge(SLIPS, "", NONE, Sight(paused=i == 3))[0] for i in range(5)]
    assert states == [SLIPS, SLIPS, SLIPS, State.UNKNOWN, SLIPS]


@pytest.mark.parametrize("stops", [True, False])
def test_a_stop_is_noticed_in_its_first_frame(stops):
    rng = np.random.default_rng(3)
    reference = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), -1).reshape(-1, 2)
    layout = layout_markers(reference)
    watch, paused = SlipWatch(layout, Noise.from_std(0.01)), []
    for frame in range(30):
        turned = 0.003 * (min(frame, 20) if stops else frame)
        turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
        moved = (reference - 3.5) @ turn.T + 3.5 + rng.normal(scale=0.01, size=reference.shape)
        paused.append(watch.update(moved, np.ones(64, dtype=bool), frame / 30.0).paused)
    assert not any(paused[:21])
    assert paused[21:23] == [stops] * 2


def test_an_outline_that_turns_shows_the_slide():
    watch, still = RestWatch(), Sight(still=True)
    angles = 0.02 * np.minimum(np.arange(12), 7)  # it stops in the eighth frame
    seen = [NONE._replace(angle=angle, low=angle - 0.01, high=angle + 0.01) for angle in angles]
    answers = [watch.judge(SLIPS, "", gel, still) for gel in seen]
    assert answers[:8] == [(SLIPS, "")] * 8
    assert answers[-1] == (State.UNKNOWN, RESTS_OR_SLIDES)


def test_a_grip_ends_the_slip_until_the_disc_closes():
    watch = RestWatch()
    grips, open_disc = Sight(grips=True), Sight(Disc(0.0, 1.0, 0.1, 0.0))
    # in the first frames of a slip, the contact has held just before
    assert [watch.judge(SLIPS, "", NONE, grips)[0] for _ in range(3)] == [SLIPS] * 3
    assert watch.judge(SLIPS, "", NONE, grips) == (State.UNKNOWN, UNSEEN_TURN)
    assert watch.judge(SLIPS, "", NONE, open_disc) == (State.UNKNOWN, UNSEEN_TURN)
    assert watch.judge(SLIPS, "", NONE, open_disc) == (State.UNKNOWN, UNSEEN_TURN)
    assert watch.judge(SLIPS, "", NONE, open_disc._replace(closed=True))[0] == SLIPS
    known = NONE._replace(angle=0.1, low=0.0, high=0.2)
    assert watch.judge(SLIPS, "", known, grips) == (SLIPS, "")  # the outline decides
    watch.judge(State.NO_CONTACT, "", NONE, Sight())
    assert watch.judge(SLIPS, "", NONE, open_disc)[0] == SLIPS  # another contact


@pytest.mark.parametrize(
    ("margins", "open_for"),
    [([1.0, 1.0], 2), ([1.0, 0.8], 1), ([1.0, np.nan, 0.6], 0), ([1.0, 0.4], -1)],
)
def test_frames_without_a_disc_do_not_show_that_it_has_closed(margins, open_for):
    watch = RestWatch()
    for _ in range(4):
        watch.judge(SLIPS, "", NONE, Sight(grips=True))
    seen = [*margins, *[np.nan] * 4]
    states = [
        watch.judge(SLIPS, "", NONE, Sight(None if np.isnan(m) else Disc(0.0, m, 0.1, 0.0)))[0]
        for m in seen
    ]
    held = len(margins) + open_for
    assert states[len(margins) - 1 : held] == [State.UNKNOWN] * (open_for + 1)
    assert states[held:] == [SLIPS] * (len(seen) - held)


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_a_pivot_that_turns_back_holds_at_once(noise):
    model = PivotModel(friction_ratio=0.1, noise=noise, normal_noise=3.5 * noise)
    legs = {"angles_deg": (0.0, 20.0, 20.0, 0.0), "frames": (60, 12, 40)}
    recording, truth = simulate_pivot(
        model, seed=4, timing=Timing(dropped=0.0, jitter=0.0), noise_window=1, **legs
    )
    slips = truth.macro_slip
    assert slips.any()
    onset = int(np.argmax(slips))
    again = onset + int(np.argmax(~slips[onset:]))  # rests, then turns back
    result = estimate_angles(recording, noise=Noise.from_std(noise))
    reported = np.flatnonzero(result.slipping)
    assert abs(int(reported[0]) - onset) <= 3
    turned = int(np.flatnonzero(np.diff(truth.angle) < 0.0)[0]) + 1  # first frame of the turn back
    assert again <= turned
    held = truth.sticking_now.sum(axis=1) >= 10
    held[: turned + 2] = False
    assert held.sum() > 15
    assert not result.slipping[held].any()
