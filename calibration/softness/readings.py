"""The table of readings of each grasp: rotation, load and reference, with their errors.

For an elastomer of thickness h with markers at the depth z, lifting adds `below` + `thin` + `along`
to the markers' rotation φ (`estimation.softness.layered`). Then
θ = (1 + k)(φ + below) + k (thin + along) equals (1 + k) times the rotation
φ + below + thin + along, minus the load thin + along. For a thick elastomer, h → ∞ and z = 0, all
three are 0.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicHermiteSpline

from calibration.softness.trials import Trial
from contactmodel import Pad
from estimation.softness.lifting import Sizes

LIFT_SHARE = 0.05
"""Relative error of the rotation that lifting adds."""

_SHARES = [(0, -0.5, 1, -0.5), (1, 0, -2.5, 1.5), (0, 0.5, 2, -1.5), (0, 0, -0.5, 0.5)]
_VARIANCE = sum((Polynomial(share) ** 2 for share in _SHARES), Polynomial([0.0]))
"""Variance of a rotation between two frames over that of a frame, by its place between them from 0
to 1: the squared shares of the four nearest frames, with independent errors, in a cubic curve."""


class Layer(NamedTuple):
    """Prior knowledge of the elastomer and of the object's shape.

    Attributes:
        thickness: h; infinite for a half-space [mm].
        depth: depth z of the markers [mm].
        thickness_error: standard deviation of h; 0 if it is exact [mm].
        depth_error: standard deviation of z; 0 if it is exact [mm].
        object_radius: radius R of a ball or round tip; infinite for a flat surface [mm].
        object_height: H from the contact to the grip; infinite if far [mm].
        object_side: radius of a cylinder's side; infinite for a plate [mm].
        object_edge: radius of the edge between a cylinder's flat face and its side [mm].
    """

    thickness: float = float("inf")
    depth: float = 0.0
    thickness_error: float = 0.0
    depth_error: float = 0.0
    object_radius: float = float("inf")
    object_height: float = float("inf")
    object_side: float = float("inf")
    object_edge: float = 0.0

    @property
    def lengths(self) -> dict[str, Any]:
        """Lengths of elastomer and object, by their names in `LayeredSoftness` [mm]."""
        return {n: length for n, length in self._asdict().items() if not n.endswith("_error")}

    @property
    def sizes(self) -> Sizes:
        """Lengths of elastomer and object for the lifting."""
        return Sizes(*self[:2], *self[4:])

    @property
    def values(self) -> Float[np.ndarray, "2"]:
        """Thickness and depth [mm]."""
        return np.array(self[:2])

    @property
    def errors(self) -> Float[np.ndarray, "2"]:
        """Standard deviations of thickness and depth [mm]."""
        return np.array(self[2:4])

    def at(self, values: Float[np.ndarray, "2"]) -> "Layer":
        """The layer with another thickness and depth, limited to possible values [mm]."""
        thickness = max(float(values[0]), 1e-3)
        depth = float(np.clip(values[1], 0.0, 0.9 * thickness))
        return self._replace(thickness=thickness, depth=depth)


HALF_SPACE = Layer()


def layer_of(pad: Pad, shape: tuple[float, float, float, float] = HALF_SPACE[4:]) -> Layer | None:
    """The elastomer of a pad under an object; None for a thick pad under a flat object.

    A thick pad with markers below its surface is an elastomer too, of infinite thickness.

    Args:
        pad: pad of a sensor.
        shape: radius, height and side of the object, each infinite if it has none, and radius of
            its edge [mm].
    """
    layer = Layer(pad.thickness or float("inf"), pad.marker_depth or 0.0, 0.0, 0.0, *shape)
    flat = layer.thickness == min(shape[:3]) == float("inf")
    return None if flat and layer.depth == 0.0 else layer


class Series(NamedTuple):
    """Reference readings and frames of one trial."""

    time: Float[np.ndarray, " readings"]  # times of the readings since the trial's first frame [s]
    reference: Float[np.ndarray, " readings"]  # angle of the object [rad]
    # standard error of a reading [rad]; NaN if unknown
    reference_error: Float[np.ndarray, " readings"]
    frame_time: Float[np.ndarray, " frames"]  # times of the frames since the first frame [s]
    rotation: Float[np.ndarray, " frames"]  # φ of the markers in the frames, without lifting [rad]
    rotation_error: Float[np.ndarray, " frames"]  # standard error of φ [rad]
    search: float  # largest offset between the clocks [s]; 0 if they are one
    lifts: "Lifts | None" = None  # rotation that lifting adds; None for a thick elastomer

    def lifted(self, layer: Layer) -> Float[np.ndarray, "3 frames"]:
        """Lifted rotation, load and the rotation's error in the frames, for an elastomer [rad]."""
        if self.lifts is None:
            return np.array([self.rotation, 0.0 * self.rotation, self.rotation_error])
        below, thin, along, *_ = self.lifts.turns(layer)
        added = below + thin + along
        error = np.hypot(self.rotation_error, LIFT_SHARE * added)
        return np.array([self.rotation + added, thin + along, error])


class Lifts:
    """Rotation that lifting adds in the frames of a trial, computed once for each layer."""

    def __init__(self, trial: Trial) -> None:
        """Store the trial."""
        self.trial = trial
        self._turns_by_layer: dict[Sizes, np.ndarray] = {}

    def turns(self, layer: Layer) -> Float[np.ndarray, "5 frames"]:
        """The parts of `Added` in each frame [rad]."""
        guess = self.trial.lifted_for
        k = 1.0 if guess is None else guess.stiffness_ratio
        return self._turns(layer.sizes._replace(stiffness_ratio=k))

    def as_seen(self) -> Float[np.ndarray, " frames"]:
        """Rotation of the markers before lifting [rad]."""
        guess = self.trial.lifted_for
        if guess is None:
            return self.trial.rotation
        k = guess.stiffness_ratio
        below, thin, *_ = self._turns(guess.sizes)
        return self.trial.rotation - below - k * thin / (1.0 + k)

    def _turns(self, sizes: Sizes) -> Float[np.ndarray, "5 frames"]:
        if sizes not in self._turns_by_layer:
            self._turns_by_layer[sizes] = np.array(
                [seen.turns(sizes) for seen in self.trial.displacements]
            ).T
        return self._turns_by_layer[sizes]


class Points(NamedTuple):
    """The table of readings that a line is fitted to: all readings with a rotation.

    Attributes:
        rotation: lifted rotation φ where the object sticks to the elastomer [rad].
        load: angle by which the object turns less than slope · rotation [rad]; 0 for a thick
            elastomer.
        rate: dφ/dt [rad/s].
        rotation_error: standard error of φ [rad].
        variance_rate: d(rotation_error²)/dt [rad²/s].
        reference: angle of the object [rad].
        reference_error: standard error of a reading [rad]; NaN if unknown.
        trial: number of the trial.
        time: time on the frames' clock [s].
    """

    rotation: Float[np.ndarray, " points"]
    load: Float[np.ndarray, " points"]
    rate: Float[np.ndarray, " points"]
    rotation_error: Float[np.ndarray, " points"]
    variance_rate: Float[np.ndarray, " points"]
    reference: Float[np.ndarray, " points"]
    reference_error: Float[np.ndarray, " points"]
    trial: Int[np.ndarray, " points"]
    time: Float[np.ndarray, " points"]


def make_series(trial: Trial, clock_search: float) -> Series:
    """Readings of a trial on the recording's clock; dense readings are averaged per frame interval.

    Args:
        trial: trial with its reference.
        clock_search: largest offset between two clocks [s].
    """
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
        lifts=lifts if trial.displacements else None,
    )


def gather_points(
    series: Sequence[Series],
    clock_offsets: Float[np.ndarray, " trials"],
    layer: Layer = HALF_SPACE,
) -> Points:
    """Readings between frames, with the rotation interpolated to their times by a cubic curve.

    The rotation is interpolated because it is less noisy than the reference. Readings in gaps of
    more than three frame intervals are left out. Between two frames the rotation's error is smaller
    than in them, so a clock offset by half a frame would seem to fit better: the rate of the
    variance corrects the fit for this.

    Args:
        series: readings and frames of the trials.
        clock_offsets: the reference's clock minus the recording's, by trial [s].
        layer: the elastomer.
    """
    parts: list[tuple[np.ndarray, ...]] = []
    for number, (trial, offset) in enumerate(zip(series, clock_offsets, strict=True)):
        at = trial.time - offset
        step = np.diff(trial.frame_time)
        before = np.clip(np.searchsorted(trial.frame_time, at) - 1, 0, len(step) - 1)
        inside = (at >= trial.frame_time[0]) & (at <= trial.frame_time[-1])
        inside &= (step[before] <= 3.0 * np.median(step)) & np.isfinite(trial.reference)
        rotation, load, error = trial.lifted(layer)
        rate = np.gradient(rotation, trial.frame_time)
        curve = CubicHermiteSpline(trial.frame_time, rotation, rate)
        part = (at - trial.frame_time[before]) / step[before]
        squared = np.interp(at, trial.frame_time, error) ** 2
        columns = (
            curve(at),
            np.interp(at, trial.frame_time, load),
            curve(at, 1),
            np.sqrt(squared * _VARIANCE(part)),
            squared * _VARIANCE.deriv()(part) / step[before],
            trial.reference,
            trial.reference_error,
            np.full(len(at), number),
            at,
        )
        parts.append(tuple(column[inside] for column in columns))
    return Points(*(np.concatenate(column) for column in zip(*parts, strict=True)))
