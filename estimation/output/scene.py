"""What a page draws of a frame and of angles over time, and the colours of all pictures.

`templates/draw.js` draws a scene: spots in the pixels of a picture, y down, and what each marker
does. Colours are those of Okabe and Ito, which colour-blind readers can tell apart; markers that
slip are crosses, too.
"""

import base64
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped

from estimation.estimators.result import State
from estimation.frames.recording import Frame
from estimation.frames.source import Source
from estimation.pictures.reading import PictureSource
from estimation.pictures.still import Shown

STATE_COLOURS = {
    State.NO_CONTACT: "#e6e6e6",
    State.STICK: "#d4ecd0",
    State.INCIPIENT: "#fbeebf",
    State.MACRO_SLIP: "#f6cfc9",
    State.UNKNOWN: "#c9c9e8",
}
"""Behind curves."""
MARKER_COLOURS = {"sticks": "#009e73", "slips": "#d55e00", "no contact": "#d9d9d9"}
"""Of markers, by what they do."""


def page_colours() -> dict[str, Mapping[str, str]]:
    """The colours as `draw.js` takes them."""
    kinds = zip("ox.", MARKER_COLOURS.values(), strict=True)
    states = {str(state): colour for state, colour in STATE_COLOURS.items()}
    return {"markers": dict(kinds), "states": states}


class Field(NamedTuple):
    """Where markers without a picture are drawn.

    Attributes:
        corner: of the drawing, in the axes of the positions.
        scale: pixels per unit of length.
        size: width and height [px].
        down: whether y points down in the source's own view.
    """

    corner: Float[np.ndarray, " 2"]
    scale: float
    size: tuple[int, int]
    down: bool

    @classmethod
    def around(cls, reference: Float[np.ndarray, "n d"], down: bool) -> "Field":
        """One that has all markers at rest in it, with room to move.

        Args:
            reference: markers at rest.
            down: whether y points down in the source's own view.
        """
        wide, room = 640.0, 0.12  # of the longer side [px]; of it, on each side [-]
        low, high = np.nanmin(reference[:, :2], axis=0), np.nanmax(reference[:, :2], axis=0)
        longest = max(float((high - low).max()), 1e-9)
        corner, span = low - room * longest, high - low + 2.0 * room * longest
        scale = wide / float(span.max())
        width, height = np.ceil(scale * span).astype(int).tolist()
        return cls(corner, scale, (width, height), down)

    def place(self, positions: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n 2"]:
        """Where markers are in the drawing [px].

        Args:
            positions: of the markers.
        """
        spots = self.scale * (positions[:, :2] - self.corner)
        return spots if self.down else np.stack([spots[:, 0], self.size[1] - spots[:, 1]], axis=1)


def keep_pictures(source: Source) -> Callable[[Frame], Shown | None]:
    """Let a source keep each picture until its frame has been answered.

    Args:
        source: of pictures, or of anything else.

    Returns:
        What finds a frame's picture; of other sources it finds none.
    """
    if not isinstance(source, PictureSource):
        return lambda frame: None
    source.keep_pictures()
    return source.find_picture


class View(NamedTuple):
    """A frame as it is drawn.

    Attributes:
        spots: where its markers are, in each view [px].
        size: width and height [px].
        jpeg: its picture; None where there is none.
    """

    spots: Float[np.ndarray, "views n 2"]
    size: tuple[int, int]
    jpeg: bytes | None


def view_markers(
    source: Source,
    positions: Float[np.ndarray, "n d"],
    reference: Float[np.ndarray, "n d"],
    shown: Shown | None,
) -> View:
    """How markers are drawn: in the picture of their frame, or in their field.

    Args:
        source: of the frame.
        positions: of the markers.
        reference: markers at rest.
        shown: the frame's picture, where it is kept.
    """
    if not isinstance(source, PictureSource):
        field = Field.around(reference, points_down(source.convention))
        return View(field.place(positions)[None], field.size, None)
    spots = source.locate(positions)
    if shown is not None:
        return View(shown.copy.place(spots), shown.copy.size, shown.copy.jpeg)
    width, height = np.ceil(np.nanmax(source.locate(reference), axis=(0, 1))).astype(int).tolist()
    return View(spots, (width, height), None)


def points_down(convention: str) -> bool:
    """Whether y points down in a source's own view, as it does in pictures.

    Args:
        convention: how the source's axes lie.
    """
    return "y down" in convention


def marker_signs(
    stick: Bool[np.ndarray, " n"], contact: Bool[np.ndarray, " n"]
) -> Shaped[np.ndarray, " n"]:
    """A sign for each marker: `o` sticks, `x` is in contact and slips, `.` is elsewhere.

    Args:
        stick: which stick.
        contact: which are of the contact region.
    """
    return np.where(stick, "o", np.where(contact, "x", "."))


def show_markers(
    spots: Float[np.ndarray, "views n 2"],
    valid: Bool[np.ndarray, " n"],
    stick: Bool[np.ndarray, " n"],
    contact: Bool[np.ndarray, " n"],
) -> dict[str, Any]:
    """Markers as `draw.js` takes them: `spots` x, y, x, y, … and `kinds`, a sign each.

    Markers that are not seen are left out.

    Args:
        spots: where they are drawn, in each view [px].
        valid: which can be used.
        stick: which stick.
        contact: which are of the contact region.
    """
    seen = valid & np.isfinite(spots).all(axis=(0, 2))
    kinds = marker_signs(stick, contact)[seen]
    return {
        "spots": np.round(spots[:, seen].ravel(), 1).tolist(),
        "kinds": "".join(kinds.tolist()) * len(spots),
    }


def picture_url(jpeg: bytes) -> str:
    """A picture as a page takes it.

    Args:
        jpeg: its content.
    """
    return f"data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}"


def show_numbers(values: Iterable[float], digits: int = 3) -> list[float | None]:
    """Numbers as JSON knows them: rounded, and nothing where there is none.

    Args:
        values: some of them NaN.
        digits: that are kept.
    """
    return [round(value, digits) if np.isfinite(value) else None for value in map(float, values)]
