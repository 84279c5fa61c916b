"""The paper's estimator: the mean of φ over the region grown by Eq. (15).

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Sections IV-B and V-B.

The paper prints the threshold of Eq. (15) as "0.4°", although the quantity it bounds has no unit.
Both readings are available: 0.4 (`paper`), and 0.4° in radians, 0.007 (`paper_strict`).
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from contactmodel.common.ranges import check_count, check_positive
from estimation.estimators.measurement import Z95, Measurement
from estimation.fields.measure import Fields, rotation_sensitivity
from estimation.fields.stencils import Stencils
from estimation.fields.stick import ANGLE_FLOOR_DEG, MIN_STICK_MARKERS, grow_stick_region
from estimation.frames.noise import Noise

STRICT_THRESHOLD = float(np.radians(0.4))
"""Threshold of `paper_strict` [-]: see `PaperSettings.threshold`."""


@dataclass(frozen=True)
class PaperSettings:
    """How the region is grown and averaged.

    Attributes:
        threshold: largest relative difference of rotation, Δφ_th of Eq. (15), at which a neighbour
            joins the region that sticks. Larger values let slipping markers in [-].
        angle_floor_deg: smallest denominator of Eq. (15) [deg].
        window_frames: length of the trailing mean, which restarts with every contact and slip
            [frames].
        zero_drift: subtract each marker's mean φ over the unloaded frames.
        min_stick_markers: fewest markers that count as sticking [-].

    Raises:
        ValueError: a value out of range.
    """

    threshold: float = 0.4
    angle_floor_deg: float = ANGLE_FLOOR_DEG
    window_frames: int = 5
    zero_drift: bool = True
    min_stick_markers: int = MIN_STICK_MARKERS

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_positive("threshold", self.threshold)
        check_positive("angle_floor_deg", self.angle_floor_deg)
        check_count("window_frames", self.window_frames)
        check_count("min_stick_markers", self.min_stick_markers, MIN_STICK_MARKERS)


class Paper:
    """Mean rotation of the stick region, over a trailing window of frames."""

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: PaperSettings = PaperSettings(),
    ) -> None:
        """Make the estimator; without the noise, it uses the scatter of φ over the region."""
        self.stencils = stencils
        self.noise = noise
        self.settings = settings
        self.floor = float(np.radians(settings.angle_floor_deg))
        self._recent: deque[tuple[float, float]] = deque(maxlen=settings.window_frames)
        self._drift = np.zeros(len(stencils.reference))
        self._unloaded = 0

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the sticking elastomer, from the fields of the next frame.

        Frames without contact give each marker's zero drift, the mean φ to subtract.
        """
        if not fields.contact.any():
            self._recent.clear()
            if self.settings.zero_drift:
                self._learn_drift(fields)
            return Measurement.none(fields.contact)
        fields = fields._replace(rotation=fields.rotation - self._drift)
        stick = grow_stick_region(
            fields, self.stencils.adjacent, threshold=self.settings.threshold, floor=self.floor
        )
        if stick.sum() < self.settings.min_stick_markers:
            self._recent.clear()
            return Measurement.none(stick)
        rotation = fields.rotation[stick]
        self._recent.append((float(rotation.mean()), self._standard_error(fields, stick)))
        angle = float(np.mean([mean for mean, _ in self._recent]))
        half = Z95 * self._windowed_error()
        return Measurement(angle, angle - half, angle + half, stick)

    def _learn_drift(self, fields: Fields) -> None:
        visible = np.isfinite(fields.rotation)
        self._unloaded += 1
        self._drift[visible] += (fields.rotation[visible] - self._drift[visible]) / self._unloaded

    def _standard_error(self, fields: Fields, stick: np.ndarray) -> float:
        """Standard error of one frame's mean φ, from the marker noise [rad]."""
        if self.noise is None:
            return float(fields.rotation[stick].std(ddof=1) / np.sqrt(stick.sum()))
        visible = np.isfinite(fields.positions[:, 0])
        return self.noise.in_plane * float(
            np.linalg.norm(rotation_sensitivity(self.stencils, stick, visible))
        )

    def _windowed_error(self) -> float:
        """Standard error of the window's mean, for frames correlated like their noise [rad]."""
        errors = np.array([error for _, error in self._recent])
        correlation = (1.0,) if self.noise is None else (1.0, *self.noise.correlation)
        lag = np.abs(np.subtract.outer(np.arange(len(errors)), np.arange(len(errors))))
        by_lag = np.nan_to_num(np.array([*correlation, 0.0]), nan=1.0)
        shared = by_lag[np.minimum(lag, len(correlation))]
        with np.errstate(invalid="ignore"):  # estimated correlations may give no variance: NaN
            return float(np.sqrt(errors @ shared @ errors) / len(errors))
