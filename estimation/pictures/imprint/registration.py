"""Registration of two textures by the rigid motion of highest correlation, and its error."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Complex, Float, Float32, Int, UInt8
from scipy.fft import irfft2, rfft2

from estimation.frames.state import WithoutCaches
from estimation.pictures.imprint.alignment import Template, find_slopes, undo
from estimation.pictures.imprint.marks import find_marks
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture


@dataclass(frozen=True, eq=False)
class Keyframe(WithoutCaches):
    """A frame with which later frames are registered.

    Attributes:
        texture: of the imprint in the frame.
        pose: maps points of the first keyframe to this frame, in homogeneous coordinates.
        error: standard error of the rotation since the first keyframe [rad].
        spread: covariance of the position of the contact's middle [px²].
    """

    texture: Texture
    pose: Float[np.ndarray, "3 3"]
    error: float
    spread: Float[np.ndarray, "2 2"]

    @cached_property
    def template(self) -> Template:
        """The texture, made ready for registrations with it."""
        return Template(self.texture)

    @property
    def angle(self) -> float:
        """Rotation since the first keyframe [rad]."""
        return float(np.arctan2(self.pose[1, 0], self.pose[0, 0]))


class Match(NamedTuple):
    """A frame registered with a keyframe.

    Attributes:
        keyframe: the keyframe.
        warp: rigid motion from the keyframe to the frame.
        quality: correlation of the two textures [-].
        own_error: standard error of the rotation between the two [rad].
        own_spread: covariance of the shift of the contact's middle between the two [px²].
        shaded: share of a rotation that light may hide, because it does not move with the object;
            a standard error [-].
        shaded_shift: the same of shifts, as a matrix [-].
        slope: root mean square change of the print's levels by a rotation [grey levels/rad].
    """

    keyframe: Keyframe
    warp: Float[np.ndarray, "2 3"]
    quality: float
    own_error: float
    own_spread: Float[np.ndarray, "2 2"]
    shaded: float
    shaded_shift: Float[np.ndarray, "2 2"]
    slope: float = np.inf

    @property
    def pose(self) -> Float[np.ndarray, "3 3"]:
        """Motion since the first keyframe, as in `Keyframe`."""
        return np.vstack([self.warp, [0.0, 0.0, 1.0]]) @ self.keyframe.pose

    @property
    def turned(self) -> float:
        """Rotation since the keyframe [rad]."""
        return float(np.arctan2(self.warp[1, 0], self.warp[0, 0]))

    @property
    def error(self) -> float:
        """Standard error of the rotation since the first keyframe [rad]."""
        return float(np.hypot(self.keyframe.error, self.own_error))

    @property
    def spread(self) -> Float[np.ndarray, "2 2"]:
        """Covariance of the position of the contact's middle [px²]."""
        return self.keyframe.spread + self.own_spread


def register(
    keyframe: Keyframe,
    texture: Texture,
    start: Float[np.ndarray, "2 3"],
    settings: ImprintSettings,
) -> Match | None:
    """Estimate the rigid motion from a keyframe to a frame; None if they correlate too little.

    Args:
        keyframe: the keyframe.
        texture: of the frame.
        start: initial motion.
        settings: of the registration.
    """
    warp, quality, marks = start, 0.0, None
    for left in reversed(range(1 + (settings.separations if texture.grey else 0))):
        aligned = keyframe.template.align(texture, warp, settings, marks)
        if aligned is None or aligned.quality <= settings.least_correlation:
            return None
        warp, quality = aligned
        if left:
            marks = find_marks(keyframe.template, texture, warp)
            if not marks.any():
                break
    if keyframe.template.compare_own(texture, warp) < settings.least_own:
        return None
    fit = _compare(keyframe.template, texture, warp, marks)
    if fit is None or fit.loss[0, 0] < settings.least_loss:
        return None
    inverse = _invert_loss(fit, settings)
    turn, right, down = (inverse @ (fit.slopes @ fit.misfit)).tolist()
    warp = warp @ undo((right, down), turn, fit.middle)
    error = float(np.hypot(np.radians(settings.reading_deg), _spread_turn(fit, inverse, settings)))
    lacking = (1.0 - quality) / settings.independent
    spread = _spread_shift(fit, lacking, texture.value.size, settings)
    shaded = settings.shaded_grey if texture.grey else settings.shaded
    turned = max(shaded, (settings.unturned / float(fit.loss[0, 0])) ** 2)
    shifted = _share_hidden(fit, turned, settings)
    slope = math.sqrt(float(fit.loss[0, 0]) * fit.correlation * fit.power)
    return Match(keyframe, warp, quality, error, spread, turned, shifted, slope)


class _Fit(NamedTuple):
    """Comparison of two registered textures.

    Attributes:
        place: row and column of the pixels that both textures show.
        middle: their mean x and y.
        arm: their root mean square distance from it along x or y [px].
        slopes: change of each pixel's level by a rotation about the middle and by shifts along x
            and y.
        misfit: difference of the levels of each pixel; the levels are normalised to length 1.
        loss: loss of correlation by these motions, over half their squares [-, 1/px²].
        apart: share of that loss by shifts, from pixels that are not beside hidden ones [1/px²].
        correlation: of the levels, to which the loss is relative [-].
        power: mean square of the levels before [grey levels²].
    """

    place: Int[np.ndarray, "2 n"]
    middle: tuple[float, float]
    arm: float
    slopes: Float[np.ndarray, "3 n"]
    misfit: Float[np.ndarray, " n"]
    loss: Float[np.ndarray, "3 3"]
    apart: Float[np.ndarray, "2 2"]
    correlation: float
    power: float


def _compare(
    template: Template,
    now: Texture,
    warp: Float[np.ndarray, "2 3"],
    marks: Bool[np.ndarray, "rows columns"] | None,
) -> _Fit | None:
    """Compare two registered textures but for marks; None if they do not overlap.

    The loss is the product of both textures' slopes, whose noise is independent and thus cancels.
    """
    value = template.bring(now.value, warp, cv2.INTER_LINEAR)
    shown = template.bring(now.mask, warp, cv2.INTER_NEAREST)
    mask = cv2.bitwise_and(template.texture.mask[template.box], shown)
    if marks is not None:
        mask[marks] = 0
    shared = np.zeros_like(mask)
    shared[template.thinned] = cv2.erode(mask, np.ones((3, 3), np.uint8))[template.thinned]
    shared = np.flatnonzero(shared)  # faster than `nonzero`
    if not len(shared):
        return None
    start = [[part.start] for part in template.box]
    place = np.stack(np.unravel_index(shared, mask.shape)) + np.array(start)
    middle = place.mean(axis=1)
    y, x = place.astype(np.float32) - middle[:, None].astype(np.float32)
    slopes, levels, power = [], [], 1.0 / len(x)
    earlier = template.texture.value[template.box]
    for plane, along in ((earlier, template.slopes), (value, find_slopes(value))):
        right, down = (slope.ravel()[shared] for slope in along)
        level = plane.ravel()[shared]
        level -= level.mean()
        scale = np.float32(1.0 / max(math.sqrt(level @ level), 1e-6))
        slopes.append(scale * np.array([x * down - y * right, right, down]))
        levels.append(scale * level)
        power /= float(scale)
    correlation = max(float(levels[0] @ levels[1]), 1e-6)
    loss = slopes[0] @ slopes[1].T / correlation
    beside = 2  # reach of hidden pixels: the width of the smoothing, and a slope [px]
    inner = cv2.erode(mask, np.ones((2 * beside + 1,) * 2, np.uint8)).ravel()[shared] > 0
    apart = (slopes[0][1:] * inner) @ slopes[1][1:].T / correlation
    return _Fit(
        place=place,
        middle=(float(middle[1]), float(middle[0])),
        arm=float(np.sqrt((x @ x + y @ y) / (2 * len(x)))),
        slopes=0.5 * (slopes[0] + slopes[1]),
        misfit=levels[1] - levels[0],
        loss=0.5 * (loss + loss.T),
        apart=0.5 * (apart + apart.T),
        correlation=correlation,
        power=power,
    )


def _invert_loss(fit: _Fit, settings: ImprintSettings) -> Float[np.ndarray, "3 3"]:
    """Converts pulls of pixels to a motion; 0 along motions that the print hardly shows."""
    scale = np.array([1.0 / fit.arm, 1.0, 1.0])
    along, ways = np.linalg.eigh(fit.loss * np.outer(scale, scale))
    seen = np.abs(along) > settings.alike * np.abs(along).max()
    inverse = (ways * seen / np.where(seen, along, 1.0)) @ ways.T
    return inverse * np.outer(scale, scale) / fit.correlation


def _spread_turn(fit: _Fit, inverse: Float[np.ndarray, "3 3"], settings: ImprintSettings) -> float:
    """Standard error of a rotation [rad].

    Differences between the two prints pull the estimated rotation in both directions. The sandwich
    estimate of the error adds up the pulls of all patches as independent ([White1982] H. White,
    "Maximum likelihood estimation of misspecified models").
    """
    rows, columns = fit.place // settings.patch
    patch = rows * (columns.max() + 1) + columns
    count, motions = np.count_nonzero(np.bincount(patch)), len(fit.slopes)
    if count <= motions:
        return np.inf
    pulls = np.stack([np.bincount(patch, pull) for pull in fit.slopes * fit.misfit])
    turned = inverse[0] @ pulls
    return float(np.linalg.norm(turned) * np.sqrt(count / (count - motions)))


def _spread_shift(
    fit: _Fit, lacking: float, area: int, settings: ImprintSettings
) -> Float[np.ndarray, "2 2"]:
    """Covariance of a shift [px²]; along uniform prints its variance is the picture's area.

    A print does not depend on the places of the dots. Pixels beside the dots keep some light of
    them, which moves with the gel. If a print shows a shift mostly by these pixels, the print
    itself is uniform along that shift.
    """
    mostly = 0.5  # share that pixels apart from the dots must have along the print [-]
    along, ways = np.linalg.eigh(fit.loss[1:, 1:])
    apart = np.sum(ways * (fit.apart @ ways), axis=0)
    own = apart * along[1] > mostly * along * apart[1]
    seen = (along > settings.alike * along[1]) & own
    variance = settings.reading_px**2 + lacking / np.where(seen, along, 1.0)
    return (ways * np.where(seen, variance, area)) @ ways.T


def _share_hidden(fit: _Fit, least: float, settings: ImprintSettings) -> Float[np.ndarray, "2 2"]:
    """Share of shifts that light may hide, as in `Match`.

    A shift by the print's arm counts as a rotation by 1 rad.

    Args:
        fit: of the registration.
        least: smallest share [-].
        settings: of the registration.
    """
    most = 0.5  # at most all of the shift is hidden, within two standard errors
    along, ways = np.linalg.eigh(fit.arm**2 * fit.loss[1:, 1:])
    share = (settings.unshifted / np.maximum(along, settings.unshifted)) ** 4
    return (ways * np.clip(share, least, most)) @ ways.T


def search_motions(
    before: Texture, now: Texture, settings: ImprintSettings
) -> list[Float[np.ndarray, "2 3"]]:
    """Search the rigid motions, within the searched range, under which two textures correlate.

    For every rotation, Fourier transforms give the correlation under all shifts at once. Rotations
    are tried in coarse steps, for which small pictures suffice.

    Returns:
        The motions of highest correlation, two shifts for a rotation at most, the highest first.
    """
    step = 6.0  # between tried rotations [deg]
    few = 40  # approximate rows of the small pictures
    part = max(round(now.mask.shape[0] / few), 1)
    turns = np.arange(-settings.searched_deg, settings.searched_deg + 0.5 * step, step)
    (earlier, mask), (value, shown) = _shrink(before, part), _shrink(now, part)
    size = shown.shape[::-1]
    middle = (0.5 * (size[0] - 1), 0.5 * (size[1] - 1))
    motions = [cv2.getRotationMatrix2D(middle, -turn, 1.0) for turn in turns]
    masks = np.stack([cv2.warpAffine(mask, ahead, size) > 0.5 for ahead in motions])
    start, end = _box(masks.max(axis=0).astype(np.uint8)), _box(shown.astype(np.uint8))
    value, shown = value[end], shown[end]
    rows, columns = shown.shape
    high, wide = masks[:, *start].shape[1:]
    shape = cv2.getOptimalDFTSize(rows + high), cv2.getOptimalDFTSize(columns + wide)
    spectra = np.asarray(rfft2(np.stack([value, shown, value**2]), shape))
    found = []
    for ahead, there in zip(motions, masks[:, *start].astype(np.float32), strict=True):
        turned = there * cv2.warpAffine(earlier, ahead, size)[start]
        least = settings.overlap * float(min(there.sum(), shown.sum()))
        conjugate = np.conj(np.asarray(rfft2(np.stack([turned, there, turned**2]), shape)))
        for height, down, right in _find_peaks(_correlate(spectra, conjugate, shape, least)):
            right += end[1].start - start[1].start - shape[1] * (right > columns)
            down += end[0].start - start[0].start - shape[0] * (down > rows)
            found.append((height, ahead + np.column_stack([np.zeros((2, 2)), (right, down)])))
    found = sorted(found, key=lambda peak: -peak[0])[: settings.compared]
    corner = np.full(2, 0.5 * (part - 1))  # middle of the first small pixel in the large picture
    for _, motion in found:
        motion[:, 2] = part * motion[:, 2] + corner - motion[:, :2] @ corner
    return [motion.astype(np.float32) for _, motion in found]


def _find_peaks(score: Float32[np.ndarray, "h w"]) -> list[tuple[float, int, int]]:
    """The two highest correlations above 0 that are not neighbours, with their rows and columns.

    Shifts are cyclic.
    """
    beside = 4  # reach of a peak [px of the small pictures]
    peaks, reach = [], np.arange(-beside, beside + 1)
    for _ in range(2):
        down, right = (int(place) for place in np.unravel_index(score.argmax(), score.shape))
        if score[down, right] <= 0.0:
            break
        peaks.append((float(score[down, right]), down, right))
        rows, columns = (down + reach) % score.shape[0], (right + reach) % score.shape[1]
        score[np.ix_(rows, columns)] = 0.0
    return peaks


def _box(mask: UInt8[np.ndarray, "h w"]) -> tuple[slice, slice]:
    """Rows and columns of the part of a picture that a mask shows."""
    x, y, width, height = cv2.boundingRect(mask)
    return slice(y, y + height), slice(x, x + width)


def _shrink(
    texture: Texture, part: int
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """A texture scaled down by a factor, 0 where hidden; and its mask, 1 where shown."""
    rows, columns = (size // part for size in texture.value.shape)
    shown = (texture.mask[: part * rows, : part * columns] > 0).astype(np.float32)
    value = shown * texture.value[: part * rows, : part * columns]
    value, shown = (
        cv2.resize(plane, (columns, rows), interpolation=cv2.INTER_AREA) for plane in (value, shown)
    )
    mask = (shown > 0.5).astype(np.float32)
    return mask * value / np.maximum(shown, 0.5), mask


def _correlate(
    now: Complex[np.ndarray, "3 h k"],
    before: Complex[np.ndarray, "3 h k"],
    shape: tuple[int, int],
    least: float,
) -> Float32[np.ndarray, "h w"]:
    """Correlation of two textures where both are shown, under every shift of the earlier one.

    Args:
        now: transforms of the texture, of its mask and of its square.
        before: conjugates of the same transforms of the earlier texture.
        shape: of the shifts.
        least: least number of pixels that both must show; the correlation is 0 with fewer.
    """
    value, shown, square = now
    earlier, there, squared = before
    products = [value * earlier, square * there, shown * squared]
    sums = [value * there, shown * earlier, shown * there]
    product, left, right, first, second, count = np.asarray(
        irfft2(np.stack(products + sums), shape)
    )
    count = np.maximum(count, 1.0)
    size = (left - first**2 / count) * (right - second**2 / count)
    score = (product - first * second / count) / np.sqrt(np.maximum(size, 1e-6))
    return np.where((count > least) & (size > 0.0), score, 0.0)
