"""Data and results of a field fit, and a verdict in sentences on whether the model describes them.

If χ² is too large, the model is wrong, and its residuals show only a part of its error. The other
part has moved the numbers by an unknown amount. No intervals are given in this case.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from calibration.forward import Prediction

FRICTION = "friction_coefficient"

LEAST_SLIP = 1.5
"""Width of the slipping ring, in cells, below which the cells rather than μ determine it.

If the model's cells are twice as large as the field's, the error of the fitted μ is 40 % for a ring
of half a cell, within its interval of 5 % for one cell, and within 0.3 % for seven cells.
"""

LEAST_P = 1e-3
"""p-value of the χ² test below which the model does not describe the data."""

NOT_COVERED = (
    "The contact lies outside the range of the corrections for finite strain (see "
    "`contactmodel.ContactSolution.correction`): the intervals may be too narrow."
)
"""What a fit and a design report of contacts outside the range."""


class FieldData(NamedTuple):
    """Measured fields and forces; NaN for missing values.

    Attributes:
        displacement: displacements of the markers in each frame [mm].
        displacement_error: their standard deviations along x, y, z [mm].
        force: force of the object on the elastomer [N]; None if not measured.
        force_error: its standard deviation [N].
        moment: moment about z through the origin [N·mm]; None if not measured.
        moment_error: its standard deviation [N·mm].
    """

    displacement: Float[np.ndarray, "frames n 3"]
    displacement_error: tuple[float, float, float] = (1e-3, 1e-3, 3e-3)
    force: Float[np.ndarray, "frames 3"] | None = None
    force_error: float = 0.02
    moment: Float[np.ndarray, " frames"] | None = None
    moment_error: float = 0.2


@dataclass(frozen=True)
class FieldFit:
    """Result of a field fit."""

    names: tuple[str, ...]  # names of the unknown numbers, `twist[1]` for the second of several
    values: Float[np.ndarray, " p"]  # best estimates; NaN if undetermined
    # lower ends of the 95 % intervals; NaN if undetermined or not `trusted`
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]  # upper ends of the 95 % intervals
    determined: Bool[np.ndarray, " p"]  # whether the data determine a number; False at a bound
    # covariance of the coordinates from the errors of the data; a pseudo-inverse if some are
    # undetermined
    covariance: Float[np.ndarray, "p p"]
    correlation: Float[np.ndarray, "p p"]  # correlation of the coordinates
    misfit: float  # χ² per degree of freedom, without the priors; about 1 if the model holds
    misfits: Mapping[str, float]  # χ² per value of each kind of measurement
    # probability of a χ² at least as large if the model holds. It is the smallest probability for
    # all data and for each kind, times the number of tests (Bonferroni).
    p_value: float
    # estimates without a part of the data, by part, to first order; NaN if the remaining data do
    # not determine a number
    left_out: Mapping[str, Float[np.ndarray, " p"]]
    residual: Float[np.ndarray, "frames n 3"]  # measured minus predicted displacement [mm]
    predicted: Prediction  # measurements that the fitted model predicts
    # best values of all numbers of the scene, undetermined ones included; a start for another fit
    best: Mapping[str, Any]
    converged: bool  # whether the fit converged
    steps: int  # number of steps of the fit
    agreeing: float = 1.0  # share of the starting points that led to this minimum
    # estimated error of the model, which the intervals contain; root mean square over that of the
    # predicted displacements [-], 0 if noise explains the residuals
    discrepancy: float = 0.0

    @property
    def trusted(self) -> bool:
        """Whether the errors of the data, and the model's `discrepancy`, explain the misfit."""
        return self.p_value >= LEAST_P

    @property
    def span(self) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
        """Smallest and largest estimate, from all data and with one part left out.

        Parts without which a number is undetermined do not count; see `depends_on`.
        """
        every = np.stack([self.values, *self.left_out.values()])
        return np.fmin.reduce(every), np.fmax.reduce(every)

    def depends_on(self, index: int) -> list[str]:
        """Parts of the data without which a determined number would be undetermined."""
        lost = [name for name, values in self.left_out.items() if np.isnan(values[index])]
        return lost if self.determined[index] else []

    @property
    def residual_share(self) -> float:
        """Root mean square of the residual displacement over that of the measured one [-]."""
        known = np.isfinite(self.residual)
        measured = (self.predicted.displacement + self.residual)[known]
        return float(np.sqrt(np.sum(self.residual[known] ** 2) / np.sum(measured**2)))

    @property
    def verdict(self) -> list[str]:
        """Sentences on how far the fit can be trusted."""
        return list(_judge(self))


def _percent(share: float) -> str:
    """A share to two digits; never in powers of ten."""
    return np.format_float_positional(100.0 * share, 2, fractional=False, trim="-") + " %"


def _judge(fit: FieldFit) -> Sequence[str]:
    lost = [name for name, known in zip(fit.names, fit.determined, strict=True) if not known]
    sentences = []
    if lost:
        sentences.append(f"The data do not determine {', '.join(lost)}: no number is given.")
    if FRICTION in lost and fit.predicted.slip_width < LEAST_SLIP:
        sentences.append(
            f"The slipping ring is at most {fit.predicted.slip_width:.1f} cells wide, too narrow "
            "to determine μ: twist or shift the object further, or use smaller cells."
        )
    if not fit.predicted.covered:
        sentences.append(NOT_COVERED)
    rms = 1e3 * np.sqrt(np.nanmean(fit.residual**2, axis=(0, 1)))
    where = (
        f"residuals {rms[0]:.2f}, {rms[1]:.2f}, {rms[2]:.2f} µm rms along x, y, z, "
        f"{_percent(fit.residual_share)} of the motion"
    )
    errors = "their stated errors"
    if fit.discrepancy:
        errors += f" and an error of the model of {_percent(fit.discrepancy)} of the motion"
    if fit.trusted:
        sentences.append(
            f"The model describes the data within {errors} (χ² "
            f"{fit.misfit:.3g} per degree of freedom, p = {fit.p_value:.2g}): {where}."
        )
    else:
        kinds = ", ".join(f"{name} {value:.3g}" for name, value in fit.misfits.items())
        chance = f"p = {fit.p_value:.1g}" if fit.p_value >= 1e-99 else "p < 1e-99"
        sentences += [
            f"The model does not describe the data within {errors} (χ² "
            f"{fit.misfit:.3g} per degree of freedom instead of 1, {chance}; "
            f"{kinds}): {where}.",
            "No intervals are given: part of the model's error moves the numbers without showing "
            "in the residuals. The values are those of the closest model. Their change when part "
            "of the data is left out is a lower bound of the error, not an interval.",
        ]
    if not fit.converged:
        sentences.append("The fit did not converge: start closer, or allow more steps.")
    if fit.agreeing < 1.0:
        sentences.append(f"{100 * fit.agreeing:.0f} % of the starts reached this minimum.")
    return sentences
