"""The table of readings of each grasp: rotation, load and reference, with their errors.

On an elastomer of thickness h with markers at the depth z, lifting adds `below` + `thin` + `along`
to the rotation φ that the markers show (`estimation.softness.layered`), and
θ = (1 + k)(φ + below) + k (thin + along) is (1 + k) times the rotation φ + below + thin + along,
less the load thin + along. On a thick one, h → ∞ and z = 0, all three are 0.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from calibration.softness.trials import Trial
from contactmodel import Pad

SEARCH_STEPS = 61
LIFT_SHARE = 0.05
"""Of the rotation that lifting adds: what that may be off by."""


class Layer(NamedTuple):
    """What is known beforehand of the elastomer, and of the object's shape.

    Attributes:
        thickness: h; infinite for a half-space [mm].
        depth: z of the markers [mm].
        thickness_error: standard deviation of h; 0 where it is exact [mm].
        depth_error: the same of z [mm].
        object_radius: R of a ball; infinite for an object with a flat surface [mm].
    """

    thickness: float = float("inf")
    depth: float = 0.0
    thickness_error: float = 0.0
    depth_error: float = 0.0
    object_radius: float = float("inf")

    @property
    def values(self) -> Float[np.ndarray, "2"]:
        """Thickness and depth [mm]."""
        return np.array(self[:2])

    @property
    def errors(self) -> Float[np.ndarray, "2"]:
        """Their standard deviations [mm]."""
        return np.array(self[2:4])

    def at(self, values: Float[np.ndarray, "2"]) -> "Layer":
        """With other values, as far as a layer can have them."""
        thickness = max(float(values[0]), 1e-3)
        depth = float(np.clip(values[1], 0.0, 0.9 * thickness))
        return self._replace(thickness=thickness, depth=depth)


HALF_SPACE = Layer()


def layer_of(pad: Pad, object_radius: float = float("inf")) -> Layer | None:
    """The elastomer of a pad under an object; None for a thick one under a flat object."""
    layer = Layer(pad.thickness or float("inf"), pad.marker_depth or 0.0)
    layer = layer._replace(object_radius=object_radius)
    return None if layer.thickness == layer.object_radius == float("inf") else layer


class Series(NamedTuple):
    """One trial's points, by the reference's readings.

    Attributes:
        time: of the readings, since the trial's first frame [s].
        reference: the object's angle [rad].
        reference_error: standard error of the reading [rad]; NaN where unknown.
        frame_time: of the frames, since the first [s].
        rotation: φ in the frames, as their markers show it [rad].
        rotation_error: standard error of φ [rad].
        search: how far the clocks may be apart [s]; 0 where they are one.
        lifts: what is to be added to it; None on a thick elastomer.
    """

    time: Float[np.ndarray, " readings"]
    reference: Float[np.ndarray, " readings"]
    reference_error: Float[np.ndarray, " readings"]
    frame_time: Float[np.ndarray, " frames"]
    rotation: Float[np.ndarray, " frames"]
    rotation_error: Float[np.ndarray, " frames"]
    search: float
    lifts: "Lifts | None" = None

    def lifted(self, layer: Layer) -> Float[np.ndarray, "3 frames"]:
        """Rotation, load and the rotation's error in the frames, on an elastomer [rad]."""
        if self.lifts is None:
            return np.array([self.rotation, 0.0 * self.rotation, self.rotation_error])
        below, thin, along = self.lifts.turns(layer)
        added = below + thin + along
        error = np.hypot(self.rotation_error, LIFT_SHARE * added)
        return np.array([self.rotation + added, thin + along, error])


class Lifts:
    """What lifting adds to the rotation in the frames of a trial, computed once for each layer."""

    def __init__(self, trial: Trial) -> None:
        """Keep what the markers of the frames showed."""
        self.trial = trial
        self._known: dict[tuple[float, ...], np.ndarray] = {}

    def turns(self, layer: Layer) -> Float[np.ndarray, "3 frames"]:
        """`below`, `thin` and `along` in each frame [rad]."""
        return self._turns(layer.thickness, layer.depth, layer.object_radius)

    def as_seen(self) -> Float[np.ndarray, " frames"]:
        """Rotation that the markers show before they are lifted [rad]."""
        made = self.trial.lifted_for
        if made is None:
            return self.trial.rotation
        below, thin, _ = self._turns(made.thickness, made.depth, made.object_radius)
        return (
            self.trial.rotation - below - made.stiffness_ratio * thin / (1.0 + made.stiffness_ratio)
        )

    def _turns(self, *at: float) -> Float[np.ndarray, "3 frames"]:
        if at not in self._known:
            self._known[at] = np.array([one.turns(*at) for one in self.trial.seen]).T
        return self._known[at]


class Points(NamedTuple):
    """The table of readings that a line is fitted to: all that have a rotation.

    Attributes:
        rotation: φ where the object sticks to the elastomer, lifted [rad].
        load: by which the object turns less than slope · rotation [rad]; 0 on a thick elastomer.
        rate: dφ/dt [rad/s].
        rotation_error: [rad].
        reference: [rad].
        reference_error: [rad]; NaN where unknown.
        trial: number of the trial.
        time: of the frames' clock [s].
    """

    rotation: Float[np.ndarray, " points"]
    load: Float[np.ndarray, " points"]
    rate: Float[np.ndarray, " points"]
    rotation_error: Float[np.ndarray, " points"]
    reference: Float[np.ndarray, " points"]
    reference_error: Float[np.ndarray, " points"]
    trial: Int[np.ndarray, " points"]
    time: Float[np.ndarray, " points"]


def make_series(trial: Trial, clock_search: float) -> Series:
    """A trial's points on the recording's clock, at no more readings than there are frames."""
    reference = trial.reference
    origin = trial.start if reference.same_clock else reference.time[0]
    time, angle, error = reference.time - origin, reference.angle, reference.error
    interval = float(np.median(np.diff(trial.time)))
    if np.median(np.diff(time)) < 0.6 * interval:
        bins = np.floor((time - time[0]) / interval).astype(int)
        known = np.isfinite(angle)
        count = np.bincount(bins[known], minlength=bins.max() + 1)
        full = count > 0
        time, angle, error = (
            np.bincount(bins[known], value[known], minlength=len(count))[full] / count[full]
            for value in (time, angle, error)
        )
    lifts = Lifts(trial)
    return Series(
        time=time,
        reference=angle,
        reference_error=error,
        frame_time=trial.time - trial.start,
        rotation=lifts.as_seen(),
        rotation_error=np.maximum(trial.error, 1e-9),
        search=0.0 if reference.same_clock else clock_search,
        lifts=lifts if trial.seen else None,
    )


def gather_points(
    series: Sequence[Series],
    clock_offsets: Float[np.ndarray, " trials"],
    layer: Layer = HALF_SPACE,
) -> Points:
    """The readings that fall between frames, with the rotation interpolated to them.

    The rotation is interpolated, not the reference: it is the less noisy of the two. Readings in
    gaps of more than three frame intervals have none.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    for number, (one, offset) in enumerate(zip(series, clock_offsets, strict=True)):
        at = one.time - offset
        step = np.diff(one.frame_time)
        left = np.clip(np.searchsorted(one.frame_time, at) - 1, 0, len(step) - 1)
        inside = (at >= one.frame_time[0]) & (at <= one.frame_time[-1])
        inside &= (step[left] <= 3.0 * np.median(step)) & np.isfinite(one.reference)
        rotation, load, error = one.lifted(layer)
        found = (
            np.interp(at, one.frame_time, rotation),
            np.interp(at, one.frame_time, load),
            np.interp(at, one.frame_time, np.gradient(rotation, one.frame_time)),
            np.interp(at, one.frame_time, error),
            one.reference,
            one.reference_error,
            np.full(len(at), number),
            at,
        )
        parts.append(tuple(value[inside] for value in found))
    return Points(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def find_clock_offset(one: Series, layer: Layer = HALF_SPACE) -> float:
    """The clock offset at which a line fits one trial best, by search [s]."""
    if one.search == 0.0:
        return 0.0
    candidates = np.linspace(-one.search, one.search, SEARCH_STEPS)
    most = max(len(gather_points([one], np.array([c]), layer).rotation) for c in candidates)
    best, cost = 0.0, np.inf
    still = one._replace(search=0.0)
    for candidate in candidates:
        points = gather_points([still], np.array([candidate]), layer)
        if len(points.rotation) < 0.6 * most:
            continue
        design = np.stack([points.rotation, np.ones(len(points.rotation))], axis=1)
        turned = points.reference + points.load
        weight = np.ones(len(design))
        residual = weight
        for _ in range(5):  # least absolute deviations
            weighted = weight[:, None] * design
            found = np.linalg.pinv(design.T @ weighted) @ (weighted.T @ turned)
            residual = turned - design @ found
            weight = 1.0 / np.maximum(np.abs(residual), 1e-6)
        if (mean := float(np.abs(residual).mean())) < cost:
            best, cost = float(candidate), mean
    return best
