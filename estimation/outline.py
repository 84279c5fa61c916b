"""Orientation of the contact's outline, an angle that does not come from the markers' twist."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.fields import measure_fields
from estimation.recording import Recording
from estimation.stencils import make_stencils

LEAST_ELONGATION = 1.5


class Outline(NamedTuple):
    """Orientation of the contact in each frame.

    Attributes:
        angle: direction of the long axis [rad], counter-clockwise from x, followed without jumps;
            NaN where there is no contact or the outline is too round to have a direction.
        elongation: long over short axis [-].
    """

    angle: Float[np.ndarray, " frames"]
    elongation: Float[np.ndarray, " frames"]


def follow_outline(recording: Recording) -> Outline:
    """Follow the long axis of the contact, from second moments of the indentation.

    The moments are taken about their centre over the markers of the contact region, each weighted
    with its indentation above the region's bound.
    """
    stencils = make_stencils(recording.layout)
    angle = np.full(len(recording), np.nan)
    elongation = np.full(len(recording), np.nan)
    for i, frame in enumerate(recording):
        if frame.flaw:
            continue
        fields = measure_fields(stencils, frame)
        if fields.contact.sum() < 3:
            continue
        depth = fields.indentation[fields.contact]
        points = fields.positions[fields.contact, :2]
        spread = np.cov(points.T, aweights=depth - 0.9 * depth.min(), ddof=0)
        short, long = np.linalg.eigvalsh(spread)
        elongation[i] = np.sqrt(long / max(short, 1e-12))
        if elongation[i] >= LEAST_ELONGATION:
            angle[i] = 0.5 * np.arctan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1])
    seen = np.isfinite(angle)
    angle[seen] = np.unwrap(angle[seen], period=np.pi)
    return Outline(angle, elongation)
