"""Following the object: increments, reversals, macro slip."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.estimators.keyframe import Keyframe, Leg
from estimation.estimators.keyframes import KeyframeSettings
from estimation.estimators.result import RESTS_OR_SLIDES, State
from estimation.estimators.tracked import TrackedSettings
from estimation.frames.noise import Noise, estimate_noise
from estimation.frames.recording import Frame, Recording, layout_markers
from estimation.slip.motion import accumulate_slip
from estimation.softness import ScalarSoftness
from estimation.tracking.tracker import Tracker, estimate_angles
from estimation.virtual.recording import (
    PivotModel,
    deform,
    lay_out_markers,
    see_all,
    simulate_pivot,
)
from papers.leaderboard.cases import list_cases
from papers.leaderboard.strained import simulate
from papers.limits import angle_limit
from tests.cases import domed_pad, recording_of, slow_case, turn_about_z
from tests.estimation.fields.test_outline import pressed_by_an_ellipsoid

MICRON = Noise(in_plane=1e-3, normal=3e-3, correlation=(0.0, 0.0), frames=100)


@pytest.fixture(scope="module")
def pivot():
    return simulate_pivot(seed=1)


@pytest.fixture(scope="module")
def followed(pivot):
    """Its angles, by method."""
    return {method: estimate_angles(pivot[0], method) for method in ("incremental", "tracked")}


@pytest.mark.parametrize("method", ["incremental", "tracked"])
def test_a_reversal_is_followed(pivot, followed, method):
    _, truth = pivot
    result = followed[method]
    firm = truth.sticking_now.sum(axis=1) >= 10
    error = np.degrees(np.abs(result.angle - truth.angle))
    assert result.answered[firm].all()
    assert error[firm].mean() < 0.05
    inside = (result.low <= truth.angle) & (truth.angle <= result.high)
    # frames of one recording share their markers and keyframes: few independent draws
    assert inside[firm].mean() > 0.8


def test_an_angle_from_a_first_frame_in_contact_counts_from_there(pivot):
    """A loaded first frame may be the only reference: earlier rotation is unknown."""
    recording, truth = pivot
    loaded = int((truth.angle > np.radians(3.0)).argmax())
    layout = layout_markers(recording.positions[loaded])
    touched = truth.sticking_now[loaded]
    tracker = Tracker(layout, noise=MICRON)
    for i in range(loaded, loaded + 4):
        frame = Frame(recording.positions[i], recording.time[i], i, contact=touched)
        answer = tracker.update(frame)
        assert answer.restarts == 1
        assert answer.since == recording.time[loaded]
        assert answer.angle == pytest.approx(truth.angle[i] - truth.angle[loaded], abs=0.002)


def test_the_reversal_frees_markers_that_the_total_angle_has_lost():
    model = PivotModel(friction_ratio=0.11)
    recording, truth = simulate_pivot(model, seed=22)
    total = estimate_angles(recording, "rigid")
    followed = estimate_angles(recording, "incremental")
    after = (recording.source_index > 85) & (recording.source_index < 120)
    assert followed.stick[after].sum() > 1.5 * total.stick[after].sum()
    error = np.degrees(np.abs(followed.angle - truth.angle))[after]
    assert np.nanmax(error) < 0.5


def test_a_keyframe_made_while_all_but_four_markers_slipped_is_not_believed():
    """Ever after the object rests, and the whole gel seems to stick to where it was made."""
    model = PivotModel(friction_ratio=0.1015, offset=(-0.42, -0.1), grid_angle=0.945)
    legs = {"angles_deg": (0.0, 10.0, 10.0, 4.0), "frames": (40, 15, 18)}
    recording, truth = simulate_pivot(model, seed=2, **legs)
    result = estimate_angles(recording, "incremental")
    turned = recording.source_index >= 80
    error = np.degrees(np.abs(result.angle - truth.angle))[turned]
    # believed, it cuts off the last 0.8° of the turn; four markers 0.7 mm from the axis know 0.1°
    assert error.max() < 0.25
    inside = (result.low <= truth.angle) & (truth.angle <= result.high)
    assert inside[turned].mean() > 0.9


@pytest.mark.parametrize("seed", [901, slow_case(905)])
def test_a_newer_keyframe_takes_the_angle_of_an_older_one_that_still_holds(seed):
    """On the way back of a large turn, keyframes made near its end cut off 1 to 2° of it."""
    sphere = next(c for c in list_cases("tuning").values() if c.group == "sphere")
    recording, truth = simulate(sphere, seed)
    result = estimate_angles(recording, "incremental", noise=MICRON)
    back = np.arange(len(recording.time)) > np.nanargmax(np.abs(truth.angle))
    error = np.degrees(np.abs(result.angle - truth.angle))[back]
    assert error.max() < 0.5
    inside = (result.low <= truth.angle) & (truth.angle <= result.high)
    assert inside[back].mean() > 0.9


@pytest.mark.parametrize("seed", [1, slow_case(3), slow_case(4)])
def test_markers_that_creep_do_not_make_the_angle_jump(seed):
    """Each marker wanders on the object, so that counts from two keyframes differ by 0.1°."""
    legs = {"angles_deg": (0.0, 10.0), "frames": (40,)}
    recording, truth = simulate_pivot(PivotModel(friction_ratio=0.3), seed=seed, **legs)
    noise, creep = 1e-3, 2e-3
    wandered = np.random.default_rng(seed).normal(size=recording.positions.shape)
    wandered = np.cumsum(creep * wandered * [1.0, 1.0, 0.0], axis=0)
    creeping = replace(recording, positions=recording.positions + wandered)
    result = estimate_angles(creeping, "incremental", noise=MICRON)
    firm = result.answered & (truth.sticking_now.sum(axis=1) >= 10)
    firm = firm[1:] & firm[:-1]
    steps = np.diff(result.angle - truth.angle)[firm]
    points, step_noise = recording.layout.reference[:, :2], np.sqrt(2.0 * noise**2 + creep**2)
    bound = [angle_limit(points, stick, step_noise) for stick in truth.sticking_now[1:][firm]]
    # counts alone: 1.7 to 4.8 times the bound of two frames' noise and one frame's creep
    assert np.sqrt(np.mean(steps**2)) < 1.4 * np.sqrt(np.mean(np.square(bound)))
    inside = (result.low <= truth.angle) & (truth.angle <= result.high)
    assert inside[result.answered].mean() > 0.95


def test_a_keyframe_moves_within_its_interval():
    keyframe = Keyframe(None, 0, angle=0.1, error=0.01, lag_low=0.05, lag_high=0.02)
    moved = keyframe.move(0.08)
    assert (moved.angle, moved.low, moved.high) == pytest.approx(
        (0.08, keyframe.low, keyframe.high)
    )
    assert keyframe.move(0.3).angle == keyframe.high
    assert keyframe.move(0.3).high > keyframe.high  # its error remains


def test_a_keyframe_whose_markers_missed_a_later_turn_reaches_as_far():
    keyframe, later = (Keyframe(None, n, angle, error=1e-3) for n, angle in ((0, 0.1), (5, 0.14)))
    slid = keyframe.see_slip(later, turned=0.0, error=1e-3)  # gel at rest
    assert slid.high == pytest.approx(0.14, abs=1e-4)
    assert (slid.angle, slid.low) == (keyframe.angle, keyframe.low)
    assert keyframe.see_slip(later, turned=0.037, error=1e-3) is keyframe
    assert keyframe.see_slip(later._replace(angle=np.nan), turned=0.0, error=1e-3) is keyframe


def turn_back(angles_deg, noise_deg=0.01):
    """The frame at which a motion is found to have turned back, and the frame of the finding."""
    leg = Leg()
    for number, angle in enumerate(np.radians(angles_deg)):
        found = leg.update(Keyframe(None, number, angle), np.radians(noise_deg))
        if found is not None:
            return found.number, number
    return None


def test_a_turning_point_is_its_last_frame():
    there, back = np.arange(0.0, 5.0, 0.5), np.arange(5.0, 3.0, -0.5)
    assert turn_back([*there, *back]) == (10, 11)
    assert turn_back([*there, 5.0, 5.01, 4.99, *back]) == (13, 14)
    assert turn_back(there) is None
    assert turn_back([0.0, 0.02, -0.02, 0.01]) is None  # at rest
    assert turn_back([*there, *back], noise_deg=0.2) == (12, 13)  # 4√2 of 0.2° are two frames


@pytest.mark.parametrize("seed", [2, 11, slow_case(5)])
def test_after_a_turn_few_markers_hold_to_one_body(seed):
    """What slipped in the last frames before the turn has turned less, and sticks after it."""
    model = PivotModel(friction_ratio=0.105)
    legs = {"angles_deg": (0.0, 10.0, 10.0, -4.0), "frames": (30, 6, 30)}
    recording, truth = simulate_pivot(model, seed=seed, **legs)
    result = estimate_angles(recording, "incremental", noise=MICRON)
    turn = int(np.nanargmax(truth.angle))
    firm = (truth.sticking_now.sum(axis=1) >= 10) & (np.arange(len(truth.angle)) > turn)
    error = np.degrees(np.abs(result.angle - truth.angle))[firm]
    # the angle at the turn is known to 0.1° by four markers and more; later steps add 0.01°
    assert error.max() < 0.35
    assert np.ptp(np.degrees(result.angle - truth.angle)[firm][10:]) < 0.2


def test_macro_slip_is_seen_when_the_last_markers_slip(pivot, followed):
    recording, truth = pivot
    result = followed["tracked"]
    slipping = np.array([state == State.MACRO_SLIP for state in result.state])
    first = recording.source_index[np.argmax(slipping & (recording.source_index > 60))]
    true_first = recording.source_index[np.argmax(truth.macro_slip)]
    # three markers that slip alike look like three that stick for some frames
    assert abs(first - true_first) <= 8
    # once the gel rests, the object may rest with it
    after = np.array(result.state)[recording.source_index > true_first + 8]
    assert set(after) <= {State.MACRO_SLIP, State.UNKNOWN}
    assert not result.stick[recording.source_index > true_first + 8].any()


def test_a_contact_that_has_slipped_before_is_counted_from_its_first_frame(pivot):
    recording, truth = pivot
    start = int(
        np.argmax(recording.source_index >= 85)
    )  # the reversal, the core's old twist inside
    rows = slice(start, start + 30)
    rough = np.random.default_rng(0).normal(size=(400, 3)) * [0.05, 0.05, 0.0]  # no core is left
    late = Recording(
        layout=recording.layout,
        positions=recording.positions[rows] + rough,
        valid=recording.valid[rows],
        time=recording.time[rows],
        source_index=recording.source_index[rows],
    )
    result = estimate_angles(late, "incremental", noise=estimate_noise(recording))
    turned = np.degrees(truth.angle[rows] - truth.angle[start])
    assert result.angle[0] == 0.0
    assert np.degrees(result.angle) == pytest.approx(turned, abs=0.1)


@pytest.mark.parametrize("spoilt", [slow_case((30,)), (50, 51)])
def test_frames_in_which_noise_hides_what_sticks_are_passed_over(pivot, spoilt):
    recording, truth = pivot
    rough = np.random.default_rng(0).normal(size=(400, 3)) * [0.05, 0.05, 0.0]  # no core is left
    positions = recording.positions.copy()
    rows = np.isin(recording.source_index, spoilt)
    positions[rows] += rough
    noise = estimate_noise(recording)
    result = estimate_angles(replace(recording, positions=positions), "incremental", noise=noise)
    firm = (truth.sticking_now.sum(axis=1) >= 10) & ~rows
    assert [result.state[i] for i in np.flatnonzero(rows)] == [State.UNKNOWN] * len(spoilt)
    assert all("no marker seems to stick" in result.reason[i] for i in np.flatnonzero(rows))
    assert result.answered[firm].all()
    assert np.degrees(np.abs(result.angle - truth.angle))[firm].mean() < 0.05  # as without


def test_a_contact_whose_first_frame_is_spoilt_is_counted_from_the_unloaded_shape(pivot, followed):
    recording, truth = pivot
    first = int(np.flatnonzero(followed["incremental"].contact.any(axis=1))[0])
    rough = np.random.default_rng(0).normal(size=(400, 3)) * [0.05, 0.05, 0.0]
    positions = recording.positions.copy()
    positions[first] += rough
    spoilt = replace(recording, positions=positions)
    result = estimate_angles(spoilt, "incremental", noise=estimate_noise(recording))
    firm = truth.sticking_now.sum(axis=1) >= 10
    firm[first] = False
    assert result.answered[firm].all()
    assert np.degrees(np.abs(result.angle - truth.angle))[firm].mean() < 0.05  # as without


def slow_press(frames: int, seed: int, turning: int = 20) -> tuple[Recording, np.ndarray]:
    """A ball is pressed 0.5 mm deep into thick gel, slowly at first, and then turned by 5°.

    Returns:
        The recording, with a noise of 10 µm, and the object's angle [rad].
    """
    layout, ball, deepest = domed_pad(), 10.0, 0.5
    x, y, z = layout.reference.T
    r = np.hypot(x, y)
    depth = np.r_[np.zeros(5), np.linspace(0.1, deepest, frames), np.full(turning, deepest)][
        :, None
    ]
    angle = np.radians(5.0 * np.r_[np.zeros(5 + frames), np.arange(1, turning + 1) / turning])
    edge = np.sqrt(ball * depth)
    out = np.maximum(r, edge)
    share = edge / out
    sunk = (2 * edge**2 - out**2) * np.arcsin(share) + out**2 * share * np.sqrt(1 - share**2)
    sunk = np.where(r < edge, depth - r**2 / (2 * ball), sunk / (np.pi * ball))  # [Johnson1985]
    turned = angle[:, None] * np.exp(-np.clip((r - 1.5) / 2.0, 0.0, None))
    c, s = np.cos(turned), np.sin(turned)
    moved = np.stack([c * x - s * y, s * x + c * y, z - sunk], axis=-1)
    noise = np.random.default_rng(seed).normal(size=moved.shape) * [1e-2, 1e-2, 3.5e-2]
    return recording_of(layout, moved + noise), angle


@pytest.mark.parametrize(
    ("frames", "seed"),
    [(150, 0), slow_case(150, 2), slow_case(200, 4)],
)
def test_noise_in_a_slow_press_is_not_taken_for_slip(frames, seed):
    recording, angle = slow_press(frames, seed)
    result = estimate_angles(recording, noise=Noise.from_std(1e-2))
    turns = angle > 0.0
    assert result.answered[turns].all()
    assert not result.slipping.any()
    assert result.low[-1] < angle[-1] < result.high[-1]


def test_a_contact_lost_before_many_markers_stuck_counts_on_once_they_do():
    model = PivotModel(friction_ratio=0.3)
    layout, rng = lay_out_markers(model), np.random.default_rng(0)
    load = np.r_[np.zeros(4), np.full(4, 0.12), np.ones(20)]
    twist = np.r_[np.full(4, np.nan), np.zeros(8), np.radians(np.linspace(0.0, 6.0, 16))]
    positions, truth = deform(model, layout, load, twist)
    positions += rng.normal(size=positions.shape) * [1e-3, 1e-3, 3e-3]
    positions[7] += rng.normal(size=positions[7].shape) * [0.05, 0.05, 0.0]  # nothing sticks
    result = estimate_angles(see_all(layout, positions), "incremental", noise=MICRON)
    assert 3 <= result.stick_markers[6] < 12
    assert not result.answered[7]
    assert result.answered[8:].all()
    assert np.degrees(np.abs(result.angle - truth.angle))[8:].max() < 0.2


def ellipsoid_slips(frames=60, slip_from=20, slip_to=40, rate=1.0, share=1.0):
    """An ellipsoid turns; the gel takes a share of it but for frames in which it stands still.

    Returns:
        The recording and the object's angle [deg].
    """
    layout = domed_pad()
    angle = rate * np.arange(frames)
    gel = share * rate * np.cumsum((np.arange(frames) < slip_from) | (np.arange(frames) >= slip_to))
    positions = []
    for i in range(frames):
        r = np.hypot(*layout.reference[:, :2].T)
        turned = np.radians(gel[i] - gel[0]) * np.exp(-np.clip((r - 4.0) / 3.0, 0.0, None))
        moved = np.stack(
            [turn_about_z(p, a) for p, a in zip(layout.reference, turned, strict=True)]
        )
        positions.append(pressed_by_an_ellipsoid(moved, np.radians(angle[i]), noise=0.0))
    noise = np.random.default_rng(0).normal(size=(frames, 400, 3)) * [1e-3, 1e-3, 3e-3]
    return recording_of(layout, np.stack(positions) + noise), angle


@pytest.fixture(scope="module")
def outlined():
    """Angles of an ellipsoid that slips and sticks again, and the true ones [deg]."""
    recording, angle = ellipsoid_slips()
    return estimate_angles(recording, "tracked", noise=MICRON), angle


def test_the_outline_takes_over_without_a_jump_and_hands_back(outlined):
    result, angle = outlined
    assert result.answered.all()
    found = np.degrees(result.angle)
    error = found - angle
    assert np.abs(error[:20]).max() < 0.3
    # slip is noticed when the outline is 2° ahead; until then the gel speaks
    slipping = np.array([state == State.MACRO_SLIP for state in result.state])
    assert not slipping[:20].any()
    assert slipping[25:40].all()
    assert np.abs(error[25:]).max() < 1.5
    assert not slipping[-5:].any()  # sticks again
    # a step of the outline's own error at the hand-over, no more
    assert np.abs(np.diff(found)[30:]).max() < 2.5
    held = (np.degrees(result.low) <= angle) & (angle <= np.degrees(result.high))
    assert held[25:].mean() > 0.8


def test_the_slip_grows_by_what_the_object_turns_over_gel_that_stands_still(outlined):
    result, angle = outlined
    slip = np.degrees(accumulate_slip(result))
    # the outline's own error, as above
    assert slip[38] - slip[26] == pytest.approx(angle[38] - angle[26], abs=1.5)
    # before and after, gel that sticks turns along
    assert abs(slip[18] - slip[10]) < 2.5
    assert np.isnan(slip).sum() == 0


def test_an_imprint_is_followed_however_long_all_slips():
    frames = TrackedSettings.memory + 35
    recording, angle = ellipsoid_slips(frames, slip_from=20, slip_to=frames, rate=0.5)
    error = np.full(frames, np.radians(0.3))
    imprint = np.stack([np.radians(angle), error], axis=1)
    result = estimate_angles(replace(recording, imprint=imprint), "tracked", noise=MICRON)
    assert result.answered.all()
    # 2° of slip before it is noticed; then the imprint, exact here, and what it was set against
    assert np.abs(np.degrees(result.angle) - angle).max() < 2.5


def test_the_outline_is_the_objects_and_the_softness_correction_the_gels():
    recording, angle = ellipsoid_slips(share=1 / 1.5)
    soft = ScalarSoftness(stiffness_ratio=0.5)
    result = estimate_angles(recording, "tracked", noise=MICRON, softness=soft)
    slipping = np.array([state == State.MACRO_SLIP for state in result.state])
    assert not slipping[:20].any()
    assert slipping[26:40].all()
    error = np.degrees(result.angle) - angle
    assert np.abs(error[:20]).max() < 0.3
    assert np.abs(error[26:]).max() < 1.5


def test_a_round_object_is_lost_in_macro_slip_and_said_so(pivot, followed):
    _, truth = pivot
    result = followed["tracked"]
    last = np.nonzero(truth.macro_slip)[0][-1]
    assert result.slipping.any()
    # in the end the gel rests, as it would under an object that has stopped
    assert result.state[last] == State.UNKNOWN
    assert np.isnan(result.angle[last])
    assert result.reason[last] == RESTS_OR_SLIDES


def test_keyframes_stay_few(pivot):
    recording, _ = pivot
    tracker = Tracker(recording.layout, "tracked", noise=MICRON)
    for frame in recording:
        tracker.update(frame)
        kept = tracker.estimator.incremental.keyframes.kept
        assert len(kept) <= KeyframeSettings.most_keyframes


def test_a_single_keyframe_is_refused():
    with pytest.raises(ValueError, match="most_keyframes is 1; it must be at least 2"):
        KeyframeSettings(most_keyframes=1)


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_an_outline_that_turns_less_does_not_take_over_from_a_gel_that_turns(share):
    layout, angle = domed_pad(), np.concatenate([[0.0], np.linspace(0.0, 24.0, 25)])
    positions = [
        pressed_by_an_ellipsoid(turn_about_z(layout.reference, a), share * a, noise=0.0)
        for a in np.radians(angle)
    ]
    positions[0] = layout.reference
    noise = np.random.default_rng(0).normal(size=(len(angle), 400, 3)) * [1e-3, 1e-3, 3e-3]
    result = estimate_angles(
        recording_of(layout, np.stack(positions) + noise), "tracked", noise=MICRON
    )
    assert State.MACRO_SLIP not in result.state
    np.testing.assert_allclose(np.degrees(result.angle[1:]), angle[1:], atol=0.1)


def turned_beside_the_middle(dims):
    """Markers at a corner of a region that seems touched turn by 0.4°; all others rest."""
    rest = np.stack(np.meshgrid(np.arange(11.0), np.arange(11.0)), -1).reshape(-1, 2)
    near = np.linalg.norm(rest - 2.5, axis=1) < 2.0
    angles = np.radians([0.0, 0.0, 0.1, 0.2, 0.3, 0.4])
    turned = np.stack([np.where(near, angle, 0.0) for angle in angles])
    c, s = np.cos(turned)[..., None], np.sin(turned)[..., None]
    arms = rest - 2.5
    moved = 2.5 + c * arms + s * arms[:, ::-1] * [-1.0, 1.0]
    if dims == 3:
        rest = np.insert(rest, 2, 0.0, axis=1)
        moved = np.insert(moved, 2, -0.1, axis=2)
        moved[0, :, 2] = 0.0
    tracker = Tracker(layout_markers(rest), "tracked", noise=Noise.from_std(1e-4))
    touched = np.ones(len(rest), dtype=bool)
    frames = [Frame(place, float(i), i, contact=touched & (i > 0)) for i, place in enumerate(moved)]
    return [tracker.update(frame) for frame in frames]


def test_in_pictures_the_interval_reaches_to_the_gel_that_has_turned_furthest():
    """The contact may seem too large there. Friction turns the gel no further than the object."""
    in_picture, measured = turned_beside_the_middle(2)[-1], turned_beside_the_middle(3)[-1]
    for last in (in_picture, measured):
        assert abs(np.degrees(last.angle)) < 0.1  # the gel at rest
    assert np.degrees(in_picture.high) > 0.4
    assert np.degrees(measured.high) < 0.2


def test_light_moves_the_dots_of_pictures_by_a_thousandth_of_their_distance():
    in_picture, measured = turned_beside_the_middle(2)[1], turned_beside_the_middle(3)[1]
    arms = 11.0 * np.sqrt(20.0)  # root sum of squares [pitches]
    error = 1.96e-3 / arms
    assert in_picture.high - measured.high == pytest.approx(error, rel=0.01)
