"""The edge of a contact, from the shape of the indented surface.

Inside the contact the gel follows the object; beyond the edge it leaves it. How deep the edge lies
depends on the object's shape and on the gel's thickness, neither of which is known: at half of the
depth under a ball on thick gel, near the unloaded surface on thin gel, and at almost the full depth
under a flat end. The indentation around a face that is flat up to some radius and round beyond, on
gel of some thickness (`estimation.fields.face`), is therefore fitted to all markers around the
contact, with its centre, its radius and its outline: an ellipse, or a rounded square or rectangle.
Without z, the edge is the outline of the region that the source gives (`outline_edge`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from estimation.fields.face import (
    FacePrior,
    Indentation,
    clip_face,
    coarse_faces,
    distance_step,
    press_face,
)


class Edge(NamedTuple):
    """The fitted edge of a contact.

    Attributes:
        radius: radius of a disc as large as the contact [mm].
        error: standard error of the radius, relative [-].
        misfit: root mean square of the residuals over the depth; NaN without z [-].
        thinness: a/(a + h) of the contact's radius a and the gel's thickness h; NaN without z [-].
        flat: radius of the face's flat part over that of the contact; NaN without z [-].
        distance: distance of each point from the centre, over that of the edge in its direction
            [-]; the contact is where it is at most 1.
        parameters: all fitted parameters: centre (2), ln radius, stretch (2), thinness, flat part,
            depth and corners (2). Without z, thinness and flat part are those of `FacePrior`, and
            the depth is 0.
    """

    radius: float
    error: float
    misfit: float
    thinness: float
    flat: float
    distance: Float[np.ndarray, " n"]
    parameters: Float[np.ndarray, " 10"]

    @property
    def elongation(self) -> float:
        """Long over short axis of the outline [-]."""
        return float(np.exp(np.hypot(*self.parameters[3:5])))


class Polar(NamedTuple):
    """Points around the centre, in coordinates in which the contact is nearly round.

    Attributes:
        distance: over that of the edge in the same direction.
        plain: the same without the outline's corners.
        direction: of length 1.
        corners: fourth power of the direction.
        fade: share of the corners that remains at this distance.
        fading: power of the distance by which they fade there.
    """

    distance: Float[np.ndarray, " n"]
    plain: Float[np.ndarray, " n"]
    direction: Complex[np.ndarray, " n"]
    corners: Complex[np.ndarray, " n"]
    fade: Float[np.ndarray, " n"]
    fading: Float[np.ndarray, " n"]


def find_edge(
    points: Float[np.ndarray, "n 2"],
    indentation: Float[np.ndarray, " n"],
    deep: float,
    last: Edge | None = None,
) -> Edge | None:
    """Fit the edge of the contact; None if the points cannot determine it.

    Args:
        points: positions in the plane [mm].
        indentation: displacement into the gel, NaN where unknown [mm].
        deep: share of the largest indentation above which points are in contact, roughly [-].
        last: the edge of the frame before. The fit starts from it, which takes a third of the time,
            and anew if that fits worse than the last one did.
    """
    worse = 1.2  # misfit over that of the last edge, from which the fit starts anew
    known = np.isfinite(indentation)
    if last is not None:
        edge = _fit(points, indentation, last.parameters, (last.misfit * last.parameters[7]) ** 2)
        if edge is not None and edge.misfit < worse * last.misfit:
            return edge
    start, radius = _start(points[known], indentation[known], deep)
    if not radius > 0.0:
        return None
    first, variance = _scan(points[known], indentation[known], start, radius)
    edge = _fit(points, indentation, first, variance)
    if edge is None:
        return None
    return _fit(points, indentation, edge.parameters, (edge.misfit * edge.parameters[7]) ** 2)


def outline_edge(
    points: Float[np.ndarray, "n d"], region: Bool[np.ndarray, " n"], fewest: int = 12
) -> Edge | None:
    """The edge of a known contact region: the ellipse with the second moments of its markers.

    The error is that of circles and ellipses of 12 to 200 markers, anywhere on a square grid.

    Args:
        points: positions [mm]; z is left out.
        region: the contact region.
        fewest: least number of its markers.

    Returns:
        The edge, or None for fewer markers, or markers in a row.
    """
    inside = points[region, :2]
    if len(inside) < fewest:
        return None
    values, axes = np.linalg.eigh(np.cov(inside.T, bias=True))
    if not values[0] > 1e-6 * values[1]:
        return None
    stretch = 0.5 * float(np.log(values[1] / values[0]))
    x, y = axes[:, 1]
    parameters = np.zeros(10)
    parameters[:2] = inside.mean(axis=0)
    parameters[2] = 0.25 * np.log(16.0 * values[0] * values[1])
    parameters[3:5] = -stretch * np.array([x * x - y * y, 2.0 * x * y])
    parameters[5:7] = FacePrior().mean
    return Edge(
        radius=float(np.exp(parameters[2])),
        error=0.3 * len(inside) ** -0.75,
        misfit=np.nan,
        thinness=np.nan,
        flat=np.nan,
        distance=measure_places(points[:, :2], parameters).distance,
        parameters=parameters,
    )


def _fit(
    points: Float[np.ndarray, "n 2"],
    indentation: Float[np.ndarray, " n"],
    start: Float[np.ndarray, " 10"],
    variance: float,
) -> Edge | None:
    """The edge that fits the points within some radii of the contact's centre."""
    reach = 2.2  # radii of the contact
    near = np.isfinite(indentation)
    near[near] = measure_places(points[near], start).distance < reach
    free = int(near.sum()) - len(start)
    if free <= len(start):
        return None
    parameters, inverse, squares = _refine(points[near], indentation[near], start, variance)
    depth = parameters[7]
    thinness, flat = clip_face(*parameters[5:7])
    if inverse is None or not depth > 0.0:
        return None
    return Edge(
        radius=float(np.exp(parameters[2])),
        error=float(np.sqrt(inverse[2, 2])),
        misfit=float(np.sqrt(squares / free) / depth),
        thinness=thinness,
        flat=flat,
        distance=measure_places(points, parameters).distance,
        parameters=parameters,
    )


def _start(
    points: Float[np.ndarray, "n 2"], indentation: Float[np.ndarray, " n"], deep: float
) -> tuple[Float[np.ndarray, " 10"], float]:
    """Parameters with centre and stretch of the deep points, and their radius [mm]; 0 without."""
    least_stretch = 0.25  # logarithm of the ratio of the axes' squares, below which it is round
    bound = deep * indentation.max(initial=0.0)
    weight = np.maximum(indentation - bound, 0.0)
    parameters = np.zeros(10)
    if np.count_nonzero(weight) < 4:
        return parameters, 0.0
    parameters[:2] = centre = weight @ points / weight.sum()
    away = points - centre
    values, axes = np.linalg.eigh((weight[:, None] * away).T @ away / weight.sum())
    if not values[0] > 1e-6 * values[1]:
        return parameters, 0.0
    stretch = 0.5 * float(np.log(values[1] / values[0]))
    if stretch >= least_stretch:
        parameters[3:5] = -stretch * np.array(
            [axes[0, 1] ** 2 - axes[1, 1] ** 2, 2.0 * axes[0, 1] * axes[1, 1]]
        )
    return parameters, float(np.sqrt(5.0 * np.sqrt(values[0] * values[1])))


def _scan(
    points: Float[np.ndarray, "n 2"],
    indentation: Float[np.ndarray, " n"],
    start: Float[np.ndarray, " 10"],
    radius: float,
) -> tuple[Float[np.ndarray, " 10"], float]:
    """The best of some faces and radii, with a centre and a stretch, and its residual variance."""
    reach = 2.6  # of the points, over the radius
    distance = measure_places(points, start).distance
    near = distance < reach * radius
    distance, indentation = distance[near], indentation[near]
    bins = 24
    edges = np.linspace(0.0, distance.max() * (1.0 + 1e-9), bins + 1)
    of_bin = np.digitize(distance, edges) - 1
    count = np.bincount(of_bin, minlength=bins)
    some = count > 0
    middle = np.bincount(of_bin, distance, bins)[some] / count[some]
    mean = np.bincount(of_bin, indentation, bins)[some] / count[some]
    radii = radius * np.geomspace(0.75, 1.7, 18)
    faces, lines = coarse_faces()
    column = np.minimum((middle / radii[:, None] / distance_step()).round(), lines.shape[1] - 1)
    models = lines[:, column.astype(int)]  # faces, radii, bins
    weighted = models * count[some]
    depth = weighted @ mean / np.sum(weighted * models, axis=2)
    squares = np.sum(count[some] * (mean - depth[..., None] * models) ** 2, axis=2)
    face, row = np.unravel_index(int(squares.argmin()), squares.shape)
    within = float(np.sum((indentation - mean[np.cumsum(some)[of_bin] - 1]) ** 2))
    variance = (float(squares.min()) + within) / max(len(distance) - len(start), 1)
    place, shape = np.log(radii[row]), [*faces[face], depth[face, row]]
    return np.r_[start[:2], place, start[3:5], shape, 0.0, 0.0], variance


def _refine(
    points: Float[np.ndarray, "n 2"],
    indentation: Float[np.ndarray, " n"],
    start: Float[np.ndarray, " 10"],
    variance: float,
) -> tuple[Float[np.ndarray, " 10"], Float[np.ndarray, "10 10"] | None, float]:
    """The most probable parameters, their covariance, and the sum of the squared residuals."""
    from scipy.optimize import leastsq  # slow to import, and a command's help needs none

    # mean and standard deviation before the fit, of stretch, thinness, flat part and corners
    face = FacePrior()
    mean = np.array([0.0, 0.0, 0.0, 0.0, 0.0, *face.mean, 0.0, 0.0, 0.0])
    spread = np.array([np.inf, np.inf, np.inf, 0.5, 0.5, *face.spread, np.inf, 0.12, 0.12])
    known = np.isfinite(spread)
    prior = 1.0 / spread[known]
    by_prior = np.diag(1.0 / spread)[:, known]
    noise = np.sqrt(max(variance, 1e-18))

    last = start.copy(), _press(points, start)

    def press(parameters: np.ndarray) -> tuple[Polar, Indentation]:
        nonlocal last
        if not np.array_equal(parameters, last[0]):
            last = parameters.copy(), _press(points, parameters)
        return last[1]

    def residual(parameters: np.ndarray) -> np.ndarray:
        model = parameters[7] * press(parameters)[1].value
        return np.concatenate([(model - indentation) / noise, (parameters - mean)[known] * prior])

    def slope(parameters: np.ndarray) -> np.ndarray:
        slopes = outline_slopes(parameters, *press(parameters))
        return np.concatenate([slopes / noise, by_prior], axis=1)

    scale = np.exp(start[2])
    typical = np.array(
        [0.1 * scale, 0.1 * scale, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1 * start[7], 0.1, 0.1]
    )
    with np.errstate(over="ignore", invalid="ignore"):  # steps of the solver may go too far
        best, *details = leastsq(
            residual,
            start,
            Dfun=slope,
            col_deriv=True,
            full_output=True,
            diag=1.0 / typical,
            factor=10,
            xtol=1e-3,
            ftol=1e-3,
            maxfev=30,
        )
    inverse, info = details[:2]
    return best, inverse, float(np.sum(info["fvec"][: len(points)] ** 2)) * noise**2


def _stretch(parameters: Float[np.ndarray, " 10"]) -> Float[np.ndarray, "2 2"]:
    """The symmetric matrix of determinant 1 that makes the contact round."""
    p, q = 0.5 * parameters[3:5]
    size = float(np.hypot(p, q))
    share = np.sinh(size) / size if size > 1e-9 else 1.0
    return np.cosh(size) * np.eye(2) + share * np.array([[p, q], [q, -p]])


def measure_places(points: Float[np.ndarray, "n 2"], parameters: Float[np.ndarray, " 10"]) -> Polar:
    """Distances from the centre, in the contact's radii.

    The edge of a square is r = exp(−e cos 4φ + 2e² cos 8φ + …) with e = 1/8; a smaller e has
    rounder corners.
    """
    away = (points - parameters[:2]) @ _stretch(parameters)
    place = away[:, 0] + 1j * away[:, 1]
    size = np.maximum(np.abs(place), 1e-9)
    direction, plain = place / size, size * np.exp(-parameters[2])
    corners = direction**4
    fading = np.where(plain > 1.0, 1.5, 0.0)
    fade = np.maximum(plain, 1.0) ** -fading
    first, second = _outline(corners, parameters)
    distance = plain * (1.0 + fade * first - fade**2 * second)
    return Polar(distance, plain, direction, corners, fade, fading)


def _outline(
    corners: Complex[np.ndarray, " n"], parameters: Float[np.ndarray, " 10"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Terms in cos 4φ and cos 8φ of the outline."""
    first = parameters[8] * np.real(corners) + parameters[9] * np.imag(corners)
    return first, 3.0 * first**2 - 1.5 * float(np.sum(parameters[8:] ** 2))


def _press(
    points: Float[np.ndarray, "n 2"], parameters: Float[np.ndarray, " 10"]
) -> tuple[Polar, Indentation]:
    """Places of the points in the contact, and the indentation over the depth there."""
    polar = measure_places(points, parameters)
    return polar, press_face(polar.distance, *parameters[5:7])


def outline_slopes(
    parameters: Float[np.ndarray, " 10"], polar: Polar, at: Indentation
) -> Float[np.ndarray, "10 n"]:
    """Derivatives of the indentation by each parameter."""
    plain, corners, fade, depth = polar.plain, polar.corners, polar.fade, parameters[7]
    first, second = _outline(corners, parameters)
    by_first = fade - 6.0 * fade**2 * first
    outwards = (
        1.0 + fade * first * (1.0 - polar.fading) - fade**2 * second * (1.0 - 2.0 * polar.fading)
    )
    around = 4.0 * (parameters[9] * np.real(corners) - parameters[8] * np.imag(corners)) * by_first
    back = np.conj(polar.direction)
    by_place = -back / (plain * np.exp(parameters[2]))
    x, y = _stretch(parameters)
    moves = [(x[0] + 1j * x[1]) * by_place, (y[0] + 1j * y[1]) * by_place]
    moves += [np.full(len(plain), -1.0 + 0.0j), 0.5 * back**2, 0.5j * back**2]
    steep = depth * at.by_distance * plain
    by_outline = [steep * (outwards * np.real(one) + around * np.imag(one)) for one in moves]
    thin = depth * at.by_thinness
    flat = depth * at.by_flat
    by_corners = [
        steep * (by_first * part + 3.0 * fade**2 * own)
        for part, own in zip((np.real(corners), np.imag(corners)), parameters[8:], strict=True)
    ]
    return np.stack([*by_outline, thin, flat, at.value, *by_corners])
