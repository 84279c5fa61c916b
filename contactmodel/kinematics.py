"""Local kinematics of the contact: rotation of surface elements, slip of a pair of points.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (1) to (8).

Angles are in rad, counter-clockwise positive seen from +z, and finite unless a name says `small`.
The paper's angle θ of the object is clockwise; where an argument is that one it is called
`clockwise`. k = G_S/G_B is the elastomer's shear modulus over the object's, l_mn what Eq. (2)
leaves over.
The functions take NumPy or JAX arrays and return what they were given.
"""

from jaxtyping import Float

from contactmodel.arrays import AnyArray


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

    Δs = Δr_B + Δr_c + ΔR (r_B + Δr_B) − Δr_S; it holds for any size of rotation and deformation.

    Args:
        elastomer_displacement: Δr_S in the sensor's frame [mm].
        object_displacement: Δr_B in the object's frame, which turns with it [mm].
        object_position: r_B before the motion [mm].
        shift: Δr_c of the object's frame [mm].
        rotation_change: ΔR = R − I of the object's frame.
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

    Component by component it is approximate, for half-spaces too; for them the curl of it is
    exact, with l_xy − l_yx = 0.

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

    It is the same whether the derivative is taken at fixed undeformed position or at the position
    now; for Eq. (3) as it stands in the paper see `slip_shear_as_printed`.

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
    """[Li2024] Eq. (3) as printed, its rigid part (cos θ − 1) sin θ + sin θ cos θ.

    That part is sin θ to first order only, and 12 % below it at 20°. Arguments as for `slip_shear`.
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
    """rot s = −(k+1) rot u_S + (l_xy − l_yx) − 2θ ([Li2024] Eq. 6, which is Eq. 5 less Eq. 4).

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

    It is the rotation for small gradients only: a rotation by φ reads sin φ.

    Args:
        displacement_gradient: `[..., i, j]` is ∂u_i/∂x_j [-].
    """
    return 0.5 * (displacement_gradient[..., 1, 0] - displacement_gradient[..., 0, 1])


def line_element_rotations(
    deformation_gradient: Float[AnyArray, "*batch 2 2"],
) -> tuple[Float[AnyArray, "*batch"], Float[AnyArray, "*batch"]]:
    """Angles by which the line elements along x (AB) and along y (AC) have turned.

    The finite form of [Li2024] Eq. (7): the rates ∂u_v/∂u and −∂u_u/∂v of the two elements,
    followed to their angle. For small gradients they are the rates times the time.

    Args:
        deformation_gradient: F, `[..., i, j]` is ∂x_i/∂X_j [-].
    """
    f = deformation_gradient
    xp = f.__array_namespace__()
    return xp.atan2(f[..., 1, 0], f[..., 0, 0]), xp.atan2(-f[..., 0, 1], f[..., 1, 1])


def mean_line_rotation(
    deformation_gradient: Float[AnyArray, "*batch 2 2"],
) -> Float[AnyArray, "*batch"]:
    """Mean angle of the two orthogonal line elements ([Li2024] Eq. 8 for finite rotations).

    Exact for a rotation by less than half a turn; near it, strain may put one element beyond and
    the mean is wrong by half a turn. Under strain it is not the rotation: it depends on which
    two elements were chosen, and its mean over all choices is `polar_rotation`.
    """
    along_x, along_y = line_element_rotations(deformation_gradient)
    return 0.5 * (along_x + along_y)


def polar_rotation(
    deformation_gradient: Float[AnyArray, "*batch 2 2"],
) -> Float[AnyArray, "*batch"]:
    """Angle of the rotation R of the polar decomposition F = R U, whatever the stretch U."""
    f = deformation_gradient
    xp = f.__array_namespace__()
    return xp.atan2(f[..., 1, 0] - f[..., 0, 1], f[..., 0, 0] + f[..., 1, 1])
