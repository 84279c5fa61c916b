"""Noise of a sensor at rest: its size in positions and angles, and suitable thresholds."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure

from calibration.findings import write_findings
from estimation.estimators.rigid import RigidSettings
from estimation.fields.stencils import Stencils, make_stencils
from estimation.fields.stick import ANGLE_FLOOR_DEG
from estimation.frames.files import write_json
from estimation.frames.noise import Noise, estimate_noise
from estimation.frames.recording import Recording
from estimation.pictures.sensor import Sensor, write_sensor

LAGS = 10
ENOUGH_SECONDS = 9.5
MOST_MOTION = 0.05
"""Largest motion of markers at rest, as from `measure_motion`, in pitches."""

DISC_RADII = (3.0, 5.0)
"""Radii of contacts for which the smallest measurable rotation is reported, in pitches."""


@dataclass(frozen=True)
class RestNoise:
    """Noise of a sensor at rest. Lengths are in the recording's unit."""

    unit: str  # unit of lengths
    seconds: float  # duration [s]
    frames: int  # number of frames with noise
    # standard deviation along x, y and z about each marker's mean and drift
    axes: tuple[float, ...]
    fast: Noise  # noise as the estimators see it, without slow changes
    # correlation of a marker's errors at 1 to 10 source frames apart [-]
    temporal: tuple[float, ...]
    spatial: float  # correlation of neighbouring markers' in-plane errors, one pitch apart [-]
    common: float  # share of the in-plane variance that is common to all markers [-]
    drift: tuple[float, ...]  # mean motion of all markers per second, along each axis
    dropped: float  # share of the source's frames that are missing [-]
    longest_gap: float  # longest time between two frames [s]
    # standard deviation of the rotation of discs of markers, by their radius [rad]
    rotation: dict[str, float]
    angle_floor_deg: float  # suggested smallest denominator of Eq. (15) at the default threshold
    onset: float  # suggested displacement at which contact starts
    notes: tuple[str, ...]  # remarks for readers, in sentences

    def content(self) -> dict[str, object]:
        """Content of `noise.json`."""
        return {
            "unit": self.unit,
            "seconds": self.seconds,
            "frames": self.frames,
            "in_plane": self.fast.in_plane,
            "correlation": [c for c in self.fast.correlation if np.isfinite(c)],
            "axes": list(self.axes),
            "temporal_correlation": list(self.temporal),
            "spatial_correlation": self.spatial,
            "common_share": self.common,
            "drift_per_s": list(self.drift),
            "dropped_share": self.dropped,
            "longest_gap_s": self.longest_gap,
            "rotation_deg": {n: float(np.degrees(v)) for n, v in self.rotation.items()},
            "suggested": {"angle_floor_deg": self.angle_floor_deg, "onset": self.onset},
        }


def assess_noise(recording: Recording) -> RestNoise:
    """Estimate the noise of a sensor at rest, in positions and in angles.

    Raises:
        ValueError: the recording is too short, repeats itself, or the sensor is not at rest.
    """
    fast, stencils = estimate_noise(recording), make_stencils(recording.layout)
    pitch = float(np.sqrt(np.median(np.sum(stencils.offsets**2, axis=(1, 2)) / 2.0)))
    rest = _find_rest(recording, pitch)
    axes = tuple(float(deviation) for deviation in rest.residual.std(axis=(0, 1)))
    plane = rest.residual[..., :2]
    variance = float(np.mean(plane**2))
    place = {int(n): i for i, n in enumerate(rest.number)}
    temporal = (_lagged(plane, place, lag) / variance for lag in range(1, LAGS + 1))
    points = recording.layout.reference[rest.seen, :2]
    floor = 3.0 * stencils.rotation_noise(fast.in_plane) / RigidSettings.threshold
    gaps = np.diff(recording.source_index) - 1
    onset = 10.0 * float(np.linalg.norm(axes))
    return RestNoise(
        unit=recording.unit,
        seconds=float(np.ptp(recording.time)),
        frames=len(plane),
        axes=axes,
        fast=fast,
        temporal=tuple(round(float(rho), 4) for rho in temporal if np.isfinite(rho)),
        spatial=_neighbours_covariance(plane, rest.seen, stencils) / variance,
        common=float(np.mean(plane.mean(axis=1) ** 2) / variance),
        drift=tuple(float(rate) for rate in rest.rates.mean(axis=0)),
        dropped=float(gaps.sum() / max(np.ptp(recording.source_index), 1)),
        longest_gap=float(np.diff(recording.time).max()),
        rotation={
            f"disc_of_{radius:g}_pitches": _rotation_scatter(points, plane, radius * pitch)
            for radius in DISC_RADII
        },
        angle_floor_deg=max(float(np.degrees(floor)), ANGLE_FLOOR_DEG),
        onset=max(0.1, onset) if recording.unit == "mm" else onset,
        notes=_warn(float(np.ptp(recording.time)), variance, fast),
    )


class _Rest(NamedTuple):
    """The markers that are visible in every frame with noise."""

    seen: Bool[np.ndarray, " n"]  # mask of these markers
    number: Int[np.ndarray, " frames"]  # number of each frame in the source
    rates: Float[np.ndarray, "m axes"]  # drift of each marker, per second
    residual: Float[np.ndarray, "frames m axes"]  # positions minus each marker's mean and drift


def measure_motion(centred: Float[np.ndarray, "frames m d"]) -> float:
    """Distance from their mean position that markers exceed in one of twenty cases.

    Args:
        centred: positions less their mean over all frames; the result has their unit.
    """
    return float(np.quantile(np.hypot(*centred[..., :2].T), 0.95))


def _find_rest(recording: Recording, pitch: float) -> _Rest:
    moved = recording.positions - recording.layout.reference
    noisy = ~(moved == 0).all(axis=(1, 2))
    seen = np.asarray(recording.valid[noisy].all(axis=0))
    moved, time = moved[noisy][:, seen], recording.time[noisy]
    clock = time - time.mean()
    centred = moved - moved.mean(axis=0)
    if measure_motion(centred) > MOST_MOTION * pitch:
        raise ValueError(
            f"{recording.name}: the markers move by more than {MOST_MOTION * pitch:.2g} "
            f"{recording.unit}: the sensor is not at rest; record ten seconds without contact"
        )
    rates = np.tensordot(clock, centred, axes=(0, 0)) / float(clock @ clock)
    residual = centred - clock[:, None, None] * rates
    return _Rest(seen, recording.source_index[noisy], rates, residual)


def _neighbours_covariance(
    plane: Float[np.ndarray, "frames m 2"], seen: Bool[np.ndarray, " n"], stencils: Stencils
) -> float:
    """Covariance of the errors of neighbouring markers, one pitch apart."""
    column = np.full(len(seen), -1)
    column[seen] = np.arange(int(seen.sum()))
    near = ((i, j) for i, j in enumerate(stencils.neighbours[:, 0]) if j >= 0)
    pairs = [(column[i], column[j]) for i, j in near if min(column[[i, j]]) >= 0]
    first, second = (plane[:, list(side)] for side in zip(*pairs, strict=True))
    return float(np.mean(first * second))


def _warn(seconds: float, variance: float, fast: Noise) -> tuple[str, ...]:
    """Remarks for readers, in sentences."""
    notes = []
    if seconds < ENOUGH_SECONDS:
        notes.append(
            f"{seconds:.1f} s are too short to estimate drift and slow errors: record ten seconds"
        )
    if variance > 2.0 * fast.in_plane**2:
        notes.append(
            f"slow errors: total noise {1e3 * variance**0.5:.3g} against {1e3 * fast.in_plane:.3g} "
            f"thousandths of a {fast.unit} from frame to frame; the estimators' intervals "
            "cover the latter only"
        )
    return tuple(notes)


def _lagged(plane: Float[np.ndarray, "frames n 2"], place: dict[int, int], lag: int) -> float:
    """Covariance of errors at a lag in source frames; NaN without such pairs of frames."""
    pairs = [(i, place[number + lag]) for number, i in place.items() if number + lag in place]
    if not pairs:
        return float("nan")
    before, after = (list(side) for side in zip(*pairs, strict=True))
    return float(np.mean(plane[before] * plane[after]))


def _rotation_scatter(
    points: Float[np.ndarray, "n 2"], plane: Float[np.ndarray, "frames n 2"], radius: float
) -> float:
    """Standard deviation of the least-squares rotation of a disc of markers in the middle [rad]."""
    inside = np.hypot(*(points - points.mean(axis=0)).T) <= radius
    arm = points[inside] - points[inside].mean(axis=0)
    motion = plane[:, inside] - plane[:, inside].mean(axis=1, keepdims=True)
    turned = arm[:, 0] * motion[..., 1] - arm[:, 1] * motion[..., 0]
    return float(np.std(turned.sum(axis=1) / np.sum(arm**2)))


def plot_noise(noise: RestNoise) -> Figure:
    """Plot the noise by axis, and its correlation in time."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    names = ("x", "y", "z")[: len(noise.axes)]
    left.bar(names, [1e3 * deviation for deviation in noise.axes], color="#6baed6", label="total")
    left.axhline(1e3 * noise.fast.in_plane, color="#08306b", lw=1, label="frame to frame, in plane")
    left.set_ylabel("standard deviation " + ("[µm]" if noise.unit == "mm" else "[1/1000 px]"))
    left.legend(fontsize=8, frameon=False)
    right.axhline(0.0, color="k", lw=0.8)
    right.plot(range(1, len(noise.temporal) + 1), noise.temporal, "o-", color="#08306b")
    right.set(xlabel="frames apart", ylabel="correlation of one marker's errors")
    right.set_ylim(min(-0.2, *right.get_ylim()), 1.0)
    right.grid(alpha=0.3)
    return figure


def write_noise(noise: RestNoise, known: Sensor, out: Path) -> list[str]:
    """Write `sensor.toml`, with the noise, `noise.json`, `noise.png` and `report.html`.

    Returns:
        Lines for the terminal.

    Raises:
        OSError: a file cannot be written.
    """
    fine = f"thousandths of a {noise.unit}" if noise.unit == "px" else "µm"
    smallest = ", ".join(
        f"{np.degrees(1.96 * np.sqrt(2.0) * deviation):.3g}° ({name.replace('_', ' ')})"
        for name, deviation in noise.rotation.items()
    )
    lines = [
        f"noise {1e3 * noise.fast.in_plane:.3g} {fine} in the plane from frame to frame; total "
        + ", ".join(f"{1e3 * deviation:.3g}" for deviation in noise.axes)
        + " along each axis",
        f"correlation {', '.join(f'{rho:.2f}' for rho in noise.temporal[:4])} over 1 to 4 frames, "
        f"{noise.spatial:.2f} between neighbours; drift "
        + ", ".join(f"{1e3 * rate:.2g}" for rate in noise.drift)
        + f" {fine}/s",
        f"{100 * noise.dropped:.1f} % of the frames are missing, the longest gap is "
        f"{1e3 * noise.longest_gap:.0f} ms",
        f"smallest rotation between two frames that exceeds the noise (95 %): {smallest}",
        f"suggested: --angle-floor-deg {noise.angle_floor_deg:.2g} --onset-mm {noise.onset:.2g}",
    ]
    caption = (
        "Left: standard deviation of the markers' positions about mean and drift, by axis. The "
        "line is the noise from frame to frame, which the estimators use. Right: correlation of "
        "a marker's errors in time; values far above 0 mean slow errors."
    )
    write_findings(
        out,
        {"noise.png": (plot_noise(noise), caption)},
        title="Noise of the sensor at rest",
        lead=lines,
        lists={"notes": noise.notes},
    )
    write_json(out / "noise.json", noise.content())
    write_sensor(replace(known, noise=noise.fast), out / "sensor.toml")
    return [*lines, *noise.notes]
