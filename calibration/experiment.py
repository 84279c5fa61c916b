"""An experiment in a file: what is pressed on how, what of it is known, and what is measured."""

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
"""Keys of the table `numbers`, and the names of their numbers."""
RENAMED = {
    f"numbers.{name}": f"numbers.{key}" for key, name in NUMBERS.items() if key != f"{name}_deg"
} | {
    "numbers.depth": "numbers.marker_depth_mm",
    "numbers.pad_radius": "numbers.dome_radius_mm",
    "errors.force_N": "errors.force_n",
    "errors.moment_Nmm": "errors.moment_nmm",
}
"""Keys of version 0.1.0, and what they are called now."""


@dataclass(frozen=True)
class Errors:
    """Standard deviations of what is measured.

    Attributes:
        displacement: of the markers along x, y, z [mm].
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
    """A plan's square grid of markers.

    Attributes:
        pitch: distance of neighbours [mm].
        count: along a side.
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


@dataclass(frozen=True)
class Experiment:
    """An experiment with some of its numbers unknown.

    Attributes:
        name: of its file or example, for errors.
        shape: of the object, one of `forward.SHAPES`.
        grid: cells of the model.
        numbers: by name; those to be found are `Unknown`.
        frames: rows of the recording that are fitted; of a plan, only how many.
        errors: of what is measured.
        markers: of a plan.
        design: numbers that the experimenter can change.
    """

    name: str
    shape: str
    grid: Grid
    numbers: Mapping[str, Any]
    frames: tuple[int, ...]
    errors: Errors
    markers: Markers
    design: tuple[str, ...]

    def plan(self) -> tuple[FieldModel, FieldData]:
        """The model of a plan: a square grid of markers, everything measured.

        Raises:
            ValueError: no such shape, or markers beyond the grid.
        """
        count = self.markers.count
        at = (np.arange(count) - 0.5 * (count - 1)) * self.markers.pitch
        markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
        frames = len(self.frames)
        with naming(self.name):
            model = FieldModel(press_and_move(self.shape), self.grid, markers, frames)
        nothing = np.zeros((frames, len(markers), 3))
        return model, self._data(nothing, np.zeros((frames, 3)), np.zeros(frames))

    def of(self, recording: Recording) -> tuple[FieldModel, FieldData]:
        """The model of a recording's frames, with the markers above the grid.

        Raises:
            ValueError: a frame that is not there, or no marker above the grid.
        """
        rows = list(self.frames)
        if not rows or min(rows) < 0 or max(rows) >= len(recording):
            raise ValueError(f"frames {rows}; {recording.name} has rows 0 to {len(recording) - 1}")
        if recording.layout.reference.shape[1] != 3 or recording.unit != "mm":
            raise ValueError(f"{recording.name} has no positions in space in mm")
        reference = recording.layout.reference
        reach = np.array([self.grid.x[-1], self.grid.y[-1]])
        above = (np.abs(reference[:, :2]) <= reach).all(axis=1)
        if not above.any():
            raise ValueError("no marker lies above the grid: take a larger one")
        seen = recording.valid[rows][:, above, None]
        moved = np.where(seen, (recording.positions - reference)[rows][:, above], np.nan)
        scene = press_and_move(self.shape)
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

    `shape`, `cells` along a side and `size_mm` of the model's grid, the recording's `frames`, a
    table `errors` (`displacement_um` along x, y, z, `force_n`, `moment_nmm`), for a plan a table
    `markers` (`pitch_mm`, `count` along a side) and `design`, names of numbers that can be
    changed; and a table `numbers` of those that `press_and_move` takes, their keys with units. A
    number is known, `thickness_mm = 4.0`, or sought, `{start = 4.0, low = 1.0, high = 20.0}`, with
    `prior = [mean, deviation]` if something is known, `per_frame = true` if every frame has its
    own; angles as `twist_deg`.

    Args:
        name: of the file, or of the example.
        pad: of a sensor description, for the numbers and the size that the file does not give.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.
    """
    examples = files("calibration") / "examples"
    example = examples / f"{name}.toml"
    if not (example.is_file() or Path(name).is_file()):
        names = sorted(one.name.removesuffix(".toml") for one in examples.iterdir())
        raise FileNotFoundError(f"no file {name}; shipped examples are {', '.join(names)}")
    path = Path(str(example)) if example.is_file() else Path(name)
    content = read_toml(path, FORMAT_VERSION, RENAMED)
    with naming(name):
        return _make(name, from_table(content, _File), pad or Pad())


def _make(name: str, file: _File, pad: Pad) -> Experiment:
    size = pad.size if file.size is None else (file.size, file.size)
    if size is None:
        raise ValueError("the key 'size_mm' is missing")
    found = (_number(*item, frames=len(file.frames)) for item in file.numbers.items())
    known = {one: value for one, value in vars(pad).items() if one in UNITS and value is not None}
    thick = [one for one, value in known.items() if not np.isfinite(value)]  # as where not given
    return Experiment(
        name=name,
        shape=file.shape,
        grid=Grid((file.cells, file.cells), size),
        numbers={one: known[one] for one in known if one not in thick} | dict(found),
        frames=file.frames,
        errors=file.errors,
        markers=file.markers,
        design=file.design,
    )


def _number(key: str, value: Any, *, frames: int) -> tuple[str, Any]:
    """A number's name and what is known of it; degrees become rad."""
    if key not in NUMBERS:
        raise ValueError(f"numbers: unknown number {key!r}; choose from {', '.join(NUMBERS)}")
    name, where = NUMBERS[key], f"numbers.{key}"
    scale = SCALES.get(key.rpartition("_")[2], 1.0)
    if not isinstance(value, dict):
        return name, scale * _values(value, where)
    given = from_table(value, _Sought, where)
    start = scale * _values(given.start, f"{where}.start")
    if given.per_frame:
        start = np.broadcast_to(start, (frames, *start.shape)).copy()
    prior = given.prior and (scale * given.prior[0], scale * given.prior[1])
    with naming(where):
        return name, Unknown(start, scale * given.low, scale * given.high, prior)


def _values(value: Any, name: str) -> Float[np.ndarray, "..."]:
    """A number, a list of them, or one list for each frame."""

    def nested(value: Any) -> Any:
        return [nested(one) for one in value] if isinstance(value, list) else as_number(value, name)

    rows = nested(value)
    try:
        values = np.array(rows, dtype=float)
    except ValueError as error:
        raise ValueError(f"{name} must have rows of one length") from error
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite, got {value}")
    return values
