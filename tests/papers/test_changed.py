"""Clips with changed pictures: how they are written, compared with references, and kept."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from estimation.pictures.stream import read_pictures
from papers.marker_images import changed, clips, registered, settings
from tests.estimation.pictures.test_printed import printed
from tests.estimation.pictures.test_reading import write_video

CLIP = "ball/exp_num_1/camera_0"
TURNS = (0.0, 0.0, 1.0, 2.0, 3.0, 4.0)


@pytest.fixture
def root(tmp_path, monkeypatch):
    """A data set of one clip, in which an object turns with the gel."""
    video, rng = tmp_path / f"{CLIP}.avi", np.random.default_rng(3)
    video.parent.mkdir(parents=True)
    write_video(video, [printed(turn, turn, rng) for turn in TURNS])
    rows = ("ball,1,0,1,5,4.0", "ball,1,0,1,3,2.0")
    (tmp_path / "reference_turns.csv").write_text("\n".join((",".join(clips.COLUMNS), *rows)))
    monkeypatch.setattr("estimation.frames.datasets.fetch", lambda name: tmp_path)
    monkeypatch.setattr(settings, "CHANGED_CLIPS", (CLIP, "egg/exp_num_1/camera_0"))
    monkeypatch.setattr(changed, "KEPT", tmp_path / "kept")
    return tmp_path


def test_changed_pictures_are_written_without_loss(root):
    before = list(read_pictures(root / f"{CLIP}.avi"))
    for name, change in changed.CHANGES.items():
        changed.write_changed(root / f"{CLIP}.avi", name, root / "changed.mkv")
        after, rng = list(read_pictures(root / "changed.mkv")), np.random.default_rng(3)
        assert [one.time for one in after] == [one.time for one in before]
        for i, (old, new) in enumerate(zip(before, after, strict=True)):
            assert old.image is not None
            assert new.image is not None
            levels = change(old.image.astype(float), i / len(before), rng)
            np.testing.assert_allclose(new.image, np.clip(levels, 0.0, 255.0), atol=0.5)


def test_a_coding_leaves_out_more_the_coarser_it_is(root):
    before = [picture.image for picture in read_pictures(root / f"{CLIP}.avi")]
    left_out = {}
    for name in changed.CODINGS:
        changed.write_changed(root / f"{CLIP}.avi", name, root / "changed.mkv")
        after = [picture.image for picture in read_pictures(root / "changed.mkv")]
        assert len(after) == len(before)
        left_out[name] = np.std(np.subtract(after, before, dtype=float))
    fine, middle, coarse, *_ = left_out.values()
    assert 0.0 < fine < middle < coarse
    assert left_out["H.264, 0.035 bits per pixel"] < left_out["H.264, 0.02 bits per pixel"]
    assert left_out["MPEG-4, 0.11 bits per pixel"] > 0.0


def test_changes_are_compared_with_the_references_and_kept(root, monkeypatch):
    names = ("as they are", "turned by 90°")
    turns = changed.answer_changes(names)
    for found in turns.values():
        assert [(turn.start, turn.stop, turn.reference) for turn in found] == [
            (1, 5, 4.0),
            (1, 3, 2.0),
            (3, 5, 2.0),
        ]
        assert [turn.error for turn in found] == pytest.approx([0.0] * 3, abs=0.5)
    monkeypatch.setattr(changed, "answer_pictures", lambda path: pytest.fail("answered again"))
    assert changed.answer_changes(names) == turns
    assert [row["pictures"] for row in changed.tables(turns)[""]] == list(names)
    plt.close(changed.plot(turns))


def test_a_change_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match=r"no change 'blue'; choose from: as they are; "):
        changed.answer_changes(["blue"])


def test_turns_are_registered_where_there_is_no_table(root, monkeypatch):
    (root / "reference_turns.csv").unlink()
    monkeypatch.setattr(registered, "draw_pairs", lambda clip, frames: [(0, 3), (1, frames - 1)])
    monkeypatch.setattr(registered, "register_pairs", lambda video, pairs: [2.1, np.nan])
    found = changed.find_references(root, {CLIP: root / f"{CLIP}.avi"})
    assert found == {CLIP: [(0, 3, 2.1)]}  # the other pair has no clear turn
