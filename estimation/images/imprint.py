"""The object's own rotation, where its edges or texture print through the gel.

What the object prints turns with the object, what is printed on the gel turns with the gel: the
dots are painted out, and the picture is registered with a keyframe by the rigid motion that
correlates the two best ([Evangelidis2008] G. D. Evangelidis, E. Z. Psarakis, "Parametric image
alignment using enhanced correlation coefficient maximization", as OpenCV has it).
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8

LEAST_CORRELATION = 0.6
"""Correlation with the keyframe below which the imprint has lost its place."""
NEW_KEYFRAME = 0.8
"""Correlation below which the frame before becomes the next keyframe."""
KEYFRAME_ERROR = np.radians(0.3)
"""Standard error of one registration [rad]; they add up over keyframes."""
LEAST_STEP = np.radians(12.0)
"""Rotation against the keyframe from which a new one is taken [rad]."""
TEXTURE = 1.5
"""Grey levels, of 255, that the imprint's own texture must have."""
STEPS = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-4)


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


class _Keyframe(NamedTuple):
    texture: np.ndarray
    mask: np.ndarray
    angle: float
    error: float


class ImprintFollower:
    """Follows the imprint from frame to frame; where it loses its place it ends."""

    def __init__(self) -> None:
        """Start without a keyframe: the first frame with contact becomes it."""
        self.keyframe: _Keyframe | None = None
        self.warp = np.eye(2, 3, dtype=np.float32)
        self.before: _Keyframe | None = None
        self.ended = False

    def update(
        self,
        picture: Shaped[np.ndarray, "h w *colour"],
        dots: Float[np.ndarray, "n 2"],
        radius: float,
        region: Float[np.ndarray, "k 2"],
    ) -> Imprint:
        """Rotation of the imprint in the next frame.

        Args:
            picture: of the frame.
            dots: all dots in it [px].
            radius: typical, of a dot [px].
            region: dots of the contact region [px].
        """
        if self.ended or len(region) < 4:
            return LOST
        texture, mask = paint_out(picture, dots, radius, region)
        if self.keyframe is None:
            if texture[mask > 0].std() < TEXTURE:
                return LOST
            self.keyframe = self.before = _Keyframe(texture, mask, 0.0, 0.0)
            return Imprint(0.0, KEYFRAME_ERROR, 1.0)
        found = self._register(texture, mask)
        if found is None and self.before is not None:
            self.keyframe, self.warp = self.before, np.eye(2, 3, dtype=np.float32)
            found = self._register(texture, mask)
        if found is None:
            self.ended = True
            return LOST
        angle, quality = found
        error = float(np.hypot(self.keyframe.error, KEYFRAME_ERROR))
        self.before = _Keyframe(texture, mask, self.keyframe.angle + angle, error)
        result = Imprint(self.before.angle, error, quality)
        if quality < NEW_KEYFRAME or abs(angle) > LEAST_STEP:
            self.keyframe, self.warp = self.before, np.eye(2, 3, dtype=np.float32)
        return result

    def _register(self, texture: np.ndarray, mask: np.ndarray) -> tuple[float, float] | None:
        """Rotation against the keyframe and correlation; None where there is no such motion."""
        assert self.keyframe is not None
        try:
            quality, warp = cv2.findTransformECC(
                self.keyframe.texture,
                texture,
                self.warp.copy(),
                cv2.MOTION_EUCLIDEAN,
                STEPS,
                inputMask=mask,
                gaussFiltSize=5,
            )
        except cv2.error:  # it has not converged
            return None
        if not quality > LEAST_CORRELATION:
            return None
        self.warp = np.asarray(warp, dtype=np.float32)
        return float(np.arctan2(warp[1, 0], warp[0, 0])), float(quality)


def paint_out(
    picture: Shaped[np.ndarray, "h w *colour"],
    dots: Float[np.ndarray, "n 2"],
    radius: float,
    region: Float[np.ndarray, "k 2"],
) -> tuple[Float[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
    """The imprint's texture with the dots and the slow change of light taken off, and its mask.

    Returns:
        Texture [grey levels of 255], and a mask of 255 where there is contact and no dot.
    """
    scale = 1.0 / 257.0 if picture.dtype == np.uint16 else 1.0
    image = picture.astype(np.float32) * np.float32(scale)
    clear = np.full(image.shape[:2], 1.0, np.float32)
    for x, y in np.rint(dots * 16).astype(int):
        cv2.circle(clear, (int(x), int(y)), int(16 * 1.6 * radius), 0.0, -1, shift=4)
    width = 3.0 * radius
    weight = cv2.GaussianBlur(clear, (0, 0), width) + 1e-3
    planes = image[..., None] if image.ndim == 2 else image
    textures = [
        (plane - cv2.GaussianBlur(plane * clear, (0, 0), width) / weight) * clear
        for plane in np.moveaxis(planes, -1, 0)
    ]
    strongest = max(textures, key=lambda plane: float(plane.std()))
    hull = cv2.convexHull(region.astype(np.float32)).astype(np.int32)
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.fillConvexPoly(mask, hull, 255)
    mask = cv2.dilate(mask, np.ones((2 * int(radius) + 1,) * 2, np.uint8))
    mask[clear == 0.0] = 0
    return cv2.GaussianBlur(strongest, (0, 0), 1.0), mask
