"""What waves do to a half-space and to a layer, and what that makes of the object's rotation.

[Burmister1945] D. M. Burmister, "The general theory of stresses and displacements in layered
systems"; here solved for one layer on a rigid base. The functions are dimensionless: x = qh, q the
wave number and h the thickness; a compliance is δ/(Gq).

In Fourier space (e^{+iq·r}) the traction along q (L) and the pressure couple, the traction across
q (T) does not: û_L = C_LL τ_L + iC_Lp p, ŵ = C_zz p − iC_zL τ_L, û_T = C_TT τ_T.

[Li2024] is the paper of `equations`: Eq. (2) and (13) have a number k = G_S/G_B and a load term L.
On bodies that are alike along the surface only the transverse part of the traction turns it, and
every wave q of it turns S and B in opposite senses in the ratio k̂(q) of their transverse
compliances, whatever slides. Of two half-spaces k̂ is k; of a layer it depends on q, and the number
k is a projection.
"""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from contactmodel.common.arrays import AnyArray, Value, as_arrays


class Transfer(NamedTuple):
    """Displacement by the waves of a unit traction, times Gq [-].

    Attributes:
        transverse: û_T by τ_T.
        longitudinal: û_L by τ_L.
        normal: ŵ by p.
        pull: û_L by p, over i.
        lift: ŵ by τ_L, over −i.
    """

    transverse: AnyArray
    longitudinal: AnyArray
    normal: AnyArray
    pull: AnyArray
    lift: AnyArray


def half_space_transfer(depth: Float[AnyArray, "*waves"], poisson_ratio: Value) -> Transfer:
    """Of a half-space.

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
    """Of a bonded layer, less that of a half-space; no difference of large numbers.

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
    """By how much more than a thick elastomer's a layer's waves count, less 1 [-].

    Attributes:
        below: 1/D − 1, D the motion by transverse waves at the depth over that at the surface.
        transverse: k̂/k − 1 against a half-space, coth x − 1.
        longitudinal: the same of longitudinal waves, both bodies incompressible.
    """

    below: AnyArray
    transverse: AnyArray
    longitudinal: AnyArray


def layer_gain(x: Float[AnyArray, "*waves"], depth: Float[AnyArray, "*waves"]) -> LayerGain:
    """Factors, less 1, that turn what a layer's markers show into a half-space's, wave by wave.

    Between two layers k̂/k is the quotient of their 1 + `transverse`.

    Args:
        x: qh, thickness times wave number; infinite for a half-space [-].
        depth: qz, depth times wave number, below qh [-].

    Examples:
        >>> import numpy as np
        >>> from contactmodel import layer_gain
        >>> thickness, wavelength = 3.0, np.array([6.0, 12.0, 24.0])  # mm
        >>> x = 2 * np.pi / wavelength * thickness
        >>> print(1 + layer_gain(x, np.zeros(3)).transverse.round(2))  # k of the layer over k
        [1.   1.09 1.52]
    """
    xp, x, depth = as_arrays(x, depth)
    x = xp.minimum(x, 1e3)  # nothing is left of the base there
    at, under = base_transfer(x, 0.5, 0.0), base_transfer(x, 0.5, xp.minimum(depth / x, 1.0))
    fade = half_space_transfer(depth, 0.5).transverse
    return LayerGain(
        below=(at.transverse - under.transverse - xp.expm1(-depth)) / (fade + under.transverse),
        transverse=-at.transverse / (1.0 + at.transverse),
        longitudinal=-at.longitudinal / (0.5 + at.longitudinal),
    )


def ball_gain(x: Float[AnyArray, "*waves"]) -> AnyArray:
    """By how much more a ball's surface turns than a half-space's, wave by wave, less 1 [-].

    A traction on a sphere that turns its surface by the harmonic n, u = r̂ × ∇Y_n, moves it by
    R/(G(n − 1)): inside, u grows like r^n, and the traction is G r d(u/r)/dr. Seen from near its
    pole the wave is that of number q = (n + ½)/R on a half-space, which moves by 1/(Gq). So the
    ball's compliance is qR/(qR − 3/2) of that; n = 1 is a rigid turn, which is the grip's, and
    waves as long as the ball, n < 2, count like n = 2.

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
        load_term: L = L_xy − L_yx, in the paper's sign as everywhere: the object turns by
            (1 + k) φ − L/2, counter-clockwise [rad].
        residual: root mean square of what they leave of the object's rotation [rad].

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
    """The k that follows the object's rotation best over a region, and the mean L left there.

    Least squares of ½ rot u_B = −k ½ rot u_S, then the mean of the rest. Both at once would not
    do: where everything sticks the two rotations differ by a constant, and k = −1 would fit.

    Args:
        elastomer_rotation: ½ rot u_S, as `ContactSolution.elastomer_rotation` has it [rad].
        object_rotation: ½ rot u_B [rad].
        region: cells to fit, those in contact for example.

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
    rest = opposite - k * phi
    count = xp.maximum(xp.sum(weight), 1.0)
    mean = xp.sum(weight * rest) / count
    spread = xp.sum(weight * (rest - mean) ** 2) / count
    root = xp.sqrt(xp.where(spread > 0.0, spread, 1.0)) * (spread > 0.0)
    return ScalarTransfer(k, -2.0 * mean, root)


def _matrix(xp: Any, a: AnyArray, b: AnyArray, c: AnyArray, d: AnyArray) -> AnyArray:
    return xp.stack([xp.stack([a, b]), xp.stack([c, d])])


def _times(xp: Any, left: AnyArray, right: AnyArray) -> AnyArray:
    return xp.einsum("ij...,jk...->ik...", left, right)
