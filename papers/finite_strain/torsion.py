"""Linear torsion of balls and other round tips: how much more they yield than a half-space.

A traction τ = r √(1 − r²/a²), per area seen along the axis, turns the tip; the far end is gripped.
The angle ψ = u_θ/r solves div(r³ grad ψ) = 0, here with quadratic finite elements (extra
`finite-elements`). The gain is the mean of ψ within 0.6 a over that of a half-space, minus 1;
`ball_gain` predicts it from the radius alone.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.special import j1

from contactmodel import ball_gain
from estimation.softness.bar import edge_compliance, tip_share
from papers.finite_strain.gel import grow, space_radii
from papers.finite_strain.two_bodies import Ball
from papers.items import Track
from papers.tables import finish

RADIUS = 20.0
BODIES = {
    "cone beyond R/2, 2 R wide": Ball(RADIUS, 10.0, 40.0, 40.0),
    "cone beyond 0.85 R": Ball(RADIUS, 17.0, 40.0, 40.0),
    "cone beyond R/2, R wide": Ball(RADIUS, 10.0, 20.0, 40.0),
    "ball on a stem": Ball(RADIUS, 19.0, 19.5, 40.0),
}
SHARES = (0.1, 0.2, 0.35)
"""Radius of the contact over R [-]."""

_FLAT = Ball(1e6, 10.0, 400.0, 400.0)
_INNER = 0.6


class Gain(NamedTuple):
    """Gain of a tip at a radius of the contact.

    Attributes:
        share: a/R [-].
        found: by finite elements [-].
        predicted: by `ball_gain` [-].
    """

    share: float
    found: float
    predicted: float


def compute(quick: bool = False, track: Track = iter) -> dict[str, list[Gain]]:
    """Gains of all bodies; the quick size is one body and one radius."""
    names, shares = (list(BODIES)[1:2], SHARES[1:2]) if quick else (list(BODIES), SHARES)
    return {name: [_compare(BODIES[name], share) for share in shares] for name in track(names)}


def _compare(body: Ball, share: float) -> Gain:
    a = share * RADIUS
    r, found = solve_torsion(body, a)
    inner = (r > 0.02 * a) & (r < _INNER * a)
    flat = np.interp(r[inner], *solve_torsion(_FLAT, a))
    more = _predict(r[inner], a)
    return Gain(share, float(np.mean(found[inner] / flat - 1.0)), float(np.mean(more / flat)))


def solve_torsion(
    body: Ball, a: float
) -> tuple[Float[np.ndarray, " nodes"], Float[np.ndarray, " nodes"]]:
    """Radii of the surface's nodes [mm], and Gψ there [mm·MPa over the unit of τ].

    Args:
        body: the body; its modulus is not used.
        a: radius of the contact [mm].
    """
    from skfem import (
        Basis,
        BilinearForm,
        ElementTriP2,
        FacetBasis,
        LinearForm,
        MeshQuad,
        MeshTri,
        condense,
        solve,
    )

    across = space_radii(body.width, a / 40.0, 1.3 * a, 1.15)
    mesh = MeshQuad.init_tensor(across, grow(body.height, a / 40.0, 1.15)).to_meshtri()
    r, z = mesh.p
    lifted = z + np.interp(r, across, body.profile(across)) * (1.0 - z / body.height)
    bent = MeshTri(np.stack([r, lifted]), mesh.t)
    height = z[mesh.facets]
    tip, end = ((np.abs(height - at) < 1e-9).all(axis=0) for at in (0.0, body.height))
    basis = Basis(bent, ElementTriP2(), intorder=6)

    def stiffness(u, v, w):
        return w.x[0] ** 3 * np.sum(np.asarray(u.grad) * np.asarray(v.grad), axis=0)

    def load(v, w):
        shear = w.x[0] * np.sqrt(np.maximum(1.0 - (w.x[0] / a) ** 2, 0.0))
        return shear * w.x[0] ** 2 * np.abs(w.n[1]) * v

    matrix = BilinearForm(stiffness).assemble(basis)
    surface = FacetBasis(bent, ElementTriP2(), facets=np.flatnonzero(tip), intorder=12)
    force = LinearForm(load).assemble(surface)
    gripped = basis.get_dofs(facets=np.flatnonzero(end)).all()
    turned = np.asarray(solve(*condense(matrix, force, D=gripped)))
    nodes = np.flatnonzero(z < 1e-9)
    nodes = nodes[np.argsort(r[nodes])]
    return r[nodes], turned[np.asarray(basis.nodal_dofs)[0, nodes]]


def compare_side(width: float, height: float, a: float) -> tuple[float, float]:
    """Share of a round tip's part that is left in a cylinder, by finite elements and predicted.

    The part is the turn of a cylinder with a tip of `RADIUS` less that of one with a flat face.

    Args:
        width: radius W of the cylinder [mm].
        height: height from the tip to the grip [mm].
        a: radius of the contact [mm].
    """
    r = np.linspace(0.05, 0.8, 60) * a
    tip, flat = (
        np.interp(r, *solve_torsion(body, a))
        for body in (
            Ball(RADIUS, 0.5 * RADIUS, width, height),
            Ball(1e6, 1.0, width, height),
        )
    )
    share = r**3 @ (tip - flat) / (r**3 @ _predict(r, a, height))
    return float(share), tip_share(a, width)


def add_edge(edge: float, side: float, height: float, share: float) -> tuple[float, float]:
    """Turn that a rounded edge adds to a cylinder's face, by finite elements and predicted.

    Args:
        edge: radius of the edge [mm].
        side: radius W of the side [mm].
        height: height from the face to the grip [mm].
        share: part of the edge that the contact reaches [-].

    Returns:
        Two compliances: turn times G over moment [1/mm³].
    """
    a = side - (1.0 - share) * edge
    r = np.linspace(0.05, 0.8, 60) * a
    bodies = Ball(edge, 0.8 * edge, side, height, flat=side - edge), Ball(1e6, 1.0, side, height)
    rounded, sharp = (np.interp(r, *solve_torsion(body, a)) for body in bodies)
    moment = 4.0 / 15.0 * np.pi * a**4  # of τ
    return float(r**3 @ (rounded - sharp) / np.sum(r**3) / moment), edge_compliance(side, edge)


def _predict(r: np.ndarray, a: float, height: float = np.inf) -> np.ndarray:
    """Gψ that `ball_gain` adds at some radii, by quadrature over the waves."""
    q = np.linspace(1e-3, 60.0 / a, 6000)
    angle = np.linspace(0.0, 0.5 * np.pi, 400)
    place = a * np.sin(angle)
    load = place**2 * np.cos(angle) * a * np.cos(angle) * (angle[1] - angle[0])
    gain = np.asarray(ball_gain(q * RADIUS)) * np.tanh(q * height) ** 3
    waves = j1(np.outer(q, place)) @ load * gain * (q[1] - q[0])
    return j1(np.outer(r, q)) @ waves / r


def tables(result: dict[str, list[Gain]]) -> dict[str, list[dict[str, object]]]:
    """A row for each body and radius."""
    return {
        "": [
            {
                "body": name,
                "a/R": gain.share,
                "gain": round(gain.found, 3),
                "ball_gain": round(gain.predicted, 3),
                "difference [%]": round(100.0 * (gain.found / gain.predicted - 1.0), 1),
            }
            for name, gains in result.items()
            for gain in gains
        ]
    }


def plot(result: dict[str, list[Gain]]) -> Figure:
    """Gain over a/R; the dashed line is `ball_gain`."""
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for name, gains in result.items():
        axis.plot([one.share for one in gains], [one.found for one in gains], "o-", label=name)
    (first, *_) = result.values()
    axis.plot([one.share for one in first], [one.predicted for one in first], "k--")
    axis.set_ylabel("k of the tip over k, minus 1 [-]")
    finish(axis, legend=8, xlabel="a/R, contact over ball [-]")
    return figure
