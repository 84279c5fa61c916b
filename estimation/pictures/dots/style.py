"""The dots of a picture, and the detection of their typical appearance."""

import cv2
import numpy as np
from jaxtyping import Float, Shaped

from estimation.pictures.dots.find import Dots, DotStyle, find_seeds, fit_dots
from estimation.pictures.dots.templates import DOT_ELONGATION, fit_alike
from estimation.pictures.lattice import index_lattice
from estimation.pictures.light import to_grey
from estimation.pictures.sensor import Sensor


def find_dots(grey: Float[np.ndarray, "h w"], style: DotStyle) -> Dots:
    """Find the dots of a picture: seeds whose fit has about the typical size and contrast.

    Dots that differ from the typical dot are fitted again by the full model.
    """
    # explained shares between which the full model is tried: below, there is no dot [-]
    most_explained, least_explained = 0.8, 0.3
    # explained share up to which only elongated dots are tried, and their elongation: of 240 others
    # in published lifts and clips, none became a dot [-]
    explained_if_round, elongated = 0.7, 1.8
    dots = fit_alike(grey, find_seeds(grey, style), style)
    unlike = (dots.explained < most_explained) & (dots.explained > least_explained)
    unlike &= (dots.explained > explained_if_round) | (dots.elongation > elongated)
    unlike = np.flatnonzero(unlike)
    if len(unlike):
        limit = np.array(grey.shape[::-1]) - 1
        seeds = np.clip(np.rint(dots.centre[unlike]).astype(int), 0, limit)
        again = fit_dots(grey, seeds, style)
        for values, better in zip(dots, again, strict=True):
            values[unlike] = better
    return _keep_dots(dots, grey, style)


def choose_style(picture: Shaped[np.ndarray, "h w *colour"], sensor: Sensor) -> DotStyle:
    """The dots' typical appearance by the sensor's description, or else by a picture.

    Raises:
        ValueError: the described dots are too large, or the picture shows no dots in rows.
    """
    largest_radius = 25.0  # pictures with larger dots are larger than necessary [px]
    if sensor.radius is not None and sensor.radius > largest_radius:
        raise ValueError(
            f"the dots' radius is {sensor.radius:g} px; it must be {largest_radius:g} px at most: "
            "scale the pictures down"
        )
    if sensor.radius is not None and sensor.dark is not None:
        return DotStyle(sensor.dark, sensor.radius)
    style = find_style(picture, sensor.dark)
    return style if sensor.radius is None else style._replace(radius=sensor.radius)


def _keep_dots(dots: Dots, grey: Float[np.ndarray, "h w"], style: DotStyle) -> Dots:
    explained = 0.75  # share of the variance around a dot that its fit must explain [-]
    size = dots.radius / style.radius
    good = (dots.explained > explained) & (size > 0.5) & (size < 1.8) & (dots.contrast > 3.0)
    good &= np.isfinite(dots.covariance).all(axis=(1, 2))
    good &= (dots.centre > -1.0).all(axis=1)
    good &= (dots.centre < np.array(grey.shape[::-1])).all(axis=1)
    if good.any():
        typical = np.sort(dots.contrast[good])[good.sum() // 2]
        good &= dots.contrast > 0.4 * typical
    return dots.take(good)


def find_style(picture: Shaped[np.ndarray, "h w *colour"], dark: bool | None = None) -> DotStyle:
    """Detect the polarity and the radius for which most dots lie in rows.

    Args:
        picture: a picture of the sensor.
        dark: whether the dots are dark; None to detect it.

    Raises:
        ValueError: the picture shows no dots in rows, for any size and polarity.
    """
    # radii that are tried [px]; the picture is scaled so that each becomes the first one
    radii = (3.5, 2.5, 5.0, 7.0, 10.0, 14.0)
    # share of the picture that the rows must cover, since a sensor's dots fill the picture [-]
    covered = 0.3
    fewest = 12  # least number of dots in rows
    best, most = None, 0.0
    for polarity in (True, False) if dark is None else (dark,):
        original = to_grey(picture, polarity)
        for radius in radii:
            scale = radii[0] / radius
            grey = cv2.resize(original, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            tried = DotStyle(polarity, radii[0])
            dots = _keep_dots(fit_alike(grey, find_seeds(grey, tried), tried), grey, tried)
            dots = dots.take(dots.elongation < DOT_ELONGATION[1])  # drops gaps between dots
            lattice = index_lattice(dots.centre)
            count = len(lattice.dot)
            typical = float(np.median(dots.radius)) if count else 0.0
            score = count * float(np.mean(dots.explained)) if count else 0.0
            enough = count >= max(fewest, 0.5 * len(dots.centre))
            if enough and score > most and _covers(dots.centre[lattice.dot], grey) > covered:
                best, most = DotStyle(polarity, typical / scale), score
    if best is None:
        raise ValueError(
            "no rows of dots were detected in the first usable frame: the sensor has no printed "
            "dots, or their radius is below 2 px or above 18 px; if there are dots, give their "
            "radius, up to 25 px, and polarity (--dot-radius-px, --dark or --bright), scale larger "
            "pictures down, or read only the pad (--crop, --mask)"
        )
    return _refine(best, to_grey(picture, best.dark))


def _refine(style: DotStyle, grey: Float[np.ndarray, "h w"]) -> DotStyle:
    """Measure radius and blur of the typical dot at the picture's full resolution."""
    dots = _keep_dots(fit_dots(grey, find_seeds(grey, style), style), grey, style)
    if not len(dots.blur):
        return style
    radius = float(np.median(dots.radius))
    return DotStyle(style.dark, round(radius, 2), round(float(np.median(dots.blur)), 2))


def _covers(points: Float[np.ndarray, "n 2"], grey: Float[np.ndarray, "h w"]) -> float:
    """Share of the picture inside the hull of points."""
    return cv2.contourArea(cv2.convexHull(points.astype(np.float32))) / grey.size
