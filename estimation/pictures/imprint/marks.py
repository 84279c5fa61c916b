"""What a grey picture shows beside the object's print: marks on the gel, and uneven light.

Colours distinguish these from a print. In grey they look like one, and distort the rotation where
the object slides: marks stay on the gel, and uneven light stays in the picture. A part of the print
that follows either of these better than the object therefore does not count. Where most parts do,
the object's own motion is in doubt, and all of them count.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from estimation.pictures.imprint.alignment import Template
from estimation.pictures.imprint.texture import Texture


def find_marks(
    template: Template, now: Texture, warp: Float[np.ndarray, "2 3"]
) -> Bool[np.ndarray, "rows columns"]:
    """Pixels of the box around the contact that follow the gel or the picture, not the object.

    Args:
        template: the earlier texture.
        now: the later one.
        warp: the object's motion between the two.
    """
    apart = 0.7  # distance from which two motions count as different [px of the scaled picture]
    side = 7  # of the square around each pixel in which the misfits are averaged [px]
    better = 0.5  # ratio of mean squared misfits, below which a motion fits clearly better [-]
    gel = now.gel @ np.linalg.inv(template.texture.gel)
    motions = [warp, gel[:2], np.eye(2, 3)]
    shown = template.texture.mask[template.box]
    for motion in motions:
        shown = cv2.bitwise_and(shown, template.bring(now.mask, motion, cv2.INTER_NEAREST))
    level, share = template.texture.smooth[template.box], (shown > 0).astype(np.float32)
    misfits = []
    for motion in motions:
        off = template.bring(now.smooth, motion, cv2.INTER_LINEAR) - level
        off = (off - cv2.mean(off, shown)[0]) * share
        misfits.append(cv2.blur(off * off, (side, side)))
    own, *others = misfits
    marks, follows = np.zeros(shown.shape, dtype=bool), shown > 0
    for motion, misfit in zip(motions[1:], others, strict=True):
        differs = (shown > 0) & (_measure_distance(template, motion - warp) > apart)
        marks |= differs & (misfit < better * own)
        follows &= differs & (own < better * misfit)
    if np.count_nonzero(marks) > np.count_nonzero(follows):
        marks[:] = False
    return marks


def _measure_distance(
    template: Template, between: Float[np.ndarray, "2 3"]
) -> Float[np.ndarray, "rows columns"]:
    """Distance between the places of each pixel of the box under two motions [px].

    Args:
        template: whose box it is.
        between: difference of the motions.
    """
    height, width = template.texture.mask.shape
    y, x = np.arange(height)[template.box[0], None], np.arange(width)[template.box[1]]
    right, down = (a * x + b * y + c for a, b, c in between)
    return np.hypot(right, down)
