"""The object's own rotation, where its edges or texture print through the gel.

The object's print turns with the object, the dots with the gel. The dots are therefore painted out,
and the picture is registered with a keyframe by the rigid motion of highest correlation. If the
last frame's motion is no good start, all rotations within a range are tried. A place counts if it
fits clearly better than all others, and if the object has not slipped against the gel's shear on
its way there: a sliding object drags the gel along. Earlier keyframes, whose rotation has a smaller
error, end the drift of later ones.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float

from estimation.pictures.imprint.lateness import Lateness
from estimation.pictures.imprint.painted import Painted
from estimation.pictures.imprint.registration import Keyframe, Match, register, search_motions
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture, cut_out


class Imprint(NamedTuple):
    """Motion of the object's print since the first frame.

    Attributes:
        angle: rotation [rad, from x to y of the picture]; NaN where lost.
        error: standard error of the rotation [rad].
        quality: correlation with the keyframe [-].
        point: x and y of a point of the object in the first frame and now [px], then the variances
            of the current x and y and their covariance [px²].
        worn: share of its texture's power that lies at worn dots [-].
    """

    angle: float
    error: float
    quality: float
    point: tuple[float, ...] = (np.nan,) * 7
    worn: float = 0.0

    @property
    def located(self) -> bool:
        """Whether the object's position is known."""
        return bool(np.isfinite(self.point[0]))


NO_IMPRINT = Imprint(np.nan, np.nan, np.nan)


class ImprintFollower:
    """Tracks the imprint from frame to frame, and gives it up when it is lost for long."""

    def __init__(self, settings: ImprintSettings | None = None) -> None:
        """Start without a keyframe; the first frame with contact becomes the first keyframe.

        Args:
            settings: of registration and tracking; defaults if None.
        """
        self._settings = settings or ImprintSettings()
        self._reading_error = float(np.radians(self._settings.reading_deg))
        self._lateness = Lateness(self._settings)
        self.restart()

    def restart(self) -> None:
        """Start again: angles count from the next frame."""
        self.keyframes: list[Keyframe] = []
        self.last: Match | None = None
        self.before: Keyframe | None = None
        self.angle = 0.0
        self.hidden = 0.0  # rotation that light may hide [rad]
        self.hidden_shift = np.zeros(2)  # the same of the contact's middle [px]
        self.missed = 0
        self.searched = False  # whether a search has just found the print
        self.resting = 0
        self.unclosed = 0  # frames since earlier keyframes were tried
        self.confirmed = False
        """Whether a second frame has shown the first one's texture, which is thus no noise."""

    def update(
        self,
        painted: Painted,
        region: Float[np.ndarray, "k 2"],
        quantizer: float = 0.0,
        sheared: Float[np.ndarray, "k 2"] | None = None,
    ) -> Imprint:
        """Measure the rotation of the imprint in the next frame.

        Args:
            painted: the picture without its dots.
            region: dots of the contact region [px].
            quantizer: step of a compressed video's quantizer [grey levels of 255]; 0 in pictures
                that are coded by themselves, and if unknown.
            sheared: displacement of these dots from rest [px]; None if unknown.
        """
        settings = self._settings
        if len(region) < settings.fewest:
            return NO_IMPRINT
        if self.resting > 0:
            self.resting -= 1
            return NO_IMPRINT
        texture = cut_out(painted, region, sheared)
        if not texture.size:
            return NO_IMPRINT
        if self.last is None or self.before is None:
            return self._begin(texture, painted.part, quantizer)
        match = self._find(texture, self.last, self.before)
        if match is None or match.error > np.radians(self._settings.largest_deg):
            self.missed += 1
            self._lateness.lose()
            if self.confirmed and self.missed <= self._settings.patience:
                return NO_IMPRINT
            shaded = not self.confirmed  # a change of light that no second frame has shown
            self.restart()
            self.resting = self._settings.unseen if shaded else 0
            return NO_IMPRINT if shaded else self._begin(texture, painted.part, quantizer)
        self.missed, self.confirmed = 0, True
        match = self._close(texture, match)
        error = self._count_motion(texture, match, self.before.pose, quantizer)
        self.last = match
        grown = self._outgrow(texture, match.keyframe)
        far = abs(match.turned) > np.radians(self._settings.step_deg)
        if grown or far or match.quality < self._settings.new_keyframe:
            self._keep(self.before)
        error = float(np.hypot(error, self.hidden))
        if self.searched:  # perhaps at a wrong place, which the next frame will not show
            return Imprint(
                self.angle, max(error, np.radians(self._settings.searched_error_deg)), match.quality
            )
        point = _locate(self.before, self.hidden_shift, painted.part)
        return Imprint(self.angle, error, match.quality, point, texture.worn_share)

    def _count_motion(
        self,
        texture: Texture,
        match: Match,
        before: Float[np.ndarray, "3 3"],
        quantizer: float,
    ) -> float:
        """Add this frame's turn and shift; the standard error of the angle, without light's [rad].

        Args:
            texture: of the frame.
            match: of the frame.
            before: pose in the last frame with a print.
            quantizer: as in `update`.
        """
        self.before = Keyframe(texture, match.pose, match.error, match.spread)
        step = float(np.angle(np.exp(1j * (self.before.angle - self.angle))))
        self.angle += step
        late = self._lateness.update(self.angle, match.slope, quantizer)
        error = float(np.hypot(match.error, late))
        if late > np.radians(self._settings.mixed_deg):
            self.before = replace(self.before, error=error)
        self.hidden += match.shaded * step
        shift = texture.middle - before @ np.linalg.solve(self.before.pose, texture.middle)
        self.hidden_shift += match.shaded_shift @ shift[:2]
        return error

    def _begin(self, texture: Texture, part: int, quantizer: float) -> Imprint:
        if texture.value[texture.mask > 0].std() < self._settings.texture:
            self.resting = self._settings.unseen
            return NO_IMPRINT
        self.before = Keyframe(texture, np.eye(3), 0.0, np.zeros((2, 2)))
        self._lateness.begin(quantizer)
        self._keep(self.before)
        point = _locate(self.before, self.hidden_shift, part)
        return Imprint(0.0, self._reading_error, 1.0, point)

    def _keep(self, keyframe: Keyframe) -> None:
        """Store a keyframe, with which the next frames are registered."""
        self.keyframes.append(keyframe)
        if len(self.keyframes) > self._settings.kept:
            del self.keyframes[1]
        still, spread = np.eye(2, 3, dtype=np.float32), self._settings.reading_px**2 * np.eye(2)
        shaded = self._settings.shaded
        self.last = Match(
            keyframe, still, 1.0, self._reading_error, spread, shaded, shaded * np.eye(2)
        )

    def _outgrow(self, texture: Texture, keyframe: Keyframe) -> bool:
        """Whether a grey print has far outgrown that of a keyframe; drops all such keyframes.

        Without colours, little of a print is soon outweighed by marks on the gel.
        """
        most = texture.size / self._settings.outgrown if texture.grey else 0.0
        self.keyframes = [one for one in self.keyframes if one.texture.size > most]
        return keyframe.texture.size <= most

    def _find(self, texture: Texture, last: Match, before: Keyframe) -> Match | None:
        """Register this frame; None if the imprint is lost.

        The keyframe of the last frame is tried first. If it fits badly, earlier keyframes with a
        smaller error are tried from the first on, then the last frame, and finally all rotations.
        A print that stays lost is searched only at intervals. Where the object turns far between
        two frames, a registration may end at a wrong place that fits moderately: one that suddenly
        fits badly counts only if no other place fits as well.
        """
        settings, self.searched = self._settings, False
        match = register(last.keyframe, texture, last.warp, settings)
        if match is not None and match.quality >= settings.new_keyframe:
            return match
        if match is None and self.missed % settings.searched_every:
            return None
        match = self._register_others(texture, last, before, match)
        if match is not None and match.quality <= settings.found_again < last.quality:
            match = None if self._has_rival(match, texture) else match
        if match is None and self.confirmed:
            match = self._search(texture, before)
            self.searched = match is not None
        return match

    def _register_others(
        self, texture: Texture, last: Match, before: Keyframe, match: Match | None
    ) -> Match | None:
        """Register this frame with other keyframes than the last frame's, which gave `match`."""
        pose = before.pose if match is None else match.pose
        for closed in self._register_earlier(texture, pose, last.keyframe):
            if match is None or closed.error < match.error:
                return closed
        if match is None and last.keyframe is not before:
            return register(before, texture, np.eye(2, 3, dtype=np.float32), self._settings)
        return match

    def _search(self, texture: Texture, before: Keyframe) -> Match | None:
        """Search the print of the last frame in this one; None unless one place fits clearly best.

        A smooth or repeated texture correlates at several places.
        """
        settings = self._settings
        guesses = search_motions(before.texture, texture, settings)
        best = register(before, texture, guesses[0], settings) if guesses else None
        if best is None or best.quality <= settings.found_again or self._slips_back(best, texture):
            return None
        return None if self._has_rival(best, texture, guesses[1:]) else best

    def _has_rival(
        self,
        match: Match,
        texture: Texture,
        guesses: list[Float[np.ndarray, "2 3"]] | None = None,
    ) -> bool:
        """Whether another place than that of a match fits about as well, or better.

        Args:
            match: of the frame with a keyframe.
            texture: of the frame.
            guesses: motions near the other places; searched by default.
        """
        settings, before = self._settings, match.keyframe
        if guesses is None:
            guesses = search_motions(before.texture, texture, settings)
        lacking = (1.0 - match.quality) / settings.clearer
        rivals = (register(before, texture, guess, settings) for guess in guesses)
        rivals = (rival for rival in rivals if rival and 1.0 - rival.quality < lacking)
        return any(_differ(match, rival, settings) for rival in rivals)

    def _slips_back(self, match: Match, texture: Texture) -> bool:
        """Whether the object would have slipped against the gel's shear."""
        before, now = match.keyframe.texture.shear, texture.shear
        moved = texture.middle[:2] - cv2.invertAffineTransform(match.warp) @ texture.middle
        along = float((moved - now + before) @ now)
        return along < -self._settings.back_px * float(np.linalg.norm(now))

    def _register_earlier(
        self, texture: Texture, pose: Float[np.ndarray, "3 3"], now: Keyframe
    ) -> Iterator[Match]:
        """Register this frame with earlier keyframes of smaller error, from the first on."""
        for earlier in self.keyframes:
            if earlier is not now and earlier.error < now.error:
                start = (pose @ np.linalg.inv(earlier.pose))[:2].astype(np.float32)
                closed = register(earlier, texture, start, self._settings)
                if closed is not None:
                    yield closed

    def _close(self, texture: Texture, match: Match) -> Match:
        """Replace a match by one with an earlier keyframe if that has a clearly smaller error.

        Earlier keyframes are tried when a new keyframe is due, and at regular intervals. Where they
        disagree with the match, one of the two errors is too small, perhaps theirs.
        """
        self.unclosed += 1
        settings = self._settings
        far = abs(match.turned) > np.radians(settings.step_deg)
        if not far and self.unclosed < settings.closing:
            return match
        self.unclosed = 0
        earlier = self._register_earlier(texture, match.pose, match.keyframe)
        closed = min(
            (_doubt(one, match) for one in earlier), key=lambda one: one.error, default=match
        )
        return closed if closed.error < settings.closer * match.error else match


def _differ(one: Match, other: Match, settings: ImprintSettings) -> bool:
    """Whether two matches of a frame put the print at different places or angles."""
    middle = one.keyframe.texture.middle
    shift = float(np.linalg.norm((one.warp - other.warp) @ middle))
    turn = abs(one.turned - other.turned)
    return shift > settings.apart_px or turn > float(np.radians(settings.apart_deg))


def _doubt(one: Match, other: Match) -> Match:
    """A match whose error explains how far another one of the same frame is from it."""
    apart = one.keyframe.angle + one.turned - other.keyframe.angle - other.turned
    expected = float(np.hypot(one.error, other.error))
    excess = float(abs(np.angle(np.exp(1j * apart)))) / max(expected, 1e-9)
    if excess <= 1.0:
        return one
    return one._replace(own_error=math.sqrt((excess * one.error) ** 2 - one.keyframe.error**2))


def _locate(now: Keyframe, hidden: Float[np.ndarray, " 2"], part: int) -> tuple[float, ...]:
    """The object's point in the middle of the contact, as in `Imprint`.

    Args:
        now: the frame.
        hidden: shift that light may hide, a standard error [px].
        part: factor by which its picture was scaled down.
    """
    middle = now.texture.middle
    first = np.linalg.solve(now.pose, middle)
    (xx, xy), (_, yy) = part * (now.spread + np.outer(hidden, hidden))
    return tuple((part * np.array([*first[:2], *middle[:2], xx, yy, xy])).tolist())
