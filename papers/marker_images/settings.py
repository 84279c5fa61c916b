"""Settings of the study."""

from typing import NamedTuple

NOISES = (2.0, 5.0)
"""Standard deviation of a pixel [grey levels of 255]."""

CONTRAST, BLUR = 120.0, 1.0
"""Grey levels between bright and dark; standard deviation of the point spread [px]."""

PITCH = 23.0
"""Distance between corners [px]; 20 rows of them fill a picture of 640×480."""

CORNER_PICTURES, QUICK_CORNER_PICTURES = 10, 1
"""Pictures of 400 corners for each noise, each laid and turned at random."""

ANGLES_DEG = tuple(range(2, 21))
"""The range that the source paper gives its method [deg]."""

FRICTION_RATIOS = (0.2, 0.3, 0.5)
"""μp0/2G* of the pivots [-]."""

PIVOT_DRAWS, PIVOT_PITCH, FIRM_MARKERS = 1, 0.92, 10
"""Draws of each ratio; side of a cell [mm]; markers that must truly stick for a frame to count."""

CLIP_FRAMES = (0, 30, 60, 90, 110, 150, 200, 300, 420)
"""Frames of the published clips that the table shows."""

REFERENCE_ERROR, REST_DEG = 0.7, 1.0
"""What registered turns are good to, and from which on an object counts as turned [deg]."""

WORST, WORST_OF_CLIP = 10, 2
"""Worst turns that are shown, of all clips and of one."""

REGISTERED: dict[str, dict[int, float]] = {
    f"screw_driver_blue_gray/exp_num_1/camera_{camera}": dict(
        zip((30, 60, 90, 120, 150, 180, 210, 240, 300), angles, strict=True)
    )
    for camera, angles in (
        (0, (17.7, 18.1, 18.3, 18.1, 33.0, 36.1, 36.8, 35.7, 35.0)),
        (2, (-11.5, -11.6, -11.3, -11.9, -24.8, -27.9, -28.9, -28.2, -28.5)),
    )
}
"""Rotation of the handle's imprint since frame 0, by frame [deg, clockwise on the screen], ±1°: the
edge image registered with the dots painted out, apart from this code, and looked at."""

TWISTS_DEG = (0.5, 2.0, 5.0, 10.0, 20.0)
"""By which speckle is turned from picture to picture [deg]."""


class SheetSettings(NamedTuple):
    """How frames are drawn for reading by eye, and shown.

    Attributes:
        seed: of the draw.
        clips: drawn for each object.
        whole: objects of which all clips are taken.
        strata: shares of a clip's frames, by the picture's motion, that part the strata [-].
        draws: frames of each stratum.
        before: frames at a clip's start that are not drawn.
        reach: frames before and after that are compared.
        rows: frames on a sheet.
        gain: by which differences of light are enlarged [-].
        enlarged: times that motion is drawn too long [-].
        far: motion from which it is drawn at its own length [px].
        least_shade: least eigenvalue of the shades' gradients at which a print is followed [-].
    """

    seed: int = 18
    clips: int = 2
    whole: tuple[str, ...] = ("avocado_real",)
    strata: tuple[float, ...] = (0.5, 0.85)
    draws: int = 5
    before: int = 12
    reach: int = 4
    rows: int = 5
    gain: float = 3.0
    enlarged: float = 8.0
    far: float = 5.0
    least_shade: float = 2e-4


SHEETS = SheetSettings()
"""Of the table of states."""

CLIP_DRAWS = 3
"""Rendered clips of each condition; shapes and reliefs take turns."""

QUICK_CLIPS = ("held, turned and back", "fast slip, then rest", "starts loaded, is let go")
"""Conditions of a quick run, one clip of each."""
