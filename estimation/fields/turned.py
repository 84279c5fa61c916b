"""The edge of an unknown contact, guessed from the rotation of the markers.

An object that turns on gel turns the gel beneath it as far as itself while it sticks. Across the
edge the rotation falls to zero and below, so that the markers that have turned by more than half of
the largest rotation lie in the contact, in its inner part once slip has begun.
"""

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.edge import Edge, outline_edge
from estimation.fields.stencils import Stencils, mean_around


def turned_edge(
    stencils: Stencils,
    displacement: Float[np.ndarray, "n d"],
    rotation: Float[np.ndarray, " n"],
) -> tuple[Edge, float] | None:
    """A guess of the contact's edge, and of the rotation within.

    Args:
        stencils: stencils of the layout.
        displacement: displacement of each marker, NaN where unknown [mm].
        rotation: rotation of each marker, NaN where unknown [rad].

    Returns:
        Both, or None if too few markers have turned, or if they have moved further than they turn
        the edge: shear turns the gel beside the contact.
    """
    beyond, error = 1.3, 0.2  # radius of the contact over that of the region, and its error
    even = mean_around(stencils, rotation)
    first = int(np.abs(even).argmax())
    turned = even * np.sign(even[first]) > 0.5 * abs(even[first])
    region = _connect(stencils, turned & np.isfinite(rotation), first)
    inner = outline_edge(stencils.reference, region, fewest=6)
    if inner is None:
        return None
    parameters = inner.parameters.copy()
    parameters[2] += np.log(beyond)
    edge = inner._replace(
        radius=beyond * inner.radius,
        error=error,
        distance=inner.distance / beyond,
        parameters=parameters,
    )
    angle = float(np.median(even[region]))
    moved = np.nanmean(displacement[region, :2], axis=0)
    return (edge, angle) if np.hypot(*moved) < abs(angle) * edge.radius else None


def _connect(
    stencils: Stencils, markers: Bool[np.ndarray, " n"], first: int
) -> Bool[np.ndarray, " n"]:
    """The markers that are connected with the first one over neighbours."""
    region = np.zeros_like(markers)
    region[first] = True
    newest = [first]
    while newest:
        around = stencils.neighbours[newest].ravel()
        around = np.unique(around[around >= 0])
        newest = around[markers[around] & ~region[around]]
        region[newest] = True
        newest = newest.tolist()
    return region
