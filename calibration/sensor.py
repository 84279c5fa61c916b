"""The sensor description from pictures: lens, scale, marker layout and noise.

The lens comes from pictures of a plane checkerboard in several poses ([Zhang2000] Z. Zhang, "A
flexible new technique for camera calibration", as OpenCV has it), the rest from pictures of the
unloaded pad, whose printed dots lie on a regular lattice of known pitch.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from estimation.images.dots import to_grey
from estimation.images.lattice import fit_lattice, index_lattice, make_reference
from estimation.images.matching import match_dots
from estimation.images.style import find_dots, find_style
from estimation.noise import Noise
from estimation.sensor import Lens, Sensor
from estimation.sources.pictures import read_pictures

FEWEST_POSES = 4
WORST = 1.0
"""Root mean square error from which a lens is refused [px]."""
FEWEST_STILLS = 5
"""Pictures of the resting pad from which the noise is told."""


class Calibrated(NamedTuple):
    """A sensor description, and what there is to say of how well it fits.

    Attributes:
        sensor: the description.
        remarks: sentences.
    """

    sensor: Sensor
    remarks: tuple[str, ...]


def fit_lens(boards: Path, corners: tuple[int, int]) -> tuple[Lens, float]:
    """The lens from pictures of a checkerboard, and the reprojection error [px].

    Args:
        boards: a folder of pictures or a video.
        corners: rows and columns of the board's inner corners.

    Raises:
        ValueError: the board is seen in too few pictures, or no lens fits them.
    """
    rows, columns = corners
    grid = np.mgrid[:columns, :rows].T.reshape(-1, 2)
    board = np.column_stack([grid, np.zeros(len(grid))]).astype(np.float32)
    seen, size, pictures = [], (0, 0), 0
    for picture in read_pictures(boards):
        if picture.image is None or picture.flaw:
            continue
        pictures += 1
        grey = to_grey(picture.image, dark=True).astype(np.uint8)
        size = grey.shape[::-1]
        found, where = cv2.findChessboardCornersSB(grey, (columns, rows))
        if found:
            seen.append(np.asarray(where, dtype=np.float32))
    if len(seen) < FEWEST_POSES:
        raise ValueError(
            f"a board of {rows}×{columns} inner corners is seen in {len(seen)} of {pictures} "
            f"pictures; {FEWEST_POSES} poses are needed: count the corners, and take more pictures"
        )
    error, matrix, distortion, _, _ = cv2.calibrateCamera(
        [board] * len(seen), seen, size, np.eye(3), np.zeros(5)
    )
    if not error < WORST:
        raise ValueError(
            f"the best lens leaves {error:.2f} px rms: are all pictures of one camera and one flat "
            "board?"
        )
    return Lens(np.asarray(matrix), np.asarray(distortion, dtype=float).ravel()[:5]), float(error)


def calibrate_sensor(
    unloaded: Path, pitch_mm: float | None = None, lens: Lens | None = None
) -> Calibrated:
    """Scale, layout and noise from pictures of the unloaded pad.

    Args:
        unloaded: a folder of pictures or a video of the pad that nothing touches.
        pitch_mm: distance of neighbouring dots [mm]; without it lengths stay in px.
        lens: of the camera, where it is known.

    Raises:
        ValueError: no usable picture, no dots in rows, or a pitch that is not above 0.
    """
    if pitch_mm is not None and not 0.0 < pitch_mm < np.inf:
        raise ValueError(f"the pitch is {pitch_mm} mm; it must be a number above 0")
    images = [
        one.image for one in read_pictures(unloaded) if one.image is not None and not one.flaw
    ]
    if not images:
        raise ValueError(f"{unloaded} has no usable picture")
    height, width = images[0].shape[:2]
    style = find_style(images[0])
    sensor = Sensor(
        lens=lens, size=(width, height), marker="dots", radius=style.radius, dark=style.dark
    )
    seen = [
        sensor.straighten(find_dots(to_grey(image, style.dark), style).centre) for image in images
    ]
    reference = make_reference(seen[0], (width, height), unloaded=True)
    track = np.full((len(seen), *reference.position.shape), np.nan)
    for row, centre in zip(track, seen, strict=True):
        match = match_dots(reference, centre)
        row[match >= 0] = centre[match[match >= 0]]
    track = track[:, np.isfinite(track).all(axis=(0, 2))]
    place = track.mean(axis=0)
    pitch, misfit = lattice_pitch(place)
    scale = 1.0 if pitch_mm is None else pitch_mm / pitch
    unit = "px" if pitch_mm is None else "mm"
    remarks = [
        f"{len(place)} {'dark' if style.dark else 'bright'} dots of radius {style.radius:.1f} px, "
        f"{pitch:.3f} px apart; {misfit:.2f} px rms off a regular lattice.",
    ]
    noise = None
    if len(track) >= FEWEST_STILLS:
        noise = Noise.given(scale * float(np.sqrt(track.var(axis=0, ddof=1).mean())))
        remarks.append(f"Noise {noise.in_plane:.2g} {unit} in {len(track)} pictures.")
    else:
        remarks.append(f"{len(track)} pictures: {FEWEST_STILLS} or more would tell the noise.")
    known = {} if pitch_mm is None else {"mm_per_px": scale}
    return Calibrated(
        replace(sensor, reference=scale * place, noise=noise, **known), tuple(remarks)
    )


def lattice_pitch(place: Float[np.ndarray, "m 2"]) -> tuple[float, float]:
    """Mean distance of neighbours, and root mean square distance from the lattice [px]."""
    lattice = index_lattice(place)
    fitted = fit_lattice(lattice, place)
    middle = lattice.coordinates.mean(axis=0)
    steps = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
    i, j = (middle + steps).T
    terms = np.stack([np.ones(4), i, j, i * i, i * j, j * j], axis=1)
    ends = terms @ fitted.coefficients
    across = np.stack([ends[0] - ends[1], ends[2] - ends[3]])
    off = place[lattice.dot] - fitted.place(lattice.coordinates)
    return float(np.sqrt(abs(np.linalg.det(across)))), float(np.sqrt(np.mean(off**2)))
