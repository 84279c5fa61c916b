"""Inspection of a frame and measurement of its fields, done once for all estimators."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.choices import ContactSettings
from estimation.fields.contact import Region, reaches_edge
from estimation.fields.face import coarse_faces
from estimation.fields.measure import Fields, measure_fields
from estimation.fields.stencils import make_stencils, marker_pitch
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.inspection import Fault, find_repeats
from estimation.frames.recording import Frame, MarkerLayout
from estimation.softness import RIGID_OBJECT, Softness
from estimation.softness.lifting import displacement_as_seen
from estimation.tracking.gaps import GapFiller


class Observation(NamedTuple):
    """A frame and the fields measured on it.

    Attributes:
        seen: the frame without outliers, with short gaps filled.
        frame: the same with marker positions lifted to the surface if the softness requires it.
        fields: fields of the frame; None if the frame cannot be used.
        flaw: reason why the frame cannot be used; empty if it can.
        cut: whether the contact reaches the edge of the view.
        as_seen: in-plane displacement of the markers before lifting [mm]; None without lifting.
    """

    seen: Frame
    frame: Frame
    fields: Fields | None
    flaw: str = ""
    cut: bool = False
    as_seen: Float[np.ndarray, "n 2"] | None = None


class Observer:
    """Inspects each frame and measures its fields."""

    def __init__(
        self,
        layout: MarkerLayout,
        softness: Softness = RIGID_OBJECT,
        contact: ContactSettings = ContactSettings(),
        *,
        noisy: bool = False,
    ) -> None:
        """Make an observer; the softness may lift marker positions to the surface.

        A frame that repeats the last one (`find_repeats`) is not used if the markers are in space
        and known to be noisy.

        Raises:
            ValueError: too few markers.
        """
        if not isinstance(layout, MarkerLayout):
            raise ValueError(
                f"a layout is expected, got {type(layout).__name__}: make one from the unloaded "
                "positions, `layout_markers(reference)`"
            )
        if len(layout.reference) < MIN_STICK_MARKERS:
            raise ValueError(
                f"{len(layout.reference)} markers in the layout; at least {MIN_STICK_MARKERS} are "
                "needed"
            )
        self.stencils = make_stencils(layout)
        self.contact = contact
        self._lifting = softness.lifting(self.stencils.reference[:, :2])
        self._layout = layout
        self._pitch = marker_pitch(layout)
        self._gaps, self._noisy = GapFiller(layout), noisy
        self._time, self._last = -np.inf, np.full_like(layout.reference, np.nan)
        self._region: Region | None = None
        if contact.contact_share is None and not self.stencils.flat:
            coarse_faces()  # tabulated now, which takes a fifth of a second, not at the first touch

    def observe(self, frame: Frame) -> Observation:
        """Inspect the next frame and measure its fields.

        Raises:
            ValueError: `frame` is not a frame of this layout.
        """
        least_in_view = 12  # markers of a contact that the edge of the view cuts
        if not isinstance(frame, Frame):
            raise ValueError(
                f"a frame is expected, got {type(frame).__name__}: make one with `Frame`, or pass "
                "the positions to `Tracker.update_positions`"
            )
        if frame.positions.shape[0] != len(self.stencils.reference):
            raise ValueError(
                f"the frame has {frame.positions.shape[0]} markers, the layout "
                f"{len(self.stencils.reference)}: keep a row for each, of NaN if it is not seen"
            )
        found, expected = frame.positions.shape[1], self._layout.reference.shape[1]
        if found != expected:
            raise ValueError(
                f"the frame's positions have {found} columns, the layout's {expected}: give both "
                "with z, or both without"
            )
        if flaw := frame.flaw or self._find_flaw(frame):
            return Observation(frame, frame, None, flaw)
        contact = frame.contact
        cut = contact is not None and reaches_edge(self.stencils.neighbours, contact)
        if contact is not None and cut and contact.sum() < least_in_view:
            return Observation(frame, frame, None, "too little of the contact is in view", cut)
        if frame.valid.sum() < MIN_STICK_MARKERS:
            return Observation(frame, frame, None, f"{frame.valid.sum()} usable markers")
        seen = self._gaps.fill(frame)
        frame, as_seen = self._lift(seen)
        fields = measure_fields(
            self.stencils,
            frame,
            onset_mm=self.contact.onset_mm,
            share=self.contact.contact_share,
            last=self._region,
        )
        self._region = fields.region
        fields = fields._replace(lifted=as_seen is not None)
        return Observation(seen, frame, fields, "", cut, as_seen)

    def explain_no_contact(self, fields: Fields) -> str:
        """Why no marker counts as touched, with a guess at wrong units or a wrong direction."""
        onset = self.contact.onset_mm
        text = f"no contact: moved by less than {onset:g} mm"
        if self._pitch < onset:
            return f"{text}, which is further than the markers are apart: are the lengths in mm?"
        moved = np.linalg.norm(np.nan_to_num(fields.displacement), axis=1)
        deepest = np.nan_to_num(fields.indentation).max(initial=0.0)
        if not self.stencils.flat and moved.max() > onset > deepest:
            return (
                f"no contact: some markers have moved by more than {onset:g} mm, but none is "
                "pressed in by that: does z point out of the pad? Turn it round together with y, "
                "since z alone would mirror the axes and the angles"
            )
        return text

    def _find_flaw(self, frame: Frame) -> str:
        """A fault of the frame or of its time stamp; empty if there is none."""
        latest = self._time
        if not np.isfinite(frame.time):
            return Fault.NO_TIME
        self._time = frame.time
        if frame.time <= latest:
            return "time stamp not after the last frame's"
        if not frame.positions.any():
            return Fault.ZERO
        last, self._last = self._last, frame.positions
        noisy = self._noisy and not self.stencils.flat
        if noisy and find_repeats(frame.positions, last, self._layout.reference):
            return Fault.REPEATS
        return self._find_disorder(frame)

    def _find_disorder(self, frame: Frame) -> str:
        """Why the positions cannot be those of the layout's markers; empty if they can.

        Neighbours on one gel never move apart by more than their distance; markers whose order
        changes do.
        """
        most = 0.5  # share of the neighbours that may seem to: some markers may be misread
        rest, around = self.stencils.reference[:, :2], self.stencils.neighbours
        moved = np.where(frame.valid[:, None], frame.positions[:, :2] - rest, np.nan)
        step = np.linalg.norm(moved[around] - moved[:, None], axis=2)
        far = step > np.linalg.norm(rest[around] - rest[:, None], axis=2)
        known = (around >= 0) & np.isfinite(step)
        if far[known].sum() <= most * known.sum():
            return ""
        return (
            "the markers have changed places: each must keep its row in the array, in the unit of "
            "the layout"
        )

    def _lift(self, frame: Frame) -> tuple[Frame, Float[np.ndarray, "n 2"] | None]:
        """The frame with lifted positions, and the markers' displacement before lifting [mm]."""
        if self._lifting is None:
            return frame, None
        moved = displacement_as_seen(self._layout, frame.positions, frame.valid)
        positions = frame.positions.copy()
        positions[:, :2] += self._lifting.of(moved)
        rotation = frame.rotation
        if rotation is not None:
            rotation = rotation + self._lifting.rotation @ np.nan_to_num(rotation)
        return replace(frame, positions=positions, rotation=rotation), moved
