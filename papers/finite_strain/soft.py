"""Soft objects at finite strain: the angle with k known, and with k fitted on a smaller grasp.

The finite elements of both `two_bodies` give the motion of the gels (`grasps`). 20 × 20 markers of
1 mm pitch are placed on them, with noise of 1 µm, 3.5 µm along z. The angle is estimated without a
correction, with the number k, with `LayeredSoftness`, and with the object's shape as well. A frame
counts while ten markers or more have always stuck.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from calibration.softness.layered import Grasp, fit_layered_softness
from calibration.softness.readings import Layer
from calibration.softness.references import Reference
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording
from estimation.softness import LayeredSoftness, ScalarSoftness, Softness
from estimation.softness.bar import radius_of_square
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, lay_out_markers
from papers.finite_strain import grasps as stored
from papers.items import Track
from papers.tables import cell as number
from papers.tables import finish

WAYS = ("none", "number k", "layered", "shape")

NOISE_MM = 1e-3
FIRM = 10
SHARES, FLOOR_DEG = {"known": 0.015, "fitted": 0.02}, 0.1
"""Largest allowed error: a share of the angle [-], or an angle [deg], whichever is larger."""

REFERENCE_ERROR, MODEL_ERROR = 1e-3, 5e-3
"""Errors given to the fit: of the reference angle [rad], and of the models over the angle [-]."""

_UNLOADED, _HELD = 10, 12  # frames before the contact, and under full load before the turn
_STEP_DEG = 0.5  # turn between frames
# recordings of a grasp, with markers in other places and other noise: of a ball, and of the others
_DRAWS, _FEWER_DRAWS = 4, 2


class Seen(NamedTuple):
    """A recording of a grasp, the object's angle [rad], and the frames that count."""

    recording: Recording
    angle: Float[np.ndarray, " frames"]
    firm: Bool[np.ndarray, " frames"]


class Errors(NamedTuple):
    """Errors of the angle in the frames that count.

    Attributes:
        mean: mean error over the angle [-].
        largest: largest error over the angle, absolute [-].
        within: share of frames within the allowed error [-].
        held: share of 95 % intervals that hold the angle [-].
        half: mean half-width of the intervals over the angle [-].
    """

    mean: float
    largest: float
    within: float
    held: float
    half: float


class Cell(NamedTuple):
    """A grasp, with k known, or fitted on the object's smallest grasp.

    Attributes:
        name: name of the object.
        one: the object.
        contact_mm: radius of the contact [mm].
        knowledge: "known" or "fitted".
        found: k by way; the mean of the draws [-].
        errors: errors by way, of all draws with a k together.
        frames: number of frames that count.
        refused: number of draws in which the fit with the shape is refused.
    """

    name: str
    one: stored.Object
    contact_mm: float
    knowledge: str
    found: dict[str, float]
    errors: dict[str, Errors]
    frames: int
    refused: int = 0


def compute(quick: bool = False, track: Track = iter) -> list[Cell]:
    """Test all objects, in about twenty minutes; the quick size is one ball and one draw."""
    if quick:
        return _test("soft", 1)
    return [cell for name in track(list(stored.OBJECTS)) for cell in _test(name, draws_of(name))]


def draws_of(name: str) -> int:
    """Number of recordings of each grasp of an object."""
    return _DRAWS if name in stored.BALLS else _FEWER_DRAWS


def _test(name: str, draws: int) -> list[Cell]:
    one, grasps = stored.OBJECTS[name], stored.read_grasps()[name]
    seen = [[see(grasp, draw) for draw in range(draws)] for grasp in grasps]
    known = {way: [make_softness(one, way)] * draws for way in WAYS}
    cells = [_compare(name, grasp, here, "known", known)
             for grasp, here in zip(grasps, seen, strict=True)]  # fmt: skip
    if len(grasps) == 1:
        return cells
    fitted = {way: [_fit(one, first, way) for first in seen[0]] for way in WAYS}
    larger = zip(grasps[1:], seen[1:], strict=True)
    return cells + [_compare(name, grasp, here, "fitted", fitted) for grasp, here in larger]


def see(grasp: stored.Grasp, draw: int) -> Seen:
    """A recording of a grasp: unloaded, held under full load, and turned.

    Args:
        grasp: the solved grasp.
        draw: seed of the markers' place and noise.
    """
    rng, surface = np.random.default_rng(draw), grasp.surface
    x, y = rng.uniform(-0.5, 0.5, 2).tolist()
    layout = lay_out_markers(PivotModel(offset=(x, y), grid_angle=float(rng.uniform(0, np.pi / 2))))
    moved, stick = grasp.move(layout.reference)
    steps = np.arange(0.0, np.degrees(surface.twist[-1]) + 1e-9, _STEP_DEG)
    place = np.interp(np.radians(steps), surface.twist, np.arange(len(surface.twist)))
    before = np.minimum(place.astype(int), len(moved) - 2)
    share = (place - before)[:, None, None]
    turned = (1.0 - share) * moved[before] + share * moved[before + 1]
    shape = layout.reference.shape
    held = np.repeat(moved[:1], _HELD, axis=0)
    displaced = np.concatenate([np.zeros((_UNLOADED, *shape)), held, turned])
    count = len(displaced)
    noise = rng.normal(size=displaced.shape) * np.array([1.0, 1.0, 3.5]) * NOISE_MM
    recording = Recording(
        layout=layout,
        positions=layout.reference + displaced + noise,
        valid=np.ones((count, len(layout.reference)), dtype=bool),
        time=np.arange(count) / 30.0,
        source_index=np.arange(count),
        source="finite elements",
    )
    sticking = np.logical_and.accumulate(stick[1:], axis=0).sum(axis=1)
    firm = (sticking[before] >= FIRM) & (steps > 0.9)
    angle = np.concatenate([np.full(_UNLOADED, np.nan), np.zeros(_HELD), np.radians(steps)])
    return Seen(recording, angle, np.append(np.zeros(_UNLOADED + _HELD, dtype=bool), firm))


def make_softness(one: stored.Object, way: str) -> Softness:
    """The softness of an object with k known.

    Args:
        one: the object.
        way: one of `WAYS`.
    """
    if way == "none":
        return ScalarSoftness()
    if way == "number k":
        return ScalarSoftness(one.ratio)
    known = LayeredSoftness(one.ratio, one.thickness_mm)
    return replace(known, **shape_of(one)) if way == "shape" else known


def shape_of(one: stored.Object) -> dict[str, float]:
    """The object's shape as arguments of `LayeredSoftness`.

    Args:
        one: the object; a side of 20 mm or more is that of a plate, and a square bar is a cylinder
            that twists like it.
    """
    known = {} if one.flat else {"object_radius": one.radius_mm}
    if one.height_mm is not None:
        known["object_height"] = one.height_mm
    if one.side_mm is not None and one.side_mm < 20.0:
        known["object_side"] = radius_of_square(2.0 * one.side_mm) if one.square else one.side_mm
        if one.flat and not one.square:
            known["object_edge"] = one.radius_mm
    return known


def _fit(one: stored.Object, seen: Seen, way: str) -> Softness | None:
    """Fit k to a grasp with the model of a way; None if the grasp cannot determine it."""
    if way == "none":
        return ScalarSoftness()
    error = np.hypot(REFERENCE_ERROR, MODEL_ERROR * seen.angle)
    truth = Reference(seen.recording.time, seen.angle, error, True, True, "truth")
    layer = Layer(np.inf if way == "number k" else one.thickness_mm)
    layer = layer._replace(**shape_of(one)) if way == "shape" else layer
    grasp = Grasp(seen.recording, truth, Noise.from_std(NOISE_MM))
    try:
        softness = fit_layered_softness([grasp], layer).softness
    except ValueError:
        return None
    return replace(softness, validity=type(softness.validity)())  # larger grasps are asked for


def _compare(
    name: str,
    grasp: stored.Grasp,
    seen: list[Seen],
    knowledge: str,
    softness: Mapping[str, Sequence[Softness | None]],
) -> Cell:
    ratios = {way: [one.stiffness_ratio for one in softness[way] if one] for way in WAYS}
    found = {way: float(np.mean(ratios[way])) if ratios[way] else np.nan for way in WAYS}
    errors = {way: measure(seen, softness[way], SHARES[knowledge]) for way in WAYS}
    pairs = list(zip(seen, softness["shape"], strict=True))
    frames = sum(int(here.firm.sum()) for here, one in pairs if one)
    refused = sum(one is None for _, one in pairs)
    one = stored.OBJECTS[name]
    return Cell(name, one, grasp.contact_mm, knowledge, found, errors, frames, refused)


def measure(seen: Sequence[Seen], softness: Sequence[Softness | None], share: float) -> Errors:
    """Errors of all draws; a missing answer counts as an error of the full angle.

    Args:
        seen: recordings of a grasp.
        softness: the softness to use for each; recordings without one do not count.
        share: largest allowed error over the angle [-].
    """
    columns = []
    for here, one in zip(seen, softness, strict=True):
        if one is None:
            continue
        noise = Noise.from_std(NOISE_MM)
        result = estimate_angles(here.recording, "incremental", noise=noise, softness=one)
        columns.append(
            [part[here.firm] for part in (here.angle, result.angle, result.low, result.high)]
        )
    if not columns:
        return Errors(*[np.nan] * 5)
    truth, angle, low, high = (np.concatenate(column) for column in zip(*columns, strict=True))
    error = np.nan_to_num(angle) - truth
    return Errors(
        mean=float(np.mean(error / truth)),
        largest=float(np.max(np.abs(error) / truth)),
        within=float(np.mean(np.abs(error) <= np.maximum(share * truth, np.radians(FLOOR_DEG)))),
        held=float(np.mean((low <= truth) & (truth <= high))),
        half=float(np.nanmean(0.5 * (high - low) / truth)),
    )


def tables(result: list[Cell]) -> dict[str, list[dict[str, object]]]:
    """A row for each grasp and knowledge of k."""
    return {
        "": [
            {
                "object": cell.name,
                "R [mm]": "flat" if cell.one.flat else cell.one.radius_mm,
                "H [mm]": cell.one.height_mm or "",
                "W [mm]": _show_side(cell.one),
                "E [mm]": cell.one.radius_mm if cell.one.flat else "",
                "held out": cell.one.held_out,
                "h [mm]": cell.one.thickness_mm,
                "k": cell.one.ratio,
                "ν": cell.one.poisson_ratio,
                "a [mm]": round(cell.contact_mm, 1),
                "k is": cell.knowledge,
                "k, shape": number(cell.found["shape"], 3),
                **{f"mean, {way} [%]": number(100 * cell.errors[way].mean, 2) for way in WAYS},
                **{
                    f"{title}, shape [%]": number(100 * value, digits)
                    for title, value, digits in zip(
                        ("largest", "within", "interval holds", "half interval"),
                        cell.errors["shape"][1:],
                        (2, 0, 0, 2),
                        strict=True,
                    )
                },
                "within, layered [%]": number(100 * cell.errors["layered"].within, 0),
                "frames": cell.frames,
                "draws without k": cell.refused,
            }
            for cell in result
        ]
    }


def _show_side(one: stored.Object) -> float | str:
    """Radius of the side, or the width of a square bar [mm]."""
    if one.square and one.side_mm is not None:
        return f"square, {2.0 * one.side_mm:g}"
    return one.side_mm or ""


def plot(result: list[Cell]) -> Figure:
    """Mean error over the contact's radius: with k known, and fitted on the smallest grasp."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained", sharey=True)
    for knowledge, axis in zip(SHARES, axes, strict=True):
        chosen = [cell for cell in result if cell.knowledge == knowledge]
        reach = [cell.contact_mm for cell in chosen]
        for i, way in enumerate(WAYS[1:]):
            error = [100.0 * cell.errors[way].mean for cell in chosen]
            axis.plot(reach, error, "o", color=f"C{i}", label=way)
        allowed = 100.0 * SHARES[knowledge]
        axis.axhspan(-allowed, allowed, color="0.9", zorder=0)
        title = f"k {knowledge}; grey: allowed"
        finish(axis, title=title, xlabel="radius of the contact [mm]")
    axes[0].set_ylabel("mean error of the angle [%]")
    axes[0].legend(fontsize=8)
    return figure
