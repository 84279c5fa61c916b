"""The sensor description from pictures: lens, scale, marker layout and noise.

The lens comes from pictures of a plane checkerboard in several poses ([Zhang2000] Z. Zhang, "A
flexible new technique for camera calibration", as OpenCV has it), the rest from pictures of the
unloaded pad, whose printed dots lie on a regular lattice of known pitch.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure

from calibration.findings import write_findings
from estimation.frames.noise import Noise
from estimation.pictures.dots.find import DotStyle
from estimation.pictures.dots.matching import match_dots
from estimation.pictures.dots.style import find_dots, find_style
from estimation.pictures.lattice import fit_lattice, index_lattice, make_reference
from estimation.pictures.light import to_grey
from estimation.pictures.sensor import Lens, Sensor, write_sensor
from estimation.pictures.stream import read_pictures

FEWEST_POSES = 4
WORST = 1.0
"""Root mean square error from which a lens is refused [px]."""
MOST_MOTION = 0.02
"""Standard deviation of a dot's place at rest, in distances of neighbours."""
FEWEST_STILLS = 5
"""Pictures of the resting pad from which the noise is told."""


class Calibrated(NamedTuple):
    """A sensor description, and what there is to say of how well it fits.

    Attributes:
        sensor: the description.
        remarks: sentences.
        image: the first picture.
        place: of each dot, straightened [px].
        off: of the dots that lie in rows, how far off a regular lattice; else NaN [px].
    """

    sensor: Sensor
    remarks: tuple[str, ...]
    image: UInt8[np.ndarray, "height width *colours"]
    place: Float[np.ndarray, "m 2"]
    off: Float[np.ndarray, "m 2"]


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
            f"the best lens fit has a residual of {error:.2f} px rms: are all pictures of "
            "one camera and one flat board?"
        )
    return Lens(np.asarray(matrix), np.asarray(distortion, dtype=float).ravel()[:5]), float(error)


def calibrate_sensor(
    unloaded: Path,
    pitch_mm: float | None = None,
    lens: Lens | None = None,
    known: Sensor | None = None,
) -> Calibrated:
    """Scale, layout and noise from pictures of the unloaded pad.

    Args:
        unloaded: a folder of pictures or a video of the pad that nothing touches.
        pitch_mm: distance of neighbouring dots [mm]; without it the scale stays as it was known,
            or lengths in px.
        lens: of the camera, where it is known.
        known: an earlier description, of which the rest is kept.

    Raises:
        ValueError: no usable picture, no dots in rows, dots that move, or a pitch that is not
            above 0.
    """
    if pitch_mm is not None and not 0.0 < pitch_mm < np.inf:
        raise ValueError(f"the pitch is {pitch_mm} mm; it must be a number above 0")
    images = [
        one.image for one in read_pictures(unloaded) if one.image is not None and not one.flaw
    ]
    if not images:
        raise ValueError(f"{unloaded} has no usable picture")
    height, width = images[0].shape[:2]
    style, known = find_style(images[0]), known or Sensor()
    known.expect_size(width, height)
    sensor = replace(
        known,
        lens=lens or known.lens,
        size=(width, height),
        marker="dots",
        radius=style.radius,
        dark=style.dark,
    )
    track = _follow_dots(images, sensor, style)
    place = track.mean(axis=0)
    pitch, off = lattice_pitch(place)
    moves = float(np.median(track.std(axis=0)))
    if moves > MOST_MOTION * pitch:
        raise ValueError(
            f"{unloaded}: the dots move by {moves:.1f} px between the pictures, {pitch:.1f} px "
            "apart: take pictures of the pad at rest with nothing on it"
        )
    sensor = sensor if pitch_mm is None else replace(sensor, mm_per_px=pitch_mm / pitch)
    remarks = [
        f"{len(place)} {'dark' if style.dark else 'bright'} dots of radius {style.radius:.1f} px, "
        f"{pitch:.3f} px apart; {np.sqrt(np.nanmean(off**2)):.2f} px rms off a regular lattice.",
    ]
    noise = known.noise
    if len(track) >= FEWEST_STILLS:
        scatter = float(np.sqrt(track.var(axis=0, ddof=1).mean()))
        noise = Noise.given(sensor.scale * scatter, sensor.unit)
        remarks.append(f"Noise {noise.in_plane:.2g} {noise.unit} in {len(track)} pictures.")
    else:
        remarks.append(f"{len(track)} pictures: the noise requires {FEWEST_STILLS} or more.")
    described = replace(sensor, reference=sensor.scale * place, noise=noise)
    return Calibrated(described, tuple(remarks), images[0], place, off)


def _follow_dots(
    images: Sequence[np.ndarray], sensor: Sensor, style: DotStyle
) -> Float[np.ndarray, "pictures m 2"]:
    """Where the dots are that are seen in every picture, straightened [px]."""
    seen = [
        sensor.straighten(find_dots(to_grey(image, style.dark), style).centre) for image in images
    ]
    reference = make_reference(seen[0], images[0].shape[1::-1], unloaded=True)
    track = np.full((len(seen), *reference.position.shape), np.nan)
    for row, centre in zip(track, seen, strict=True):
        match = match_dots(reference, centre)
        row[match >= 0] = centre[match[match >= 0]]
    return track[:, np.isfinite(track).all(axis=(0, 2))]


def lattice_pitch(place: Float[np.ndarray, "m 2"]) -> tuple[float, Float[np.ndarray, "m 2"]]:
    """Mean distance of neighbours, and each dot's off the lattice, NaN for dots not in it [px]."""
    lattice = index_lattice(place)
    fitted = fit_lattice(lattice, place)
    middle = lattice.coordinates.mean(axis=0)
    steps = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
    i, j = (middle + steps).T
    terms = np.stack([np.ones(4), i, j, i * i, i * j, j * j], axis=1)
    ends = terms @ fitted.coefficients
    across = np.stack([ends[0] - ends[1], ends[2] - ends[3]])
    off = np.full_like(place, np.nan)
    off[lattice.dot] = place[lattice.dot] - fitted.place(lattice.coordinates)
    return float(np.sqrt(abs(np.linalg.det(across)))), off


def write_calibration(found: Calibrated, lines: Sequence[str], out: Path) -> None:
    """Write `sensor.toml`, a report and its picture.

    Args:
        found: the sensor.
        lines: what else there is to say.
        out: folder.

    Raises:
        OSError: a file cannot be written.
    """
    lens = found.sensor.lens
    caption = (
        "The first picture with its dots, and the distance of each from a slightly bent regular "
        "lattice. A common pattern shows a lens that is not corrected, a single outlier a dot that "
        "is misprinted or badly fitted." + ("" if lens is None else " Right: the lens's shifts.")
    )
    write_findings(
        out,
        {"sensor.png": (plot_sensor(found), caption)},
        title="Calibration of a sensor",
        lead=[*lines, *found.remarks],
    )
    write_sensor(found.sensor, out / "sensor.toml")


def plot_sensor(found: Calibrated) -> Figure:
    """The dots, how far they are off a lattice, and what the lens moves."""
    lens = found.sensor.lens
    height, width = found.image.shape[:2]
    figure, axes = plt.subplots(
        1, 2 if lens is None else 3, figsize=(9.5 if lens is None else 14.0, 4.0),
        layout="constrained", sharex=True, sharey=True,
    )  # fmt: skip
    seen = found.place if lens is None else lens.bend(found.place)
    axes[0].imshow(found.image, cmap="gray")
    axes[0].plot(*seen.T, "+", color="C1", ms=5, mew=0.8)
    axes[0].set_title(f"{len(seen)} dots")
    known = np.isfinite(found.off[:, 0])
    _arrows(figure, axes[1], found.place[known], found.off[known], "off the lattice")
    if lens is not None:
        at = np.stack(
            np.meshgrid(np.linspace(0.0, width, 17), np.linspace(0.0, height, 13)), -1
        ).reshape(-1, 2)
        _arrows(figure, axes[2], lens.straighten(at), at - lens.straighten(at), "moved by the lens")
    for axis in axes:
        axis.set(xlabel="x [px]", ylabel="y [px]", xlim=(0, width), ylim=(height, 0))
        axis.set_aspect("equal")
    return figure


def _arrows(figure: Figure, axis, place: np.ndarray, by: np.ndarray, title: str) -> None:
    """Arrows of their own scale, their length as a colour."""
    length = np.hypot(*by.T)
    drawn = axis.quiver(*place.T, *by.T, length, angles="xy", cmap="viridis", width=4e-3)
    figure.colorbar(drawn, ax=axis, label="[px]", shrink=0.8)
    axis.set_title(title)
