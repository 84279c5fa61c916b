"""The comparison with registered turns: what is read, what counts, what is shown."""

import numpy as np
import pytest

from papers.marker_images import clips, settings

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
