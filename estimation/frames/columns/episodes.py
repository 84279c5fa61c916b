"""Episodes in the videos of LeRobot data sets (version 3) written by other programs.

Such a data set is like a folder: `set/observation.images.gel/episode_7` is the video of episode 7
in the feature `observation.images.gel`. A video file holds many episodes one after the other;
`meta/episodes` lists their start times.
"""

import json
import re
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from contactmodel.common.inputs import naming
from estimation.frames.extras import require_extra


class Clip(NamedTuple):
    """Part of a video."""

    video: Path  # path of the video
    start: float  # time at which the part begins [s]
    stop: float  # time at which the part ends [s]
    pictures: int  # number of pictures in the part


def is_lerobot(path: Path) -> bool:
    """Whether there is a LeRobot data set at the path."""
    return (path / "meta" / "info.json").is_file()


def list_features(path: Path) -> list[str]:
    """List the features of a data set that are videos.

    Raises:
        ValueError: the data set is of another version, or damaged.
        OSError: the data set cannot be read.
    """
    features = _read_info(path)["features"]
    return [name for name, feature in features.items() if feature.get("dtype") == "video"]


def list_episodes(path: Path, features: tuple[str, ...] = ()) -> list[Path]:
    """List the places of all episodes, feature by feature.

    Args:
        path: of the data set.
        features: names of the features; may be omitted if only one is a video.

    Raises:
        ImportError: the extra `lerobot` is not installed.
        ValueError: there is no such feature, a feature must be named because there are several, or
            the data set is damaged.
        OSError: the data set cannot be read.
    """
    videos = list_features(path)
    if not videos:
        held = ", ".join(_read_info(path)["features"]) or "no features"
        raise ValueError(
            f"{path} has no videos, but {held}: features of points lack positions at rest, so they "
            "are read only from data sets of `--sink lerobot`; write the markers of other data "
            "sets as an archive (write_archive)"
        )
    if not features and len(videos) > 1:
        names = ", ".join(videos)
        raise ValueError(
            f"{path} has {len(videos)} videos: name that of the sensor (--topic): {names}"
        )
    if unknown := [feature for feature in features if feature not in videos]:
        names = ", ".join(videos)
        raise ValueError(f"{path} has no video {unknown[0]} (--topic); it has {names}")
    return [
        path / feature / f"episode_{episode}"
        for feature in features or videos
        for episode in sorted(_read_episodes(path, feature))
    ]


def find_clip(place: Path) -> Clip | None:
    """Find the part of a video that shows an episode, the place `SET/FEATURE/episode_N`.

    None if the place is not in a data set.

    Raises:
        ImportError: the extra `lerobot` is not installed.
        ValueError: there is no such episode, or the data set is damaged.
        OSError: the data set cannot be read.
    """
    episode = re.fullmatch(r"episode_(\d+)", place.name)
    if episode is None or len(place.parts) < 3 or not is_lerobot(place.parents[1]):
        return None
    path = place.parents[1]
    clips, number = _read_episodes(path, place.parent.name), int(episode[1])
    if number not in clips:
        raise ValueError(f"{path} has no episode {number} of {place.parent.name}")
    return clips[number]


def _read_info(path: Path) -> dict[str, Any]:
    file = path / "meta" / "info.json"
    with naming(file, "not of a LeRobot data set, or damaged"):
        info = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(info, dict) or not isinstance(info.get("features"), dict):
            raise ValueError("it has no features")
        if not all(isinstance(feature, dict) for feature in info["features"].values()):
            raise ValueError("its features have no description")
    version = str(info.get("codebase_version"))
    if not version.startswith("v3"):
        raise ValueError(
            f"{path} is a LeRobot data set of version {version}, but only version 3 is read: run "
            "over its videos (videos/…/episode_000000.mp4), or convert it with LeRobot"
        )
    return info


@lru_cache(maxsize=8)
def _read_episodes(path: Path, feature: str) -> dict[int, Clip]:
    """The part of a video that shows each episode of a feature, by the episode's number."""
    require_extra("lerobot", f"reading {path}")
    from pyarrow import ArrowException, parquet

    info, clips = _read_info(path), dict[int, Clip]()
    template = str(info.get("video_path", ""))
    about = ("chunk_index", "file_index", "from_timestamp", "to_timestamp")
    named = [f"videos/{feature}/{name}" for name in about]
    for file in sorted((path / "meta" / "episodes").rglob("*.parquet")):
        try:
            columns = ["episode_index", "length", *named]
            if missing := [name for name in columns if name not in parquet.read_schema(file).names]:
                raise ValueError(f"it lacks {', '.join(missing)}")
            table = parquet.read_table(file, columns=columns)
            for number, length, chunk, part, start, stop in zip(
                *(table[name].to_pylist() for name in table.column_names), strict=True
            ):
                video = template.format(video_key=feature, chunk_index=chunk, file_index=part)
                place = (path / video).resolve()
                if not place.is_relative_to(path.resolve()):
                    raise ValueError(f"the video {video} is outside the data set")
                known = None not in (length, start, stop)
                if not (known and 0.0 <= start < stop and length > 0):
                    raise ValueError(
                        f"episode {number} is {length} frames from {start} to {stop} s"
                    )
                clips[int(number)] = Clip(place, float(start), float(stop), int(length))
        except (ArrowException, LookupError, TypeError, ValueError, OSError) as error:
            why = " ".join(str(error).split())
            raise ValueError(f"{file} is damaged, or of another version ({why})") from error
    if not clips:
        raise ValueError(f"{path} has no episodes: meta/episodes is missing, or empty")
    return clips
