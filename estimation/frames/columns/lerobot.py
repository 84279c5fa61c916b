"""Frames as a LeRobot data set, version 3.0: one episode in Parquet and JSON, without `lerobot`.

The markers are the feature `observation.tactile.points`: for each marker dx, dy, dz [mm] and Fx,
Fy, Fz [N] in single precision, following the proposals for tactile sensors. Estimates are features
such as `observation.contact.angle_deg`. Features that begin with `contactmodel.` hold the complete
frames in full precision, and `meta/contactmodel.json` the layout.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from contactmodel.common.inputs import naming
from estimation.frames.columns.rows import (
    ANSWER_PREFIX,
    Columns,
    RowFile,
    batch_rows,
    describe_rows,
    open_rows,
)
from estimation.frames.extras import require_extra
from estimation.frames.files import write_folder, write_json
from estimation.frames.flat import FRAME_FIELDS
from estimation.frames.source import Source


class _File(StrEnum):
    """Files of a data set, by their paths in its folder."""

    DATA = "data/chunk-000/file-000.parquet"
    EPISODES = "meta/episodes/chunk-000/file-000.parquet"
    ABOUT = "meta/contactmodel.json"


class _Feature(StrEnum):
    """Names of features; names that end in a dot are prefixes.

    - `EXACT`: prefix of the exact values of a frame, from which it is restored.
    - `ANSWER`: prefix of the quantities of a frame's answer.
    - `POINTS`: displacements and forces of the markers.
    """

    EXACT = "contactmodel."
    ANSWER = "observation.contact."
    POINTS = "observation.tactile.points"


def is_ours(path: Path) -> bool:
    """Whether the path is a LeRobot data set written by `write_lerobot`."""
    return (path / _File.ABOUT).is_file()


def write_lerobot(path: Path, source: Source, answers: Iterable[Mapping[str, Any]] = ()) -> None:
    """Write the frames of a source as a LeRobot data set; a failed write leaves no partial one.

    Args:
        path: of the folder.
        source: of the frames.
        answers: quantities of each frame's answer, by name; may be empty.

    Raises:
        ImportError: the extra `lerobot` is not installed.
        ValueError: there are no frames.
        OSError: the data set cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> from estimation import simulate_pivot, write_lerobot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> write_lerobot(Path("pivot"), recording)
        >>> for file in sorted(Path("pivot").rglob("file-*.parquet")):
        ...     print(file.as_posix())
        pivot/data/chunk-000/file-000.parquet
        pivot/meta/episodes/chunk-000/file-000.parquet
    """
    require_extra("lerobot", f"writing {path}")
    import pyarrow
    from pyarrow import parquet

    times: list[float] = []
    features, statistics = dict[str, Any](), _Statistics()
    with write_folder(path) as folder:
        for name in (_File.DATA, _File.EPISODES):
            (folder / name).parent.mkdir(parents=True)
        writer = None
        for columns in batch_rows(source, answers):
            named = _name_columns(columns, source.layout.reference, times)
            features = features or {name: _describe(values) for name, values in named.items()}
            statistics.update(named)
            table = pyarrow.table({name: _to_arrow(values) for name, values in named.items()})
            writer = writer or parquet.ParquetWriter(folder / _File.DATA, table.schema)
            writer.write_table(table)
        if writer is None:
            raise ValueError(f"{source.name} has no frames: there is nothing to write to {path}")
        writer.close()
        features[_Feature.POINTS]["names"] = ["dx", "dy", "dz", "Fx", "Fy", "Fz"]
        _write_meta(folder, len(times), _find_rate(times), features)
        write_json(folder / "meta" / "stats.json", statistics.content())
        write_json(folder / _File.ABOUT, describe_rows(source))


def open_lerobot(path: Path) -> RowFile:
    """Open a data set that `write_lerobot` has written.

    Raises:
        ImportError: the extra `lerobot` is not installed.
        ValueError: the data set is damaged.
        OSError: the data set cannot be read.
    """
    require_extra("lerobot", f"reading {path}")
    with naming(path, "not a data set of `--sink lerobot`, or damaged"):
        try:
            about = json.loads((path / _File.ABOUT).read_text(encoding="utf-8"))
            return open_rows(about, _read(path))
        except (LookupError, TypeError, AttributeError, RecursionError) as error:
            raise ValueError(f"{_File.ABOUT} lacks {error}") from error


def _read(path: Path) -> Iterator[Columns]:
    """The exact columns of the frames, in batches."""
    from pyarrow import ArrowException, parquet

    names = [_Feature.EXACT + name for name in FRAME_FIELDS]
    try:
        with parquet.ParquetFile(path / _File.DATA) as file:
            for batch in file.iter_batches(columns=names, batch_size=256):
                yield {
                    name: _from_arrow(batch.column(_Feature.EXACT + name)) for name in FRAME_FIELDS
                }
    except (ArrowException, LookupError, OSError) as error:
        why = " ".join(str(error).split())
        raise ValueError(f"{path / _File.DATA} is damaged ({why}): copy it again") from error


def _name_columns(columns: Columns, reference: np.ndarray, times: list[float]) -> dict[str, Any]:
    """The features of a batch of rows, whose times are appended to `times`."""
    first, rows = len(times), len(columns["time"])
    times += columns["time"].tolist()
    points = np.zeros((rows, len(reference), 6), np.float32)
    points[..., : reference.shape[1]] = columns["positions"] - reference
    points[..., 3 : 3 + reference.shape[1]] = columns["forces"]
    since = np.array(times[first:]) - next((time for time in times if np.isfinite(time)), 0.0)
    named: dict[str, Any] = {_Feature.POINTS: points}
    stamps = [ANSWER_PREFIX + name for name in ("time_s", "since_s", "slip_since_s")]
    # a clock's present time in single precision would be up to a minute wrong
    for name, values in columns.items():
        if not name.startswith(ANSWER_PREFIX):
            named[_Feature.EXACT + name] = values
        elif isinstance(values, list) or values.dtype.kind != "f" or name in stamps:
            named[_Feature.ANSWER + name.removeprefix(ANSWER_PREFIX)] = values
        else:
            named[_Feature.ANSWER + name.removeprefix(ANSWER_PREFIX)] = values.astype(np.float32)
    index = np.arange(first, first + rows)
    zero = np.zeros(rows, dtype=np.int64)
    return named | {
        "timestamp": np.nan_to_num(since).astype(np.float32),
        "frame_index": index,
        "episode_index": zero,
        "index": index,
        "task_index": zero,
    }


def _describe(values: Any) -> dict[str, Any]:
    """The entry of a feature in `info.json`."""
    if isinstance(values, list):
        return {"dtype": "string", "shape": [1], "names": None}
    return {"dtype": str(values.dtype), "shape": list(values.shape[1:]) or [1], "names": None}


def _to_arrow(values: Any) -> Any:
    """A column of texts or numbers, or of lists as deep as the feature's shape."""
    import pyarrow

    if isinstance(values, list):
        return pyarrow.array(values, pyarrow.string())
    column = pyarrow.array(values.ravel())
    for axis in range(values.ndim - 1, 0, -1):
        count = int(np.prod(values.shape[:axis]))
        ends = np.arange(count + 1, dtype=np.int32) * values.shape[axis]
        column = pyarrow.ListArray.from_arrays(ends, column)
    return column


def _from_arrow(column: Any) -> Any:
    """The values of a column, with lists flattened in each row."""
    import pyarrow

    if pyarrow.types.is_string(column.type):
        return column.to_pylist()
    shape = (len(column), -1) if pyarrow.types.is_list(column.type) else -1
    while pyarrow.types.is_list(column.type):
        column = column.flatten()
    return column.to_numpy(zero_copy_only=False).reshape(shape)


def _find_rate(times: list[float]) -> int:
    """Frames per second, as the whole number that LeRobot requires."""
    steps = np.diff(times)
    steps = steps[np.isfinite(steps) & (steps > 0.0)]
    return max(round(1.0 / float(np.median(steps))), 1) if len(steps) else 30


def _write_meta(folder: Path, frames: int, rate: int, features: dict[str, Any]) -> None:
    """Write LeRobot's metadata: the features, the single episode and its task."""
    import pyarrow
    from pyarrow import parquet

    task = "hold and turn an object"
    info = {
        "codebase_version": "v3.0",
        "robot_type": "contactmodel",
        "total_episodes": 1,
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": "0:1"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    write_json(folder / "meta" / "info.json", info)
    episode = {
        "episode_index": [0],
        "tasks": [[task]],
        "length": [frames],
        "data/chunk_index": [0],
        "data/file_index": [0],
        "dataset_from_index": [0],
        "dataset_to_index": [frames],
        "meta/episodes/chunk_index": [0],
        "meta/episodes/file_index": [0],
    }
    parquet.write_table(pyarrow.table(episode), folder / _File.EPISODES)
    tasks = pyarrow.table({"task_index": [0], "task": [task]})
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": stored}
        for name, (kind, stored) in kinds.items()
    ]
    index = {"index_columns": ["task"], "columns": columns, "column_indexes": []}
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(index)})  # names of its rows
    parquet.write_table(tasks, folder / "meta" / "tasks.parquet")


class _Statistics:
    """Minimum, maximum, mean and spread of each numeric feature, accumulated in batches."""

    def __init__(self) -> None:
        self._parts: dict[str, list[np.ndarray]] = {}

    def update(self, named: Mapping[str, Any]) -> None:
        for name, values in named.items():
            if name.startswith(_Feature.EXACT) or isinstance(values, list):
                continue
            finite, exact = np.isfinite(values), np.asarray(values, dtype=float)
            zero = np.where(finite, exact, 0.0)
            parts = [
                np.where(finite, exact, np.inf).min(axis=0),
                np.where(finite, exact, -np.inf).max(axis=0),
                *(sums.sum(axis=0) for sums in (zero, zero**2, finite.astype(float))),
            ]
            if name in self._parts:
                least, most, *sums = self._parts[name]
                parts[:2] = [np.minimum(least, parts[0]), np.maximum(most, parts[1])]
                parts[2:] = [before + now for before, now in zip(sums, parts[2:], strict=True)]
            self._parts[name] = parts

    def content(self) -> dict[str, dict[str, Any]]:
        content = {}
        for name, (least, most, total, squares, count) in self._parts.items():
            many = np.maximum(count, 1.0)
            mean = total / many
            spread = np.sqrt(np.maximum(squares / many - mean**2, 0.0))
            values = {"min": least, "max": most, "mean": mean, "std": spread}
            finite = {key: np.where(count > 0, value, 0.0) for key, value in values.items()}
            content[name] = {key: np.atleast_1d(value).tolist() for key, value in finite.items()}
            content[name]["count"] = [int(count.max())]
        return content
