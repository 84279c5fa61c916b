"""Dots followed from frame to frame, each frame matched to the reference."""

import numpy as np
from jaxtyping import Float, Int

from estimation.pictures.dots.matching import grow_match, match_dots, match_piece
from estimation.pictures.lattice import Reference

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

    def update(self, centre: Float[np.ndarray, "n 2"]) -> tuple[Int[np.ndarray, " m"], str]:
        """The dot that each point of the reference is now, −1 where not seen; and what is wrong.

        A dot that would have jumped from one frame to the next is left out of the frame.
        """
        # distance from one frame to the next beyond which a dot is not taken for the same [pitches]
        jump = 0.5
        # the same in a frame that stands alone: more strain than that may have led the match astray
        first = 0.8
        match = self._follow(centre)
        if match is None:
            match = match_dots(self.reference, centre)
        now = np.full(self.last.shape, np.nan)
        now[match >= 0] = centre[match[match >= 0]]
        jumped = np.linalg.norm(now - self.last, axis=1) > jump * self.reference.pitch
        match = np.where(jumped, -1, match)
        before, self.last = self.last, now
        seen = int((match >= 0).sum())
        alone = not np.isfinite(before).any()
        needed = (first if alone else LOST) * min(len(match), max(len(centre), LOST * len(match)))
        if seen < needed:
            self.last = before
            return match, f"only {seen} of {len(match)} dots were recognised"
        return match, ""

    def _follow(self, centre: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " m"] | None:
        """The match that the last frame leads to, where it agrees about the dots that rest."""
        # share of the dots at rest on which the last frame and the reference must agree
        agreement = 0.5
        if not np.isfinite(self.last).any():
            return None
        guess = np.where(np.isfinite(self.last), self.last, self.reference.position)
        match = grow_match(self.reference, centre, match_piece(self.reference, centre, guess))
        rest = match_piece(self.reference, centre, self.reference.position)
        agree = (rest >= 0) & (rest == match)
        enough = agreement * min(len(match), len(centre))
        if agree.sum() >= agreement * max((rest >= 0).sum(), 1) and (match >= 0).sum() >= enough:
            return match
        self.last[:] = np.nan
        return None
