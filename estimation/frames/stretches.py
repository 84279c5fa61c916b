"""Stretches of a recording: frames in a row for which something holds."""

import numpy as np
from jaxtyping import Bool


def find_stretches(flags: Bool[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """The first row of each stretch of True, and the row after its last."""
    edges = np.flatnonzero(np.diff(np.pad(flags, 1).astype(int)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
