"""Frames answered one after the other: from any source, by every method, into any sink.

A folder, a file, a camera and any other source of frames go the same way. What a stream keeps of
its past is bounded; what it has found goes to its sinks.
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
from estimation.frames.noise import Noise, expect_unit, find_noise
from estimation.frames.recording import Frame, MarkerLayout, Recording, record_frames
from estimation.frames.source import Source
from estimation.frames.state import save_state
from estimation.pictures.reading import PictureSource, PictureState
from estimation.settings import Settings
from estimation.slip.alert import Alert, AlertWatch
from estimation.slip.branch import Branch
from estimation.slip.friction import Friction
from estimation.slip.margin import Margin, MarginTracker
from estimation.slip.onset import Sight, SlipWatch
from estimation.slip.shear import Shear
from estimation.tracking.tracker import Trackers

AHEAD = 96
"""Frames that are read before the first is answered, for the noise that they show."""
AHEAD_LIVE = 24
"""The same of a source that gives them as they are taken: less than a second at 25 per second."""
MOST_HELD = 2000
"""Frames that are answered anew when a better reference is found after them."""


class Answer(NamedTuple):
    """The answers for a frame.

    Attributes:
        row: of the frame, counted from 0.
        frame: as the source gave it.
        estimates: by method.
        axis: direction of the contact's long axis [rad], NaN where refused.
        sight: the region that sticks, from the motion over the last frames.
        margin: angle and moment that remain before macro slip, by the chosen method.
        turned: φ of each marker since that method's angle is counted [rad].
        shear: of the gel, and whether the object slips along it.
        friction: in use, and its coefficient.
        alert: when all of the contact will slip, and what a gripper should do.
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

    Args:
        layout: markers and reference.
        settings: of the run.
        noise: of the markers, given or found.

    Raises:
        ValueError: a wrong setting, or too few markers.
    """
    return Trackers(
        layout,
        settings.methods,
        noise=noise,
        softness=settings.softness,
        contact=settings.contact,
    )


@runtime_checkable
class Sink(Protocol):
    """Whatever takes answers: a table on the disc, a screen, a robot.

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
        """Forget all answers so far: with a better reference they are given anew."""
        ...


class Follower:
    """Answers the frames of one source; it keeps no more of the past than its methods do.

    Attributes:
        layout: markers and reference.
        noise: of the markers.
        notes: about the noise and the reference, in sentences.
        row: of the next frame.
        last: time stamp [s] and number of the last frame that had them.
        flaws: how many frames could not be used, by the reason.
    """

    def __init__(
        self,
        layout: MarkerLayout,
        settings: Settings,
        noise: Noise | None,
        notes: tuple[str, ...] = (),
    ) -> None:
        """Begin with the first frame.

        Args:
            layout: markers and reference.
            settings: of the run.
            noise: of the markers; without it intervals come from the misfit within each frame.
            notes: about the noise.

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
        self._outline, self._margin = OutlineFollower(), MarginTracker()
        self._alert = AlertWatch(self._settings.alert)
        self._watch = None if self.noise is None else SlipWatch(layout, self.noise)
        self._digest = hashlib.sha256(np.ascontiguousarray(layout.reference).tobytes()).digest()

    def relay(self, layout: MarkerLayout, why: str = "") -> None:
        """Go on with another reference.

        Args:
            layout: with that reference.
            why: what has happened, where the frames so far are not to be answered anew.
        """
        if why:
            self.notes = (
                *self.notes,
                f"From frame {self.row} on angles are relative to another reference: {why}.",
            )
        else:
            self.row, self.flaws = 0, Counter()
        self._begin(layout)

    def update(self, frame: Frame) -> Answer:
        """What is known after the next frame.

        Raises:
            ValueError: the frame is not of this layout.
        """
        estimates = self.trackers.update(frame)
        seen = self.trackers.observation
        assert seen is not None
        if seen.flaw:
            self.flaws[seen.flaw] += 1
        if np.isfinite(frame.time):
            self.last = (frame.time, frame.source_index)
        main = estimates[self._settings.method]
        self._digest = hashlib.sha256(
            self._digest + frame.positions.tobytes() + frame.valid.tobytes()
        ).digest()
        sight = Sight(None, False)
        if self._watch is not None:
            printed = bool(np.isfinite(frame.imprint[0]))
            sight = self._watch.update(frame.positions, main.contact, frame.time, printed)
        margin = self._margin.follow(main.state, main.angle, main.moment, main.contact_markers)
        friction = self.trackers.friction.tell(self._margin.branch)
        shear = self.trackers.shear
        answer = Answer(
            row=self.row,
            frame=frame,
            estimates=estimates,
            axis=self._outline.update(seen.fields)[0],
            sight=sight,
            margin=margin,
            turned=main.rotation - self.trackers.counts[self._settings.method].start,
            shear=shear,
            friction=friction,
            alert=self._alert.update(
                main.time, main.state, main.angle, margin, friction, shear.slipped
            ),
            layout=self.layout,
        )
        self.row += 1
        return answer

    @property
    def branch(self) -> Branch | None:
        """Moment against angle as known in the last frame that had a margin."""
        return self._margin.last

    @property
    def sha256(self) -> str:
        """Of what the angles were computed from: reference, positions and validity, in a chain."""
        return self._digest.hex()


class Checkpoint(NamedTuple):
    """Where a stream has got to.

    Attributes:
        follower: that has answered the frames so far.
        held: frames that a better reference, which may still be found, would answer anew; None
            where there are too many of them.
        pictures: what the source has learnt from as many pictures; None of other sources.
        clock: when that was [s since the epoch].
    """

    follower: Follower
    held: list[Frame] | None
    pictures: PictureState | None
    clock: float

    @property
    def row(self) -> int:
        """Of the next frame."""
        return self.follower.row

    def clock_now(self) -> tuple[float, int]:
        """Time stamp [s] and number of a frame that is taken now."""
        last, number = self.follower.last
        return last + max(time.time() - self.clock, 0.0), number + 1


class Stream:
    """A source that is followed.

    Attributes:
        source: of the frames.
        follower: that answers them.
        done: frames whose answers have gone to every sink.
        interrupted: whether Ctrl-C came while it read, answered or looked ahead.

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
        """Look ahead, for the noise that the first frames show.

        Args:
            source: of the frames.
            settings: of the run.
            resumed: where an earlier stream got to; the source begins with the frame after.

        Raises:
            ValueError: a wrong setting, a noise in another unit than the lengths, or no frames.
        """
        self.source, self.interrupted, self.done = source, False, 0
        self._frames, self._ahead = iter(source), list[Frame]()
        self._held: list[Frame] | None = []
        self._settled = False
        if resumed is not None:
            self.follower, self._held = resumed.follower, resumed.held
            if source.live:
                self._held = []
                self.follower.relay(source.layout, "nothing was observed during the interruption")
            self.follower.layout, self.done = source.layout, self.follower.row
            return
        noise, notes = settings.noise, ()
        expect_unit(noise, source)
        if noise is None and isinstance(source, Recording):
            noise, notes = find_noise(source)
        elif noise is None:
            noise, notes = self._look_ahead()
        self.follower = Follower(source.layout, settings, noise, notes)

    def _look_ahead(self) -> tuple[Noise | None, tuple[str, ...]]:
        layout = self.source.layout
        try:
            for frame in islice(self._frames, AHEAD_LIVE if self.source.live else AHEAD):
                self._ahead.append(frame)
        except KeyboardInterrupt:
            self.interrupted = True
        if not self._ahead:
            raise ValueError(f"{self.source.name} has no frames")
        if self.source.layout is not layout:
            self._ahead = self._judge_again(self._ahead)
        return find_noise(record_frames(self.source.layout, self._ahead))

    def answers(self, *sinks: Sink) -> Iterator[Answer]:
        """Answer frame by frame; an answer has gone to every sink before it is given.

        Args:
            *sinks: that take the answers, in this order.

        Raises:
            ValueError: a frame is not of the source's layout.
            OSError: a sink cannot write.
        """
        try:
            for frame in self._next_frames():
                again: list[Frame] = []
                if self.source.layout is not self.follower.layout:
                    again = self._relay(sinks)
                self._hold(frame)
                for one in (*again, frame):
                    answer = self.follower.update(one)
                    for sink in sinks:
                        sink.put(answer)
                    self.done = self.follower.row
                    self._settled = one is frame and not (self._ahead or self.interrupted)
                    yield answer
        except KeyboardInterrupt:
            self.interrupted, self._settled = True, False
            raise

    def checkpoint(self) -> bytes:
        """The state from which a run resumes after the last answer.

        Empty while frames that were read are not answered, and once Ctrl-C has come: a frame may
        then be half read or half answered.
        """
        if not self._settled:
            return b""
        pictures = self.source.state if isinstance(self.source, PictureSource) else None
        return save_state(Checkpoint(self.follower, self._held, pictures, time.time()))

    def _next_frames(self) -> Iterator[Frame]:
        while self._ahead:
            yield self._ahead.pop(0)
        if not self.interrupted:
            yield from self._frames

    def _relay(self, sinks: tuple[Sink, ...]) -> list[Frame]:
        """Go on with the source's new reference; the frames that are to be answered anew."""
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
        return self._judge_again(held)

    def _judge_again(self, frames: list[Frame]) -> list[Frame]:
        """Frames that came before a reference was found, judged by it where the source can."""
        return self.source.judge_again(frames) if isinstance(self.source, PictureSource) else frames

    def _hold(self, frame: Frame) -> None:
        """Keep a frame while a better reference may be found, unless there are too many."""
        if not self.source.provisional:
            self._held = []
        elif self._held is not None and len(self._held) < MOST_HELD:
            self._held.append(frame)
        else:
            self._held = None
