"""This project's format for recordings: one `.npz` file.

`numpy.load` opens the file without further dependencies. The file holds no pickled objects, so
opening a stranger's file runs no code.

Its entries follow from the declarations of `Recording` and `MarkerLayout`: a field added there is
written and read here. `write_archive` lists the entries.
"""

import io
import zipfile
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from contactmodel.common.arrays import declared_arrays
from contactmodel.common.stored import read_arrays
from estimation.frames.files import write_whole
from estimation.frames.recording import MarkerLayout, Recording

FORMAT_VERSION = 2
"""Version of the format that is written; older ones are read too."""


def write_archive(recording: Recording, path: str | Path) -> None:
    """Write a recording as one `.npz` file; a failed write leaves no partial file.

    Format version 2 has these entries; lengths are in mm or px (see `unit`), forces in N, moments
    in N·mm, angles in rad, times in s:

    - `format_version`, shape (): 2.
    - `positions`, shape (frames, markers, 2 or 3): marker positions; NaN where not visible.
    - `valid`, shape (frames, markers): which markers can be used.
    - `time`, shape (frames,): time stamps.
    - `source_index`, shape (frames,): frame numbers of the source.
    - `reference`, shape (markers, 2 or 3): unloaded positions.
    - `neighbours`, shape (markers, k): indices of neighbours; −1 for none.
    - `grid_shape`, shape (2,): rows and columns; only if the markers form a grid.
    - `force`, `moment`, shape (frames, 3): resultants; only if known.
    - `forces`, shape like `positions`: force at each marker; only if known.
    - `flaws`, shape (frames,) text: why a frame cannot be used; (0,) if not inspected.
    - `contact`, shape (frames, markers): the contact region; only if the source measures it.
    - `imprint`, shape (frames, 2): rotation of the imprint and its standard error; only if known.
    - `print_point`, shape (frames, 7): a point of the imprint, at first and now; only if known.
    - `rotation`, shape (frames, markers): rotation of each marker's line features; only if known.
    - `hold`, shape (frames, 3): correlation of the print with earlier prints; only if known.
    - `others`, shape (frames, markers): markers around other contacts; only if there are any.
    - `pictured`, shape (): whether pictures show the contact.
    - `unit`, shape () text: unit of lengths, `mm` or `px`.
    - `name`, `source`, `convention`, shape () text: as in `Recording`.
    - `notes`, `warnings`, shape (sentences,) text: as in `Recording`.

    Texts are NumPy `U` arrays. Version 1 lacks `rotation` and `warnings`, and its first archives
    lack `unit` (mm). Archives without `pictured` are from pictures if they have a contact without
    z. Readers reject newer versions and unknown entries.

    Raises:
        ValueError: the file's name does not end in `.npz`.
        OSError: the folder cannot be written to, or the disk is full.

    Examples:
        >>> from estimation import read_recording, simulate_pivot, write_archive
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> write_archive(recording, "pivot.npz")
        >>> read_recording("pivot.npz").positions.shape  # frames, markers, coordinates
        (43, 400, 3)
    """
    path = Path(path)
    if not is_archive(path):
        raise ValueError(f"{path} must end in .npz, the suffix of recording archives")
    entries = {"format_version": FORMAT_VERSION} | _contents(recording.layout)
    entries |= _contents(recording)
    present = {name: np.asarray(entry) for name, entry in entries.items() if entry is not None}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **present)  # pyright: ignore[reportArgumentType]
    write_whole(path, buffer.getvalue())


def _contents(part: MarkerLayout | Recording) -> dict[str, Any]:
    """The fields of a part of a recording by name, without the layout."""
    hints = get_type_hints(type(part))
    return {
        name: np.array(getattr(part, name), dtype=np.str_)
        if hint == tuple[str, ...]  # even if it is empty
        else getattr(part, name)
        for name, hint in hints.items()
        if hint is not MarkerLayout
    }


def is_archive(path: Path) -> bool:
    """Whether the path has the suffix of recording archives."""
    return path.suffix == ".npz"


def read_archive(path: str | Path) -> Recording:
    """Read a recording that `write_archive` has written.

    Raises:
        ValueError: the file is no such archive, of a newer version, damaged, or inconsistent.
        OSError: the file cannot be read.
    """
    path = Path(path)
    entries = _read_entries(path)
    version = entries.get("format_version")
    if version is None or version.shape != () or version.dtype.kind not in "iu":
        raise ValueError(
            f"{path} has no `format_version`: it is not a recording archive. Write one from your "
            "arrays with `write_archive`, as examples/markers_table.py does"
        )
    if version > FORMAT_VERSION:
        raise ValueError(
            f"{path} has format version {version}; this contactmodel reads up to "
            f"{FORMAT_VERSION}: update contactmodel"
        )
    try:
        return _to_recording(entries)
    except KeyError as error:
        raise ValueError(f"{path} lacks the entry {error}: it is incomplete") from error
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is not consistent: {error}") from error


def _read_entries(path: Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    """All arrays of the file; pickled objects are rejected."""
    if path.stat().st_size and not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is not a recording archive, or is truncated")
    return read_arrays(path)


def _to_recording(entries: dict[str, Shaped[np.ndarray, "..."]]) -> Recording:
    """The recording that the entries describe."""
    if "contact" in entries and "positions" in entries:
        entries.setdefault("pictured", np.array(entries["positions"].shape[-1:] == (2,)))
    layout = _read_part(MarkerLayout, entries)
    recording = Recording(layout=MarkerLayout(**layout), **_read_part(Recording, entries))
    known = {"format_version", *get_type_hints(MarkerLayout), *get_type_hints(Recording)}
    if unknown := sorted(set(entries) - known):
        raise ValueError(f"the entry {unknown[0]!r} is unknown: update contactmodel")
    return recording


def _read_part(
    part: type[MarkerLayout | Recording], entries: dict[str, Shaped[np.ndarray, "..."]]
) -> dict[str, Any]:
    """The fields of a part of a recording, from the entries.

    Raises:
        KeyError: an entry is missing.
        TypeError: an entry is of another type.
    """
    types: dict[Any, type] = {Bool: bool, Int: int, Float: float}
    # required entries that the first archives lack
    later = ("unit", "warnings", "pictured")
    arrays, values = declared_arrays(part), {}
    for name, hint in get_type_hints(part).items():
        optional = NoneType in get_args(hint) or name in later
        if hint is MarkerLayout or (optional and name not in entries):
            continue
        entry = entries[name]
        if name in arrays:
            values[name] = entry.astype(types[arrays[name].dtype], casting="same_kind", copy=False)
        else:
            values[name] = _read_plain(name, entry, hint)
    return values


def _read_plain(name: str, entry: Shaped[np.ndarray, "..."], hint: Any) -> Any:
    """Convert an entry to a text or a truth value, or to a tuple of texts or whole numbers."""
    kinds = {str: "U", bool: "b", tuple[str, ...]: "U"}.get(hint, "iu")
    single = hint in (str, bool)
    if entry.dtype.kind not in kinds or entry.ndim != (not single):
        raise TypeError(f"`{name}` holds {entry.dtype} in the shape {entry.shape}")
    return entry.item() if single else tuple(entry.tolist())
