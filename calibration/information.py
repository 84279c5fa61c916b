"""Accuracy of fitted numbers from the Fisher information of measurements."""

import numpy as np
from jaxtyping import Bool, Float

LARGEST_ERROR = 0.25
"""Standard error of a coordinate above which its number counts as undetermined."""

LARGEST_SHARE = 0.125
"""Standard error over the range between the bounds above which a number is undetermined."""


def invert_information(
    information: Float[np.ndarray, "p p"],
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, " p"]]:
    """Covariance and standard errors from the Fisher information.

    A direction without information adds nothing to the covariance. Every coordinate with a part in
    it gets an infinite error.
    """
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    blind = values <= 1e-12 * max(values[-1], 1.0)
    inverse = np.where(blind, 0.0, 1.0 / np.where(blind, 1.0, values))
    covariance = (vectors * inverse) @ vectors.T / np.outer(scale, scale)
    lost = (np.abs(vectors[:, blind]) > 1e-6).any(axis=1)
    return covariance, np.where(lost, np.inf, np.sqrt(np.diag(covariance)))


def is_determined(
    error: Float[np.ndarray, " p"], span: Float[np.ndarray, " p"]
) -> Bool[np.ndarray, " p"]:
    """Whether a standard error is small enough to report a number."""
    return error <= np.minimum(LARGEST_ERROR, LARGEST_SHARE * span)


def correlate(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """Correlations from a covariance; 0 for numbers without variance."""
    error = np.sqrt(np.diag(covariance))
    error = np.where(error > 0.0, error, 1.0)
    return covariance / np.outer(error, error)
