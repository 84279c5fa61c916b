"""A contact that turns and slips by the law of friction, followed frame by frame.

Markers that stick give the object's angle directly. Those that slip lag behind it by the law
(`estimation.estimators.law_fit`), so that all markers of a contact determine its angle together.
What the law leaves open, such as friction over modulus, the pressure and the outline, is fitted in
each frame and carried along. A frame that it does not explain is not answered.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex

from estimation.estimators.law_fit import At, Belief, LawFit, LawModel, fit_law
from estimation.fields.edge import Edge
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.fields.torsion import clip_turning, prepare_face


@dataclass(frozen=True)
class LawSettings:
    """How a contact is followed.

    Attributes:
        start_deg: rotation from which the law is fitted [°].
        edges: number of last edges whose median is the first guess at the contact [-].
        worst_misfit: mean square of the residuals over their variance, above which the law does not
            explain a frame [-].
        patience: unexplained frames after which the contact is fitted anew, and between two tries
            [frames].
        doubt: standard errors of the angle per standard error of the fit [-].
        discrepancy: standard error of the angle by what the law leaves out, over the angle times
            a/c − 1, a and c the radii of the contact and of the disc that sticks [-].
        closed: radius of the disc that sticks over the third marker's distance from the centre,
            below which the angle is lost [-].
        most_corners: share of the radius by which corners stand out of the fitted outline, from
            which the law is not used: a square face closes in another way [-].
        turn_deg: smallest turn back that ends the first turn [°].
        spread: standard deviations of a contact's parameters about the fitted edge.
        drift: standard deviations of their changes from frame to frame.
        model: how far the contact may deviate from the law.
    """

    start_deg: float = 1.7
    edges: int = 4
    worst_misfit: float = 1.6
    patience: int = 4
    doubt: float = 1.4
    discrepancy: float = 0.001
    closed: float = 0.85
    most_corners: float = 0.05
    turn_deg: float = 0.3
    spread: tuple[float, ...] = (0.1, 0.1, 0.05, 0.05, 0.05, 0.1, 0.15, 30.0, 0.03, 0.03, 0.01)
    drift: tuple[float, ...] = (
        *(0.01, 0.01, 0.003, 0.005, 0.005, 0.01, 0.02, 0.03, 0.003, 0.003, 0.0),
    )
    model: LawModel = field(default_factory=LawModel)


class Reading(NamedTuple):
    """What the law tells of a frame that it explains.

    Attributes:
        angle: rotation of the object since the unloaded shape [rad].
        error: its standard error [rad].
        step_error: standard error of the angle against the last turn [rad].
        stick: markers inside the disc that sticks.
    """

    angle: float
    error: float
    step_error: float
    stick: Bool[np.ndarray, " n"]


class ContactLaw:
    """Follows a contact from its first turn to its second."""

    def __init__(self, noise: float, settings: LawSettings = LawSettings()) -> None:
        """Begin without contact.

        Args:
            noise: noise of the markers per coordinate [mm].
            settings: how the contact is followed.
        """
        self.noise, self.settings = noise, settings
        self.restart()

    def restart(self) -> None:
        """Begin with the next contact."""
        self._edges: deque[np.ndarray] = deque(maxlen=self.settings.edges)
        self._belief: Belief | None = None
        self._last = self._step = self._largest = 0.0
        self._missed = self._wait = 0
        self.turned = self._over = False
        self._furthest = 0.0  # back from the turn
        self._discrepancy = 0.0
        self.closed = False

    @property
    def follows(self) -> bool:
        """Whether the law explains the contact, or has explained it up to the turn back."""
        return self.turned or self._belief is not None

    def reject(self) -> None:
        """Do not follow this contact any more."""
        self._over = True

    def observe(self, edge: Edge | None) -> bool:
        """Take the contact's edge in the next frame, and tell whether to call `update` for it."""
        self.closed = False
        if edge is not None:
            self._edges.append(edge.parameters)
        return not self._over and len(self._edges) == self.settings.edges

    def update(
        self, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"], angle: float
    ) -> Reading | None:
        """The reading of the frame just observed; None if the law does not explain it.

        Args:
            before: unloaded positions in the contact's plane [mm].
            after: positions now [mm].
            angle: rotation by the sticking markers [rad]; NaN if unknown.
        """
        fit = self._fit(before, after, angle)
        if fit is None:
            return None
        self._missed = 0
        self._learn(fit)
        return self._read(fit)

    def _fit(
        self, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"], angle: float
    ) -> LawFit | None:
        """The fit of a frame; None if the law does not explain it."""
        settings = self.settings
        if self._belief is None:
            return self._begin(before, after, angle)
        guess = self._last + self._step, self._belief.mean
        fit = fit_law(before, after, self.noise, guess, self._belief, 6, settings.model)
        if fit is not None and fit.misfit <= settings.worst_misfit:
            return fit
        self._missed += 1
        self._step = 0.0
        if self._missed > settings.patience:
            self._over, self._belief = self.turned, None
            self._wait = settings.patience
        return None

    def _begin(
        self, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"], angle: float
    ) -> LawFit | None:
        """The first fit, from the edge and several scales of the twist."""
        self._wait -= 1
        prepare_face(*self._edges[-1][At.thinness : At.flat + 1])
        self._largest = float(np.nanmax([self._largest, abs(angle)]))
        back = not abs(angle) > self._largest - np.radians(self.settings.turn_deg)
        if self._wait > 0 or back or abs(angle) < np.radians(self.settings.start_deg):
            return None
        edge = np.median(np.array(self._edges), axis=0)
        mean = np.append(edge, 0.0)
        mean[At.thinness], mean[At.flat] = clip_turning(*edge[5:7])
        belief, best = Belief(mean, np.diag(np.square(self.settings.spread)), 0.0), None
        for scale in np.log(np.geomspace(0.03, 1.0, 8)):
            mean[At.scale] = scale
            fit = fit_law(before, after, self.noise, (angle, mean), belief, 2, self.settings.model)
            if fit is not None and (best is None or fit.cost < best.cost):
                best = fit
        if best is None:
            return None
        guess = best.angle, best.parameters
        fit = fit_law(before, after, self.noise, guess, belief, 12, self.settings.model)
        if fit is None or fit.misfit > self.settings.worst_misfit:
            self._wait = self.settings.patience
            return None
        self._belief = belief._replace(way=float(np.sign(angle)))
        self._last = fit.angle
        return fit

    def _learn(self, fit: LawFit) -> None:
        """Carry the contact on to the next frame."""
        assert self._belief is not None
        before, way = self._belief, self._belief.way
        mean = fit.parameters.copy()
        covariance = fit.covariance[1:, 1:] + np.diag(np.square(self.settings.drift))
        variance = fit.covariance[0, 0]
        self._step = float(np.clip(fit.angle - self._last, -0.03, 0.03))
        self._last = fit.angle
        if self.turned:
            covariance[At.turn, At.turn] = before.covariance[At.turn, At.turn]
        elif (fit.angle - mean[At.turn]) * way >= 0.0:
            covariance[At.turn] = covariance[:, At.turn] = 0.0
            mean[At.turn], covariance[At.turn, At.turn] = fit.angle, variance
        self._belief = Belief(mean, covariance, way)

    def _read(self, fit: LawFit) -> Reading | None:
        belief = self._belief
        assert belief is not None
        settings, doubt = self.settings, self.settings.doubt * np.sqrt(max(fit.misfit, 1.0))
        variance, shared = fit.covariance[0, 0], fit.covariance[0, 1 + At.turn]
        step = np.sqrt(max(variance + fit.covariance[1 + At.turn, 1 + At.turn] - 2.0 * shared, 0.0))
        back = (fit.parameters[At.turn] - fit.angle) * belief.way
        margin = max(np.radians(settings.turn_deg), 4.0 * step)
        if back > margin:
            self.turned = True
        if self.turned:
            self._furthest = max(self._furthest, back)
            self._over = back < self._furthest - margin
        if not 0.0 < back < 2.0 * abs(fit.parameters[At.turn]):
            self._discrepancy = (
                settings.discrepancy * abs(fit.angle) * (1.0 / fit.stick_ratio - 1.0)
            )
        third = np.sort(fit.places)[MIN_STICK_MARKERS - 1]
        self.closed = fit.stick_ratio < settings.closed * third
        self._over = self._over or self.closed
        if np.hypot(*fit.parameters[At.corners]) > settings.most_corners:
            self._over, self._belief = True, None
        if self._over:
            return None
        return Reading(
            angle=fit.angle,
            error=float(np.hypot(doubt * np.sqrt(variance), self._discrepancy)),
            step_error=float(step),
            stick=fit.places < fit.stick_ratio,
        )
