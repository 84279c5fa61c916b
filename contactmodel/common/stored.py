"""Read `.npy` and `.npz` files without unpickling, and with no more memory than they hold."""

import io
import math
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import IO

import numpy as np
from jaxtyping import Shaped

_HEADER = (ValueError, EOFError, OverflowError, TokenError)
"""Errors of NumPy for a damaged header, which it parses as Python."""
_ARCHIVE = (zipfile.BadZipFile, zlib.error, RuntimeError, OSError)
"""Errors of zipfile for a damaged archive. RuntimeError stands for a password or an unknown
compression, OSError for a position beyond the file."""


def read_array(path: Path) -> Shaped[np.ndarray, "..."]:
    """Read the array of a `.npy` file.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is damaged, incomplete, or holds objects.
    """
    with path.open("rb") as file:
        try:
            return _read(file, path.stat().st_size)
        except _HEADER as error:
            raise ValueError(f"{path} is not a complete array of numbers ({error})") from error


def read_arrays(path: Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    """Read the arrays of a `.npz` file by name.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is damaged, incomplete, or holds objects.
    """
    with path.open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                return {
                    entry.filename.removesuffix(".npy"): _read_entry(archive, entry)
                    for entry in archive.infolist()
                }
        except (*_HEADER, *_ARCHIVE) as error:
            raise ValueError(f"{path} is damaged: copy or write it again ({error})") from error


def _read_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Shaped[np.ndarray, "..."]:
    if not entry.filename.endswith(".npy"):
        raise ValueError(f"{entry.filename} in it is no array")
    with archive.open(entry) as file:
        return _read(file, entry.file_size)


def _read(file: IO[bytes] | io.BufferedIOBase, size: int) -> Shaped[np.ndarray, "..."]:
    """Read an array after checking its header against the size of the file [bytes]."""
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise ValueError(f"version {version} of the format is unknown")
    shape, _, kind = read_header(file)
    needed = math.prod(shape) * kind.itemsize
    if min(shape, default=0) < 0 or needed > size - file.tell():
        raise ValueError(
            f"it declares {needed} bytes but has {size - file.tell()}: it is truncated"
        )
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)
