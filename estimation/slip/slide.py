"""Slip of the object over the gel, from the positions of both.

The object's print gives the position of the object, and the markers give that of the gel. While the
object holds, both move together, however the gel is sheared. Their difference is the slip, in any
direction and over any length.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.fields.stencils import marker_pitch
from estimation.frames.recording import MarkerLayout

RECENT_FRAMES = 16
"""Frames over which recent slip is measured."""


class Recent(NamedTuple):
    """Slip of the object over each marker in the last frames, beyond what shear alone may cause.

    Attributes:
        lately: slip within a number of frames [pitches]; NaN where unknown.
        just: slip within a quarter of these frames [pitches]; NaN where unknown.
    """

    lately: Float[np.ndarray, " n"]
    just: Float[np.ndarray, " n"]


class _Paths(NamedTuple):
    """Where the markers and the object are in one frame."""

    gel: Float[np.ndarray, "n 2"]  # positions of the markers [mm]
    object_: Float[np.ndarray, "n 2"]  # first positions if they had moved with the object [mm]
    arm: Float[np.ndarray, " n"]  # distances of the markers from the print's middle [mm]
    turn_error: float  # standard error of the object's rotation [rad]
    time: float  # time stamp [s]


class Slide(NamedTuple):
    """Slip of the object over the gel.

    Attributes:
        slip: slip over the gel that has followed the object best [mm], or over that in the middle
            of the print if none clearly has; 0 while some of the contact sticks. NaN without
            contact or print, and if its error exceeds both a marker's pitch and the slip: a print
            that is uniform along a line does not show slip along it.
        slip_error: half-width of its 95 % interval [mm]; NaN without contact or print.
        slip_since: time stamp of the frame that the slip counts from [s]: the first frame with a
            print after the object touched, or after a long loss of the print.
        beyond: smallest ratio, over the markers, of the slip to the radius of its 95 % region [-].
            A print that is uniform along a line shows only slip across it.
        recent: slip over each marker within `RECENT_FRAMES` frames; None if it is unknown.
        slow: the same within up to 64 frames and 0.7 s; None with fewer than 32 frames.
    """

    slip: float = float("nan")
    slip_error: float = float("nan")
    slip_since: float = float("nan")
    beyond: float = float("nan")
    recent: Recent | None = None
    slow: Recent | None = None


class SlideWatch:
    """Follows the object's position on the gel from frame to frame.

    Slip varies over the contact: it is largest at the rim and smallest in the core, where it is 0
    while markers stick. The slip of the object is its slip over the marker that has clearly
    followed it best. The gel between the markers may have followed it better.
    """

    # share of the gel's shear by which a print is ahead of the gel that holds it, a standard error
    # [-]: a sheared contact grows at its front. In 19 held published lifts it was 0.18 at most
    ahead = 0.08
    # most frames and time [s] over which the slip in the pictures of a fast camera is measured;
    # over longer times prints drift
    slow_frames, slow_s = 4 * RECENT_FRAMES, 0.7
    radius = 2.4477  # of the circle with 95 % of a normal error in the plane [standard errors]

    def __init__(self, layout: MarkerLayout) -> None:
        """Begin before the object touches.

        Args:
            layout: markers and reference.
        """
        self._pitch = marker_pitch(layout)
        self._start: _Paths | None = None
        self._since = float("nan")
        self._paths: deque[_Paths | None] = deque(maxlen=self.slow_frames + 1)

    def update(
        self,
        positions: Float[np.ndarray, "n 2"],
        contact: Bool[np.ndarray, " n"],
        imprint: tuple[float, float],
        point: Sequence[float],
        time: float,
    ) -> Slide:
        """The slip after the next frame.

        Args:
            positions: positions of the markers [mm]; NaN for markers that are not visible.
            contact: markers of the contact region.
            imprint: rotation of the object's imprint and its standard error [rad].
            point: point of the imprint, as in `Frame.print_point` [mm, mm²].
            time: time stamp [s].
        """
        self._paths.append(None)
        # standard error of a marker's path along x and y [pitches]: 5 µm for dots 1.9 mm apart
        marker_error = 0.003
        if not contact.any():
            self._start = None
            return Slide()
        xx, yy, xy = point[4:]
        if not np.isfinite([*imprint, *point]).all() or xx < 0.0 or xx * yy < xy**2:
            return Slide()
        first, now = np.array(point[:2]), np.array(point[2:4])
        turn, turn_error = imprint
        c, s = np.cos(turn), np.sin(turn)
        arms = positions - now
        # initial position of each marker if it had moved with the object ever since
        with_object = first + arms @ np.array([[c, -s], [s, c]])
        path = _Paths(positions.copy(), with_object, np.linalg.norm(arms, axis=1), turn_error, time)
        if self._start is None or (turn == 0.0 and np.array_equal(first, now)):
            self._start, self._since = path, time
            self._paths.clear()
            self._paths.append(None)
        slips = (with_object - self._start.object_) @ np.array([[c, s], [-s, c]])
        visible = contact & np.isfinite(slips[:, 0])
        if not visible.any():
            return Slide()
        across = turn_error * arms[visible][:, ::-1] * [-1.0, 1.0]
        sheared = self.ahead * np.linalg.norm((positions - self._start.gel)[visible], axis=1)
        spread = np.array([[xx, xy], [xy, yy]]) + across[:, :, None] * across[:, None]
        read = marker_error * self._pitch
        spread += (read**2 + sheared[:, None, None] ** 2) * np.eye(2)
        middle = int(path.arm[visible].argmin())
        apart = arms[visible] - arms[visible][middle]
        slide = self._judge(slips[visible], spread, middle, turn_error * np.hypot(*apart.T))
        if 2.0 * np.sqrt(np.linalg.eigvalsh([[xx, xy], [xy, yy]])[-1]) > 0.25 * self._pitch:
            return slide  # a print that is uniform along a line would seem to stay behind the gel
        self._paths[-1] = path
        known = sum(old is not None and time - old.time < self.slow_s for old in self._paths) - 1
        slow = self._look_back(known, contact) if 2 * known >= self.slow_frames else None
        return slide._replace(recent=self._look_back(RECENT_FRAMES, contact), slow=slow)

    def _look_back(self, frames: int, contact: Bool[np.ndarray, " n"]) -> Recent:
        """Slip within a number of frames."""
        return Recent(self._measure(frames, contact), self._measure(frames // 4, contact))

    def _measure(self, frames: int, contact: Bool[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Slip over each marker of the contact within some frames, as in `Recent`."""
        then, now = self._paths[max(len(self._paths) - 1 - frames, 0)], self._paths[-1]
        if then is None or now is None:
            return np.full(len(contact), np.nan)
        gel = np.linalg.norm(now.gel - then.gel, axis=1)
        slip = np.linalg.norm(now.object_ - then.object_, axis=1)
        # error of the rotation between the two; that of a print that was not lost is small
        grown = np.sqrt(abs(now.turn_error**2 - then.turn_error**2))
        doubt = 2.0 * now.arm * grown * (grown > np.radians(1.0))
        beyond = np.maximum(slip - self.radius * self.ahead * gel - doubt, 0.0)
        return np.where(contact, beyond / self._pitch, np.nan)

    def _judge(
        self,
        slips: Float[np.ndarray, "m 2"],
        spread: Float[np.ndarray, "m 2 2"],
        middle: int,
        turned: Float[np.ndarray, " m"],
    ) -> Slide:
        """The slip of the object, from the slip over each marker.

        An error of the rotation lowers the slip on one side of the contact. If the object slips
        over all markers, the slip over the marker in the middle of the print therefore counts,
        unless another marker has clearly followed the object better. Markers outside the contact
        may seem to, under an object that turns. The interval therefore reaches to both.

        Args:
            slips: slip over each marker [mm].
            spread: its covariance [mm²].
            middle: the marker in the middle of the print.
            turned: error of the slip over each marker, less that in the middle, by the error of the
                rotation; a standard error [mm].
        """
        sure = 4.0  # standard errors by which a marker has followed better than the middle [-]
        far = np.linalg.norm(slips, axis=1)
        squared = np.einsum("ki,ki->k", slips, np.linalg.solve(spread, slips[..., None])[..., 0])
        beyond = float(np.sqrt(squared.min())) / self.radius
        least = best = int(far.argmin())
        if beyond > 1.0 and far[middle] - far[least] < sure * turned[least]:
            best = middle
        half = self.radius * float(np.sqrt(np.linalg.eigvalsh(spread[best])[-1]))
        determined = half < max(far[best], self._pitch)
        reach = float(np.hypot(half, far[middle] - far[least]))
        return Slide(float(far[best]) if determined else np.nan, reach, self._since, beyond)
