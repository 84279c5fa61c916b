"""Virtual lifts: rendered pictures of objects that are held or slip, with truth.

Spheres, cubes and cylinders are shifted along the gel, some turned as well, at friction from 0.2
to 1.0; friction falls when the object slides, or does not. The pictures begin loaded, and go the
way of `python -m estimation run` without options.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import Rigid
from contactmodel.pose import Pose, make_path
from estimation.estimators import DEFAULT_METHOD
from estimation.estimators.result import State
from estimation.slip.shear import Shear
from estimation.virtual.clip import Scene, VirtualClip
from papers.items import Track
from papers.marker_images.answers import answer_clip
from papers.marker_images.scenes import GRID, PAD, draw_look, shape_of
from papers.slip_lifts.scores import first_called

SHAPES = ("sphere", "cube", "cylinder")
RELIEFS = ("texture", "edges", "stripes", "smooth")
DRAWS, QUICK_DRAWS = 36, 4
"""Lifts of either kind."""
UNSEEN = 9
"""Poses before the first picture: the object is pressed on."""
SOON = 2
"""Frames after the onset of macro slip within which it should be called."""

NEAR_SHARE, NEAR_MM = 0.05, 0.02
"""Error of the slip that is asked for: a share of it [-], or a length."""
SLIP_FIGURES = (
    "median error [µm]",
    "90 % [µm]",
    "within 5 % or 20 µm [%]",
    "median half-width [µm]",
    "in the interval [%]",
)


class VirtualLift(NamedTuple):
    """A lift, as it was and as it is answered.

    Attributes:
        shape: of the object.
        relief: what it prints.
        slips: whether it slips.
        onset: first frame in which nothing sticks; None if it is held.
        slipped: probability of a slip in each frame [-].
        states: of the contact in each frame, as answered.
        slid: slip of the object over the gel in each frame, as it was since the frame that the
            answer counts from, the answer, and the half-width of its interval [mm]; NaN where it is
            not answered.
    """

    shape: str
    relief: str
    slips: bool
    onset: int | None
    slipped: Float[np.ndarray, " frames"]
    states: tuple[State, ...]
    slid: Float[np.ndarray, "3 frames"]

    @property
    def called(self) -> int | None:
        """First frame that is called a slip."""
        return first_called(self.slipped)

    @property
    def delay(self) -> int | None:
        """Frames from the onset to the call."""
        return None if self.onset is None or self.called is None else self.called - self.onset


def draw_lift(slips: bool, draw: int) -> tuple[str, Scene]:
    """The shape and the scene of a lift, drawn at random."""
    rng = np.random.default_rng((int(slips), draw))
    shape = SHAPES[draw % len(SHAPES)]
    indenter, approach = shape_of(shape, rng)
    way = rng.uniform(0.0, 2.0 * np.pi)
    friction = rng.uniform(0.2, 0.5) if slips else rng.uniform(0.6, 1.0)
    distance = rng.uniform(2.0, 4.0) if slips else rng.uniform(0.2, 0.5)
    shift = distance * np.array([np.cos(way), np.sin(way)])
    turn = np.radians(3.0) if rng.uniform() < 1.0 / 3.0 else 0.0
    frames = int(rng.integers(6, 11))
    pressed = Pose(approach)
    lifted = Pose(approach, shift, turn)
    scene = Scene(
        contact=Contact(PAD, Rigid(), indenter, GRID, friction),
        path=make_path(
            [Pose(0.0), Pose(0.0), pressed, pressed, lifted, lifted],
            [3, 5, 6, frames, 16 - frames],
        ),
        relief=RELIEFS[draw % len(RELIEFS)],
        first=UNSEEN,
        kinetic=float(rng.choice([1.0, 0.8, 0.6])),
        **draw_look(rng),
    )
    return shape, scene


def answer_lift(slips: bool, draw: int) -> VirtualLift:
    """Draw a lift, and run over its pictures as the command line does."""
    shape, scene = draw_lift(slips, draw)
    clip = VirtualClip(scene)
    answers = answer_clip(clip).frames
    return VirtualLift(
        shape,
        scene.relief,
        clip.truth.onset is not None,
        clip.truth.onset,
        np.array([answer.shear.slipped for answer in answers]),
        tuple(answer.estimates[DEFAULT_METHOD].state for answer in answers),
        compare_slips(clip, [answer.shear for answer in answers]),
    )


def compare_slips(clip: VirtualClip, shears: list[Shear]) -> Float[np.ndarray, "3 frames"]:
    """The slip of the object in each frame, the answer and its half-width, as `VirtualLift` has it.

    Args:
        clip: whose pictures were answered, without a scale.
        shears: the answers.
    """
    truth, scale = clip.truth, clip.scene.camera.mm_per_px
    found = np.array([(one.slip, one.slip_error, one.slip_since) for one in shears]).T
    since = np.rint(np.nan_to_num(found[2]) * clip.scene.rate).astype(int)
    way = truth.shift - truth.gel_shift
    # counted from a frame before any slip it is that over the gel that has slipped least
    slip = np.where(truth.slip[since] > 0.0, np.linalg.norm(way - way[since], axis=1), truth.slip)
    return np.stack([slip, *(scale * found[:2])])


def compute(quick: bool = False, track: Track = iter) -> list[VirtualLift]:
    """Draw and answer the lifts."""
    draws = range(QUICK_DRAWS if quick else DRAWS)
    return [answer_lift(*case) for case in track([(s, i) for i in draws for s in (False, True)])]


def tables(result: list[VirtualLift]) -> dict[str, list[dict[str, object]]]:
    """A row for each shape and for each thing printed; how far the slips found are off."""
    shapes = {name: [one for one in result if one.shape == name] for name in SHAPES}
    reliefs = {name: [one for one in result if one.relief == name] for name in RELIEFS}
    groups = shapes | reliefs | {"all": result}
    slips = {
        f"{relief}, {'slipped' if slipped else 'held'}": [
            one for one in reliefs[relief] if one.slips == slipped
        ]
        for relief in RELIEFS
        for slipped in (False, True)
    }
    return {
        "": [_row(name, some) for name, some in groups.items() if some],
        "_slips": [_slip_row(name, some) for name, some in slips.items() if some],
    }


def _slip_row(name: str, lifts: list[VirtualLift]) -> dict[str, object]:
    slid = np.concatenate([one.slid for one in lifts], axis=1)
    slip, found, half = slid[:, np.isfinite(slid[1])]
    off = np.abs(found - slip)
    row: dict[str, object] = {"lifts": name, "frames": slid.shape[1], "answered": len(slip)}
    if not len(slip):
        return row | dict.fromkeys(SLIP_FIGURES)
    near = off <= np.maximum(NEAR_SHARE * slip, NEAR_MM)
    figures = (
        1e3 * np.median(off),
        1e3 * np.quantile(off, 0.9),
        100.0 * near.mean(),
        1e3 * np.median(half),
        100.0 * (off <= half).mean(),
    )
    return row | {name: round(float(one)) for name, one in zip(SLIP_FIGURES, figures, strict=True)}


def _row(name: str, lifts: list[VirtualLift]) -> dict[str, object]:
    held = [one for one in lifts if not one.slips]
    slipped = [one for one in lifts if one.slips]
    delays = [one.delay for one in slipped if one.delay is not None]
    soon = sum(abs(delay) <= SOON for delay in delays)
    return {
        "lifts": name,
        "held": len(held),
        "called slips": sum(one.called is not None for one in held),
        "macro slip in some frame": sum(State.MACRO_SLIP in one.states for one in held),
        "slipped": len(slipped),
        "called": len(delays),
        f"within {SOON} frames": soon,
        "median delay [frames]": float(np.median(delays)) if delays else None,
        "longest": max(delays, default=None),
    }


def plot(result: list[VirtualLift]) -> Figure:
    """Probability of a slip, from its onset in lifts that slip and from the first frame else."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 3.6), sharey=True, layout="constrained")
    for one in result:
        frames = np.arange(len(one.slipped)) - (one.onset or 0)
        axes[int(one.slips)].plot(frames, one.slipped, color="C3" if one.slips else "C0", lw=0.8)
    for axis, title in zip(axes, ("held", "slipped"), strict=True):
        axis.axhline(0.5, color="0.5", lw=0.8)
        axis.set_title(f"{title}: {sum(one.slips == (title == 'slipped') for one in result)} lifts")
        axis.set_xlabel("frame" if title == "held" else "frames after nothing sticks")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("probability of a slip")
    return figure
