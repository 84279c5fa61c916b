"""The texture of the imprint in a contact, cut out of a painted picture."""

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from estimation.frames.state import WithoutCaches
from estimation.pictures.imprint.painted import Painted


@dataclass(frozen=True, eq=False)
class Texture(WithoutCaches):
    """The imprint's texture in one frame.

    Attributes:
        value: grey levels of 255, without dots and slow changes of light.
        mask: 255 in contact without a dot, else 0.
        grey: whether the picture has no colours.
        shear: mean displacement of the gel under it from rest [px of the scaled picture]; 0 if
            unknown.
        gel: motion of that gel from rest, in homogeneous coordinates; known in grey pictures only.
        worn: 255 at worn dots that the mask shows, which move with the gel; None without any.
    """

    value: Float32[np.ndarray, "h w"]
    mask: UInt8[np.ndarray, "h w"]
    grey: bool = False
    shear: Float[np.ndarray, " 2"] = field(default_factory=lambda: np.zeros(2))
    gel: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    worn: UInt8[np.ndarray, "h w"] | None = None

    @cached_property
    def smooth(self) -> Float32[np.ndarray, "h w"]:
        """The value, with less of its grain, for which a registration needs no finer steps."""
        return cv2.GaussianBlur(self.value, (3, 3), 0)

    @cached_property
    def size(self) -> int:
        """Number of pixels that the mask shows."""
        return cv2.countNonZero(self.mask)

    @cached_property
    def own(self) -> UInt8[np.ndarray, "h w"]:
        """The mask without worn dots."""
        return self.mask if self.worn is None else cv2.subtract(self.mask, self.worn)

    @cached_property
    def worn_share(self) -> float:
        """Share of the texture's power that lies at worn dots [-]."""
        if self.worn is None:
            return 0.0
        power, *_ = cv2.mean(self.value**2, self.mask)
        own, *_ = cv2.mean(self.value**2, self.own)
        return 1.0 - own * cv2.countNonZero(self.own) / max(power * self.size, 1e-6)

    @cached_property
    def middle(self) -> Float[np.ndarray, " 3"]:
        """Middle of the pixels that the mask shows, as x, y and 1 [px]."""
        shape = cv2.moments(self.mask, binaryImage=True)
        return np.array([shape["m10"], shape["m01"], shape["m00"]]) / shape["m00"]

    @cached_property
    def inner(self) -> UInt8[np.ndarray, "h w"]:
        """The mask without the pixels beside hidden ones, on which their slopes depend."""
        return cv2.erode(self.mask, np.ones((3, 3), np.uint8))


def cut_out(
    painted: Painted,
    region: Float[np.ndarray, "k 2"],
    sheared: Float[np.ndarray, "k 2"] | None = None,
) -> Texture:
    """Cut out the texture of the contact region.

    Args:
        painted: the picture.
        region: dots of the contact region [px of the original picture].
        sheared: their displacements from rest [px of the original picture]; None if unknown.
    """
    mask = np.zeros(painted.clear.shape, np.uint8)
    hull = cv2.convexHull((region / painted.part).astype(np.float32)).astype(np.int32)
    cv2.fillConvexPoly(mask, hull, 255)
    mask = cv2.dilate(mask, np.ones((2 * int(painted.radius) + 1,) * 2, np.uint8))
    shear = np.zeros(2) if sheared is None else sheared.mean(axis=0) / painted.part
    mask *= painted.bare > 0.0
    worn = mask * painted.worn
    worn = worn if worn.any() else None
    grey, gel = len(painted.colours) == 1, np.eye(3)
    if grey and sheared is not None:
        gel = _fit_gel(region / painted.part, sheared / painted.part)
    return Texture(painted.texture, mask, grey, shear, gel, worn)


def _fit_gel(
    region: Float[np.ndarray, "k 2"], sheared: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, "3 3"]:
    """Motion of the gel from rest, linear in the place, in homogeneous coordinates."""
    rest = region - sheared
    middle = rest.mean(axis=0)
    off = np.column_stack([rest - middle, np.ones(len(rest))])
    linear = np.linalg.lstsq(off, sheared, rcond=None)[0].T
    gel = np.eye(3)
    gel[:2, :2] += linear[:, :2]
    gel[:2, 2] = linear[:, 2] - linear[:, :2] @ middle
    return gel
