"""The incremental estimator: rotation since the oldest frame whose markers still stick.

A total angle assumes that a point has stuck since the pad was unloaded. After a reversal or a
partial slip there may be no such point, though most markers stick again. Three sources answer:
the markers that stick since a keyframe (`keyframes`), the law of friction where few of them stick
(`law.reader`), and the motion of the gel, which bounds the slide that no marker shows
(`unseen_slide`).
"""

from functools import partial

import numpy as np
from jaxtyping import Bool

from estimation.estimators.keyframe import Counted, Keyframe
from estimation.estimators.keyframes import Keyframes, KeyframeSettings
from estimation.estimators.law.reader import LawReader
from estimation.estimators.law.state import Reading
from estimation.estimators.measurement import Measurement
from estimation.estimators.result import RESTS_OR_SLIDES
from estimation.estimators.rigid import Rigid
from estimation.estimators.rotation import RigidFit
from estimation.estimators.touch import Touch
from estimation.estimators.unseen_slide import UnseenSlide
from estimation.fields.measure import Fields
from estimation.fields.stencils import Stencils
from estimation.frames.noise import Noise


class Incremental:
    """The angle by the sticking markers, by the law of friction, or neither.

    Attributes:
        settings: how the markers that stick are followed.
        keyframes: the keyframes, and the count of the angle from them.
        law: the law of friction.
        restarts: number of restarts of the angle's count since the object touched.
    """

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: KeyframeSettings = KeyframeSettings(),
    ) -> None:
        """Make the estimator; without the noise of the markers, it uses the misfit of the fit."""
        self.settings = settings
        self._slide = UnseenSlide(settings.firm_markers)
        rigid = Rigid(stencils, noise, settings)
        self.keyframes = Keyframes(rigid, settings, memory=self._slide.settings.over)
        self.restarts = 0
        self._free = 0  # the last frame without contact
        own = settings.many_markers, settings.mature_age, settings.patience
        self._touch = Touch(stencils, rigid.noise_mm, *own)
        self.law = LawReader(stencils, noise, settings.many_markers)

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the sticking elastomer, widened by possible slides (`follow`, `widen`)."""
        return self.widen(self.follow(self.bound(fields)), np.inf)

    def bound(self, fields: Fields) -> Fields:
        """The fields, with the contact that the law has shown if it is unknown."""
        return self.law.bound(fields)

    def widen(self, gel: Measurement, most: float) -> Measurement:
        """The measurement, its interval widened by the possible slide, up to `most` [rad]."""
        behind, ahead = (min(extent, most) for extent in self._slide.extent)
        reason = gel.reason or (RESTS_OR_SLIDES if self.doubtful and most == np.inf else "")
        gel = gel._replace(low=gel.low - behind, high=gel.high + ahead)
        return gel._replace(reason=reason, slides=self.slides, disc=self.law.disc)

    @property
    def slides(self) -> bool:
        """Whether the law of friction has shown a slide, and the object has not held since."""
        return self.law.slides

    @property
    def doubtful(self) -> bool:
        """Whether the object may be sliding over gel at rest and may have slid far."""
        return self._slide.doubtful

    def follow(self, fields: Fields) -> Measurement:
        """Rotation of the sticking elastomer, from the fields of the next frame.

        A contact that has already slipped in its first frame is counted from that frame. Once no
        marker sticks, the angle is lost until the next contact: gel at rest may stick again, or the
        object may slide over it. Up to two frames whose noise hides what sticks are skipped.
        """
        self.keyframes.number += 1
        self._touch.update(fields)
        if not fields.contact.any():
            self.restart()
            self._free = self.keyframes.number
            return Measurement.none(fields.contact)
        if self.keyframes.number == 1 and not np.nan_to_num(fields.displacement).any():
            return self._start_from(fields)  # it is the reference: earlier rotation is unknown
        if self._sticks_after_all(fields):
            self.restart()
        counted = self.keyframes.count(fields, self.doubtful)
        press = self.keyframes.rigid.press
        reading, counted = self.law.read(fields, counted, self.restarts, press)
        if reading is not None:
            return self._follow_law(fields, reading, counted)
        if reason := self._touch.explain(counted is None, self.law.closed):
            self._slide.miss()
            if self._touch.light:
                self.restart()
            return self._none(fields, reason)
        if counted is None and self._free >= self.keyframes.number - self.settings.patience:
            self.restart()  # the first frames may have been noise
            counted = self.keyframes.count(fields, self.doubtful)
        if counted is not None:
            return self._follow_count(fields, *counted)
        if self.keyframes.kept[-1].fields is None:
            return self._start_from(fields)
        self._touch.lose()
        self.lose(fields)
        return self._none(fields)

    def _none(self, fields: Fields, reason: str = "") -> Measurement:
        return Measurement.none(np.zeros_like(fields.contact), reason, self.restarts)

    def _start_from(self, fields: Fields) -> Measurement:
        """Count the angle from a frame on, because the earlier rotation is unknown."""
        self.restarts += 1
        error = self.keyframes.rigid.reading_error(fields)
        start = self.keyframes.start_from(fields, 0.0, error)
        return self._answer(start, fields.contact)

    def _sticks_after_all(self, fields: Fields) -> bool:
        """Whether many markers have stuck since the gel was unloaded, which noise hid at first.

        A first touch with few markers, some of them misread, proves no slip.
        """
        mature = self.keyframes.number - self.settings.mature_age
        young = self.restarts and self._free >= mature
        unsure = not self._touch.settled and bool(np.isnan(self.keyframes.kept[-1].angle))
        if self._free == 0 or not (young or unsure):
            return False
        fit = self.keyframes.rigid.fit(fields)
        return fit is not None and bool(fit.stick.sum() >= self.settings.many_markers)

    def _follow_count(self, fields: Fields, now: Keyframe, fit: RigidFit) -> Measurement:
        """The measurement by the markers that stick since a keyframe."""
        self.keyframes.remember(now)
        slides, stick = bool(fields.closed) or self.slides, fit.stick
        if slides:  # markers still move alike, but the object slides over them
            self.keyframes.increment, stick = None, np.zeros_like(stick)
        if np.isnan(now.angle):
            return self._none(fields)
        sticking, touching = int(stick.sum()), int(fields.contact.sum())
        self._touch.hold(sticking)
        along = partial(self.keyframes.turn_lately, fields)
        if self._touch.turned and self._slide.update(
            now.angle, sticking, touching, fit.noise_error, along, slides
        ):
            self.keyframes.keep_grip()
        self.keyframes.follow(now, stick, fit.standard_error)
        return self._answer(now, stick)

    def _follow_law(self, fields: Fields, reading: Reading, counted: Counted) -> Measurement:
        """The measurement by the law of friction.

        Its interval covers the count's angle too under shear, and where many markers stick by the
        law: under a square face, whose slip is not that of a disc, it may have too many stick.
        """
        lags = max(-reading.ahead, 0.0), max(reading.ahead, 0.0)
        now = Keyframe(fields, self.keyframes.number, reading.angle, reading.error, *lags)
        alike = 0 if counted is None else int(counted[1].stick.sum())
        stick = reading.stick & fields.contact
        many = bool(stick.sum() >= self.settings.many_markers) and not self.law.turned
        if counted is not None and (many or reading.sheared):
            now = now.doubt(counted[0].angle - now.angle)
        self.keyframes.keep(now._replace(body=stick, turning=self.law.turned))
        sticking, touching = int(stick.sum()), int(fields.contact.sum())
        self._touch.hold(sticking, reading.firm)
        if reading.firm and not (reading.near or reading.sheared):
            self._slide.hold(now.angle, sticking, touching, reading.step_error)
        else:  # the law's disc is no proof that the object holds, but markers that move alike are
            few, error = min(sticking, alike), reading.step_error
            self._slide.update(now.angle, few, touching, error, slides=reading.near)
        self.keyframes.follow(now, stick, reading.step_error)
        self.law.slides = bool(sticking < self.settings.min_stick_markers)
        return self._answer(now, np.zeros_like(stick) if self.slides else stick)

    def _answer(self, now: Keyframe, stick: Bool[np.ndarray, " n"]) -> Measurement:
        return Measurement(now.angle, now.low, now.high, stick, restarts=self.restarts)

    def lose(self, fields: Fields) -> None:
        """Lose the angle: from this frame on, only increments are known."""
        self._slide.restart()
        self.law.leave()
        self.keyframes.lose(fields)

    def resume(self, fields: Fields, angle: float, error: float) -> None:
        """Continue from this frame with an angle and its error from another source [rad]."""
        self._slide.restart()
        self.law.leave()
        self.law.slides = False
        self.keyframes.forget_motion()
        self.keyframes.start_from(fields, angle, error)

    def restart(self) -> None:
        """Count from the unloaded shape again."""
        self._slide.restart()
        self.law.restart()
        self.keyframes.restart()
        self.restarts = 0
