"""Scenes that a page draws of a frame, and the colours of all figures.

`templates/draw.js` draws a scene: positions of the markers in pixels, y down, and the state of
each. The colours of markers are those of Okabe and Ito, which colour-blind readers can distinguish;
markers that slip are also drawn as crosses.
"""

import base64
from collections.abc import Callable, Iterable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from estimation.estimators.result import State, Track
from estimation.frames.files import json_number
from estimation.frames.recording import Frame
from estimation.frames.source import Source
from estimation.output.record import KeptMarkers
from estimation.pictures.reading import PictureSource
from estimation.pictures.still import Shown

STATE_COLOURS = {
    State.NO_CONTACT: "#e6e6e6",
    State.STICK: "#d4ecd0",
    State.INCIPIENT: "#fbeebf",
    State.MACRO_SLIP: "#f6cfc9",
    State.UNKNOWN: "#c9c9e8",
}
"""Background colours of curves, by state."""
MARKER_COLOURS = {"sticks": "#009e73", "slips": "#d55e00", "no contact": "#d9d9d9"}
"""Colours of markers, by their state."""


def show_state(state: str) -> str:
    """A state in words: `macro slip`."""
    return state.replace("_", " ")


def page_colours() -> dict[str, Mapping[str, str]]:
    """The colours in the form that `draw.js` takes."""
    kinds = zip("ox.", MARKER_COLOURS.values(), strict=True)
    states = {str(state): colour for state, colour in STATE_COLOURS.items()}
    return {"markers": dict(kinds), "states": states}


class Field(NamedTuple):
    """Drawing area for markers without a picture."""

    corner: Float[np.ndarray, " 2"]  # corner of the drawing, in the axes of the positions
    scale: float  # pixels per unit of length
    size: tuple[int, int]  # width and height [px]
    down: bool  # whether y points down in the source's own view

    @classmethod
    def around(cls, reference: Float[np.ndarray, "n d"], down: bool) -> "Field":
        """The area around all markers at rest, with room to move."""
        wide, room = 640.0, 0.12  # longer side [px]; margin on each side over the pattern's size
        low, high = np.nanmin(reference[:, :2], axis=0), np.nanmax(reference[:, :2], axis=0)
        longest = max(float((high - low).max()), 1e-9)
        corner, span = low - room * longest, high - low + 2.0 * room * longest
        scale = wide / float(span.max())
        width, height = np.ceil(scale * span).astype(int).tolist()
        return cls(corner, scale, (width, height), down)

    def place(self, positions: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """Positions of markers, in the unit of the reference, as pixels of the drawing."""
        spots = self.scale * (positions[:, :2] - self.corner)
        return spots if self.down else np.stack([spots[:, 0], self.size[1] - spots[:, 1]], axis=1)


def keep_pictures(source: Source) -> Callable[[Frame], Shown | None]:
    """Make a source keep each picture until its frame has been answered.

    Returns:
        A function that returns a frame's picture; None for sources without pictures.
    """
    if not isinstance(source, PictureSource):
        return lambda frame: None
    source.keep_pictures()
    return source.find_picture


class View(NamedTuple):
    """A drawn frame."""

    spots: Float[np.ndarray, "views n 2"]  # positions of the markers in each view [px]
    size: tuple[int, int]  # width and height [px]
    jpeg: bytes | None  # picture of the frame; None without a picture


def view_markers(
    source: Source,
    positions: Float[np.ndarray, "n d"],
    reference: Float[np.ndarray, "n d"],
    shown: Shown | None,
) -> View:
    """Markers drawn in the picture of their frame, or in a field around them if there is none."""
    if not isinstance(source, PictureSource):
        field = Field.around(reference, points_down(source.convention))
        return View(field.place(positions)[None], field.size, None)
    spots = source.locate(positions)
    if shown is not None:
        return View(shown.copy.place(spots), shown.copy.size, shown.copy.jpeg)
    width, height = np.ceil(np.nanmax(source.locate(reference), axis=(0, 1))).astype(int).tolist()
    return View(spots, (width, height), None)


def points_down(convention: str) -> bool:
    """Whether y points down in a source's own view, as it does in pictures."""
    return "y down" in convention


def sticking_markers(track: Track, markers: KeptMarkers) -> Bool[np.ndarray, " n"]:
    """The stored markers that stick; none if the answer to their frame was withdrawn."""
    return markers.stick & bool(track.stick_markers[markers.row])


def marker_signs(
    stick: Bool[np.ndarray, " n"], contact: Bool[np.ndarray, " n"]
) -> Shaped[np.ndarray, " n"]:
    """A sign for each marker: `o` sticks, `x` slips in the contact, `.` has no contact."""
    return np.where(stick, "o", np.where(contact, "x", "."))


def show_markers(
    spots: Float[np.ndarray, "views n 2"],
    valid: Bool[np.ndarray, " n"],
    stick: Bool[np.ndarray, " n"],
    contact: Bool[np.ndarray, " n"],
) -> dict[str, Any]:
    """Markers in the form that `draw.js` takes: `spots` x, y, x, y, … and `kinds`, a sign each.

    Their places are in each view [px]. Markers that are not visible are omitted.
    """
    visible = valid & np.isfinite(spots).all(axis=(0, 2))
    kinds = marker_signs(stick, contact)[visible]
    return {
        "spots": np.round(spots[:, visible].ravel(), 1).tolist(),
        "kinds": "".join(kinds.tolist()) * len(spots),
    }


def picture_url(jpeg: bytes) -> str:
    """The data URL of a picture."""
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"


def json_numbers(values: Iterable[float], digits: int = 3) -> list[float | None]:
    """Numbers for JSON; see `json_number`."""
    return [json_number(value, digits) for value in values]


def choose_rows(
    *curves: Shaped[np.ndarray, " frames"], most_parts: int = 2000
) -> Int[np.ndarray, " rows"]:
    """The rows of a long stream to draw: all, or the extremes of each curve in each part of it.

    Args:
        *curves: what is drawn over the frames, at least one curve.
        most_parts: largest number of parts; a figure has about half as many pixels.
    """
    count = len(curves[0])
    if count <= 4 * most_parts:
        return np.arange(count)
    edges = np.linspace(0, count, most_parts + 1).astype(int)
    rows = [edges[:-1], [count - 1]]
    for values in curves:
        for unknown, find in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            known = np.where(np.isfinite(values), values, unknown)
            rows.append([a + find(known[a:b]) for a, b in pairwise(edges)])
    return np.unique(np.concatenate(rows))
