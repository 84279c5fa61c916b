"""Published slip warnings: signals that predict the loss of grip, without an angle.

[Yuan2015] W. Yuan, R. Li, M. A. Srinivasan, E. H. Adelson, "Measurement of Shear and Slip with a
GelSight Tactile Sensor".
[Ito2011] Y. Ito, Y. Kim, G. Obinata, "Robust Slippage Degree Estimation Based on Reference Update
of Vision-Based Tactile Sensor".
[Dong2017] S. Dong, W. Yuan, E. H. Adelson, "Improved GelSight Tactile Sensor for Measuring Geometry
and Slip".

All of them were made for shear, where markers that stick move alike. In a twist they do not:
displacement grows with the distance from the axis, even without slip. `turning_ratio` is the stick
ratio with rotations of markers instead of displacements.

The signals follow the papers. Their constants (ten bins, the share of 80 %, the bounds, the least
motion) are our choices and could not be checked against the papers.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.measure import Fields, measure_fields
from estimation.fields.stencils import Stencils, make_stencils
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.recording import Recording


class SlipWarning(NamedTuple):
    """A slip warning over a recording.

    Attributes:
        signal: signal of each frame [-]; NaN without contact or with too little motion.
        warned: frames in which the signal exceeds its bound.
    """

    signal: Float[np.ndarray, " frames"]
    warned: Bool[np.ndarray, " frames"]


def warn_by_entropy(recording: Recording, *, bound: float = 0.8) -> SlipWarning:
    """Entropy of the histogram of tangential displacements, [Yuan2015].

    The histogram has ten bins from 0 to the largest displacement of the contact. The entropy is
    divided by its largest value, log 10.

    Args:
        recording: the recording.
        bound: entropy above which a warning is given [-].
    """
    return _warn(recording, _entropy, lambda signal: signal > bound)


def warn_by_stick_ratio(recording: Recording, *, bound: float = 0.5) -> SlipWarning:
    """Share of the contact's markers that move with the largest motion, [Ito2011], [Dong2017].

    These are the markers with at least 80 % of the largest tangential displacement.

    Args:
        recording: the recording.
        bound: ratio below which a warning is given [-].
    """
    return _warn(recording, _stick_ratio, lambda signal: signal < bound)


def warn_by_turning_ratio(recording: Recording, *, bound: float = 0.5) -> SlipWarning:
    """Stick ratio of a twist: share of markers with at least 80 % of the largest rotation.

    The largest rotation is the 90th percentile of φ over the contact, to exclude noise.

    Args:
        recording: the recording.
        bound: ratio below which a warning is given [-].
    """
    return _warn(recording, _turning_ratio, lambda signal: signal < bound)


SLIP_WARNINGS: dict[str, Callable[[Recording], SlipWarning]] = {
    "entropy": warn_by_entropy,
    "stick_ratio": warn_by_stick_ratio,
    "turning_ratio": warn_by_turning_ratio,
}
"""Slip warnings by name."""


def _warn(
    recording: Recording,
    measure: Callable[[Stencils, Fields], float],
    is_beyond: Callable[[np.ndarray], np.ndarray],
) -> SlipWarning:
    stencils = make_stencils(recording.layout)
    signal = np.full(len(recording), np.nan)
    for i, frame in enumerate(recording):
        if frame.flaw:
            continue
        fields = measure_fields(stencils, frame)
        if fields.contact.sum() >= MIN_STICK_MARKERS:
            signal[i] = measure(stencils, fields)
    with np.errstate(invalid="ignore"):
        return SlipWarning(signal, is_beyond(signal))


def _tangential(stencils: Stencils, fields: Fields) -> Float[np.ndarray, " m"] | None:
    """Size of the contact's displacements along the surface [mm]; None if all are small."""
    least_motion = 0.05  # largest displacement below which there is no warning [mm]
    normals = stencils.normals[fields.contact]
    along = fields.displacement[fields.contact]
    along = along - np.sum(along * normals, axis=1, keepdims=True) * normals
    moved = np.linalg.norm(along, axis=1)
    return None if moved.max() < least_motion else moved


def _entropy(stencils: Stencils, fields: Fields) -> float:
    entropy_bins = 10
    moved = _tangential(stencils, fields)
    if moved is None:
        return np.nan
    share = np.histogram(moved, entropy_bins, (0.0, moved.max()))[0] / len(moved)
    return float(-np.sum(share * np.log(np.maximum(share, 1e-30))) / np.log(entropy_bins))


def _stick_ratio(stencils: Stencils, fields: Fields) -> float:
    moved = _tangential(stencils, fields)
    if moved is None:
        return np.nan
    return _near_largest(moved, moved.max())


def _turning_ratio(stencils: Stencils, fields: Fields) -> float:
    least_rotation_deg = 1.0
    turned = np.abs(fields.rotation[fields.contact])
    largest = np.percentile(turned, 90)
    if largest < np.radians(least_rotation_deg):
        return np.nan
    return _near_largest(turned, largest)


def _near_largest(values: Float[np.ndarray, " m"], largest: float) -> float:
    """Share of the markers whose value is near the largest: these count as sticking [-]."""
    near = 0.8  # of the largest value, from which on a marker sticks [-]
    return float(np.mean(values >= near * largest))
