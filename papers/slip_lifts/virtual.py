"""Virtual lifts: rendered pictures of objects that are held or slip, with truth.

Spheres, cubes and cylinders are shifted along the gel, and some are turned, with friction
coefficients from 0.2 to 1.0. In some lifts friction falls once the object slides. The pictures
begin loaded; `python -m estimation run` answers them without options.
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
from estimation.slip.shear import Shear, ShearPath
from estimation.virtual.clip import Scene, VirtualClip
from papers.items import Track
from papers.marker_images.answers import answer_clip
from papers.marker_images.scenes import GRID, PAD, draw_look, shape_of
from papers.slip_lifts.scores import date_onset, first_called

SHAPES = ("sphere", "cube", "cylinder")
RELIEFS = ("texture", "edges", "stripes", "smooth")
DRAWS, QUICK_DRAWS = 108, 4
"""Number of held lifts, and of lifts that slip."""
UNSEEN = 9
"""Poses before the first picture, in which the object is pressed on."""
SOON = 2
"""Frames around the onset within which macro slip should be called and dated."""

NEAR_SHARE, NEAR_MM = 0.05, 0.02
"""Largest allowed error of the slip: a share of the slip [-], or a length [mm] if larger."""
SLIP_FIGURES = (
    "median error [µm]",
    "90 % [µm]",
    "within 5 % or 20 µm [%]",
    "median half-width [µm]",
    "in the interval [%]",
)


class VirtualLift(NamedTuple):
    """The truth of a lift and its answers."""

    shape: str  # shape of the object
    relief: str  # relief that the object prints
    slips: bool  # whether the object slips
    onset: int | None  # first frame in which nothing sticks; None for a held object
    shears: ShearPath  # shear of the gel and probability of a slip in each frame
    states: tuple[State, ...]  # estimated state of the contact in each frame
    # slip of the object over the gel in each frame [mm]: the truth since the frame from which the
    # estimate counts, the estimate, and the half-width of its interval. The last two are NaN
    # without an answer.
    slid: Float[np.ndarray, "3 frames"]

    @property
    def called(self) -> int | None:
        """First frame called a slip; None without one."""
        return first_called(self.shears.slip_probability)

    @property
    def delay(self) -> int | None:
        """Frames from the onset to the call; None without an onset or a call."""
        return None if self.onset is None or self.called is None else self.called - self.onset

    @property
    def misdated(self) -> int | None:
        """Frames from the onset to its date in view of all frames; None as for `delay`."""
        dated = date_onset(self.shears)
        return None if self.onset is None or dated is None else dated - self.onset


def draw_lift(slips: bool, draw: int) -> tuple[str, Scene]:
    """The shape's name and the random scene of a lift."""
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
    """Render a lift, and answer its pictures as the command line does."""
    shape, scene = draw_lift(slips, draw)
    clip = VirtualClip(scene)
    answers = answer_clip(clip).frames
    shears = [answer.shear for answer in answers]
    return VirtualLift(
        shape,
        scene.relief,
        clip.truth.onset is not None,
        clip.truth.onset,
        ShearPath.of(*shears),
        tuple(answer.estimates[DEFAULT_METHOD].state for answer in answers),
        compare_slips(clip, shears),
    )


def compare_slips(clip: VirtualClip, shears: list[Shear]) -> Float[np.ndarray, "3 frames"]:
    """The true slip in each frame, the estimate and its half-width [mm], as in `VirtualLift.slid`.

    The clip's pictures were answered without a scale.
    """
    truth, scale = clip.truth, clip.scene.camera.mm_per_px
    estimated = np.array([(shear.slip, shear.slip_error, shear.slip_since) for shear in shears]).T
    since = np.rint(np.nan_to_num(estimated[2]) * clip.scene.rate).astype(int)
    way = truth.shift - truth.gel_shift
    # counted from a frame before any slip: the slip of the gel's point that has slipped least
    slip = np.where(truth.slip[since] > 0.0, np.linalg.norm(way - way[since], axis=1), truth.slip)
    return np.stack([slip, *(scale * estimated[:2])])


def compute(quick: bool = False, track: Track = iter) -> list[VirtualLift]:
    """Render and answer the lifts."""
    draws = range(QUICK_DRAWS if quick else DRAWS)
    return [answer_lift(*case) for case in track([(s, i) for i in draws for s in (False, True)])]


def tables(result: list[VirtualLift]) -> dict[str, list[dict[str, object]]]:
    """A row for each shape and relief, and the errors of the estimated slip."""
    shapes = {name: [lift for lift in result if lift.shape == name] for name in SHAPES}
    reliefs = {name: [lift for lift in result if lift.relief == name] for name in RELIEFS}
    groups = shapes | reliefs | {"all": result}
    slips = {
        f"{relief}, {'slipped' if slipped else 'held'}": [
            lift for lift in reliefs[relief] if lift.slips == slipped
        ]
        for relief in RELIEFS
        for slipped in (False, True)
    }
    return {
        "": [_row(name, lifts) for name, lifts in groups.items() if lifts],
        "_slips": [_slip_row(name, lifts) for name, lifts in slips.items() if lifts],
    }


def _slip_row(name: str, lifts: list[VirtualLift]) -> dict[str, object]:
    slid = np.concatenate([lift.slid for lift in lifts], axis=1)
    slip, estimated, half = slid[:, np.isfinite(slid[1])]
    off = np.abs(estimated - slip)
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
    return row | {name: round(float(f)) for name, f in zip(SLIP_FIGURES, figures, strict=True)}


def _row(name: str, lifts: list[VirtualLift]) -> dict[str, object]:
    held = [lift for lift in lifts if not lift.slips]
    slipped = [lift for lift in lifts if lift.slips]
    delays = [lift.delay for lift in slipped if lift.delay is not None]
    misdated = [lift.misdated for lift in slipped if lift.misdated is not None]
    return {
        "lifts": name,
        "held": len(held),
        "called slips": sum(lift.called is not None for lift in held),
        "macro slip in some frame": sum(State.MACRO_SLIP in lift.states for lift in held),
        "slipped": len(slipped),
        "called": len(delays),
        f"within {SOON} frames": sum(abs(delay) <= SOON for delay in delays),
        "median delay [frames]": float(np.median(delays)) if delays else None,
        "longest": max(delays, default=None),
        f"dated within {SOON} frames": sum(abs(off) <= SOON for off in misdated),
        "earliest date [frames]": min(misdated, default=None),
        "latest date [frames]": max(misdated, default=None),
    }


def plot(result: list[VirtualLift]) -> Figure:
    """Probability of a slip over the frames; in lifts that slip, frames count from the onset."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 3.6), sharey=True, layout="constrained")
    for lift in result:
        slipped = lift.shears.slip_probability
        frames = np.arange(len(slipped)) - (lift.onset or 0)
        axes[int(lift.slips)].plot(frames, slipped, color="C3" if lift.slips else "C0", lw=0.8)
    for axis, title in zip(axes, ("held", "slipped"), strict=True):
        axis.axhline(0.5, color="0.5", lw=0.8)
        axis.set_title(
            f"{title}: {sum(lift.slips == (title == 'slipped') for lift in result)} lifts"
        )
        axis.set_xlabel("frame" if title == "held" else "frames after nothing sticks")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("probability of a slip")
    return figure
