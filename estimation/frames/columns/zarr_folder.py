"""Frames as a Zarr group with one array for each column, whose first axis is the frames.

The layout, `unit`, `convention` and `format_version` are attributes of the group.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimation.frames.columns.rows import Columns, RowFile, batch_rows, describe_rows, open_rows
from estimation.frames.extras import require_extra
from estimation.frames.files import write_folder
from estimation.frames.flat import FRAME_FIELDS
from estimation.frames.source import Source


def write_zarr(path: Path, source: Source, answers: Iterable[Mapping[str, Any]] = ()) -> None:
    """Write the frames of a source as a Zarr group; a failed write leaves no partial group.

    Args:
        path: of the folder.
        source: of the frames.
        answers: quantities of each frame's answer, by name; may be empty.

    Raises:
        ImportError: the extra `zarr` is not installed.
        OSError: the group cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> import zarr
        >>> from estimation import simulate_pivot, write_zarr
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> write_zarr(Path("pivot.zarr"), recording)
        >>> zarr.open_group("pivot.zarr")["positions"].shape
        (43, 400, 3)
    """
    require_extra("zarr", f"writing {path}")
    import zarr

    chunk_rows = 256  # rows of a chunk
    with write_folder(path) as folder:
        group, arrays = zarr.create_group(folder), dict[str, Any]()
        for columns in batch_rows(source, answers, chunk_rows):
            for name, values in columns.items():
                if isinstance(values, list):
                    values = np.array(values, dtype=np.dtypes.StringDType())
                if name not in arrays:
                    kind = "string" if values.dtype.kind == "T" else values.dtype
                    arrays[name] = group.create_array(
                        name,
                        shape=(0, *values.shape[1:]),
                        chunks=(chunk_rows, *values.shape[1:]),
                        dtype=kind,
                    )
                arrays[name].append(values)
        group.attrs.update(describe_rows(source))


def is_zarr(path: Path) -> bool:
    """Whether there is a Zarr group at the path."""
    return path.suffix == ".zarr" and path.is_dir()


def open_zarr(path: Path) -> RowFile:
    """Open a group that `write_zarr` has written.

    Raises:
        ImportError: the extra `zarr` is not installed.
        ValueError: the path is no such group, or the group is damaged.
        OSError: the group cannot be read.
    """
    require_extra("zarr", f"reading {path}")
    import zarr

    try:
        # a resolved path, because zarr removes the root from inner paths
        group: Any = zarr.open_group(path.resolve(), mode="r")
        arrays = {name: group[name] for name in FRAME_FIELDS}
        lengths = {name: array.shape[0] for name, array in arrays.items()}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"its arrays have different lengths: {lengths}")
        return open_rows(dict(group.attrs), _read_columns(path, arrays))
    except (ValueError, LookupError, TypeError, AttributeError, RuntimeError) as error:
        raise _damaged(path, error) from error


def _read_columns(path: Path, arrays: dict[str, Any]) -> Iterator[Columns]:
    chunk_rows = 256  # rows to read at a time
    for start in range(0, arrays["time"].shape[0], chunk_rows):
        try:
            columns = {name: array[start : start + chunk_rows] for name, array in arrays.items()}
        except (ValueError, LookupError, TypeError, RuntimeError) as error:
            raise _damaged(path, error) from error
        yield columns


def _damaged(path: Path, error: Exception) -> ValueError:
    return ValueError(
        f"{path} is not a Zarr group of frames, or is damaged: {error or type(error)}"
    )
