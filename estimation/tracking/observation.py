"""What one frame shows, found once for every estimator and for the contact's outline."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from estimation.choices import DEFAULT_CONTACT, ContactSettings
from estimation.fields.contact import reaches_edge
from estimation.fields.measure import Fields, measure_fields
from estimation.fields.stencils import make_stencils
from estimation.fields.stick import MIN_STICK_MARKERS
from estimation.frames.recording import Frame, MarkerLayout
from estimation.softness import RIGID_OBJECT, Softness
from estimation.softness.lifting import displacement_as_seen


class Observation(NamedTuple):
    """What one frame shows.

    Attributes:
        frame: the frame, as the softness wants to see it.
        fields: measured on it; None where the frame cannot be used.
        flaw: why it cannot be used; empty where it can.
        cut: whether the contact reaches the edge of the view.
        as_seen: displacement of the markers in the plane, before a softness has lifted it [mm];
            None where none has.
    """

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
        contact: ContactSettings = DEFAULT_CONTACT,
    ) -> None:
        """Make an observer.

        Args:
            layout: the markers of the sensor.
            softness: what the object's softness adds to what the markers show.
            contact: how the contact is told.

        Raises:
            ValueError: too few markers.
        """
        if not isinstance(layout, MarkerLayout):
            raise ValueError(
                f"a layout is expected, got {type(layout).__name__}: make one of the unloaded "
                "positions, `layout_markers(reference)`"
            )
        if len(layout.reference) < MIN_STICK_MARKERS:
            raise ValueError(
                f"{len(layout.reference)} markers; at least {MIN_STICK_MARKERS} are needed"
            )
        self.stencils = make_stencils(layout)
        self.contact = contact
        self._lifting = softness.lifting(self.stencils.reference[:, :2])
        self._layout = layout
        self._time = -np.inf

    def observe(self, frame: Frame) -> Observation:
        """Inspect the next frame and measure its fields.

        Raises:
            ValueError: the frame is not of this layout.
        """
        # markers of a contact that is cut by the edge of the view below which too little of it is
        # seen
        least_in_view = 12
        if not isinstance(frame, Frame):
            raise ValueError(
                f"a frame is expected, got {type(frame).__name__}: make one with `Frame`, or give "
                "the positions to `Tracker.update_positions`"
            )
        if frame.positions.shape[0] != len(self.stencils.reference):
            raise ValueError(
                f"the frame has {frame.positions.shape[0]} markers, the layout "
                f"{len(self.stencils.reference)}"
            )
        if flaw := frame.flaw or self._find_flaw(frame):
            return Observation(frame, None, flaw)
        told = frame.contact
        cut = told is not None and reaches_edge(self.stencils.neighbours, told)
        if told is not None and cut and told.sum() < least_in_view:
            return Observation(frame, None, "too little of the contact is in view", cut)
        if frame.valid.sum() < MIN_STICK_MARKERS:
            return Observation(frame, None, f"{frame.valid.sum()} usable markers")
        frame, as_seen = self._lift(frame)
        fields = measure_fields(
            self.stencils, frame, onset_mm=self.contact.onset_mm, share=self.contact.contact_share
        )
        return Observation(frame, fields, "", cut, as_seen)

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

    def _lift(self, frame: Frame) -> tuple[Frame, Float[np.ndarray, "n 2"] | None]:
        """The frame that the softness wants to see, and the displacement that the markers show."""
        if self._lifting is None:
            return frame, None
        moved = displacement_as_seen(self._layout, frame.positions, frame.valid)
        positions = frame.positions.copy()
        positions[:, :2] += self._lifting.of(moved)
        rotation = frame.rotation
        if rotation is not None:
            rotation = rotation + self._lifting.rotation @ np.nan_to_num(rotation)
        return replace(frame, positions=positions, rotation=rotation), moved
