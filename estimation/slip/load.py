"""Margin, friction and alert after each frame, fitted when asked for."""

from functools import cached_property

import numpy as np
from jaxtyping import Float

from estimation.choices import AlertSettings
from estimation.estimators.measurement import StickDisc
from estimation.estimators.result import Estimate, State
from estimation.fields.edge import Edge
from estimation.slip.alert import Alert, AlertWatch
from estimation.slip.branch import Branch
from estimation.slip.friction import Friction, FrictionWatch
from estimation.slip.load_path import Loads
from estimation.slip.margin import Margin, MarginWatch
from estimation.slip.pressures import Face, prepare_curves, pressure_curves


class LoadWatch:
    """Follows the load of a contact towards macro slip.

    The fits behind margin, friction and alert are made when one of these is first asked for after a
    frame, so a loop that reads the angle alone does not pay for them.
    """

    def __init__(self, settings: AlertSettings = AlertSettings()) -> None:
        """Begin without any frame.

        Args:
            settings: thresholds of the alerts.
        """
        pressure_curves()  # solved once, before the first frame
        self._margin, self._friction = MarginWatch(), FrictionWatch()
        self._alert = AlertWatch(settings)
        self._last: Estimate | None = None
        self._slip_probability = np.nan

    def press(
        self, wrench: tuple[float, ...], contact: Float[np.ndarray, "n 2"], edge: Edge | None
    ) -> None:
        """Take the forces of the next frame, before its state is known; see `FrictionWatch`."""
        self._friction.update(wrench, contact, edge)

    @property
    def holds(self) -> bool:
        """Whether too little friction is in use for a slip."""
        return self._friction.holds

    @property
    def loads(self) -> Loads:
        """Moment and shear in the last frame."""
        return self._friction.loads

    def follow(self, estimate: Estimate, slip_probability: float, *, usable: bool) -> None:
        """Take the estimate of the next frame.

        Args:
            estimate: by the chosen method.
            slip_probability: probability that all of the contact has slipped recently [-]; NaN if
                unknown.
            usable: whether the frame was usable, so that the friction may be learnt from it.
        """
        state, angle = estimate.state, estimate.angle
        if usable and state == State.MACRO_SLIP:
            self._friction.learn()
        loads = estimate.moment, estimate.gel_moment
        face = Face(estimate.gel_thinness, estimate.flat_share, estimate.elongation)
        disc = StickDisc(estimate.disc_ratio, estimate.disc_error, estimate.disc_twist)
        sheared = Loads(estimate.centre_moment, estimate.shear_moment_x, estimate.shear_moment_y)
        self._margin.add(state, angle, *loads, estimate.restarts, face, disc, sheared)
        self._alert.add(estimate.time, state, angle, self._friction.used)
        self._last, self._slip_probability = estimate, slip_probability
        for name in ("margin", "friction", "alert"):
            self.__dict__.pop(name, None)

    @cached_property
    def margin(self) -> Margin:
        """Angle and moment that remain before macro slip."""
        last = self._last
        if last is None:
            return Margin()
        prepare_curves(Face(last.gel_thinness, last.flat_share))
        return self._margin.predict(last.state, last.angle, last.contact_markers)

    @cached_property
    def friction(self) -> Friction:
        """Friction in use and its coefficient."""
        _ = self.margin  # its fit gives the coefficient before the first slip
        return self._friction.estimate(self._margin.branch)

    @cached_property
    def alert(self) -> Alert:
        """Predicted time to macro slip, and the level of the alert to a gripper."""
        if self._last is None:
            return Alert()
        last, forces = self._last, (self.margin, self.friction)
        return self._alert.predict(last.state, last.reason, *forces, self._slip_probability)

    @property
    def branch(self) -> Branch | None:
        """The moment–angle curve of the last frame with a margin."""
        return self._margin.last
