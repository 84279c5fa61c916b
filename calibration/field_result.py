"""Measured fields and what a fit to them found, whether the model describes them, in sentences.

A model whose χ² is too large is wrong in a way that its residuals show only in part: the rest has
gone into the numbers, and how much that is the data do not tell. So no intervals are given then.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from calibration.forward import Prediction

FRICTION = "friction_coefficient"

LEAST_SLIP = 1.5
"""Width of the ring that slips, in cells, below which the cells and not μ tell what slips.

Fitted on cells twice as large as those of the field, μ is off by 40 % at half a cell, within its
interval of 5 % at one, within 0.3 % at seven.
"""

LEAST_P = 1e-3
"""Of the test of χ², below which the model does not describe the data."""


class FieldData(NamedTuple):
    """What was measured; NaN where it was not.

    Attributes:
        displacement: of the markers, frame by frame [mm].
        displacement_error: standard deviation along x, y, z [mm].
        force: of the object on the elastomer [N]; None if not measured.
        force_error: standard deviation [N].
        moment: about z through the origin [N·mm]; None if not measured.
        moment_error: standard deviation [N·mm].
    """

    displacement: Float[np.ndarray, "frames n 3"]
    displacement_error: tuple[float, float, float] = (1e-3, 1e-3, 3e-3)
    force: Float[np.ndarray, "frames 3"] | None = None
    force_error: float = 0.02
    moment: Float[np.ndarray, " frames"] | None = None
    moment_error: float = 0.2


@dataclass(frozen=True)
class FieldFit:
    """What was found, and what was not.

    Attributes:
        names: of the numbers sought, `twist[1]` for the second of several.
        values: best estimates; NaN where undetermined.
        low: lower ends of the 95 % intervals; NaN where undetermined or not `trusted`.
        high: upper ends.
        determined: whether the data tell a number; false also at a bound.
        covariance: of the coordinates, by the errors given for the data; a pseudo-inverse where
            they are undetermined.
        correlation: of the coordinates.
        misfit: χ² by the degrees of freedom, the priors not counted; about 1 if the model holds.
        misfits: the same of each kind of measurement, by their number.
        p_value: probability of χ² as large as that, if the model holds: the smallest of that of all
            data and those of each kind, times their number (Bonferroni).
        left_out: by part of the data, the estimates without it, to first order; NaN where the
            remaining data do not determine a number.
        residual: measured less predicted displacement [mm].
        predicted: by the fitted model.
        best: every number of the scene, also those that are undetermined: where to start again.
        converged: whether the fit came to an end.
        steps: trials of the fit.
        agreeing: of several starts, the share that came to this minimum.
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, " p"]
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    determined: Bool[np.ndarray, " p"]
    covariance: Float[np.ndarray, "p p"]
    correlation: Float[np.ndarray, "p p"]
    misfit: float
    misfits: Mapping[str, float]
    p_value: float
    left_out: Mapping[str, Float[np.ndarray, " p"]]
    residual: Float[np.ndarray, "frames n 3"]
    predicted: Prediction
    best: Mapping[str, Any]
    converged: bool
    steps: int
    agreeing: float = 1.0

    @property
    def trusted(self) -> bool:
        """Whether the errors given for the data explain the misfit."""
        return self.p_value >= LEAST_P

    @property
    def span(self) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Least and largest estimate, from all data or with one part left out.

        Parts without which a number is undetermined are not in it, see `hangs_on`.
        """
        every = np.stack([self.values, *self.left_out.values()])
        return np.fmin.reduce(every), np.fmax.reduce(every)

    def hangs_on(self, index: int) -> list[str]:
        """Parts of the data without which a number that is determined would not be."""
        lost = [name for name, values in self.left_out.items() if np.isnan(values[index])]
        return lost if self.determined[index] else []

    @property
    def residual_share(self) -> float:
        """Root mean square displacement that the model leaves, over that of what was measured."""
        known = np.isfinite(self.residual)
        measured = (self.predicted.displacement + self.residual)[known]
        return float(np.sqrt(np.sum(self.residual[known] ** 2) / np.sum(measured**2)))

    @property
    def verdict(self) -> list[str]:
        """What to make of the fit, in sentences."""
        return list(_judge(self))


def _judge(fit: FieldFit) -> Sequence[str]:
    lost = [name for name, known in zip(fit.names, fit.determined, strict=True) if not known]
    said = []
    if lost:
        said.append(f"The data do not determine {', '.join(lost)}: no number is given.")
    if FRICTION in lost and fit.predicted.slip_width < LEAST_SLIP:
        said.append(
            f"The slipping ring is {fit.predicted.slip_width:.1f} cells wide at most, too narrow "
            "to determine μ: twist or shift the object further, or use smaller cells."
        )
    rms = 1e3 * np.sqrt(np.nanmean(fit.residual**2, axis=(0, 1)))
    where = (
        f"residuals {rms[0]:.2f}, {rms[1]:.2f}, {rms[2]:.2f} µm rms along x, y, z, "
        f"{100.0 * fit.residual_share:.2g} % of the motion"
    )
    if fit.trusted:
        said.append(
            "The model describes the data within the errors given for them (χ² "
            f"{fit.misfit:.3g} per degree of freedom, p = {fit.p_value:.2g}): {where}."
        )
    else:
        kinds = ", ".join(f"{name} {value:.3g}" for name, value in fit.misfits.items())
        said += [
            "The model does not describe the data within the errors given for them (χ² "
            f"{fit.misfit:.3g} per degree of freedom instead of 1, {_show_p(fit.p_value)}; "
            f"{kinds}): {where}.",
            "No intervals are given: part of the model's error moves the numbers without showing "
            "in the residuals. The values are those of the closest model. Their change when part "
            "of the data is left out is a lower bound of the error, not an interval.",
        ]
    if not fit.converged:
        said.append("The fit did not converge: start closer, or allow more steps.")
    if fit.agreeing < 1.0:
        said.append(f"{100 * fit.agreeing:.0f} % of the starts reached this minimum.")
    return said


def _show_p(p_value: float) -> str:
    """A small probability."""
    return f"p = {p_value:.1g}" if p_value >= 1e-99 else "p < 1e-99"
