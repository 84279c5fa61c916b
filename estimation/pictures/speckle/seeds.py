"""Guesses of where a speckle pattern has gone, however far, from two pictures alone."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial import KDTree


class Guess(NamedTuple):
    """Where subsets may be.

    Attributes:
        position: of their centres [px].
        deformation: F.
    """

    position: Float[np.ndarray, "n 2"]
    deformation: Float[np.ndarray, "n 2 2"]


def stay(centre: Float[np.ndarray, "n 2"], shift: Float[np.ndarray, " 2"]) -> Guess:
    """All moved by the same vector [px]."""
    return Guess(centre + shift, np.tile(np.eye(2), (len(centre), 1, 1)))


def flatten_light(grey: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """A picture without its slow changes, of about equal contrast everywhere."""
    grain = 24.0  # width of what is taken off as light rather than texture, standard deviation [px]
    texture = grey - cv2.GaussianBlur(grey, (0, 0), grain)
    spread = np.sqrt(cv2.GaussianBlur(texture * texture, (0, 0), grain)) + 2.0
    return np.clip(texture / spread, -3.0, 3.0)


def find_shift(
    rest: Float32[np.ndarray, "h w"], now: Float32[np.ndarray, "h w"]
) -> Float[np.ndarray, " 2"]:
    """The shift that most of the picture agrees on, by phase correlation [px].

    Args:
        rest: the reference, its light flattened.
        now: the picture, its light flattened.
    """
    window = cv2.createHanningWindow(rest.shape[::-1], cv2.CV_32F)
    shift, _ = cv2.phaseCorrelate(rest, now, window)
    return np.array(shift)


class FeatureSeeds:
    """Features of a reference picture, by which any motion and rotation is found."""

    def __init__(self, rest: Float32[np.ndarray, "h w"]) -> None:
        """Find features in a picture whose light is flattened."""
        self.detector = cv2.SIFT.create(nfeatures=4000, contrastThreshold=0.02)
        self.points, self.turns, self.descriptors = self._describe(rest)

    def _describe(self, texture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        byte = cv2.convertScaleAbs(texture + 3.0, alpha=42.0)
        keypoints, descriptors = self.detector.detectAndCompute(byte, None)
        if descriptors is None:
            descriptors = np.zeros((0, 128), np.float32)
        points = np.array([one.pt for one in keypoints]).reshape(-1, 2)
        return points, np.radians([one.angle for one in keypoints]), descriptors

    def guess(
        self, now: Float32[np.ndarray, "h w"], centre: Float[np.ndarray, "n 2"]
    ) -> Guess | None:
        """Where points are in another picture; None where too few features are found again.

        Args:
            now: the picture, its light flattened.
            centre: the points in the reference [px].
        """
        # distance of a feature's best match to that of its second best below which it is taken
        ratio = 0.8
        # features around a point that say where it is; their median is robust to three wrong ones
        around = 7
        points, turns, descriptors = self._describe(now)
        if min(len(self.points), len(points)) < around:
            return None
        pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(self.descriptors, descriptors, k=2)
        kept = [one for one, two in pairs if one.distance < ratio * two.distance]
        if len(kept) < around:
            return None
        before = np.array([one.queryIdx for one in kept])
        after = np.array([one.trainIdx for one in kept])
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
