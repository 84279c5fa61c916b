"""Angles of the object that do not come from the twist of the gel: what softness is fitted to."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from contactmodel.common.inputs import cell_number, read_rows
from estimation.fields.outline import follow_outline
from estimation.frames.names import counted
from estimation.frames.recording import Recording

NO_REFERENCE = (
    "cannot fit k without a reference angle: with the pressure given, the twist of one "
    "elastomer depends on θ/(1+k) alone, so a soft object turned far and a rigid one turned less "
    "look the same. Give the angle of a rotary stage or an inertial sensor as a CSV, let the "
    "object be long enough for its contact outline to show its direction, hold it with a second "
    "finger of another stiffness, or measure k by pressing (python -m calibration squeeze)"
)
FEWEST_READINGS = 2
Rows = list[tuple[str, dict[str, str]]]


@dataclass(frozen=True)
class Reference:
    """Angle of the object over time.

    Attributes:
        time: [s]; the recording's clock if `same_clock`.
        angle: [rad, counter-clockwise as the recording's angles]; NaN where unknown.
        error: standard error of a reading [rad]; NaN where unknown, it then follows from the
            scatter.
        zeroed: whether it counts from the onset of contact as Eq. (13) does. If not, only its
            changes are used: Eq. (12).
        same_clock: whether its time stamps are those of the recording's clock.
        source: what it is, for readers.

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


def read_reference(path: Path, *, zeroed: bool = False, same_clock: bool = False) -> Reference:
    """Read the angles of a rotary stage or an inertial sensor from a CSV.

    Columns `time_s`, `angle_deg` or `angle_rad`, and, if known, `error_deg` or `error_rad`, the
    standard error of a reading.

    Raises:
        OSError: the file cannot be read.
        ValueError: a column is missing, a value is no number, or the clock goes back.

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
            f"{path}: {counted(len(rows), 'reading', 'readings')} with columns {sorted(names)}; "
            "a reference has the columns time_s and angle_deg (or angle_rad)"
        )
    time = _column(rows, "time_s")
    if not (np.diff(time) > 0).all():
        raise ValueError(f"{path}: time_s must increase from row to row")
    angle = _angle(rows, names, "angle")
    if angle is None:
        raise ValueError(
            f"{path} has columns {sorted(names)}; the angle must be called angle_deg or angle_rad, "
            "so that its unit is known"
        )
    error = _angle(rows, names, "error")
    return Reference(
        time=time,
        angle=angle,
        error=np.full(len(time), np.nan) if error is None else error,
        zeroed=zeroed,
        same_clock=same_clock,
        source=path.name,
    )


def _angle(rows: Rows, names: set[str], what: str) -> np.ndarray | None:
    """A column of angles by either unit [rad]; None where there is none."""
    if f"{what}_rad" in names:
        return _column(rows, f"{what}_rad")
    return np.radians(_column(rows, f"{what}_deg")) if f"{what}_deg" in names else None


def _column(rows: Rows, name: str) -> np.ndarray:
    """The numbers of a column; NaN where a cell is empty."""
    values = np.array([cell_number(row[name] or "nan", f"{at}: {name}") for at, row in rows])
    if np.isinf(values).any():
        raise ValueError(f"{rows[int(np.argmax(np.isinf(values)))][0]}: {name} is infinite")
    return values


def outline_reference(recording: Recording) -> Reference:
    """The direction of the contact's outline, or of the object's imprint where there is one.

    Raises:
        ValueError: neither can be followed.

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
            f"{recording.name}: the contact is too round, or too small, to show how the object "
            f"has turned, and there is no imprint: {NO_REFERENCE}"
        )
    return Reference(
        time=recording.time[known],
        angle=outline.angle[known],
        error=np.full(int(known.sum()), np.nan),  # its own figure is scatter within one frame only
        zeroed=False,
        same_clock=True,
        source="imprint" if recording.imprint is not None else "contact outline",
    )
