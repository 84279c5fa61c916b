"""A fast fit of dots by least squares, linearised about tabulated dots.

Most dots of a sensor look alike. The model and its derivatives are tabulated once, for centres on a
grid finer than a pixel and for several radii. A dot is then fitted by linear least squares about
the nearest entry, twice. An error of the entry's shape changes the dot symmetrically about its
centre, so to first order it does not bias the centre. It does to second order: dots that are far
from round, as under an oblique camera, are fitted once more in a frame in which they are round.
"""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int

from estimation.pictures.dots.find import Dots, DotStyle
from estimation.pictures.dots.fit import model_dots

DOT_ELONGATION = (1.15, 3.0)
"""Ratio of a dot's axes from which it is fitted in its own frame, and the largest of a dot."""
PARTS_PER_PIXEL = 8
"""Steps between the tabulated centres across a pixel, both edges included."""
RELATIVE_SIZES = (0.8, 0.9, 1.0, 1.12, 1.25)
"""Tabulated radii, as multiples of the typical radius."""


class Templates(NamedTuple):
    """Tabulated dots.

    Attributes:
        dx: of the window's pixels, from its middle.
        dy: the same along y.
        jacobian: derivatives of each entry by the first seven parameters of `model_dots`, for a dot
            of height 1; the entries are sorted by radius, then y, then x.
        background: derivatives by the last three parameters, equal for all entries.
        gram: products of the derivatives.
        inverse: inverse of the damped products.
    """

    dx: Int[np.ndarray, " pixels"]
    dy: Int[np.ndarray, " pixels"]
    jacobian: Float[np.ndarray, "entries 7 pixels"]
    background: Float[np.ndarray, "3 pixels"]
    gram: Float[np.ndarray, "entries 10 10"]
    inverse: Float[np.ndarray, "entries 10 10"]

    def fit(
        self, entry: Int[np.ndarray, " #n"], value: Float[np.ndarray, "n pixels"]
    ) -> Float[np.ndarray, "n 10"]:
        """Fit the ten parameters of each window by linear least squares about an entry.

        Args:
            entry: number of each window's entry, or a single entry for all windows.
            value: grey levels of the windows minus their mean.
        """
        if len(entry) == 1 or (len(entry) and (entry == entry[0]).all()):  # as for seeds
            own = value @ self.jacobian[entry[0]].T
        else:
            own = np.matmul(self.jacobian[entry], value[..., None])[..., 0]
        products = np.concatenate([own, value @ self.background.T], axis=1).astype(float)
        return np.matmul(self.inverse[entry], products[..., None])[..., 0]


@lru_cache(maxsize=4)
def make_templates(radius: float, blur: float) -> Templates:
    """Tabulate dots around a typical radius [px], with a given blur [px]."""
    half = int(np.ceil(1.5 * radius + 2.0))
    dy, dx = np.mgrid[-half : half + 1, -half : half + 1].reshape(2, -1)
    inside = dx**2 + dy**2 <= (half + 0.5) ** 2
    dx, dy = dx[inside], dy[inside]
    spots = np.arange(PARTS_PER_PIXEL + 1) / PARTS_PER_PIXEL - 0.5
    size, y, x = (a.ravel() for a in np.meshgrid(RELATIVE_SIZES, spots, spots, indexing="ij"))
    zero, one = np.zeros_like(x), np.ones_like(x)
    inverse = 1.0 / (radius * size)
    p = np.stack([x, y, inverse, inverse, zero, blur * one, one, zero, zero, zero], axis=1)
    single = (values.astype(np.float32) for values in (p, dx, dy))
    _, jacobian = model_dots(*single)
    gram = (jacobian @ jacobian.transpose(0, 2, 1)).astype(float)
    own, background = np.ascontiguousarray(jacobian[:, :7]), jacobian[0, 7:].copy()
    return Templates(dx, dy, own, background, gram, np.linalg.inv(_damp(gram)))


def _damp(gram: Float[np.ndarray, "n 10 10"]) -> Float[np.ndarray, "n 10 10"]:
    share = 1e-5  # share of each diagonal element that is added to it, as in `fit_windows`
    diagonal = np.einsum("nii->ni", gram)
    damping = share * diagonal + 1e-6
    return gram + damping[:, :, None] * np.eye(10)


def fit_alike(
    grey: Float[np.ndarray, "h w"], seeds: Int[np.ndarray, "n 2"], style: DotStyle
) -> Dots:
    """Fit dots that look similar to the typical dot.

    Args:
        grey: the picture from `to_grey`.
        seeds: initial pixels, each within half a radius of a dot's centre [px].
        style: typical radius and blur, and whether the dots are dark.
    """
    templates = make_templates(style.radius, style.blur)
    centre, size = seeds.astype(float), np.full(len(seeds), RELATIVE_SIZES.index(1.0))
    limit = np.array(grey.shape[::-1]) - 0.501
    rough = _fit_linear(grey, templates, centre, size, style)
    moved = rough.centre - centre
    far = np.hypot(*moved.T) / (0.5 * style.radius)
    centre = np.clip(centre + moved / np.maximum(far, 1.0)[:, None], -0.499, limit)
    radius = np.maximum(rough.radius / style.radius, 1e-3)
    size = np.abs(np.log(radius)[:, None] - np.log(RELATIVE_SIZES)).argmin(axis=1)
    dots = _fit_linear(grey, templates, centre, size, style)
    return _refit_elongated(grey, templates, dots, style)


def _refit_elongated(
    grey: Float[np.ndarray, "h w"], templates: Templates, dots: Dots, style: DotStyle
) -> Dots:
    """Fit elongated dots again, each in its own frame and about the entry at a pixel's middle.

    Dots that the picture's border cuts stay as they are.
    """
    least, most = DOT_ELONGATION
    elongation = dots.elongation
    far = np.flatnonzero((elongation > least) & (elongation < most))
    frame = dots.axes[far] / style.radius
    window = np.array([templates.dx, templates.dy], np.float32)
    place = dots.centre[far, :, None].astype(np.float32) + frame.astype(np.float32) @ window
    last = np.array(grey.shape[::-1], np.float32)[:, None] - 1
    inside = ((place >= 0.0) & (place <= last)).all(axis=(1, 2))
    far, frame, place = far[inside], frame[inside], place[inside]
    if not len(far):
        return dots
    x, y = place.transpose(1, 0, 2)
    value = cv2.remap(grey, x, y, cv2.INTER_LINEAR)
    value -= value.mean(axis=1, keepdims=True)
    middle = PARTS_PER_PIXEL // 2
    entry = (RELATIVE_SIZES.index(1.0) * (PARTS_PER_PIXEL + 1) + middle) * (PARTS_PER_PIXEL + 1)
    entry += middle
    fit = templates.fit(np.array([entry]), value)
    gram, spread = templates.gram[[entry]], templates.inverse[[entry], :2, :2]
    own = _to_dots(fit, value, gram, spread, 1.0 / style.radius, style, float(value.shape[1]))
    # interpolation reduces the noise, and the density of samples is not one a pixel
    some = place[:, :, ::8]  # pixels that are enough for the mean
    share = some - np.floor(some)  # faster than `%`
    kept = 1 - 2 * share * (1 - share)
    noise = (kept[:, 0] * kept[:, 1]).mean(axis=1) * np.linalg.det(frame)
    transposed = frame.transpose(0, 2, 1)
    better = own._replace(
        centre=dots.centre[far] + np.einsum("nij,nj->ni", frame, own.centre),
        covariance=frame @ own.covariance @ transposed / noise[:, None, None],
        axes=_symmetric(frame @ own.axes),
    )
    for values, new in zip(dots, better, strict=True):
        values[far] = new
    return dots


def _symmetric(axes: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2 2"]:
    """Symmetric matrices that map the unit circle to the same ellipses: square roots of A Aᵀ."""
    square = axes @ axes.transpose(0, 2, 1)
    area = np.abs(axes[:, 0, 0] * axes[:, 1, 1] - axes[:, 0, 1] * axes[:, 1, 0])
    width = np.sqrt(square[:, 0, 0] + square[:, 1, 1] + 2.0 * area)  # by Cayley–Hamilton
    return (square + area[:, None, None] * np.eye(2)) / width[:, None, None]


def _fit_linear(
    grey: Float[np.ndarray, "h w"],
    templates: Templates,
    centre: Float[np.ndarray, "n 2"],
    size: Int[np.ndarray, " n"],
    style: DotStyle,
) -> Dots:
    """One linear fit about the entries nearest to the centres."""
    pixel = np.rint(centre).astype(int)
    part = np.rint((centre - pixel + 0.5) * PARTS_PER_PIXEL).astype(int)
    entry = (size * (PARTS_PER_PIXEL + 1) + part[:, 1]) * (PARTS_PER_PIXEL + 1) + part[:, 0]
    width = grey.shape[1]
    index = (pixel @ [1, width])[:, None] + (templates.dy * width + templates.dx)
    reach, last = templates.dx.max(), np.array(grey.shape[::-1]) - 1
    outside = (pixel < reach) | (pixel > last - reach)
    cut = np.flatnonzero(outside.any(axis=1))  # windows that the picture's border cuts
    x, y = pixel[cut, 0, None] + templates.dx, pixel[cut, 1, None] + templates.dy
    there = (x >= 0) & (x < width) & (y >= 0) & (y < len(grey))
    index[cut] *= there
    value = grey.ravel().take(index, mode="wrap")  # unchecked: faster
    value[cut] *= there
    count = np.full(len(value), float(value.shape[1]))
    count[cut] = there.sum(axis=1)
    value -= (value.sum(axis=1) / count).astype(value.dtype)[:, None]
    gram, spread = templates.gram[entry], templates.inverse[entry, :2, :2]
    fit = templates.fit(entry, value)
    if len(cut):
        value[cut] *= there
        planes = np.empty((len(cut), 11, value.shape[1]), np.float32)
        planes[:, :7], planes[:, 7:10] = templates.jacobian[entry[cut]], templates.background
        planes[:, 10] = value[cut]
        planes *= there[:, None].astype(np.float32)
        products = (planes[:, :10] @ planes.transpose(0, 2, 1)).astype(float)
        gram[cut], sides = products[..., :10], np.zeros((len(cut), 10, 3))
        sides[..., 0], sides[:, [0, 1], [1, 2]] = products[..., 10], 1.0
        solved = np.linalg.solve(_damp(gram[cut]), sides)
        fit[cut], spread[cut] = solved[..., 0], solved[:, :2, 1:]
    start_inverse = 1.0 / (style.radius * np.asarray(RELATIVE_SIZES)[size])
    dots = _to_dots(fit, value, gram, spread, start_inverse, style, count)
    return dots._replace(centre=pixel + part / PARTS_PER_PIXEL - 0.5 + dots.centre)


def _to_dots(
    fit: Float[np.ndarray, "n 10"],
    value: Float[np.ndarray, "n pixels"],
    gram: Float[np.ndarray, "#n 10 10"],
    spread: Float[np.ndarray, "#n 2 2"],
    start_inverse: Float[np.ndarray, " n"] | float,
    style: DotStyle,
    count: Float[np.ndarray, " n"] | float,
) -> Dots:
    """Convert linear fits to dots, with centres relative to the entries' centres.

    Args:
        fit: parameters of the fits.
        value: grey levels of the windows minus their mean.
        gram: products of the entries' derivatives.
        spread: covariance of the centres at unit noise, for dots of height 1 [px²].
        start_inverse: 1 / radius of the entries [1/px].
        style: typical blur, and whether the dots are dark.
        count: number of pixels of each window.
    """
    right = np.matmul(gram, fit[..., None])[..., 0]
    power = np.vecdot(value, value).astype(float)
    misfit = np.maximum(power - np.vecdot(fit, right), 0.0)
    height = np.where(np.abs(fit[:, 6]) > 1e-3, fit[:, 6], 1e-3)
    change = fit[:, :6] / height[:, None]
    xx, yy, xy = change[:, 2] + start_inverse, change[:, 3] + start_inverse, change[:, 4]
    determinant = xx * yy - xy * xy
    determinant = np.where(np.abs(determinant) > 1e-6, determinant, 1e-6)
    axes = np.stack([yy, -xy, -xy, xx], axis=1).reshape(-1, 2, 2) / determinant[:, None, None]
    variance = misfit / np.maximum(count - 10.0, 1.0) / height**2
    return Dots(
        centre=change[:, :2],
        covariance=spread * variance[:, None, None],
        axes=axes,
        contrast=-height if style.dark else height,
        blur=style.blur + change[:, 5],
        explained=1.0 - misfit / np.maximum(power, 1e-6),
    )
