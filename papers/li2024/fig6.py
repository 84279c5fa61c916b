"""Fig. 6: measured rotations of four contacts, pressed and moved.

The motions are clockwise, counter-clockwise, pure translation, and a twisted small round contact.
The contact model solves their paths on an incompressible pad, so that pressing does not move the
markers sideways.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid, make_path, solve_path
from estimation.estimators import DEFAULT_METHOD
from estimation.frames.noise import find_noise
from estimation.tracking.trackers import Trackers
from estimation.virtual.contact import simulate_recording
from estimation.virtual.recording import Camera, PivotModel, Timing, lay_out_markers
from papers.items import Track
from papers.li2024 import settings
from papers.tables import cell

METHODS = ("paper", "paper_strict", "kolamuri", DEFAULT_METHOD)


class Motion(NamedTuple):
    """A case of the figure: radius of curvature and approach [mm], angle [deg], shift [mm]."""

    radius: float
    approach: float
    angle_deg: float
    shift: tuple[float, float]


MOTIONS = {
    "(a) clockwise": Motion(settings.DOME_MM, settings.APPROACH_MM, -10.0, (0.3, -0.2)),
    "(b) counter-clockwise": Motion(settings.DOME_MM, settings.APPROACH_MM, 10.0, (0.3, -0.2)),
    "(c) translation": Motion(settings.DOME_MM, settings.APPROACH_MM, 0.0, (0.5, -0.3)),
    "(d) small round contact": Motion(8.0, 0.7, 10.0, (0.0, 0.0)),
}

_PAD = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5)
_GRID = Grid((48, 48), (14.0, 14.0))
_FRICTION = 1.0
_STEPS = 10


class View(NamedTuple):
    """The last frame of a motion."""

    truth: float  # the object's true angle [deg]
    angle: dict[str, float]  # angle by each of `METHODS`; NaN without an answer [deg]
    reference: Float[np.ndarray, "n 2"]  # positions of the unloaded markers [mm]
    displacement: Float[np.ndarray, "n 2"]  # displacement of the markers [mm]
    sticks: Bool[np.ndarray, " n"]  # mask of the markers that truly stick
    contact: Bool[np.ndarray, " n"]  # mask of the markers under the object
    seen: Bool[np.ndarray, " n"]  # mask of the sticking markers according to the paper's method


def compute(quick: bool = False, track: Track = iter) -> dict[str, View]:
    """Solve and measure the four motions, in seconds; the quick size is the full one."""
    return {name: _view(MOTIONS[name]) for name in track(list(MOTIONS))}


def _view(motion: Motion) -> View:
    end = Pose(motion.approach, motion.shift, np.radians(motion.angle_deg))
    path = make_path([Pose(motion.approach), end], [_STEPS])
    solution = solve_path(
        Contact(_PAD, Rigid(), Paraboloid(motion.radius), _GRID, _FRICTION), path, rtol=1e-6
    )
    layout = lay_out_markers(PivotModel(grid_shape=settings.MARKERS, pitch=settings.PITCH_MM))
    recording, truth = simulate_recording(
        solution, layout, Camera(timing=Timing(dropped=0.0), seed=settings.SEED), unloaded=20
    )
    trackers = Trackers(layout, {method: {} for method in METHODS}, noise=find_noise(recording)[0])
    *_, last = (trackers.update(frame) for frame in recording)
    return View(
        truth=motion.angle_deg,
        angle={method: float(np.degrees(answer.angle)) for method, answer in last.items()},
        reference=layout.reference[:, :2],
        displacement=(recording.positions[-1] - layout.reference)[:, :2],
        sticks=truth.stick[-1],
        contact=truth.contact[-1],
        seen=last["paper"].stick,
    )


def numbers(result: dict[str, View]) -> dict[str, float]:
    """Our numbers for `published.csv`."""
    return {"rotation_in_translation": abs(result["(c) translation"].angle[DEFAULT_METHOD])}


def tables(result: dict[str, View]) -> dict[str, list[dict[str, object]]]:
    """A row for each motion."""
    return {
        "": [
            {
                "motion": name,
                "truth [°]": view.truth,
                **{f"{method} [°]": cell(view.angle[method], 3) for method in METHODS},
                "markers that stick": int(view.sticks.sum()),
                "in contact": int(view.contact.sum()),
            }
            for name, view in result.items()
        ]
    }


def plot(result: dict[str, View]) -> Figure:
    """Displacements of the markers, coloured by their true state; rings: the paper's method."""
    figure, axes = plt.subplots(1, 4, figsize=(15, 6), layout="constrained")
    for axis, (name, view) in zip(axes, result.items(), strict=True):
        slips = view.contact & ~view.sticks
        for markers, colour, what in (
            (~view.contact, "0.75", "no contact"),
            (slips, "C1", "has slipped (truth)"),
            (view.sticks, "C0", "sticks (truth)"),
        ):
            axis.quiver(
                *view.reference[markers].T,
                *view.displacement[markers].T,
                color=colour,
                angles="xy",
                scale_units="xy",
                scale=1.0,
                width=0.006,
                label=what,
            )
        axis.scatter(*view.reference[view.seen].T, s=30, facecolors="none", edgecolors="k", lw=0.6,
                     label="sticks (paper's method)")  # fmt: skip
        answers = "\n".join(f"{m}: {_say(angle)}" for m, angle in view.angle.items())
        axis.set_title(f"{name}, truth {view.truth:g}°\n{answers}", fontsize=9)
        reach = 1.5 * np.abs(view.reference[view.contact]).max()
        axis.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="x [mm]")
    axes[0].set_ylabel("y [mm]")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _say(angle: float) -> str:
    return f"{angle:.2f}°" if np.isfinite(angle) else "no answer"
