"""When a slip is called, beside the frame in which an outside camera sees the object move.

Objects 1 and 3. The motion is that of the object against the gripper, so that it contains the
gel's own shear and that of the other finger.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.pictures.stream import read_pictures
from papers.slip_lifts import settings
from papers.slip_lifts.lifts import Lift, Study, compute
from papers.slip_lifts.outside import measure_motion
from papers.slip_lifts.scores import first_called

__all__ = ["compute", "plot", "tables"]


@dataclass(frozen=True)
class Onsets:
    """Lifts that the outside camera has seen.

    Attributes:
        lifts: as answered from the gel.
        motion: of the object against the gripper in each frame [mm], by lift.
    """

    lifts: tuple[Lift, ...]
    motion: tuple[Float[np.ndarray, " frames"], ...]


@cache
def watch(study: Study) -> Onsets:
    """Follow the objects of a study in the outside pictures, where there are any."""
    seen = tuple(one for one in study.lifts if one.label.object_ in settings.VIEWS)
    motion = []
    for lift in seen:
        folder = study.root / "outside" / lift.label.object_ / lift.label.lift
        grey = [
            cv2.cvtColor(picture.image, cv2.COLOR_BGR2GRAY)
            for picture in read_pictures(folder)
            if picture.image is not None
        ]
        motion.append(measure_motion(grey, settings.VIEWS[lift.label.object_]))
    return Onsets(seen, tuple(motion))


def tables(result: Study) -> dict[str, list[dict[str, object]]]:
    """A row by lift, and how many frames before each motion the slips were called."""
    return tabulate(watch(result))


def plot(result: Study) -> Figure:
    """Motion by the outside camera and probability of a slip by the gel, lift by lift."""
    return draw(watch(result))


def tabulate(result: Onsets) -> dict[str, list[dict[str, object]]]:
    """The tables of some lifts."""
    rows = []
    for lift, motion in zip(result.lifts, result.motion, strict=True):
        called = first_called(lift.slipped)
        row: dict[str, object] = {
            "object": lift.label.object_,
            "lift": lift.label.lift,
            "label": "slipped" if lift.label.slipped else "held",
            "lift begins [frame]": lift.label.begins - lift.frames[0],
            "loaded [frame]": first_loaded(lift) if lift.label.slipped else None,
            "called [frame]": called,
        }
        for far in settings.SLID_MM:
            row[f"{far:g} mm [frame]"] = first_beyond(motion, far)
        rows.append(row | {"last frame [mm]": round(float(motion[-1]), 2)})
    slips = [row for row in rows if row["label"] == "slipped"]
    summary = [_lead(slips, f"{far:g} mm [frame]", f"{far:g} mm") for far in settings.SLID_MM]
    return {"": rows, "_leads": [row for row in summary if row["slips"]] or summary[:1]}


def _lead(slips: list[dict], column: str, name: str) -> dict[str, object]:
    """By how many frames the calls are ahead of a motion, and how many would have been possible."""
    reached = [
        row for row in slips if row[column] is not None and row["called [frame]"] is not None
    ]
    lead = np.array([row[column] - row["called [frame]"] for row in reached])
    most = np.array([row[column] - row["loaded [frame]"] for row in reached])
    return {
        "motion": name,
        "slips": len(reached),
        "lead, median [frames]": float(np.median(lead)) if len(lead) else None,
        "least": int(lead.min()) if len(lead) else None,
        "most": int(lead.max()) if len(lead) else None,
        "3 frames before or more": int((lead >= 3).sum()),
        "after the first load, median": float(np.median(most)) if len(most) else None,
    }


def first_beyond(motion: Float[np.ndarray, " frames"], far: float) -> int | None:
    """Index of the first frame from which on the object has gone as far for good; None in none."""
    short = np.flatnonzero(motion < far)
    first = int(short[-1]) + 1 if len(short) else 0
    return first if first < len(motion) else None


def first_loaded(lift: Lift) -> int:
    """Index of the frame in which the gel first shows a tenth of its greatest shear."""
    shear = np.array([one.shear for one in lift.shears])
    return int((shear > 0.1 * np.nanmax(shear)).argmax())


def draw(result: Onsets) -> Figure:
    """The figure of some lifts."""
    columns = 5
    rows = -(-len(result.lifts) // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(13, 2.3 * rows), sharex=True, squeeze=False, layout="constrained"
    )
    for axis in axes.ravel()[len(result.lifts) :]:
        axis.axis("off")
    for axis, lift, motion in zip(axes.ravel(), result.lifts, result.motion, strict=False):
        axis.plot(motion, "k", lw=1.0)
        axis.axhline(settings.SLID_MM[0], color="0.7", lw=0.6)
        axis.set_ylim(0.0, 5.0)
        twin = axis.twinx()
        twin.plot(lift.slipped, "C3", lw=1.0)
        twin.set_ylim(0.0, 1.05)
        what = "slipped" if lift.label.slipped else "held"
        axis.set_title(f"{lift.label.object_} {lift.label.lift}: {what}", fontsize=8)
    axes[0, 0].set_ylabel("black: moved [mm]\nred: probability", fontsize=8)
    axes[-1, 0].set_xlabel("frame")
    return figure
