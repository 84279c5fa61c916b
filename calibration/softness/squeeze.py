"""Fit k by pressing alone, from gripper travel and indentation or from the contact's curvature.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.3 and 4.2: under one pressure two thick
bodies share the approach in proportion to (1−ν)/G, for any shape of the contact. With the
elastomer's share δ_S and the object's δ_B, k = G_S/G_B = (δ_B/δ_S) (1−ν_S)/(1−ν_B). In a Hertz
contact the elastomer also takes the share δ_S/(δ_S+δ_B) of the relative curvature.

Poisson's ratio of the object is seldom known, so the interval covers a range of it.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.stats import t

from calibration.findings import write_findings
from calibration.softness.choices import Pressing
from contactmodel.common.inputs import cell_number, read_rows
from estimation.estimators.measurement import Z95
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.names import counted
from estimation.frames.recording import Recording
from estimation.softness import ScalarSoftness, write_softness

FEWEST_READINGS = 5
FARTHEST = 1e6
"""Largest plausible reading of a gripper [mm]."""
LEAST_MARKERS = 12
FINITE_STRAIN = 0.01
"""Standard error of the pad's share from the finite strain that Hertz omits (measured; tested)."""

CORE_SHARE = 0.6
"""Share of the contact's radius for measuring its curvature; further out the pad bends away."""


class Evidence(NamedTuple):
    """Measurements behind the object's share, for readers."""

    source: str  # name of the measurement
    x: Float[np.ndarray, " readings"]  # measured values along x of the figure
    y: Float[np.ndarray, " readings"]  # measured values along y of the figure
    # intercept and slope of the line through y over x that gives the share
    line: tuple[float, float]
    labels: tuple[str, str]  # labels of x and y
    notes: tuple[str, ...]  # remarks for readers, in sentences


@dataclass(frozen=True)
class Squeeze:
    """k fitted by pressing."""

    stiffness_ratio: float  # k for the middle of the range of the object's Poisson's ratio [-]
    # lower end of the 95 % interval, for the Poisson's ratio that gives the lowest k [-]
    low: float
    # upper end of the 95 % interval, for the Poisson's ratio that gives the highest k [-]
    high: float
    standard_error: float  # standard error of k from scatter only [-]
    share: float  # the object's share of the approach over the elastomer's [-]
    evidence: Evidence  # measurements behind the share


@dataclass(frozen=True)
class Bodies:
    """Poisson's ratios of the two bodies.

    Attributes:
        poisson_ratio: ν of the elastomer [-].
        object_poisson: smallest and largest ν of the object [-].

    Raises:
        ValueError: a ratio is not from 0 to 0.5, or the object's ratios are not in order.
    """

    poisson_ratio: float = 0.48
    object_poisson: tuple[float, float] = (0.3, 0.5)

    def __post_init__(self) -> None:
        """Check the values."""
        low, high = self.object_poisson
        if not (0.0 <= self.poisson_ratio <= 0.5 and 0.0 <= low <= high <= 0.5):
            raise ValueError(
                f"Poisson's ratios are {self.poisson_ratio} and {self.object_poisson}; they must "
                "be from 0 to 0.5, the lower end first"
            )

    def factor(self, poisson_ratio: float) -> float:
        """k over δ_B/δ_S for a Poisson's ratio of the object [-]."""
        return (1.0 - self.poisson_ratio) / (1.0 - poisson_ratio)


def squeeze_by_travel(
    travel: Float[np.ndarray, " readings"],
    indentation: Float[np.ndarray, " readings"],
    bodies: Bodies,
    pressing: Pressing | None = None,
    *,
    source: str = "travel",
) -> Squeeze:
    """Fit k to the travel of the gripper and the indentation of the pads.

    Args:
        travel: travel of the gripper from any start; only changes count [mm].
        indentation: indentation of one pad at its deepest marker [mm].
        bodies: Poisson's ratios.
        pressing: pads and stiffness of the gripper; None for two pads and a stiff gripper.
        source: name of the measurement, for readers.

    Raises:
        ValueError: there are too few readings, the pads are not pressed in, or the travel is less
            than for a rigid object.
    """
    pressing = pressing or Pressing()
    known = np.isfinite(travel) & np.isfinite(indentation)
    travel, indentation = travel[known], indentation[known]
    if len(travel) < FEWEST_READINGS or np.ptp(indentation) < 0.05:
        reach = np.ptp(indentation) if len(travel) else 0.0
        raise ValueError(
            f"{source}: {counted(len(travel), 'reading', 'readings')} over {reach:.2f} mm of "
            f"indentation; {FEWEST_READINGS} or more are required: close the gripper over 0.3 mm "
            f"or more, in {FEWEST_READINGS} steps"
        )
    if (farthest := np.abs([travel, indentation]).max()) > FARTHEST:
        raise ValueError(
            f"{source}: a reading is {farthest:.3g} mm; check that the readings are in mm"
        )
    design = np.stack([indentation, np.ones(len(indentation))], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    slope, zero = inverse @ (design.T @ travel)
    residual = travel - design @ (slope, zero)
    freedom = len(travel) - 2
    error = float(np.sqrt(residual @ residual / freedom * inverse[0, 0])) / pressing.pads
    share = float(slope) / pressing.pads - pressing.rigid_slope
    notes = (
        "compliance of the gripper and of the pad's backing counts as softness of the object "
        "unless the slope of a rigid object is given (--rigid-slope)",
        "two thick bodies are assumed; a thin pad is stiffer to pressing than to twisting",
    )
    labels = ("indentation of the pad [mm]", "travel of the gripper [mm]")
    line = (float(zero), float(slope))
    evidence = Evidence(source, indentation, travel, line, labels, notes)
    return _conclude(share, error, freedom, bodies, evidence)


def squeeze_by_curvature(
    recording: Recording,
    radius: float,
    bodies: Bodies,
    *,
    pad_radius: float = float("inf"),
) -> Squeeze:
    """Fit k to the pad's share of the curvature of a sphere of known radius.

    Args:
        recording: recording of a sphere pressed on the pad.
        radius: radius of the sphere [mm].
        bodies: Poisson's ratios.
        pad_radius: radius of a domed pad; infinite for a flat pad [mm].

    Raises:
        ValueError: too few frames have enough markers in contact, or the pad is bent more than
            the sphere.
    """
    if not (radius > 0.0 and pad_radius > 0.0):
        raise ValueError(
            f"the radii of sphere and pad are {radius} and {pad_radius} mm; they must be above 0"
        )
    relative = 1.0 / radius + 1.0 / pad_radius
    stencils = make_stencils(recording.layout)
    depth, bent = [], []
    for frame in recording:
        fields = measure_fields(stencils, frame)
        if frame.flaw or not fields.contact.any():
            continue
        points, pressed = fields.positions[fields.contact, :2], fields.indentation[fields.contact]
        arm = points - np.average(points, axis=0, weights=pressed)
        core = np.hypot(*arm.T) <= CORE_SHARE * np.hypot(*arm.T).max()
        if core.sum() < LEAST_MARKERS:
            continue
        x, y = arm[core].T
        design = np.stack([np.ones_like(x), x, y, 0.5 * (x * x + y * y)], axis=1)
        shape = np.linalg.lstsq(design, pressed[core], rcond=None)[0]
        depth.append(float(shape[0]))
        bent.append(-float(shape[3]) / relative)
    if len(bent) < FEWEST_READINGS:
        raise ValueError(
            f"{recording.name}: {len(bent)} frames have {LEAST_MARKERS} markers well inside the "
            f"contact, {FEWEST_READINGS} are needed: press deeper, or use a sphere of larger radius"
        )
    share = np.array(bent)
    deep = np.array(depth) >= 0.5 * max(depth)
    mean = float(np.median(share[deep]))
    spread = float(1.4826 * np.median(np.abs(share[deep] - mean)))
    freedom = max(int(deep.sum()) // 3 - 1, 1)  # errors are correlated over three frames
    error = float(np.hypot(spread / np.sqrt(freedom + 1.0), FINITE_STRAIN))
    notes = (
        "an error of 1 % in the radius, the marker depth or the scale changes the share by 1 %; "
        "finite strain bends the pad by 1 to 2 % more, which the interval includes",
    )
    labels = ("indentation [mm]", "the pad's share of the curvature")
    source = f"curvature, {recording.name}"
    evidence = Evidence(source, np.array(depth), share, (mean, 0.0), labels, notes)
    return _conclude(1.0 / mean - 1.0, error / mean**2, freedom, bodies, evidence)


def _conclude(
    share: float, error: float, freedom: int, bodies: Bodies, evidence: Evidence
) -> Squeeze:
    half = float(t.ppf(0.975, freedom)) * error
    if share + half < 0.0:
        raise ValueError(
            f"{evidence.source}: the object's share over the elastomer's is "
            f"{share:.3g} ± {half:.2g}, but a share cannot be negative: check scale, "
            "radius, the number of pads and the slope of a rigid object"
        )
    least, most = (bodies.factor(ratio) for ratio in bodies.object_poisson)
    middle = bodies.factor(float(np.mean(bodies.object_poisson)))
    return Squeeze(
        stiffness_ratio=max(share, 0.0) * middle,
        low=max(share - half, 0.0) * least,
        high=(share + half) * most,
        standard_error=error * middle,
        share=share,
        evidence=evidence,
    )


def read_travel(
    path: Path,
) -> tuple[Float[np.ndarray, " readings"], Float[np.ndarray, " readings"]]:
    """Read travel and indentation from a CSV with columns travel_mm and indentation_mm [mm].

    Raises:
        OSError: the file cannot be read.
        ValueError: a column is missing, or a value is not a number.
    """
    names = ("travel_mm", "indentation_mm")
    rows = read_rows(path, names)
    travel, indentation = (
        np.array([cell_number(row[name], f"{where}: {name}") for where, row in rows])
        for name in names
    )
    return travel, indentation


def write_squeeze(squeeze: Squeeze, out: Path) -> list[str]:
    """Write `softness.toml`, `squeeze.png` and `report.html`.

    Returns:
        Lines for the terminal.

    Raises:
        OSError: a file cannot be written.
    """
    # the interval is not symmetric; its half-width stands for the error
    error = (squeeze.high - squeeze.low) / 2.0 / Z95
    softness = ScalarSoftness(
        squeeze.stiffness_ratio,
        covariance=((error**2, 0.0), (0.0, 0.0)),
        provenance={
            "squeeze": squeeze.evidence.source,
            "stiffness_ratio_95": [squeeze.low, squeeze.high],
        },
    )
    lines = [
        f"k = {squeeze.stiffness_ratio:.4f} (95 %: {squeeze.low:.4f} to {squeeze.high:.4f}, over "
        "the range of the object's Poisson's ratio)",
        f"the object's deformation is {squeeze.share:.4f} times the elastomer's",
    ]
    write_findings(
        out,
        {
            "squeeze.png": (
                plot_squeeze(squeeze),
                f"{squeeze.evidence.source}: measured values, and the line that gives k.",
            )
        },
        title="Softness from pressing",
        lead=lines,
        lists={"notes": squeeze.evidence.notes},
    )
    write_softness(softness, out / "softness.toml")
    return [*lines, *squeeze.evidence.notes]


def plot_squeeze(squeeze: Squeeze) -> Figure:
    """Plot the measured values, and the line that gives k."""
    figure, axis = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
    axis.plot(squeeze.evidence.x, squeeze.evidence.y, "o", ms=4, color="#08306b", label="measured")
    ends = np.array([squeeze.evidence.x.min(), squeeze.evidence.x.max()])
    zero, slope = squeeze.evidence.line
    axis.plot(
        ends, zero + slope * ends, color="#c1440e", label=f"k = {squeeze.stiffness_ratio:.3g}"
    )
    axis.legend(fontsize=8, frameon=False)
    axis.set(xlabel=squeeze.evidence.labels[0], ylabel=squeeze.evidence.labels[1])
    axis.grid(alpha=0.3)
    return figure
