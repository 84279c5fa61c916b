"""How far the object has slipped over the pad: the curl of the slip.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (9).
"""

import numpy as np
from jaxtyping import Float

from contactmodel.rotation import object_rotation, slip_curl_of_rotation
from estimation.result import Result, State


def find_slip_curl(result: Result, frame: int) -> Float[np.ndarray, " n"]:
    """rot(s) at each marker since the angle has been counted ([Li2024] Eq. 9) [rad].

    The object's angle is the estimated one. What sticks now is no measure of it: after a reversal
    the region holds markers that have slipped before. Where the pad was first seen loaded and the
    angle is counted from that frame, so is φ.

    Args:
        result: of one method.
        frame: row of the recording.

    Returns:
        NaN outside the contact region and where the angle is unknown.
    """
    stiffness_ratio = float(result.stiffness_ratio[frame])
    load_term = float(result.load_term[frame])
    start = _counted_from(result, frame)
    rotation = result.rotation[frame] - (0.0 if start is None else result.rotation[start])
    curl = slip_curl_of_rotation(
        rotation, stiffness_ratio, load_term, clockwise=-float(result.angle[frame])
    )
    return np.where(result.contact[frame], np.asarray(curl), np.nan)


def _counted_from(result: Result, frame: int) -> int | None:
    """The frame of this contact whose angle was set to zero; None for the unloaded shape."""
    zero = np.asarray(object_rotation(0.0, result.stiffness_ratio, result.load_term))
    for i in range(frame, -1, -1):
        if result.state[i] == State.NO_CONTACT:
            return None
        if result.angle[i] == zero[i]:
            return i
    return None
