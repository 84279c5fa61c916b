"""The incremental estimator: what has turned since the oldest frame that the contact remembers.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eqs. (12) and (15).

A total angle assumes that a point has stuck since the pad was unloaded. After a reversal or a
partial slip none may have, though most stick again. Eq. (12) is the rate form of the total: it
holds for what sticks over any interval. Here the interval runs from a keyframe to now, and the
keyframe is the oldest whose markers still move as one body with the object: measured so, errors add
up once per keyframe, not once per frame.
"""

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from estimation.estimators.measurement import Z95, Measurement
from estimation.estimators.result import RESTS_OR_SLIDES
from estimation.estimators.rigid import Rigid, RigidFit, RigidSettings
from estimation.estimators.unseen_slide import UnseenSlide
from estimation.fields.measure import Fields
from estimation.fields.stencils import Stencils
from estimation.fields.stick import check_count
from estimation.frames.noise import Noise


@dataclass(frozen=True)
class IncrementalSettings(RigidSettings):
    """How the markers that stick are followed; see `RigidSettings` for the rest.

    In macro slip the gel hardly moves from one frame to the next and all of it seems to stick; over
    the mature age it does not. Where many markers stuck in most of the last frames, noise hides
    them all at once, and slip lets them go one after the other; gel that comes to rest under a
    sliding object seems to stick all of a sudden.

    Attributes:
        keyframe_interval: frames between two keyframes [frames].
        mature_age: frames over which markers must move together to count as sticking, and over
            which gel and outline are compared. More frames report slip later [frames].
        most_keyframes: number of keyframes to keep [-].
        firm_markers: number of markers still sticking since a keyframe, from which newer keyframes
            are not tried [-].
        many_markers: number of markers that stuck before, from which a frame without any is first
            taken for noise and not for slip [-].
        patience: frames without a sticking marker after which the angle is given up, if many
            markers stuck before [frames].
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
        for name in ("keyframe_interval", "mature_age", "most_keyframes"):
            check_count(name, getattr(self, name))


class Keyframe(NamedTuple):
    """A frame to count from.

    Attributes:
        fields: of the frame; None for the unloaded shape.
        number: frames since the tracker began.
        angle: rotation of the elastomer up to there [rad].
        error: its standard error [rad].
        lag_low: how far undetected slip may have kept it above the truth [rad].
        lag_high: how far undetected slip may have kept it below the truth [rad].
    """

    fields: Fields | None
    number: int
    angle: float = 0.0
    error: float = 0.0
    lag_low: float = 0.0
    lag_high: float = 0.0

    def advance(self, fields: Fields, number: int, fit: RigidFit) -> "Keyframe":
        """The keyframe that now is, counted from this one."""
        return Keyframe(
            fields=fields,
            number=number,
            angle=self.angle + fit.angle,
            error=float(np.hypot(self.error, fit.standard_error)),
            lag_low=self.lag_low + max(-fit.lag, 0.0),
            lag_high=self.lag_high + max(fit.lag, 0.0),
        )

    def agrees(self, other: "Keyframe") -> bool:
        """Whether the intervals of two angles of one frame have anything in common."""
        return not (self.high < other.low or other.high < self.low)

    def doubt(self, apart: float) -> "Keyframe":
        """The keyframe, its angle in doubt by what another one's markers have turned beyond it."""
        return self._replace(lag_low=max(self.lag_low, -apart), lag_high=max(self.lag_high, apart))

    @property
    def low(self) -> float:
        """Lower end of the angle's 95 % interval [rad]."""
        return self.angle - float(np.hypot(Z95 * self.error, self.lag_low))

    @property
    def high(self) -> float:
        """Upper end of the angle's 95 % interval [rad]."""
        return self.angle + float(np.hypot(Z95 * self.error, self.lag_high))


class Increment(NamedTuple):
    """What has moved as one body since the keyframe that was last counted from.

    Attributes:
        age: frames since.
        angle: rotation since [rad].
        stick: the markers.
    """

    age: int
    angle: float
    stick: Bool[np.ndarray, " n"]


class Incremental:
    """Rigid increments of what sticks, from the oldest keyframe that still holds."""

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: IncrementalSettings = IncrementalSettings(),
    ) -> None:
        """Make the estimator.

        Args:
            stencils: of the marker layout.
            noise: of the markers; without it the misfit of the fit takes its place.
            settings: how the markers that stick are found and followed.
        """
        self.settings = settings
        self.rigid = Rigid(stencils, noise, settings)
        self.keyframes = [Keyframe(None, -settings.mature_age)]
        self.number = 0
        self.increment: Increment | None = None
        self.anew = 0
        """How often the angle has been counted anew since the object touched."""
        self._free = 0  # the last frame without contact
        self._firm: deque[bool] = deque(
            maxlen=settings.mature_age
        )  # whether many stuck, frame by frame
        self._hidden = 0  # frames passed over just now
        self._slide = UnseenSlide(settings.firm_markers)

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the elastomer where it sticks, and how far the object may have slid on.

        See `follow`.
        """
        return self.widen(self.follow(fields), np.inf)

    def widen(self, gel: Measurement, most: float) -> Measurement:
        """The interval with how far the object may have slid over gel that rests.

        Args:
            gel: the frame's measurement.
            most: that it can have slid unseen [rad].
        """
        behind, ahead = (min(one, most) for one in self._slide.extent)
        reason = gel.reason or (RESTS_OR_SLIDES if self.doubtful and most == np.inf else "")
        return gel._replace(low=gel.low - behind, high=gel.high + ahead, reason=reason)

    @property
    def doubtful(self) -> bool:
        """Whether the object may slide over gel that rests, and have slid far."""
        return self._slide.doubtful

    def follow(self, fields: Fields) -> Measurement:
        """Rotation of the elastomer where it sticks, from the fields of the next frame.

        A contact that has already slipped when it is first seen is counted from that frame. Once
        nothing sticks any more the angle is lost until the next contact: gel that stands still may
        stick again, or the object may slide on over it. Up to two frames in which noise hides what
        sticks are passed over.
        """
        self.number += 1
        if not fields.contact.any():
            self.restart()
            self._free = self.number
            self._firm.clear()
            return Measurement.none(fields.contact)
        found = self._count_on(fields)
        if (
            found is None
            and self._hidden < self.settings.patience
            and 2 * sum(self._firm) > len(self._firm)
        ):
            self._hidden += 1
            reason = "no marker seems to stick, but a dozen or more did just before"
            return Measurement.none(np.zeros_like(fields.contact), reason, self.anew)
        self._hidden = 0
        if found is None and self.number - self._free <= self.settings.patience:
            self.restart()  # what the first frames showed may have been noise
            found = self._count_on(fields)
        if found is None and self.keyframes[-1].fields is None:
            error = self.rigid.reading_error(fields)
            start = Keyframe(fields, self.number - self.settings.mature_age, error=error)
            self.keyframes = [start]
            self.anew += 1
            return Measurement(start.angle, start.low, start.high, fields.contact, anew=self.anew)
        if found is None:
            self._firm.clear()
            self.lose(fields)
            return Measurement.none(np.zeros_like(fields.contact), anew=self.anew)
        now, stick = found
        self._remember(now)
        if np.isnan(now.angle):
            return Measurement.none(np.zeros_like(fields.contact), anew=self.anew)
        self._firm.append(bool(stick.sum() >= self.settings.many_markers))
        self._slide.update(now.angle, int(stick.sum()), int(fields.contact.sum()))
        return Measurement(now.angle, now.low, now.high, stick, anew=self.anew)

    def lose(self, fields: Fields) -> None:
        """Give up the angle: from this frame on only increments are known."""
        self._slide.restart()
        unknown = Keyframe(fields, self.number, angle=np.nan)
        self.keyframes = [k for k in self.keyframes if np.isnan(k.angle)] or [unknown]
        self._remember(unknown)

    def resume(self, fields: Fields, angle: float, error: float) -> None:
        """Count on from this frame, at an angle that was found otherwise [rad]."""
        self._slide.restart()
        number = self.number - self.settings.mature_age
        self.keyframes = [Keyframe(fields, number, angle=angle, error=error)]

    def restart(self) -> None:
        """Count from the unloaded shape again."""
        self._slide.restart()
        self.keyframes = [Keyframe(None, self.number - self.settings.mature_age)]
        self.anew = 0

    def _count_on(self, fields: Fields) -> tuple[Keyframe, np.ndarray] | None:
        """The frame counted from the best mature keyframe, and its markers that stick.

        The oldest serves while nine markers or more hold on to it; among weaker ones the one that
        leaves the narrowest interval. What has stuck since an older keyframe has stuck since a
        newer one too: where their intervals have nothing in common, the newer one was made while
        all but the older one's markers slipped, and the object has rested since. While the angle
        is lost it is the newest that serves, which forgets the slip soonest. Those that no longer
        hold are forgotten.
        """
        mature = [
            i for i, k in enumerate(self.keyframes) if self._age(k) >= self.settings.mature_age
        ]
        if mature and np.isnan(self.keyframes[0].angle):
            mature = mature[-1:]
        best: tuple[float, int, Keyframe, RigidFit] | None = None
        broken: list[int] = []
        for i in mature:
            fit = self.rigid.fit(fields, self.keyframes[i].fields)
            if fit is None:
                broken.append(i)
                continue
            now = self.keyframes[i].advance(fields, self.number, fit)
            if best is not None and not best[2].agrees(now):
                self.keyframes[i] = self.keyframes[i].doubt(best[2].angle - now.angle)
                continue
            width = np.inf if np.isnan(now.angle) else now.high - now.low
            if best is None or width < best[0]:
                best = width, i, now, fit
            if best[3].stick.sum() >= self.settings.firm_markers:
                break
        self.increment = None
        if best is None:
            return None
        _, first, now, fit = best
        self.increment = Increment(self._age(self.keyframes[first]), fit.angle, fit.stick)
        self.keyframes = [k for i, k in enumerate(self.keyframes) if i not in broken]
        return now, fit.stick

    def _age(self, keyframe: Keyframe) -> int:
        return self.number - keyframe.number

    def _remember(self, now: Keyframe) -> None:
        """Keep the frame as a keyframe if the last one is old enough, and thin the others out."""
        if self._age(self.keyframes[-1]) < self.settings.keyframe_interval:
            return
        self.keyframes.append(now)
        if len(self.keyframes) > self.settings.most_keyframes:
            ages = [self._age(keyframe) for keyframe in self.keyframes]
            crowding = [
                (ages[i - 1] - ages[i + 1]) / (ages[i] + 1.0) for i in range(1, len(ages) - 1)
            ]
            del self.keyframes[1 + int(np.argmin(crowding))]
