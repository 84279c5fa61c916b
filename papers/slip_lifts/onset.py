"""Time of the first slip call, compared with the object's motion in an outside camera.

Objects 1 and 3. The motion is that of the object relative to the gripper, so it includes the shear
of the gel and of the other finger.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from estimation.pictures.stream import read_pictures
from estimation.slip.shear import ShearPath
from papers.slip_lifts import settings
from papers.slip_lifts.lifts import Lift, Study, compute
from papers.slip_lifts.outside import measure_motion
from papers.slip_lifts.scores import date_onset, first_called
from papers.tables import cell

__all__ = ["compute", "plot", "tables"]


@dataclass(frozen=True)
class Onsets:
    """Lifts recorded by the outside camera.

    Attributes:
        lifts: answers from the gel.
        motion: motion of the object relative to the gripper in each frame, by lift [mm].
    """

    lifts: tuple[Lift, ...]
    motion: tuple[Float[np.ndarray, " frames"], ...]


@cache
def watch(study: Study) -> Onsets:
    """Track the objects in the outside pictures, for the lifts that have such pictures."""
    watched = tuple(lift for lift in study.lifts if lift.label.object_ in settings.VIEWS)
    motion = []
    for lift in watched:
        folder = study.root / "outside" / lift.label.object_ / lift.label.lift
        grey = [
            cv2.cvtColor(picture.image, cv2.COLOR_BGR2GRAY)
            for picture in read_pictures(folder)
            if picture.image is not None
        ]
        motion.append(measure_motion(grey, settings.VIEWS[lift.label.object_]))
    return Onsets(watched, tuple(motion))


def tables(result: Study) -> dict[str, list[dict[str, object]]]:
    """A row for each lift, and the lead of the slip calls before each distance, in frames."""
    return tabulate(watch(result))


def plot(result: Study) -> Figure:
    """Motion by the outside camera and probability of a slip by the gel, a panel for each lift."""
    return draw(watch(result))


def tabulate(result: Onsets) -> dict[str, list[dict[str, object]]]:
    """The tables of the lifts recorded by the outside camera."""
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
            "dated [frame]": date_onset(ShearPath.of(*lift.shears)),
        }
        for far in settings.SLID_MM:
            row[f"{far:g} mm [frame]"] = first_beyond(motion, far)
        rows.append(row | {"last frame [mm]": cell(motion[-1], 2)})
    slips = [row for row in rows if row["label"] == "slipped"]
    summary = [_lead(slips, f"{far:g} mm [frame]", f"{far:g} mm") for far in settings.SLID_MM]
    return {"": rows, "_leads": [row for row in summary if row["slips"]] or summary[:1]}


def _lead(slips: list[dict], column: str, name: str) -> dict[str, object]:
    """Lead of the calls before a motion, and the largest possible lead [frames]."""
    reached = [
        row for row in slips if row[column] is not None and row["called [frame]"] is not None
    ]
    lead = np.array([row[column] - row["called [frame]"] for row in reached])
    most = np.array([row[column] - row["loaded [frame]"] for row in reached])
    return {
        "motion": name,
        "slips": len(reached),
        "lead, median [frames]": cell(lead, 1, np.median),
        "least": int(lead.min()) if len(lead) else None,
        "most": int(lead.max()) if len(lead) else None,
        "3 frames before or more": int((lead >= 3).sum()),
        "after the first load, median": cell(most, 1, np.median),
    }


def first_beyond(motion: Float[np.ndarray, " frames"], far: float) -> int | None:
    """Index of the frame from which the object stays beyond a distance; None if it never does."""
    short = np.flatnonzero(motion < far)
    first = int(short[-1]) + 1 if len(short) else 0
    return first if first < len(motion) else None


def first_loaded(lift: Lift) -> int:
    """Index of the frame in which the gel first has a tenth of its greatest shear."""
    shear = np.array([shear.shear for shear in lift.shears])
    return int((shear > 0.1 * np.nanmax(shear)).argmax())


def draw(result: Onsets) -> Figure:
    """The figure of the lifts recorded by the outside camera."""
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
