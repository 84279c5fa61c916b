"""Grasps that slip twice: does the first slip give the limit of the second?

An object is pressed on the gel, dragged until it slips, taken off, and grasped again with another
normal force. The friction measured in the first slip, and the gel's shear in it, each predict the
load of the second slip. Markers and forces are virtual, by the contact model.
"""

from dataclasses import replace
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import Rigid
from contactmodel.pose import Pose, make_path
from contactmodel.solve import solve_path
from estimation.estimators import DEFAULT_METHOD
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout
from estimation.settings import Settings
from estimation.slip.alert import AlertLevel
from estimation.tracking.stream import Answer, Stream
from estimation.virtual.recording import PivotModel, lay_out_markers, see_all
from papers.items import Track
from papers.marker_images.scenes import GRID, PAD, shape_of
from papers.virtual_pivots.few_markers import add_noise

SHAPES = ("sphere", "cylinder", "cube")
LOADS = (0.8, 1.0, 1.2)
"""Normal force of the second grasp over that of the first [-]."""
DEEPER = {"sphere": 2.0 / 3.0, "cylinder": 0.75, "cube": 0.9}
"""Exponent with which the approach grows with the normal force [-]."""
DRAWS, QUICK_DRAWS = 18, 3
UNLOADED, PRESSED, DRAGGED = 8, 13, 26
"""Frames without contact before each grasp, and of its two legs."""
NOISES_MM = (1e-3, 1e-2)
"""In-plane noises of the markers, in turn; 3.5 times as much along z [mm]."""
FORCE_SHARE, FORCE_N = 0.01, 0.02
"""Standard deviations of the forces' errors: a share of each component [-], and a force [N]."""


class Grasp(NamedTuple):
    """Motion of the gel in one grasp."""

    moved: Float[np.ndarray, "frames n 3"]  # displacement of the markers [mm]
    force: Float[np.ndarray, "frames 3"]  # on the gel [N]
    stick: Float[np.ndarray, " frames"]  # share of the contact that sticks [-]
    moment: Float[np.ndarray, " frames"]  # about the sensor's origin [N·mm]


class Case(NamedTuple):
    """Truth and answers of a recording, about its second grasp."""

    shape: str
    load: float  # normal force of the second grasp over that of the first [-]
    slips: bool  # whether the object slips in the second grasp
    friction: float  # coefficient [-]
    before: Bool[np.ndarray, " frames"]  # frames in which the object is dragged, before the slip
    stick: Float[np.ndarray, " frames"]  # share of the contact that sticks [-]
    left: Float[np.ndarray, " frames"]  # time until the second slip [s]; NaN if it does not slip
    found: Float[np.ndarray, "frames 3"]  # estimated coefficient and its interval [-]
    time: Float[np.ndarray, "frames 3"]  # estimated time to slip and its interval [s]
    acts: Bool[np.ndarray, " frames"]  # whether the alert is `act`
    shears: tuple[float, float]  # shear of the gel in both slips [mm]
    depths: tuple[float, float]  # approach in both grasps [mm]


def drag(contact: Contact, approach: float, shift: np.ndarray, layout: MarkerLayout) -> Grasp:
    """Press an object on and drag it along the gel."""
    path = make_path([Pose(0.0), Pose(approach), Pose(approach, shift)], [PRESSED, DRAGGED])
    solved = solve_path(contact, path, rtol=1e-5, sliding=True)
    force, place = np.asarray(solved.force), np.asarray(path.shift)
    return Grasp(
        np.asarray(solved.elastomer_displacement_at(layout.reference[:, :2])),
        force,
        np.asarray(solved.stick).sum(axis=(1, 2)) / np.asarray(solved.contact).sum(axis=(1, 2)),
        np.asarray(solved.moment) + place[:, 0] * force[:, 1] - place[:, 1] * force[:, 0],
    )


def answer_case(draw: int, slips: bool) -> Case:
    """Simulate two grasps of an object, and answer the recording."""
    rng = np.random.default_rng(draw)
    shape, load = SHAPES[draw % 3], LOADS[draw // 3 % 3]
    friction = rng.uniform(0.2, 0.5) if draw // 9 % 2 else rng.uniform(0.5, 1.0)
    indenter, depth = shape_of(shape, rng)
    contact = Contact(PAD, Rigid(), indenter, GRID, friction)
    way = np.exp(1j * rng.uniform(0.0, 2.0 * np.pi))
    model = PivotModel(grid_angle=float(rng.uniform(0.0, 0.5 * np.pi)))
    layout = lay_out_markers(model._replace(offset=tuple(rng.uniform(-0.5, 0.5, 2))))
    depths = depth, depth * load ** DEEPER[shape]
    # on a thick gel, all of the contact slips from a shift of 1.5 µ times the approach on
    shares = rng.uniform(1.3, 1.8), rng.uniform(1.3, 1.8) if slips else 0.5
    grasps = [
        drag(contact, deep, 1.5 * friction * share * deep * np.array([way.real, way.imag]), layout)
        for deep, share in zip(depths, shares, strict=True)
    ]
    free = Grasp(*(np.zeros((UNLOADED, *values.shape[1:])) for values in grasps[0]))
    both = Grasp(*map(np.concatenate, zip(free, grasps[0], free, grasps[1], strict=True)))
    answers = _answer(both, layout, NOISES_MM[draw % 2], rng)
    half = UNLOADED + PRESSED + DRAGGED
    onsets = [
        half * k + UNLOADED + PRESSED + _find_onset(grasp.stick[PRESSED:])
        for k, grasp in enumerate(grasps)
    ]
    rows = np.arange(len(answers))
    shear = [answer.shear.shear for answer in answers]
    return Case(
        shape,
        load,
        slips,
        friction,
        before=(rows >= half + UNLOADED + PRESSED) & (rows < onsets[1]),
        stick=both.stick,
        left=np.where(slips, (onsets[1] - rows) / 30.0, np.nan),
        found=np.array([answer.friction[1:] for answer in answers]),
        time=np.array([_time_of(answer) for answer in answers]),
        acts=np.array([answer.alert.level == AlertLevel.ACT for answer in answers]),
        shears=(np.nanmax(shear[onsets[0] : half]), np.nanmax(shear[half + UNLOADED :])),
        depths=depths,
    )


def _answer(
    grasp: Grasp, layout: MarkerLayout, noise: float, rng: np.random.Generator
) -> list[Answer]:
    """The answers to markers and forces with noise."""
    recording = add_noise(see_all(layout, layout.reference + grasp.moved), noise, rng)
    size = grasp.force.shape
    force = grasp.force * (1.0 + FORCE_SHARE * rng.normal(size=size))
    recording = replace(
        recording,
        force=force + FORCE_N * rng.normal(size=size),
        moment=grasp.moment[:, None] * np.array([0.0, 0.0, 1.0]),
    )
    stream = Stream(recording, Settings(noise=Noise.from_std(noise)))
    answers = {answer.row: answer for answer in stream.answers()}
    return [answers[row] for row in sorted(answers)]


def _time_of(answer: Answer) -> tuple[float, ...]:
    """Time to slip and its interval [s]; NaN in a slip."""
    if answer.alert.level == AlertLevel.SLIPS or DEFAULT_METHOD not in answer.estimates:
        return (np.nan,) * 3
    return tuple(answer.alert[1:])


def _find_onset(stick: Float[np.ndarray, " frames"]) -> int:
    """First frame of a leg in which nothing sticks; the number of frames without one."""
    return int(np.argmax(np.append(stick, 0.0) == 0.0))


def compute(quick: bool = False, track: Track = iter) -> list[Case]:
    """Simulate and answer the recordings."""
    draws = range(QUICK_DRAWS if quick else DRAWS)
    return [answer_case(*case) for case in track([(i, s) for i in draws for s in (True, False)])]


def tables(result: list[Case]) -> dict[str, list[dict[str, object]]]:
    """The limit from the friction of the first slip by shape, and from the gel's shear by load."""
    shapes = {name: [case for case in result if case.shape == name] for name in SHAPES}
    loads = {f"{load}": [case for case in result if case.load == load] for load in LOADS}
    return {
        "": [_friction_row(name, cases) for name, cases in shapes.items() if cases],
        "_shear": [_shear_row(name, cases) for name, cases in loads.items() if cases],
    }


def _friction_row(name: str, cases: list[Case]) -> dict[str, object]:
    late, offs, covers, times, timed, leads, acts = 0, [], [], 0, 0, [], 0
    for case in cases:
        tenth = case.before & (case.stick < 0.9) & np.isfinite(case.found[:, 0])
        offs += list(np.abs(case.found[tenth, 0] / case.friction - 1.0))
        covers += list(
            (case.found[tenth, 1] <= case.friction) & (case.friction <= case.found[tenth, 2])
        )
        if not case.slips:
            acts += int(case.acts[case.before].sum())
            continue
        known = case.before & np.isfinite(case.time[:, 0])
        _, low, high = case.time[known].T
        timed += len(low)
        times += int(((low <= case.left[known]) & (case.left[known] <= high)).sum())
        late += int((low > case.left[known]).sum())
        leads.append(int((case.acts & case.before).sum()))
    return {
        "shape": name,
        "recordings": len(cases),
        "with the coefficient": sum(
            bool(np.isfinite(case.found[case.before, 0]).all()) for case in cases
        ),
        "frames with a tenth slipping": len(offs),
        "largest error [%]": round(100.0 * max(offs), 1) if offs else None,
        "interval covers [%]": round(100.0 * float(np.mean(covers))) if covers else None,
        "frames with a time": timed,
        "its interval covers": times,
        "its low end too late": late,
        "frames of act before the slip": float(np.median(leads)) if leads else None,
        "frames of act in held grasps": acts,
    }


def _shear_row(name: str, cases: list[Case]) -> dict[str, object]:
    slipped = [case for case in cases if case.slips]
    ratio = np.array([case.shears[1] / case.shears[0] for case in slipped])
    scaled = ratio * [case.depths[0] / case.depths[1] for case in slipped]
    return {
        "normal force, second over first": name,
        "recordings": len(slipped),
        "shear at slip, second over first": f"{ratio.min():.2f} to {ratio.max():.2f}",
        "the same over the depth": f"{scaled.min():.2f} to {scaled.max():.2f}",
    }


def plot(result: list[Case]) -> Figure:
    """Time to slip against its truth in the second grasp, with intervals."""
    figure, axis = plt.subplots(figsize=(5.0, 4.0), layout="constrained")
    for case in result:
        known = case.before & np.isfinite(case.time[:, 0]) & case.slips
        middle, low, _ = case.time[known].T
        axis.vlines(case.left[known], low, middle, color=f"C{SHAPES.index(case.shape)}", lw=0.8)
    end = 30.0**-1 * DRAGGED
    axis.plot([0.0, end], [0.0, end], color="0.5", lw=0.8)
    axis.set(xlabel="time to the second slip [s]", ylabel="predicted, and its lower end [s]")
    axis.set_ylim(0.0, 2.0 * end)
    return figure
