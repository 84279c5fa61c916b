"""Local kinematics of the contact: rotation of surface elements, slip of a pair of points.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (7) and (8).

Angles are in rad, counter-clockwise positive seen from +z, and finite unless a name says `small`.
The functions take NumPy or JAX arrays and return what they were given.
"""

from jaxtyping import Float

from contactmodel.arrays import AnyArray


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

    Exact for a rotation of any size. Under strain it is not the rotation: it depends on which
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
