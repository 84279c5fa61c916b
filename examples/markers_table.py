"""Table of your marker positions to a recording: `python examples/markers_table.py T.csv T.npz`."""

import sys
from pathlib import Path

import numpy as np

from contactmodel.common.inputs import cell_number, read_rows
from estimation import Recording, layout_markers, write_archive

SCALE = 1.0  # mm per unit of the table: 1000.0 if its lengths are in m


def main(table: str, archive: str) -> None:
    """Convert columns time_s, marker, x, y and perhaps z; the first time shows the bare pad."""
    rows = read_rows(Path(table), names := ["time_s", "marker", "x", "y"])
    names += ["z"] if rows and "z" in rows[0][1] else []
    values = np.array([[cell_number(r[n] or "nan", f"{at}: {n}") for n in names] for at, r in rows])
    (time, frame), (markers, column) = (np.unique(v, return_inverse=True) for v in values.T[:2])
    assert len(np.unique(values[:, :2], axis=0)) == len(rows), "a marker is twice at one time"
    positions = np.full((len(time), len(markers), len(names) - 2), np.nan)  # NaN: not seen
    positions[frame, column] = SCALE * values[:, 2:]
    positions = positions[:, np.isfinite(positions[0]).all(axis=1)]  # those with a place at rest
    layout, seen = layout_markers(positions[0]), np.isfinite(positions.sum(axis=2))
    write_archive(Recording(layout, positions, seen, time, np.arange(len(time))), archive)
    print(f"{len(time)} frames, {seen.shape[1]} of {len(markers)} markers are in the first one")


if __name__ == "__main__":
    main(*sys.argv[1:])
