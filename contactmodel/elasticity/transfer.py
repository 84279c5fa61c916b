"""Compliance of half-spaces and layers by wave, and its effect on the object's rotation.

[Burmister1945] D. M. Burmister, "The general theory of stresses and displacements in layered
systems"; solved here for one layer on a rigid base. The functions are dimensionless: x = qh, where
q is the wave number and h the thickness. A compliance is δ/(Gq).

In Fourier space (e^{+iq·r}) the traction along q (L) and the pressure are coupled. The traction
across q (T) is not: û_L = C_LL τ_L + iC_Lp p, ŵ = C_zz p − iC_zL τ_L, û_T = C_TT τ_T.

[Li2024] is the paper of `equations`. Its Eqs. (2) and (13) contain a number k = G_S/G_B and a load
term L. If both bodies are uniform along the surface, only the transverse part of the traction turns
the surface. Every wave q turns S and B in opposite senses, in the ratio k̂(q) of their transverse
compliances, wherever the contact slides. For two half-spaces k̂ = k. For a layer k̂ depends on q, and
the number k is a projection.
"""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from contactmodel.common.arrays import AnyArray, Value, as_arrays, root


class Transfer(NamedTuple):
    """Displacement under waves of unit traction, times Gq [-]."""

    transverse: AnyArray  # û_T by τ_T
    longitudinal: AnyArray  # û_L by τ_L
    normal: AnyArray  # ŵ by p
    pull: AnyArray  # û_L by p, over i
    lift: AnyArray  # ŵ by τ_L, over −i


def half_space_transfer(depth: Float[AnyArray, "*waves"], poisson_ratio: Value) -> Transfer:
    """Transfer functions of a half-space.

    Args:
        depth: qz, depth times wave number [-].
        poisson_ratio: ν [-].
    """
    xp, depth, nu = as_arrays(depth, poisson_ratio)
    fade = xp.exp(-depth)
    return Transfer(
        transverse=fade,
        longitudinal=((1.0 - nu) - 0.5 * depth) * fade,
        normal=((1.0 - nu) + 0.5 * depth) * fade,
        pull=0.5 * ((1.0 - 2.0 * nu) - depth) * fade,
        lift=0.5 * ((1.0 - 2.0 * nu) + depth) * fade,
    )


def base_transfer(x: Float[AnyArray, "*waves"], poisson_ratio: Value, depth: Value) -> Transfer:
    """Transfer functions of a bonded layer minus a half-space's, without cancellation.

    Args:
        x: qh, thickness times wave number [-].
        poisson_ratio: ν [-].
        depth: z/h, from 0 at the surface to 1 at the base [-].
    """
    xp, x, nu, depth = as_arrays(x, poisson_ratio, depth)
    z, y = x * depth, x * (1.0 - depth)
    s, f = 3.0 - 4.0 * nu, 0.25 / (1.0 - nu)
    twice = xp.exp(-2.0 * x)  # once down to the base and back
    down, up = xp.exp(-z), xp.exp(z - 2.0 * x)  # to the point from above, from the base
    c = 2.0 * x**2 + 5.0 - 12.0 * nu + 8.0 * nu**2
    det = 0.5 * s * (1.0 + twice**2) + c * twice
    one = xp.ones_like(z)
    t = 2.0 * f * (1.0 - 2.0 * nu)
    # displacement at y above the base and surface traction by growing and decaying waves
    rise = _matrix(xp, s + y, y, -y, s - y)
    fall = _matrix(xp, y - s, -y, y, -s - y)
    grow = _matrix(xp, one - 2.0 * f * x, t - 2.0 * f * x, t + 2.0 * f * x, one + 2.0 * f * x)
    decay = _matrix(xp, one + 2.0 * f * x, -t - 2.0 * f * x, -t + 2.0 * f * x, one - 2.0 * f * x)
    waves = up * _times(xp, fall, grow) + twice * (
        down * _times(xp, rise, decay) + up * _times(xp, fall, decay)
    )
    waves = waves / (8.0 * f * det)
    half = half_space_transfer(z, nu)
    less = -twice * (0.5 * s * twice + c) / det
    return Transfer(
        transverse=-(up + down * twice) / (1.0 + twice),
        longitudinal=waves[0, 0] + less * half.longitudinal,
        normal=waves[1, 1] + less * half.normal,
        pull=waves[0, 1] + less * half.pull,
        lift=waves[1, 0] + less * half.lift,
    )


class LayerGain(NamedTuple):
    """Factors of a layer's waves relative to a half-space's, minus 1 [-]."""

    # 1/D − 1, where D is the displacement by transverse waves at the depth over that at the surface
    below: AnyArray
    transverse: AnyArray  # k̂/k − 1 of a layer against a half-space, coth x − 1
    longitudinal: AnyArray  # k̂/k − 1 of longitudinal waves, for two incompressible bodies


def layer_gain(x: Float[AnyArray, "*waves"], depth: Float[AnyArray, "*waves"]) -> LayerGain:
    """Factors, minus 1, that convert the motion of a layer's markers to a half-space's, by wave.

    For two layers, k̂/k is the quotient of their values of 1 + `transverse`.

    Args:
        x: qh, thickness times wave number; infinite for a half-space [-].
        depth: qz, depth times wave number, less than qh [-].

    Examples:
        >>> import numpy as np
        >>> from contactmodel import layer_gain
        >>> thickness, wavelength = 3.0, np.array([6.0, 12.0, 24.0])  # mm
        >>> x = 2 * np.pi / wavelength * thickness
        >>> print(1 + layer_gain(x, np.zeros(3)).transverse.round(2))  # k of the layer over k
        [1.   1.09 1.52]
    """
    xp, x, depth = as_arrays(x, depth)
    x = xp.minimum(x, 1e3)  # the base has no effect there
    at, under = base_transfer(x, 0.5, 0.0), base_transfer(x, 0.5, xp.minimum(depth / x, 1.0))
    fade = half_space_transfer(depth, 0.5).transverse
    return LayerGain(
        below=(at.transverse - under.transverse - xp.expm1(-depth)) / (fade + under.transverse),
        transverse=-at.transverse / (1.0 + at.transverse),
        longitudinal=-at.longitudinal / (0.5 + at.longitudinal),
    )


def ball_gain(x: Float[AnyArray, "*waves"]) -> AnyArray:
    """Rotation of a ball's surface over that of a half-space, wave by wave, minus 1 [-].

    A unit traction that turns a sphere's surface by the harmonic n, u = r̂ × ∇Y_n, displaces it by
    R/(G(n − 1)): inside, u grows like r^n, and the traction is G r d(u/r)/dr. Near the pole this
    wave is the wave q = (n + ½)/R on a half-space, which moves by 1/(Gq). The ball's compliance is
    therefore qR/(qR − 3/2) times the half-space's. n = 1 is a rigid rotation, which the grip
    determines. Waves as long as the ball, n < 2, are treated like n = 2; they depend on the shape
    of the body beyond the contact (`papers.finite_strain.soft`).

    Args:
        x: qR, radius times wave number; infinite for a flat object [-].

    Examples:
        >>> import numpy as np
        >>> from contactmodel import ball_gain
        >>> radius, wavelength = 10.0, np.array([5.0, 10.0, 20.0])  # mm
        >>> print(1 + ball_gain(2 * np.pi / wavelength * radius).round(2))  # k of the ball over k
        [1.14 1.31 1.91]
    """
    xp, x = as_arrays(x)
    return 1.5 / (xp.maximum(x, 2.5) - 1.5)


class ScalarTransfer(NamedTuple):
    """The numbers k and L that replace a transfer function in Eqs. (2) and (13) of [Li2024].

    Attributes:
        stiffness_ratio: k [-].
        load_term: L = L_xy − L_yx with the paper's sign: the object turns by (1 + k) φ − L/2,
            counter-clockwise [rad].
        residual: root mean square of the object's rotation that k and L do not explain [rad].

    Examples:
        >>> import numpy as np
        >>> from contactmodel import fit_scalar_transfer
        >>> gel, every = np.radians([4.0, 5.0, 6.0]), np.full(3, True)
        >>> transfer = fit_scalar_transfer(gel, -0.5 * gel, every)
        >>> turned = (1 + transfer.stiffness_ratio) * gel - transfer.load_term / 2
        >>> print(np.degrees(turned).round(2))  # of the object
        [6.  7.5 9. ]
    """

    stiffness_ratio: Float[AnyArray, ""]
    load_term: Float[AnyArray, ""]
    residual: Float[AnyArray, ""]


def fit_scalar_transfer(
    elastomer_rotation: Float[AnyArray, "*cells"],
    object_rotation: Float[AnyArray, "*cells"],
    region: Bool[AnyArray, "*cells"],
) -> ScalarTransfer:
    """Fit k to the object's rotation over a region, then L to the mean of the residual.

    k is the least-squares fit of ½ rot u_B = −k ½ rot u_S. Both are not fitted together: if
    everything sticks, the two rotations differ by a constant, and the fit would give k = −1.

    Args:
        elastomer_rotation: ½ rot u_S, as returned by `ContactSolution.elastomer_rotation` [rad].
        object_rotation: ½ rot u_B, as returned by `ContactSolution.object_rotation` [rad].
        region: cells to fit, for example those in contact.

    Examples:
        >>> from contactmodel import Contact, Grid, HalfSpace, Pose, Sphere
        >>> from contactmodel import fit_scalar_transfer, solve_contact
        >>> gel, object_ = HalfSpace(0.2, poisson_ratio=0.5), HalfSpace(0.4, poisson_ratio=0.5)
        >>> contact = Contact(gel, object_, Sphere(20.0), Grid((24, 24), (24.0, 24.0)), 0.5)
        >>> solved = solve_contact(contact, Pose(approach=1.0, twist=0.15))
        >>> rotations = solved.elastomer_rotation(), solved.object_rotation()
        >>> print(f"k = {fit_scalar_transfer(*rotations, solved.contact).stiffness_ratio:.3f}")
        k = 0.500
    """
    xp, phi, turned, inside = as_arrays(elastomer_rotation, object_rotation, region)
    weight, opposite = inside.astype(phi.dtype), -turned
    square = xp.sum(weight * phi**2)
    moves = square > 0.0
    k = xp.where(moves, xp.sum(weight * phi * opposite) / xp.where(moves, square, 1.0), 0.0)
    residual = opposite - k * phi
    count = xp.maximum(xp.sum(weight), 1.0)
    mean = xp.sum(weight * residual) / count
    spread = xp.sum(weight * (residual - mean) ** 2) / count
    return ScalarTransfer(k, -2.0 * mean, root(spread))


def _matrix(xp: Any, a: AnyArray, b: AnyArray, c: AnyArray, d: AnyArray) -> AnyArray:
    return xp.stack([xp.stack([a, b]), xp.stack([c, d])])


def _times(xp: Any, left: AnyArray, right: AnyArray) -> AnyArray:
    return xp.einsum("ij...,jk...->ik...", left, right)
