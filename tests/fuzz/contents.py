"""What files hold, by their suffix, and how it is written.

An input is a dictionary from file names to contents: arrays (`.npy`, pictures), dictionaries of
arrays (`.npz`), tables (`.toml`), rows of cells (`.csv`), or bytes, which are written as they are.
"""

import datetime
import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

Input = dict[str, Any]


def write_input(content: Mapping[str, Any], folder: Path) -> None:
    """Write all files of an input."""
    for name, part in content.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(to_bytes(name, part))


def to_bytes(name: str, content: Any) -> bytes:
    """A file's content as it is stored."""
    if isinstance(content, bytes):
        return content
    if isinstance(content, np.ndarray):
        suffix = Path(name).suffix
        return _npy(content) if suffix == ".npy" else _picture(suffix, content)
    if name.endswith(".npz"):
        return _npz(content)
    if name.endswith(".toml"):
        return "".join(f"{_key(key)} = {_toml(value)}\n" for key, value in content.items()).encode()
    return "".join(",".join(row) + "\n" for row in content).encode()


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    return buffer.getvalue()


def _npz(entries: Mapping[str, Any]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, entry in entries.items():
            file = zipfile.ZipInfo(f"{name}.npy")  # without the time of day
            content = entry if isinstance(entry, bytes) else _npy(entry)
            archive.writestr(file, content, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()


def _picture(suffix: str, image: np.ndarray) -> bytes:
    """The picture; where its kind cannot hold such an array, the array itself."""
    try:
        encoded, data = cv2.imencode(suffix, image)
    except cv2.error:
        encoded, data = False, image
    return data.tobytes() if encoded else image.tobytes()


def _toml(value: Any) -> str:
    """A value in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(key)} = {_toml(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, datetime.date):
        return value.isoformat()
    return json.dumps(value) if isinstance(value, bool | str) else repr(value)


def _key(key: str) -> str:
    return json.dumps(key)
