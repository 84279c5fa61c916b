"""Reference angles of the object, measured independently of the gel's twist, for softness fits."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from jaxtyping import Float

from contactmodel.common.inputs import cell_number, read_rows
from estimation.fields.outline import follow_outline
from estimation.frames.names import counted
from estimation.frames.recording import Recording

NO_REFERENCE = (
    "cannot fit k without a reference angle: for a given pressure, the twist of one elastomer "
    "depends only on θ/(1+k), so a soft object turned far looks like a rigid object turned less. "
    "Give the angle of a rotary stage or an inertial sensor as a CSV (--reference), use an object "
    "long enough for its contact outline to show its direction (--reference outline), hold it with "
    "a second finger of another stiffness (--k-ratio), or measure k by pressing (python -m "
    "calibration squeeze)"
)
FEWEST_READINGS = 2
_LEAST_JUMP = np.radians(300.0)  # below: the object turned between two rows, or the unit is wrong
OUTLINES = ("imprint", "contact outline")
"""Sources of angles that come from the recording itself, and so share its clock."""

Rows = list[tuple[str, dict[str, str]]]


@dataclass(frozen=True)
class Reference:
    """Angle of the object over time, from an independent measurement.

    Attributes:
        time: times of the readings, on the recording's clock if `same_clock` [s].
        angle: angle of the object; NaN if unknown [rad, counter-clockwise].
        error: standard error of a reading; NaN to estimate it from the scatter [rad].
        zeroed: whether the angle counts from the onset of contact, as in Eq. (13). If not, only
            its changes are used, by Eq. (12).
        same_clock: whether the times are on the recording's clock.
        source: name of the source, for readers.
        finger: whether it is the rotation of another finger's gel.

    Examples:
        >>> import numpy as np
        >>> from calibration import Reference
        >>> stage = Reference(
        ...     time=np.array([0.0, 0.5, 1.0]),
        ...     angle=np.radians([0.0, 5.0, 10.0]),
        ...     error=np.full(3, np.radians(0.05)),
        ...     zeroed=True,
        ...     same_clock=False,
        ...     source="rotary stage",
        ... )
        >>> print(f"{stage.source}: {np.degrees(stage.angle[-1]):.1f}° after {stage.time[-1]} s")
        rotary stage: 10.0° after 1.0 s
    """

    time: Float[np.ndarray, " readings"]
    angle: Float[np.ndarray, " readings"]
    error: Float[np.ndarray, " readings"]
    zeroed: bool
    same_clock: bool
    source: str
    finger: bool = False


def read_reference(path: Path, *, zeroed: bool = False, same_clock: bool = False) -> Reference:
    """Read the angles of a rotary stage or an inertial sensor from a CSV.

    The columns are `time_s`, `angle_deg` or `angle_rad`, and optionally `error_deg` or `error_rad`,
    the standard error of a reading. Jumps by whole turns, as where a yaw angle passes 180° or 360°,
    are removed.

    Args:
        path: CSV file.
        zeroed: whether the angles count from the onset of contact.
        same_clock: whether the times are on the recording's clock.

    Raises:
        OSError: the file cannot be read.
        ValueError: a column is missing, a value is not a number, or the times do not increase.

    Examples:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> from calibration import read_reference
        >>> _ = Path("stage.csv").write_text("time_s,angle_deg\\n0.0,0.0\\n0.5,5.0\\n")
        >>> print(np.degrees(read_reference(Path("stage.csv"), zeroed=True).angle))
        [0. 5.]
    """
    rows = read_rows(path)
    names = set(rows[0][1]) if rows else set()
    if len(rows) < FEWEST_READINGS or "time_s" not in names:
        raise ValueError(
            f"{path}: {counted(len(rows), 'reading', 'readings')} with the columns "
            f"{', '.join(sorted(names)) or 'none'}; a reference requires {FEWEST_READINGS} or more "
            "readings with the columns time_s and angle_deg (or angle_rad), named in its first line"
        )
    time = _column(rows, "time_s")
    _check_times(time, rows)
    angle = _angle(rows, names, "angle")
    if angle is None:
        raise ValueError(
            f"{path} has the columns {', '.join(sorted(names))}; the angle must be called "
            "angle_deg or angle_rad, to state its unit"
        )
    if (known := int(np.isfinite(angle).sum())) < FEWEST_READINGS:
        raise ValueError(
            f"{path}: {counted(known, 'angle is a number', 'angles are numbers')} in {len(rows)} "
            f"rows; {FEWEST_READINGS} or more are required"
        )
    error = _angle(rows, names, "error")
    if error is not None and (error < 0).any():
        place = rows[int(np.argmax(error < 0))][0]
        raise ValueError(f"{place}: the error is negative; it is the standard error of the angle")
    return Reference(
        time=time,
        angle=_without_jumps(angle),
        error=np.full(len(time), np.nan) if error is None else error,
        zeroed=zeroed,
        same_clock=same_clock,
        source=path.name,
    )


def _check_times(time: Float[np.ndarray, " rows"], rows: Rows) -> None:
    if np.isnan(time).any():
        place = rows[int(np.argmax(np.isnan(time)))][0]
        raise ValueError(f"{place}: time_s is empty: add the time, or remove the row")
    if (late := ~(np.diff(time) > 0)).any():
        place = int(np.argmax(late)) + 1
        raise ValueError(
            f"{rows[place][0]}: time_s is {rows[place][1]['time_s']} after "
            f"{rows[place - 1][1]['time_s']}; it must increase from row to row: remove repeated "
            "rows, and sort the others by time"
        )


def _without_jumps(angle: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """The angles without jumps by whole turns, and most of them near 0 rather than near 360°."""
    known, turn = np.isfinite(angle), 2.0 * np.pi
    smooth = angle.copy()
    smooth[known] = np.unwrap(angle[known], discont=_LEAST_JUMP)
    return smooth - turn * np.round(np.nanmedian(smooth) / turn)


def median_of_three(angle: Float[np.ndarray, " readings"]) -> Float[np.ndarray, " readings"]:
    """The readings without single wrong ones: the median of each and its neighbours [rad]."""
    return scipy.ndimage.median_filter(angle, 3, mode="nearest")


def _angle(rows: Rows, names: set[str], what: str) -> np.ndarray | None:
    """A column of angles in either unit, converted to rad; None if it is missing."""
    if f"{what}_rad" in names:
        return _column(rows, f"{what}_rad")
    return np.radians(_column(rows, f"{what}_deg")) if f"{what}_deg" in names else None


def _column(rows: Rows, name: str) -> np.ndarray:
    """Numbers of a column; NaN for empty cells."""
    values = np.array([cell_number(row[name] or "nan", f"{at}: {name}") for at, row in rows])
    if np.isinf(values).any():
        raise ValueError(f"{rows[int(np.argmax(np.isinf(values)))][0]}: {name} is infinite")
    return values


def outline_reference(recording: Recording) -> Reference:
    """Reference from the direction of the object's imprint, or else of the contact's outline.

    Args:
        recording: recording of the grasp.

    Raises:
        ValueError: there is no imprint, and the outline is too round or too small.

    Examples:
        >>> from dataclasses import replace
        >>> import numpy as np
        >>> from calibration import outline_reference
        >>> from estimation import simulate_pivot
        >>> recording, truth = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> imprint = np.stack([truth.angle, np.full(len(recording), 1e-3)], axis=1)  # rad
        >>> reference = outline_reference(replace(recording, imprint=imprint))
        >>> print(f"{reference.source}: {np.degrees(reference.angle[-1]):.1f}° at the end")
        imprint: 10.0° at the end
    """
    outline = follow_outline(recording)
    known = np.isfinite(outline.angle)
    if known.sum() < FEWEST_READINGS:
        raise ValueError(
            f"{recording.name}: the contact is too round or too small to show the rotation of the "
            f"object, and there is no imprint: {NO_REFERENCE}"
        )
    return Reference(
        time=recording.time[known],
        angle=outline.angle[known],
        error=np.full(int(known.sum()), np.nan),  # the outline's error is within one frame only
        zeroed=False,
        same_clock=True,
        source="imprint" if recording.imprint is not None else "contact outline",
    )
