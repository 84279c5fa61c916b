"""A contact that turns and slips by the law of friction, followed frame by frame.

Markers that stick give the object's angle directly. Those that slip lag behind it by the law
(`estimation.estimators.law.fit`), so that all markers of a contact determine its angle together.
What the law leaves open, such as friction over modulus, the pressure and the outline, is fitted in
each frame and carried along. A frame that it does not explain is not answered.
"""

from collections import deque
from itertools import product

import numpy as np
from jaxtyping import Bool, Complex

from estimation.estimators.law.fit import LawFits
from estimation.estimators.law.settings import LawSettings
from estimation.estimators.law.state import At, Belief, LawFit, Reading
from estimation.estimators.law.turn_back import Angle, TurnBack, correct_law
from estimation.estimators.measurement import Z95
from estimation.estimators.strain import Press
from estimation.fields.edge import Edge
from estimation.fields.plane import fit_turn, has_turned, surround
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.fields.torsion import clip_turning


class ContactLaw:
    """Follows a contact from its first turn to its second."""

    def __init__(
        self,
        noise: float,
        settings: LawSettings = LawSettings(),
        correlated: float = 3.0,
        fits: LawFits | None = None,
    ) -> None:
        """Begin without contact.

        Args:
            noise: noise of the markers per coordinate [mm].
            settings: how the contact is followed.
            correlated: frames over which this noise is correlated (`Noise.correlated`).
            fits: makes the fits; own ones by default.
        """
        self.noise, self.settings, self._correlated = noise, settings, correlated
        self._fits = LawFits() if fits is None else fits
        self.restart()

    def restart(self) -> None:
        """Begin with the next contact."""
        self._edges: deque[Edge] = deque(maxlen=self.settings.edges)
        self._belief: Belief | None = None
        self._last = self._step = self._largest = 0.0
        self._seen = np.nan  # rotation by the sticking markers in the last frame
        self._missed = self._wait = 0
        self.turned = self._over = self.closed = False
        self.fit: LawFit | None = None  # of the last frame, if the law explains it
        self._furthest = 0.0  # back from the turn
        self._press = Press()
        self._since: TurnBack | None = None
        # the furthest angle of the first turn, its standard error, and the object since then
        self._peak: tuple[float, float, TurnBack | None] = 0.0, 0.0, None

    @property
    def follows(self) -> bool:
        """Whether the law explains the contact, or has explained it up to the turn back."""
        return self.turned or self._belief is not None

    def reject(self) -> None:
        """Do not follow this contact any more."""
        self._over = True

    def observe(self, edge: Edge | None) -> bool:
        """Take the contact's edge in the next frame, and tell whether to call `update` for it."""
        self.closed, self.fit = False, None
        if edge is not None:
            self._edges.append(edge)
        return not self._over and len(self._edges) == self.settings.edges

    def update(
        self,
        before: Complex[np.ndarray, " n"],
        after: Complex[np.ndarray, " n"],
        angle: float,
        stick: Bool[np.ndarray, " n"] | None = None,
        many: bool = False,
        press: Press = Press(),
    ) -> Reading | None:
        """The reading of the frame just observed; None if the law does not explain it.

        Args:
            before: unloaded positions in the contact's plane [mm].
            after: positions now [mm].
            angle: rotation by the sticking markers [rad]; NaN if unknown.
            stick: markers that seem to stick. In the first frame that is fitted, or after one that
                is not explained, a slide is believed only if outer ones lag behind inner ones.
            many: whether they are many. Then a slide must be found from the edge alone in any
                frame, since the fit may follow noise.
            press: strain of the gel by the press (`Rigid.press`).
        """
        self._press = press
        first = self._belief is None
        alone = first or self._missed > 0
        fit = self._fit(before, after, angle)
        slides = fit is not None and not self.turned and self._is_closed(fit)
        if slides and many and not first:
            self._belief, alone = None, True
            fit = self._begin(before, after, angle)
        if (
            fit is not None
            and stick is not None
            and alone
            and self._is_closed(fit)
            and not self._lags(fit, before, after, stick)
        ):
            self._belief, fit = None, None
        if fit is None:
            return None
        self._missed = 0
        self._learn(fit, after)
        return self._read(fit, before, after)

    def _fit(
        self, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"], angle: float
    ) -> LawFit | None:
        """The fit of a frame; None if the law does not explain it."""
        settings = self.settings
        if self._belief is None:
            return self._begin(before, after, angle)
        step = angle - self._seen if np.isfinite(angle - self._seen) else self._step
        self._seen = angle
        guess = self._last + float(np.clip(step, -0.03, 0.03)), self._belief.mean
        fit = self._try(before, after, guess, self._belief, 6)
        if fit is not None and fit.misfit <= settings.worst_misfit:
            return self._turn_on(fit, before, after)
        self._missed += 1
        self._step = 0.0
        if self._missed > settings.patience:
            self._over, self._belief = self.turned, None
            self._wait = settings.patience
        return None

    def _turn_on(
        self, fit: LawFit, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"]
    ) -> LawFit:
        """The fit of a frame in which the object may not have turned back.

        Gel comes to rest under an object that has stopped or turned back a little, and also under
        one that turns on while nearly all slips. A fit of the first kind knows the angle far
        better. Unless it is clearly the better fit, the one of the second kind counts.
        """
        belief = self._belief
        assert belief is not None
        back = (fit.parameters[At.turn] - fit.angle) * belief.way
        if self.turned or not 0.0 < back <= self._margin(fit.step_error):
            return fit
        guess = fit.angle, fit.parameters
        on = self._try(before, after, guess, belief._replace(way=0.0), 6)
        if on is None or on.cost > fit.cost + Z95**2:
            return fit
        furthest, error, since = self._peak
        slowly = (furthest - on.angle) * belief.way  # back, though hardly from frame to frame
        if slowly > self._margin(float(np.hypot(error, on.error))):
            mean, covariance = belief.mean.copy(), belief.covariance.copy()
            mean[At.turn], covariance[At.turn, At.turn] = furthest, error**2
            known = belief._replace(mean=mean, covariance=covariance)
            self._since = since
            return self._try(before, after, (on.angle, mean), known, 20) or fit
        parameters = on.parameters.copy()
        parameters[At.turn] = on.angle
        return on._replace(parameters=parameters)

    def _begin(
        self, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"], angle: float
    ) -> LawFit | None:
        """The first fit, from the edge and several scales of the twist."""
        self._wait -= 1
        last = self._edges[-1]
        self._largest = float(np.nanmax([self._largest, abs(angle)]))
        back = not abs(angle) > self._largest - np.radians(self.settings.turn_deg)
        if self._wait > 0 or back or abs(angle) < np.radians(self.settings.start_deg):
            return None
        edge = np.median([seen.parameters for seen in self._edges], axis=0)
        centre, radius = complex(*edge[At.centre]), float(np.exp(edge[At.radius]))
        if not surround(before, centre, radius):
            return None
        within = (np.abs(before - centre) < radius) & np.isfinite(after)
        if not has_turned(before[within], after[within], self.noise):
            return None  # the angle may be noise
        mean, spread = np.append(edge, 0.0), np.array(self.settings.spread)
        mean[At.thinness], mean[At.flat] = clip_turning(*edge[5:7])
        if np.isnan(last.thinness):  # the edge of a region
            spread, place = np.array(self.settings.outlined), slice(0, At.thinness)
            spread[place] = np.maximum(spread[place], last.error)
            spread[At.centre] *= radius
        belief = Belief(mean, np.diag(np.square(spread)), 0.0)
        fit = self._scan(before, after, angle, belief)
        if fit is None:
            self._wait = self.settings.patience
            return None
        self._belief = belief._replace(way=float(np.sign(angle)))
        self._last, self._seen = fit.angle, angle
        return fit

    def _scan(
        self,
        before: Complex[np.ndarray, " n"],
        after: Complex[np.ndarray, " n"],
        angle: float,
        belief: Belief,
    ) -> LawFit | None:
        """The best fit from several scales of the twist, for a contact that sticks or slides."""
        fits: dict[bool, LawFit] = {}
        for scale, ahead in product(np.log(np.geomspace(0.006, 0.6, 5)), (1.0, 2.0)):
            mean = belief.mean.copy()
            mean[At.scale] = scale
            fit = self._try(before, after, (ahead * angle, mean), belief, 4)
            if fit is not None:
                closed = self._is_closed(fit)
                if closed not in fits or fit.cost < fits[closed].cost:
                    fits[closed] = fit
        starts = [(fit.angle, fit.parameters) for fit in fits.values()]
        refined = [self._try(before, after, start, belief, 20) for start in starts]
        possible = [
            fit
            for fit in (*refined, *fits.values())
            if fit is not None
            and fit.misfit <= self.settings.first_misfit
            and fit.angle * angle >= 0.0
        ]
        return min(possible, key=self._cost, default=None)

    def _cost(self, fit: LawFit) -> float:
        """The cost of a first fit, with a prior against slip that the frame does not show."""
        return fit.cost + self.settings.clearly * (1.0 - fit.stick_ratio)

    def _try(
        self,
        before: Complex[np.ndarray, " n"],
        after: Complex[np.ndarray, " n"],
        guess: tuple[float, np.ndarray],
        belief: Belief,
        most: int,
    ) -> LawFit | None:
        known = belief._replace(stretch=self._press.stretch)
        return self._fits.fit(before, after, self.noise, guess, known, most, self.settings.model)

    def _margin(self, error: float) -> float:
        """The smallest turn back that is certain, by its standard error [rad]."""
        return max(float(np.radians(self.settings.turn_deg)), 4.0 * error)

    def _is_closed(self, fit: LawFit, further: float = 0.0, over: float | None = None) -> bool:
        """Whether fewer than three markers have never slipped, by the law.

        Args:
            fit: the fitted frame.
            further: rotation that is added to the furthest one [rad].
            over: radius of the disc over the third marker's distance, below which they are fewer
                [-]; None for `closed`.
        """
        third = np.sort(fit.places)[MIN_STICK_MARKERS - 1]
        ratio = fit.hold_further(further) if further else fit.held_ratio
        return bool(ratio < (over or self.settings.closed) * third)

    def _is_sheared(self, fit: LawFit) -> bool:
        """Whether the object shifts so much as it turns that other markers may slip last.

        They lie around the point about which it turns, at the shift over the angle from the centre.
        """
        disc = fit.held_ratio * float(np.exp(fit.parameters[At.radius]))
        return bool(fit.shift > self.settings.sheared * fit.furthest * disc)

    def _noise_of(self, fit: LawFit) -> float:
        """Standard error of the angle by noise [rad]."""
        return self.settings.doubt * float(np.sqrt(max(fit.misfit, 1.0) * fit.covariance[0, 0]))

    def _discrepancy_of(self, fit: LawFit) -> float:
        """Standard error of the angle by what the law leaves out [rad]."""
        shaped = self.settings.elongated * float(np.hypot(*fit.parameters[At.outline]))
        return (self.settings.discrepancy + shaped) * fit.furthest * (1.0 / fit.held_ratio - 1.0)

    def _ahead_of(self, fit: LawFit) -> float:
        """How far the object may be ahead of the angle under a flat face [rad]."""
        assert self._belief is not None
        flat = self.settings.flat * float(np.clip(fit.parameters[At.flat], 0.0, 1.0))
        return 0.5 * flat * fit.furthest * (fit.held_ratio**-2 - 1.0) * self._belief.way

    def _lags(
        self,
        fit: LawFit,
        before: Complex[np.ndarray, " n"],
        after: Complex[np.ndarray, " n"],
        stick: Bool[np.ndarray, " n"],
    ) -> bool:
        """Whether the outer half of some markers turns less than the inner half, strain apart.

        Args:
            fit: the fitted frame.
            before: unloaded positions [mm].
            after: positions now [mm].
            stick: the markers.
        """
        certain = 4.0  # standard errors; markers that slip lag by thirty and more
        turn, _ = fit_turn(before[stick], after[stick], self.noise)
        even = after - self._press.displace(before, np.exp(1j * turn))
        inner = stick & (fit.places <= np.median(fit.places[stick]))
        (ahead, one), (behind, other) = (
            fit_turn(before[half], even[half], self.noise) for half in (inner, stick & ~inner)
        )
        return bool((ahead - behind) * np.sign(fit.angle) > certain * np.hypot(one, other))

    def _learn(self, fit: LawFit, after: Complex[np.ndarray, " n"]) -> None:
        """Carry the contact on to the next frame."""
        assert self._belief is not None
        before, way, self.fit = self._belief, self._belief.way, fit
        mean = fit.parameters.copy()
        covariance = fit.covariance[1:, 1:] + np.diag(np.square(self.settings.drift))
        variance = fit.covariance[0, 0]
        self._step = fit.angle - self._last
        self._last = fit.angle
        if self.turned:
            covariance[At.turn, At.turn] = before.covariance[At.turn, At.turn]
        elif (fit.angle - mean[At.turn]) * way >= 0.0:
            covariance[At.turn] = covariance[:, At.turn] = 0.0
            mean[At.turn], covariance[At.turn, At.turn] = fit.angle, variance
            self._since = TurnBack(after, self._correlated, self.settings)
            if (fit.angle - self._peak[0]) * way > 0.0:
                self._peak = fit.angle, fit.error, self._since
        self._belief = Belief(mean, covariance, way)

    def _read(
        self, fit: LawFit, before: Complex[np.ndarray, " n"], after: Complex[np.ndarray, " n"]
    ) -> Reading | None:
        belief = self._belief
        assert belief is not None
        settings, margin = self.settings, self._margin(fit.step_error)
        back = (fit.parameters[At.turn] - fit.angle) * belief.way
        if back > margin:
            self.turned = True
        if self.turned:
            self._furthest = max(self._furthest, back)
            self._over = back < self._furthest - margin
        law, discrepancy = Angle(fit.angle, self._noise_of(fit)), self._discrepancy_of(fit)
        angle, share = law.widen(discrepancy), 1.0
        error = angle.error
        closing = not self.turned and self._is_closed(fit, -error, settings.closing)
        self.closed = closing or self._is_closed(fit)
        self._over = self._over or self.closed
        if self._over:
            return None
        inside = fit.places < (fit.stick_ratio if self.turned else fit.held_ratio)
        if self.turned and self._since is not None:
            reach = fit.places / fit.held_ratio, fit.places / fit.stick_ratio
            mean, disc = self._since.update(before, after, *reach, law, self.noise, fit.known)
            fitted = mean.error * fit.error / law.error
            angle, share = correct_law(mean, fitted, discrepancy, disc)
            angle = angle.widen(settings.rigid * fit.furthest)
        return Reading(
            *angle,
            fit.step_error,
            inside & np.isfinite(before + after),
            firm=not self._is_closed(fit, 3.0 * error),
            ahead=share * self._ahead_of(fit),
            near=not self.turned and self._is_closed(fit, over=settings.near),
            sheared=self._is_sheared(fit),
        )
