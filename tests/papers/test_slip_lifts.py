"""The study of labelled lifts: scores, fits, the rule, the outside camera, and one lift of each."""

from pathlib import Path

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from estimation.estimators.result import State
from estimation.slip.outcome import Outcome
from estimation.slip.shear import Shear, ShearPath, ShearSettings, find_slip_probability
from papers.slip_lifts import again, lifts, onset, outside, scores, settings, virtual, worst
from papers.slip_lifts.lifts import LEFT_OUT, OURS, RULE, Label, Lift, Study
from papers.slip_lifts.settings import FitSettings, RuleSettings, View
from tests.cases import find_published

SLIPPED = np.array([True, True, False, False])


@pytest.mark.parametrize(
    ("score", "auc"),
    [([3, 4, 1, 2], 1.0), ([3, 1, 2, 0], 0.75), ([1, 1, 1, 1], 0.5), ([0, 0, 1, 0], 0.25)],
)
def test_the_auc_counts_pairs_and_is_the_area_under_the_curve(score, auc):
    score = np.array(score, float)
    assert scores.measure_auc(score, SLIPPED) == auc
    false, true = scores.draw_roc(score, SLIPPED)
    assert np.sum(np.diff(false) * 0.5 * (true[1:] + true[:-1])) == auc
    assert (false[0], true[0], false[-1], true[-1]) == (0.0, 0.0, 1.0, 1.0)


def test_there_is_no_auc_of_one_class():
    assert np.isnan(scores.measure_auc(np.array([1.0, 2.0]), np.array([True, True])))


def test_a_bound_is_chosen_from_the_other_objects():
    score = np.array([0.9, 0.1, 0.5, 0.3, 0.4, 0.2])
    slipped = np.array([True, False, True, False, True, False])
    assert scores.choose_bound(score, slipped) == pytest.approx(0.35)
    group = np.array([1, 1, 1, 1, 2, 2])
    # without the second group the bound is 0.4, which its slip does not exceed
    np.testing.assert_array_equal(
        scores.leave_out(score, slipped, group), [True, False, True, False, False, False]
    )


def shift_markers(shear, markers=12):
    """Markers that all move along x; the last two are never seen."""
    moved = np.zeros((len(shear), markers, 2))
    moved[..., 0] = np.asarray(shear)[:, None]
    moved[:, -2:] = np.nan
    return moved


@pytest.mark.parametrize(
    ("shear", "fallen"),
    [([0, 2, 4, 2.5, 3], 0.25), ([0, 2, 4, 5, 6], 0.0), ([0, 0.4, 0.1, 0.4, 0.1], 0.0)],
)
def test_the_rule_measures_the_fall_from_a_peak_above_half_a_pixel(shear, fallen):
    assert scores.apply_rule(shift_markers(shear), RuleSettings()) == pytest.approx(fallen)


def test_the_prior_alone_sets_the_spreads_of_outcomes_far_apart():
    fallen = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.8], [0.0, 0.0]])
    hold = np.array([[0.95, 0.95], [0.95, 0.95], [0.95, 0.95], [0.95, 0.05]])
    slipped = np.array([False, False, True, True])
    signs = np.stack([fallen, hold, np.full_like(hold, np.nan)])
    fit = scores.fit_probability(signs, slipped, FitSettings())
    p = find_slip_probability(signs, fit).max(axis=1)
    np.testing.assert_array_equal(p > 0.5, slipped)
    # the data want narrower spreads by the little that the tails still cost
    assert 0.6 * 0.05 < fit.fallen_spread < 0.05
    assert 0.6 * 0.05 < fit.kept_spread < 0.05


def test_a_fit_finds_the_numbers_that_drew_the_outcomes():
    rng = np.random.default_rng(0)
    hold = rng.uniform(0.2, 0.9, (1000, 1))
    slipped = rng.random(1000) < 1.0 / (1.0 + np.exp((hold[:, 0] - 0.6) / 0.08))
    signs = np.stack([np.zeros_like(hold), hold, np.zeros_like(hold)])
    fit = scores.fit_probability(signs, slipped, FitSettings())
    # 1000 draws know the middle to 0.008 and the spread to 0.006
    assert fit.kept == pytest.approx(0.6, abs=0.02)
    assert fit.kept_spread == pytest.approx(0.08, abs=0.015)


def test_labels_are_read_and_a_wrong_line_is_named(tmp_path):
    table = tmp_path / "object009_result.dat"
    table.write_text(
        "68 fail 0 160 450 398 068_00 _s09_\n\n67.1 ok 1 11870 12100 11971 067_10 _s09_"
    )
    assert list(lifts.read_labels(table)) == [
        Label("object009", "068_00_mm", True, 398),
        Label("object009", "067_10_mm", False, 11971),
    ]
    table.write_text("68 fail perhaps 160 450 398 068_00")
    with pytest.raises(
        ValueError, match=r"object009_result.dat, line 1: expected width, word, label"
    ):
        list(lifts.read_labels(table))


def test_motion_against_the_gripper_is_measured_in_mm():
    rng = np.random.default_rng(0)
    rough = cv2.GaussianBlur(rng.uniform(0, 255, (200, 300)).astype(np.float32), (0, 0), 2.0)
    rough = np.clip(128 + 4.0 * (rough - rough.mean()), 0, 255).astype(np.uint8)
    pictures = []
    for i in range(4):
        picture = np.roll(rough, -i, axis=0)  # the hand shakes: all moves up
        picture[20:180, 170:280] = np.roll(rough, -3 * i, axis=0)[20:180, 170:280]
        pictures.append(picture)
    view = View((180, 60, 90, 80), (10, 20, 140, 160), (225.0, -800.0))
    scale = settings.FINGER_PX_PER_MM * 900.0 / np.hypot(900.0, settings.FOCAL_PX)
    found = outside.measure_motion(pictures, view)
    # the median corner lies within 20 px of the middle of its patch
    assert found == pytest.approx(2.0 * np.arange(4) / scale, rel=0.03, abs=0.02)
    with pytest.raises(ValueError, match="no corner to track"):
        outside.follow_points([np.zeros((50, 50), np.uint8)] * 2, (0, 0, 50, 50))


def make_lift(object_, name, slipped, hold, folder):
    signs = np.array([np.zeros(len(hold)), hold, np.zeros(len(hold))])
    odds = find_slip_probability(signs, ShearSettings())
    shears = tuple(
        Shear(float(i), 0.0, one, slip_probability=float(p))
        for i, (one, p) in enumerate(zip(hold, odds, strict=True))
    )
    outcome = Outcome("slipped" if odds.max() > 0.5 else "held", float(odds.max()), np.nan)
    others = {RULE: float(slipped), lifts.UNPRINTED: 0.0}
    label = Label(object_, name, slipped, 102)
    macro_slip = float((odds > 0.5).mean())
    return Lift(label, folder, (100, 101, 102, 103), shears, outcome, others, macro_slip)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lift")
    for i in range(4):
        cv2.imwrite(str(folder / f"gelsight_{i}.png"), np.full((24, 32, 3), 100, np.uint8))
    kept, gone, unsure = [1.0, 0.97, 0.95, 0.95], [1.0, 0.9, 0.3, 0.2], [1.0, 0.9, 0.5, 0.6]
    return Study(
        Path(),
        tuple(
            make_lift(object_, name, slipped, hold, folder)
            for object_, name, slipped, hold in [
                ("object001", "a", True, gone),
                ("object001", "b", False, kept),
                ("object003", "a", True, gone),
                ("object003", "b", False, unsure),
            ]
        ),
    )


def test_the_tables_count_what_is_right(study):
    shown = lifts.tables(study)
    first, second, every = shown[""]
    assert (first["lifts"], first["slips"], first[f"{OURS}: right"]) == (2, 1, 2)
    assert (second[f"{OURS}: right"], second[f"{OURS}: AUC"]) == (1, 1.0)
    assert (every["lifts"], every["held lifts with macro slip"]) == (4, 1)
    assert [row["left out"] for row in shown["_fits"]] == ["object001", "object003"]
    by_score = {row["score"]: row for row in shown["_scores"]}
    assert by_score[OURS]["right [%]"] == 75.0
    assert by_score[OURS]["holds called slips"] == 1
    assert by_score[RULE]["right [%]"] == 100.0
    assert LEFT_OUT in by_score
    assert [row["first slipped [frame]"] for row in shown["_lifts"]] == [2, None, 2, 2]
    plt.close(lifts.plot(study))


def test_one_object_alone_is_not_fitted(study):
    alone = Study(study.root, study.lifts[:2])
    assert LEFT_OUT not in alone.scores
    assert "_fits" not in lifts.tables(alone)


def test_the_least_sure_lift_comes_first(study):
    assert worst.find_worst(study)[0] == 3
    rows = worst.tables(study)[""]
    assert (rows[0]["object"], rows[0]["lift"], rows[0]["label"]) == ("object003", "b", "held")
    plt.close(worst.plot(study))


def test_calls_stand_beside_the_motion(study):
    motion = (
        np.array([0.0, 0.2, 1.2, 2.5]),
        np.zeros(4),
        np.array([0.0, 1.5, 0.5, 1.2]),
        np.ones(4),
    )
    shown = onset.tabulate(onset.Onsets(study.lifts, motion))
    first, _, third, _ = shown[""]
    assert (first["called [frame]"], first["1 mm [frame]"], first["2 mm [frame]"]) == (2, 2, 3)
    assert (first["lift begins [frame]"], first["loaded [frame]"]) == (2, 1)
    assert third["1 mm [frame]"] == 3  # it was back below 1 mm
    leads = {row["motion"]: row for row in shown["_leads"]}
    assert leads["1 mm"]["slips"] == 2
    assert leads["1 mm"]["lead, median [frames]"] == 0.5
    assert leads["1 mm"]["3 frames before or more"] == 0
    plt.close(onset.draw(onset.Onsets(study.lifts, motion)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "slipped"), [("052_080_mm", True), ("052_020_mm", False)])
def test_a_published_lift_is_answered_as_labelled(name, slipped):
    root = find_published("slip-lifts")
    labels = {one.lift: one for one in lifts.read_labels(root / "object003_result.dat")}
    lift = lifts.answer(root, labels[name])
    assert (lift.outcome.word == "slipped") == lift.label.slipped == slipped
    assert (lift.macro_slip > 0.0) == slipped
    assert len(lift.shears) == len(lift.frames) == 21


def test_virtual_lifts_are_counted_by_shape_and_print():
    stick, slip = (State.STICK,) * 5, (State.STICK,) * 3 + (State.MACRO_SLIP,) * 2
    low, high = (
        ShearPath.of(*(Shear(slip_probability=p) for p in odds))
        for odds in ([0.01] * 5, [0.0, 0.1, 0.2, 0.9, 1.0])
    )
    none = np.full((3, 5), np.nan)
    slid = np.array(
        [[0.0, 0.0, 0.5, 1.0, 2.0], [0.01, 0.03, 0.55, 1.04, np.nan], [0.1, 0.02, 0.1, 0.1, 0.3]]
    )
    result = [
        virtual.VirtualLift("cube", "edges", False, None, low, stick, none),
        virtual.VirtualLift("cube", "smooth", False, None, high, slip, none),
        virtual.VirtualLift("sphere", "edges", True, 1, high, slip, slid),
        virtual.VirtualLift("sphere", "edges", True, 0, high, slip, none),
        virtual.VirtualLift("sphere", "smooth", True, 2, low, stick, none),
    ]
    rows = {row["lifts"]: row for row in virtual.tables(result)[""]}
    assert "cylinder" not in rows
    assert rows["cube"]["called slips"] == rows["cube"]["macro slip in some frame"] == 1
    sphere = rows["sphere"]
    assert (sphere["slipped"], sphere["called"], sphere["within 2 frames"]) == (3, 2, 1)
    assert (sphere["median delay [frames]"], sphere["longest"]) == (2.5, 3)
    # without a print they are dated as they were called
    assert sphere["dated within 2 frames"] == 1
    assert (sphere["earliest date [frames]"], sphere["latest date [frames]"]) == (2, 3)
    slips = {row["lifts"]: row for row in virtual.tables(result)["_slips"]}
    edges = slips["edges, slipped"]
    assert (edges["frames"], edges["answered"]) == (10, 4)
    assert (edges["within 5 % or 20 µm [%]"], edges["in the interval [%]"]) == (50, 75)
    assert edges["median error [µm]"] == 35
    assert slips["edges, held"]["answered"] == 0
    assert slips["edges, held"]["median error [µm]"] is None
    plt.close(virtual.plot(result))


def test_virtual_lifts_begin_loaded_and_end_as_they_are_drawn():
    for slips in (False, True):
        shape, scene = virtual.draw_lift(slips, 1)
        assert shape == "cube"
        path = scene.path
        assert (np.asarray(path.approach)[virtual.UNSEEN :] > 0.0).all()
        far = np.linalg.norm(np.asarray(path.shift)[-1])
        assert (far > 1.0) == slips


def test_the_first_slip_gives_the_limit_of_the_second():
    case = again.answer_case(0, slips=True)
    assert case.load == 0.8
    coefficient, low, high = case.found[case.before].T
    np.testing.assert_allclose(coefficient, case.friction, rtol=0.03)
    assert ((low < case.friction) & (case.friction < high)).all()
    left, time = case.left[case.before], case.time[case.before]
    known = np.isfinite(time[:, 0])
    assert known.sum() > 6  # the object moves before it slips for 16 frames
    assert ((time[:, 1] <= left) & (left <= time[:, 2]))[known].all()
    assert case.acts[case.before].any()


def test_grasps_that_slip_twice_are_counted_by_shape_and_load():
    nan, some = np.nan, np.array([False, True, True, True])
    slips = again.Case(
        "sphere",
        1.2,
        True,
        0.5,
        before=some,
        stick=np.array([1.0, 0.95, 0.8, 0.3]),
        left=np.array([0.4, 0.3, 0.2, 0.1]),
        found=np.array(
            [(nan, nan, nan), *[(0.51, 0.45, 0.55), (0.51, 0.505, 0.55)], (0.5, 0.4, 0.6)]
        ),
        time=np.array([(nan,) * 3, (0.3, 0.25, np.inf), (0.3, 0.25, np.inf), (0.05, 0.02, 0.2)]),
        acts=np.array([True, False, False, True]),
        shears=(1.0, 1.2),
        depths=(1.0, 1.25),
    )
    held = slips._replace(slips=False, left=np.full(4, nan), shears=(1.0, 0.4))
    made = again.tables([slips, held])
    (row,), (shear,) = made[""], made["_shear"]
    assert (row["recordings"], row["with the coefficient"]) == (2, 2)
    assert (row["frames with a tenth slipping"], row["largest error [%]"]) == (4, 2.0)
    assert row["interval covers [%]"] == 50
    assert (row["frames with a time"], row["its interval covers"]) == (3, 2)
    assert (row["its low end too late"], row["frames of act before the slip"]) == (1, 1.0)
    assert row["frames of act in held grasps"] == 1
    assert shear["shear at slip, second over first"] == "1.20 to 1.20"
    assert shear["the same over the depth"] == "0.96 to 0.96"
    plt.close(again.plot([slips, held]))
