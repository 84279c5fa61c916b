import base64
import html
import json
from dataclasses import replace

import numpy as np
import pytest
from rich.progress import Progress

from estimation.estimators.grasp import compare_fingers
from estimation.estimators.result import State, Track
from estimation.inputs import Input
from estimation.output.found import find_in_record
from estimation.output.overview import (
    describe_clocks,
    describe_evidence,
    describe_fits,
    describe_grasp,
    describe_joint_outcome,
    write_overview,
)
from estimation.output.record import RecordReader
from estimation.output.report import summarise
from estimation.run import run_all
from estimation.settings import Settings
from estimation.slip.shear import ShearPath
from estimation.sources import find_recordings, read_recording
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, simulate_pivot
from tests.cases import find_published

PATH = (0.0, 8.0, 8.0, -6.0)
NAMES = ("left", "right")


@pytest.fixture(scope="module")
def fingers():
    """Two fingers on one object: the second sees it turn the other way, 0.4 s later."""
    model = PivotModel(friction_ratio=0.3)
    legs = {"frames": (30, 12, 50), "pressing": 10}
    first, truth = simulate_pivot(model, angles_deg=PATH, seed=1, **legs)
    mirrored = tuple(-angle for angle in PATH)
    second, _ = simulate_pivot(
        model._replace(offset=(-0.1, 0.4)), angles_deg=mirrored, seed=2, unloaded=22, **legs
    )
    second = replace(second, time=second.time + 1e4, name="other")
    return first, second, truth


@pytest.fixture(scope="module")
def tracks(fingers):
    """Their angles."""
    return [estimate_angles(recording) for recording in fingers[:2]]


def test_clock_sign_and_difference_are_found(fingers, tracks):
    first, second, truth = fingers
    grasp = compare_fingers(*tracks)
    late = 12 / 30  # its first frame comes 12 frames earlier in the motion
    start = (first.source_index[0] - second.source_index[0]) / 30
    assert grasp.fixed.clock_offset == pytest.approx(-late - start, abs=0.01)
    assert abs(np.degrees(grasp.fixed.angle_offset)) < 0.1
    assert np.degrees(grasp.fixed.rms) < 0.1  # jitter of 2 ms at 8°/s, 0.02° of noise
    assert grasp.free.slope == pytest.approx(1.0, abs=4 * grasp.free.errors[0] + 0.002)
    error = np.degrees(np.abs(grasp.joint - truth.angle))[grasp.holds]
    assert error.mean() < 0.05
    assert np.isfinite(grasp.joint).sum() >= np.isfinite(grasp.first).sum()


def test_a_slope_is_seen_and_the_clock_not_confused_with_it(tracks):
    first, soft = tracks
    soft = replace(soft, angle=0.9 * soft.angle, low=0.9 * soft.low, high=0.9 * soft.high)
    grasp = compare_fingers(first, soft)
    assert grasp.free.slope == pytest.approx(0.9, abs=0.005)
    assert np.degrees(grasp.fixed.rms) > 3 * np.degrees(grasp.free.rms)
    assert abs(grasp.free.correlation) < 1.0


def test_time_stamps_alone_are_no_disagreement(tracks):
    """A clean pair is beyond its intervals in most frames, as these leave out jitter of clocks."""
    model, legs = PivotModel(friction_ratio=0.3), {"frames": (30, 12, 50), "pressing": 10}
    mirrored, _ = simulate_pivot(model, angles_deg=[-angle for angle in PATH], seed=2, **legs)
    first, second = tracks[0], estimate_angles(mirrored)
    clean = compare_fingers(first, second).raw
    assert clean.share > 0.5
    assert np.degrees(clean.rms) < 0.1
    assert not clean.clear
    since = second.time - second.time[0]
    for begin in (1.0, np.quantile(since[np.isfinite(second.angle)], 0.85)):  # or slips at the end
        turned = np.radians(2.0) * (since > begin)
        moved = {name: getattr(second, name) + turned for name in ("angle", "low", "high")}
        raw = compare_fingers(first, replace(second, **moved)).raw
        assert abs(np.degrees(raw.largest)) == pytest.approx(2.0, abs=0.1)
        assert raw.clear
        assert f"by {np.degrees(raw.rms):.2f}° rms" in raw.describe()


def test_fingers_that_never_hold_together_are_refused(tracks):
    one, other = tracks
    slipping = replace(other, state=(State.MACRO_SLIP,) * len(other.state))
    with pytest.raises(ValueError, match="in fewer than 10 common frames"):
        compare_fingers(one, slipping)


def test_fingers_that_turn_in_the_same_sense_are_refused(tracks):
    """As of a mirrored picture, or a copy of the first finger's recording."""
    first, second = tracks
    mirrored = replace(second, angle=-second.angle, low=-second.high, high=-second.low)
    for other in (mirrored, first):
        with pytest.raises(ValueError, match=r"match best in the same sense.*mirrored"):
            compare_fingers(first, other)


def test_a_short_recording_is_compared_in_either_order(tracks):
    first, second = tracks
    short = second.take(slice(60))
    for pair in ((first, short), (short, first)):
        grasp = compare_fingers(*pair)
        assert abs(grasp.fixed.clock_offset) == pytest.approx(0.4, abs=0.05)
        assert np.degrees(grasp.fixed.rms) < 0.1


def test_different_lengths_and_rates(tracks):
    first, second = tracks
    grasp = compare_fingers(first, second.take(slice(None, None, 2)))
    assert len(grasp.joint) == len(first.time)
    assert np.degrees(grasp.fixed.rms) < 0.1


def test_command_writes_the_comparison(fingers, tmp_path):
    first, second, _ = fingers
    inputs = [Input(first), Input(second)]
    outcome = run_all(inputs, tmp_path, Settings(grasp=True), Progress(disable=True))
    assert {"comparison.csv", "grasp.json", "grasp.png", "moment.png"} <= {
        p.name for p in tmp_path.iterdir()
    }
    figures = json.loads((tmp_path / "grasp.json").read_text())
    assert figures["slope_fixed"]["slope"] == 1.0
    assert figures["slope_free"]["slope_standard_error"] > 0
    assert any("rms before macro slip" in line for line in outcome.lines)
    assert outcome.lines[0].startswith("the fingers disagree")  # 0.4 s apart on their own clocks
    assert figures["before_offsets"]["disagree"]
    assert not figures["own_clocks"]
    rows = (tmp_path / "comparison.csv").read_text().splitlines()
    assert len(rows) == len(first) + 1
    assert float(rows[1].split(",")[0]) == pytest.approx(first.time[0], abs=1e-6)  # own time stamps
    assert outcome.lines[1].endswith(": no print is visible; its angle was not restarted")
    assert "Fingers that disagree" in outcome.lines[3]
    assert any(line.startswith("The clock offset of ") for line in outcome.lines)
    assert not any("check the clocks" in line for line in outcome.lines)
    joint = next(line for line in outcome.lines if line.startswith("Joint outcome: "))
    assert joint == "Joint outcome: held, at both fingers"
    both = [figures["first"], figures["second"]]
    expected = {"word": "held", "probability_slipped": None, "onset_s": None, "at": both}
    assert figures["outcome"] == expected
    page = (tmp_path / "report.html").read_text()
    assert outcome.lines[0] in html.unescape(page)
    assert f"{joint}." in html.unescape(page)
    assert page.index("the fingers disagree") < page.index("The grasp")
    picture = base64.b64encode((tmp_path / "grasp.png").read_bytes()).decode()
    assert f'src="data:image/png;base64,{picture}"' in page
    for column in ("joint_deg", "joint_low_deg", "joint_high_deg", "second_deg"):
        last = rows[-1].split(",")[rows[0].split(",").index(column)]
        assert f"{float(last):.2f}".replace("-", "−") in page
    free = figures["slope_free"]
    assert f"{free['slope']:.3f} ± {free['slope_standard_error']:.3f}" in page
    assert f"<td>{figures['slope_fixed']['rms_difference_deg']:.3f}</td>" in page
    with pytest.raises(ValueError, match="two fingers, got 1"):
        run_all(inputs[:1], tmp_path, Settings(grasp=True), Progress(disable=True))


@pytest.fixture(scope="module")
def turns(tracks):
    """Makes two fingers' tracks of one turn: noise, a later clock of the second, its own slip."""
    base = tracks[0]
    time = np.arange(300) / 25

    def turn(time):  # a lift, shaking, a release
        shaking = 0.1 * np.sin(5 * time) * (np.abs(time - 5) < 2)
        return 0.2 / (1 + np.exp(-8 * (time - 2.5))) + shaking - 0.3 / (1 + np.exp(-8 * (time - 9)))

    def track(angle):
        count, half = len(time), np.radians(0.5)
        values = {
            name: column[:1] * count if isinstance(column, tuple) else column[:1].repeat(count)
            for name, column in base.quantities().items()
            if name in Track.columns()
        }
        values |= {"time": time, "state": (State.STICK,) * count}
        values |= {"stick_markers": np.full(count, 40)}
        values |= {"angle": angle, "low": angle - half, "high": angle + half}
        return Track(method="tracked", **values)

    def make(late=0.0, slip=0.0, seed=0, turned=1.0):
        noise = np.random.default_rng(seed).normal(0.0, np.radians(0.1), (2, len(time)))
        moved = turned * turn(time - late) + slip
        return track(turned * turn(time) + noise[0]), track(-moved - noise[1])

    return make, time


@pytest.mark.parametrize("slip_deg", [0.0, 4.0])
@pytest.mark.parametrize("late", [0.0, 0.24])
def test_slow_slip_of_a_finger_does_not_move_its_clock(turns, late, slip_deg):
    make, time = turns
    grasp = compare_fingers(*make(late, np.radians(slip_deg) * time / time[-1]))
    error = grasp.fixed.errors[1]
    assert grasp.fixed.clock_offset == pytest.approx(-late, abs=min(0.03, 2 * error))
    assert grasp.own_clocks == (late == 0.0)
    both = np.isfinite(grasp.second)
    for angle in (grasp.first, grasp.second):
        assert np.all((grasp.low <= angle + 1e-9) & (angle <= grasp.high + 1e-9) | ~both)
    assert grasp.raw.clear == (late > 0 or slip_deg > 0)


def test_the_error_of_the_clock_covers_its_scatter(turns):
    make, time = turns
    misses = []
    for seed in range(20):
        wander = np.cumsum(np.random.default_rng(100 + seed).normal(0, np.radians(0.3), len(time)))
        fit = compare_fingers(*make(0.24, wander, seed)).fixed
        misses.append((fit.clock_offset + 0.24) / fit.errors[1])
    assert 0.2 < np.sqrt(np.mean(np.square(misses))) < 1.5


def test_a_slip_shows_in_the_joint_interval_and_before_the_fit(turns):
    make, time = turns
    first, second = make(slip=np.radians(3.0) * (time > 1))
    grasp = compare_fingers(first, second)
    assert grasp.raw.clear
    assert grasp.raw.share > 0.8
    assert abs(np.degrees(grasp.raw.largest)) == pytest.approx(3.0, abs=0.8)
    wrong = grasp.fixed._replace(rms=grasp.raw.rms)
    doubted = describe_clocks(grasp._replace(fixed=wrong, own_clocks=False))
    assert doubted.endswith("less than half of their difference: check the clocks")
    raw = -second.angle + second.angle[0] + first.angle[0]
    assert np.all((grasp.low <= raw + 1e-9) & (raw <= grasp.high + 1e-9))


@pytest.fixture(scope="module")
def run(fingers, tmp_path_factory):
    """The run of one finger."""
    folder = tmp_path_factory.mktemp("finger")
    run_all([Input(fingers[0])], folder, Settings(), Progress(disable=True))
    with RecordReader(folder / "record.sqlite") as record:
        return find_in_record(record)


@pytest.fixture
def finger(run):
    """Makes a run with a probability of a slip from 2 s after its first frame; NaN: no contact."""
    count = len(run.main.time)
    states = {"state": (State.NO_CONTACT,) * count, "contact_markers": np.zeros(count, dtype=int)}

    def make(name, probability):
        empty = [np.full(count, np.nan)] * len(ShearPath._fields)
        late = run.main.time - run.main.time[0] > 2.0
        shears = ShearPath(*empty)._replace(slip_probability=np.where(late, probability, np.nan))
        main = run.main if np.isfinite(probability) else replace(run.main, **states)
        return replace(run, name=name, shears=shears, results={run.method: main})

    return make


@pytest.mark.parametrize(
    ("probabilities", "words"),
    [
        ((0.99, 0.95), "slipped (probability of a slip 0.99), at both fingers"),
        ((0.3, 0.2), "probably held (probability of a slip 0.30), at both fingers"),
        (
            (0.99, 0.41),
            "slipped (probability of a slip 0.99), at left; at right: probably held (probability "
            "of a slip 0.41). Either the object slipped at one finger only, or right missed the "
            "slip",
        ),
        (
            (0.05, 0.8),
            "probably slipped (probability of a slip 0.80), at right; at left: held (probability "
            "of a slip 0.05). Either the object slipped at one finger only, or left missed the "
            "slip",
        ),
        ((np.nan, 0.05), "unknown, at left; at right: held (probability of a slip 0.05)"),
        ((0.99, np.nan), "slipped (probability of a slip 0.99), at left; at right: unknown"),
    ],
)
def test_the_joint_outcome_names_the_finger_it_comes_from(finger, probabilities, words):
    runs = [finger(*each) for each in zip(NAMES, probabilities, strict=True)]
    assert describe_joint_outcome(runs) == f"Joint outcome: {words}"


def test_the_joint_outcome_is_on_the_first_fingers_clock(finger, turns, tmp_path):
    make, _ = turns
    grasp = compare_fingers(*make(late=0.24))
    runs = [finger("left", 0.2), finger("right", 0.8)]
    write_overview([(run, summarise(run)) for run in runs], tmp_path, grasp)
    outcome = json.loads((tmp_path / "grasp.json").read_text())["outcome"]
    own = summarise(runs[1])["outcome"]
    assert outcome["onset_s"] == pytest.approx(own["onset_s"] + grasp.fixed.clock_offset, abs=1e-5)
    expected = {"word": "slipped", "probability_slipped": 0.8, "at": ["right"]}
    assert {name: outcome[name] for name in expected} == expected


def test_restarts_of_a_finger_are_told(turns, run):
    make, time = turns
    track = make()[0]
    later = (time > 7.0).astype(int)
    touching = np.full(len(time), 40)
    track = replace(
        track,
        contact_markers=touching,
        restarts=later,
        since=np.where(later, time[later.argmax()], 0.0),
    )
    printed = {"imprint": 0.0 * time, "outline": 0.0 * time}
    line, advice = describe_evidence([replace(run, results={"tracked": track}, **printed)])
    assert "the print is visible in 300 of 300 frames" in line
    assert "lost and restarted 7.04 s after its first frame" in line
    assert "not restarted" in advice


def test_fingers_that_hardly_turn_keep_their_clocks(turns):
    make, _ = turns
    grasp = compare_fingers(*make(late=0.24, turned=0.005))
    assert grasp.own_clocks
    half = 1.96 * grasp.fixed.errors[1]
    assert describe_clocks(grasp).endswith(f"do not exclude one of up to {half:.2g} s")
    assert grasp.fixed.clock_offset == 0.0
    assert grasp.fixed.errors[1] > 0.05
    assert not grasp.raw.clear


def test_no_overlap_is_said_and_the_rest_is_kept(fingers, tmp_path):
    first, second, _ = fingers
    inputs = [Input(first.head(30)), Input(second.head(12))]
    outcome = run_all(inputs, tmp_path, Settings(grasp=True), Progress(disable=True))
    assert outcome.lines[0].startswith("no comparison")
    assert any(line.startswith("Joint outcome: ") for line in outcome.lines)
    page = (tmp_path / "report.html").read_text()
    assert "no comparison: both fingers hold the object in fewer than 10 common frames" in page
    assert not (tmp_path / "comparison.csv").exists()


def test_angles_after_a_restart_are_left_out(turns):
    make, time = turns
    first, second = make()
    lost = time > 6.0
    moved = np.radians(10.0) * lost  # what it has not seen
    again = replace(
        second,
        restarts=second.restarts + lost,
        **{name: getattr(second, name) + moved for name in ("angle", "low", "high")},
    )
    grasp = compare_fingers(first, again)
    assert grasp.left_out == (0, int(lost.sum()))
    (left_out,), _ = describe_fits(grasp, NAMES)
    assert left_out.startswith(f"right: its angle was restarted; {lost.sum()} frames with another")
    assert not grasp.raw.clear
    np.testing.assert_allclose(grasp.joint[lost], first.angle[lost])
    whole = compare_fingers(first, replace(again, restarts=second.restarts))
    assert whole.left_out == (0, 0)
    assert whole.disagrees
    assert describe_grasp(whole).startswith("The fingers disagree by up to ")


def test_the_fingers_are_compared_after_a_restart_in_the_first_frames(turns):
    make, time = turns
    first, second = make()
    late = time > 0.1
    grasp = compare_fingers(replace(first, restarts=first.restarts + late), second)
    assert grasp.left_out == (int((~late).sum()), 0)
    np.testing.assert_allclose(grasp.first[late], first.angle[late])
    assert not grasp.raw.clear


def test_each_contact_has_its_own_start(turns):
    make, time = turns
    first, second = make()
    states = tuple(State.NO_CONTACT if 3.0 < t < 3.2 else State.STICK for t in time)
    again = replace(first, state=states, restarts=first.restarts + (time < 1.0))
    assert again.contacts[[0, -1]].tolist() == [1, 2]
    grasp = compare_fingers(again, second)
    assert grasp.left_out == (int((time < 1.0).sum()), 0)


def test_a_slope_that_no_turn_shows_is_not_given(turns):
    make, _ = turns
    _, lines = describe_fits(compare_fingers(*make(turned=0.005)), NAMES)
    assert any("turned too little" in line for line in lines)
    _, lines = describe_fits(compare_fingers(*make()), NAMES)
    assert "by both fingers" in lines[0]
    assert "(standard error)" in lines[2]


def test_two_fingers_of_the_published_grasp_agree():
    """Within 0.133° while the object turns by 35°, slope 0.994 ± 0.005 (docs/real_grasp.md)."""
    paths = find_recordings(find_published("tac3d-pivot"))
    grasp = compare_fingers(*(estimate_angles(read_recording(path)) for path in paths))
    assert grasp.fixed.frames >= 60
    assert np.degrees(grasp.fixed.rms) < 0.15
    assert abs(grasp.free.slope - 1.0) < 2.0 * grasp.free.errors[0]
    assert grasp.free.errors[0] < 0.01
