"""Table of your marker positions to a recording: `python examples/markers_table.py T.csv T.npz`."""

import sys

import numpy as np

from estimation import Recording, layout_markers, write_archive

SCALE = 1.0  # mm per unit of the table: 1000.0 if its lengths are in m


def main(table: str, archive: str) -> None:
    """Convert columns time_s, marker, x, y and perhaps z; the first time shows the bare pad."""
    rows = np.genfromtxt(table, delimiter=",", names=True)
    names = rows.dtype.names or ()
    if not {"time_s", "marker", "x", "y"} <= set(names):
        raise SystemExit(f"{table} must begin with a line like: time_s,marker,x,y,z")
    time, frame = np.unique(rows["time_s"], return_inverse=True)  # in order of time
    markers, column = np.unique(rows["marker"], return_inverse=True)  # in any order in the table
    axes = [rows[name] for name in ("x", "y", "z") if name in names]
    positions = np.full((len(time), len(markers), len(axes)), np.nan)  # NaN: not seen
    positions[frame, column] = SCALE * np.stack(axes, axis=1)
    positions = positions[:, np.isfinite(positions[0]).all(axis=1)]  # those with a place at rest
    layout, seen = layout_markers(positions[0]), np.isfinite(positions.sum(axis=2))
    write_archive(Recording(layout, positions, seen, time, np.arange(len(time))), archive)
    print(f"{len(time)} frames of {positions.shape[1]} markers: python -m estimation run {archive}")


if __name__ == "__main__":
    main(*sys.argv[1:])
