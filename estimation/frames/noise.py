"""Marker noise, estimated from the recording itself.

Markers move while they are measured, and their errors are correlated over about three frames,
because such trackers smooth over three frames. Motion is smooth in space and slow; noise is
neither. A smooth surface through each marker's surroundings is therefore subtracted. The noise
follows from second differences in time, three frames apart, of the residual.

Errors that change over more than three frames, such as those of a sensor that filters its markers,
cannot be distinguished from motion while the pad is loaded. While it is not, they show as the
scatter of the markers about the reference, so that the noise is at least this scatter. It is also
at least that of rounding: a marker that hardly moves keeps its rounding error, while the motions of
all are multiples of a step. A bias that depends on a dot's position between the camera's pixels is
not included.
"""

from dataclasses import dataclass

import numpy as np
import scipy
from jaxtyping import Float, Int

from estimation.frames.names import counted
from estimation.frames.outliers import OutlierFinder
from estimation.frames.recording import ONSET_MM, Recording
from estimation.frames.source import Source


@dataclass(frozen=True)
class Noise:
    """Random error of marker positions.

    Attributes:
        in_plane: standard deviation of x and of y.
        normal: standard deviation of z; NaN in two dimensions.
        correlation: correlation in time of a marker's errors, one and two frames of the source
            apart; NaN if the recording has too few such frames. It counts as zero beyond two.
        frames: number of frames that the estimate uses.
        unit: of lengths: mm, or px for pictures without a scale.

    Examples:
        >>> import numpy as np
        >>> from estimation import Noise, Tracker, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> for noise in (1e-3, 1e-2):  # mm
        ...     tracker = Tracker(recording.layout, noise=Noise.from_std(noise))
        ...     *_, last = (tracker.update(frame) for frame in recording)
        ...     print(f"{1e3 * noise:.0f} µm: ± {np.degrees(last.high - last.low) / 2:.2f}°")
        1 µm: ± 0.05°
        10 µm: ± 0.29°
    """

    in_plane: float
    normal: float
    correlation: tuple[float, float]
    frames: int
    unit: str = "mm"

    @property
    def correlated(self) -> float:
        """Frames over which a marker's errors are correlated, 1 to 3; 3 if that is unknown.

        The mean of many frames has this many times the variance that it has with white noise.
        """
        frames = 1.0 + 2.0 * sum(self.correlation)
        return float(np.clip(frames, 1.0, 3.0)) if np.isfinite(frames) else 3.0

    @classmethod
    def from_std(cls, in_plane: float, unit: str = "mm") -> "Noise":
        """Make a noise of which only the standard deviation in the plane is known.

        Args:
            in_plane: standard deviation of x and of y.
            unit: of it, mm or px.

        Raises:
            ValueError: the standard deviation is not above 0, or the unit is another one.
        """
        if unit not in ("mm", "px"):
            raise ValueError(f"the noise is in {unit!r}; it must be in mm or px")
        if not 0.0 < in_plane < float("inf"):
            raise ValueError(f"the noise is {in_plane} {unit}; it must be a number above 0")
        unknown = float("nan")
        return cls(in_plane, normal=unknown, correlation=(unknown, unknown), frames=0, unit=unit)


def find_noise(recording: Recording) -> tuple[Noise | None, tuple[str, ...]]:
    """Estimate the noise of a recording; if that fails, return None and a note with the reason."""
    try:
        return estimate_noise(recording), ()
    except ValueError as error:
        return None, (f"{error}. The intervals come from the misfit within each frame instead.",)


def estimate_noise(recording: Recording) -> Noise:
    """Estimate the noise of a recording in which the markers may move.

    Distances between frames are counted in the source's frame numbers, so dropped frames do no
    harm. Frames that repeat the reference exactly (some sensors send them while unloaded) are
    ignored, and so are markers that most frames lack. Where other markers are missing for some
    frames, they count as surroundings of their neighbours, interpolated in time. The medians
    tolerate a minority of jumping markers and frames.

    Raises:
        ValueError: there are too few markers or too few frames of the right distance, or the
            positions do not scatter.

    Examples:
        >>> from estimation import PivotModel, estimate_noise, simulate_pivot
        >>> recording, _ = simulate_pivot(PivotModel(noise=2e-3))
        >>> print(f"{1e3 * estimate_noise(recording).in_plane:.1f} µm")  # 2 µm are true
        2.0 µm
    """
    # distances at which errors count as independent [frames]; trackers average over three
    white_lags = range(3, 9)
    fewest = 300  # residuals per coordinate, for which their median is accurate to about 7 %
    rough, smooth = _split_smooth(recording)
    rows = np.flatnonzero(np.isfinite(rough).any(axis=(1, 2)))
    number_to_row = dict(zip(recording.source_index[rows].tolist(), rows.tolist(), strict=True))
    for lag in white_lags:
        triples = _triples(number_to_row, lag)
        white = _second_difference_variance(rough, triples, fewest)
        if np.isfinite(white).all():
            break
    else:
        raise ValueError(
            f"the noise cannot be estimated from {counted(len(recording), 'frame', 'frames')}: it "
            f"requires frames i, i + {white_lags.start} and i + {2 * white_lags.start} of the "
            f"source with {fewest} markers in all; give the noise, or record longer"
        )
    rounding = find_rounding(recording) ** 2 / 12
    if not (np.maximum(white, rounding)[:2] > 0).all():
        raise ValueError(
            "the noise cannot be estimated: the positions do not scatter, as if repeated; give "
            "the noise"
        )
    variance = white / 6  # of x[t+l] − 2 x[t] + x[t−l] with the three independent
    plane = float(variance[:2].mean())
    others = [
        float(_second_difference_variance(rough, _triples(number_to_row, at), fewest)[:2].mean())
        for at in (1, 2, lag + 1)
    ]
    variance = _include_slow(variance, _unloaded_variance(rough, smooth, fewest))
    return Noise(
        in_plane=float(np.sqrt(max(variance[:2].mean(), *rounding[:2]))),
        normal=float(np.sqrt(max([*variance[2:], *rounding[2:]], default=np.nan))),
        correlation=_correlate(6.0 * plane, lag, *others),
        frames=len(np.unique(triples)),
        unit=recording.unit,
    )


def _correlate(
    white: float, lag: int, one: float, two: float, beyond: float
) -> tuple[float, float]:
    """Correlation of a marker's errors one and two frames apart; NaN where it is unknown.

    With correlation ρ, second differences at lag l have the variance (6 − 8 ρ(l) + 2 ρ(2l)) σ².
    Motion adds to it about as the square of the lag, and up to half of it.

    Args:
        white: their variance at a lag at which errors are independent.
        lag: this lag [frames].
        one: variance at lag one.
        two: variance at lag two.
        beyond: variance at the next larger lag; NaN if it is unknown.
    """
    motion = float(np.nan_to_num((beyond - white) / ((lag + 1) ** 2 - lag**2)))
    motion = float(np.clip(motion, 0.0, 0.5 * white / lag**2))
    variance = (white - motion * lag**2) / 6.0
    rho_two = (6.0 - _ratio(two - 4.0 * motion, variance)) / 8.0
    rho_one = (6.0 - _ratio(one - motion, variance) + 2.0 * rho_two) / 8.0
    return float(rho_one), float(rho_two)


def find_rounding(recording: Recording) -> Float[np.ndarray, " d"]:
    """The step to which each coordinate is rounded; 0 if it is not, or if no marker stays still."""
    most = 200_000  # motions that show it
    frames, markers, axes = recording.positions.shape
    before = np.arange(0, frames - 1, max(frames * markers // most, 1))
    motion = np.abs(recording.positions[before + 1] - recording.positions[before])
    seen = recording.valid[before] & recording.valid[before + 1]
    motion = motion[seen & np.isfinite(motion).all(axis=2)]
    steps = np.zeros(axes)
    for axis, moved in enumerate(motion.T):
        sizes = np.unique(moved)
        still = sizes <= 1e-9 * sizes.max(initial=0.0)
        sizes = sizes[~still]
        count = sizes / sizes.min(initial=np.inf)
        if still.any() and len(sizes) and np.abs(count - np.rint(count)).max() < 0.01:
            steps[axis] = sizes[0]
    return steps


def _include_slow(
    variance: Float[np.ndarray, " d"], scatter: Float[np.ndarray, " d"]
) -> Float[np.ndarray, " d"]:
    """The variance by changes in time, or that about the reference if some errors change slowly."""
    slow = 1.4  # the second over the first, above which they do
    return scatter if scatter[:2].mean() > slow * variance[:2].mean() else variance


def _unloaded_variance(
    rough: Float[np.ndarray, "frames m d"], smooth: Float[np.ndarray, "frames m d"], fewest: int
) -> Float[np.ndarray, " d"]:
    """Variance of markers about the reference while the pad is unloaded, by coordinate.

    In a frame without load, the surroundings of no marker are pressed in by the onset of a contact,
    and no marker is far rougher than the others. NaN in two dimensions, and for fewer samples than
    `fewest`.
    """
    largest = 5.0  # roughness of a marker over the typical one of its frame [-]
    unknown = np.full(rough.shape[2], np.nan)
    if rough.shape[2] < 3:
        return unknown
    pressed = np.fmax.reduce(-smooth[..., 2], axis=1)
    left = rough[(pressed < ONSET_MM) & (np.isfinite(rough[..., 0]).sum(axis=1) > 0)]
    typical = 1.4826 * np.nanmedian(np.abs(left), axis=1)
    left = left[(np.fmax.reduce(np.abs(left), axis=1) < largest * typical).all(axis=1)]
    left = left[np.isfinite(left).all(axis=2)]
    return np.mean(left**2, axis=0) if len(left) >= fewest else unknown


def _split_smooth(
    recording: Recording,
) -> tuple[Float[np.ndarray, "frames m d"], Float[np.ndarray, "frames m d"]]:
    """The rough and the smooth part of the displacements, of markers with complete surroundings.

    The smooth part is what the surroundings predict, and the rough part the difference, of gain
    one. NaN where a marker is missing; missing surroundings are interpolated in time.
    """
    displacement = recording.positions - recording.layout.reference
    usable = recording.valid & ~(displacement == 0).all(axis=(1, 2))[:, None]
    often = 2 * usable.sum(axis=0) >= usable.any(axis=1).sum()
    seen = np.where(usable[..., None], displacement, np.nan)
    if not recording.pictured:
        finder = OutlierFinder(recording.layout.reference)
        seen[[finder.find(frame, local=finder.bent) for frame in seen]] = np.nan
    seen = seen[:, often]
    values, columns = _surroundings(recording.layout.reference[often])
    rough = _take_off_smooth(_fill_gaps(seen), values, columns)
    own = seen[:, columns[:, 0]]
    rough = np.where(np.isnan(own), np.nan, rough)
    return rough, own - rough / values[:, :1]


def _surroundings(
    reference: Float[np.ndarray, "n d"],
) -> tuple[Float[np.ndarray, "m k"], Int[np.ndarray, "m k"]]:
    """Values and columns of the operator that subtracts a quadratic through the surroundings.

    Row i is (x_i − Σ w_j x_j) / √(1 + Σ w_j²), of gain one, with weights that reproduce quadratics.
    Markers whose value would be extrapolated (corners) have no row.
    """
    # number of nearest markers to which a quadratic is fitted: two rings of a square grid
    surroundings = 12
    plane = reference[:, :2]
    if len(plane) <= surroundings:
        raise ValueError(
            f"the noise cannot be estimated from {len(plane)} markers: more than {surroundings} "
            "are needed; give the noise"
        )
    near = np.asarray(scipy.spatial.KDTree(plane).query(plane, surroundings + 1)[1])[:, 1:]
    offset = plane[near] - plane[:, None]
    x, y = np.moveaxis(offset / np.abs(offset).mean(), -1, 0)
    quadratic = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-2)
    weights = np.linalg.pinv(quadratic, rcond=1e-6)[..., 0]
    gain = 1 + (weights**2).sum(axis=1)
    rows = np.flatnonzero(gain < 2)
    scale = np.sqrt(gain[rows])[:, None]
    values = np.concatenate([np.ones_like(scale), -weights[rows]], axis=1) / scale
    return values, np.concatenate([rows[:, None], near[rows]], axis=1)


def _fill_gaps(displacement: Float[np.ndarray, "frames n d"]) -> Float[np.ndarray, "frames n d"]:
    """The displacements, interpolated in time where a marker is missing between two frames."""
    filled = displacement.copy()
    known = np.isfinite(displacement[..., 0])
    rows = np.arange(len(displacement))
    for marker in np.flatnonzero(known.any(axis=0) & ~known.all(axis=0)):
        there = rows[known[:, marker]]
        gaps = rows[~known[:, marker] & (rows > there[0]) & (rows < there[-1])]
        for axis in range(displacement.shape[2]):
            filled[gaps, marker, axis] = np.interp(gaps, there, displacement[there, marker, axis])
    return filled


def _take_off_smooth(
    displacement: Float[np.ndarray, "frames n d"],
    values: Float[np.ndarray, "m k"],
    columns: Int[np.ndarray, "m k"],
) -> Float[np.ndarray, "frames m d"]:
    """Apply the operator in every frame; NaN where a marker of the surroundings is NaN."""
    frames, markers, dimensions = displacement.shape
    starts = np.arange(0, columns.size + 1, columns.shape[1])
    operator = scipy.sparse.csr_array(
        (values.ravel(), columns.ravel(), starts), shape=(len(columns), markers)
    )
    stacked = displacement.transpose(1, 0, 2).reshape(markers, frames * dimensions)
    return (operator @ stacked).reshape(-1, frames, dimensions).transpose(1, 0, 2)


def _triples(row: dict[int, int], lag: int) -> Int[np.ndarray, "triples 3"]:
    """Rows of frames whose numbers at the source are `lag` and twice `lag` apart."""
    rows = [
        (i, row[number + lag], row[number + 2 * lag])
        for number, i in row.items()
        if number + lag in row and number + 2 * lag in row
    ]
    return np.array(rows, dtype=int).reshape(-1, 3)


def _second_difference_variance(
    rough: Float[np.ndarray, "frames m d"], triples: Int[np.ndarray, "triples 3"], fewest: int
) -> Float[np.ndarray, " d"]:
    """Variance of second differences in time per coordinate, from the median deviation.

    NaN for fewer samples than `fewest`.
    """
    before, now, after = (rough[triples[:, i]] for i in range(3))
    difference = (before - 2 * now + after).reshape(-1, rough.shape[-1])
    difference = difference[np.isfinite(difference).all(axis=-1)]
    if len(difference) < fewest:
        return np.full(rough.shape[-1], np.nan)
    return (1.4826 * np.median(np.abs(difference), axis=0)) ** 2


def _ratio(variance: float, white: float) -> float:
    """Ratio of two variances; 6, as for independent errors, without any noise."""
    return variance / white if white > 0 else 6.0


def expect_noise(noise: object) -> None:
    """Check that a noise, if given, is one.

    Raises:
        ValueError: it is not.
    """
    if not (noise is None or isinstance(noise, Noise)):
        raise ValueError(f"a `Noise` is expected, got {noise!r}: make one, `Noise.from_std(…)`")


def expect_unit(noise: Noise | None, source: Source) -> None:
    """Check that a given noise has the unit of a source's lengths.

    Raises:
        ValueError: the units differ, or it is no noise.
    """
    expect_noise(noise)
    if noise is not None and noise.unit != source.unit:
        how = "in µm (--noise-um), in Python in mm (`Noise.from_std`)"
        if source.unit == "px":
            how = "in px (--noise-px), or the scale of the pictures (--mm-per-px)"
        raise ValueError(
            f"{source.name}: the noise is given in {noise.unit}, lengths are in {source.unit}: "
            f"give it {how}"
        )
