"""How the object's rotation follows the elastomer's when one of them is a layer.

[Li2024] is the paper of `kinematics`: Eq. (2) and (13) have a number k = G_S/G_B and a load term L.
On bodies that are alike along the surface only the transverse part of the traction turns it, and
every wave q of it turns S and B in opposite senses in the ratio k(q) of their transverse
compliances, whatever slides. Of two half-spaces k(q) is k; of a layer it depends on q, and the
number k is a projection.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from contactmodel.arrays import AnyArray
from contactmodel.bodies import AbstractBody
from contactmodel.solution import ContactSolution


def transfer_function(
    elastomer: AbstractBody, object_: AbstractBody, wave_number: Float[AnyArray, "*waves"]
) -> Float[Array, "*waves"]:
    """k(q): rotation of the object's surface by that of the elastomer's, with the sign changed [-].

    Args:
        elastomer: S.
        object_: B.
        wave_number: q, above 0 [1/mm].
    """
    return object_.turning(wave_number) / elastomer.turning(wave_number)


class ScalarTransfer(NamedTuple):
    """The numbers that stand for a transfer function in Eq. (2) and (13) of [Li2024].

    Attributes:
        stiffness_ratio: k [-].
        load_term: L = L_xy − L_yx, in the paper's sign as everywhere: the object turns by
            (1 + k) φ − L/2, counter-clockwise [rad].
        residual: root mean square of what they leave of the object's rotation [rad].
    """

    stiffness_ratio: Float[Array, ""]
    load_term: Float[Array, ""]
    residual: Float[Array, ""]


def fit_scalar_transfer(
    solution: ContactSolution, region: Bool[AnyArray, "nx ny"] | None = None
) -> ScalarTransfer:
    """The k that follows the object's rotation best over a region, and the mean L left there.

    Least squares of ½ rot u_B = −k ½ rot u_S, then the mean of the rest. Both at once would not
    do: where everything sticks the two rotations differ by a constant, and k = −1 would fit.

    Args:
        solution: one contact.
        region: cells to fit; the cells in contact if not given.
    """
    weight = (solution.contact if region is None else jnp.asarray(region)).astype(float)
    phi, opposite = solution.elastomer_rotation(), -solution.object_rotation()
    square = jnp.sum(weight * phi**2)
    turned = square > 0.0
    k = jnp.where(turned, jnp.sum(weight * phi * opposite) / jnp.where(turned, square, 1.0), 0.0)
    rest = opposite - k * phi
    count = jnp.maximum(jnp.sum(weight), 1.0)
    mean = jnp.sum(weight * rest) / count
    spread = jnp.sum(weight * (rest - mean) ** 2) / count
    root = jnp.sqrt(jnp.where(spread > 0.0, spread, 1.0)) * (spread > 0.0)
    return ScalarTransfer(k, -2.0 * mean, root)
