"""Experiment files: the object and its motion, known and unknown numbers, and measurements."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.field_result import FieldData
from calibration.forward import UNITS, FieldModel, Unknown, press_and_move
from contactmodel import Grid, Pad
from contactmodel.common.inputs import as_number, naming
from contactmodel.common.settings import SCALES, from_table, read_toml, unit
from estimation.frames.recording import Recording

FORMAT_VERSION = 1
_FILE_UNITS = {"-": "", "rad": "deg"}
NUMBERS = {
    "_".join(filter(None, (name, _FILE_UNITS.get(of, of.lower())))): name
    for name, of in UNITS.items()
}
"""Names of the numbers by their keys in the table `numbers`."""
RENAMED = {
    f"numbers.{name}": f"numbers.{key}" for key, name in NUMBERS.items() if key != f"{name}_deg"
} | {
    "numbers.depth": "numbers.marker_depth_mm",
    "numbers.pad_radius": "numbers.dome_radius_mm",
    "errors.force_N": "errors.force_n",
    "errors.moment_Nmm": "errors.moment_nmm",
}
"""Keys of version 0.1.0 and their present names."""


@dataclass(frozen=True)
class Errors:
    """Standard deviations of the measurements.

    Attributes:
        displacement: of the markers' displacements along x, y, z [mm].
        force: of the resultant force [N].
        moment: of the resultant moment [N·mm].
    """

    displacement: tuple[float, float, float] = field(
        default=(1e-3, 1e-3, 3e-3), metadata=unit("um", above=0.0)
    )
    force: float = field(default=0.02, metadata=unit("n", above=0.0))
    moment: float = field(default=0.2, metadata=unit("nmm", above=0.0))


@dataclass(frozen=True)
class Markers:
    """The square grid of markers of a planned experiment.

    Attributes:
        pitch: distance between neighbours [mm].
        count: number of markers along a side.
    """

    pitch: float = field(default=1.0, metadata=unit("mm", above=0.0))
    count: int = field(default=10, metadata=unit(least=1.0, most=1000.0))


@dataclass(frozen=True)
class _Sought:
    start: Any
    low: float = field(metadata=unit())
    high: float = field(metadata=unit())
    prior: tuple[float, float] | None = field(default=None, metadata=unit())
    per_frame: bool = False


@dataclass(frozen=True)
class _File:
    shape: str
    cells: int
    frames: tuple[int, ...]
    numbers: Mapping[str, Any]
    size: float | None = field(default=None, metadata=unit("mm"))
    markers: Markers = field(default_factory=Markers)
    errors: Errors = field(default_factory=Errors)
    design: tuple[str, ...] = ()
    finite_strain: bool = False


@dataclass(frozen=True)
class Experiment:
    """An experiment with known and unknown numbers."""

    name: str  # name of its file or example, for errors
    shape: str  # shape of the object, one of `forward.SHAPES`
    grid: Grid  # cells of the model
    numbers: Mapping[str, Any]  # values by name; the unknown ones are `Unknown`
    frames: tuple[int, ...]  # rows of the recording to fit; for a plan, only their number counts
    errors: Errors  # standard deviations of the measurements
    markers: Markers  # grid of markers of a plan
    design: tuple[str, ...]  # names of numbers that the experimenter can change
    # whether the model is corrected for finite strain, see `press_and_move`, and intervals contain
    # its error
    finite_strain: bool

    def plan(self) -> tuple[FieldModel, FieldData]:
        """Model and data of a plan: a square grid of markers, with everything measured.

        Raises:
            ValueError: the shape is unknown, or markers lie outside the grid.
        """
        count = self.markers.count
        at = (np.arange(count) - 0.5 * (count - 1)) * self.markers.pitch
        markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
        frames = len(self.frames)
        with naming(self.name):
            scene = press_and_move(self.shape, finite_strain=self.finite_strain)
            model = FieldModel(scene, self.grid, markers, frames)
        still = np.zeros((frames, len(markers), 3))
        return model, self._data(still, np.zeros((frames, 3)), np.zeros(frames))

    def of(self, recording: Recording) -> tuple[FieldModel, FieldData]:
        """Model and data of a recording's frames, with the markers above the grid.

        Raises:
            ValueError: a frame does not exist, the positions are not in space in mm, no marker lies
                above the grid, none has moved, or one moved further than the grid is wide.
        """
        rows = list(self.frames)
        if not rows:
            raise ValueError(f"{self.name}: frames is empty: name the rows to fit, counted from 0")
        if min(rows) < 0 or max(rows) >= len(recording):
            raise ValueError(
                f"{self.name}: frames is {rows}, but {recording.name} has rows 0 to "
                f"{len(recording) - 1}"
            )
        if recording.layout.reference.shape[1] != 3 or recording.unit != "mm":
            raise ValueError(
                f"{recording.name} has no positions in space in mm; the fit needs them"
            )
        reference = recording.layout.reference
        reach = np.array([self.grid.x[-1], self.grid.y[-1]])
        if self.finite_strain:  # the grid follows the object
            reach = reach - _largest(self.numbers.get("position", 0.0))
        above = (np.abs(reference[:, :2]) <= reach).all(axis=1)
        if not above.any():
            raise ValueError(
                f"no marker of {recording.name} lies above the grid: use a larger size_mm"
            )
        seen = recording.valid[rows][:, above, None]
        moved = np.where(seen, (recording.positions - reference)[rows][:, above], np.nan)
        _check_motion(moved, rows, 2.0 * reach.max(), recording.name)
        sure = 5.0  # standard errors beyond which no marker at rest lies
        if np.nanmax(np.abs(moved / self.errors.displacement)) < sure:
            raise ValueError(
                f"{self.name}: frames is {rows}, but no marker of {recording.name} has moved there "
                "beyond its stated errors: name rows in which the object is pressed in"
            )
        with naming(self.name):
            scene = press_and_move(self.shape, finite_strain=self.finite_strain)
        model = FieldModel(scene, self.grid, reference[above, :2], len(rows))
        force = None if recording.force is None else recording.force[rows]
        moment = None if recording.moment is None else recording.moment[rows, 2]
        return model, self._data(moved, force, moment)

    def _data(
        self,
        moved: Float[np.ndarray, "frames n 3"],
        force: Float[np.ndarray, "frames 3"] | None,
        moment: Float[np.ndarray, " frames"] | None,
    ) -> FieldData:
        errors = self.errors
        return FieldData(moved, errors.displacement, force, errors.force, moment, errors.moment)


def read_experiment(name: str, pad: Pad | None = None) -> Experiment:
    """Read an experiment's TOML file, or a shipped example by its name.

    The file holds `shape`; `cells` along a side and `size_mm` of the model's grid; the recording's
    `frames`; a table `errors` (`displacement_um` along x, y, z, `force_n`, `moment_nmm`); for a
    plan a table `markers` (`pitch_mm`, `count` along a side) and `design`, the names of numbers
    that can be changed; `finite_strain = true` corrects the model for finite strain. The table
    `numbers` holds the numbers of `press_and_move`, with units in their keys. A number is known,
    `thickness_mm = 4.0`, or unknown, `{start = 4.0, low = 1.0, high = 20.0}`. An unknown number may
    have `prior = [mean, deviation]`, and `per_frame = true` gives it a value for each frame. Angles
    are given as `twist_deg`.

    Args:
        name: name of the file, or of the example.
        pad: pad of a sensor description; supplies the numbers and the size that the file lacks.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a valid experiment.
    """
    examples = files("calibration") / "examples"
    example = examples / f"{name}.toml"
    if not (example.is_file() or Path(name).is_file()):
        names = sorted(item.name.removesuffix(".toml") for item in examples.iterdir())
        raise FileNotFoundError(f"{name} does not exist; shipped examples: {', '.join(names)}")
    path = Path(str(example)) if example.is_file() else Path(name)
    content = read_toml(path, FORMAT_VERSION, RENAMED)
    with naming(name):
        return _make(name, from_table(content, _File), pad or Pad())


def _make(name: str, file: _File, pad: Pad) -> Experiment:
    size = pad.size if file.size is None else (file.size, file.size)
    if size is None:
        raise ValueError("the key 'size_mm' is missing")
    numbers = (_number(*item, frames=len(file.frames)) for item in file.numbers.items())
    of_pad = {  # an infinite value means the same as a missing one; `radius` is the object's
        key: value
        for key, value in vars(pad).items()
        if key in UNITS and key != "radius" and value is not None and np.isfinite(value)
    }
    return Experiment(
        name=name,
        shape=file.shape,
        grid=Grid((file.cells, file.cells), size),
        numbers=of_pad | dict(numbers),
        frames=file.frames,
        errors=file.errors,
        markers=file.markers,
        design=file.design,
        finite_strain=file.finite_strain,
    )


def _largest(number: Any) -> float:
    """Largest absolute value that a number may take."""
    ends = (number.low, number.high) if isinstance(number, Unknown) else number
    return float(np.max(np.abs(ends)))


def _number(key: str, value: Any, *, frames: int) -> tuple[str, Any]:
    """Name of a number, and its value or `Unknown`; degrees become rad."""
    if key not in NUMBERS:
        raise ValueError(f"numbers: unknown number {key!r}; choose from {', '.join(NUMBERS)}")
    name, where = NUMBERS[key], f"numbers.{key}"
    scale = SCALES.get(key.rpartition("_")[2], 1.0)
    if not isinstance(value, dict):
        return name, scale * _values(value, where)
    table = from_table(value, _Sought, where)
    start = scale * _values(table.start, f"{where}.start")
    if table.per_frame:
        start = np.broadcast_to(start, (frames, *start.shape)).copy()
    prior = table.prior and (scale * table.prior[0], scale * table.prior[1])
    with naming(where):
        return name, Unknown(start, scale * table.low, scale * table.high, prior)


def _check_motion(
    moved: Float[np.ndarray, "frames markers 3"], rows: list[int], most: float, name: str
) -> None:
    """Check that every frame shows markers, and that none has moved beyond the grid's width [mm].

    Raises:
        ValueError: a frame shows no marker, or a marker has moved further.
    """
    for row, frame in zip(rows, moved, strict=True):
        length = np.linalg.norm(frame, axis=1)
        if np.isnan(length).all():
            raise ValueError(f"row {row} of {name} shows no marker above the grid: leave it out")
        if (far := np.nanmax(length)) > most:
            raise ValueError(
                f"a marker has moved by {far:.3g} mm in row {row} of {name}, further than the grid "
                "is wide: check the unit of the positions, and mark misread markers as not visible"
            )


def _values(value: Any, name: str) -> Float[np.ndarray, "..."]:
    """Values of a number: one, a list, or one list for each frame."""

    def nested(value: Any) -> Any:
        if isinstance(value, list):
            return [nested(item) for item in value]
        return as_number(value, name)

    rows = nested(value)
    try:
        values = np.array(rows, dtype=float)
    except ValueError as error:
        raise ValueError(f"{name} must have rows of one length") from error
    if not np.isfinite(values).all():
        hint = ": leave it out for a thick gel" if name.endswith("thickness_mm") else ""
        raise ValueError(f"{name} must be finite, got {value}{hint}")
    return values
