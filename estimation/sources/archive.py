"""Our own format for recordings: one `.npz` file.

Why `.npz`: everyone who works with arrays can open it (`numpy.load`) without a further dependency,
it is one file, and it needs no pickled objects, so that opening a stranger's file runs nothing.

Format version 1 has these entries, lengths in mm, forces in N, moments in N·mm, times in s:

| entry | shape | meaning |
|---|---|---|
| `format_version` | () | 1 |
| `positions` | (frames, markers, 2 or 3) | marker positions; NaN where not seen |
| `valid` | (frames, markers) | which of them can be used |
| `time`, `source_index` | (frames,) | time stamps; frame numbers of the source |
| `reference` | (markers, 2 or 3) | unloaded positions |
| `neighbours` | (markers, k) | indices of neighbours, −1 where there is none |
| `grid_shape` | (2,) | rows and columns; only where the markers form a grid |
| `force`, `moment` | (frames, 3) | resultants; only where known |
| `forces` | like `positions` | force at each marker; only where known |
| `flaws` | (frames,) text | why a frame cannot be used, empty where it can; (0,) if not inspected |
| `contact` | (frames, markers) | the contact region; only where the source knows it |
| `imprint` | (frames, 2) | the imprint's rotation and its standard error [rad]; only where known |
| `unit` | () text | of lengths, `mm` or `px`; mm where missing |
| `name`, `source`, `convention` | () text | as in `Recording` |
| `notes` | (notes,) text | as in `Recording` |

Texts are NumPy's own `U` arrays. A reader refuses versions that are newer than it is.
"""

import io
import zipfile
import zlib
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from estimation.files import write_whole
from estimation.recording import MarkerLayout, Recording

FORMAT_VERSION = 1
SUFFIX = ".npz"


def write_archive(recording: Recording, path: str | Path) -> None:
    """Write a recording; the file appears whole or not at all.

    Raises:
        ValueError: the file's name does not end in `.npz`.
        OSError: the folder cannot be written to, or the disk is full.
    """
    path = Path(path)
    if path.suffix != SUFFIX:
        raise ValueError(f"{path} must end in {SUFFIX}, by which archives are found again")
    layout = recording.layout
    entries = {
        "format_version": FORMAT_VERSION,
        "positions": recording.positions,
        "valid": recording.valid,
        "time": recording.time,
        "source_index": recording.source_index,
        "reference": layout.reference,
        "neighbours": layout.neighbours,
        "grid_shape": layout.grid_shape,
        "force": recording.force,
        "moment": recording.moment,
        "forces": recording.forces,
        "flaws": np.array(recording.flaws, dtype=np.str_),
        "contact": recording.contact,
        "imprint": recording.imprint,
        "unit": recording.unit,
        "name": recording.name,
        "source": recording.source,
        "convention": recording.convention,
        "notes": np.array(recording.notes, dtype=np.str_),
    }
    known = {name: np.asarray(entry) for name, entry in entries.items() if entry is not None}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **known)  # pyright: ignore[reportArgumentType]
    write_whole(path, buffer.getvalue())


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
        raise ValueError(f"{path} has no `format_version`: it is no recording archive")
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
        raise ValueError(f"{path} is no recording archive, or only the beginning of one")
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            entries = {name: file[name] for name in file.files}
    except (zipfile.BadZipFile, zlib.error, EOFError, ValueError) as error:
        raise ValueError(f"{path} is damaged: copy or write it again ({error})") from error
    return {name: entry for name, entry in entries.items() if isinstance(entry, np.ndarray)}


def _to_recording(entries: dict[str, Shaped[np.ndarray, "..."]]) -> Recording:
    """The recording that the entries describe."""

    def array(name: str, kind: type) -> Shaped[np.ndarray, "..."]:
        return entries[name].astype(kind, casting="same_kind", copy=False)

    def optional(name: str) -> Shaped[np.ndarray, "..."] | None:
        return array(name, float) if name in entries else None

    grid_shape = None
    if "grid_shape" in entries:
        rows, columns = entries["grid_shape"].tolist()
        grid_shape = (int(rows), int(columns))
    return Recording(
        layout=MarkerLayout(array("reference", float), array("neighbours", int), grid_shape),
        positions=array("positions", float),
        valid=array("valid", bool),
        time=array("time", float),
        source_index=array("source_index", int),
        force=optional("force"),
        moment=optional("moment"),
        forces=optional("forces"),
        flaws=tuple(entries["flaws"].tolist()),
        contact=array("contact", bool) if "contact" in entries else None,
        imprint=optional("imprint"),
        unit=str(entries["unit"]) if "unit" in entries else "mm",
        name=str(entries["name"]),
        source=str(entries["source"]),
        convention=str(entries["convention"]),
        notes=tuple(entries["notes"].tolist()),
    )
