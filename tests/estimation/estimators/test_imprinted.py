"""Imprint and gel put together: slow slip, lost imprints, jumps and counting anew."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.estimators.imprinted import ImprintedTurn
from estimation.estimators.measurement import Z95
from estimation.fields.plane import shear_strain
from estimation.frames.recording import layout_markers
from estimation.slip.motion import accumulate_slip, describe_counts
from estimation.tracking.tracker import estimate_angles
from estimation.tracking.trackers import Trackers
from tests.estimation.estimators.test_incremental import MICRON, ellipsoid_slips

ERROR = np.radians(0.2)
"""Standard error that a made-up registration reports."""


def follow(object_, gel, seen=None, noise=0.0):
    """Turns found while object and gel turn as given [deg], the imprint seen in some frames."""
    rng = np.random.default_rng(4)
    turn, turns = ImprintedTurn(), []
    for i, (angle, along) in enumerate(zip(np.radians(object_), np.radians(gel), strict=True)):
        read = angle + np.radians(noise) * rng.normal() if i else 0.0
        imprint = (read, ERROR) if seen is None or seen[i] else (np.nan, np.nan)
        turns.append(turn.update(along, 0.0, imprint, lasting=True))
    return np.degrees([(one.angle, *one.interval) for one in turns]).T


def test_slow_slip_that_every_single_frame_hides_is_followed():
    object_ = np.linspace(0.0, -3.5, 80)  # 0.04° a frame, as a wallet creeps
    angle, low, high = follow(object_, 0.2 * object_, noise=0.1)
    assert np.abs(angle - object_).max() < 0.35  # three readings, and the filter's lag
    assert ((low <= object_) & (object_ <= high)).mean() > 0.95


def test_the_gel_carries_the_angle_while_the_imprint_is_lost_and_the_interval_grows():
    object_ = np.r_[np.linspace(0.0, 6.0, 30), np.full(70, 6.0)]
    gel = np.r_[object_[:40], np.full(60, 5.0)]  # creeps back by 1° meanwhile
    seen = (np.arange(100) < 20) | (np.arange(100) >= 90)
    angle, low, high = follow(object_, gel, seen)
    assert ((low <= object_) & (object_ <= high)).all()
    half = 0.5 * (high - low)
    assert half[19] < 0.6 < half[40] < half[60] < Z95 * 1.1 * 2.0  # °, the most creep
    assert angle[90] == pytest.approx(6.0, abs=0.1)
    assert half[90] < 0.6


def test_where_imprint_and_gel_part_at_once_the_interval_holds_both():
    object_ = np.r_[np.zeros(20), np.full(20, 5.0)]
    angle, low, high = follow(object_, np.zeros(40))
    assert low[20] < 0.0
    assert high[20] > 5.0
    assert np.abs(angle[20:] - 5.0).max() < 0.2


def test_a_slip_may_go_on_while_the_imprint_is_lost_and_where_it_begins_anew():
    object_ = np.r_[np.zeros(10), -2.4 * np.arange(1, 6), np.full(10, -12.0)]
    _, low, high = follow(object_, np.zeros(25), seen=np.arange(25) < 12)
    assert ((low <= object_) & (object_ <= high)).all()
    assert high[14] - low[14] > high[11] - low[11] + 10.0
    turn = ImprintedTurn()
    for now in (0.0, 0.0, -2.4, -4.8, np.nan, np.nan, 0.0, 0.1):  # two frames lost, then anew
        one = turn.update(0.0, 0.0, (np.radians(now), ERROR), lasting=True)
    low, high = np.degrees(one.interval)
    assert low < -12.0 < high


def test_gel_that_springs_back_once_the_imprint_is_lost_may_have_left_the_object():
    object_ = np.r_[np.linspace(0.0, 3.0, 20), np.full(5, 3.0)]
    gel = np.r_[object_[:20], np.linspace(2.5, 0.5, 5)]  # the object is let go
    _, low, high = follow(object_, gel, np.arange(25) < 20)
    assert ((low <= object_) & (object_ <= high)).all()
    assert ((low <= gel) & (gel <= high)).all()


def test_an_imprint_that_restarts_is_counted_on():
    turn, degree = ImprintedTurn(), np.radians(1.0)
    for i in range(5):
        turn.update(i * degree, 0.0, (i * degree, ERROR), lasting=True)
    again = turn.update(5 * degree, 0.0, (0.0, ERROR), lasting=True)
    assert np.degrees(again.angle) == pytest.approx(5.0, abs=0.1)
    assert again.error > 1.4 * ERROR  # of both starts
    now = turn.update(6 * degree, 0.0, (degree, ERROR), lasting=True)
    assert np.degrees(now.angle) == pytest.approx(6.0, abs=0.1)


def test_slow_slip_under_markers_that_seem_to_stick_is_in_the_angle_and_in_the_slip():
    recording, angle = ellipsoid_slips(60, slip_from=60, slip_to=60, rate=0.1, share=0.3)
    imprint = np.stack([np.radians(angle), np.full(60, ERROR)], axis=1)
    result = estimate_angles(replace(recording, imprint=imprint), "tracked", noise=MICRON)
    assert np.abs(np.degrees(result.angle) - angle).max() < 0.4
    slip = np.degrees(accumulate_slip(result))
    # the gel is that of the tenth of the markers that turned furthest: by up to twice φ's noise
    assert slip[-1] - slip[0] == pytest.approx(0.7 * angle[-1], abs=0.6)


def test_gel_that_shears_in_layers_turns_by_as_much_as_it_strains():
    rng = np.random.default_rng(6)
    before = rng.normal(size=30) + 1j * rng.normal(size=30)
    rigid = (1.0 + 0.05j) * before + 3.0
    assert shear_strain(before, rigid) == pytest.approx(0.0, abs=1e-12)
    layers = before + 0.02 * before.imag
    assert shear_strain(before, layers) == pytest.approx(0.01)  # half the shear, as the rotation


def test_the_first_angle_of_a_sheared_gel_is_uncertain_by_its_strain():
    recording, _ = ellipsoid_slips(20, slip_from=20, slip_to=20, rate=0.0)
    imprint = np.tile([0.0, 1e-4], (20, 1))
    imprint[1:, 0] = 1e-6  # it counts from the first frame
    slope, halves = 0.008, []
    for shear in (0.0, slope):
        positions = recording.positions.copy()
        positions[..., 0] += shear * recording.layout.reference[:, 1]
        given = replace(recording, positions=positions, imprint=imprint)
        result = estimate_angles(given, "tracked", noise=MICRON)
        halves.append(0.5 * (result.high - result.low)[-1])
    assert np.degrees(halves[0]) < 0.1
    assert halves[1] == pytest.approx(Z95 * 0.5 * slope, rel=0.05)


def test_an_angle_that_restarts_says_since_when_and_is_never_exact():
    recording, _ = ellipsoid_slips(20, slip_from=20, slip_to=20, rate=0.2)
    moved = recording.positions.copy()
    gone = recording.layout.reference[:, 0] > 0.0  # half the pad is elsewhere: it has slipped
    moved[:, gone, 1] += 0.7
    result = estimate_angles(replace(recording, positions=moved), "tracked", noise=MICRON)
    anew = result.restarts > 0
    assert anew.any()
    assert (result.since[anew] >= recording.time[0]).all()
    assert (result.high - result.low)[result.answered].min() > 0.0
    later = replace(result, time=result.time - 1.0)
    assert "restarted" in " ".join(describe_counts(later))


def test_the_imprint_carries_the_first_angle_over_frames_in_which_the_gel_has_none():
    recording, angle = ellipsoid_slips(20, slip_from=20, slip_to=20, rate=0.5)
    moved = recording.positions.copy()
    moved[1] += np.random.default_rng(7).normal(scale=0.5, size=moved[1].shape)
    imprint = np.stack([np.radians(angle - angle[0]), np.full(20, ERROR)], axis=1)
    given = replace(recording, positions=moved, imprint=imprint)
    result = estimate_angles(given, "tracked", noise=MICRON)
    assert (result.stick_markers[:2] > 0).tolist() == [True, False]
    assert not result.restarts.any()
    np.testing.assert_allclose(
        np.degrees(result.angle - result.angle[0]), angle - angle[0], atol=0.2
    )


def test_the_gels_turn_from_a_shadow_that_stays_is_covered():
    recording, angle = ellipsoid_slips(40, slip_from=40, slip_to=40, rate=1.0)
    shown = np.clip(np.arange(40) - 12, 0, 8)  # rests, turns by 8°, rests
    still = np.stack([np.r_[0.0, np.full(39, 1e-3)], np.full(40, ERROR)], axis=1)
    noise = np.random.default_rng(8).normal(scale=1e-4, size=recording.positions.shape)
    recording = replace(recording, positions=recording.positions[shown] + noise, imprint=still)
    result = estimate_angles(recording, "tracked", noise=MICRON)
    truth, low, high = angle[shown], np.degrees(result.low), np.degrees(result.high)
    assert ((low <= truth) & (truth <= high))[20:].all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_gels_turn_from_a_mark_on_the_lens_is_covered_however_slow(sign):
    recording, angle = ellipsoid_slips(52, slip_from=52, slip_to=52, rate=0.2)
    shown = np.clip(np.arange(52) - 12, 0, 40)  # rests, then turns by 0.2° per frame
    still = np.stack([np.r_[0.0, np.full(51, 1e-3)], np.full(52, ERROR)], axis=1)
    mirror = np.array([1.0, sign, 1.0])
    noise = np.random.default_rng(8).normal(scale=1e-4, size=recording.positions.shape)
    recording = replace(
        recording,
        layout=layout_markers(recording.layout.reference * mirror),
        positions=(recording.positions[shown] + noise) * mirror,
        imprint=still,
    )
    result = estimate_angles(recording, "tracked", noise=MICRON)
    truth = sign * angle[shown]
    low, high = np.degrees(result.low), np.degrees(result.high)
    assert ((low <= truth) & (truth <= high)).mean() > 0.95


def test_the_gels_turn_from_a_mark_is_covered_in_a_contact_that_begins_loaded():
    recording, angle = ellipsoid_slips(52, slip_from=52, slip_to=52, rate=0.2)
    still = np.stack([np.r_[0.0, np.full(51, 1e-3)], np.full(52, ERROR)], axis=1)
    inside = np.hypot(*recording.layout.reference[:, :2].T) < 4.0
    recording = replace(
        recording,
        layout=layout_markers(recording.positions[0]),
        contact=np.tile(inside, (52, 1)),
        imprint=still,
    )
    trackers = Trackers(recording.layout, {"tracked": {}}, noise=MICRON)
    estimates = [trackers.update(frame)["tracked"] for frame in recording]
    assert estimates[5].restarts == 1
    low, high = np.degrees([(one.low, one.high) for one in estimates]).T
    margin = 0.1  # °, of 95 % intervals by markers with 1 µm of noise
    assert (low - margin <= angle).all()
    assert (angle <= high + margin).all()


def test_gel_that_sticks_again_is_not_compared_with_its_turn_before_it_was_lost():
    rng = np.random.default_rng(8)
    recording, _ = ellipsoid_slips(100, slip_from=100, slip_to=100, rate=0.0)
    object_ = np.r_[np.linspace(0.0, -8.0, 60), -4.0, np.full(39, -0.3)]
    imprint = np.stack([np.radians(object_), np.full(100, ERROR)], axis=1)
    imprint[1:, 0] += 1e-6  # it counts from the first frame
    positions = recording.positions.copy()
    positions[60:61, :, :2] += rng.normal(scale=0.3, size=(1, positions.shape[1], 2))  # lost
    given = replace(recording, positions=positions, imprint=imprint)
    result = estimate_angles(given, "tracked", noise=MICRON)
    assert result.answered[-20:].all()
    assert np.abs(np.degrees(result.angle[-20:]) - object_[-20:]).max() < 0.5


@pytest.mark.parametrize("anew", [False, True])
def test_an_imprint_found_again_after_a_fast_slip_goes_on_unless_it_counts_anew(anew):
    rng = np.random.default_rng(9)
    recording, _ = ellipsoid_slips(40, slip_from=40, slip_to=40, rate=0.0)
    object_ = np.r_[np.linspace(0.0, 2.0, 20), np.linspace(6.0, 18.0, 4), np.full(16, 18.0)]
    imprint = np.stack([np.radians(object_), np.full(40, ERROR)], axis=1)
    imprint[1:, 0] += 1e-6  # it counts from the first frame
    lost = slice(21, 23)
    imprint[lost] = np.nan
    if anew:
        imprint[23:, 0] = np.r_[0.0, np.full(16, 1e-6)]
    positions = recording.positions.copy()
    shape = positions[lost, :, :2].shape
    positions[lost, :, :2] += rng.normal(scale=0.3, size=shape)  # no marker moves with another
    given = replace(recording, positions=positions, imprint=imprint)
    result = estimate_angles(given, "tracked", noise=MICRON)
    assert not result.answered[lost].any()
    after = np.degrees(result.angle)[24:]
    assert np.isfinite(after).all()
    if anew:
        assert (result.restarts[24:] > result.restarts[20]).all()
        assert (result.since[24:] > result.time[20]).all()
    else:
        assert (result.restarts == result.restarts[0]).all()
        assert np.abs(after - object_[24:]).max() < 0.5


@pytest.mark.parametrize("kept", [0.6, 0.98, np.nan])
def test_an_object_whose_print_is_lost_turns_with_the_gel_only_if_it_is_seen_to_hold(kept):
    recording, _ = ellipsoid_slips(40, slip_from=40, slip_to=40, rate=0.0)
    object_ = np.r_[np.full(20, 0.0), np.linspace(10.0, 30.0, 4), np.full(16, 30.0)]
    imprint = np.stack([np.radians(object_), np.full(40, ERROR)], axis=1)
    imprint[1:, 0] += 1e-6  # it counts from the first frame
    lost = slice(20, 23)
    imprint[lost] = np.nan
    hold = np.tile([np.nan, np.nan, kept], (40, 1))
    noise = np.random.default_rng(8).normal(scale=1e-4, size=recording.positions.shape)
    still = recording.positions + noise  # the gel rests at its limit while the object slips
    given = replace(recording, positions=still, imprint=imprint, hold=hold)
    result = estimate_angles(given, "tracked", noise=MICRON)
    assert (result.answered[lost] == (not kept < 0.9)).all()
    assert result.answered[24:].all()
    assert (result.restarts == result.restarts[0]).all()
    assert np.abs(np.degrees(result.angle)[24:] - object_[24:]).max() < 0.5


def test_an_imprint_found_again_after_markers_have_counted_anew_counts_with_them(monkeypatch):
    recording, turn = ellipsoid_slips(40, slip_from=40, slip_to=40, rate=0.2)
    slid = 30.0 * (np.arange(40) > 20)  # in the first frame without the print
    imprint = np.stack([np.radians(turn + slid), np.full(40, ERROR)], axis=1)
    imprint[1:, 0] += 1e-6  # it counts from the first frame
    imprint[21:26] = np.nan  # one frame longer than the gel
    hold = np.full((40, 3), np.nan)
    hold[21, 2] = 0.3
    recording = replace(recording, imprint=imprint, hold=hold)
    trackers = Trackers(recording.layout, {"tracked": {}}, noise=MICRON)
    gel, frames = trackers.estimators["tracked"].incremental, iter(range(40))
    follow = gel.follow

    def count_anew(fields):
        found, frame = follow(fields), next(frames)
        if frame < 25:
            return found
        angle = np.radians(turn[frame] - turn[25])
        return found._replace(
            angle=angle, low=angle - 1e-3, high=angle + 1e-3, stick=fields.contact, restarts=1
        )

    monkeypatch.setattr(gel, "follow", count_anew)
    estimates = [trackers.update(frame)["tracked"] for frame in recording]
    assert np.isnan([one.angle for one in estimates[21:25]]).all()
    assert [one.restarts for one in estimates[25:]] == [1] * 15
    angles = np.degrees([one.angle for one in estimates[25:]])
    np.testing.assert_allclose(angles, turn[25:] - turn[25], atol=0.5)
