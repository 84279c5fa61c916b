"""Arrays in files, `.npy` and `.npz`: nothing is unpickled, no more memory taken than they hold."""

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
"""What NumPy raises where a header is damaged, which it parses as Python."""
_ARCHIVE = (zipfile.BadZipFile, zlib.error, RuntimeError, OSError)
"""What zipfile raises where an archive is: the last two for a password or a compression that is not
known, and for a place beyond the file."""


def read_array(path: Path) -> Shaped[np.ndarray, "..."]:
    """The array of a `.npy` file.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is damaged, incomplete, or holds objects.
    """
    with path.open("rb") as file:
        try:
            return _read(file, path.stat().st_size)
        except _HEADER as error:
            raise ValueError(f"{path} is not a complete array of numbers ({error})") from error


def read_arrays(path: Path) -> dict[str, Shaped[np.ndarray, "..."]]:
    """The arrays of a `.npz` file by name.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is damaged, incomplete, or holds objects.
    """
    with path.open("rb") as file:
        try:
            with zipfile.ZipFile(file) as archive:
                return {
                    entry.filename.removesuffix(".npy"): _read_entry(archive, entry)
                    for entry in archive.infolist()
                    if entry.filename.endswith(".npy")
                }
        except (*_HEADER, *_ARCHIVE) as error:
            raise ValueError(f"{path} is damaged: copy or write it again ({error})") from error


def _read_entry(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Shaped[np.ndarray, "..."]:
    with archive.open(entry) as file:
        return _read(file, entry.file_size)


def _read(file: IO[bytes] | io.BufferedIOBase, size: int) -> Shaped[np.ndarray, "..."]:
    """An array, once its header is seen to fit the size of the file [bytes]."""
    version = np.lib.format.read_magic(file)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise ValueError(f"version {version} of the format is not known")
    shape, _, kind = read_header(file)
    needed = math.prod(shape) * kind.itemsize
    if min(shape, default=0) < 0 or needed > size - file.tell():
        raise ValueError(
            f"it declares {needed} bytes and has {size - file.tell()}: it is truncated"
        )
    file.seek(0)
    return np.lib.format.read_array(file, allow_pickle=False)
