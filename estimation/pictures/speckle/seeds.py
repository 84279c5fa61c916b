"""Initial guesses of a speckle pattern's motion, of any size, from two pictures."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial import KDTree


class Guess(NamedTuple):
    """Guessed motion of subsets.

    Attributes:
        position: of their centres [px].
        deformation: deformation gradient F [-].
    """

    position: Float[np.ndarray, "n 2"]
    deformation: Float[np.ndarray, "n 2 2"]


def stay(centre: Float[np.ndarray, "n 2"], shift: Float[np.ndarray, " 2"]) -> Guess:
    """A guess that moves all subsets by the same vector, without deformation.

    Args:
        centre: of the subsets at rest [px].
        shift: the vector [px].
    """
    return Guess(centre + shift, np.tile(np.eye(2), (len(centre), 1, 1)))


def flatten_light(grey: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Remove slow changes of light from a picture, and equalise its contrast."""
    grain = 24.0  # standard deviation of the blur that separates light from texture [px]
    texture = grey - cv2.GaussianBlur(grey, (0, 0), grain)
    spread = np.sqrt(cv2.GaussianBlur(texture * texture, (0, 0), grain)) + 2.0
    return np.clip(texture / spread, -3.0, 3.0)


def find_shift(
    rest: Float32[np.ndarray, "h w"], now: Float32[np.ndarray, "h w"]
) -> Float[np.ndarray, " 2"]:
    """Estimate the shift of the whole picture by phase correlation [px].

    Args:
        rest: the reference, with flattened light.
        now: the picture, with flattened light.
    """
    window = cv2.createHanningWindow(rest.shape[::-1], cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(rest, now, window)
    return np.array(shift)


class FeatureSeeds:
    """Features of a reference picture, from which any motion and rotation can be guessed."""

    def __init__(self, rest: Float32[np.ndarray, "h w"]) -> None:
        """Find the features of a picture with flattened light."""
        self.detector = cv2.SIFT.create(nfeatures=4000, contrastThreshold=0.02)
        self.points, self.turns, self.descriptors = self._describe(rest)

    def _describe(self, texture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        byte = cv2.convertScaleAbs(texture + 3.0, alpha=42.0)
        keypoints, descriptors = self.detector.detectAndCompute(byte, None)
        if descriptors is None:
            descriptors = np.zeros((0, 128), np.float32)
        points = np.array([keypoint.pt for keypoint in keypoints]).reshape(-1, 2)
        return points, np.radians([keypoint.angle for keypoint in keypoints]), descriptors

    def guess(
        self, now: Float32[np.ndarray, "h w"], centre: Float[np.ndarray, "n 2"]
    ) -> Guess | None:
        """Guess the motion of points in another picture; None if too few features match.

        Args:
            now: the picture, with flattened light.
            centre: the points in the reference [px].
        """
        # largest distance of a feature's best match, as a share of its second best's
        ratio = 0.8
        # number of features that determine a point; their median is robust to three wrong ones
        around = 7
        points, turns, descriptors = self._describe(now)
        if min(len(self.points), len(points)) < around:
            return None
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(self.descriptors, descriptors, k=2)
        matches = [best for best, second in pairs if best.distance < ratio * second.distance]
        if len(matches) < around:
            return None
        before = np.array([match.queryIdx for match in matches])
        after = np.array([match.trainIdx for match in matches])
        turn = turns[after] - self.turns[before]
        near = np.asarray(KDTree(self.points[before]).query(centre, around)[1])
        unit = np.exp(1j * turn[near])
        middle = np.median(np.real(unit), axis=1) + 1j * np.median(np.imag(unit), axis=1)
        middle /= np.maximum(np.abs(middle), 1e-9)
        to_complex = np.array([1.0, 1.0j])
        arm = (centre[:, None] - self.points[before][near]) @ to_complex
        place = points[after][near] @ to_complex + middle[:, None] * arm
        position = np.median([np.real(place), np.imag(place)], axis=2).T
        cosine, sine = middle.real, middle.imag
        turned = np.stack([cosine, -sine, sine, cosine], axis=1).reshape(-1, 2, 2)
        return Guess(position, turned)
