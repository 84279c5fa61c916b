"""Episodes of LeRobot data sets of other programs: each is what its part of a video shows."""

import numpy as np
import pytest
from pyarrow import parquet

from estimation.frames.columns.episodes import find_clip, list_episodes
from estimation.inputs import open_inputs
from estimation.pictures.reader import ImageSettings
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import (
    count_pictures,
    describe_pictures,
    is_pictures,
    read_pictures,
)
from estimation.settings import Settings
from estimation.sources import find_recordings, list_contents, read_recording
from tests.estimation.frames.lerobot_sets import GEL, RATE, write_set, write_video
from tests.estimation.pictures.test_clips import compress
from tests.test_examples import pictures as turned_pictures


@pytest.fixture(scope="module")
def shown():
    """The pictures of each episode."""
    first = list(turned_pictures())[1:]
    return [first, first[::-1], first[:3]]


@pytest.fixture(scope="module")
def data_set(tmp_path_factory, shown):
    """All episodes in one video that has a single key frame."""
    path = tmp_path_factory.mktemp("sets") / "pivots"
    features = {GEL: {"dtype": "video"}, "observation.images.top": {"dtype": "video"}}
    write_set(path, features | {"action": {"dtype": "float32"}}, [len(one) for one in shown])
    write_video(path, [one for episode in shown for one in episode])
    return path


def test_every_episode_is_a_recording(data_set, shown):
    places = find_recordings(data_set, (GEL,))
    assert places == [data_set / GEL / f"episode_{number}" for number in range(3)]
    for place, expected in zip(places, shown, strict=True):
        assert is_pictures(place)
        assert count_pictures(place) == len(expected)
        found = list(read_pictures(place))
        assert [one.number for one in found] == list(range(len(expected)))
        np.testing.assert_allclose([one.time for one in found], np.arange(len(expected)) / RATE)
        for one, image in zip(found, expected, strict=True):
            assert not one.flaw
            assert abs(one.image.mean(axis=2) - image).mean() < 4.0


def test_episodes_are_run_over_like_clips(data_set):
    settings = Settings(topic=(GEL,), images=ImageSettings(Sensor(dark=True)))
    inputs = open_inputs([str(data_set)], settings, print)
    assert [one.source.name for one in inputs] == ["episode_0", "episode_1", "episode_2"]
    recording = read_recording(data_set / GEL / "episode_0", settings.images)
    assert recording.valid.sum(axis=1).min() >= 25


def test_videos_are_named_and_listed(data_set):
    with pytest.raises(ValueError, match=rf"2 videos: name that.*\(--topic\): {GEL}, .*top"):
        find_recordings(data_set)
    with pytest.raises(ValueError, match=r"no video action \(--topic\)"):
        find_recordings(data_set, ("action",))
    assert list_contents(data_set)[0] == f"{GEL}: video (3 episodes)"
    with pytest.raises(ValueError, match=f"no episode 7 of {GEL}"):
        find_clip(data_set / GEL / "episode_7")
    assert find_clip(data_set.parent / "none" / GEL / "episode_7") is None


def test_a_video_that_ends_early_says_so(tmp_path, data_set):
    write_set(tmp_path / "set", {GEL: {"dtype": "video"}}, [4, 20])
    (tmp_path / "set" / "videos").symlink_to(data_set / "videos")
    with pytest.raises(ValueError, match="outside the data set"):
        list_episodes(tmp_path / "set")
    (tmp_path / "set" / "videos").unlink()
    file = tmp_path / "set" / "videos" / GEL / "chunk-000" / "file-000.mp4"
    file.parent.mkdir(parents=True)
    file.write_bytes((data_set / "videos" / GEL / "chunk-000" / "file-000.mp4").read_bytes())
    (tmp_path / "set" / "meta" / "episodes" / "again.parquet").touch()
    with pytest.raises(ValueError, match=r"again\.parquet is damaged"):
        list_episodes(tmp_path / "set")
    (tmp_path / "set" / "meta" / "episodes" / "again.parquet").unlink()
    found = list(read_pictures(list_episodes(tmp_path / "set")[1]))
    assert len(found) == 8
    assert found[-1].flaw.startswith("13 of the episode's 20 frames are missing")


def test_a_coarse_video_is_doubted_as_a_clip_is(tmp_path):
    images = [np.full((96, 128, 3), level, np.uint8) for level in range(100, 160)]
    write_set(tmp_path, {GEL: {"dtype": "video"}}, [30, 30])
    file = tmp_path / "videos" / GEL / "chunk-000" / "file-000.mp4"
    file.parent.mkdir(parents=True)
    for codec, doubts in (("libx265", 1), ("libx264", 0)):
        compress(file, images, 0.01, codec)
        assert len(describe_pictures(tmp_path / GEL / "episode_1")) == doubts


def test_a_table_of_episodes_without_times_names_them(tmp_path):
    write_set(tmp_path, {GEL: {"dtype": "video"}}, [3])
    (file,) = (tmp_path / "meta" / "episodes").rglob("*.parquet")
    start, whole = f"videos/{GEL}/from_timestamp", parquet.read_table(file)
    for table, words in (
        (whole.drop_columns(start), f"it lacks {start}"),
        (whole.drop_columns(start).append_column(start, [[None]]), "3 frames from None to"),
    ):
        parquet.write_table(table, file)
        with pytest.raises(ValueError, match=words):
            list_episodes(tmp_path)


def test_what_cannot_be_read_says_what_to_do(tmp_path):
    write_set(tmp_path / "old", {GEL: {"dtype": "video"}}, [3], version="v2.1")
    with pytest.raises(ValueError, match=r"version v2\.1, but only version 3 is read: run over"):
        find_recordings(tmp_path / "old")
    write_set(tmp_path / "points", {"observation.tactile.points": {"dtype": "float32"}}, [3])
    with pytest.raises(ValueError, match=r"no videos, but observation\.tactile\.points: .*rest"):
        find_recordings(tmp_path / "points")
    write_set(tmp_path / "far", {GEL: {"dtype": "video"}}, [3], video="../../../../far.mp4")
    with pytest.raises(ValueError, match="outside the data set"):
        find_recordings(tmp_path / "far")
