"""How the imprint is read and followed."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ImprintSettings:
    """How the imprint is registered with keyframes and followed from frame to frame.

    Attributes:
        reading_deg: standard error of a registration with correlation 1; errors add up over
            keyframes [deg].
        reading_px: the same of the shift [px of the picture as it is registered].
        independent: parts of a texture that differ from the keyframe by themselves: what the
            correlation lacks, over these and over its loss by a shift, is the square of the shift's
            error [-].
        patch: side of the squares, of the picture scaled down, in which what the print is not the
            same in belongs together: how far they pull the turn to and fro is its error [px].
        shaded: share of the rotation by which light holds it back, the median of 72 published turns
            [-].
        least_correlation: with the keyframe, below which the imprint has lost its place [-].
        found_again: correlation from which it counts as found again after a search [-].
        new_keyframe: correlation below which another keyframe is taken: an earlier one, or a new
            one [-].
        kept: keyframes that are kept, the first always: registering with an earlier one ends the
            drift.
        closing: after how many frames earlier keyframes are tried again [frames].
        closer: error over what it is without them from which they serve [-].
        largest_deg: standard error from which the imprint is given up [deg].
        step_deg: rotation against the keyframe from which a new one is taken [deg].
        texture: grey levels, of 255, that the imprint's own texture must have, all colours
            together.
        least_loss: what a turn must cost of the correlation, over half its square, to be read: 5 %
            at 3°. Prints of published clips have 70 to 260, a smooth ball 20, by what does not turn
            with it [-].
        alike: what a shift along the print must cost of the correlation, as a share of one across
            it, for the print to show it: ridges have 0.00 to 0.07, prints of published lifts 0.09
            and more [-].
        searched_deg: largest rotation that is tried either way where the imprint has lost its place
            [deg].
        overlap: share of the smaller contact region that both pictures must show: elsewhere the pad
            itself is seen [-].
        unseen: frames that are passed over after one in which the object prints nothing.
        patience: frames in a row without the imprint after which it is given up.
        fewest: dots of the contact region below which too little of the object is seen.
    """

    reading_deg: float = 0.05
    reading_px: float = 0.05
    independent: float = 30.0
    patch: int = 12
    shaded: float = 0.01
    least_correlation: float = 0.65
    found_again: float = 0.8
    new_keyframe: float = 0.85
    kept: int = 8
    closing: int = 20
    closer: float = 0.8
    largest_deg: float = 4.5
    step_deg: float = 12.0
    texture: float = 0.9
    least_loss: float = 40.0
    alike: float = 0.05
    searched_deg: float = 30.0
    overlap: float = 0.4
    unseen: int = 4
    patience: int = 25
    fewest: int = 9
