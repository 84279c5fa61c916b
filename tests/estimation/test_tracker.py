from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.choices import AlertSettings, ContactSettings
from estimation.estimators import METHODS
from estimation.estimators.result import State
from estimation.frames.inspection import inspect_recording
from estimation.frames.noise import Noise
from estimation.frames.recording import Frame, layout_markers
from estimation.settings import Settings
from estimation.slip.alert import AlertLevel
from estimation.tracking.stream import Stream
from estimation.tracking.tracker import Tracker, estimate_angles
from estimation.tracking.trackers import Trackers
from tests.cases import domed_pad, lift, slow_case

MICRON = Noise(in_plane=1e-3, normal=3e-3, correlation=(0.0, 0.0), frames=100)
ANGLES = np.radians(np.linspace(0.0, 12.0, 25))


@cache
def answers_of(method="tracked"):
    """Those to a whole lift, for all tests that compare with them."""
    return estimate_angles(lift(ANGLES), method, noise=MICRON)


@pytest.mark.parametrize("method", METHODS)
def test_one_frame_at_a_time_gives_the_same_numbers(method):
    recording = lift(ANGLES)
    result = answers_of(method)
    tracker = Tracker(recording.layout, method, noise=MICRON)
    for i, frame in enumerate(recording):
        estimate = tracker.update(frame)
        assert estimate.state == result.state[i]
        assert estimate.time == result.time[i]
        np.testing.assert_array_equal(
            [estimate.angle, estimate.low, estimate.high],
            [result.angle[i], result.low[i], result.high[i]],
        )
        np.testing.assert_array_equal(estimate.stick, result.stick[i])


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_a_clock_in_another_unit_is_doubted_once(factor):
    recording = lift(ANGLES)
    tracker = Tracker(recording.layout, noise=MICRON)
    tracker.update_positions(recording.positions[0], np.nan)

    def follow():
        return [tracker.update_positions(f.positions, factor * f.time) for f in recording]

    with pytest.warns(UserWarning, match="are the time stamps in s") as caught:
        follow()
    assert len(caught) == 1


@pytest.mark.parametrize("rate", [200.0, 2000.0, slow_case(500.0), slow_case(1000.0)])
def test_a_fast_clock_in_ms_is_doubted(rate):
    recording = lift(ANGLES)

    def follow(unit, **alert):
        tracker = Tracker(recording.layout, noise=MICRON, alert=AlertSettings(**alert))
        for number, frame in enumerate(recording):
            tracker.update_positions(frame.positions, number / rate * unit)

    follow(1.0)  # a warning would be an error here
    follow(1e3, act_s=400.0)  # the whole program counts in ms
    with pytest.warns(UserWarning, match=r"stamps in s\?.*than `act` comes before a slip, 0.4 s"):
        follow(1e3)


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1e6])
def test_lengths_and_noise_in_another_unit_are_doubted(factor):
    layout, reference = lift(ANGLES).layout, lift(ANGLES).layout.reference
    with pytest.warns(UserWarning, match=r"markers lie .* mm apart: are the lengths in mm\?"):
        Tracker(layout_markers(factor * reference), noise=MICRON)
    with pytest.warns(UserWarning, match=r"mistaken for each other: is the noise in mm\?"):
        Tracker(layout, noise=Noise.from_std(1.0))  # 1 µm in µm
    for unit in ("mm", "px"):  # 20 px and 0.05 px, or 1 mm and 20 µm
        scale, noise = (1.0, 0.02) if unit == "mm" else (20.0, 0.05)
        Tracker(layout_markers(scale * reference), noise=Noise.from_std(noise, unit))


def test_a_pause_or_a_backward_clock_is_not_doubted():
    recording = lift(ANGLES)
    for times in (recording.time + 3600.0 * (recording.time > 0.2), -recording.time):
        tracker = Tracker(recording.layout, noise=MICRON)  # a warning would be an error here
        for positions, time in zip(recording.positions, times, strict=True):
            tracker.update_positions(positions, time)


@pytest.mark.parametrize("method", METHODS)
def test_the_past_does_not_know_the_future(method):
    part = estimate_angles(lift(ANGLES).head(18), method, noise=MICRON)
    np.testing.assert_array_equal(part.angle, answers_of(method).angle[:18])


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        ([1e-3, 1e-3, 1e-3], "are the lengths in mm"),
        ([1.0, 1.0, -1.0], "does z point out of the pad"),
    ],
)
def test_a_missing_contact_hints_at_wrong_units_and_directions(factor, words):
    recording = lift(ANGLES)
    tracker = Tracker(layout_markers(recording.layout.reference * factor))
    for positions, time in zip(recording.positions, recording.time, strict=True):
        answer = tracker.update_positions(positions * factor, time)
    assert answer.state == State.NO_CONTACT
    assert words in answer.reason


def test_what_a_loop_may_pass_by_mistake(unchecked):
    layout = lift(ANGLES).layout
    with pytest.raises(ValueError, match=r"Noise\.from_std"):
        Trackers(layout, {"tracked": {}}, noise=1e-3)
    with pytest.raises(ValueError, match="mm or px"):
        Noise.from_std(1e-3, unit="m")
    with pytest.raises(ValueError, match=r"\(400, 1\)"):
        layout_markers(np.zeros((400, 1)))
    places = layout.reference.copy()
    places[7] = np.inf
    frame = Frame(places, time=0.0, source_index=0)
    assert np.isnan(frame.positions[7]).all()
    assert not frame.valid[7]
    with pytest.raises(ValueError, match="in seconds is expected, a number, got NoneType"):
        Tracker(layout).update_positions(layout.reference, None)
    with pytest.raises(ValueError, match=r"a recording is expected, got ndarray: .*Tracker"):
        estimate_angles(places)
    with pytest.raises(ValueError, match=r"in px, lengths are in mm: give it in µm") as found:
        estimate_angles(lift(ANGLES), noise=Noise.from_std(0.1, "px"))
    assert "--mm-per-px" not in str(found.value)  # markers have no pixels
    with pytest.raises(ValueError, match=r"a source of frames is expected, got str: .*open"):
        Stream("clip.mp4", Settings())
    with pytest.raises(ValueError, match=r"Noise\.from_std"):
        Stream(lift(ANGLES), Settings(noise=1e-3))


def test_positions_may_be_masked_lists_or_whole_numbers(unchecked):
    recording = lift(ANGLES)
    tracker = Tracker(layout_markers(recording.layout.reference.tolist()))
    hidden = np.zeros((400, 3), dtype=bool)
    hidden[recording.layout.reference[:, 0] < 0.0] = True
    wrong = np.ma.masked_array(np.where(hidden, 1e3, recording.positions[9]), hidden)
    tracker.update_positions(recording.positions[0].tolist(), 0.0)
    estimate = tracker.update_positions(wrong, 1.0)
    assert not estimate.contact[hidden[:, 0]].any()
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), -1).reshape(-1, 2)
    assert layout_markers(grid).reference.dtype == float


@pytest.mark.parametrize("flat", [False, True])
def test_markers_in_another_order_give_no_angle(flat):
    recording, rng = lift(ANGLES), np.random.default_rng(6)
    columns = 2 if flat else 3
    tracker = Tracker(layout_markers(recording.layout.reference[:, :columns]), noise=MICRON)
    for number, frame in enumerate(recording):
        positions = frame.positions[:, :columns]
        if number >= 12:
            positions = rng.permutation(positions)
        answer = tracker.update(replace(frame, positions=positions))
        assert ("changed places" in answer.reason) == (number >= 12)
        assert np.isnan(answer.angle) or number < 12


def test_states_and_their_bounds():
    recording = lift(ANGLES)
    result = answers_of()
    assert result.state[:5] == (State.NO_CONTACT,) * 5
    assert all(np.isfinite(result.angle[5:]))
    share = result.stick.sum(axis=1)[5:] / result.contact.sum(axis=1)[5:]
    expected = [State.STICK if s >= 0.9 else State.INCIPIENT for s in share]
    assert list(result.state[5:]) == expected
    assert State.INCIPIENT in expected
    generous = estimate_angles(recording, noise=MICRON, contact=ContactSettings(stick_share=0.01))
    assert set(generous.state[5:]) == {State.STICK}


@pytest.mark.parametrize(
    ("since", "state", "reason"),
    [
        (0.99, State.STICK, "the contact sticks, but the object's rotation so far is unknown"),
        (np.nan, State.UNKNOWN, "few markers stick, and the object's print does not show its slip"),
        (0.3, State.UNKNOWN, "few markers stick, and the object's print does not show its slip"),
    ],
)
def test_reason_where_the_print_stays_but_the_angle_is_unknown(since, state, reason):
    """Markers scattered by a sensor that saw no turn; the print is uniform or has slipped."""
    recording = lift(ANGLES)
    rest, touched = recording.layout.reference, recording.positions[-1]
    contact = rest[:, 2] - touched[:, 2] > 0.1
    tracker, rng = Tracker(recording.layout, noise=MICRON), np.random.default_rng(0)
    for number in range(6):
        scatter = rng.normal(size=rest.shape) * [0.1, 0.1, 0.0]
        stays = (since, 0.99, 0.99)
        last = tracker.update(
            Frame(touched + scatter, 0.1 * number, number, contact=contact, hold=stays)
        )
    assert last.state == state
    assert np.isnan(last.angle)
    assert last.reason.startswith(reason)


def test_a_print_that_shows_no_slide_is_no_alarm():
    recording = lift(ANGLES)
    contact = recording.layout.reference[:, 2] - recording.positions[-1][:, 2] > 0.1
    tracker = Tracker(recording.layout, noise=MICRON)
    for frame in recording.head(9):
        last = tracker.update(replace(frame, contact=contact, hold=(np.nan, 0.99, 0.99)))
    assert last.stick_markers > 9
    assert tracker.alert.level in (AlertLevel.NONE, AlertLevel.WATCH)


def test_noise_is_estimated_unless_given():
    recording = lift(np.radians(np.linspace(0, 5, 20)), unloaded=10)
    given = estimate_angles(recording, noise=MICRON)
    found = estimate_angles(recording)
    width = (found.high - found.low)[15:] / (given.high - given.low)[15:]
    assert np.median(width) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("method", METHODS)
def test_the_least_number_of_sticking_markers_is_an_argument(method):
    recording = lift(ANGLES)
    few = estimate_angles(recording, method, noise=MICRON, min_stick_markers=3)
    many = estimate_angles(recording, method, noise=MICRON, min_stick_markers=70)
    assert few.answered.sum() > many.answered.sum()
    assert (many.stick[many.answered].sum(axis=1) >= 70).all()


def test_a_flawed_frame_is_labelled_and_the_rest_goes_on():
    recording = lift(ANGLES)
    flaws = ["" for _ in range(len(recording))]
    flaws[12] = "all positions are zero"
    result = estimate_angles(replace(recording, flaws=tuple(flaws)), noise=MICRON)
    clean = answers_of()
    assert result.state[12] == State.UNKNOWN
    assert result.reason[12] == "all positions are zero"
    assert np.isnan(result.angle[12])
    np.testing.assert_array_equal(np.delete(result.angle, 12), np.delete(clean.angle, 12))


def test_a_frame_with_two_markers_left_is_labelled():
    recording = lift(ANGLES)
    valid = recording.valid.copy()
    valid[12] = False
    valid[12, [5, 200]] = True
    result = estimate_angles(replace(recording, valid=valid), noise=MICRON)
    assert (result.state[12], result.reason[12]) == (State.UNKNOWN, "2 usable markers")


@settings(max_examples=15)
@given(data=st.data())
def test_nothing_that_a_sensor_does_stops_a_recording(data):
    recording = lift(ANGLES[::3], layout=domed_pad((8, 8)), unloaded=3)
    positions = recording.positions.copy()
    time = recording.time.copy()
    frames = st.integers(0, len(recording) - 1)
    for frame in data.draw(st.lists(frames, max_size=3)):
        positions[frame] = 0.0
    for frame in data.draw(st.lists(frames, max_size=3)):
        positions[frame] = np.nan
    for frame in data.draw(st.lists(frames, max_size=3)):
        time[frame] = data.draw(st.sampled_from([np.nan, 0.0, 1e9, time[0]]))
    for marker in data.draw(st.lists(st.integers(0, 63), max_size=20)):
        start = data.draw(frames)
        positions[start:, marker] = data.draw(st.sampled_from([np.nan, 0.0, 1e3, -5.0]))
    valid = np.isfinite(positions).all(axis=-1)
    broken = inspect_recording(replace(recording, positions=positions, valid=valid, time=time))
    trackers = Trackers(recording.layout, {method: {} for method in METHODS}, noise=MICRON)
    for frame in broken:
        answers = trackers.update(frame)
        assert list(answers) == list(METHODS)
        for answer in answers.values():
            state, reason, angle = answer.state, answer.reason, answer.angle
            warned = reason == "of several contacts, one is followed"
            assert warned or bool(reason) == bool(np.isnan(angle))
            # the one documented state without an angle: the disc of sticking markers is still open
            unseen = state == State.INCIPIENT and reason.startswith("no slip is seen, but too few")
            assert np.isfinite(angle) or unseen or state not in (State.STICK, State.INCIPIENT)


def test_lost_markers_cost_accuracy_not_answers():
    recording = lift(ANGLES)
    valid = np.random.default_rng(1).random(recording.valid.shape) > 0.15
    positions = np.where(valid[..., None], recording.positions, np.nan)
    result = estimate_angles(replace(recording, valid=valid, positions=positions), noise=MICRON)
    assert result.answered[5:].mean() > 0.9
    error = np.degrees(np.abs(result.angle[5:] - ANGLES))
    assert np.nanmedian(error) < 0.02


def test_wrong_settings_are_refused():
    layout = domed_pad()
    with pytest.raises(
        ValueError, match="unknown method 'magic'; choose from tracked, incremental"
    ):
        Tracker(layout, "magic")
    with pytest.raises(ValueError, match="window_frames is 0"):
        Tracker(layout, "paper", window_frames=0)
    with pytest.raises(ValueError, match="min_stick_markers is 0"):
        Tracker(layout, "tracked", min_stick_markers=0)
    with pytest.raises(ValueError, match="threshold"):
        Tracker(layout, "rigid", threshold=0.0)
    message = "rigid has no setting 'window_frames'; it has angle_floor_deg"
    with pytest.raises(ValueError, match=message):
        Tracker(layout, "rigid", window_frames=3)
    tracker = Tracker(layout)
    with pytest.raises(ValueError, match="196 markers, the layout 400"):
        tracker.update(next(iter(lift(ANGLES, layout=domed_pad((14, 14))))))
    with pytest.raises(ValueError, match="2 columns, the layout's 3"):
        tracker.update_positions(layout.reference[:, :2], 0.0)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"positions": np.zeros((400, 3))}, "all marker positions are zero"),
        ({"time": np.nan}, "no time stamp"),
        ({"time": 0.0}, "time stamp not after the last frame's"),
    ],
)
def test_a_live_frame_that_cannot_be_used_does_not_end_the_contact(change, reason):
    frames = list(lift(ANGLES))
    tracker = Tracker(lift(ANGLES).layout, noise=MICRON)
    clean = Tracker(lift(ANGLES).layout, noise=MICRON)
    for frame in frames[:11]:
        tracker.update(frame)
        clean.update(frame)
    bad = tracker.update(replace(frames[11], **change))
    assert (bad.state, bad.reason) == (State.UNKNOWN, reason)
    following = tracker.update(frames[12])
    assert following.angle == clean.update(frames[12]).angle
    assert following.angle > np.radians(3.0)


def test_what_strains_as_no_one_body_is_unknown_not_slip():
    result = estimate_angles(lift(ANGLES), "rigid", noise=Noise.from_std(1e-5), max_strain=1e-5)
    refused = [i for i, reason in enumerate(result.reason) if reason.startswith("no rigid core")]
    assert refused
    assert all(result.state[i] == State.UNKNOWN for i in refused)


def test_fewer_markers_than_a_rigid_motion_needs_are_refused():
    for method in ("tracked", "rigid", "paper"):
        with pytest.raises(ValueError, match="min_stick_markers is 2; it must be at least 3"):
            Tracker(domed_pad(), method, min_stick_markers=2)


def test_constants_left_alone_are_known():
    tracker = Tracker(domed_pad(), "paper", window_frames=7)
    assert tracker.constants["window_frames"] == 7
    assert tracker.constants["min_stick_markers"] == 3
    assert "gain" not in Tracker(domed_pad(), "tracked").constants


def test_a_contact_that_is_mostly_out_of_view_is_not_answered():
    recording = lift(ANGLES)
    frame = list(recording)[10]
    x = recording.layout.reference[:, 0]
    corner = np.zeros(len(x), dtype=bool)
    corner[np.argsort(x)[:10]] = True  # a row at the edge of the markers
    cut = Tracker(recording.layout, noise=MICRON).update(replace(frame, contact=corner))
    assert cut.state == State.UNKNOWN
    assert "too little of the contact is in view" in cut.reason
    assert np.isnan(cut.angle)
    corner[np.argsort(x)[:40]] = True
    seen = Tracker(recording.layout, noise=MICRON).update(replace(frame, contact=corner))
    assert "edge of the view" in seen.reason


@pytest.mark.parametrize(
    ("hold", "state"),
    [
        ((0.99, 0.99, 0.95), State.STICK),
        ((0.99, 0.97, 0.3), State.INCIPIENT),
        ((0.1, 0.1, 0.0), State.MACRO_SLIP),
        ((np.nan,) * 3, State.UNKNOWN),
    ],
)
def test_a_contact_that_has_not_settled_has_the_state_that_its_print_tells(hold, state):
    recording = lift(ANGLES)
    contact = np.zeros(len(recording.layout.reference), dtype=bool)
    contact[:40] = True
    unsettled = {"contact": contact, "hold": hold, "flaw": "it has not settled"}
    trackers = Trackers(recording.layout, {"tracked": {}}, noise=MICRON)
    found = trackers.update(replace(list(recording)[10], **unsettled))["tracked"]
    assert (found.state, found.reason) == (state, "it has not settled")
    assert np.isnan(found.angle)
    assert np.isnan(
        trackers.shear.slip_probability
    )  # it may come in sliding, and is no slip of a grasp
