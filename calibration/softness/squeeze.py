"""k from pressing alone: gripper travel against indentation, or the curvature of the contact.

[Johnson1985] K. L. Johnson, "Contact Mechanics", Sections 3.3 and 4.2: under one pressure two thick
bodies share the approach as their (1−ν)/G, whatever the contact's shape. With δ_S the elastomer's
share and δ_B the object's, k = G_S/G_B = (δ_B/δ_S) (1−ν_S)/(1−ν_B). Within a Hertz contact the
elastomer takes the share δ_S/(δ_S+δ_B) of the relative curvature, too.

Poisson's ratio of the object is seldom known: the interval takes it anywhere in a range.
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
from estimation.frames.recording import Recording
from estimation.softness import ScalarSoftness, write_softness

FEWEST_READINGS = 5
FARTHEST = 1e6
"""Length beyond which a reading of a gripper is none [mm]."""
LEAST_MARKERS = 12
FINITE_STRAIN = 0.01
"""Standard error of the pad's share by the strain that Hertz leaves out (measured; tested)."""

CORE_SHARE = 0.6
"""Share of the contact's radius within which its curvature is read: outside the pad bends away."""


class Evidence(NamedTuple):
    """What the object's share was read from, for readers.

    Attributes:
        source: what it was found from.
        x: what was measured first, for a figure.
        y: what was measured against it.
        line: intercept and slope of y over x that the share was read from.
        labels: of both.
        notes: remarks for readers, in sentences.
    """

    source: str
    x: Float[np.ndarray, " readings"]
    y: Float[np.ndarray, " readings"]
    line: tuple[float, float]
    labels: tuple[str, str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Squeeze:
    """k from pressing.

    Attributes:
        stiffness_ratio: k with Poisson's ratio in the middle of its range [-].
        low: lower end of the 95 % interval, Poisson's ratio at the end that lowers it [-].
        high: upper end [-].
        standard_error: of k, scatter only [-].
        share: of the approach that the object takes, over the elastomer's [-].
        evidence: what it was read from.
    """

    stiffness_ratio: float
    low: float
    high: float
    standard_error: float
    share: float
    evidence: Evidence


@dataclass(frozen=True)
class Bodies:
    """What is known of the two bodies.

    Attributes:
        poisson_ratio: ν of the elastomer [-].
        object_poisson: least and greatest ν of the object [-].

    Raises:
        ValueError: a ratio that no solid has.
    """

    poisson_ratio: float = 0.48
    object_poisson: tuple[float, float] = (0.3, 0.5)

    def __post_init__(self) -> None:
        """Check the values."""
        low, high = self.object_poisson
        if not (0.0 <= self.poisson_ratio <= 0.5 and 0.0 <= low <= high <= 0.5):
            raise ValueError(
                f"Poisson's ratios {self.poisson_ratio} and {self.object_poisson}; they must be "
                "from 0 to 0.5, the lower end first"
            )

    def factor(self, poisson_ratio: float) -> float:
        """k over δ_B/δ_S for an object of that ν."""
        return (1.0 - self.poisson_ratio) / (1.0 - poisson_ratio)


def squeeze_by_travel(
    travel: Float[np.ndarray, " readings"],
    indentation: Float[np.ndarray, " readings"],
    bodies: Bodies,
    pressing: Pressing | None = None,
    *,
    source: str = "travel",
) -> Squeeze:
    """k from how far the gripper closes while the pads are pressed in.

    Args:
        travel: of the gripper since it touched, or before: only changes count [mm].
        indentation: of one pad at its deepest marker [mm].
        bodies: Poisson's ratios.
        pressing: how the gripper closes; two pads and a stiff gripper unless given.
        source: for readers.

    Raises:
        ValueError: too few readings, no pressing, or less travel than a rigid object takes.
    """
    pressing = pressing or Pressing()
    known = np.isfinite(travel) & np.isfinite(indentation)
    travel, indentation = travel[known], indentation[known]
    if len(travel) < FEWEST_READINGS or np.ptp(indentation) < 0.05:
        reach = np.ptp(indentation) if len(travel) else 0.0
        raise ValueError(
            f"{source}: {len(travel)} readings over {reach:.2f} mm of indentation: close the "
            f"gripper over 0.3 mm or more, in {FEWEST_READINGS} steps"
        )
    if (farthest := np.abs([travel, indentation]).max()) > FARTHEST:
        raise ValueError(f"{source}: a reading of {farthest:.3g} mm: are the readings in mm?")
    design = np.stack([indentation, np.ones(len(indentation))], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    slope, zero = inverse @ (design.T @ travel)
    left = travel - design @ (slope, zero)
    freedom = len(travel) - 2
    error = float(np.sqrt(left @ left / freedom * inverse[0, 0])) / pressing.pads
    share = float(slope) / pressing.pads - pressing.rigid_slope
    notes = (
        "the gripper's give and the pad's backing count as softness of the object unless a rigid "
        "object's slope is given (--rigid-slope)",
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
    """k from how much of the curvature of a sphere of known radius the pad takes on.

    Args:
        recording: of a sphere that is pressed on.
        radius: of the object [mm].
        bodies: Poisson's ratios.
        pad_radius: of a domed pad [mm].

    Raises:
        ValueError: no frame with enough markers in contact, or a pad bent more than the object.
    """
    if not (radius > 0.0 and pad_radius > 0.0):
        raise ValueError(f"radii of {radius} and {pad_radius} mm; both must be above 0")
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
            f"{recording.name}: {len(bent)} frames with {LEAST_MARKERS} markers well inside the "
            "contact: press deeper, or take an object of larger radius"
        )
    taken = np.array(bent)
    deep = np.array(depth) >= 0.5 * max(depth)
    mean = float(np.median(taken[deep]))
    spread = float(1.4826 * np.median(np.abs(taken[deep] - mean)))
    freedom = max(int(deep.sum()) // 3 - 1, 1)  # errors hold on for three frames
    error = float(np.hypot(spread / np.sqrt(freedom + 1.0), FINITE_STRAIN))
    notes = (
        "the radius, the marker depth and the scale enter in full: 1 % of either shifts the share "
        "by 1 %; finite strain bends the pad by 1 to 2 % more, which the interval includes",
    )
    labels = ("indentation [mm]", "share of the curvature that the pad takes")
    source = f"curvature, {recording.name}"
    evidence = Evidence(source, np.array(depth), taken, (mean, 0.0), labels, notes)
    return _conclude(1.0 / mean - 1.0, error / mean**2, freedom, bodies, evidence)


def _conclude(
    share: float, error: float, freedom: int, bodies: Bodies, evidence: Evidence
) -> Squeeze:
    half = float(t.ppf(0.975, freedom)) * error
    if share + half < 0.0:
        raise ValueError(
            f"{evidence.source}: the object's share over the elastomer's is "
            f"{share:.3g} ± {half:.2g}, and a share cannot be negative: check scale, "
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
    """Travel and indentation [mm] from a CSV with columns travel_mm and indentation_mm.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no such columns, or a value is no number.
    """
    names = ("travel_mm", "indentation_mm")
    rows = read_rows(path, names)
    travel, indentation = (
        np.array([cell_number(row[name], f"{where}: {name}") for where, row in rows])
        for name in names
    )
    return travel, indentation


def write_squeeze(found: Squeeze, out: Path) -> list[str]:
    """Write `softness.toml`, `squeeze.png` and `report.html`.

    Returns:
        Lines for the terminal.

    Raises:
        OSError: a file cannot be written.
    """
    # the interval is not symmetric; its half-width stands for the error
    error = (found.high - found.low) / 2.0 / Z95
    softness = ScalarSoftness(
        found.stiffness_ratio,
        covariance=((error**2, 0.0), (0.0, 0.0)),
        provenance={
            "squeeze": found.evidence.source,
            "stiffness_ratio_95": [found.low, found.high],
        },
    )
    lines = [
        f"k = {found.stiffness_ratio:.4f} (95 %, any Poisson's ratio of the object in its range: "
        f"{found.low:.4f} to {found.high:.4f})",
        f"the object takes {found.share:.4f} of the elastomer's deformation",
    ]
    write_findings(
        out,
        {"squeeze.png": (plot_squeeze(found), found.evidence.source)},
        title="Softness from pressing",
        lead=lines,
        lists={"notes": found.evidence.notes},
    )
    write_softness(softness, out / "softness.toml")
    return [*lines, *found.evidence.notes]


def plot_squeeze(found: Squeeze) -> Figure:
    """What was measured, and the line through it."""
    figure, axis = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
    axis.plot(found.evidence.x, found.evidence.y, "o", ms=4, color="#08306b", label="measured")
    ends = np.array([found.evidence.x.min(), found.evidence.x.max()])
    zero, slope = found.evidence.line
    axis.plot(ends, zero + slope * ends, color="#c1440e", label=f"k = {found.stiffness_ratio:.3g}")
    axis.legend(fontsize=8, frameon=False)
    axis.set_xlabel(found.evidence.labels[0])
    axis.set_ylabel(found.evidence.labels[1])
    axis.grid(alpha=0.3)
    return figure
