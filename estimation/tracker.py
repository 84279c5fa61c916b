"""Run an estimator over frames, one at a time or a whole recording."""

from dataclasses import replace
from inspect import signature
from typing import Any

import numpy as np
from jaxtyping import Float

from estimation.contact import ONSET_MM, SHARE, reaches_edge
from estimation.estimators import DEFAULT_METHOD, METHODS, RIVALS, Estimator, Measurement
from estimation.fields import Fields, measure_fields
from estimation.noise import Noise, find_noise
from estimation.recording import Frame, MarkerLayout, Recording
from estimation.result import TOO_FEW_STICK, Estimate, Result, State
from estimation.softness import Contact, ScalarSoftness, Softness
from estimation.stencils import Stencils, make_stencils
from estimation.stick import MIN_STICK_MARKERS, check_positive

RIGID_OBJECT = ScalarSoftness()
STICK_SHARE = 0.9
LEAST_IN_VIEW = 12
"""Markers of a contact that is cut by the edge of the view below which too little of it is seen."""


class Tracker:
    """Follows the object's angle frame by frame, knowing only the past.

    Over the frames of a recording it gives the numbers that `estimate_angles` gives when told the
    same noise.
    """

    def __init__(
        self,
        layout: MarkerLayout,
        method: str = DEFAULT_METHOD,
        *,
        noise: Noise | None = None,
        softness: Softness = RIGID_OBJECT,
        onset_mm: float = ONSET_MM,
        contact_share: float = SHARE,
        stick_share: float = STICK_SHARE,
        **constants: Any,
    ) -> None:
        """Make a tracker.

        Args:
            layout: the markers of the sensor.
            method: one of `METHODS` or `RIVALS`.
            noise: of the markers; without it intervals come from the misfit within each frame.
            softness: correction by Eq. (13).
            onset_mm: displacement of the stick centre from which there is contact [mm].
            contact_share: share of the largest normal displacement that bounds the contact [-].
            stick_share: share of the contact's markers from which the state is `stick` [-].
            **constants: of the method.

        Raises:
            ValueError: no such method or constant, a value out of range, or too few markers.
        """
        if method not in METHODS | RIVALS:
            raise ValueError(f"no method {method!r}; there are {', '.join(METHODS | RIVALS)}")
        if len(layout.reference) < MIN_STICK_MARKERS:
            raise ValueError(
                f"{len(layout.reference)} markers; at least {MIN_STICK_MARKERS} are needed"
            )
        self.stencils = make_stencils(layout)
        self.estimator = _make_estimator(
            method, self.stencils, noise, 1.0 + softness.stiffness_ratio, constants
        )
        self.constants = method_constants(method) | constants
        self.softness = softness
        self._lifting = softness.lifting(self.stencils.reference[:, :2])
        self._time = -np.inf
        self.onset_mm = check_positive("onset_mm", onset_mm)
        self.contact_share = _check_share("contact_share", contact_share)
        self.stick_share = _check_share("stick_share", stick_share)

    def update(self, frame: Frame) -> Estimate:
        """What is known after the next frame.

        A frame that cannot be used is labelled and otherwise left out: one with a flaw that its
        source has found, without a time stamp or with one that is not after the last frame's, with
        all positions zero, or with too few markers.

        Raises:
            ValueError: the frame is not of this layout.
        """
        if frame.positions.shape[0] != len(self.stencils.reference):
            raise ValueError(
                f"the frame has {frame.positions.shape[0]} markers, the layout "
                f"{len(self.stencils.reference)}"
            )
        if flaw := frame.flaw or self._find_flaw(frame):
            return self._label(frame, State.UNKNOWN, flaw)
        told = frame.contact
        cut = told is not None and reaches_edge(self.stencils.neighbours, told)
        if told is not None and cut and told.sum() < LEAST_IN_VIEW:
            return self._label(frame, State.UNKNOWN, "too little of the contact is in view")
        if frame.valid.sum() < MIN_STICK_MARKERS:
            return self._label(frame, State.UNKNOWN, f"{frame.valid.sum()} usable markers")
        frame, as_seen = self._lift(frame)
        fields = measure_fields(
            self.stencils, frame, onset_mm=self.onset_mm, share=self.contact_share
        )
        gel = self.estimator.update(fields)
        state, reason = self._judge(fields, gel, told=told is not None)
        if cut:
            reason = reason or "the contact reaches the edge of the view"
        contact = Contact(fields, frame.normal_force, gel.stick, as_seen)
        try:
            softness = self.softness.at(contact) if np.isfinite(gel.angle) else RIGID_OBJECT
        except ValueError as error:
            return self._label(frame, State.UNKNOWN, str(error))
        angle, low, high = softness.correct(gel)
        return Estimate(
            time=frame.time,
            source_index=frame.source_index,
            state=state,
            reason=reason,
            angle=angle,
            low=low,
            high=high,
            moment=frame.moment,
            rotation=fields.rotation,
            contact=fields.contact,
            stick=gel.stick,
            stiffness_ratio=softness.stiffness_ratio,
            load_term=softness.load_term,
            covered=softness.validity.covers(gel.angle, contact),
        )

    def _lift(self, frame: Frame) -> tuple[Frame, Float[np.ndarray, "n 2"] | None]:
        """The frame that the softness wants to see, and the displacement that the markers show.

        A marker that is not seen counts with the mean of its neighbours.
        """
        if self._lifting is None:
            return frame, None
        moved = (frame.positions - self.stencils.reference[:, : frame.positions.shape[1]])[:, :2]
        seen = frame.valid
        beside = self.stencils.neighbours
        counts = (beside >= 0) & seen[beside]
        total = np.sum(np.where(counts[..., None], moved[beside], 0.0), axis=1)
        mean = total / np.maximum(counts.sum(axis=1), 1)[:, None]
        moved = np.where(seen[:, None], moved, mean)
        positions = frame.positions.copy()
        positions[:, :2] += self._lifting.of(moved)
        rotation = frame.rotation
        if rotation is not None:
            rotation = rotation + self._lifting.rotation @ np.nan_to_num(rotation)
        return replace(frame, positions=positions, rotation=rotation), moved

    def _find_flaw(self, frame: Frame) -> str:
        """What a frame and the one before it show to be wrong; empty where nothing is."""
        last = self._time
        if not np.isfinite(frame.time):
            return "no time stamp"
        self._time = frame.time
        if frame.time <= last:
            return "time stamp not after the last frame's"
        if not frame.positions.any():
            return "all marker positions are zero"
        return ""

    def _judge(self, fields: Fields, gel: Measurement, told: bool) -> tuple[State, str]:
        """State of the contact, and why there is no angle; whether the source told the contact."""
        if not fields.contact.any():
            if told:
                return State.NO_CONTACT, "no contact"
            return State.NO_CONTACT, f"no contact: moved by less than {self.onset_mm:g} mm"
        if gel.reason:
            return State.UNKNOWN, gel.reason
        if not np.isfinite(gel.angle):
            return State.MACRO_SLIP, TOO_FEW_STICK
        if not gel.stick.any():
            return State.MACRO_SLIP, ""
        if gel.stick.sum() >= self.stick_share * fields.contact.sum():
            return State.STICK, ""
        return State.INCIPIENT, ""

    def _label(self, frame: Frame, state: State, reason: str) -> Estimate:
        """An estimate that only says why there is none."""
        none = np.zeros(len(self.stencils.reference), dtype=bool)
        return Estimate(
            time=frame.time,
            source_index=frame.source_index,
            state=state,
            reason=reason,
            angle=np.nan,
            low=np.nan,
            high=np.nan,
            moment=frame.moment,
            rotation=np.full(len(none), np.nan),
            contact=none,
            stick=none,
        )


def _make_estimator(
    method: str,
    stencils: Stencils,
    noise: Noise | None,
    gain: float,
    constants: dict[str, Any],
) -> Estimator:
    make = (METHODS | RIVALS)[method]
    own = method_constants(method)
    for name in constants:
        if name not in own:
            raise ValueError(
                f"{method} has no constant {name!r}; it has {', '.join(sorted(own)) or 'none'}"
            )
    takes_gain = "gain" in signature(make).parameters
    return make(stencils, noise, **({"gain": gain} if takes_gain else {}), **constants)


def method_constants(method: str) -> dict[str, Any]:
    """A method's constants at their defaults.

    Args:
        method: one of `METHODS` or `RIVALS`.
    """
    parameters = signature((METHODS | RIVALS)[method]).parameters
    others = ("stencils", "noise", "gain")
    return {name: one.default for name, one in parameters.items() if name not in others}


def _check_share(name: str, value: float) -> float:
    if not 0.0 < value <= 1.0:
        raise ValueError(f"{name} is {value}; it must be a share above 0 and at most 1")
    return value


def estimate_angles(
    recording: Recording,
    method: str = DEFAULT_METHOD,
    *,
    noise: Noise | None = None,
    **settings: Any,
) -> Result:
    """The object's angle in every frame of a recording.

    Args:
        recording: the recording.
        method: one of `METHODS` or `RIVALS`.
        noise: of the markers; estimated from the recording unless given. A recording that is too
            short for that gets intervals from the misfit within each frame, and a note.
        **settings: of the `Tracker`.

    Raises:
        ValueError: a wrong setting.
    """
    noise, notes = (noise, ()) if noise else find_noise(recording)
    tracker = Tracker(recording.layout, method, noise=noise, **settings)
    return Result.gather(method, [tracker.update(frame) for frame in recording], notes)
