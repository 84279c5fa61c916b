"""Run several estimators over frames, one by one."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from estimation.choices import AlertSettings, ContactSettings
from estimation.estimators import Measurement, make_estimator, method_constants, share_fits
from estimation.estimators.result import TOO_FEW_STICK, Estimate, Number, Record, State
from estimation.fields.measure import Fields
from estimation.frames.inspection import Fault
from estimation.frames.noise import Noise, expect_noise
from estimation.frames.recording import UNHELD_FLAWS, Frame, MarkerLayout
from estimation.slip.gel_moment import GelMoment
from estimation.slip.load import LoadWatch
from estimation.slip.motion import Count, Since, gel_ends
from estimation.slip.onset import Sight, SlipWatch
from estimation.slip.pace import PaceWatch
from estimation.slip.rest import RestWatch
from estimation.slip.shear import Shear, ShearWatch
from estimation.slip.slide import SlideWatch
from estimation.softness import RIGID_OBJECT, Contact, Softness
from estimation.tracking.observation import Observation, Observer


class Trackers:
    """Estimates the object's angle by several methods at once, causally.

    Each frame is inspected and its fields are measured once for all methods. Methods that fit the
    same markers with the same settings share the fit.

    Attributes:
        estimators: estimators by method.
        constants: constants by method.
        counts: by method, the frame that its angle counts from.
        observation: fields and contact of the last frame; None before the first.
        sight: evidence of macro slip in the motion of the last frames.
        shear: shear of the gel in the last frame, and whether the object slips along it.
        load: margin, friction and alert after the last frame, by the first method.

    Examples:
        >>> import numpy as np
        >>> from estimation import Trackers, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> trackers = Trackers(recording.layout, {"tracked": {}, "kabsch": {}})
        >>> *_, last = (trackers.update(frame) for frame in recording)
        >>> for method, estimate in last.items():
        ...     print(f"{method}: {np.degrees(estimate.angle):.1f}°")  # 10° is true
        tracked: 10.0°
        kabsch: 4.8°
    """

    def __init__(
        self,
        layout: MarkerLayout,
        methods: Mapping[str, Mapping[str, Any]],
        *,
        noise: Noise | None = None,
        softness: Softness = RIGID_OBJECT,
        contact: ContactSettings = ContactSettings(),
        alert: AlertSettings = AlertSettings(),
    ) -> None:
        """Make the trackers.

        Args:
            layout: the markers of the sensor.
            methods: names from `METHODS` or `PUBLISHED_METHODS`, each with the constants to change.
            noise: noise of the markers; without it, intervals come from the misfit in each frame.
            softness: correction by Eq. (13).
            contact: thresholds of contact and state.
            alert: thresholds of the alerts.

        Raises:
            ValueError: an unknown method or constant, a value out of range, or too few markers.
        """
        expect_noise(noise)
        if not hasattr(softness, "stiffness_ratio"):
            raise ValueError(
                f"a softness is expected, got {softness!r}: make one, for example "
                "`ScalarSoftness(stiffness_ratio)`, or read one with `read_softness`"
            )
        self.constants = {name: method_constants(name) | dict(own) for name, own in methods.items()}
        self.softness = softness
        self._observer = Observer(layout, softness, contact, noisy=noise is not None)
        stencils, gain = self._observer.stencils, 1.0 + softness.stiffness_ratio
        self.estimators = {
            name: make_estimator(name, stencils, noise, gain, own) for name, own in methods.items()
        }
        share_fits(self.estimators.values())
        self._since = dict.fromkeys(methods, Since())
        self._states = dict.fromkeys(methods, State.UNKNOWN)
        self.counts = {name: Count() for name in methods}
        self._rests = {name: RestWatch() for name in methods}
        self._paces = {name: PaceWatch(stencils, noise, gain) for name in methods}
        self.observation: Observation | None = None
        self.sight, self.shear, self.load = Sight(), Shear(), LoadWatch(alert)
        self._watch = None if noise is None else SlipWatch(layout, noise)
        self._shear, self._slide = ShearWatch(layout), SlideWatch(layout)
        self._gel, self._gel_moment = GelMoment(layout), np.nan

    def update(self, frame: Frame) -> dict[str, Estimate]:
        """The estimates for the next frame, by method.

        An unusable frame gets an estimate without an angle that gives the reason, and has no
        further effect. A frame is unusable if its source flagged it, if its time stamp is missing
        or not after the last frame's, if all positions are zero, or if it has too few markers.

        Raises:
            ValueError: `frame` is not a frame of this layout.
        """
        touch = frame if isinstance(frame, Frame) and frame.flaw in UNHELD_FLAWS else None
        if touch is not None:  # it holds nothing: the next angle counts from the next contact
            frame = dataclasses.replace(frame, flaw="", contact=np.zeros_like(frame.valid))
        observation = self.observation = self._observer.observe(frame)
        self.shear = self._follow_shear(observation)
        fields = observation.fields
        self.sight = self._follow_disc(observation)
        if fields is None:
            estimates = self._label(observation)
        else:
            fields = fields._replace(closed=self.sight.closed, grips=self.sight.grips)
            self._gel_moment = self._gel.update(fields)
            self.load.press(frame.wrench, fields.positions[fields.contact, :2], fields.edge)
            estimates = {name: self._answer(observation, fields, name) for name in self.estimators}
        self._states = {name: estimate.state for name, estimate in estimates.items()}
        main = next(iter(estimates.values()))
        shown = np.nan if self.shear.hidden else self.shear.slip_probability
        self.load.follow(main, shown, usable=fields is not None)
        if touch is None:
            return estimates
        return {name: label_frame(touch, touch.flaw, since) for name, since in self._since.items()}

    def _label(self, observation: Observation) -> dict[str, Estimate]:
        """Estimates without an angle, for a frame that cannot be used."""
        frame = observation.frame
        # the source detects the contact; only the angle suffers from the flaw
        by_source = bool(frame.flaw) or observation.cut
        states = dict.fromkeys(self._since, self.shear.state if by_source else State.UNKNOWN)
        if frame.flaw == Fault.REPEATS and frame.contact is not None:
            states = self._states
        elif frame.flaw:  # the object's print in this frame is no evidence of a grasp yet
            self.shear = Shear(self.shear.shear, print_correlation=self.shear.print_correlation)
        return {
            name: label_frame(frame, observation.flaw, since, states[name])
            for name, since in self._since.items()
        }

    def _follow_disc(self, observation: Observation) -> Sight:
        """The disc of sticking markers, from the motion over the last frames."""
        if self._watch is None:
            return Sight()
        frame, fields = observation.seen, observation.fields
        contact = np.zeros(len(frame.positions), dtype=bool) if fields is None else fields.contact
        printed = bool(np.isfinite(frame.imprint[0]))
        return self._watch.update(frame.positions, contact, frame.time, printed)

    def _follow_shear(self, observation: Observation) -> Shear:
        """The gel's shear, also in frames whose contact is too little in view for an angle."""
        if observation.flaw == Fault.REPEATS:
            return self.shear
        frame, fields = observation.frame, observation.fields
        contact = frame.contact if fields is None else fields.contact
        if contact is None or (frame.flaw and not contact.any()):
            return Shear()
        slide = None
        if not frame.flaw:
            slide = self._slide.update(
                frame.positions[:, :2], contact, frame.imprint, frame.print_point, frame.time
            )
        return self._shear.update(frame.positions, contact, frame.hold, slide)

    def _answer(self, observation: Observation, fields: Fields, method: str) -> Estimate:
        """The estimate by one method."""
        frame, gel = observation.frame, self.estimators[method].update(fields)
        since = self._since[method] = self._since[method].update(gel, fields, frame.time)
        state, reason = self._judge(fields, gel, frame, method)
        if observation.cut:
            reason = reason or "the contact reaches the edge of the view"
        if fields.others is not None:
            reason = reason or "of several contacts, one is followed"
        contact = Contact(fields, frame.normal_force, gel.stick, observation.as_seen)
        try:
            softness = self.softness.at(contact) if np.isfinite(gel.angle) else RIGID_OBJECT
        except ValueError as error:
            return label_frame(frame, str(error), since)
        angle, low, high = softness.correct(gel)
        count = self.counts[method]
        turned = count.turned(state, since.restarts, fields.rotation)
        held = count.held_angle(gel) if np.isnan(frame.imprint[0]) else np.nan
        gel_low, gel_high = gel_ends(turned, fields.contact, held)
        stick = fields.contact if self.shear.sticks else gel.stick & (not self.shear.slides)
        if self._shear.strayed is not None:
            stick = stick & ~self._shear.strayed
        return Estimate(
            time=frame.time,
            source_index=frame.source_index,
            state=state,
            reason=reason,
            angle=angle,
            low=low,
            high=high,
            since=since.since,
            restarts=since.restarts,
            moment=frame.moment,
            centre_moment=self.load.loads.moment,
            shear_moment_x=self.load.loads.shear_x,
            shear_moment_y=self.load.loads.shear_y,
            gel_moment=self._gel_moment,
            rotation=fields.rotation,
            contact=fields.contact,
            stick=stick,
            stick_markers=int(stick.sum()),
            contact_markers=int(fields.contact.sum()),
            contact_radius=np.nan if fields.edge is None else fields.edge.radius,
            gel_thinness=np.nan if fields.edge is None else fields.edge.thinness,
            flat_share=np.nan if fields.edge is None else fields.edge.flat,
            elongation=np.nan if fields.edge is None else fields.edge.elongation,
            disc_ratio=gel.disc.ratio,
            disc_error=gel.disc.error,
            disc_twist=gel.disc.twist * (1.0 + softness.stiffness_ratio),
            gel_low=gel_low,
            gel_high=gel_high,
            stiffness_ratio=softness.stiffness_ratio,
            load_term=softness.load_term,
            covered=softness.validity.covers(gel.angle, contact),
        )

    def _judge(
        self, fields: Fields, gel: Measurement, frame: Frame, method: str
    ) -> tuple[State, str]:
        """State of the contact, and the reason for a missing or uncertain angle.

        Four steps decide; each may change the state that the one before has found:

        1. The signs of this frame, of which the first that applies counts (`_rank_signs`).
        2. Without a print, the gel's last frames: its rest may hide a slip, or the end of one, and
           its grip ends one (`RestWatch`).
        3. Then the markers that stuck last: their pace shows whether they slip (`PaceWatch`).
        4. The whole recording, once it is known (`estimation.slip.lookback`): states by the print
           are dated back, and then answers given during unnoticed slips are withdrawn.

        A frame that cannot be used has the state of its print, if any (`_label`).
        """
        if fields.contact.any():
            state, reason = self._rank_signs(fields, gel)
        else:
            by_source, explain = frame.contact is not None, self._observer.explain_no_contact
            state, reason = State.NO_CONTACT, "no contact" if by_source else explain(fields)
        if self.shear.slides or np.isfinite(frame.imprint[0]):
            return state, reason
        state, reason = self._rests[method].judge(state, reason, gel, self.sight)
        return self._paces[method].judge(state, reason, gel, fields, frame.time)

    def _rank_signs(self, fields: Fields, gel: Measurement) -> tuple[State, str]:
        """State of a contact by the first sign of a frame that applies, and the reason."""
        shear, stick = self.shear, int(gel.stick.sum())
        lost = "" if np.isfinite(gel.angle) else TOO_FEW_STICK
        few, holds = bool(lost) or not stick, shear.holds or self.load.holds
        opens = fields.closed is False and not gel.slides
        least = self._observer.contact.stick_share * fields.contact.sum()
        stuck = "the contact sticks, but the object's rotation so far is unknown"
        alike = "no slip is seen, but too few markers move as one body to give an angle"
        hidden = "few markers stick, and the object's print does not show its slip"
        signs = (
            # the disc of sticking markers has closed; the print, or the forces, show no hold
            (fields.closed and not holds, State.MACRO_SLIP, lost),
            # the print moves over the gel
            (shear.slides, State.MACRO_SLIP, gel.reason or lost),
            # the method doubts its own markers
            (gel.reason, State.UNKNOWN, gel.reason),
            # all of the print has stayed on the gel, or all but a part
            (shear.sticks, State.STICK, lost and stuck),
            (shear.strays, State.INCIPIENT, lost),
            # few markers move as one body: print, forces or disc show that the object holds, ...
            (few and (holds or opens), State.INCIPIENT, lost and alike),
            # ... or the print cannot show its slip, or nothing speaks against a slip
            (few and (shear.hidden or shear.rests), State.UNKNOWN, hidden),
            (few, State.MACRO_SLIP, lost),
            (stick < least, State.INCIPIENT, ""),
            (True, State.STICK, ""),
        )
        return next((state, reason) for applies, state, reason in signs if applies)


def label_frame(
    frame: Frame, reason: str, since: Since = Since(), state: State = State.UNKNOWN
) -> Estimate:
    """An estimate without an angle, with the reason."""
    unknown: dict[str, Any] = {
        item.name: np.nan for item in dataclasses.fields(Record) if item.type is Number
    }
    none = np.zeros(len(frame.positions), dtype=bool)
    contact = none if frame.contact is None else frame.contact
    known = {
        "time": frame.time,
        "source_index": frame.source_index,
        "state": state,
        "reason": reason,
        "since": since.since,
        "restarts": since.restarts,
        "moment": frame.moment,
        "rotation": np.full(len(none), np.nan),
        "contact": contact,
        "stick": none,
        "stick_markers": 0,
        "contact_markers": int(contact.sum()),
        "stiffness_ratio": 0.0,
        "load_term": 0.0,
        "covered": True,
    }
    return Estimate(**unknown | known)
