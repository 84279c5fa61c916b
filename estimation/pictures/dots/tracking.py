"""Tracking of dots from frame to frame; each frame is matched to the reference."""

import numpy as np
from jaxtyping import Float, Int

from estimation.pictures.dots.matching import (
    drop_doubtful,
    grow_match,
    match_dots,
    match_piece,
)
from estimation.pictures.lattice import Reference


class DotTracker:
    """Matches the dots of each frame to the dots of the reference.

    The dots at rest are searched anew in every frame (`match_dots`). The previous frame helps where
    the gel is strained too much for a match from the dots at rest, but only if both matches agree
    about the dots at rest. After a gap or a jump they disagree, and only the reference is used; so
    it is where it fits more dots to their neighbours.
    """

    def __init__(self, reference: Reference) -> None:
        """Start with a reference."""
        self.reference = reference
        self.last = np.full(reference.position.shape, np.nan)

    def update(self, centre: Float[np.ndarray, "n 2"]) -> tuple[Int[np.ndarray, " m"], str]:
        """Match the dots of the next frame.

        A dot that would have jumped since the previous frame is dropped from this frame.

        Args:
            centre: dots of the frame [px].

        Returns:
            For each point of the reference, the number of its dot, −1 where not visible; and why
            the frame cannot be used, empty if it can.
        """
        # largest motion of a dot from one frame to the next [pitches]
        jump = 0.5
        # share of the reference's dots below which a frame counts as not tracked; and the share
        # that a frame without a predecessor must match, since the strain may mislead the match
        least, first = 0.4, 0.8
        match = self._choose(centre, self._follow(centre))
        now = np.full(self.last.shape, np.nan)
        now[match >= 0] = centre[match[match >= 0]]
        jumped = np.linalg.norm(now - self.last, axis=1) > jump * self.reference.pitch
        match = np.where(jumped, -1, match)
        before, self.last = self.last, now
        seen = int((match >= 0).sum())
        alone = not np.isfinite(before).any()
        needed = (first if alone else least) * min(len(match), max(len(centre), least * len(match)))
        if seen < needed:
            self.last = before
            return match, f"only {seen} of {len(match)} dots were recognised"
        return match, ""

    def _choose(
        self, centre: Float[np.ndarray, "n 2"], followed: Int[np.ndarray, " m"] | None
    ) -> Int[np.ndarray, " m"]:
        """The match from the last frame, or the one from the reference alone if it fits more dots.

        After a fast slip the last frame may lead to the wrong row of dots, and would then do so
        for the rest of the clip.
        """
        row = 3  # dots that do not fit their neighbours, from which a row may be mistaken
        if followed is None:
            return match_dots(self.reference, centre)
        matched = (followed >= 0).sum()
        if matched == len(centre):  # a mistaken row leaves dots over
            return followed
        certain = (drop_doubtful(self.reference, centre, followed) >= 0).sum()
        if certain > matched - row:
            return followed
        alone = match_dots(self.reference, centre)
        return alone if (alone >= 0).sum() > certain else followed

    def _follow(self, centre: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " m"] | None:
        """The match from the last frame; None if it disagrees about the dots at rest."""
        # share of the dots at rest about which the last frame and the reference must agree
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
