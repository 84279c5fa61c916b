"""Streams: frames of any source, answered one by one by every method, into any sinks.

Folders, files, cameras and other sources are handled alike. A stream keeps a bounded part of its
past; its answers go to the sinks.
"""

import hashlib
import time
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from estimation.estimators.result import Estimate
from estimation.fields.outline import OutlineFollower
from estimation.fields.torsion import prepare_faces
from estimation.frames.inspection import ClockWatch, doubt_times, expect_clock
from estimation.frames.noise import Noise, expect_unit, find_noise
from estimation.frames.recording import Frame, MarkerLayout, Recording
from estimation.frames.source import MOST_HELD_FRAMES, Source, record_frames
from estimation.frames.state import save_state
from estimation.pictures.reading import PictureSource, PictureState
from estimation.settings import Settings
from estimation.slip.alert import Alert
from estimation.slip.branch import Branch
from estimation.slip.friction import Friction
from estimation.slip.margin import Margin
from estimation.slip.onset import Sight
from estimation.slip.shear import Shear
from estimation.softness import expect_scale
from estimation.tracking.trackers import Trackers

AHEAD_LIVE_FRAMES = 24
"""Frames that are read from a live source before the first answer: 1 s at 25 frames per second."""


class Answer(NamedTuple):
    """The answers for a frame.

    Attributes:
        row: number of the frame, counted from 0.
        frame: the frame as it came from the source.
        estimates: estimates by method.
        axis: direction of the contact's long axis [rad]; NaN if rejected.
        sight: the stick region, from the motion over the last frames.
        margin: angle and moment that remain before macro slip, by the chosen method.
        turned: φ of each marker since the frame that the chosen method's angle counts from [rad].
        shear: shear of the gel, and whether the object slips along it.
        friction: share of the friction limit in use, and the friction coefficient.
        alert: predicted time to macro slip, and the level of the alert to a gripper.
        layout: markers, and the reference that the answer is relative to.

    Examples:
        >>> from estimation import Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> *_, last = Stream(recording, Settings()).answers()
        >>> print(last.row, last.estimates["tracked"].state, last.alert.level)
        42 incipient act
    """

    row: int
    frame: Frame
    estimates: dict[str, Estimate]
    axis: float
    sight: Sight
    margin: Margin
    turned: Float[np.ndarray, " n"]
    shear: Shear
    friction: Friction
    alert: Alert
    layout: MarkerLayout


def make_trackers(layout: MarkerLayout, settings: Settings, noise: Noise | None) -> Trackers:
    """The trackers of a run.

    Raises:
        ValueError: a wrong setting, or too few markers.
    """
    return Trackers(
        layout,
        settings.methods,
        noise=noise,
        softness=settings.softness,
        contact=settings.contact,
        alert=settings.alert,
    )


@runtime_checkable
class Sink(Protocol):
    """A receiver of answers, such as a table, a screen or a robot.

    Examples:
        >>> from estimation import Settings, Sink, Stream, simulate_pivot
        >>> class States(list):
        ...     def put(self, answer):
        ...         self.append(answer.estimates["tracked"].state)
        ...     restart = list.clear
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> sink: Sink = States()
        >>> _ = list(Stream(recording, Settings()).answers(sink))
        >>> print(len(sink), "states, the last", sink[-1])
        43 states, the last incipient
    """

    def put(self, answer: Answer) -> None:
        """Take the next answer."""
        ...

    def restart(self) -> None:
        """Discard all answers so far; they come again, relative to a better reference."""
        ...


class Follower:
    """Answers the frames of one source, with no memory beyond that of the methods.

    Attributes:
        layout: markers and reference.
        noise: noise of the markers.
        notes: notes about the noise and the reference, in sentences.
        row: number of the next frame.
        last: time stamp [s] and number of the last frame with a time stamp.
        flaws: number of unusable frames by reason.
    """

    def __init__(
        self,
        layout: MarkerLayout,
        settings: Settings,
        noise: Noise | None,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Begin with the first frame; without noise, intervals come from the misfit in each frame.

        Raises:
            ValueError: a wrong setting, or too few markers.
        """
        self.noise, self.notes, self.row = noise, notes, 0
        self.last = (0.0, -1)
        self.flaws: Counter[str] = Counter()
        self._settings = settings
        self._begin(layout)

    def _begin(self, layout: MarkerLayout) -> None:
        self.layout = layout
        self.trackers = make_trackers(layout, self._settings, self.noise)
        self._outline = OutlineFollower()
        self._digest = hashlib.sha256(np.ascontiguousarray(layout.reference).tobytes()).digest()

    def relay(self, layout: MarkerLayout, why: str = "") -> None:
        """Continue with another reference; `why` is empty if earlier frames are answered again."""
        if why:
            self.notes = (
                *self.notes,
                f"From frame {self.row} on, angles are relative to another reference: {why}.",
            )
        else:
            self.row, self.flaws = 0, Counter()
        self._begin(layout)

    def update(self, frame: Frame) -> Answer:
        """The answer for the next frame.

        Raises:
            ValueError: `frame` is not a frame of this layout.
        """
        estimates = self.trackers.update(frame)
        observation = self.trackers.observation
        assert observation is not None
        if observation.flaw:
            self.flaws[observation.flaw] += 1
        if np.isfinite(frame.time):
            self.last = (frame.time, frame.source_index)
        main = estimates[self._settings.method]
        self._digest = hashlib.sha256(
            self._digest + frame.positions.tobytes() + frame.valid.tobytes()
        ).digest()
        answer = Answer(
            row=self.row,
            frame=frame,
            estimates=estimates,
            axis=self._outline.update(observation.fields)[0],
            sight=self.trackers.sight,
            margin=self.trackers.load.margin,
            turned=main.rotation - self.trackers.counts[self._settings.method].start,
            shear=self.trackers.shear,
            friction=self.trackers.load.friction,
            alert=self.trackers.load.alert,
            layout=self.layout,
        )
        self.row += 1
        return answer

    @property
    def branch(self) -> Branch | None:
        """The moment–angle curve of the last frame with a margin."""
        return self.trackers.load.branch

    @property
    def sha256(self) -> str:
        """Chained hash of the inputs of the angles: reference, positions and validity."""
        return self._digest.hex()


class Checkpoint(NamedTuple):
    """State of a stream, from which it can be resumed.

    Attributes:
        follower: follower that has answered the frames so far.
        held: frames to answer again if a better reference is found; None if they are too many.
        pictures: state of a source of pictures after these frames; None for other sources.
        clock: time of the checkpoint [s since the epoch].
    """

    follower: Follower
    held: list[Frame] | None
    pictures: PictureState | None
    clock: float

    @property
    def row(self) -> int:
        """Number of the next frame."""
        return self.follower.row

    def clock_now(self) -> tuple[float, int]:
        """Time stamp [s] and number of a frame taken now."""
        last, number = self.follower.last
        return last + max(time.time() - self.clock, 0.0), number + 1


class Stream:
    """Answers of a source, frame by frame.

    Attributes:
        source: source of the frames.
        follower: follower that answers them.
        done: number of frames whose answers every sink has taken.
        interrupted: whether Ctrl-C came while frames were read or answered.

    Examples:
        >>> from estimation import Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> for answer in Stream(recording, Settings()).answers():
        ...     state = answer.estimates["tracked"].state
        >>> print(answer.row, state)
        42 incipient
    """

    def __init__(
        self, source: Source, settings: Settings, resumed: Checkpoint | None = None
    ) -> None:
        """Make a stream; without a given noise, read the first frames to estimate it.

        Args:
            source: source of the frames.
            settings: settings of the run.
            resumed: state of an earlier stream; the source begins with the frame after it.

        Raises:
            ValueError: a wrong setting, a noise in another unit than the lengths, or no frames.
        """
        if not hasattr(source, "layout"):
            raise ValueError(
                f"a source of frames is expected, got {type(source).__name__}: open one, for "
                "example with `read_recording`, `PictureSource` or `FrameStream`"
            )
        if source.live:
            prepare_faces()  # no frame waits for them
        self.source, self.interrupted, self.done = source, False, 0
        self._frames, self._ahead = iter(source), list[Frame]()
        self._held: list[Frame] | None = []
        self._settled = False
        self._clock = ClockWatch(settings.alert.act_s)
        if resumed is not None:
            self.follower, self._held = resumed.follower, resumed.held
            if source.live:
                self._held = []
                self.follower.relay(source.layout, "nothing was observed during the interruption")
            self.follower.layout, self.done = source.layout, self.follower.row
            return
        noise, notes = settings.noise, ()
        expect_unit(noise, source)
        expect_scale(settings.softness, source.unit, source.name)
        if noise is None and isinstance(source, Recording):
            noise, notes = find_noise(source)
        elif noise is None:
            noise, notes = self._look_ahead()
        self.follower = Follower(source.layout, settings, noise, notes)

    def _look_ahead(self) -> tuple[Noise | None, tuple[str, ...]]:
        # frames that are read before the first answer, to estimate the noise
        ahead = AHEAD_LIVE_FRAMES if self.source.live else 96
        layout = self.source.layout
        try:
            for frame in islice(self._frames, ahead):
                self._ahead.append(frame)
        except KeyboardInterrupt:
            self.interrupted = True
        if not self._ahead:
            raise ValueError(f"{self.source.name} has no frames")
        times = np.array([frame.time for frame in self._ahead])
        ordered = times[~expect_clock(self.source.name, times)]
        known = self.source.live or isinstance(self.source, PictureSource)
        doubts = [] if known else doubt_times(ordered)  # others are watched, or have reported it
        if self.source.layout is not layout:
            self._ahead = self._reevaluate(self._ahead)
        noise, notes = find_noise(record_frames(self.source.layout, self._ahead))
        return noise, (*doubts, *notes)

    def answers(self, *sinks: Sink) -> Iterator[Answer]:
        """Answer frame by frame; every sink takes an answer before it is yielded.

        Args:
            *sinks: receivers of the answers, called in this order.

        Raises:
            ValueError: a frame does not have the source's layout.
            OSError: a sink cannot write.
        """
        try:
            for frame in self._next_frames():
                again: list[Frame] = []
                if self.source.layout is not self.follower.layout:
                    again = self._relay(sinks)
                self._hold(frame)
                if self.source.live:
                    self.follower.notes += tuple(self._clock.update(frame.time))
                for pending in (*again, frame):
                    answer = self.follower.update(pending)
                    for sink in sinks:
                        sink.put(answer)
                    self.done = self.follower.row
                    self._settled = pending is frame and not (self._ahead or self.interrupted)
                    yield answer
        except KeyboardInterrupt:
            self.interrupted, self._settled = True, False
            raise

    def checkpoint(self) -> bytes:
        """The state from which a run resumes after the last answer, as bytes.

        Empty while a frame that was read is not answered yet, and after Ctrl-C, which may leave a
        frame half read or half answered.
        """
        if not self._settled:
            return b""
        pictures = self.source.state if isinstance(self.source, PictureSource) else None
        held = [] if self.source.live else self._held  # a live source does not resume with them
        return save_state(Checkpoint(self.follower, held, pictures, time.time()))

    def _next_frames(self) -> Iterator[Frame]:
        while self._ahead:
            yield self._ahead.pop(0)
        if not self.interrupted:
            yield from self._frames

    def _relay(self, sinks: tuple[Sink, ...]) -> list[Frame]:
        """Continue with the source's new reference; return the frames to answer again."""
        held, self._held = self._held, []
        if held is None or len(held) < self.follower.row:
            self.follower.relay(
                self.source.layout,
                "a better reference appeared too late to answer earlier frames again",
            )
            return []
        self.follower.relay(self.source.layout)
        for sink in sinks:
            sink.restart()
        return self._reevaluate(held)

    def _reevaluate(self, frames: list[Frame]) -> list[Frame]:
        """The frames, inspected again with the new reference if the source can do so."""
        return self.source.reevaluate(frames) if isinstance(self.source, PictureSource) else frames

    def _hold(self, frame: Frame) -> None:
        """Keep a frame while a better reference may come, up to `MOST_HELD_FRAMES` frames."""
        if not self.source.provisional:
            self._held = []
        elif self._held is not None and len(self._held) < MOST_HELD_FRAMES:
            self._held.append(frame)
        else:
            self._held = None
