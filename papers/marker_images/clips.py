"""The published clips `pivot-videos`: what each finger's dots, and the object's imprint, say.

Two GelSight fingers hold an object that is lifted, turned and shaken. Nobody measured its angle
apart from the pictures: for one lift the imprint of the handle's ridges was registered by other
means and checked by eye (`settings.REGISTERED`), good to a degree.
"""

from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from estimation.estimators.result import Result, State
from estimation.frames import datasets
from estimation.frames.noise import estimate_noise
from estimation.frames.recording import Recording
from estimation.slip.motion import follow_gel
from estimation.sources import read_recording
from estimation.tracker import Tracker
from papers.items import Track
from papers.marker_images import settings


class Clip(NamedTuple):
    """A finger's video, read and answered."""

    recording: Recording
    result: Result


def compute(quick: bool = False, track: Track = iter) -> dict[str, Clip]:
    """Read and answer every clip, by its place in the data set; the lift with a reference only."""
    root = datasets.fetch("pivot-videos").parents[1]
    paths = sorted(root.glob("screw_driver_blue_gray/exp_num_1/*.avi" if quick else "*/*/*.avi"))
    return {
        f"{path.parent.relative_to(root)}/{path.stem}": _answer(read_recording(path))
        for path in track([Path(one) for one in paths])
    }


def _answer(recording: Recording) -> Clip:
    tracker = Tracker(recording.layout, noise=estimate_noise(recording))
    return Clip(recording, Result.gather("tracked", [tracker.update(frame) for frame in recording]))


def tables(result: dict[str, Clip]) -> dict[str, list[dict[str, object]]]:
    """A row for each clip, and one for each of some frames of it."""
    clips, frames = [], []
    for name, (recording, found) in result.items():
        answered = int(found.answered.sum())
        labelled = sum(
            bool(why) for why, a in zip(found.reason, found.answered, strict=True) if not a
        )
        half = np.degrees(0.5 * (found.high - found.low))
        clips.append(
            {
                "clip": name,
                "frames": len(recording),
                "answered": answered,
                "labelled": labelled,
                **{f"{state}": found.state.count(state) for state in State},
                "at the edge": sum("edge of the view" in why for why in found.reason),
                "not recognised": sum(bool(flaw) for flaw in recording.flaws),
                "widest ± [°]": _number(np.nanmax(half) if answered else np.nan),
            }
        )
        for frame in settings.CLIP_FRAMES:
            if frame < len(recording):
                frames.append(_row(name, recording, found, frame))
    return {"": clips, "_frames": frames}


def _row(name: str, recording: Recording, found: Result, frame: int) -> dict[str, object]:
    imprint = np.nan if recording.imprint is None else recording.imprint[frame, 0]
    gel = follow_gel(found)[frame]
    return {
        "clip": name,
        "frame": frame,
        "state": str(found.state[frame]),
        "angle [°]": _number(np.degrees(found.angle[frame])),
        "± [°]": _number(np.degrees(0.5 * (found.high - found.low)[frame])),
        "gel [°]": _number(np.degrees(gel)),
        "imprint [°]": _number(np.degrees(imprint)),
        "imprint - gel [°]": _number(np.degrees(imprint - gel)),
        "registered by other means [°]": settings.REGISTERED.get(name, {}).get(frame),
        "reason": found.reason[frame],
    }


def _number(value: float) -> float | None:
    return round(float(value), 1) if np.isfinite(value) else None


def plot(result: dict[str, Clip]) -> Figure:
    """Angles of both fingers of each lift, their imprints, and the reference where there is one."""
    lifts = list(dict.fromkeys(name.rsplit("/", 1)[0] for name in result))
    columns = min(3, len(lifts))
    figure, axes = plt.subplots(
        -(-len(lifts) // columns),
        columns,
        figsize=(4.5 * columns, 3.0 * -(-len(lifts) // columns)),
        squeeze=False,
        layout="constrained",
    )
    for axis, lift in zip(axes.ravel(), lifts, strict=False):
        fingers = [name for name in result if name.startswith(lift + "/")]
        for colour, name in zip(("C0", "C1"), fingers, strict=False):
            recording, found = result[name]
            number = found.source_index
            axis.plot(number, np.degrees(found.angle), color=colour, label=name.rsplit("/", 1)[1])
            axis.fill_between(
                number, *np.degrees([found.low, found.high]), color=colour, alpha=0.3, lw=0
            )
            if recording.imprint is not None:
                axis.plot(number, np.degrees(recording.imprint[:, 0]), ":", color=colour, lw=0.9)
            known = settings.REGISTERED.get(name, {})
            axis.plot(list(known), list(known.values()), "k.", ms=4)
        axis.set_title(lift, fontsize=9)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    axes[0, 0].set_ylabel("angle [°]; dotted: imprint")
    axes[-1, 0].set_xlabel("frame")
    return figure
