"""An experiment in a file: what is pressed on how, what of it is known, and what is measured."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.field_result import FieldData
from calibration.forward import UNITS, FieldModel, Unknown, press_and_move
from contactmodel import Grid
from contactmodel.common.inputs import (
    as_flag,
    as_list,
    as_matrix,
    as_number,
    as_numbers,
    as_table,
    as_text,
    as_texts,
    as_whole,
    expect_keys,
    naming,
    read_toml,
)
from estimation.frames.recording import Recording

FORMAT_VERSION = 1
_KEYS = {"shape", "cells", "size_mm", "frames", "markers", "errors", "numbers"}
_KEYS |= {"design"}
_ERRORS = {"displacement_um": [1.0, 1.0, 3.0], "force_N": 0.02, "moment_Nmm": 0.2}
MOST_MARKERS = 1000
"""Along a side of a plan's grid of markers."""
_MARKERS = {"pitch_mm": 1.0, "count": 10}
_UNKNOWN_KEYS = ("start", "low", "high", "prior", "per_frame")


@dataclass(frozen=True)
class Experiment:
    """An experiment with some of its numbers unknown.

    Attributes:
        shape: of the object, one of `forward.SHAPES`.
        grid: cells of the model.
        numbers: by name; those to be found are `Unknown`.
        frames: rows of the recording that are fitted; of a plan, only how many.
        displacement_error: standard deviations along x, y, z [mm].
        force_error: standard deviation [N].
        moment_error: standard deviation [N·mm].
        pitch: of a plan's markers [mm].
        count: of a plan's markers along a side.
        design: numbers that the experimenter can change.
    """

    shape: str
    grid: Grid
    numbers: Mapping[str, Any]
    frames: tuple[int, ...]
    displacement_error: tuple[float, float, float]
    force_error: float
    moment_error: float
    pitch: float
    count: int
    design: tuple[str, ...]

    def plan(self) -> tuple[FieldModel, FieldData]:
        """The model of a plan: a square grid of markers, everything measured."""
        at = (np.arange(self.count) - 0.5 * (self.count - 1)) * self.pitch
        markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
        frames = len(self.frames)
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
        return FieldData(
            moved, self.displacement_error, force, self.force_error, moment, self.moment_error
        )


def read_experiment(name: str) -> Experiment:
    """Read an experiment's TOML file, or a shipped example by its name.

    `shape`, `cells` along a side and `size_mm` of the model's grid, the recording's `frames`, a
    table `errors` (`displacement_um` along x, y, z, `force_N`, `moment_Nmm`), for a plan a table
    `markers` (`pitch_mm`, `count` along a side) and `design`, names of numbers that can be
    changed; and a table `numbers` of those that `press_and_move` takes. A number is known, `4.0`,
    or sought, `{start = 4.0, low = 1.0, high = 20.0}`, with `prior = [mean, deviation]` if
    something is known, `per_frame = true` if every frame has its own; angles as `twist_deg`.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.
    """
    examples = files("calibration") / "examples"
    example = examples / f"{name}.toml"
    if not (example.is_file() or Path(name).is_file()):
        names = sorted(one.name.removesuffix(".toml") for one in examples.iterdir())
        raise FileNotFoundError(f"no file {name}; shipped examples are {', '.join(names)}")
    content = read_toml(Path(str(example)) if example.is_file() else Path(name), FORMAT_VERSION)
    with naming(name):
        expect_keys(content, "the file", _KEYS)
        return _make(content)


def _make(content: Mapping[str, Any]) -> Experiment:
    errors = _ERRORS | as_table(content.get("errors", {}), "errors")
    expect_keys(errors, "errors", tuple(_ERRORS))
    markers = _MARKERS | as_table(content.get("markers", {}), "markers")
    expect_keys(markers, "markers", tuple(_MARKERS))
    frames = tuple(as_whole(row, "each frame") for row in as_list(content["frames"], "frames"))
    x, y, z = (1e-3 * one for one in as_numbers(errors["displacement_um"], "displacement_um", 3))
    cells, size = as_whole(content["cells"], "cells"), as_number(content["size_mm"], "size_mm")
    count = as_whole(markers["count"], "count")
    if not 1 <= count <= MOST_MARKERS:
        raise ValueError(f"count, markers along a side, must be 1 to {MOST_MARKERS}, got {count}")
    numbers = as_table(content["numbers"], "numbers").items()
    return Experiment(
        shape=as_text(content["shape"], "shape"),
        grid=Grid((cells, cells), (size, size)),
        numbers=dict(_number(*item, frames=len(frames)) for item in numbers),
        frames=frames,
        displacement_error=(x, y, z),
        force_error=as_number(errors["force_N"], "force_N"),
        moment_error=as_number(errors["moment_Nmm"], "moment_Nmm"),
        pitch=as_number(markers["pitch_mm"], "pitch_mm"),
        count=count,
        design=as_texts(content.get("design", []), "design"),
    )


def _number(name: str, value: Any, *, frames: int) -> tuple[str, Any]:
    """A number's name and what is known of it; degrees become rad."""
    scale = np.pi / 180.0 if name.endswith("_deg") else 1.0
    name = name.removesuffix("_deg")
    if name not in UNITS:
        raise ValueError(f"no number {name!r}; there are {', '.join(UNITS)}")
    if not isinstance(value, dict):
        return name, scale * _values(value, name)
    expect_keys(value, name, _UNKNOWN_KEYS)
    start = scale * _values(value["start"], f"{name}: start")
    if as_flag(value.get("per_frame", False), f"{name}: per_frame"):
        start = np.broadcast_to(start, (frames, *start.shape)).copy()
    low, high = (scale * as_number(value[end], f"{name}: {end}") for end in ("low", "high"))
    prior = None
    if "prior" in value:
        mean, deviation = as_numbers(value["prior"], f"{name}: prior", 2)
        prior = scale * mean, scale * deviation
    return name, Unknown(start, low, high, prior)


def _values(value: Any, name: str) -> Float[np.ndarray, "..."]:
    """A number, a list of them, or one list for each frame."""
    if not isinstance(value, list):
        values = np.array(as_number(value, name))
    elif value and isinstance(value[0], list):
        values = as_matrix(value, name)
    else:
        values = np.array(as_numbers(value, name))
    if not np.isfinite(values).all():
        raise ValueError(f"{name} must be finite, got {value}")
    return values
