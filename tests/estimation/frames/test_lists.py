"""Recordings and layouts of lists."""

import numpy as np
import pytest

from estimation.frames.recording import MarkerLayout, Recording


@pytest.mark.usefixtures("unchecked")
def test_recordings_and_layouts_take_lists():
    layout = MarkerLayout([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[1, 2], [0, 2], [0, 1]])
    positions = [[[0.0, 0.0], [1, 0], [0, 1]], [[0.1, 0.0], [1, 0], [np.nan, np.nan]]]
    valid = [[True, True, True], [1, 1, 0]]
    recording = Recording(layout, positions, valid, [0, 0.1], [0, 1], force=[[0, 0, -1]] * 2)
    assert len(list(recording)) == 2
    assert recording.positions.shape == (2, 3, 2)
    assert recording.valid.dtype == bool
    assert recording.source_index.dtype.kind == "i"
    with pytest.raises(ValueError, match=r"`time` must be a number for each of \(frames\)"):
        Recording(layout, positions, valid, ["now", "then"], [0, 1])
    with pytest.raises(
        ValueError, match=r"`positions` must be a number for each of \(frames and n"
    ):
        Recording(layout, [positions[0], positions[1][:2]], valid, [0, 0.1], [0, 1])
