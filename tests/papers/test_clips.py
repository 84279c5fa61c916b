"""The comparison with registered turns: what is read, what counts, what is shown."""

from dataclasses import replace

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from estimation import Settings, Stream, simulate_pivot
from papers.marker_images import clips, registered, registration, settings
from tests.estimation.pictures.scenes import real

TURN = clips.Turn("ball/exp_num_1/camera_0", 5, 40, 6.0, 6.5, 6.2, 6.8, 6.1, "stick", "")


def test_the_table_beside_the_clips_is_read(tmp_path):
    known = clips.read_references(tmp_path)
    assert set(known) == set(settings.REGISTERED)
    table = tmp_path / "reference_turns.csv"
    table.write_text(",".join(clips.COLUMNS) + "\nball,1,0,5,40,-2.5\n")
    assert clips.read_references(tmp_path)["ball/exp_num_1/camera_0"] == [(5, 40, -2.5)]
    table.write_text(",".join(clips.COLUMNS) + "\nball,1,0,5,x,-2.5\n")
    with pytest.raises(ValueError, match="to_frame"):
        clips.read_references(tmp_path)


def test_a_turn_is_outside_beyond_what_the_reference_is_good_to():
    assert not TURN.outside
    assert TURN._replace(reference=5.4).outside
    assert (
        "frames 5 to 40: the reference is +6.0°, we measure +6.5 ± 0.3°, inside" in TURN.describe()
    )


def test_the_worst_are_of_several_clips_and_missing_answers_are_counted():
    turns = [TURN._replace(angle=6.0 + i) for i in range(4)]
    turns += [
        TURN._replace(clip="egg/a/b", angle=6.1),
        TURN._replace(clip="egg/a/b", angle=np.nan),
        TURN._replace(clip="egg/a/b", reference=0.2, angle=0.3, low=0.1, high=0.5),
    ]
    result = clips.Clips(None, turns, {})
    errors = [one.error for one in clips.find_worst(result)]
    assert errors == pytest.approx([3.0, 2.0, 0.1, 0.1])
    by_object = {row["object"]: row for row in clips.tables(result)[""]}
    egg = by_object["egg"]
    assert (egg["turns"], egg["rests"], egg["unanswered"], egg["outside"]) == (1, 1, 1, 0)
    assert by_object["all"]["turns"] == 5


def test_clips_without_an_answered_turn_have_an_empty_picture(tmp_path):
    result = clips.Clips(tmp_path, [TURN._replace(angle=np.nan)], {})
    figure = registered.plot(result)
    assert not any(axis.images for axis in figure.axes)
    plt.close(figure)


def shapes(turn, seed=0):
    """Edges of random boxes, turned clockwise [deg], under dots that stand still."""
    rng = np.random.default_rng(seed)
    scene = np.full((240, 320, 3), 120, np.uint8)
    for _ in range(25):
        corner, size = rng.integers((60, 40), (220, 160)), rng.integers(8, 40, 2)
        colour = tuple(int(value) for value in rng.integers(60, 200, 3))
        cv2.rectangle(scene, tuple(map(int, corner)), tuple(map(int, corner + size)), colour, -1)
    turning = cv2.getRotationMatrix2D((170.0, 110.0), -turn, 1.0)
    seen = cv2.warpAffine(scene, turning, (320, 240), borderValue=(120, 120, 120))
    for x in range(15, 320, 30):
        for y in range(15, 240, 30):
            cv2.circle(seen, (x, y), 5, (20, 20, 20), -1)
    return registration.find_edges(seen)


@pytest.mark.parametrize("turn", [-37.3, 0.0, 1.6, 22.8])
def test_a_print_under_dots_at_rest_is_registered(turn):
    found = registration.register(shapes(0.0), shapes(turn))
    assert found.clear
    assert found.turn == pytest.approx(turn, abs=0.3)


def test_two_different_prints_are_not_registered():
    assert not registration.register(shapes(0.0), shapes(0.0, seed=1)).clear


def test_pairs_are_drawn_from_the_clips_name():
    pairs = registered.draw_pairs("ball/exp_num_1/camera_0", 60)
    assert pairs == registered.draw_pairs("ball/exp_num_1/camera_0", 60)
    assert pairs != registered.draw_pairs("egg/exp_num_1/camera_0", 60)
    assert all(0 <= first < second < 60 for first, second in pairs)
    assert len({first for first, _ in pairs}) <= settings.PAIRED_FRAMES


def test_the_registration_agrees_with_an_independent_one():
    root = real("incipient-slip-detection")
    clip = "wallet/exp_num_1/camera_0"
    table = clips.read_references(root)[clip]
    turns = registered.register_pairs(root / f"{clip}.avi", [pair[:2] for pair in table])
    apart = np.abs(np.array(turns) - [turn for *_, turn in table])
    assert np.isfinite(apart).mean() > 0.9
    assert np.nanmax(apart) < settings.REFERENCE_ERROR


def test_an_angle_that_is_counted_anew_is_no_turn():
    recording, _ = simulate_pivot(angles_deg=(0.0, 5.0), frames=(5,))
    *_, answer = Stream(recording, Settings()).answers()

    def turn(first, last):
        estimate = answer.estimates["tracked"]
        counted = [replace(estimate, since=since) for since in (first, last)]
        answers = [answer._replace(estimates={"tracked": one}) for one in counted]
        return clips.compare_turn("egg", 0, 1, 0.0, answers).angle

    loaded = np.nan  # no frame without contact
    assert turn(loaded, loaded) == turn(0.4, 0.4) == 0.0
    assert np.isnan(turn(0.4, 1.2))
    assert np.isnan(turn(loaded, 1.2))
