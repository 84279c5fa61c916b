"""The stick region: growth from the stick centre.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (15) and Section IV-B.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from estimation.fields.measure import Fields

MIN_STICK_MARKERS = 3
"""Least number of markers that count as sticking."""
ANGLE_FLOOR_DEG = 2.0
"""Least denominator of Eq. (15): the smallest angle of the range the paper states."""


def normalized_difference(rotation: float, mean: float, floor: float) -> float:
    """|φ_i − φ̄| / sqrt(φ_i φ̄), [Li2024] Eq. (15) [-].

    As printed, it is undefined where φ_i and φ̄ differ in sign or one of them vanishes, which holds
    everywhere before any twist. Here the denominator is at least `floor`, so rotations that are
    small against `floor` are compared with it, whatever their signs.

    Args:
        rotation: φ_i [rad].
        mean: φ̄ [rad].
        floor: least denominator, above 0 [rad].
    """
    product = rotation * mean
    return abs(rotation - mean) / (max(math.sqrt(product), floor) if product > 0.0 else floor)


def grow_stick_region(
    fields: Fields, adjacent: Sequence[Sequence[int]], *, threshold: float, floor: float
) -> Bool[np.ndarray, " n"]:
    """Grow the stick region from the stick centre over neighbours, by [Li2024] Eq. (15).

    Growth is breadth-first, ring by ring: the candidates of a ring are all markers of the contact
    region that adjoin the stick region and do not belong to it yet. They are tried in the order of
    their distance in φ from the region's mean, which is updated after each accepted marker, so the
    result does not depend on the numbering of the markers. Growth ends when a whole ring is
    rejected.

    Args:
        fields: fields of a frame with contact.
        adjacent: indices of each marker's neighbours.
        threshold: Δφ_th [-].
        floor: least denominator of Eq. (15) [rad].
    """
    phi = fields.rotation.tolist()
    free = fields.contact.tolist()
    free[fields.centre] = False
    members, newest = [fields.centre], [fields.centre]
    total = phi[fields.centre]
    rejected: set[int] = set()
    while newest:
        ring = rejected | {j for i in newest for j in adjacent[i] if free[j]}
        mean = total / len(members)
        newest = []
        for j in sorted(ring, key=lambda j, mean=mean: abs(phi[j] - mean)):
            if normalized_difference(phi[j], total / len(members), floor) < threshold:
                free[j] = False
                members.append(j)
                newest.append(j)
                total += phi[j]
        rejected = {j for j in ring if free[j]}
    stick = np.zeros_like(fields.contact)
    stick[members] = True
    return stick
