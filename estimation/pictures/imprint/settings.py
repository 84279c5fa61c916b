"""Settings for reading and tracking the imprint."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ImprintSettings:
    """Settings for registering the imprint with keyframes and tracking it.

    Attributes:
        reading_deg: standard error of the rotation of a registration with correlation 1; errors
            add up over keyframes [deg].
        reading_px: standard error of the shift of such a registration [px of the scaled picture].
        independent: number of independent parts of a texture. The variance of a shift is the
            missing correlation (1 minus the correlation), divided by this number and by the
            correlation's loss under a unit shift [-].
        patch: side of the square patches of the scaled picture whose differences from the keyframe
            count as independent. The error of a rotation follows from the pull of each patch [px].
        shaded: share of the rotation that is lost by shading, the median of 72 published turns [-].
        shaded_grey: the same share in grey pictures, which do not distinguish a slope from shading;
            the median over five objects of published clips turned grey. Since marks on the gel are
            left out, clips of six objects have 0.00 to 0.12 [-].
        separations: number of times that marks on the gel and uneven light are separated from a
            grey print, which is then registered without them.
        outgrown: size of a grey print, over that in a keyframe, from which the keyframe is no
            longer used [-].
        unturned: the same share is the square of this number over the loss of correlation by a
            rotation, as in `least_loss`, if that is more. Prints with few features lag: rendered
            smooth squares lose 17 to 31 and lag by 1 to 7 %, other rendered prints lose 38 or more
            and lag by 2 % at most [-].
        unshifted: the share of a shift is the fourth power of this number over the loss of
            correlation by the shift, in each direction, if that is more; a shift by the print's arm
            counts as a rotation by 1 rad. Along rendered smooth cylinders, prints lose 4 to 20 and
            lag by 10 to 30 %; those with edges lose 25 or more and do not lag [-].
        dropped: rotation that the compression of a video may hide, as a standard error: the root
            mean square change of the print's levels by it, over the part of the quantizer's step
            that exceeds `harmless`. Rendered clips in H.264 chose both [-].
        harmless: step up to which compression hides nothing, as the pictures' noise carries changes
            through it [grey levels of 255].
        jumps: number of last jumps of the print by which this is known for the video.
        most_late_deg: largest such error. Steps above 150 hid up to 7° in published clips that were
            compressed again [deg].
        mixed_deg: such error from which it stays with a keyframe, whose picture may mix two prints.
            Smaller ones do not: the turn since the keyframe makes up for them [deg].
        least_correlation: correlation with the keyframe below which the imprint is lost [-].
        least_own: the same without worn dots, which match by themselves while the object slides. In
            published lifts with worn dots, prints of held objects have 0.52 at least (of three of
            the four objects 0.71), and 45 of 119 prints of the others less than 0.45 [-].
        steps: number of steps after which a registration ends.
        smallest_px: step that ends it [px of the scaled picture].
        trial: number of steps after which a registration is judged.
        hopeless: correlation after these steps below which it is given up; earlier, the limit is
            lower in proportion. In published lifts, 99 % of those that succeed exceed 0.65 by then
            [-].
        searched_every: interval at which a print that stays lost is searched among all rotations
            and earlier keyframes. In published lifts, 39 % of the searches in the first frame
            without the print find it, and 0.2 % of the later ones [frames].
        found_again: correlation from which a lost imprint counts as found by a search [-].
        compared: number of places that a search compares.
        clearer: missing correlation (1 minus the correlation) at the best place of a search, over
            that at any other place, up to which the print counts as found. Right places of
            published lifts and clips have 0.7 at most, wrong ones mostly 0.86 or more [-].
        apart_px: shift of the contact's middle from which a place is another one [px of the scaled
            picture].
        apart_deg: rotation from which it is another one [deg].
        back_px: slip against the gel's shear from which such a place is wrong. Right places have 1
            at most, wrong ones 14 or more [px of the scaled picture].
        searched_error_deg: least standard error of a rotation found by a search, until the next
            frame shows the print at that place as well [deg].
        new_keyframe: correlation below which another keyframe is used, an earlier or a new one [-].
        kept: number of stored keyframes, always with the first; registration with an earlier
            keyframe ends the drift.
        closing: interval at which earlier keyframes are tried again [frames].
        closer: largest error with an earlier keyframe, over the error without it, for it to be
            used [-].
        largest_deg: standard error from which the imprint is given up [deg].
        step_deg: rotation against the keyframe from which a new keyframe is taken [deg].
        texture: least standard deviation of the imprint's texture, over all colours [grey levels of
            255].
        least_loss: least loss of correlation by a rotation, over half the rotation's square, for
            the rotation to be measured; 40 is a loss of 5 % at 3°. Prints of published clips have
            70 to 260, a rendered smooth square 17 to 31, a smooth ball 1 [-].
        alike: least loss of correlation by a shift along the print, as a share of the loss across
            it, for that shift to be measured. Ridges have 0.00 to 0.07, prints of published lifts
            at least 0.09 [-].
        searched_deg: largest rotation, in both directions, that a search for a lost imprint
            tries [deg].
        overlap: share of the smaller contact region that both pictures must show; outside it the
            pictures show the pad itself [-].
        unseen: number of frames skipped after a frame without a print.
        patience: number of consecutive frames without the imprint after which it is given up.
        fewest: least number of dots in the contact region.
    """

    reading_deg: float = 0.05
    reading_px: float = 0.05
    independent: float = 30.0
    patch: int = 12
    shaded: float = 0.01
    shaded_grey: float = 0.1
    separations: int = 2
    outgrown: float = 1.5
    unturned: float = 5.5
    unshifted: float = 8.0
    dropped: float = 0.03
    harmless: float = 4.0
    jumps: int = 30
    most_late_deg: float = 3.5
    mixed_deg: float = 1.0
    least_correlation: float = 0.65
    least_own: float = 0.45
    steps: int = 25
    smallest_px: float = 0.02
    trial: int = 2
    hopeless: float = 0.5
    searched_every: int = 3
    found_again: float = 0.8
    compared: int = 8
    clearer: float = 0.75
    apart_px: float = 4.0
    apart_deg: float = 4.0
    back_px: float = 5.0
    searched_error_deg: float = 3.0
    new_keyframe: float = 0.85
    kept: int = 8
    closing: int = 20
    closer: float = 0.8
    largest_deg: float = 4.5
    step_deg: float = 12.0
    texture: float = 0.9
    least_loss: float = 15.0
    alike: float = 0.05
    searched_deg: float = 30.0
    overlap: float = 0.4
    unseen: int = 4
    patience: int = 25
    fewest: int = 9
