"""Dots followed from frame to frame, each frame matched to the reference."""

import numpy as np
from jaxtyping import Float, Int

from estimation.images.lattice import Reference, match_dots

JUMP = 0.5
"""Distance from one frame to the next beyond which a dot is not taken for the same [pitches]."""
AGREEMENT = 0.5
"""Share of the dots at rest on which the last frame and the reference must agree."""
FIRST = 0.8
"""The same in a frame that stands alone: more strain than that may have led the match astray."""
LOST = 0.4
"""Share of the reference's dots below which a frame counts as not tracked."""


class DotTracker:
    """Says which dot of a frame is which dot of the reference.

    The dots that rest are found anew in every frame (`match_dots`). The frame before helps where
    the gel is strained too much to be followed from there, but only while it agrees about those
    that rest: after a gap or a jump it does not, and the match starts from the reference alone.
    """

    def __init__(self, reference: Reference) -> None:
        """Start with a reference."""
        self.reference = reference
        self.last = np.full(reference.position.shape, np.nan)
        self.relocked = 0

    def update(self, centre: Float[np.ndarray, "n 2"]) -> tuple[Int[np.ndarray, " m"], str]:
        """The dot that each point of the reference is now, −1 where not seen; and what is wrong.

        A dot that would have jumped from one frame to the next is left out of the frame.
        """
        match, rest = match_dots(self.reference, centre)
        guess = np.where(np.isfinite(self.last), self.last, self.reference.position)
        if np.isfinite(self.last).any():
            helped, _ = match_dots(self.reference, centre, guess)
            both = (rest >= 0) & (helped >= 0)
            agrees = (rest[both] == helped[both]).sum() >= AGREEMENT * max((rest >= 0).sum(), 1)
            if agrees and (helped >= 0).sum() >= AGREEMENT * (match >= 0).sum():
                match = helped
            else:
                self.relocked += 1
                self.last[:] = np.nan
        now = np.full(self.last.shape, np.nan)
        now[match >= 0] = centre[match[match >= 0]]
        jumped = np.linalg.norm(now - self.last, axis=1) > JUMP * self.reference.pitch
        match = np.where(jumped, -1, match)
        before, self.last = self.last, now
        seen = int((match >= 0).sum())
        alone = not np.isfinite(before).any()
        needed = (FIRST if alone else LOST) * min(len(match), max(len(centre), LOST * len(match)))
        if seen < needed:
            self.last = before
            return match, f"only {seen} of {len(match)} dots were recognised"
        return match, ""
