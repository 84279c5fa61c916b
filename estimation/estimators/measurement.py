"""An estimator's measurement of one frame, before the correction for softness."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

Z95 = 1.959964
"""Half-width of a 95 % interval in standard errors."""


class StickDisc(NamedTuple):
    """The disc that sticks under an object that has turned one way; NaN where unknown.

    Attributes:
        ratio: its radius over that of the contact, c/a [-].
        error: standard error of the ratio [-].
        twist: rotation at which the contact holds this disc on first loading [rad].
    """

    ratio: float = np.nan
    error: float = np.nan
    twist: float = np.nan


class Measurement(NamedTuple):
    """Rotation of the sticking part of the elastomer's surface.

    Attributes:
        angle: φ [rad]; NaN if no marker sticks.
        low: lower end of the 95 % interval [rad].
        high: upper end of the 95 % interval [rad].
        stick: the markers that stick.
        reason: reason for a missing angle; empty if too few markers stick.
        restarts: number of times that the count of the angle was restarted, in a frame in which the
            angle was unknown, since the object touched; 0 while it counts from the unloaded shape.
        slides: whether the law of friction shows that fewer than three markers stick.
        disc: the disc that sticks, by the law of friction.
        body: the markers that have moved as one body lately, while the angle is lost; None if there
            are none.
    """

    angle: float
    low: float
    high: float
    stick: Bool[np.ndarray, " n"]
    reason: str = ""
    restarts: int = 0
    slides: bool = False
    disc: StickDisc = StickDisc()
    body: Bool[np.ndarray, " n"] | None = None

    @property
    def alike(self) -> Bool[np.ndarray, " n"]:
        """The markers that stick, or those that have moved as one body lately."""
        return self.stick if self.body is None else self.body

    def shift(self, turn: float) -> "Measurement":
        """The measurement of an object that has turned further [rad]."""
        return self._replace(angle=self.angle + turn, low=self.low + turn, high=self.high + turn)

    @classmethod
    def none(
        cls, stick: Bool[np.ndarray, " n"], reason: str = "", restarts: int = 0
    ) -> "Measurement":
        """A measurement without an angle; an empty reason means that too few markers stick."""
        return cls(np.nan, np.nan, np.nan, stick, reason, restarts)


def clustered_covariance(
    jacobian: Float[np.ndarray, "values parameters"],
    residual: Float[np.ndarray, " values"],
    lag: int,
) -> Float[np.ndarray, "parameters parameters"]:
    """Covariance of least squares with correlated residuals.

    It comes from the scatter of tenths of the values. It is at least that of residuals constant
    over `lag` values, since a tenth with most of the motion would hide their correlation.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    tenths = np.array_split(jacobian * residual[:, None], 10)
    scores = np.stack([tenth.sum(axis=0) for tenth in tenths])
    covariance = inverse @ (scores.T @ scores * 10 / 9) @ inverse
    least = lag * np.mean(residual**2) * np.diag(inverse)
    return covariance * np.max(least / np.maximum(np.diag(covariance), 1e-30), initial=1.0)
