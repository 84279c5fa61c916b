"""Separate contacts on one pad, recognised by the valleys between them.

Each contact is a peak of the indentation. Two peaks are two contacts if every way from one to the
other goes through gel that is much less indented than the shallower of them. The textured face of
one object has valleys too, but its peaks move as one body, so each of them shows its turn.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from estimation.fields.stencils import Stencils, mean_around


def separate(
    stencils: Stencils, indentation: Float[np.ndarray, " n"], onset_mm: float
) -> Int[np.ndarray, " n"] | None:
    """The contact that each marker belongs to; None if there are not two or more.

    Args:
        stencils: stencils of the layout.
        indentation: displacement into the gel, NaN where unknown [mm].
        onset_mm: indentation from which a peak is a contact, also above the way to another [mm].

    Returns:
        A label of each marker: the index of its contact's deepest marker. Markers around the
        contacts belong to the nearest one.
    """
    shallow = 0.2  # share of the largest indentation below which the way between peaks is unknown
    least = 3  # markers of a contact
    smooth = mean_around(stencils, indentation)
    bound = shallow * smooth.max(initial=0.0)
    pressed = smooth > bound
    label = _merge(stencils, smooth, pressed, _climb(stencils, smooth), onset_mm)
    peaks, counts = np.unique(label[pressed], return_counts=True)
    peaks = peaks[(counts >= least) & (_highest_pass(smooth[peaks], onset_mm) > bound)]
    if len(peaks) < 2:
        return None
    known = pressed & np.isin(label, peaks)
    points = stencils.reference
    away = np.linalg.norm(points[:, None] - points[known], axis=2)
    return np.where(known, label, label[known][away.argmin(axis=1)])


def _climb(stencils: Stencils, height: Float[np.ndarray, " n"]) -> Int[np.ndarray, " n"]:
    """The peak that each marker reaches by the steepest way up."""
    rows = np.arange(len(height))[:, None]
    around = np.hstack([rows, np.where(stencils.neighbours >= 0, stencils.neighbours, rows)])
    steepest = height[around].argmax(axis=1)[:, None]
    goal = np.take_along_axis(around, steepest, axis=1)[:, 0]
    while not np.array_equal(goal[goal], goal):
        goal = goal[goal]
    return goal


def _highest_pass(peak: Float[np.ndarray, " n"], onset_mm: float) -> Float[np.ndarray, " n"]:
    """Height of a pass, below which the peaks on both sides are two contacts [mm]."""
    return np.minimum(0.75 * peak, peak - onset_mm)


def _merge(
    stencils: Stencils,
    height: Float[np.ndarray, " n"],
    pressed: Bool[np.ndarray, " n"],
    label: Int[np.ndarray, " n"],
    onset_mm: float,
) -> Int[np.ndarray, " n"]:
    """The labels, after peaks without a valley as deep as the onset between them became one."""
    one, slot = np.nonzero(stencils.neighbours >= 0)
    other = stencils.neighbours[one, slot]
    passes = pressed[one] & pressed[other] & (label[one] != label[other])
    one, other = one[passes], other[passes]
    level, most = np.minimum(height[one], height[other]), _highest_pass(height, onset_mm)
    for i in np.argsort(-level):  # the highest pass first
        high, low = sorted((label[one[i]], label[other[i]]), key=lambda peak: -height[peak])
        if level[i] >= most[low]:
            label = np.where(label == low, high, label)
    return label
