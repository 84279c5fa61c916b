"""Our own format for recordings: one `.npz` file.

Why `.npz`: everyone who works with arrays can open it (`numpy.load`) without a further dependency,
it is one file, and it needs no pickled objects, so that opening a stranger's file runs nothing.

Its entries follow from the declarations of `Recording` and `MarkerLayout`: a field that is added
there is written and read here. `write_archive` lists the entries.
"""

import io
import zipfile
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from contactmodel.common.stored import read_arrays
from estimation.frames.files import write_whole
from estimation.frames.recording import MarkerLayout, Recording, declared_arrays

FORMAT_VERSION = 2
SUFFIX = ".npz"
_TYPES: dict[Any, type] = {Bool: bool, Int: int, Float: float}


def write_archive(recording: Recording, path: str | Path) -> None:
    """Write a recording as one `.npz` file; the file appears whole or not at all.

    Format version 2 has these entries; lengths are in mm or px (see `unit`), forces in N, moments
    in N·mm, angles in rad, times in s:

    - `format_version`, shape (): 2.
    - `positions`, shape (frames, markers, 2 or 3): marker positions; NaN where not seen.
    - `valid`, shape (frames, markers): which of them can be used.
    - `time`, shape (frames,): time stamps.
    - `source_index`, shape (frames,): frame numbers of the source.
    - `reference`, shape (markers, 2 or 3): unloaded positions.
    - `neighbours`, shape (markers, k): indices of neighbours, −1 where there is none.
    - `grid_shape`, shape (2,): rows and columns; only where the markers form a grid.
    - `force`, `moment`, shape (frames, 3): resultants; only where known.
    - `forces`, shape like `positions`: force at each marker; only where known.
    - `flaws`, shape (frames,) text: why a frame cannot be used; (0,) if not inspected.
    - `contact`, shape (frames, markers): the contact region; only where the source knows it.
    - `imprint`, shape (frames, 2): the imprint's rotation and its standard error; where known.
    - `print_point`, shape (frames, 7): a point of the imprint, at first and now; where known.
    - `rotation`, shape (frames, markers): turn of each marker's line features; where known.
    - `hold`, shape (frames, 3): agreement of the print on the gel with earlier ones; where known.
    - `unit`, shape () text: of lengths, `mm` or `px`.
    - `name`, `source`, `convention`, shape () text: as in `Recording`.
    - `notes`, `warnings`, shape (sentences,) text: as in `Recording`.

    Texts are NumPy's own `U` arrays. Version 1 had no `rotation` and no `warnings`, and its first
    archives no `unit` (mm). A reader refuses versions that are newer than it is, and entries that
    it does not know.

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
    if path.suffix != SUFFIX:
        raise ValueError(f"{path} must end in {SUFFIX}, the suffix of recording archives")
    entries = {"format_version": FORMAT_VERSION} | _contents(recording.layout)
    entries |= _contents(recording)
    known = {name: np.asarray(entry) for name, entry in entries.items() if entry is not None}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **known)  # pyright: ignore[reportArgumentType]
    write_whole(path, buffer.getvalue())


def _contents(part: MarkerLayout | Recording) -> dict[str, Any]:
    """The fields of a part of a recording by name, but for parts of its own."""
    hints = get_type_hints(type(part))
    return {
        name: np.array(getattr(part, name), dtype=np.str_)
        if hint == tuple[str, ...]  # also where it is empty
        else getattr(part, name)
        for name, hint in hints.items()
        if hint is not MarkerLayout
    }


def read_archive(path: str | Path) -> Recording:
    """Read a recording that `write_archive` has written.

    Raises:
        ValueError: no archive of this kind, of a newer version, damaged, or inconsistent.
        OSError: the file cannot be read.
    """
    path = Path(path)
    entries = _read_entries(path)
    version = entries.get("format_version")
    if version is None or version.shape != () or version.dtype.kind not in "iu":
        raise ValueError(f"{path} has no `format_version`: it is not a recording archive")
    if version > FORMAT_VERSION:
        raise ValueError(
            f"{path} has format version {version}; this contactmodel reads up to "
            f"{FORMAT_VERSION}: update contactmodel"
        )
    try:
        return _to_recording(entries)
    except KeyError as error:
        raise ValueError(f"{path} lacks the entry {error}: it is not complete") from error
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is not consistent: {error}") from error


def _read_entries(path: Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    """All arrays of the file; pickled objects are refused."""
    if path.stat().st_size and not zipfile.is_zipfile(path):
        raise ValueError(f"{path} is not a recording archive, or is truncated")
    return read_arrays(path)


def _to_recording(entries: dict[str, Shaped[np.ndarray, "..."]]) -> Recording:
    """The recording that the entries describe."""
    layout = _read_part(MarkerLayout, entries)
    recording = Recording(layout=MarkerLayout(**layout), **_read_part(Recording, entries))
    known = {"format_version", *get_type_hints(MarkerLayout), *get_type_hints(Recording)}
    if unknown := sorted(set(entries) - known):
        raise ValueError(f"the entry {unknown[0]!r} is not known here: update contactmodel")
    return recording


def _read_part(
    part: type[MarkerLayout | Recording], entries: dict[str, Shaped[np.ndarray, "..."]]
) -> dict[str, Any]:
    """The fields of a part of a recording that the entries hold.

    Raises:
        KeyError: an entry is missing.
        TypeError: an entry is of another type.
    """
    # entries that are not optional, and that the first archives were written without
    later = ("unit", "warnings")
    arrays, found = declared_arrays(part), {}
    for name, hint in get_type_hints(part).items():
        optional = NoneType in get_args(hint) or name in later
        if hint is MarkerLayout or (optional and name not in entries):
            continue
        entry = entries[name]
        if name in arrays:
            found[name] = entry.astype(_TYPES[arrays[name].dtype], casting="same_kind", copy=False)
        else:
            found[name] = _read_plain(name, entry, hint)
    return found


def _read_plain(name: str, entry: Shaped[np.ndarray, "..."], hint: Any) -> Any:
    """A text, or several texts or whole numbers, as Python has them."""
    kinds = "U" if hint in (str, tuple[str, ...]) else "iu"
    if entry.dtype.kind not in kinds or entry.ndim != (hint is not str):
        raise TypeError(f"`{name}` holds {entry.dtype} in the shape {entry.shape}")
    return str(entry) if hint is str else tuple(entry.tolist())
