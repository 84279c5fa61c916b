"""Which markers stick: the stick region and its growth.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (15) and Section IV-B.
"""

import math

import numpy as np
from jaxtyping import Bool, Int

from estimation.fields.measure import Fields

MIN_STICK_MARKERS = 3
ANGLE_FLOOR_DEG = 2.0
"""Least denominator of Eq. (15): the least angle of the range that the paper gives its method."""


def check_positive(name: str, value: float) -> float:
    """The value, if it is a number above 0.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is {value}; it must be a number above 0")
    return value


def check_count(name: str, value: int, least: int = 1) -> int:
    """The value, if it is not below the least that makes sense.

    Raises:
        ValueError: it is not.
    """
    if value < least:
        raise ValueError(f"{name} is {value}; it must be at least {least}")
    return value


def check_share(name: str, value: float) -> float:
    """The value, if it is a share above 0 and at most 1.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 < value <= 1.0:
        raise ValueError(f"{name} is {value}; it must be a share above 0 and at most 1")
    return value


def normalized_difference(rotation: float, mean: float, floor: float) -> float:
    """|φ_i − φ̄| / sqrt(φ_i φ̄), [Li2024] Eq. (15) [-].

    As printed it has no value where φ_i and φ̄ differ in sign or one of them vanishes, and before
    any twist that is everywhere. Here the denominator is never less than `floor`: rotations that
    are small beside it are compared with it, whatever their signs.

    Args:
        rotation: φ_i [rad].
        mean: φ̄ [rad].
        floor: least denominator, above 0 [rad].
    """
    product = rotation * mean
    return abs(rotation - mean) / (max(math.sqrt(product), floor) if product > 0.0 else floor)


def grow_stick_region(
    fields: Fields, neighbours: Int[np.ndarray, "n k"], *, threshold: float, floor: float
) -> Bool[np.ndarray, " n"]:
    """Grow the stick region from the stick centre over neighbours, by [Li2024] Eq. (15).

    Breadth-first, ring by ring: the candidates of a ring are all markers of the contact region
    that adjoin the stick region and do not belong to it yet. They are tried in the order of their
    distance in φ from the region's mean, and the mean is updated after each marker that is taken,
    so that the result does not depend on how the markers are numbered. Growth ends when a whole
    ring has been refused.

    Args:
        fields: of a frame with contact.
        neighbours: indices of neighbours, filled up with −1.
        threshold: Δφ_th [-].
        floor: least denominator of Eq. (15) [rad].
    """
    phi = fields.rotation.tolist()
    free = fields.contact.tolist()
    adjacent = neighbours.tolist()
    free[fields.centre] = False
    members, newest = [fields.centre], [fields.centre]
    total = phi[fields.centre]
    refused: set[int] = set()
    while newest:
        ring = refused | {j for i in newest for j in adjacent[i] if j >= 0 and free[j]}
        mean = total / len(members)
        newest = []
        for j in sorted(ring, key=lambda j, mean=mean: abs(phi[j] - mean)):
            if normalized_difference(phi[j], total / len(members), floor) < threshold:
                free[j] = False
                members.append(j)
                newest.append(j)
                total += phi[j]
        refused = {j for j in ring if free[j]}
    stick = np.zeros_like(fields.contact)
    stick[members] = True
    return stick
