"""From the rotation of the elastomer's surface to the object's angle.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (9) to (14).

The paper measures the object's angle θ clockwise and the surface's rotation φ counter-clockwise;
the functions named after its equations keep that. `object_rotation` gives both counter-clockwise.
The functions take NumPy or JAX arrays or numbers and return what they were given.
"""

from jaxtyping import Float

from contactmodel.arrays import AnyArray
from contactmodel.kinematics import slip_curl


def clockwise_object_angle(
    rotation: Float[AnyArray, "*batch"] | float,
    stiffness_ratio: Float[AnyArray, "*#batch"] | float = 0.0,
    load_term: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"] | float:
    """θ = −(k+1)φ + ½(L_xy − L_yx), clockwise ([Li2024] Eq. 13; with k = L = 0, Eq. 14).

    Of increments between two frames, or of rates, it is Eq. (12): it asks only that the point has
    stuck in between, not ever since the reference.

    Args:
        rotation: φ of a point that has stuck [rad, counter-clockwise].
        stiffness_ratio: k = G_S/G_B, elastomer over object [-].
        load_term: L_xy − L_yx [rad].
    """
    return -(stiffness_ratio + 1.0) * rotation + 0.5 * load_term


def object_rotation(
    rotation: Float[AnyArray, "*batch"] | float,
    stiffness_ratio: Float[AnyArray, "*#batch"] | float = 0.0,
    load_term: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"] | float:
    """The object's rotation, counter-clockwise like φ: [Li2024] Eq. (13) with the sign turned.

    Arguments as for `clockwise_object_angle`.
    """
    return -clockwise_object_angle(rotation, stiffness_ratio, load_term)


def slip_curl_of_rotation(
    rotation: Float[AnyArray, "*batch"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float,
    load_term: Float[AnyArray, "*#batch"] | float,
    clockwise: Float[AnyArray, "*#batch"] | float,
) -> Float[AnyArray, "*batch"]:
    """rot(s) = −2(k+1)φ + (L_xy − L_yx) − 2θ ([Li2024] Eq. 9), for increments, rates or totals.

    Args:
        rotation: φ of the elastomer's surface [rad].
        stiffness_ratio: k [-].
        load_term: L_xy − L_yx [rad].
        clockwise: θ of the object, clockwise [rad].
    """
    return slip_curl(2.0 * rotation, stiffness_ratio, load_term, clockwise)


def rotation_difference(
    slip_curl_difference: Float[AnyArray, "*batch"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"]:
    """φ_i − φ_j = −rot(s_i − s_j)/2(k+1) ([Li2024] Eq. 11; of rates, Eq. 10).

    Args:
        slip_curl_difference: rot(s_i) − rot(s_j) [-].
        stiffness_ratio: k [-].
    """
    return -slip_curl_difference / (2.0 * (stiffness_ratio + 1.0))


def slip_curl_difference(
    rotation: Float[AnyArray, "*batch"],
    stick_rotation: Float[AnyArray, "*#batch"] | float,
    stiffness_ratio: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"]:
    """rot(s) of a point, from its rotation and that of a point that sticks ([Li2024] Eq. 11).

    Eq. (11), φ_i − φ_j = −rot(s_i − s_j)/2(k+1), solved for the curl at i with rot(s_j) = 0.

    Args:
        rotation: φ_i [rad].
        stick_rotation: φ_j of the sticking point [rad].
        stiffness_ratio: k [-].
    """
    return -2.0 * (stiffness_ratio + 1.0) * (rotation - stick_rotation)
