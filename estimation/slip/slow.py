"""Slip that is too slow for a few frames to show it, from the slip over each marker.

The slip is summed over two spans of frames. The longer one shows the slips that a camera takes with
up to four times as many pictures.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool
from scipy.special import expit

from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.slip.slide import Recent, Slide


@dataclass(frozen=True)
class SlowSlipSettings:
    """How a slow slip is recognised. A span is up to 16 frames long, or from 32 to 64 frames.

    Attributes:
        strayed: slip within a span from which a marker counts as slipping [pitches].
        lost: slip within a span over all markers but two at which slip has even odds [pitches].
        lost_spread: change of that slip that multiplies the odds by e [pitches].
        going: slip within the last quarter of a span over a quarter of the markers, from which the
            object still slips [pitches].
        ended: rate of slip in the last quarter of a short span, over that in all of it, below which
            the slip has ended [-].
        ended_slow: the same ratio for the long span [-].
    """

    strayed: float = 0.08
    lost: float = 0.04
    lost_spread: float = 0.004
    going: float = 0.02
    ended: float = 0.5
    ended_slow: float = 0.75


class SlowSlip(NamedTuple):
    """Slow slip of the object, if it goes on.

    Attributes:
        lost: probability that the object has slipped over all markers but two [-].
        slides: whether it still does.
        strays: whether the object slips over a quarter of the markers or more.
        strayed: markers over which it slips.
    """

    lost: float
    slides: bool
    strays: bool
    strayed: Bool[np.ndarray, " n"]


class SlowSlipWatch:
    """Looks for slow slip from frame to frame."""

    def __init__(self) -> None:
        """Begin without contact."""
        self._settings = SlowSlipSettings()
        # whether the object slipped over a quarter of the markers in the last frame, by span
        self._going = [False, False]

    def update(self, slide: Slide) -> SlowSlip | None:
        """The slow slip after the next frame; None if there is none.

        The long span counts only if the short one shows no slip, since a slip is not over at once
        in a long span.

        Args:
            slide: slip of the object, with that in both spans.
        """
        if slide.recent is None:
            return None
        short, slipped = self._judge(slide.recent, 0)
        if slide.slow is None or slipped > self._settings.lost:
            self._going[1] = False
            return short
        slow, _ = self._judge(slide.slow, 1)
        return slow or short

    def _judge(self, recent: Recent, span: int) -> tuple[SlowSlip | None, float]:
        """The slow slip in a span, and the slip over all markers but two [pitches]."""
        settings = self._settings
        lately, just = (np.sort(slip[np.isfinite(slip)]) for slip in recent)
        if min(len(lately), len(just)) < MIN_STICK_MARKERS:
            return None, np.nan
        third, recently = (float(slip[MIN_STICK_MARKERS - 1]) for slip in (lately, just))
        before, going = self._going[span], bool(just[-1 - len(just) // 4] > settings.going)
        self._going[span] = going
        ended = 4.0 * recently < (settings.ended, settings.ended_slow)[span] * third
        if not (before and going) or (span and ended):  # a single frame may be wrong
            return None, third
        lost = (third - settings.lost) / settings.lost_spread
        found = SlowSlip(
            lost=float(expit(lost)),
            slides=lost > 0.0 and not ended,
            strays=bool(lately[-1 - len(lately) // 4] > settings.strayed),
            strayed=np.nan_to_num(recent.lately) > settings.strayed,
        )
        return found, third
