"""Error of the contact model at finite strain, with a size that the residuals determine.

[DerSimonian1986] R. DerSimonian, N. Laird, "Meta-analysis in clinical trials": a variance component
from the moment of a weighted sum of squares.

Against finite elements the corrected field is off by smooth functions of the distance r from the
axis, equal all around it. They are modes here: columns of errors of all measurements, whose
coefficients are independent with one standard deviation, the size s. Then

1. s follows from the part of the residuals along the modes, beyond the noise. It is 0 if noise
   explains this part.
2. Each marker and each force is weighted by the variance of noise and modes together. Modes are not
   removed: a fit to the remaining fine structure would be worse than one to the whole field.
3. The covariance is that of this weighted fit under noise and modes, C = G (N + s² U Uᵀ) Gᵀ.

The amplitudes are those of `papers.finite_strain`: errors of u_r are largest, those after a twist
are a share of u_θ.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from calibration.field_problem import find_kinds
from calibration.forward import FieldModel, Prediction

_PRESSED = (0.01, 0.002, 0.005)  # errors of u_r, u_θ and u_z, shares of the largest u_z
_TWISTED = (0.05, 0.02, 0.02)  # the same, shares of the largest u_θ
_RESULTANT = 0.01  # relative error of force and moment
_SHARED = 0.8  # share of the variance of forces that is common to all frames
_LENGTH = 0.35  # correlation length of the errors, in radii of the contact
_FAR = 0.1  # least amplitude far away, relative to the edge of the contact
_ABSORBED = 2.0  # size over its estimate: the numbers absorb part of the error
_NOISE_ALONE_P = 0.05  # p-value above which noise alone explains the part along the modes


class Whitening(NamedTuple):
    """A linear map of residuals in standard deviations of the noise.

    Attributes:
        blocks: matrices for the three displacements of a marker in a frame.
        scale: factors for all other residuals.
    """

    blocks: Float[np.ndarray, "frames n 3 3"]
    scale: Float[np.ndarray, " rest"]

    def apply(self, rows: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "m k"]:
        """The map of some columns; further rows, those of priors, stay."""
        count = 3 * self.blocks.shape[0] * self.blocks.shape[1]
        end = count + len(self.scale)
        fields = rows[:count].reshape(*self.blocks.shape[:3], -1)
        turned = (self.blocks @ fields).reshape(count, -1)
        return np.concatenate([turned, self.scale[:, None] * rows[count:end], rows[end:]])


def whiten_modes(modes: Float[np.ndarray, "m k"], frames: int, markers: int) -> Whitening:
    """The map that gives each marker and each force unit variance under noise and modes.

    Args:
        modes: modes in standard deviations of the noise, times their size.
        frames: number of frames.
        markers: number of markers.
    """
    fields = modes[: 3 * frames * markers].reshape(frames, markers, 3, -1)
    variance = np.eye(3) + fields @ np.swapaxes(fields, -1, -2)
    rest = np.sqrt(1.0 + np.sum(modes[3 * frames * markers :] ** 2, axis=1))
    return Whitening(np.linalg.inv(np.linalg.cholesky(variance)), 1.0 / rest)


def make_modes(
    model: FieldModel, seen: Prediction, centre: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "m k"]:
    """Modes of the model's error at size 1, in the order and units of the outputs.

    Args:
        model: grid and markers.
        seen: measurements that the fitted model predicts.
        centre: the axis [mm].
    """
    away = model.markers - centre
    distance = np.linalg.norm(away, axis=1)
    x, y = (away / np.maximum(distance, 1e-12)[:, None]).T
    none, one = np.zeros_like(x), np.ones_like(x)
    axes = np.array([[x, y, none], [-y, x, none], [none, none, one]])  # polar, Cartesian, n
    polar = np.einsum("pcn,fnc->fpn", axes, seen.displacement)
    largest = np.abs(polar).max(axis=2)  # of each component in each frame
    pressed = np.outer(largest[:, 2], _PRESSED)
    twisted = np.outer(largest[:, 1], _TWISTED) / np.sqrt(2.0)
    each = np.eye(len(largest))[:, :, None]  # one frame at a time
    amplitudes = [pressed, twisted, *(each * twisted)]  # the first two are shared by all frames
    smooth = _smooth(distance / float(seen.radius))
    fields = np.einsum("afp,kn,pcn->fncapk", np.stack(amplitudes), smooth, axes)
    modes = [np.pad(fields.reshape(seen.displacement.size, -1), [(0, 4 * len(each) + 3), (0, 0)])]
    kinds = find_kinds(model)
    every = [seen.displacement, seen.force, seen.moment, np.zeros(3)]
    values = np.concatenate([np.ravel(part) for part in every])
    for kind in ("force", "moment"):
        error = _RESULTANT * np.where(kinds[kind], values, 0.0)
        modes += [np.sqrt(_SHARED) * error[:, None], np.sqrt(1.0 - _SHARED) * _each(error)]
    together = np.concatenate(modes, axis=1)
    return together[:, np.any(together != 0.0, axis=0)]


def _each(error: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m k"]:
    """A column for each error that is not 0."""
    rows = np.flatnonzero(error)
    columns = np.zeros((len(error), len(rows)))
    columns[rows, np.arange(len(rows))] = error[rows]
    return columns


def _smooth(ratio: Float[np.ndarray, " n"]) -> Float[np.ndarray, "k n"]:
    """Smooth functions of r/a whose squares sum to the variance: (r/a)² inside, (a/r)⁴ outside."""
    knots = np.linspace(0.0, 1.01 * ratio.max(), 50)

    def kernel(at: np.ndarray) -> np.ndarray:
        return np.exp(-0.5 * ((at[:, None] - knots) / _LENGTH) ** 2)

    values, vectors = np.linalg.eigh(kernel(knots))
    kept = values > 1e-3 * values[-1]
    inside = ratio < 1.0
    size = np.maximum(np.where(inside, ratio, np.where(inside, 1.0, ratio) ** -2), _FAR)
    return ((kernel(ratio) @ vectors[:, kept]) / np.sqrt(values[kept]) * size[:, None]).T


def estimate_size(
    residual: Float[np.ndarray, " m"],
    jacobian: Float[np.ndarray, "m p"],
    modes: Float[np.ndarray, "m k"],
    whitening: Whitening | None,
) -> float:
    """Size of the modes, by [DerSimonian1986]; 0 if noise explains the residuals along them.

    Args:
        residual: residuals of a fit, then those of priors, in standard deviations.
        jacobian: their derivatives.
        modes: modes in standard deviations of the noise, 0 for priors.
        whitening: map that the residuals contain; None for noise alone, which is then tested.
    """
    seen = modes if whitening is None else whitening.apply(modes)
    space, _ = np.linalg.qr(jacobian)

    def without_numbers(columns: np.ndarray) -> np.ndarray:
        return columns - space @ (space.T @ columns)

    left = without_numbers(seen)
    basis, strength, _ = np.linalg.svd(left, full_matrices=False)
    basis = basis[:, strength > 1e-3 * strength[0]]
    square = float(np.sum((basis.T @ without_numbers(residual)) ** 2))
    noise = float(basis.shape[1])
    if whitening is None and chi2.sf(square, noise) >= _NOISE_ALONE_P:
        return 0.0
    if whitening is not None:
        turned = Whitening(np.swapaxes(whitening.blocks, -1, -2), whitening.scale)
        noise = float(np.sum(turned.apply(basis) ** 2))
    return _ABSORBED * float(np.sqrt(max(square - noise, 0.0) / np.sum((basis.T @ left) ** 2)))


def widen(
    covariance: Float[np.ndarray, "p p"],
    jacobian: Float[np.ndarray, "m p"],
    modes: Float[np.ndarray, "m k"],
    whitening: Whitening,
) -> Float[np.ndarray, "p p"]:
    """Covariance of a weighted fit under noise and modes.

    Args:
        covariance: inverse of JᵀJ.
        jacobian: J, derivatives of the whitened residuals.
        modes: modes in standard deviations of the noise, times their size; 0 for priors.
        whitening: map that the residuals contain.
    """
    gain = covariance @ jacobian.T
    turned = Whitening(np.swapaxes(whitening.blocks, -1, -2), whitening.scale)
    noise = turned.apply(gain.T)
    error = gain @ whitening.apply(modes)
    return noise.T @ noise + error @ error.T


def share_of(
    modes: Float[np.ndarray, "rows k"],
    weights: Float[np.ndarray, " m"],
    moved: Float[np.ndarray, "..."],
) -> float:
    """Root mean square of the modes' displacements, over that of the predicted ones [-].

    Args:
        modes: modes in standard deviations of the noise, times their size.
        weights: inverse standard deviations of the noise, 0 for missing values.
        moved: predicted displacements, the first of all outputs [mm].
    """
    measured = weights[: moved.size] > 0.0
    error = np.sum(modes[: moved.size][measured] ** 2, axis=1)
    square = np.sum(error / weights[: moved.size][measured] ** 2)
    return float(np.sqrt(square / np.sum(np.ravel(moved)[measured] ** 2)))
