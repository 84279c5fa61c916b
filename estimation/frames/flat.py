"""Frames and layouts as plain arrays by name, for files of other formats.

Missing values of a frame are NaN (−1 in `contact`, 0 in `others`), so that all frames of a
recording have the same names and shapes.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from estimation.frames.recording import Frame, MarkerLayout

FRAME_FIELDS = {
    "time": "f8",
    "source_index": "i8",
    "flaw": "U",
    "positions": "f8",
    "valid": "u1",
    "contact": "i1",
    "wrench": "f8",
    "forces": "f8",
    "imprint": "f8",
    "print_point": "f8",
    "rotation": "f8",
    "hold": "f8",
    "others": "u1",
    "pictured": "u1",
}
"""Fields of a flat frame, with the types of their values."""
PLAIN_FIELDS = ("time", "source_index", "flaw")
"""Fields of a flat frame that are single values, not arrays."""
LAYOUT_FIELDS = {"reference": "f8", "neighbours": "i4", "grid_shape": "i4"}
"""Fields of a flat layout, with the types of their values."""


def flatten_frame(frame: Frame) -> dict[str, Any]:
    """Convert a frame to values by name: all are arrays except time, number and flaw."""
    unknown = np.full(frame.positions.shape, np.nan)
    contact = np.full(len(unknown), -1) if frame.contact is None else frame.contact
    values = {name: getattr(frame, name) for name in FRAME_FIELDS}
    values |= {
        "contact": contact,
        "pictured": [frame.pictured],
        "others": np.zeros(len(unknown)) if frame.others is None else frame.others,
        "forces": unknown if frame.forces is None else frame.forces,
        "rotation": unknown[:, 0] if frame.rotation is None else frame.rotation,
    }
    return {
        name: value if name in PLAIN_FIELDS else np.asarray(value, FRAME_FIELDS[name])
        for name, value in values.items()
    }


def restore_frame(flat: Mapping[str, Any], layout: MarkerLayout) -> Frame:
    """Convert the values of `flatten_frame` back to a frame of a layout.

    Arrays may have any shape with the right number of values; forces and rotation may be empty.

    Raises:
        ValueError: the arrays do not fit each other or the layout.
    """
    valid = np.array(flat["valid"], dtype=bool).ravel()
    markers = len(valid)

    def at_markers(name: str) -> np.ndarray | None:
        values = np.array(flat[name], dtype=float)
        return values.reshape(markers, -1) if np.isfinite(values).any() else None

    contact = np.array(flat["contact"], dtype=int).ravel()
    others = np.array(flat["others"], dtype=bool).ravel()
    rotation = at_markers("rotation")
    positions = np.array(flat["positions"], dtype=float).reshape(markers, -1)
    if positions.shape != layout.reference.shape:
        raise ValueError(f"it has {markers} markers, the layout {len(layout.reference)}")
    return Frame(
        positions=positions,
        valid=valid,
        time=float(flat["time"]),
        source_index=int(flat["source_index"]),
        wrench=tuple(np.ravel(flat["wrench"]).tolist()),
        forces=at_markers("forces"),
        flaw=str(flat["flaw"]),
        contact=None if (contact < 0).any() else contact.astype(bool),
        imprint=tuple(np.ravel(flat["imprint"]).tolist()),
        print_point=tuple(np.ravel(flat["print_point"]).tolist()),
        rotation=None if rotation is None else rotation[:, 0],
        hold=tuple(np.ravel(flat["hold"]).tolist()),
        others=others if others.any() else None,
        pictured=bool(np.ravel(flat["pictured"])[0]),
    )


def flatten_layout(layout: MarkerLayout) -> dict[str, np.ndarray]:
    """Convert a layout to arrays by name; `grid_shape` is empty if there is no grid."""
    values = {name: getattr(layout, name) for name in LAYOUT_FIELDS}
    return {
        name: np.array([] if value is None else value, LAYOUT_FIELDS[name])
        for name, value in values.items()
    }


def restore_layout(flat: Mapping[str, Any], dimensions: int) -> MarkerLayout:
    """Convert the arrays of `flatten_layout` back to a layout in two or three dimensions.

    The arrays may have any shape with the right number of values.

    Raises:
        ValueError: the arrays do not fit each other.
    """
    reference = np.array(flat["reference"], dtype=float).reshape(-1, dimensions)
    around = np.array(flat["neighbours"], dtype=int).reshape(len(reference), -1)
    grid = tuple(np.array(flat["grid_shape"], dtype=int).ravel().tolist())
    return MarkerLayout(reference, around, grid or None)
