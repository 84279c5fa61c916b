"""The incremental estimator: rotation since the oldest frame whose markers still stick.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (12) and (15).

A total angle assumes that a point has stuck since the pad was unloaded. After a reversal or a
partial slip there may be no such point, though most markers stick again. Eq. (12) is the rate form
of the total: it holds for the markers that stick over any interval. Here the interval runs from a
keyframe to now, and the keyframe is the oldest whose markers still move as one body with the
object. Errors then add up once per keyframe, not once per frame.
"""

from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from contactmodel.common.ranges import check_count
from estimation.estimators.keyframes import Counted, Keyframe, Leg, thin_out
from estimation.estimators.law.reader import LawReader
from estimation.estimators.law.state import Reading
from estimation.estimators.measurement import Measurement
from estimation.estimators.result import RESTS_OR_SLIDES
from estimation.estimators.rigid import Rigid, RigidSettings
from estimation.estimators.rotation import RigidFit
from estimation.estimators.strain import Press
from estimation.estimators.touch import Touch
from estimation.estimators.unseen_slide import UnseenSlide
from estimation.fields.measure import Fields
from estimation.fields.stencils import Stencils
from estimation.frames.noise import Noise


@dataclass(frozen=True)
class IncrementalSettings(RigidSettings):
    """How the markers that stick are followed; `RigidSettings` describes the inherited settings.

    In macro slip the gel hardly moves from frame to frame and all of it seems to stick; over the
    mature age it does not. Noise hides all sticking markers at once, while slip releases them one
    by one. Gel that comes to rest under a sliding object seems to stick suddenly.

    Attributes:
        keyframe_interval: frames between two keyframes [frames].
        mature_age: frames over which markers must move together to count as sticking, and over
            which gel and outline are compared. More frames report slip later [frames].
        most_keyframes: largest number of keyframes in memory, at least 2; twice as many after signs
            of a grip [-].
        firm_markers: number of markers that have stuck since a keyframe. With as many or more,
            newer keyframes are not tried [-].
        many_markers: number of sticking markers. After a frame with as many or more, a frame
            without any counts as noise at first, not as slip [-].
        patience: frames without a sticking marker after which the angle is lost, if many markers
            stuck before [frames].
    """

    keyframe_interval: int = 5
    mature_age: int = 8
    most_keyframes: int = 4
    firm_markers: int = 9
    many_markers: int = 12
    patience: int = 2

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        check_count("most_keyframes", self.most_keyframes, 2)
        for name in ("keyframe_interval", "mature_age", "firm_markers", "many_markers"):
            check_count(name, getattr(self, name))
        check_count("patience", self.patience, 0)


class Increment(NamedTuple):
    """Motion as one body since the keyframe that the last angle counts from.

    Attributes:
        age: frames since the keyframe.
        angle: rotation since the keyframe [rad].
        stick: markers that moved as one body.
    """

    age: int
    angle: float
    stick: Bool[np.ndarray, " n"]


class Incremental:
    """Rigid increments of the sticking markers, from the oldest keyframe that still holds."""

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: IncrementalSettings = IncrementalSettings(),
    ) -> None:
        """Make the estimator; without the noise of the markers, it uses the misfit of the fit."""
        self.settings = settings
        self.rigid = Rigid(stencils, noise, settings)
        self.keyframes = [Keyframe(None, -settings.mature_age)]
        self.number = 0
        self.increment: Increment | None = None
        self.restarts = 0
        """Number of restarts of the angle's count since the object touched."""
        self._free = 0  # the last frame without contact
        own = settings.many_markers, settings.mature_age, settings.patience
        self._touch = Touch(stencils, self.rigid.noise_mm, *own)
        self._slide = UnseenSlide(settings.firm_markers)
        self._recent: deque[Keyframe] = deque(maxlen=self._slide.settings.over)  # the last frames
        self._leg = Leg()
        self._last: tuple[Keyframe, Bool[np.ndarray, " n"]] | None = None  # its sticking markers
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
        return gel._replace(
            low=gel.low - behind,
            high=gel.high + ahead,
            reason=reason,
            slides=self.slides,
            disc=self.law.disc,
        )

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
        self.number += 1
        self._touch.update(fields)
        if not fields.contact.any():
            self.restart()
            self._free = self.number
            return Measurement.none(fields.contact)
        if self.number == 1 and not np.nan_to_num(fields.displacement).any():
            return self._start_from(fields)  # it is the reference: earlier rotation is unknown
        counted = self._count(fields)
        reading, counted = self.law.read(fields, counted, self.restarts, self.rigid.press)
        if reading is not None:
            return self._follow_law(fields, reading, counted)
        if reason := self._touch.explain(counted is None, self.law.closed):
            self._slide.miss()
            if self._touch.light:
                self.restart()
            return Measurement.none(np.zeros_like(fields.contact), reason, self.restarts)
        if counted is None and self.number - self._free <= self.settings.patience:
            self.restart()  # the first frames may have been noise
            counted = self._count_on(fields)
        if counted is None and self.keyframes[-1].fields is None:
            return self._start_from(fields)
        if counted is None:
            self._touch.lose()
            self.lose(fields)
            return Measurement.none(np.zeros_like(fields.contact), restarts=self.restarts)
        now, fit = counted
        self._remember(now)
        slides, stick = bool(fields.closed) or self.slides, fit.stick
        if slides:  # markers still move alike, but the object slides over them
            self.increment, stick = None, np.zeros_like(stick)
        if np.isnan(now.angle):
            return Measurement.none(np.zeros_like(fields.contact), restarts=self.restarts)
        sticking, touching = int(stick.sum()), int(fields.contact.sum())
        self._touch.hold(sticking)
        along, error = partial(self._turns_along, fields), fit.noise_error
        if self._touch.turned and self._slide.update(
            now.angle, sticking, touching, error, along, slides
        ):
            mature = self.number - self.settings.mature_age
            self.keyframes.append(self._recent[0]._replace(number=mature))
            thin_out(self.keyframes, self.number, 2 * self.settings.most_keyframes)
        self._recent.append(now)
        self._last = now, stick
        self._follow_turn(now, fit.standard_error)
        return Measurement(now.angle, now.low, now.high, stick, restarts=self.restarts)

    def _start_from(self, fields: Fields) -> Measurement:
        """Count the angle from a frame on, because the earlier rotation is unknown."""
        error = self.rigid.reading_error(fields)
        start = Keyframe(fields, self.number - self.settings.mature_age, error=error)
        self.keyframes = [start]
        self.restarts += 1
        interval = start.angle, start.low, start.high
        return Measurement(*interval, fields.contact, restarts=self.restarts)

    def _count(self, fields: Fields) -> Counted:
        """The count, from the unloaded shape after all if noise has hidden what stuck at first.

        A first touch with few markers, some of them misread, proves no slip: the angle counts on
        once many markers have stuck since the gel was unloaded.
        """
        young = self.restarts and self._free >= self.number - self.settings.mature_age
        unsure = not self._touch.settled and bool(np.isnan(self.keyframes[-1].angle))
        if self._free > 0 and (young or unsure):
            fit = self.rigid.fit(fields)
            if fit is not None and fit.stick.sum() >= self.settings.many_markers:
                self.restart()
        return self._count_on(fields)

    def _follow_law(self, fields: Fields, reading: Reading, counted: Counted) -> Measurement:
        """The measurement by the law of friction, which under shear covers the count too."""
        lags = max(-reading.ahead, 0.0), max(reading.ahead, 0.0)
        now = Keyframe(fields, self.number, reading.angle, reading.error, *lags)
        alike = 0 if counted is None else int(counted[1].stick.sum())
        if counted is not None and reading.sheared:
            now = now.doubt(counted[0].angle - now.angle)
        stick = reading.stick & fields.contact
        if self.law.leads:
            self.keyframes.append(now._replace(body=stick, turning=self.law.turned))
            thin_out(self.keyframes, self.number, self.settings.most_keyframes)
        sticking, touching = int(stick.sum()), int(fields.contact.sum())
        self._touch.hold(sticking, reading.firm)
        if reading.firm and not (reading.near or reading.sheared):
            self._slide.hold(now.angle, sticking, touching, reading.step_error)
        else:  # the law's disc is no proof that the object holds, but markers that move alike are
            few, error = min(sticking, alike), reading.step_error
            self._slide.update(now.angle, few, touching, error, slides=reading.near)
        self._recent.append(now)
        self._last = now, stick
        self._follow_turn(now, reading.step_error)
        self.law.slides = bool(stick.sum() < self.settings.min_stick_markers)
        if self.slides:
            stick = np.zeros_like(stick)
        return Measurement(now.angle, now.low, now.high, stick, restarts=self.restarts)

    def _follow_turn(self, now: Keyframe, noise: float) -> None:
        """Put a keyframe where the object has turned back.

        What slipped before this point sticks again after it. Since a keyframe from before, it
        forms a second body, which has turned less than the object. So older keyframes continue with
        the markers that stuck up to the turning point, and those too young for this are removed. An
        angle that only jumps, because another keyframe gives it, turns no gel back.
        """
        turning = self._leg.update(now, noise)
        if turning is None or turning.fields is None or now.fields is None:
            return
        back, turned = self.rigid.fit(now.fields, turning.fields), now.angle - turning.angle
        if back is None or abs(back.angle - turned) > 0.5 * abs(turned):
            return
        mature = turning.number - self.settings.mature_age
        older = []
        for k in self.keyframes:
            if k.number <= mature:
                fit = self.rigid.fit(turning.fields, k.fields, k.body)
                if fit is not None:
                    older.append(k._replace(body=fit.stick))
            elif k.number > turning.number:
                older.append(k)
        older.append(turning._replace(turning=True))
        self.keyframes = sorted(older, key=lambda k: k.number)
        thin_out(self.keyframes, self.number, self.settings.most_keyframes)

    def _turns_along(self, fields: Fields) -> float:
        """Recent turn of most of the contact as one body, as with an object [rad]; else 0.

        Gel that rests under a sliding object does not turn, and gel that springs back does not turn
        as one body.
        """
        since = self._recent[0].fields
        fit = None if since is None else self.rigid.fit(fields, since)
        if fit is None or abs(fit.angle) < np.radians(self._slide.settings.grip_deg):
            return 0.0
        most = max(self.settings.many_markers, 0.5 * fields.contact.sum())
        return fit.angle if fit.stick.sum() >= most else 0.0

    def _restart_slide(self) -> None:
        """Begin with an object that holds."""
        self._slide.restart()
        self._recent.clear()
        self._leg, self._last = Leg(), None

    def lose(self, fields: Fields) -> None:
        """Lose the angle: from this frame on, only increments are known."""
        self._restart_slide()
        self.law.leave()
        unknown = Keyframe(fields, self.number, angle=np.nan)
        self.keyframes = [k for k in self.keyframes if np.isnan(k.angle)] or [unknown]
        self._remember(unknown)

    def resume(self, fields: Fields, angle: float, error: float) -> None:
        """Continue from this frame with an angle and its error from another source [rad]."""
        self._restart_slide()
        self.law.leave()
        self.law.slides = False
        self.keyframes = [Keyframe(fields, self.number - self.settings.mature_age, angle, error)]

    def restart(self) -> None:
        """Count from the unloaded shape again."""
        self._restart_slide()
        self.keyframes = [Keyframe(None, self.number - self.settings.mature_age)]
        self.rigid.press, self.restarts = Press(), 0
        self.law.restart()

    def _count_on(self, fields: Fields) -> Counted:
        """The present keyframe, counted from the best mature one, and the sticking markers.

        The oldest keyframe is used while nine markers or more still stick since then; otherwise the
        one with the narrowest interval. Markers that stick since an older keyframe stick since a
        newer one too. If the newer one was made while most markers slipped unnoticed, it lags, and
        its angle is corrected to the older one's. If their intervals do not even overlap, the
        object has rested since, and the newer one's is widened to the older one's. A keyframe at a
        turning point is used at once. While the angle is lost, the newest is used, which forgets
        the slip soonest. Keyframes that no longer hold are removed. In the plane, where all markers
        may count as in contact, the gel at rest around the object is no body of its own.
        """
        least = self.settings.mature_age
        mature = [i for i, k in enumerate(self.keyframes) if k.turning or self._age(k) >= least]
        if mature and np.isnan(self.keyframes[0].angle):
            mature = mature[-1:]
        best: tuple[float, int, Keyframe, RigidFit] | None = None
        broken: list[int] = []
        whole = self.rigid.stencils.flat and fields.contact[np.isfinite(fields.rotation)].all()
        lately = None if self._last is None or self.doubtful else self._last[1]
        last = self.keyframes[-1]
        stuck = self._last[1] if self._last is not None and whole else None
        for i in mature:
            fit = self.rigid.fit(fields, self.keyframes[i].fields, self.keyframes[i].body, lately)
            if fit is None:
                broken.append(i)
                continue
            if stuck is not None and fit.is_around(stuck, fields.contact):
                continue
            turned = self.rigid.turn(fit.stick, last.fields, self.keyframes[i].fields)
            keyframe = self.keyframes[i].see_slip(last, *turned)
            now = keyframe.advance(fields, self.number, fit)
            if best is not None and not best[2].agrees(now):
                self.keyframes[i] = self.keyframes[i].doubt(best[2].angle - now.angle)
                continue
            if best is not None and now.lags(
                best[2], float(np.hypot(best[3].standard_error, fit.standard_error))
            ):
                self.keyframes[i] = self.keyframes[i].correct(best[2], now, fit.stick)
                continue
            width = np.inf if np.isnan(now.angle) else now.high - now.low
            if best is None or width < best[0]:
                best, self.keyframes[i] = (width, i, now, fit), keyframe
            if best[3].stick.sum() >= self.settings.firm_markers:
                break
        self.increment = None
        if best is None:
            return None
        _, first, now, fit = best
        self.increment = Increment(self._age(self.keyframes[first]), fit.angle, fit.stick)
        explained = fit.strain == 0.0 or not self.rigid.noise_mm
        if not ((explained and self.keyframes[first].fields is None) or self.rigid.stencils.flat):
            now = self._step(fields, now, fit)
        self.keyframes = [k for i, k in enumerate(self.keyframes) if i not in broken]
        return now, fit

    def _step(self, fields: Fields, now: Keyframe, fit: RigidFit) -> Keyframe:
        """The angle one step on from the last frame's, drawn towards the count.

        Counts from two keyframes differ, because different markers give them, which do not all
        stick alike. The step is that of the markers that stick in both frames, so that the angle
        does not jump when the keyframe changes. Its errors add up from step to step, so the
        difference to the count is forgotten over the mature age. The interval is the count's. Not
        so for a count from the unloaded shape whose misfit the noise explains, nor in the plane:
        gel that springs back in a slip is compared with the print at once.
        """
        if self._last is None or np.isnan(now.angle):
            return now
        last, stick = self._last
        both = stick & fit.stick
        if both.sum() < self.settings.min_stick_markers:
            return now
        turned, _ = self.rigid.turn(both, fields, last.fields)
        apart = last.angle + turned - now.angle
        return now.move(now.angle + (1.0 - 1.0 / self.settings.mature_age) * apart)

    def _age(self, keyframe: Keyframe) -> int:
        return self.number - keyframe.number

    def _remember(self, now: Keyframe) -> None:
        """Keep the frame as a keyframe if the last one is old enough, and thin the others out."""
        if self._age(self.keyframes[-1]) < self.settings.keyframe_interval:
            return
        self.keyframes.append(now)
        thin_out(self.keyframes, self.number, self.settings.most_keyframes)
