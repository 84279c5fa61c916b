"""The sink that sends the answers of a live run to a page in the browser."""

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
    json_numbers,
    keep_pictures,
    picture_url,
    show_markers,
    view_markers,
)
from estimation.pictures.still import Shown
from estimation.tracking.stream import Answer


class Point(NamedTuple):
    """A point of the curve; time in s, angles in degrees."""

    serial: int
    time: float
    angle: float
    low: float
    high: float
    state: str


class Latest(NamedTuple):
    """An answer, and the picture that it comes from; None without pictures."""

    serial: int
    answer: Answer
    picture: Shown | None


class Window:
    """Sink that offers the latest answer to browsers and never waits for them.

    A slow browser misses pictures and markers, but no point of the curve.
    """

    def __init__(self, source: Source, feed: Feed, method: str) -> None:
        """Make a window."""
        longest = 4000  # points of the curve that a new browser receives
        self.dropped = self.events = 0
        self._source, self._feed, self._method = source, feed, method
        self._find_picture = keep_pictures(source)
        self._changed, self._drawing = threading.Condition(), threading.Lock()
        self._points: deque[Point] = deque(maxlen=longest)
        self._latest: Latest | None = None
        self._drawn: tuple[int, dict[str, Any]] = (-1, {})
        self._began, self._serial, self._anew, self._end = np.nan, 0, 0, ""

    def put(self, answer: Answer) -> None:
        """Take an answer, without drawing it."""
        estimate = answer.estimates[self._method]
        picture = self._find_picture(answer.frame)
        with self._changed:
            if np.isfinite(estimate.time):
                self._began = estimate.time if np.isnan(self._began) else self._began
                interval = np.degrees([estimate.angle, estimate.low, estimate.high])
                angle, low, high = interval.tolist()
                since, state = estimate.time - self._began, str(estimate.state)
                self._points.append(Point(self._serial, since, angle, low, high, state))
            self._latest = Latest(self._serial, answer, picture)
            self._serial += 1
            self._changed.notify_all()

    def restart(self) -> None:
        """Clear the curve; the answers come again, relative to a better reference."""
        with self._changed:
            self._points.clear()
            self._anew += 1

    def end(self, text: str) -> None:
        """End the stream of all browsers with a sentence."""
        with self._changed:
            self._end = text
            self._changed.notify_all()

    def follow(self) -> Iterator[str]:
        """Lines of JSON for one browser: the latest answer at each request.

        Empty lines come while there is no new answer.
        """
        quiet, least = 5.0, 1.0 / 60.0  # longest wait for an answer; least time between two [s]
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
                news = {"again": again, "curve": _show_points(points), "lost": self._feed.lost}
                yield json.dumps(self._draw(shown) | news, ensure_ascii=False, allow_nan=False)
            elif not end:
                yield ""
            if end:
                yield json.dumps({"end": end}, ensure_ascii=False)
                return
            time.sleep(least)

    def describe(self) -> str:
        """A sentence on answers that browsers have missed; empty if there are none."""
        if not self.dropped:
            return ""
        total = self.dropped + self.events
        return f"window: {self.dropped} of {total} frames not shown: the browser was slower"

    def _wait_for_other(self, serial: int, quiet: float) -> Latest | None:
        """Wait for another answer than that of a serial, at most `quiet` s; return the latest."""
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
        """The content of an answer, drawn once for all browsers."""
        with self._drawing:
            if self._drawn[0] != shown.serial:
                self._drawn = shown.serial, self._describe(shown)
            return self._drawn[1]

    def _describe(self, shown: Latest) -> dict[str, Any]:
        answer, frame = shown.answer, shown.answer.frame
        estimate, reference = answer.estimates[self._method], answer.layout.reference
        view = view_markers(self._source, frame.positions, reference, shown.picture)
        signs = show_markers(view.spots, frame.valid, estimate.stick, estimate.contact)
        return {
            "frame": estimate.source_index,
            "state": str(estimate.state),
            "alert": str(answer.alert.level),
            "reason": estimate.reason,
            "values": self._list_values(answer),
            "scene": {"size": list(view.size)} | signs,
            "picture": None if view.jpeg is None else picture_url(view.jpeg),
        }

    def _list_values(self, answer: Answer) -> list[list[Any]]:
        """Name, value, half-width and unit of each known quantity."""
        estimate, shear, unit = answer.estimates[self._method], answer.shear, self._source.unit
        margin, alert = answer.margin, answer.alert
        angle = np.degrees([estimate.angle, (estimate.high - estimate.low) / 2.0])
        remaining = np.degrees([margin.angle, (margin.angle_high - margin.angle_low) / 2.0])
        rows: list[tuple[str, float, float, str]] = [
            ("angle", angle[0], angle[1], "°"),
            ("slip", shear.slip, shear.slip_error, unit),
            ("probability of a slip", shear.slip_probability, np.nan, ""),
            ("remaining angle", remaining[0], remaining[1], "°"),
            ("time to slip", alert.time_to_slip, (alert.high - alert.low) / 2.0, "s"),
            ("friction in use", answer.friction.used, np.nan, ""),
            ("markers that stick", float(estimate.stick_markers), np.nan, ""),
            ("markers in contact", float(estimate.contact_markers), np.nan, ""),
        ]
        shown = [[name, *json_numbers((value, half)), unit] for name, value, half, unit in rows]
        return [row for row in shown if row[1] is not None]


def _show_points(points: list[Point]) -> dict[str, Any]:
    """Points in the form that `drawCurve` takes."""
    columns = list(zip(*points, strict=True)) or [()] * len(Point._fields)
    table = dict(zip(Point._fields, columns, strict=True))
    numbers = {name: json_numbers(table[name], 4) for name in ("time", "angle", "low", "high")}
    return numbers | {"state": list(table["state"])}
