"""Run estimators over single frames or a whole recording."""

import warnings
from typing import Any

import numpy as np
from jaxtyping import Float

from estimation.choices import AlertSettings, ContactSettings
from estimation.estimators import DEFAULT_METHOD
from estimation.estimators.result import Estimate, Result
from estimation.fields.torsion import prepare_faces
from estimation.frames.inspection import (
    ClockWatch,
    disordered_times,
    doubt_scale,
    doubt_times,
)
from estimation.frames.noise import Noise, expect_unit, find_noise
from estimation.frames.recording import Frame, MarkerLayout, Recording
from estimation.slip.alert import Alert
from estimation.slip.friction import Friction
from estimation.slip.margin import Margin
from estimation.slip.shear import Shear
from estimation.softness import RIGID_OBJECT, Softness
from estimation.tracking.trackers import Trackers


class Tracker:
    """Estimates the object's angle frame by frame, causally, and warns of slip.

    Over the frames of a recording, it gives the same numbers as `estimate_angles` with the same
    noise.

    Attributes:
        layout: the markers of the sensor.
        estimator: the estimator.
        constants: constants of the method.

    Examples:
        >>> import numpy as np
        >>> from estimation import Noise, Tracker, layout_markers, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> layout = layout_markers(recording.layout.reference)
        >>> tracker = Tracker(layout, noise=Noise.from_std(5e-3))
        >>> for positions, time in zip(recording.positions, recording.time):
        ...     last = tracker.update_positions(positions, time)
        >>> half = np.degrees(last.high - last.low) / 2
        >>> print(f"{tracker.alert.level}: {np.degrees(last.angle):.1f}° ± {half:.2f}°")
        watch: 10.0° ± 0.15°
    """

    def __init__(
        self,
        layout: MarkerLayout,
        method: str = DEFAULT_METHOD,
        *,
        noise: Noise | None = None,
        softness: Softness = RIGID_OBJECT,
        contact: ContactSettings = ContactSettings(),
        alert: AlertSettings = AlertSettings(),
        **constants: Any,
    ) -> None:
        """Make a tracker; warns of lengths or a noise that seem to be in another unit.

        Args:
            layout: the markers of the sensor. Lengths are in mm, or in px: then `noise` must be in
                px, and the threshold `onset_mm` counts px.
            method: name from `METHODS` or `PUBLISHED_METHODS`.
            noise: noise of the markers; without it, intervals come from the misfit in each frame.
            softness: correction by Eq. (13).
            contact: thresholds of contact and state.
            alert: thresholds of the alerts.
            **constants: constants of the method to change.

        Raises:
            ValueError: an unknown method or constant, a value out of range, or too few markers.
        """
        if noise is not None:
            prepare_faces()  # no frame waits for them
        self._trackers = Trackers(
            layout,
            {method: constants},
            noise=noise,
            softness=softness,
            contact=contact,
            alert=alert,
        )
        doubts = [] if noise is None else doubt_scale(layout.reference, noise, noise.unit)
        for doubt in doubts:
            warnings.warn(doubt, stacklevel=2)
        self.layout, self._method, self._count = layout, method, 0
        self._clock = ClockWatch(alert.act_s)
        self.estimator = self._trackers.estimators[method]
        self.constants = self._trackers.constants[method]

    def update(self, frame: Frame) -> Estimate:
        """The estimate for the next frame; see `Trackers.update`.

        Warns once if the first frames are further apart than `act_s`: their time stamps seem to be
        in another unit than seconds, or they come too seldom for alerts.

        Raises:
            ValueError: `frame` is not a frame of this layout.
        """
        estimate = self._trackers.update(frame)[self._method]
        for doubt in self._clock.update(frame.time):
            warnings.warn(doubt, stacklevel=2)
        return estimate

    @property
    def alert(self) -> Alert:
        """The warning of a macro slip after the last frame."""
        return self._trackers.load.alert

    @property
    def shear(self) -> Shear:
        """Shear of the gel in the last frame, and whether the object slips along it."""
        return self._trackers.shear

    @property
    def margin(self) -> Margin:
        """Angle and moment that remain before macro slip; the moment is NaN unless measured."""
        return self._trackers.load.margin

    @property
    def friction(self) -> Friction:
        """Friction in use and its coefficient after the last frame; NaN without forces."""
        return self._trackers.load.friction

    def update_positions(self, positions: Float[np.ndarray, "n d"], time: float) -> Estimate:
        """The estimate for the next frame, from marker positions alone.

        In two dimensions all markers count as in contact, so the state is never `stick`. If you
        know which markers the object touches, call `update` with a `Frame(contact=...)` instead.

        Args:
            positions: positions of the layout's markers, in its order and unit; NaN for markers
                that are not visible.
            time: time stamp [s].

        Raises:
            ValueError: the positions have another shape than the layout's reference, or `time` is
                not a number.
        """
        expect_time(time)
        number, self._count = self._count, self._count + 1
        values = np.ma.filled(np.ma.asanyarray(positions, dtype=float), np.nan)  # masked: not seen
        if values.ndim != 2:
            raise ValueError(
                f"`positions` has shape {values.shape}; give one frame at a time, (markers, 2) or "
                "(markers, 3)"
            )
        return self.update(Frame(values, time, number))


def expect_time(time: object) -> None:
    """Check that a time stamp is a number.

    Raises:
        ValueError: it is not.
    """
    value = np.asarray(time)
    if value.ndim or value.dtype.kind not in "iuf":
        raise ValueError(
            f"a time stamp in seconds is expected, a number, got {type(time).__name__}: for clock "
            "times, subtract the first and give the difference in seconds"
        )


def estimate_angles(
    recording: Recording,
    method: str = DEFAULT_METHOD,
    *,
    noise: Noise | None = None,
    **settings: Any,
) -> Result:
    """The object's angle in every frame of a recording, from this and earlier frames.

    `python -m estimation run` also looks back over the whole recording: it may withdraw angles and
    date slips earlier.

    Args:
        recording: the recording.
        method: name from `METHODS` or `PUBLISHED_METHODS`.
        noise: noise of the markers; estimated from the recording unless given. If the recording is
            too short for that, intervals come from the misfit in each frame, and a note reports it.
        **settings: further arguments of `Tracker`.

    Raises:
        ValueError: a wrong setting, or a noise in another unit than the lengths.

    Examples:
        >>> import numpy as np
        >>> from estimation import estimate_angles, simulate_pivot
        >>> recording, truth = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> result = estimate_angles(recording)
        >>> half = np.degrees(result.high[-1] - result.low[-1]) / 2
        >>> print(f"{np.degrees(result.angle[-1]):.1f}° ± {half:.2f}°")
        10.0° ± 0.04°
    """
    if not isinstance(recording, Recording):
        raise ValueError(
            f"a recording is expected, got {type(recording).__name__}: read one with "
            "`read_recording`, or pass positions to a `Tracker`, frame by frame"
        )
    expect_unit(noise, recording)
    noise, notes = (noise, ()) if noise else find_noise(recording)
    for doubt in doubt_times(recording.time[~disordered_times(recording.time)]):
        warnings.warn(doubt, stacklevel=2)
    tracker = Tracker(recording.layout, method, noise=noise, **settings)
    estimates = [tracker._trackers.update(frame)[method] for frame in recording]
    return Result.gather(method, estimates, notes)
