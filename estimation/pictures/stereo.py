"""Recordings in three dimensions from pictures that mirrors split into two views."""

import numpy as np
from jaxtyping import Float, Int, Shaped

from estimation.fields.contact import SHARE
from estimation.frames.recording import ONSET_MM
from estimation.pictures.corners.placing import SMALLEST
from estimation.pictures.corners.reader import lay_out
from estimation.pictures.corners.tracking import CornerTracker, Seen
from estimation.pictures.reader import ImageSettings, MarkerReader, Row
from estimation.pictures.region import find_tear_flaw, find_unseen_flaw
from estimation.pictures.rig import Rig, triangulate
from estimation.pictures.stream import Picture, find_exposure_flaw

TOO_MANY = 0.3
"""Share of the markers left out so from which the whole frame is."""


class StereoReader(MarkerReader):
    """Turns split pictures of a checkerboard, one after the other, into positions in space."""

    scale, unit = 1.0, "mm"

    def __init__(self, first: Picture, settings: ImageSettings) -> None:
        """Learn corners and reference from a picture, which must be of the unloaded pad.

        Raises:
            ValueError: there is no checkerboard in a view, the views cannot be matched, or they do
                not fit the calibration.
        """
        # misfit of a marker's two views beyond the calibration's, from which it is left out [px]
        slack = 0.25
        advice = (
            "are the views swapped, is one mirrored (`python -m calibration stereo --mirrored`), "
            "or is it another camera's calibration?"
        )
        # tilt of the pad at rest against a view from straight behind from which that is not its own
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
        kept = rest.misfit < self.limit
        seen = np.isfinite(rest.misfit).sum()
        if kept.sum() < max((1.0 - TOO_MANY) * seen, SMALLEST):
            swapped = _median_misfit(self.rig, right.rest.position, left.rest.position)
            cause = "the views are swapped" if swapped < self.limit else advice
            raise ValueError(
                f"the two views fit the calibration to {np.nanmedian(rest.misfit):.2f} px, where "
                f"{self.limit:.2f} px are allowed: {cause}"
            )
        self.tilt = _tilt(rest.points[kept])
        if self.rig.left.orthographic and self.tilt > tilted:
            raise ValueError(
                f"the pad at rest is tilted by {np.degrees(self.tilt):.1f}° against the left view, "
                "which sees it from straight behind: is it another camera's calibration?"
            )
        self.left, self.right = left.take(kept), right.take(kept)
        self.misfit = float(np.median(rest.misfit[kept]))
        self.layout = lay_out(self.left, rest.points[kept])
        given = settings.unloaded is not None
        self.reference = "the frame that was given" if given else "the first usable frame"

    def read(self, picture: Picture) -> Row:
        """Positions in space in the next picture; they tell the contact region."""
        shape = self.layout.reference.shape
        if picture.flaw or picture.image is None:
            return Row.of_none(picture, shape, picture.flaw or "no picture")
        views = self.rig.split(picture.image)
        left, right = self.left.find(views[0]), self.right.find(views[1])
        if flaw := _either_flaw(left, right):
            return Row.of_none(picture, shape, flaw)
        found = triangulate(self.rig, left.position, right.position)
        bad = found.misfit > self.limit
        both = np.isfinite(found.misfit).sum()
        if bad.sum() > TOO_MANY * both or both < SMALLEST:
            flaw = f"{bad.sum()} of {both} corners do not fit in the two views: wrong calibration?"
            return Row.of_none(picture, shape, flaw)
        points = np.where(bad[:, None], np.nan, found.points)
        return Row(
            position=points,
            contact=None,
            time=picture.time,
            number=picture.number,
            flaw=self._contact_flaw(points),
        )

    def _contact_flaw(self, points: Float[np.ndarray, "m 3"]) -> str:
        """Why the contact cannot be judged: a torn pattern, or a middle that is not seen."""
        rest = self.layout.reference
        flaw = find_tear_flaw(self.left.neighbours, rest[:, :2], points[:, :2])
        depth = np.nan_to_num(rest[:, 2] - points[:, 2])
        pressed = (depth >= SHARE * depth.max()) & (depth >= ONSET_MM)
        seen = np.isfinite(points[:, 0])
        return flaw or find_unseen_flaw(self.left.rest.position, pressed, seen)

    def notes(self) -> tuple[str, ...]:
        """What the pattern looks like, what the reference is, and how the views fit."""
        return (
            self.left.describe(),
            f"The reference is {self.reference}, which must be unloaded.",
            f"The two views fit the calibration to {self.misfit:.3f} px (median); its own error is "
            f"{self.rig.error:.3f} px. The pad at rest is tilted by {np.degrees(self.tilt):.1f}° "
            "against the left view: more than a few degrees indicate another camera's "
            "calibration.",
            "Rotation is that of the lines to the neighbours, in space; the edges' own angles, "
            "four times as uncertain, are used only where there is one view.",
        )


def find_view_flaw(rig: Rig, picture: Shaped[np.ndarray, "h w *colour"]) -> str:
    """Why one of the views shows nothing, empty where both show something.

    Raises:
        ValueError: the picture is not of the calibration's size.
    """
    for name, view in zip(("left", "right"), rig.split(picture), strict=True):
        if flaw := find_exposure_flaw(view):
            return flaw.replace("the picture", f"the {name} view")
    return ""


def _tilt(points: Float[np.ndarray, "n 3"]) -> float:
    """Of the plane through points against the sensor's own [rad]."""
    design = np.column_stack([points[:, :2], np.ones(len(points))])
    slope = np.linalg.lstsq(design, points[:, 2], rcond=None)[0][:2]
    return float(np.arctan(np.hypot(*slope)))


def _either_flaw(left: Seen, right: Seen) -> str:
    flaws = [
        f"{name} view: {one.flaw}" for name, one in (("left", left), ("right", right)) if one.flaw
    ]
    return "; ".join(flaws)


def _median_misfit(
    rig: Rig, left: Float[np.ndarray, "n 2"], right: Float[np.ndarray, "n 2"]
) -> float:
    misfit = triangulate(rig, left, right).misfit
    return float(np.nanmedian(misfit)) if np.isfinite(misfit).any() else np.inf
