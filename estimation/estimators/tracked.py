"""The tracked estimator: the object's imprint, else increments and the contact's outline.

The gel alone cannot distinguish an object that slips from one that rests, since it stands still in
both cases. The object's imprint can (`estimation.estimators.imprinted`): where it is visible, it
gives the angle, and the gel gives the steps from frame to frame. Elsewhere increments give the
angle while markers stick. In macro slip the contact's outline gives it, since it turns with the
object (`estimation.fields.outline`).
"""

from collections import deque
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from contactmodel.common.ranges import check_count, check_positive
from estimation.estimators.imprinted import ImprintedTurn, Turn
from estimation.estimators.incremental import Incremental
from estimation.estimators.keyframes import KeyframeSettings
from estimation.estimators.measurement import Z95, Measurement
from estimation.estimators.outlined import OutlinedTurn
from estimation.estimators.result import RESTS_OR_SLIDES, UNSEEN_TURN
from estimation.fields.measure import Fields
from estimation.fields.outline import Axis, measure_axis
from estimation.fields.plane import in_contact_plane, shear_strain
from estimation.fields.stencils import Stencils
from estimation.frames.noise import Noise


@dataclass(frozen=True)
class TrackedSettings(KeyframeSettings):
    """Weights of outline and imprint against the gel.

    `KeyframeSettings` describes the inherited settings. Imprint and gel that stick together
    differ by up to four errors of two readings of the imprint.

    Attributes:
        slip_deg: difference between the turns of outline and gel over the mature age, from which
            the contact is in macro slip [deg].
        shape_change: relative change of the contact's curvature since the first frame with an
            outline, above which the outline belongs to another face and is not used [-].
        memory: frames of outline and imprint in memory [frames].
        widest_deg: half-width of the interval above which no angle is reported [deg].
        together_deg: difference between the turns of imprint and gel over three frames, up to which
            they count as sticking together [deg].
        sticking: correlation of each part of the print on the gel with that of a few frames before,
            below which an object whose imprint is lost does not count as turning with the gel: it
            may slip too fast for the camera [-]. As in `ShearSettings`.
    """

    slip_deg: float = 2.0
    shape_change: float = 0.3
    memory: int = 60
    widest_deg: float = 10.0
    together_deg: float = 0.5
    sticking: float = 0.92

    def __post_init__(self) -> None:
        """Check the ranges."""
        super().__post_init__()
        for name in ("slip_deg", "shape_change", "widest_deg", "together_deg", "sticking"):
            check_positive(name, getattr(self, name))
        check_count("memory", self.memory)


class Tracked:
    """Angle from imprint and gel, else from sticking markers, or from the outline in macro slip."""

    def __init__(
        self,
        stencils: Stencils,
        noise: Noise | None,
        settings: TrackedSettings = TrackedSettings(),
        gain: float = 1.0,
    ) -> None:
        """Make the estimator; without the noise of the markers, it uses the misfit of the fit.

        The gain is 1 + k, rotation of the object over that of the sticking elastomer [-]; the
        tracker takes it from the softness correction. Measured angles are the elastomer's.
        """
        self.settings = settings
        self.incremental = Incremental(stencils, noise, settings)
        self._keyframes = self.incremental.keyframes
        self.mature_age = settings.mature_age
        self.slip = float(np.radians(settings.slip_deg))
        self.widest = float(np.radians(settings.widest_deg))
        self.gain = gain
        self._restarts = 0
        self._forget()

    def update(self, fields: Fields) -> Measurement:
        """Rotation of the object since it touched, from the fields of the next frame."""
        fields = self.incremental.bound(fields)
        gel = self.incremental.follow(fields)
        if not fields.contact.any():
            self._forget()
            self._restarts = 0
            return gel
        gel = self._doubt_gel(fields, gel)
        confirmed = self._confirm(fields, gel)
        if confirmed or self._printed:
            return self._by_imprint(fields, gel, confirmed)
        if np.isfinite(gel.angle):
            self._restarts = gel.restarts
            if self._astray:
                self._turn, self._astray = ImprintedTurn(), False
        answer = self._by_outline(fields, gel)
        return answer._replace(restarts=self._restarts, slides=self.incremental.slides)

    def _doubt_gel(self, fields: Fields, gel: Measurement) -> Measurement:
        """The gel's angle with the errors that positions from pictures have in addition to noise.

        An object that is pressed on shades the gel, and the light moves the dots. Unless the source
        knows the contact, which then has an edge, it may seem too large, and gel at rest around it
        may seem to stick. Friction turns the gel no further than the object, and less where few
        markers span a small core that sticks: the interval reaches beyond the gel that has turned
        furthest, by as much again.

        Beside another contact, only some of the markers around the contact show slip, and its
        stress strains the gel: errors are up to 1.4 times larger (95 % of them, in simulation).
        """
        rigid = self._keyframes.rigid
        if fields.others is not None:
            beside = 0.4  # by how much the interval widens, over its width
            low, high = beside * (gel.angle - gel.low), beside * (gel.high - gel.angle)
            gel = gel._replace(low=gel.low - low, high=gel.high + high)
        error = Z95 * rigid.shading_error(fields, gel.stick)
        if not error:
            return gel
        low, high = gel.low - error, gel.high + error
        if self._keyframes.kept[0].fields is None and fields.edge is None:
            # largest local turn by noise and light [rad]
            largest = max(np.radians(0.05), 3.0 * rigid.stencils.rotation_noise(rigid.noise_mm))
            turned = np.sort(np.nan_to_num(fields.rotation[fields.contact]))
            # single dots may jump
            furthest = max(turned[2:-2], key=abs, default=0.0)
            way = float(np.sign(furthest))
            ahead = way * (furthest - gel.angle)
            if self._contradicts(fields, ahead):
                return Measurement.none(np.zeros_like(gel.stick), RESTS_OR_SLIDES, gel.restarts)
            if ahead > largest:
                reach = gel.angle + 2.0 * way * ahead
                low, high = min(low, reach - largest), max(high, reach + largest)
        return gel._replace(low=low, high=high)

    def _contradicts(self, fields: Fields, ahead: float) -> bool:
        """Whether some gel in contact has turned far `ahead` of markers that seem to stick [rad].

        Slip enters from the rim, so they are gel at rest beside an object that shows no print.
        """
        far = np.radians(1.0)
        return bool(ahead > far and not self._printed and np.isnan(fields.imprint[0]))

    def _by_outline(self, fields: Fields, gel: Measurement) -> Measurement:
        """The angle from the gel where it sticks, and from the outline elsewhere."""
        outline, axis = self._outline, self._outline.follow(measure_axis(fields))
        slides = bool(fields.closed) or self.incremental.slides
        if np.isfinite(gel.angle):
            gel = gel.shift(outline.lead(axis, gel.angle))
        if np.isfinite(gel.angle) and (
            (slides and outline.count(axis)) or outline.overtakes(axis, gel.angle)
        ):
            self.incremental.lose(fields)
            gel = Measurement.none(np.zeros_like(gel.stick))
        ahead = gel.angle + outline.reach(axis, gel.angle)
        outline.add(axis, gel.angle, 0.5 * (gel.high - gel.low) / Z95)
        if np.isfinite(gel.angle):
            gel = gel._replace(low=min(gel.low, ahead), high=max(gel.high, ahead))
            # a visible outline reveals a slide larger than this
            hidden = max(self.slip, 3.0 * axis.standard_error)
            answer = self.incremental.widen(gel, hidden if np.isfinite(axis.angle) else np.inf)
        else:
            answer = self._hand_over(fields, axis, gel, slides)
        if answer.high - answer.low > 2.0 * self.widest:
            if gel.reason:
                return gel
            self._may_slide = self.incremental.doubtful
            self.incremental.lose(fields)
            outline.clear()
            return Measurement.none(answer.stick, self._too_wide)
        return answer

    def _confirm(self, fields: Fields, gel: Measurement) -> bool:
        """Whether this frame is the second in a row with an imprint: a single one may be light.

        An imprint that was lost and is found again, before markers have counted anew, goes on.
        """
        if self._printed:
            return False
        angle = fields.imprint[0]
        if self._turn.known and np.isfinite(angle) and angle != 0.0:
            found, self._astray, self._printed = self._astray, False, True
            return not found
        if not (self._astray and np.isnan(angle)):
            self._turn, self._astray = ImprintedTurn(), False
        if self._astray or np.isfinite(angle):
            self._follow_turn(fields, gel)
        return False

    def _follow_turn(self, fields: Fields, gel: Measurement) -> Turn:
        lasting = gel.restarts == self._gel_restarts and not self._resumed
        if np.isnan(fields.imprint[0]) and fields.print_kept < self.settings.sticking:
            lasting = False
        self._gel_restarts, self._resumed = gel.restarts, False
        error = 0.5 * (gel.high - gel.low) / Z95
        if not self._turn.known:
            self._count = gel.restarts if np.isfinite(gel.angle) else None
        if not (self._turn.known or gel.restarts) and gel.stick.any():
            error = float(np.hypot(error, self._measure_shear(fields, gel.stick)))
        return self._turn.update(self.gain * gel.angle, self.gain * error, fields.imprint, lasting)

    def _measure_shear(self, fields: Fields, stick: Bool[np.ndarray, " n"]) -> float:
        """Shear strain of the markers that stick [-], an error of the angle that they give [rad].

        A body that sticks does not strain. Where slip enters from one side, as in a contact that
        the edge of the view cuts, the gel shears in layers, and turns by as much as it strains.
        """
        before, after = in_contact_plane(self._keyframes.rigid.stencils, fields, stick)
        return shear_strain(before[stick], after[stick])

    def _by_imprint(self, fields: Fields, gel: Measurement, confirmed: bool) -> Measurement:
        """The angle from imprint and gel together, and the markers that move with the imprint."""
        turn = self._follow_turn(fields, gel)
        if turn.error > self.widest / Z95:
            self._printed, self._astray = False, True
            self._begin()
            self.incremental.lose(fields)
            return Measurement.none(np.zeros_like(gel.stick), self._too_wide, self._restarts)
        if confirmed:
            self._restarts = self._restarts + 1 if self._count is None else self._count
        if np.isfinite(gel.angle) and self._slides(turn.angle, self.gain * gel.angle):
            self.incremental.lose(fields)
            gel = Measurement.none(np.zeros_like(gel.stick))
        self._turned.append((turn.angle, self.gain * gel.angle))
        self._seen.append((fields, turn.angle))
        stick = gel.stick
        if not np.isfinite(gel.angle):
            stick = self._moves_along(gel.stick)
            if stick.any():
                self.incremental.resume(fields, turn.angle / self.gain, turn.error / self.gain)
                self._resumed = True
        low, high = (end / self.gain for end in turn.interval)
        beyond = abs(gel.angle) - abs(turn.angle) / self.gain
        same = gel.restarts == (self._count or 0)  # both count from the same frame
        if beyond > 0.0 and same and not low < gel.angle < high:
            low, high = np.fmin(low, gel.low), np.fmax(high, gel.high)  # it may be a mark
        return Measurement(turn.angle / self.gain, low, high, stick, restarts=self._restarts)

    def _slides(self, turned: float, gel: float) -> bool:
        """Whether the object has recently turned away from markers that seem to stick.

        Gel that has been lost since counts from the print, not from its own turn before.
        """
        recent = list(self._turned)[-self.mature_age :]
        if len(recent) < self.mature_age or np.isnan(recent).any():
            return False
        before, gel_before = recent[0]
        apart = (turned - before) - (gel - gel_before)
        return bool(min(abs(apart), abs(turned - before)) > self.slip)

    def _moves_along(self, none: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """The markers that have recently moved as one body and with the imprint.

        Gel at rest sticks to an object at rest. Three frames distinguish this from an object that
        slides over the gel, since the imprint shows the slip.
        """
        (before, angle), (now, turned) = self._seen[0], self._seen[-1]
        if before is now or not (before.contact & now.contact).any():
            return none
        fit = self._keyframes.rigid.fit(now, before)
        together = np.radians(self.settings.together_deg)
        if fit is None or abs(turned - angle - self.gain * fit.angle) > together:
            return none
        return fit.stick

    @property
    def _too_wide(self) -> str:
        return f"the angle is not known to ±{self.settings.widest_deg:.0f}° any more"

    def _forget(self) -> None:
        """Restart with the next contact."""
        self._turn, self._printed = ImprintedTurn(), False
        self._astray = False  # the imprint is lost, but may be found again
        self._count: int | None = None  # of the gel's angle in the first frame with an imprint
        self._begin()

    def _begin(self) -> None:
        """Begin without frames to compare."""
        self._turned: deque[tuple[float, float]] = deque(maxlen=self.settings.memory)
        self._seen: deque[tuple[Fields, float]] = deque(maxlen=4)
        self._gel_restarts, self._resumed = 0, False
        self._may_slide = False  # over gel at rest, for so long that the angle is lost
        settings = self.settings
        self._outline = OutlinedTurn(
            settings.mature_age, settings.memory, self.slip, settings.shape_change, self.gain
        )

    def _hand_over(self, fields: Fields, axis: Axis, gel: Measurement, slides: bool) -> Measurement:
        """The angle by the outline, until markers stick and move with it.

        An object that slides holds nothing, though markers may move with it for some frames.
        """
        turn = self._outline.count(axis)
        if turn is None:
            return self._at_a_loss(gel)
        angle, error = turn
        increment, stick = self._keyframes.increment, gel.stick
        if increment is not None and not slides:
            along = self._outline.turns_along(axis, increment.angle, increment.age)
            stick = increment.stick if along else stick
        if stick.any():
            self.incremental.resume(fields, angle, error)
            self._outline.resume(axis)
        return Measurement(angle, angle - Z95 * error, angle + Z95 * error, stick)

    def _at_a_loss(self, gel: Measurement) -> Measurement:
        """No angle; macro slip, unless the markers turn as one body.

        At rest, markers that move as one are no evidence: the object may slide over them.
        """
        increment = self._keyframes.increment
        if self._may_slide and not gel.reason:
            gel = gel._replace(reason=RESTS_OR_SLIDES)
        if increment is None or increment.age < self.mature_age or not increment.stick.any():
            return gel
        if abs(increment.angle) < 0.5 * self.slip:
            return gel
        return gel._replace(reason=UNSEEN_TURN, body=increment.stick)
