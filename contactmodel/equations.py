"""Eqs. (1) to (14) of the source paper as functions.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".

| Eq. | function |
|---|---|
| 1 | `pair_slip`, `rotation_change` |
| 2 | `object_gradient` |
| 3 | `slip_shear`, `slip_shear_as_printed` |
| 4, 5 | `small_slip_shears` |
| 6 | `slip_curl` |
| 7, 8 | `line_element_rotations`, `mean_line_rotation`, `small_rotation`, `polar_rotation` |
| 9 | `slip_curl_of_rotation` |
| 10, 11 | `rotation_difference`, `slip_curl_difference` |
| 12, 13, 14 | `clockwise_object_angle`, `object_rotation` |

Angles are in rad, counter-clockwise positive seen from +z, and of any size unless a name contains
`small`. The paper's angle θ of the object is clockwise. Functions named after its equations keep
this sign and call the argument `clockwise`. `object_rotation` is counter-clockwise.
k = G_S/G_B is the elastomer's shear modulus over the object's; l_mn is the remainder of Eq. (2).
The functions take NumPy arrays, JAX arrays or numbers and return the same kind.
"""

from jaxtyping import Float

from contactmodel.common.arrays import AnyArray


def rotation_change(angle: Float[AnyArray, "*batch"]) -> Float[AnyArray, "*batch 2 2"]:
    """ΔR = R − I of a counter-clockwise rotation, the matrix of [Li2024] Eq. (1)."""
    xp = angle.__array_namespace__()
    sine, versine = xp.sin(angle), 2.0 * xp.sin(0.5 * angle) ** 2
    return xp.stack([xp.stack([-versine, -sine], -1), xp.stack([sine, -versine], -1)], -2)


def pair_slip(
    elastomer_displacement: Float[AnyArray, "*batch 2"],
    object_displacement: Float[AnyArray, "*batch 2"],
    object_position: Float[AnyArray, "*batch 2"],
    shift: Float[AnyArray, "*#batch 2"],
    rotation_change: Float[AnyArray, "*#batch 2 2"],
) -> Float[AnyArray, "*batch 2"]:
    """Slip Δs of a point of the object against its partner on the elastomer ([Li2024] Eq. 1).

    Δs = Δr_B + Δr_c + ΔR (r_B + Δr_B) − Δr_S, for rotations and deformations of any size.

    Args:
        elastomer_displacement: Δr_S in the sensor's frame [mm].
        object_displacement: Δr_B in the object's frame, which turns with the object [mm].
        object_position: r_B before the motion [mm].
        shift: Δr_c of the object's frame [mm].
        rotation_change: ΔR = R − I of the object's frame [-].
    """
    moved = object_position + object_displacement
    turned = (rotation_change @ moved[..., None])[..., 0]
    return object_displacement + shift + turned - elastomer_displacement


def object_gradient(
    elastomer_gradient: Float[AnyArray, "*batch"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float,
    load_term: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"]:
    """D_m u_B,n ≈ −k D_m u_S,n + l_mn ([Li2024] Eq. 2).

    Each component is approximate, even for half-spaces. For half-spaces the curl is exact, with
    l_xy − l_yx = 0.

    Args:
        elastomer_gradient: D_m u_S,n [-].
        stiffness_ratio: k [-].
        load_term: l_mn [-].
    """
    return -stiffness_ratio * elastomer_gradient + load_term


def slip_shear(
    elastomer_gradient: Float[AnyArray, "*batch"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float,
    load_term: Float[AnyArray, "*#batch"] | float,
    clockwise: Float[AnyArray, "*#batch"],
) -> Float[AnyArray, "*batch"]:
    """D_y s_x = −(k+1) D_y u_S,x + l_yx + sin θ: [Li2024] Eq. (3) with the exact rigid part.

    The rigid part is the same for derivatives by the undeformed and by the present position. For
    Eq. (3) as printed, see `slip_shear_as_printed`.

    Args:
        elastomer_gradient: D_y u_S,x [-].
        stiffness_ratio: k [-].
        load_term: l_yx [-].
        clockwise: θ [rad].
    """
    xp = clockwise.__array_namespace__()
    stretch = object_gradient(elastomer_gradient, stiffness_ratio, load_term)
    return stretch - elastomer_gradient + xp.sin(clockwise)


def slip_shear_as_printed(
    elastomer_gradient: Float[AnyArray, "*batch"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float,
    load_term: Float[AnyArray, "*#batch"] | float,
    clockwise: Float[AnyArray, "*#batch"],
) -> Float[AnyArray, "*batch"]:
    """[Li2024] Eq. (3) as printed, with the rigid part (cos θ − 1) sin θ + sin θ cos θ.

    This part equals sin θ only to first order, and is 12 % below it at 20°. Arguments as for
    `slip_shear`.
    """
    xp = clockwise.__array_namespace__()
    sine, cosine = xp.sin(clockwise), xp.cos(clockwise)
    stretch = object_gradient(elastomer_gradient, stiffness_ratio, load_term)
    return stretch - elastomer_gradient + (cosine - 1.0) * sine + sine * cosine


def small_slip_shears(
    elastomer_gradient: Float[AnyArray, "*batch 2 2"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float,
    load_terms: tuple[Float[AnyArray, "*#batch"] | float, Float[AnyArray, "*#batch"] | float],
    clockwise: Float[AnyArray, "*#batch"] | float,
) -> tuple[Float[AnyArray, "*batch"], Float[AnyArray, "*batch"]]:
    """D_y s_x and D_x s_y for small angles ([Li2024] Eqs. 4 and 5).

    Args:
        elastomer_gradient: `[..., i, j]` is ∂u_i/∂x_j of the elastomer [-].
        stiffness_ratio: k [-].
        load_terms: l_yx and l_xy [-].
        clockwise: θ = Ω Δt [rad].
    """
    across = object_gradient(elastomer_gradient[..., 0, 1], stiffness_ratio, load_terms[0])
    along = object_gradient(elastomer_gradient[..., 1, 0], stiffness_ratio, load_terms[1])
    return (
        across - elastomer_gradient[..., 0, 1] + clockwise,
        along - elastomer_gradient[..., 1, 0] - clockwise,
    )


def slip_curl(
    elastomer_curl: Float[AnyArray, "*batch"],
    stiffness_ratio: Float[AnyArray, "*#batch"] | float,
    load_term: Float[AnyArray, "*#batch"] | float,
    clockwise: Float[AnyArray, "*#batch"] | float,
) -> Float[AnyArray, "*batch"]:
    """rot s = −(k+1) rot u_S + (l_xy − l_yx) − 2θ ([Li2024] Eq. 6, which is Eq. 5 minus Eq. 4).

    Args:
        elastomer_curl: rot u_S = ∂u_y/∂x − ∂u_x/∂y [-].
        stiffness_ratio: k [-].
        load_term: l_xy − l_yx [-].
        clockwise: θ = Ω Δt [rad].
    """
    return -(stiffness_ratio + 1.0) * elastomer_curl + load_term - 2.0 * clockwise


def small_rotation(
    displacement_gradient: Float[AnyArray, "*batch 2 2"],
) -> Float[AnyArray, "*batch"]:
    """Half the curl of the displacement, ½(∂u_y/∂x − ∂u_x/∂y) ([Li2024] Eq. 8, integrated).

    It equals the rotation only for small gradients: for a rotation by φ it is sin φ.

    Args:
        displacement_gradient: `[..., i, j]` is ∂u_i/∂x_j [-].
    """
    return 0.5 * (displacement_gradient[..., 1, 0] - displacement_gradient[..., 0, 1])


def line_element_rotations(
    deformation_gradient: Float[AnyArray, "*batch 2 2"],
) -> tuple[Float[AnyArray, "*batch"], Float[AnyArray, "*batch"]]:
    """Rotation angles of the line elements along x (AB) and along y (AC) [rad].

    This is the finite form of [Li2024] Eq. (7): the rates ∂u_v/∂u and −∂u_u/∂v of the two elements,
    integrated to angles. For small gradients the angles are rate times time.

    Args:
        deformation_gradient: F, `[..., i, j]` is ∂x_i/∂X_j [-].
    """
    f = deformation_gradient
    xp = f.__array_namespace__()
    return xp.atan2(f[..., 1, 0], f[..., 0, 0]), xp.atan2(-f[..., 0, 1], f[..., 1, 1])


def mean_line_rotation(
    deformation_gradient: Float[AnyArray, "*batch 2 2"],
) -> Float[AnyArray, "*batch"]:
    """Mean rotation of two orthogonal line elements ([Li2024] Eq. 8 for finite rotations) [rad].

    It is exact for a rotation by less than half a turn. Near half a turn, strain may carry one
    element beyond it, and the mean is wrong by half a turn. Under strain it is not the rotation:
    it depends on the choice of the two elements. Its mean over all choices is `polar_rotation`.

    Args:
        deformation_gradient: F, `[..., i, j]` is ∂x_i/∂X_j [-].
    """
    along_x, along_y = line_element_rotations(deformation_gradient)
    return 0.5 * (along_x + along_y)


def polar_rotation(
    deformation_gradient: Float[AnyArray, "*batch 2 2"],
) -> Float[AnyArray, "*batch"]:
    """Angle of the rotation R in the polar decomposition F = R U, for any stretch U [rad].

    Args:
        deformation_gradient: F, `[..., i, j]` is ∂x_i/∂X_j [-].
    """
    f = deformation_gradient
    xp = f.__array_namespace__()
    return xp.atan2(f[..., 1, 0] - f[..., 0, 1], f[..., 0, 0] + f[..., 1, 1])


def clockwise_object_angle(
    rotation: Float[AnyArray, "*batch"] | float,
    stiffness_ratio: Float[AnyArray, "*#batch"] | float = 0.0,
    load_term: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"] | float:
    """θ = −(k+1)φ + ½(L_xy − L_yx), clockwise ([Li2024] Eq. 13; with k = L = 0, Eq. 14).

    For increments between two frames, or for rates, it is Eq. (12). That requires the point to
    stick between the two frames, but not since the reference.

    Args:
        rotation: φ of a sticking point [rad, counter-clockwise].
        stiffness_ratio: k = G_S/G_B, elastomer over object [-].
        load_term: L_xy − L_yx [rad].
    """
    return -(stiffness_ratio + 1.0) * rotation + 0.5 * load_term


def object_rotation(
    rotation: Float[AnyArray, "*batch"] | float,
    stiffness_ratio: Float[AnyArray, "*#batch"] | float = 0.0,
    load_term: Float[AnyArray, "*#batch"] | float = 0.0,
) -> Float[AnyArray, "*batch"] | float:
    """The object's rotation, counter-clockwise like φ: [Li2024] Eq. (13) with the opposite sign.

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
    """φ_i − φ_j = −rot(s_i − s_j)/2(k+1) ([Li2024] Eq. 11; for rates, Eq. 10).

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
    """rot(s) of a point, from its rotation and that of a sticking point ([Li2024] Eq. 11).

    Eq. (11), φ_i − φ_j = −rot(s_i − s_j)/2(k+1), is solved for the curl at i with rot(s_j) = 0.

    Args:
        rotation: φ_i [rad].
        stick_rotation: φ_j of the sticking point [rad].
        stiffness_ratio: k [-].
    """
    return -2.0 * (stiffness_ratio + 1.0) * (rotation - stick_rotation)
