"""Table of your marker positions to a recording: `python examples/markers_table.py T.csv T.npz`."""

import sys
from pathlib import Path

import numpy as np

from contactmodel.common.inputs import read_rows
from estimation import Recording, layout_markers, write_archive

SCALE = 1.0  # mm per unit of the table: 1000.0 if its lengths are in m


def main(table: str, archive: str) -> None:
    """Convert columns time_s, marker, x, y and perhaps z; the first time shows the bare pad."""
    rows = [row for _, row in read_rows(Path(table), ("time_s", "marker", "x", "y"))]
    names = ["time_s", "marker", "x", "y", *(["z"] if rows and "z" in rows[0] else [])]
    values = np.array([[float(row[name] or "nan") for name in names] for row in rows])
    time, frame = np.unique(values[:, 0], return_inverse=True)  # in order of time
    markers, column = np.unique(values[:, 1], return_inverse=True)  # in any order in the table
    positions = np.full((len(time), len(markers), len(names) - 2), np.nan)  # NaN: not seen
    positions[frame, column] = SCALE * values[:, 2:]
    positions = positions[:, np.isfinite(positions[0]).all(axis=1)]  # those with a place at rest
    layout, seen = layout_markers(positions[0]), np.isfinite(positions.sum(axis=2))
    write_archive(Recording(layout, positions, seen, time, np.arange(len(time))), archive)
    print(f"{len(time)} frames of {positions.shape[1]} markers: python -m estimation run {archive}")


if __name__ == "__main__":
    main(*sys.argv[1:])
