"""What a page in the browser shows of a run that goes on: the sink of its answers."""

import json
import threading
import time
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from estimation.frames.source import Source
from estimation.live.feed import Feed
from estimation.output.scene import (
    keep_pictures,
    picture_url,
    show_markers,
    show_numbers,
    view_markers,
)
from estimation.pictures.still import Shown
from estimation.tracking.stream import Answer


class Point(NamedTuple):
    """What the curve shows of an answer; angles in degrees."""

    serial: int
    time: float
    angle: float
    low: float
    high: float
    state: str


class Latest(NamedTuple):
    """An answer, and the picture that it was found in; None where there is none."""

    serial: int
    answer: Answer
    picture: Shown | None


class Window:
    """The sink that hands the latest answer to whoever looks; it never waits for them.

    A browser that is slow misses pictures and markers, but no point of the curve.

    Attributes:
        dropped: answers that a browser has not shown, the browsers added up.
        events: answers that were handed to browsers.
    """

    def __init__(self, source: Source, feed: Feed, method: str) -> None:
        """Make it.

        Args:
            source: that is followed.
            feed: that its frames go through.
            method: whose answers are shown.
        """
        longest = 4000  # points of the curve that a new browser is given
        self.dropped = self.events = 0
        self._source, self._feed, self._method = source, feed, method
        self._find_picture = keep_pictures(source)
        self._changed, self._drawing = threading.Condition(), threading.Lock()
        self._points: deque[Point] = deque(maxlen=longest)
        self._latest: Latest | None = None
        self._drawn: tuple[int, dict[str, Any]] = (-1, {})
        self._began, self._serial, self._anew, self._end = np.nan, 0, 0, ""

    def put(self, answer: Answer) -> None:
        """Take an answer; nothing is drawn here."""
        found = answer.estimates[self._method]
        picture = self._find_picture(answer.frame)
        with self._changed:
            if np.isfinite(found.time):
                self._began = found.time if np.isnan(self._began) else self._began
                angle, low, high = np.degrees([found.angle, found.low, found.high]).tolist()
                since, state = found.time - self._began, str(found.state)
                self._points.append(Point(self._serial, since, angle, low, high, state))
            self._latest = Latest(self._serial, answer, picture)
            self._serial += 1
            self._changed.notify_all()

    def restart(self) -> None:
        """Begin the curve anew: with a better reference the answers are given again."""
        with self._changed:
            self._points.clear()
            self._anew += 1

    def end(self, text: str) -> None:
        """Tell browsers, in a sentence, that there is nothing more to come."""
        with self._changed:
            self._end = text
            self._changed.notify_all()

    def follow(self) -> Iterator[str]:
        """What one browser is told, as lines of JSON: the latest answer whenever it is asked.

        Empty lines come while nothing is new.
        """
        quiet, least = 5.0, 1.0 / 60.0  # time without news; between two of them [s]
        serial, point, anew = -1, -1, self._anew
        while True:
            with self._changed:
                shown = self._wait_for_other(serial, quiet)
                end, again = self._end, self._anew != anew
                if again:
                    point, anew = -1, self._anew
                points = self._points_after(point)
            if shown is not None and shown.serial != serial:
                missed = shown.serial - serial - 1 if serial >= 0 else 0
                self.dropped, self.events = self.dropped + missed, self.events + 1
                serial = shown.serial
                point = points[-1].serial if points else point
                told = {"again": again, "curve": _show_points(points), "lost": self._feed.lost}
                yield json.dumps(self._draw(shown) | told, ensure_ascii=False, allow_nan=False)
            elif not end:
                yield ""
            if end:
                yield json.dumps({"end": end}, ensure_ascii=False)
                return
            time.sleep(least)

    def describe(self) -> str:
        """What browsers have missed, in a sentence; empty where it is nothing."""
        if not self.dropped:
            return ""
        every = self.dropped + self.events
        return f"window: {self.dropped} of {every} frames not shown: the browser was slower"

    def _wait_for_other(self, serial: int, quiet: float) -> Latest | None:
        """The latest answer, once it is another one than a serial's, or time has gone by."""
        if not self._end and (self._latest is None or self._latest.serial == serial):
            self._changed.wait(quiet)
        return self._latest

    def _points_after(self, serial: int) -> list[Point]:
        after: list[Point] = []
        for point in reversed(self._points):
            if point.serial <= serial:
                break
            after.append(point)
        return after[::-1]

    def _draw(self, shown: Latest) -> dict[str, Any]:
        """What is shown of an answer; it is drawn once for all browsers."""
        with self._drawing:
            if self._drawn[0] != shown.serial:
                self._drawn = shown.serial, self._describe(shown)
            return self._drawn[1]

    def _describe(self, shown: Latest) -> dict[str, Any]:
        answer, frame = shown.answer, shown.answer.frame
        found, reference = answer.estimates[self._method], answer.layout.reference
        view = view_markers(self._source, frame.positions, reference, shown.picture)
        signs = show_markers(view.spots, frame.valid, found.stick, found.contact)
        return {
            "frame": found.source_index,
            "state": str(found.state),
            "alert": str(answer.alert.level),
            "reason": found.reason,
            "values": self._list_values(answer),
            "scene": {"size": list(view.size)} | signs,
            "picture": None if view.jpeg is None else picture_url(view.jpeg),
        }

    def _list_values(self, answer: Answer) -> list[list[Any]]:
        """Name, value, half-width and unit of what is known."""
        found, shear, unit = answer.estimates[self._method], answer.shear, self._source.unit
        margin, alert = answer.margin, answer.alert
        angle = np.degrees([found.angle, (found.high - found.low) / 2.0])
        left = np.degrees([margin.angle, (margin.angle_high - margin.angle_low) / 2.0])
        rows: list[tuple[str, float, float, str]] = [
            ("angle", angle[0], angle[1], "°"),
            ("slip", shear.slip, shear.slip_error, unit),
            ("probability of a slip", shear.slipped, np.nan, ""),
            ("angle left", left[0], left[1], "°"),
            ("time to slip", alert.time_to_slip, (alert.high - alert.low) / 2.0, "s"),
            ("friction in use", answer.friction.used, np.nan, ""),
            ("markers that stick", float(found.stick_markers), np.nan, ""),
            ("markers in contact", float(found.contact_markers), np.nan, ""),
        ]
        shown = [[name, *show_numbers((value, half)), of] for name, value, half, of in rows]
        return [row for row in shown if row[1] is not None]


def _show_points(points: list[Point]) -> dict[str, Any]:
    """Points as `drawCurve` takes them."""
    columns = list(zip(*points, strict=True)) or [()] * len(Point._fields)
    table = dict(zip(Point._fields, columns, strict=True))
    numbers = {name: show_numbers(table[name], 4) for name in ("time", "angle", "low", "high")}
    return numbers | {"state": list(table["state"])}
