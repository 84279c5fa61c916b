"""Keyframes, from which rotations are counted, and the points where the object turns back.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (12).

Eq. (12) is the rate form of the total angle: it holds for the markers that stick over any interval.
Here the interval runs from a keyframe to now, and the keyframe is the oldest whose markers still
move as one body with the object. Errors then add up once per keyframe, not once per frame.
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from contactmodel.common.ranges import check_count
from estimation.estimators.keyframe import Counted, Keyframe, Leg
from estimation.estimators.rigid import Rigid, RigidSettings
from estimation.estimators.rotation import RigidFit
from estimation.estimators.strain import Press
from estimation.fields.measure import Fields


@dataclass(frozen=True)
class KeyframeSettings(RigidSettings):
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


class Keyframes:
    """The keyframes of a contact, and the angle counted from the oldest that still holds.

    Attributes:
        rigid: finds the markers that have moved as one body, and their rotation.
        kept: the keyframes in memory, the oldest first.
        number: number of the present frame since the tracker began.
        increment: motion since the keyframe that the last count began at; None without any.
    """

    def __init__(self, rigid: Rigid, settings: KeyframeSettings, memory: int) -> None:
        """Begin with the unloaded shape; the last `memory` frames are kept, too."""
        self.rigid, self._settings = rigid, settings
        self.number = 0
        self.increment: Increment | None = None
        # the last frames, each with its sticking markers
        self._recent: deque[tuple[Keyframe, Bool[np.ndarray, " n"]]] = deque(maxlen=memory)
        self.restart()

    def forget_motion(self) -> None:
        """The next frames do not continue the motion of the last ones."""
        self._leg = Leg()
        self._recent.clear()

    def restart(self) -> None:
        """Count from the unloaded shape."""
        self.forget_motion()
        self.kept = [Keyframe(None, self.number - self._settings.mature_age)]
        self.rigid.press = Press()

    def start_from(self, fields: Fields, angle: float, error: float) -> Keyframe:
        """Count from the present frame on, whose angle and its error are known [rad]."""
        start = Keyframe(fields, self.number - self._settings.mature_age, angle, error)
        self.kept = [start]
        return start

    def lose(self, fields: Fields) -> None:
        """Lose the angle: from the present frame on, only increments are known."""
        self.forget_motion()
        unknown = Keyframe(fields, self.number, angle=np.nan)
        self.kept = [k for k in self.kept if np.isnan(k.angle)] or [unknown]
        self.remember(unknown)

    def count(self, fields: Fields, doubtful: bool) -> Counted:
        """The present frame, counted from the best mature keyframe, and the sticking markers.

        The oldest keyframe is used while nine markers or more still stick since then; otherwise the
        one with the narrowest interval. Markers that stick since an older keyframe stick since a
        newer one too (`Keyframe.reconcile`); those that stuck last do, unless it is doubtful that
        they hold the object. Keyframes that no longer hold are removed. In the plane, where all
        markers may count as in contact, the gel at rest around the object is no body of its own.
        """
        stuck = self._recent[-1][1] if self._recent else None
        whole = self.rigid.stencils.flat and fields.contact[np.isfinite(fields.rotation)].all()
        best: tuple[float, int, Keyframe, RigidFit] | None = None
        broken: list[int] = []
        for i in self._find_mature():
            keyframe = self.kept[i]
            lately = None if doubtful else stuck
            fit = self.rigid.fit(fields, keyframe.fields, keyframe.body, lately)
            if fit is None:
                broken.append(i)
                continue
            if whole and stuck is not None and fit.is_around(stuck, fields.contact):
                continue
            turned = self.rigid.turn(fit.stick, self.kept[-1].fields, keyframe.fields)
            slipped = keyframe.see_slip(self.kept[-1], *turned)
            now = slipped.advance(fields, self.number, fit)
            if best is not None:
                noise = float(np.hypot(best[3].standard_error, fit.standard_error))
                self.kept[i] = keyframe.reconcile(now, best[2], noise, fit.stick)
                if self.kept[i] is not keyframe:
                    continue
            width = np.inf if np.isnan(now.angle) else now.high - now.low
            if best is None or width < best[0]:
                best, self.kept[i] = (width, i, now, fit), slipped
            if best[3].stick.sum() >= self._settings.firm_markers:
                break
        self.increment = None
        if best is None:
            return None
        _, first, now, fit = best
        self.increment = Increment(self._age(self.kept[first]), fit.angle, fit.stick)
        now = self._step(fields, now, fit, since=self.kept[first])
        self.kept = [k for i, k in enumerate(self.kept) if i not in broken]
        return now, fit

    def _find_mature(self) -> list[int]:
        """Places of the keyframes that may be counted from, the oldest first.

        A keyframe at a turning point is used at once. While the angle is lost, the newest is used,
        which forgets the slip soonest.
        """
        least = self._settings.mature_age
        mature = [i for i, k in enumerate(self.kept) if k.turning or self._age(k) >= least]
        return mature[-1:] if np.isnan(self.kept[0].angle) else mature

    def _step(self, fields: Fields, now: Keyframe, fit: RigidFit, since: Keyframe) -> Keyframe:
        """The angle one step on from the last frame's, drawn towards the count.

        Counts from two keyframes differ, because different markers give them, which do not all
        stick alike. The step is that of the markers that stick in both frames, so that the angle
        does not jump when the keyframe changes. Its errors add up from step to step, so the
        difference to the count is forgotten over the mature age. The interval is the count's. Not
        so for a count from the unloaded shape whose misfit the noise explains, nor in the plane:
        gel that springs back in a slip is compared with the print at once.
        """
        explained = fit.strain == 0.0 or not self.rigid.noise_mm
        if (explained and since.fields is None) or self.rigid.stencils.flat:
            return now
        if not self._recent or np.isnan(now.angle):
            return now
        last, stick = self._recent[-1]
        both = stick & fit.stick
        if both.sum() < self._settings.min_stick_markers:
            return now
        turned, _ = self.rigid.turn(both, fields, last.fields)
        apart = last.angle + turned - now.angle
        return now.move(now.angle + (1.0 - 1.0 / self._settings.mature_age) * apart)

    def remember(self, now: Keyframe) -> None:
        """Keep the present frame as a keyframe if the last one is old enough."""
        if self._age(self.kept[-1]) >= self._settings.keyframe_interval:
            self.keep(now)

    def keep(self, keyframe: Keyframe, most: int = 0) -> None:
        """Keep a keyframe, the newest, and thin the others out."""
        self.kept.append(keyframe)
        self._thin_out(most or self._settings.most_keyframes)

    def keep_grip(self) -> None:
        """Keep the first of the last frames as a mature keyframe: the object has held since."""
        held = self._recent[0][0]
        mature = held._replace(number=self.number - self._settings.mature_age)
        self.keep(mature, 2 * self._settings.most_keyframes)

    def turn_lately(self, fields: Fields) -> float:
        """Turn of most of the contact as one body since the first of the last frames [rad]; else 0.

        Gel that rests under a sliding object does not turn, and gel that springs back does not turn
        as one body.
        """
        fit = self.rigid.fit(fields, self._recent[0][0].fields)
        most = max(self._settings.many_markers, 0.5 * fields.contact.sum())
        return fit.angle if fit is not None and fit.stick.sum() >= most else 0.0

    def follow(self, now: Keyframe, stick: Bool[np.ndarray, " n"], noise: float) -> None:
        """Take the present frame, and put a keyframe where the object has turned back.

        Gel that slipped before this point sticks again after it. Since a keyframe from before, it
        forms a second body, which has turned less than the object. So older keyframes continue with
        the markers that stuck up to the turning point, and those too young for this are removed. An
        angle that only jumps, because another keyframe gives it, turns no gel back. The noise is
        that of the angle against those of the frames before [rad].
        """
        self._recent.append((now, stick))
        turning = self._leg.update(now, noise)
        if turning is None or turning.fields is None or now.fields is None:
            return
        back, turned = self.rigid.fit(now.fields, turning.fields), now.angle - turning.angle
        if back is None or abs(back.angle - turned) > 0.5 * abs(turned):
            return
        mature = turning.number - self._settings.mature_age
        older = []
        for k in self.kept:
            if k.number <= mature:
                fit = self.rigid.fit(turning.fields, k.fields, k.body)
                if fit is not None:
                    older.append(k._replace(body=fit.stick))
            elif k.number > turning.number:
                older.append(k)
        older.append(turning._replace(turning=True))
        self.kept = sorted(older, key=lambda k: k.number)
        self._thin_out(self._settings.most_keyframes)

    def _age(self, keyframe: Keyframe) -> int:
        return self.number - keyframe.number

    def _thin_out(self, most: int) -> None:
        """Remove keyframes whose neighbours are closest for their age, down to two or more."""
        while len(self.kept) > most:
            ages = [self._age(keyframe) for keyframe in self.kept]
            inner = range(1, len(ages) - 1)
            crowding = [(ages[i - 1] - ages[i + 1]) / (ages[i] + 1.0) for i in inner]
            last = max((i for i, k in enumerate(self.kept) if k.turning), default=0)
            if 0 < last <= len(crowding) and len(crowding) > 1:
                crowding[last - 1] = np.inf
            del self.kept[1 + int(np.argmin(crowding))]
