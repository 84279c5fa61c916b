"""The object's own rotation, where its edges or texture print through the gel.

What the object prints turns with the object, what is printed on the gel turns with the gel: the
dots are painted out, and the picture is registered with a keyframe by the rigid motion that
correlates the two best. Where the last frame's motion leads nowhere, all rotations within reach are
tried. Earlier keyframes, whose rotation is better known, end the drift of later ones.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from estimation.pictures.imprint.painted import Painted, Texture, cut_out
from estimation.pictures.imprint.registration import Keyframe, Match, register, search_motion
from estimation.pictures.imprint.settings import ImprintSettings


class Imprint(NamedTuple):
    """Motion of what the object prints, since the first frame.

    Attributes:
        angle: rotation [rad, from x to y of the picture]; NaN where lost.
        error: its standard error [rad].
        quality: correlation with the keyframe [-].
        point: x and y of a point of the object in the first frame and now [px], and the variances
            of where it is now and their covariance [px²].
    """

    angle: float
    error: float
    quality: float
    point: tuple[float, ...] = (np.nan,) * 7


LOST = Imprint(np.nan, np.nan, np.nan)


class ImprintFollower:
    """Follows the imprint from frame to frame; where it loses its place for long it ends."""

    def __init__(self, settings: ImprintSettings | None = None) -> None:
        """Start without a keyframe: the first frame with contact becomes it.

        Args:
            settings: how the imprint is read.
        """
        self._settings = settings or ImprintSettings()
        self._reading_error = float(np.radians(self._settings.reading_deg))
        self._restart()

    def _restart(self) -> None:
        """Count from the next frame, against which nothing is known yet."""
        self.keyframes: list[Keyframe] = []
        self.last: Match | None = None
        self.before: Keyframe | None = None
        self.angle = 0.0
        self.missed = 0
        self.resting = 0
        self.unclosed = 0  # frames since earlier keyframes were tried
        self.confirmed = False
        """Whether a second frame has shown the first one's texture: else it may be noise."""

    def update(self, painted: Painted, region: Float[np.ndarray, "k 2"]) -> Imprint:
        """Rotation of the imprint in the next frame.

        Args:
            painted: the picture without its dots.
            region: dots of the contact region [px].
        """
        if len(region) < self._settings.fewest:
            return LOST
        if self.resting > 0:
            self.resting -= 1
            return LOST
        texture = cut_out(painted, region)
        if self.last is None or self.before is None:
            return self._begin(texture, painted.part)
        found = self._find(texture, self.last, self.before)
        if found is None or found.error > np.radians(self._settings.largest_deg):
            self.missed += 1
            if self.confirmed and self.missed <= self._settings.patience:
                return LOST
            shaded = not self.confirmed  # light, that no second frame has shown
            self._restart()
            self.resting = self._settings.unseen if shaded else 0
            return LOST if shaded else self._begin(texture, painted.part)
        self.missed, self.confirmed = 0, True
        found = self._close(texture, found)
        self.before = Keyframe(texture, found.pose, found.error, found.spread)
        self.angle += float(np.angle(np.exp(1j * (self.before.angle - self.angle))))
        self.last = found
        if found.quality < self._settings.new_keyframe or abs(found.turned) > np.radians(
            self._settings.step_deg
        ):
            self._keep(self.before)
        error = float(np.hypot(found.error, self._settings.shaded * self.angle))
        return Imprint(self.angle, error, found.quality, _locate(self.before, painted.part))

    def _begin(self, texture: Texture, part: int) -> Imprint:
        if texture.value[texture.mask > 0].std() < self._settings.texture:
            self.resting = self._settings.unseen
            return LOST
        self.before = Keyframe(texture, np.eye(3), 0.0, np.zeros((2, 2)))
        self._keep(self.before)
        return Imprint(0.0, self._reading_error, 1.0, _locate(self.before, part))

    def _keep(self, keyframe: Keyframe) -> None:
        """Make it the keyframe to register with."""
        self.keyframes.append(keyframe)
        if len(self.keyframes) > self._settings.kept:
            del self.keyframes[1]
        still, spread = np.eye(2, 3, dtype=np.float32), self._settings.reading_px**2 * np.eye(2)
        self.last = Match(keyframe, still, 1.0, self._reading_error, spread)

    def _find(self, texture: Texture, last: Match, before: Keyframe) -> Match | None:
        """The motion to this frame; None where the imprint has lost its place.

        Tried are the keyframe of the last frame; where that fits badly, earlier ones, from the
        first on, that leave less of an error; the last frame; and at last all rotations.
        """
        settings = self._settings
        found = register(last.keyframe, texture, last.warp, settings)
        if found is not None and found.quality >= settings.new_keyframe:
            return found
        pose = before.pose if found is None else found.pose
        for closed in self._register_earlier(texture, pose, last.keyframe):
            if found is None or closed.error < found.error:
                return closed
        if found is not None:
            return found
        found = register(before, texture, np.eye(2, 3, dtype=np.float32), settings)
        if found is None and self.confirmed:
            guess = search_motion(before.texture, texture, settings)
            if guess is not None:
                found = register(before, texture, guess, settings, least=settings.found_again)
        return found

    def _register_earlier(
        self, texture: Texture, pose: Float[np.ndarray, "3 3"], now: Keyframe
    ) -> Iterator[Match]:
        """The motions from earlier keyframes that are better known, the first one first."""
        for earlier in self.keyframes:
            if earlier is not now and earlier.error < now.error:
                start = (pose @ np.linalg.inv(earlier.pose))[:2].astype(np.float32)
                if (closed := register(earlier, texture, start, self._settings)) is not None:
                    yield closed

    def _close(self, texture: Texture, found: Match) -> Match:
        """The motion from an earlier keyframe where that leaves less of an error.

        It is looked for where a keyframe is to be taken, and now and then while one lasts.
        """
        self.unclosed += 1
        settings = self._settings
        far = abs(found.turned) > np.radians(settings.step_deg)
        if not far and self.unclosed < settings.closing:
            return found
        self.unclosed = 0
        closed = min(
            self._register_earlier(texture, found.pose, found.keyframe),
            key=lambda one: one.error,
            default=found,
        )
        return closed if closed.error < settings.closer * found.error else found


def _locate(now: Keyframe, part: int) -> tuple[float, ...]:
    """The object's point that is in the middle of the contact, as `Imprint` has it.

    Args:
        now: the frame.
        part: by how much its picture has been scaled down.
    """
    shape = cv2.moments(now.texture.mask, binaryImage=True)
    middle = np.array([shape["m10"], shape["m01"], shape["m00"]]) / shape["m00"]
    first = np.linalg.solve(now.pose, middle)
    (xx, xy), (_, yy) = part * now.spread
    return tuple((part * np.array([*first[:2], *middle[:2], xx, yy, xy])).tolist())
