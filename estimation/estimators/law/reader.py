"""The law of friction beside the sticking markers: which of them gives a frame's angle.

Two contacts are followed by the law (`estimation.estimators.law.contact`): one with the markers'
noise, which gives angles, and one with a coarse noise, which only shows a slide.
"""

from functools import cache, partial

import numpy as np
from jaxtyping import Complex

from estimation.estimators.keyframe import Counted
from estimation.estimators.law.contact import ContactLaw
from estimation.estimators.law.fit import LawFits
from estimation.estimators.law.rough import RoughLaw
from estimation.estimators.law.state import At, LawFit, Reading
from estimation.estimators.measurement import StickDisc
from estimation.estimators.strain import Press
from estimation.fields.contact import known_contact
from estimation.fields.edge import Edge
from estimation.fields.measure import Fields
from estimation.fields.plane import fit_turn, in_plane_of_edge
from estimation.fields.stencils import Stencils
from estimation.fields.torsion import TurningFace
from estimation.fields.turned import turned_edge
from estimation.frames.noise import Noise


class LawReader:
    """Reads frames by the law of friction, where few markers stick and it explains them.

    Attributes:
        slides: whether the law has shown the object to slide, which has not held since.
        leads: whether the law gives the angle for good.
        fits: makes the fits.
    """

    def __init__(self, stencils: Stencils, noise: Noise | None, many_markers: int) -> None:
        """Begin without contact; without the noise of the markers, no frame is read.

        Args:
            stencils: stencils of the layout.
            noise: noise of the markers.
            many_markers: number of sticking markers from which the angle is as good without the
                law.
        """
        self._stencils, self._many_markers = stencils, many_markers
        self._law = self._rough = None
        self.fits = LawFits()
        if noise is not None:
            self._law = ContactLaw(noise.in_plane, correlated=noise.correlated, fits=self.fits)
            self._rough = RoughLaw(noise.in_plane, self.fits)
        self.slides = self.leads = False
        self._edge: Edge | None = None  # of a contact that only the law shows
        # the last reading, and the markers' positions then [mm]
        self._last: tuple[Reading, Complex[np.ndarray, " n"]] | None = None

    @property
    def closed(self) -> bool:
        """Whether the last frame shows that fewer than three markers have never slipped."""
        return self._law is not None and self._law.closed

    @property
    def turned(self) -> bool:
        """Whether the object has turned back, by the law."""
        return self._law is not None and self._law.turned

    @property
    def disc(self) -> StickDisc:
        """The disc that sticks, at the largest turn; unknown where the law explains nothing."""
        fit = None if self._law is None else self._law.fit
        return StickDisc() if fit is None else measure_disc(fit)

    def restart(self) -> None:
        """Begin with the next contact."""
        self.leads = self.slides = False
        self._edge = self._last = None
        for law in (self._law, self._rough):
            if law is not None:
                law.restart()

    def leave(self) -> None:
        """Do without the law, which needs the contact's whole history."""
        self.leads, self._last = False, None
        for law in (self._law, self._rough):
            if law is not None:
                law.reject()

    def bound(self, fields: Fields) -> Fields:
        """The fields, with an unknown contact within the edge, as long as the law shows it."""
        if fields.bounded or self._edge is None or self._law is None or not self._law.follows:
            return fields
        within = fields.contact & (self._edge.distance <= 1.0)
        if not within.any():
            return fields
        region = known_contact(self._stencils, fields.displacement, within, exact=False)
        return fields._replace(contact=region.markers, centre=region.centre, edge=self._edge)

    def read(
        self,
        fields: Fields,
        counted: Counted,
        restarts: int,
        press: Press,
    ) -> tuple[Reading | None, Counted]:
        """The reading of the next frame if the law gives its angle, and the count by the markers.

        As long as many markers stick, the angle is as good without the law. Noise may hide that
        most of them slip, and decides which of them count, so that the interval covers the law's
        angle too. The count is no answer once the law shows that fewer than three markers stick.
        Where the law stops explaining the contact, it does not lead any more.

        Args:
            fields: fields of the frame.
            counted: the angle by the sticking markers, and their fit; None without any.
            restarts: number of restarts of the count, after which the law does not apply.
            press: strain that pressing has left in the gel that sticks.
        """
        self.slides = self.slides and not fields.grips
        if self._law is None or self._rough is None or restarts or fields.lifted:
            return None, counted
        angle, stick = (np.nan, None) if counted is None else (counted[0].angle, counted[1].stick)
        few = stick is None or bool(stick.sum() < self._many_markers)
        motion = cache(partial(in_plane_of_edge, self._stencils, fields))
        reading, edge = None, fields.edge
        if edge is None and not fields.bounded:
            turned = turned_edge(self._stencils, fields.displacement, fields.rotation)
            if turned is not None:
                edge, angle = turned
                stick = None if stick is None else stick & (edge.distance <= 1.0)
        if self._law.observe(edge):
            reading = self._law.update(*motion(), angle, stick, many=not few, press=press)
            self.slides = self.slides or self._law.closed
            if reading is not None and self._jumps(reading, motion()[1], self._law.noise):
                self.leave()
                reading = None
            if not fields.bounded and self._law.fit is not None:
                self._edge = fitted_edge(self._law.fit)
        if few and not (self._law.follows or self._law.closed):
            slides = self._rough.slides(edge, motion, angle, stick)
            self.slides = self.slides if slides is None else slides
        self.leads = self.leads and (reading is not None or self._law.follows)
        if counted is None or few or self.leads or self._law.closed:
            self.leads = self.leads or reading is not None
            return reading, None if self._law.closed else counted
        now, fit = counted
        if reading is None:
            return None, counted
        return None, (now.doubt(reading.angle - now.angle), fit)

    def _jumps(self, reading: Reading, places: Complex[np.ndarray, " n"], noise: float) -> bool:
        """Whether the angle has changed otherwise than its sticking markers have turned."""
        certain = 4.0  # standard errors
        last, self._last = self._last, (reading, places)
        if last is None:
            return False
        both = last[0].stick & reading.stick
        turned, error = fit_turn(last[1][both], places[both], np.sqrt(2.0) * noise)
        apart = reading.angle - last[0].angle - turned
        return bool(abs(apart) > certain * np.hypot(error, reading.step_error))


def fitted_edge(fit: LawFit) -> Edge:
    """The edge of the contact in a fitted frame."""
    contact = fit.parameters
    return Edge(
        radius=float(np.exp(contact[At.radius])),
        error=float(np.sqrt(fit.covariance[1 + At.radius, 1 + At.radius])),
        misfit=np.nan,
        thinness=np.nan,
        flat=np.nan,
        distance=fit.places,
        parameters=np.r_[contact[: At.scale], 0.0, contact[At.corners]],
    )


def measure_disc(fit: LawFit) -> StickDisc:
    """The disc that sticks in a fitted frame, at the object's largest turn.

    Its error is that of the fit, and what the law leaves out, which is more where the contact is
    not round. The fewer markers stick, the more of it comes from the angle's error.
    """
    doubt, coarse, shaped = 1.4, 0.5, 1.0
    contact, both = fit.parameters, fit.covariance
    last = float(contact[At.turn])
    row, turned = (0, fit.angle) if abs(fit.angle) >= abs(last) else (1 + At.turn, last)
    face = TurningFace(contact[At.thinness], contact[At.flat])
    ratio, slopes = face.find_disc(abs(turned) / float(np.exp(contact[At.scale])))
    rows = [row, 1 + At.scale, 1 + At.thinness, 1 + At.flat]
    # the twist counts over its scale
    slopes = np.r_[-slopes[0] / (turned or np.inf), slopes]
    variance = max(float(slopes @ both[np.ix_(rows, rows)] @ slopes), 0.0) * max(fit.misfit, 1.0)
    shape = float(np.hypot(*contact[At.outline]) + np.hypot(*contact[At.corners]))
    known = doubt * np.sqrt(variance), coarse / max(int((fit.places < 1.0).sum()), 1)
    error = float(np.linalg.norm([*known, shaped * shape]))
    return StickDisc(ratio, error, abs(turned))
