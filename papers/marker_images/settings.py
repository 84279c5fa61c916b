"""Settings of the study."""

from typing import NamedTuple

NOISES = (2.0, 5.0)
"""Standard deviation of a pixel's noise [grey levels of 255]."""

CONTRAST, BLUR = 120.0, 1.0
"""Grey levels between bright and dark; standard deviation of the point spread [px]."""

PITCH = 23.0
"""Distance between corners [px]; 20 rows fill a picture of 640×480."""

CORNER_PICTURES, QUICK_CORNER_PICTURES = 10, 1
"""Pictures of 400 corners for each noise, each shifted and turned at random."""

ANGLES_DEG = tuple(range(2, 21))
"""The range that the source paper gives its method [deg]."""

FRICTION_RATIOS = (0.2, 0.3, 0.5)
"""μp0/2G* of the pivots [-]."""

PIVOT_DRAWS, PIVOT_PITCH, FIRM_MARKERS = 1, 0.92, 10
"""Draws of each ratio; side of a cell [mm]; fewest truly sticking markers in a scored frame."""

CLIP_FRAMES = (0, 30, 60, 90, 110, 150, 200, 300, 420)
"""Frames of the published clips in the table."""

REFERENCE_ERROR, REST_DEG = 0.7, 1.0
"""Error of the registered turns, and least turn of an object that counts as turned [deg]."""

PAIRED_FRAMES, FRAMES_APART = 12, (8, 20, 40, 80, 160)
"""Random frames of a clip, and the later frames with which each of them is registered."""

WORST, WORST_OF_CLIP = 10, 2
"""Number of worst turns shown, in total and per clip."""

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
edge image with the dots painted out, registered independently of this code and checked by eye."""

TWISTS_DEG = (0.5, 2.0, 5.0, 10.0, 20.0)
"""Turns of the speckle from picture to picture [deg]."""


class SheetSettings(NamedTuple):
    """Selection and display of frames for reading by eye."""

    seed: int = 18  # seed of the selection
    clips: int = 2  # number of clips selected for each object
    whole: tuple[str, ...] = ("avocado_real",)  # objects with all clips selected
    # quantiles of the picture's motion that separate the strata of a clip [-]
    strata: tuple[float, ...] = (0.5, 0.85)
    draws: int = 5  # number of frames in each stratum
    before: int = 12  # number of frames excluded at a clip's start
    reach: int = 4  # number of frames before and after that are compared
    rows: int = 5  # number of frames on a sheet
    gain: float = 3.0  # factor of brightness differences [-]
    enlarged: float = 8.0  # factor of small motions [-]
    far: float = 5.0  # motion from which arrows have their true length [px]
    least_shade: float = 2e-4  # least eigenvalue of the brightness gradients at a tracked print [-]


SHEETS = SheetSettings()
"""Settings of the study's table of states."""

CLIP_DRAWS = 3
"""Rendered clips of each condition; shapes and reliefs alternate."""

QUICK_CLIPS = ("held, turned and back", "fast slip, then rest", "starts loaded, is let go")
"""Conditions of a quick run, with one clip each."""

WRONG_DEG, SURE_DEG = 2.0, 1.5
"""An answer is confidently wrong above this error and below this half-width [deg]."""

CHANGED_CLIPS = (
    "artificial_strawberry/exp_num_1/camera_2",
    "avocado_real/exp_num_2/camera_0",
    "lemon/exp_num_2/camera_0",
    "tennis_ball/exp_num_2/camera_0",
    "wallet/exp_num_1/camera_0",
    "wallet/exp_num_3/camera_0",
    "screw_driver_blue_gray/exp_num_6/camera_0",
    "wooden_statue/exp_num_1/camera_0",
)
"""Published clips that are answered with changed pictures."""
