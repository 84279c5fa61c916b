"""The object's own rotation, where its edges or texture print through the gel.

What the object prints turns with the object, what is printed on the gel turns with the gel: the
dots are painted out, and the picture is registered with a keyframe by the rigid motion that
correlates the two best ([Evangelidis2008] G. D. Evangelidis, E. Z. Psarakis, "Parametric image
alignment using enhanced correlation coefficient maximization", as OpenCV has it). Where the last
frame's motion leads nowhere, all rotations within `SEARCHED` are tried.

The lamps do not turn with the object: a slope that turns changes its colour. Registered is how far
all colours together depart from what is around: how steep the print is.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Shaped, UInt8

ROWS = 120
"""Rows, about, of the picture that is registered; larger ones are scaled down."""
SMALLEST_DOT = 2.0
"""Radius that scaling down leaves a dot [px]: a smaller one cannot be painted out."""
READING_ERROR = np.radians(0.05)
"""Standard error of a registration with correlation 1 [rad]. Errors add up over keyframes."""
INDEPENDENT = 30.0
"""Parts of a texture that differ from the keyframe by themselves: what the correlation lacks, over
these and over its loss by a turn, is the square of the error [-]; 96 % of 195 registrations in
published clips are in their interval."""
SHADED = 0.01
"""Share of the rotation by which light holds it back [-], the median of 72 published turns."""
LEAST_CORRELATION = 0.65
"""Correlation with the keyframe below which the imprint has lost its place."""
FOUND_AGAIN = 0.8
"""Correlation from which it counts as found again after a search."""
NEW_KEYFRAME = 0.85
"""Correlation below which another keyframe is taken: an earlier one, or a new one."""
KEPT = 8
"""Keyframes that are kept, the first always: registering with an earlier one ends the drift."""
LARGEST_ERROR = np.radians(4.5)
"""Standard error from which the imprint is given up [rad]."""
LEAST_STEP = np.radians(12.0)
"""Rotation against the keyframe from which a new one is taken [rad]."""
TEXTURE = 0.9
"""Grey levels, of 255, that the imprint's own texture must have, all colours together."""
LEAST_LOSS = 40.0
"""What a turn must cost of the correlation, over half its square, to be read [-]: 5 % at 3°. Prints
of published clips have 70 to 260, a smooth ball 20, by what does not turn with it."""
SEARCHED = np.radians(np.arange(-30.0, 31.0, 6.0))
"""Rotations against the keyframe that are tried where the imprint has lost its place [rad]."""
OVERLAP = 0.4
"""Share of the smaller contact region that both must show: elsewhere the pad itself is seen."""
UNSEEN = 4
"""Frames that are passed over after one in which the object prints nothing."""
PATIENCE = 25
"""Frames in a row without the imprint after which it is given up."""
FEWEST = 9
"""Dots of the contact region below which too little of the object is seen."""
STEPS = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 25, 3e-4)


class Imprint(NamedTuple):
    """Rotation of what the object prints, against the first frame.

    Attributes:
        angle: rotation [rad, from x to y of the picture]; NaN where lost.
        error: its standard error [rad].
        quality: correlation with the keyframe [-].
    """

    angle: float
    error: float
    quality: float


LOST = Imprint(np.nan, np.nan, np.nan)


class Texture(NamedTuple):
    """The imprint's texture in one frame.

    Attributes:
        value: grey levels of 255, without dots and slow change of light.
        mask: 255 where there is contact and no dot.
    """

    value: Float32[np.ndarray, "h w"]
    mask: UInt8[np.ndarray, "h w"]


class _Keyframe(NamedTuple):
    texture: Texture
    pose: np.ndarray
    """Takes points of the first keyframe to where they are here, in homogeneous coordinates."""
    error: float

    @property
    def angle(self) -> float:
        return float(np.arctan2(self.pose[1, 0], self.pose[0, 0]))


class _Match(NamedTuple):
    """The rigid motion from a keyframe to a frame, how well the two correlate, and its error."""

    keyframe: _Keyframe
    warp: np.ndarray
    quality: float
    own_error: float

    def pose(self) -> np.ndarray:
        return np.vstack([self.warp, [0.0, 0.0, 1.0]]) @ self.keyframe.pose

    @property
    def turned(self) -> float:
        return float(np.arctan2(self.warp[1, 0], self.warp[0, 0]))

    @property
    def error(self) -> float:
        return float(np.hypot(self.keyframe.error, self.own_error))


class ImprintFollower:
    """Follows the imprint from frame to frame; where it loses its place for long it ends."""

    def __init__(self) -> None:
        """Start without a keyframe: the first frame with contact becomes it."""
        self._restart()

    def _restart(self) -> None:
        """Count from the next frame, against which nothing is known yet."""
        self.keyframes: list[_Keyframe] = []
        self.last: _Match | None = None
        self.before: _Keyframe | None = None
        self.angle = 0.0
        self.missed = 0
        self.resting = 0
        self.confirmed = False
        """Whether a second frame has shown the first one's texture: else it may be noise."""

    def update(self, painted: "Painted", region: Float[np.ndarray, "k 2"]) -> Imprint:
        """Rotation of the imprint in the next frame.

        Args:
            painted: the picture without its dots.
            region: dots of the contact region [px].
        """
        if len(region) < FEWEST:
            return LOST
        if self.resting > 0:
            self.resting -= 1
            return LOST
        texture = cut_out(painted, region)
        if self.last is None or self.before is None:
            return self._begin(texture)
        found = self._find(texture, self.last, self.before)
        if found is None or found.error > LARGEST_ERROR:
            self.missed += 1
            if self.confirmed and self.missed <= PATIENCE:
                return LOST
            shaded = not self.confirmed  # light, that no second frame has shown
            self._restart()
            self.resting = UNSEEN if shaded else 0
            return LOST if shaded else self._begin(texture)
        self.missed, self.confirmed = 0, True
        self.before = _Keyframe(texture, found.pose(), found.error)
        self.angle += float(np.angle(np.exp(1j * (self.before.angle - self.angle))))
        self.last = found
        if found.quality < NEW_KEYFRAME or abs(found.turned) > LEAST_STEP:
            self._keep(self.before)
        error = float(np.hypot(found.error, SHADED * self.angle))
        return Imprint(self.angle, error, found.quality)

    def _begin(self, texture: Texture) -> Imprint:
        if texture.value[texture.mask > 0].std() < TEXTURE:
            self.resting = UNSEEN
            return LOST
        self.before = _Keyframe(texture, np.eye(3), 0.0)
        self._keep(self.before)
        return Imprint(0.0, READING_ERROR, 1.0)

    def _keep(self, keyframe: _Keyframe) -> None:
        """Make it the keyframe to register with."""
        self.keyframes.append(keyframe)
        if len(self.keyframes) > KEPT:
            del self.keyframes[1]
        self.last = _Match(keyframe, np.eye(2, 3, dtype=np.float32), 1.0, READING_ERROR)

    def _find(self, texture: Texture, last: _Match, before: _Keyframe) -> _Match | None:
        """The motion to this frame; None where the imprint has lost its place.

        Tried are the keyframe of the last frame; where that fits badly, earlier ones, from the
        first on, that leave less of an error; the last frame; and at last all rotations.
        """
        found = register(last.keyframe, texture, last.warp, LEAST_CORRELATION)
        if found is not None and found.quality >= NEW_KEYFRAME:
            return found
        pose = before.pose if found is None else found.pose()
        for earlier in self.keyframes:
            if earlier is last.keyframe or earlier.error >= last.keyframe.error:
                continue
            start = (pose @ np.linalg.inv(earlier.pose))[:2].astype(np.float32)
            closed = register(earlier, texture, start, LEAST_CORRELATION)
            if closed is not None and (found is None or closed.error < found.error):
                return closed
        if found is not None:
            return found
        still = np.eye(2, 3, dtype=np.float32)
        found = register(before, texture, still, LEAST_CORRELATION)
        if found is None and self.confirmed:
            guess = search_motion(before.texture, texture)
            found = None if guess is None else register(before, texture, guess, FOUND_AGAIN)
        return found


def register(
    keyframe: _Keyframe, texture: Texture, start: Float[np.ndarray, "2 3"], least: float
) -> _Match | None:
    """The rigid motion from a keyframe to a frame; None where they correlate too little."""
    before = keyframe.texture
    shown = cv2.warpAffine(before.mask, start, before.mask.shape[::-1], flags=cv2.INTER_NEAREST)
    both = cv2.bitwise_and(shown, texture.mask)
    areas = cv2.countNonZero(before.mask), cv2.countNonZero(texture.mask)
    if cv2.countNonZero(both) < OVERLAP * min(areas):
        return None
    pair = before.value, texture.value
    try:
        quality, warp = cv2.findTransformECC(
            *pair, start.copy(), cv2.MOTION_EUCLIDEAN, STEPS, inputMask=both, gaussFiltSize=3
        )
    except cv2.error:  # it has not converged
        return None
    if quality <= least:
        return None
    loss = _turning_loss(before, texture, np.asarray(warp))
    if loss < LEAST_LOSS:
        return None
    error = np.hypot(READING_ERROR, np.sqrt((1.0 - quality) / (INDEPENDENT * loss)))
    return _Match(keyframe, np.asarray(warp), float(quality), float(error))


def _turning_loss(before: Texture, now: Texture, warp: np.ndarray) -> float:
    """What a turn from where they fit would cost of the correlation, over half its square [-].

    It comes from the product of both slopes: noise, which they do not share, is left out.
    """
    size, back = before.value.shape[::-1], cv2.WARP_INVERSE_MAP
    value = cv2.warpAffine(now.value, warp, size, flags=cv2.INTER_LINEAR | back)
    shown = cv2.warpAffine(now.mask, warp, size, flags=cv2.INTER_NEAREST | back)
    both = cv2.erode(cv2.bitwise_and(before.mask, shown), np.ones((3, 3), np.uint8)) > 0
    rows, columns = np.nonzero(both)
    if not len(rows):
        return 0.0
    x, y = columns - columns.mean(), rows - rows.mean()
    products = []
    for one in (before.value, value):
        right = cv2.Sobel(one, cv2.CV_32F, 1, 0, scale=0.125)[both]
        down = cv2.Sobel(one, cv2.CV_32F, 0, 1, scale=0.125)[both]
        products.append((x * down - y * right, one[both] - one[both].mean()))
    (turn, level), (turn_now, level_now) = products
    return float(np.sum(turn * turn_now) / max(np.sum(level * level_now), 1e-9))


def search_motion(before: Texture, now: Texture) -> Float[np.ndarray, "2 3"] | None:
    """The rigid motion, of all within the range searched, under which two textures correlate best.

    Fourier transforms give, for every rotation, the correlation under all shifts at once.
    """
    rows, columns = now.value.shape
    shape = (cv2.getOptimalDFTSize(2 * rows), cv2.getOptimalDFTSize(2 * columns))
    shown = (now.mask > 0).astype(np.float32)
    planes = shown * now.value, shown, shown * now.value**2
    spectra = [np.fft.rfft2(plane, shape) for plane in planes]
    middle = (0.5 * (columns - 1), 0.5 * (rows - 1))
    best, most = None, 0.0
    for turn in SEARCHED:
        ahead = cv2.getRotationMatrix2D(middle, -np.degrees(turn), 1.0)
        value = cv2.warpAffine(before.value, ahead, (columns, rows))
        mask = cv2.warpAffine((before.mask > 0).astype(np.float32), ahead, (columns, rows))
        mask = (mask > 0.5).astype(np.float32)
        turned = [np.conj(np.fft.rfft2(p, shape)) for p in (mask * value, mask, mask * value**2)]
        both, left, right, here, there = (
            np.fft.irfft2(a * b, shape)
            for a, b in (
                (spectra[0], turned[0]),
                (spectra[2], turned[1]),
                (spectra[1], turned[2]),
                (spectra[1], turned[1]),
                (spectra[0], turned[1]),
            )
        )
        other = np.fft.irfft2(spectra[1] * turned[0], shape)
        count = np.maximum(here, 1.0)
        size = (left - there**2 / count) * (right - other**2 / count)
        score = np.where(
            (here > OVERLAP * min(mask.sum(), shown.sum())) & (size > 0.0),
            (both - there * other / count) / np.sqrt(np.maximum(size, 1e-6)),
            0.0,
        )
        highest = float(score.max())
        if highest > most:
            down, right_ = np.unravel_index(int(score.argmax()), score.shape)
            shift = [right_ - shape[1] * (right_ > columns), down - shape[0] * (down > rows)]
            most, best = highest, ahead + np.array([[0.0, 0.0, shift[0]], [0.0, 0.0, shift[1]]])
    return None if best is None else best.astype(np.float32)


class Painted(NamedTuple):
    """A picture without its dots and the slow change of its light, scaled down.

    Attributes:
        planes: its colours, grey levels of 255, smoothed.
        texture: how far all together depart from what is around; without colours grey levels.
        clear: 1 where there is no dot, nor one that the side may cut; else 0.
        power: squares of all colours' departure and 1 where there is no dot, up to the sides.
        part: by how much it has been scaled down [-].
        radius: typical, of a dot in it [px].
    """

    planes: list[Float32[np.ndarray, "h w"]]
    texture: Float32[np.ndarray, "h w"]
    clear: Float32[np.ndarray, "h w"]
    power: Float32[np.ndarray, "2 h w"]
    part: int
    radius: float

    def level(self, points: Float[np.ndarray, "n 2"], reach: float) -> Float[np.ndarray, " n"]:
        """Root mean square of the texture around each of some points, over all colours.

        Args:
            points: in the picture as it was [px]; NaN where there is none.
            reach: half the side of the square around each [px].
        """
        width = (2 * int(reach / self.part) + 1,) * 2
        power, shown = (cv2.blur(one, width) for one in self.power)
        level = np.sqrt(power / (shown + 1e-3))
        place = np.rint(np.nan_to_num(points) / self.part).astype(int)
        column, row = np.clip(place, 0, np.array(level.shape[::-1]) - 1).T
        return np.where(np.isfinite(points[:, 0]), level[row, column], np.nan)


def paint_out(
    picture: Shaped[np.ndarray, "h w *colour"],
    dots: Float[np.ndarray, "n 2"],
    radius: float,
    seen: Bool[np.ndarray, "h w"] | None = None,
) -> Painted:
    """The picture with the dots and the slow change of light taken off, scaled down.

    Args:
        picture: of the frame.
        dots: all dots in it [px].
        radius: typical, of a dot [px].
        seen: pixels that are read; all by default.
    """
    part = max(min(round(picture.shape[0] / ROWS), int(radius / SMALLEST_DOT)), 1)
    size = (picture.shape[1] // part, picture.shape[0] // part)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    image = small.astype(np.float32) * np.float32(1.0 / 257.0 if small.dtype == np.uint16 else 1.0)
    dots, radius = dots / part, radius / part
    shown = np.ones(image.shape[:2], np.float32)
    for x, y in np.rint(dots * 16).astype(int).tolist():
        cv2.circle(shown, (x, y), int(16 * 1.6 * radius), 0.0, -1, shift=4)
    if seen is not None:
        shown[cv2.resize(seen.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 0] = 0.0
    rim = round(1.6 * radius)  # of dots that the side cuts, whose middle is not seen
    clear = np.zeros_like(shown)
    clear[rim:-rim, rim:-rim] = shown[rim:-rim, rim:-rim]
    colours = [image] if image.ndim == 2 else list(cv2.split(image[..., :3]))

    def without_around(plane: np.ndarray, clear: np.ndarray) -> np.ndarray:
        width = (2 * int(4.0 * radius) + 1,) * 2
        around = cv2.blur(plane * clear, width) / (cv2.blur(clear, width) + np.float32(1e-3))
        return (plane - around) * clear

    def smooth(clear: np.ndarray) -> list[np.ndarray]:
        return [cv2.GaussianBlur(without_around(one, clear), (0, 0), 1.0) for one in colours]

    planes, power = smooth(clear), shown * np.sum(np.square(smooth(shown)), axis=0)
    texture = planes[0]
    if len(planes) > 1:
        texture = without_around(np.sqrt(np.sum(np.square(planes), axis=0)), clear)
    return Painted(planes, texture, clear, np.stack([power, shown]), part, radius)


def cut_out(painted: Painted, region: Float[np.ndarray, "k 2"]) -> Texture:
    """The texture of the contact region.

    Args:
        painted: the picture.
        region: dots of the contact region [px of the picture as it was].
    """
    mask = np.zeros(painted.clear.shape, np.uint8)
    hull = cv2.convexHull((region / painted.part).astype(np.float32)).astype(np.int32)
    cv2.fillConvexPoly(mask, hull, 255)
    mask = cv2.dilate(mask, np.ones((2 * int(painted.radius) + 1,) * 2, np.uint8))
    mask[painted.clear == 0.0] = 0
    return Texture(painted.texture, mask)
