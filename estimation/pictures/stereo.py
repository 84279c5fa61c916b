"""Recordings in three dimensions, from pictures that mirrors split into two views."""

import numpy as np
from jaxtyping import Float, Int, Shaped

from estimation.fields.contact import CONTACT_SHARE
from estimation.frames.recording import ONSET_MM
from estimation.pictures.corners.placing import SMALLEST_PIECE
from estimation.pictures.corners.reader import lay_out
from estimation.pictures.corners.tracking import CornerTracker, Seen
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.region import find_tear_flaw, find_unseen_flaw
from estimation.pictures.rig import Rig, triangulate
from estimation.pictures.still import find_exposure_flaw
from estimation.pictures.stream import Picture

MOST_MISFITTING_SHARE = 0.3
"""Share of misfitting markers from which the whole frame is rejected."""


class StereoReader(MarkerReader):
    """Turns split pictures of a checkerboard into positions in space."""

    scale, unit = 1.0, "mm"

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Detect the corners in a picture of the unloaded pad, and make the reference.

        Raises:
            ValueError: a view shows no checkerboard, the views cannot be matched, or they do not
                fit the calibration.
        """
        # misfit of a marker's two views, beyond the calibration's error, that is tolerated [px]
        slack = 0.25
        advice = (
            "are the views swapped, is one mirrored (`python -m calibration stereo --mirrored`), "
            "or is it another camera's calibration?"
        )
        # largest tilt of the pad at rest against a view from straight behind
        tilted = np.radians(5.0)
        assert first.image is not None
        assert settings.rig is not None
        self.rig = settings.rig
        self.limit = slack + 3.0 * self.rig.error
        views = self.rig.split(first.image)
        left = CornerTracker.learn(views[0], unloaded=True)

        def misfit(markers: Int[np.ndarray, " k"], points: Float[np.ndarray, "k 2"]) -> float:
            return _median_misfit(self.rig, left.rest.position[markers], points)

        try:
            right = left.from_aside(views[1], misfit)
        except ValueError as error:
            raise ValueError(f"{error}; {advice}") from error
        rest = triangulate(self.rig, left.rest.position, right.rest.position)
        fitting = rest.misfit < self.limit
        seen = np.isfinite(rest.misfit).sum()
        if fitting.sum() < max((1.0 - MOST_MISFITTING_SHARE) * seen, SMALLEST_PIECE):
            swapped = _median_misfit(self.rig, right.rest.position, left.rest.position)
            cause = "the views are swapped" if swapped < self.limit else advice
            raise ValueError(
                f"the two views fit the calibration to {np.nanmedian(rest.misfit):.2f} px; at most "
                f"{self.limit:.2f} px are allowed: {cause}"
            )
        self.tilt = _tilt(rest.points[fitting])
        if self.rig.left.orthographic and self.tilt > tilted:
            raise ValueError(
                f"the pad at rest is tilted by {np.degrees(self.tilt):.1f}° against the left view, "
                "which sees it from straight behind: is it another camera's calibration?"
            )
        self.left, self.right = left.take(fitting), right.take(fitting)
        self.misfit = float(np.median(rest.misfit[fitting]))
        self.layout = lay_out(self.left, rest.points[fitting])
        unloaded = settings.unloaded is not None
        self.reference = "the frame that was given" if unloaded else "the first usable frame"

    def read(self, picture: Picture) -> Row:
        """Measure positions in space in the next picture; the contact follows from them."""
        shape = self.layout.reference.shape
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, shape, picture.flaw or "no picture")
        views = self.rig.split(picture.image)
        left, right = self.left.find(views[0]), self.right.find(views[1])
        if flaw := _either_flaw(left, right):
            return Row.of_none(picture, shape, flaw)
        located = triangulate(self.rig, left.position, right.position)
        bad = located.misfit > self.limit
        count = np.isfinite(located.misfit).sum()
        if bad.sum() > MOST_MISFITTING_SHARE * count or count < SMALLEST_PIECE:
            flaw = (
                f"{bad.sum()} of {count} corners seen in both views do not fit the calibration: "
                "is it another camera's?"
            )
            return Row.of_none(picture, shape, flaw)
        points = np.where(bad[:, None], np.nan, located.points)
        return Row(
            position=points,
            contact=None,
            time=picture.time,
            number=picture.number,
            flaw=self._contact_flaw(points),
        )

    def _contact_flaw(self, points: Float[np.ndarray, "m 3"]) -> str:
        """Why the contact cannot be judged: the pattern is torn, or the centre is not visible."""
        rest = self.layout.reference
        flaw = find_tear_flaw(self.left.neighbours, rest[:, :2], points[:, :2])
        depth = np.nan_to_num(rest[:, 2] - points[:, 2])
        pressed = (depth >= CONTACT_SHARE * depth.max()) & (depth >= ONSET_MM)
        seen = np.isfinite(points[:, 0])
        return flaw or find_unseen_flaw(self.left.rest.position, pressed, seen)

    def notes(self) -> tuple[str, ...]:
        """Remarks on the pattern, the reference and the fit of the views."""
        return (
            self.left.describe(),
            f"The reference is {self.reference}; it must be unloaded.",
            f"The two views fit the calibration to {self.misfit:.3f} px (median); its own error is "
            f"{self.rig.error:.3f} px. The pad at rest is tilted by {np.degrees(self.tilt):.1f}° "
            "against the left view; more than a few degrees indicate another camera's calibration.",
            "Rotation is measured from the lines to the neighbours, in space. The edges' own "
            "angles, four times as uncertain, are used only with a single view.",
        )


def find_view_flaw(rig: Rig, picture: Shaped[np.ndarray, "h w *colour"]) -> str:
    """Why a view shows nothing: it is black or saturated; empty if neither view is.

    Raises:
        ValueError: the picture's size differs from the calibration's.
    """
    for name, view in zip(("left", "right"), rig.split(picture), strict=True):
        if flaw := find_exposure_flaw(view):
            return flaw.replace("the picture", f"the {name} view")
    return ""


def _tilt(points: Float[np.ndarray, "n 3"]) -> float:
    """Tilt of the plane through points against the sensor's plane [rad]."""
    design = np.column_stack([points[:, :2], np.ones(len(points))])
    slope = np.linalg.lstsq(design, points[:, 2], rcond=None)[0][:2]
    return float(np.arctan(np.hypot(*slope)))


def _either_flaw(left: Seen, right: Seen) -> str:
    views = {"left": left, "right": right}
    return "; ".join(f"{name} view: {seen.flaw}" for name, seen in views.items() if seen.flaw)


def _median_misfit(
    rig: Rig, left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"]
) -> float:
    misfit = triangulate(rig, left, right).misfit
    return float(np.nanmedian(misfit)) if np.isfinite(misfit).any() else np.inf
