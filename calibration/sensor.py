"""Sensor description from pictures: lens, scale, marker layout and noise.

The lens is calibrated from pictures of a plane checkerboard in several poses ([Zhang2000] Z. Zhang,
"A flexible new technique for camera calibration", in OpenCV). Scale, layout and noise come from
pictures of the unloaded pad, whose printed dots form a regular lattice of known pitch.
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
from calibration.noise import MOST_MOTION, measure_motion
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
"""Root mean square error from which a lens is rejected [px]."""
FEWEST_STILLS = 5
"""Smallest number of pictures of the resting pad for an estimate of the noise."""


class Calibrated(NamedTuple):
    """A sensor description, and the quality of its fit."""

    sensor: Sensor  # the description
    remarks: tuple[str, ...]  # remarks for readers, in sentences
    image: UInt8[np.ndarray, "height width *colours"]  # the first picture
    place: Float[np.ndarray, "m 2"]  # position of each dot without lens distortion [px]
    # distance of each dot from a regular lattice; NaN for dots that are not in rows [px]
    off: Float[np.ndarray, "m 2"]


def fit_lens(boards: Path, corners: tuple[int, int]) -> tuple[Lens, float]:
    """Fit the lens to pictures, or a video, of a checkerboard with rows and columns of corners.

    Returns:
        The lens and the reprojection error, root mean square [px].

    Raises:
        ValueError: too few pictures show the board, or no lens fits them.
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
        complete, position = cv2.findChessboardCornersSB(grey, (columns, rows))
        if complete:
            seen.append(np.asarray(position, dtype=np.float32))
    if len(seen) < FEWEST_POSES:
        raise ValueError(
            f"a board of {rows}×{columns} inner corners was detected in {len(seen)} of {pictures} "
            f"pictures; {FEWEST_POSES} poses are needed: check the numbers of inner corners, and "
            "take more pictures"
        )
    error, matrix, distortion, _, _ = cv2.calibrateCamera(
        [board] * len(seen), seen, size, np.eye(3), np.zeros(5)
    )
    if not error < WORST:
        raise ValueError(
            f"the best lens fit has a residual of {error:.2f} px rms, {WORST:g} px are allowed: "
            "check that all pictures are of one camera and one flat board"
        )
    return Lens(np.asarray(matrix), np.asarray(distortion, dtype=float).ravel()[:5]), float(error)


def calibrate_sensor(
    unloaded: Path,
    pitch_mm: float | None = None,
    lens: Lens | None = None,
    known: Sensor | None = None,
) -> Calibrated:
    """Fit scale, layout and noise to pictures of the unloaded pad.

    Args:
        unloaded: a folder of pictures, or a video, of the pad without contact.
        pitch_mm: distance between neighbouring dots [mm]; without it, the scale is not changed.
        lens: lens of the camera, if known.
        known: an earlier description, whose other values are kept.

    Raises:
        ValueError: no picture can be used, no dots lie in rows, the dots move, or the pitch is not
            above 0.
    """
    if pitch_mm is not None and not 0.0 < pitch_mm < np.inf:
        raise ValueError(f"the pitch is {pitch_mm} mm; it must be a number above 0")
    pictures = (picture for picture in read_pictures(unloaded) if not picture.flaw)
    images = [picture.image for picture in pictures if picture.image is not None]
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
    moves = measure_motion(track - place)
    if moves > MOST_MOTION * pitch:
        raise ValueError(
            f"{unloaded}: the dots, {pitch:.1f} px apart, move by {moves:.1f} px between the "
            "pictures: take pictures of the pad at rest without contact"
        )
    sensor = sensor if pitch_mm is None else replace(sensor, mm_per_px=pitch_mm / pitch)
    remarks = [
        f"{len(place)} {'dark' if style.dark else 'bright'} dots of radius {style.radius:.1f} px, "
        f"{pitch:.3f} px apart; {np.sqrt(np.nanmean(off**2)):.2f} px rms off a regular lattice.",
    ]
    noise = known.noise
    if len(track) >= FEWEST_STILLS:
        scatter = float(np.sqrt(track.var(axis=0, ddof=1).mean()))
        noise = Noise.from_std(sensor.scale * scatter, sensor.unit)
        remarks.append(f"Noise {noise.in_plane:.2g} {noise.unit} in {len(track)} pictures.")
    else:
        remarks.append(
            f"Noise not estimated: {len(track)} pictures, {FEWEST_STILLS} or more are needed."
        )
    described = replace(sensor, reference=sensor.scale * place, noise=noise)
    return Calibrated(described, tuple(remarks), images[0], place, off)


def _follow_dots(
    images: Sequence[np.ndarray], sensor: Sensor, style: DotStyle
) -> Float[np.ndarray, "pictures m 2"]:
    """Positions of the dots that are visible in every picture, without lens distortion [px]."""
    seen = [
        sensor.undistort(find_dots(to_grey(image, style.dark), style).centre) for image in images
    ]
    reference = make_reference(seen[0], images[0].shape[1::-1], unloaded=True)
    track = np.full((len(seen), *reference.position.shape), np.nan)
    for row, centre in zip(track, seen, strict=True):
        match = match_dots(reference, centre)
        row[match >= 0] = centre[match[match >= 0]]
    return track[:, np.isfinite(track).all(axis=(0, 2))]


def lattice_pitch(place: Float[np.ndarray, "m 2"]) -> tuple[float, Float[np.ndarray, "m 2"]]:
    """Fit a slightly bent regular lattice to dots.

    Args:
        place: positions of the dots [px].

    Returns:
        Mean distance of neighbours [px]; distance of each dot from the lattice, NaN for dots
        outside it [px].
    """
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


def write_calibration(calibrated: Calibrated, lines: Sequence[str], out: Path) -> None:
    """Write `sensor.toml`, a report and its picture.

    Raises:
        OSError: a file cannot be written.
    """
    lens = calibrated.sensor.lens
    caption = (
        "The first picture with its dots, and the distance of each dot from a slightly bent "
        "regular lattice. A common pattern means that the lens is not corrected, a single outlier "
        "that a dot is misprinted or badly fitted."
        + ("" if lens is None else " Right: displacement by the lens.")
    )
    write_findings(
        out,
        {"sensor.png": (plot_sensor(calibrated), caption)},
        title="Calibration of a sensor",
        lead=[*lines, *calibrated.remarks],
    )
    write_sensor(calibrated.sensor, out / "sensor.toml")


def plot_sensor(calibrated: Calibrated) -> Figure:
    """Plot the dots, their distances from a lattice, and the displacement by the lens."""
    lens = calibrated.sensor.lens
    height, width = calibrated.image.shape[:2]
    figure, axes = plt.subplots(
        1, 2 if lens is None else 3, figsize=(9.5 if lens is None else 14.0, 4.0),
        layout="constrained", sharex=True, sharey=True,
    )  # fmt: skip
    seen = calibrated.place if lens is None else lens.distort(calibrated.place)
    axes[0].imshow(calibrated.image, cmap="gray")
    axes[0].plot(*seen.T, "+", color="C1", ms=5, mew=0.8)
    axes[0].set_title(f"{len(seen)} dots")
    in_rows = np.isfinite(calibrated.off[:, 0])
    title = "distance from the lattice"
    _arrows(figure, axes[1], calibrated.place[in_rows], calibrated.off[in_rows], title)
    if lens is not None:
        at = np.stack(
            np.meshgrid(np.linspace(0.0, width, 17), np.linspace(0.0, height, 13)), -1
        ).reshape(-1, 2)
        title = "displacement by the lens"
        _arrows(figure, axes[2], lens.undistort(at), at - lens.undistort(at), title)
    for axis in axes:
        axis.set(xlabel="x [px]", ylabel="y [px]", xlim=(0, width), ylim=(height, 0))
        axis.set_aspect("equal")
    return figure


def _arrows(figure: Figure, axis, place: np.ndarray, by: np.ndarray, title: str) -> None:
    """Draw arrows with an automatic scale; the colour shows their length."""
    length = np.hypot(*by.T)
    drawn = axis.quiver(*place.T, *by.T, length, angles="xy", cmap="viridis", width=4e-3)
    figure.colorbar(drawn, ax=axis, label="[px]", shrink=0.8)
    axis.set_title(title)
