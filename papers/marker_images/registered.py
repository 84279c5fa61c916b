"""The published clips: our angles compared with turns between random frames, registered here.

Pairs of frames are drawn at random, and the turn of the object's print between them is found by a
method of its own (`registration`). Pairs without a clear turn are left out.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from estimation.frames import datasets
from estimation.pictures.stream import read_pictures
from papers.items import Track
from papers.marker_images import clips, settings
from papers.marker_images.answers import answer_pictures
from papers.marker_images.registration import Edges, find_edges, register


def compute(quick: bool = False, track: Track = iter) -> clips.Clips:
    """Answer every clip, and register its pairs; if quick, only the two shortest clips."""
    root = datasets.fetch("pivot-videos").parents[1]
    datasets.fetch("state-videos")
    found = sorted(root.glob("*/*/*.avi"))
    videos = {video.relative_to(root).with_suffix("").as_posix(): video for video in found}
    if quick:
        videos = clips.take_shortest(videos)
    result = clips.Clips(root, [], {})
    for clip in track(videos):
        answers = answer_pictures(videos[clip]).frames
        pairs = draw_pairs(clip, len(answers))
        turns = register_pairs(videos[clip], pairs)
        result.answers[clip] = answers
        result.turns.extend(
            clips.compare_turn(clip, *pair, turn, answers)
            for pair, turn in zip(pairs, turns, strict=True)
            if np.isfinite(turn)
        )
    return result


def tables(result: clips.Clips) -> dict[str, list[dict[str, object]]]:
    """Tables by object and pair, and the worst turns as text."""
    return clips.tabulate_turns(result)


def plot(result: clips.Clips) -> Figure:
    """The worst turns: both frames with the contact's markers, and a sentence."""
    return clips.plot(result)


def draw_pairs(clip: str, frames: int) -> list[tuple[int, int]]:
    """Random frames of a clip, each with some later frames; the clip's name is the seed."""
    rng = np.random.default_rng(list(clip.encode()))
    first = rng.choice(frames, size=min(settings.PAIRED_FRAMES, frames), replace=False)
    pairs = [(int(i), int(i) + apart) for i in np.sort(first) for apart in settings.FRAMES_APART]
    return [pair for pair in pairs if pair[1] < frames]


def register_pairs(video: Path, pairs: list[tuple[int, int]]) -> list[float]:
    """The turns between pairs of frames [deg, clockwise on the screen]; NaN if one is not clear."""
    wanted = {frame for pair in pairs for frame in pair}
    edges: dict[int, Edges] = {}
    for frame, picture in enumerate(read_pictures(video)):
        if frame in wanted and picture.image is not None:
            edges[frame] = find_edges(picture.image)
    turns = []
    for first, second in pairs:
        shown = first in edges and second in edges
        found = register(edges[first], edges[second]) if shown else None
        turns.append(found.turn if found is not None and found.clear else np.nan)
    return turns
