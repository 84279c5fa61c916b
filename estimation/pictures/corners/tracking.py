"""Tracking of x-corners; each picture is placed in the reference independently of the others."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from estimation.pictures.corners.board import Board, Cells, connect_corners, read_cells
from estimation.pictures.corners.fit import (
    Corners,
    CornerStyle,
    find_corners,
    find_rings,
    fit_corners,
)
from estimation.pictures.corners.placing import (
    SMALLEST_PIECE,
    Misfit,
    Placed,
    Plan,
    place_board,
    place_by_misfit,
)
from estimation.pictures.lattice import Lattice, fit_lattice, lattice_neighbours
from estimation.pictures.light import to_light
from estimation.pictures.lines import straighten_edges
from estimation.pictures.part import Part


class Seen(NamedTuple):
    """The reference's corners in a picture; NaN where not visible.

    Attributes:
        position: of each corner [px].
        variance: of the position per coordinate [px²].
        heading: directions of the edges along the two lattice coordinates [rad].
        heading_variance: of the mean of the two directions [rad²].
        flaw: why the picture cannot be used; empty if it can.
    """

    position: Float[np.ndarray, "m 2"]
    variance: Float[np.ndarray, " m"]
    heading: Float[np.ndarray, "m 2"]
    heading_variance: Float[np.ndarray, " m"]
    flaw: str = ""


class CornerTracker:
    """Locates the reference's corners in each picture.

    Attributes:
        style: appearance of the corners.
        plan: the reference.
        rest: the corners of the reference.
        note: origin of the reference, in a sentence.
        neighbours: of each corner, before and after it on one line, then on the other; −1 for none.
        part: the part of the sensor's pictures that is read.
    """

    def __init__(
        self, style: CornerStyle, plan: Plan, rest: Seen, note: str, part: Part = Part()
    ) -> None:
        """Start with a reference."""
        self.style, self.plan, self.rest, self.note, self.part = style, plan, rest, note, part
        self.neighbours = lattice_neighbours(plan.cells.corner)

    @classmethod
    def learn(
        cls, picture: Shaped[np.ndarray, "h w *colour"], unloaded: bool = False, part: Part = Part()
    ) -> "CornerTracker":
        """Detect the corners in a picture and make the reference.

        Args:
            picture: of the sensor.
            unloaded: whether the picture is known to be unloaded.
            part: the part of the sensor's pictures that all pictures show.

        Raises:
            ValueError: the picture shows no checkerboard.
        """
        grey = to_light(picture)
        style = find_corner_style(grey)
        corners, board, pieces = _look(grey, style, part)
        if not pieces:
            raise ValueError(
                f"fewer than {SMALLEST_PIECE} complete corners of a checkerboard were detected"
            )
        cells = pieces[0]
        index = np.argwhere(cells.corner >= 0)
        members = cells.corner[tuple(index.T)]
        number = np.full(cells.corner.shape, -1)
        number[tuple(index.T)] = np.arange(len(index))
        rest, note = _rest(corners.take(members), board.turn[members], index, unloaded)
        plan = Plan(cells._replace(corner=number), rest.position, rest.heading[:, 0], style.pitch)
        return cls(style, plan, rest, note, part)

    def from_aside(
        self, picture: Shaped[np.ndarray, "h w *colour"], misfit: Misfit
    ) -> "CornerTracker":
        """Make a tracker of the same corners in another view of the reference.

        Corners that the other view does not show have no position in its reference.

        Args:
            picture: the other view, taken together with the reference.
            misfit: misfit of the other view's points to markers, used for patterns without a code.

        Raises:
            ValueError: the view shows no checkerboard, or its pattern fits nowhere or in several
                places.
        """
        grey = to_light(picture)
        style = find_corner_style(grey)
        corners, board, pieces = _look(grey, style)
        if self.plan.coded:
            placed = place_board(self.plan, corners, board, pieces)
        else:
            placed = place_by_misfit(self.plan, corners, board, pieces[0], misfit)
        if placed is None or (placed.corner >= 0).sum() < SMALLEST_PIECE:
            raise ValueError(
                "the pattern in the two views cannot be matched: it fits nowhere, or in several "
                "places equally well"
            )
        rest = _everywhere(corners, placed)
        plan = Plan(self.plan.cells, rest.position, rest.heading[:, 0], style.pitch)
        return CornerTracker(style, plan, rest, self.note)

    def take(self, kept: Bool[np.ndarray, " m"]) -> "CornerTracker":
        """Make a tracker of the corners where `kept` is true."""
        number = np.where(kept, np.cumsum(kept) - 1, -1)
        corner = self.plan.cells.corner
        cells = self.plan.cells._replace(corner=np.where(corner >= 0, number[corner], -1))
        position, variance, heading, heading_variance = (part[kept] for part in self.rest[:4])
        rest = Seen(position, variance, heading, heading_variance)
        plan = Plan(cells, rest.position, rest.heading[:, 0], self.plan.pitch)
        return CornerTracker(self.style, plan, rest, self.note)

    def find(self, picture: Shaped[np.ndarray, "h w *colour"]) -> Seen:
        """Locate the reference's corners in the next picture."""
        # share of the reference's corners below which the pattern counts as not recognised
        lost = 0.3
        grey = to_light(picture)
        corners, board, pieces = _look(grey, self.style, self.part)
        placed = place_board(self.plan, corners, board, pieces)
        here = placed.corner >= 0
        if here.sum() >= max(lost * len(here), SMALLEST_PIECE):
            return self._straighten(grey, corners, placed)
        flaw = f"only {here.sum()} of {len(here)} corners were recognised"
        if placed.left_out:
            flaw += f"; {placed.left_out} more lie in pieces whose place is ambiguous"
        nowhere = placed._replace(corner=np.full_like(placed.corner, -1))
        return _everywhere(corners, nowhere)._replace(flaw=flaw)

    def _straighten(
        self, grey: Float32[np.ndarray, "h w"], corners: Corners, placed: Placed
    ) -> Seen:
        """The markers in a picture, corrected for the curvature of their edges.

        The shift by curved edges grows with the square of the window. Corners with a large shift
        are fitted again in a smaller window, although its noise is larger.
        """
        # shift by curved edges from which a corner is fitted again in a smaller window [px]
        most_bent = 0.02
        # pitch that sets the smaller window: as a share of the pattern's, and at least [px]
        smaller, least = 0.55, 10.0
        seen = _everywhere(corners, placed)
        position = self._unbend(seen, self.style)
        shift = np.linalg.norm(position - seen.position, axis=1)
        bent = np.flatnonzero(np.nan_to_num(shift) > most_bent)
        small = self.style._replace(pitch=max(smaller * self.style.pitch, least))
        again = placed.corner[bent]
        fitted = fit_corners(grey, corners.take(again), small)
        good = np.linalg.norm(fitted.position - corners.position[again], axis=1) < 0.1 * small.pitch
        good &= fitted.is_explained & np.isfinite(fitted.covariance).all(axis=(1, 2))
        for whole, part in zip(corners, fitted, strict=True):
            whole[again[good]] = part[good]
        seen = _everywhere(corners, placed)
        position[bent[good]] = self._unbend(seen, small)[bent[good]]
        return seen._replace(position=position)

    def _unbend(self, seen: Seen, style: CornerStyle) -> Float[np.ndarray, "m 2"]:
        return straighten_edges(self.neighbours, seen.position, seen.heading, style.radius)

    def describe(self) -> str:
        """Remarks on the pattern and the identification of its markers, in sentences."""
        pattern = (
            f"{len(self.plan.position)} x-corners, {self.plan.pitch:.1f} px apart, "
            f"blur {self.style.blur:.2f} px. "
        )
        if self.plan.coded:
            return pattern + "The cells carry a code, so each piece of the pattern is identified."
        return pattern + (
            "The cells carry no code, so the pattern repeats and is identified by its corners at "
            "rest. A jump of the whole view by two cells between pictures goes unnoticed."
        )


def find_corner_style(grey: Float32[np.ndarray, "h w"], covered: float = 0.2) -> CornerStyle:
    """Estimate pitch and blur of the checkerboard in a picture.

    Args:
        grey: the picture, 0 to 255.
        covered: least share of the picture that the checkerboard must cover.

    Raises:
        ValueError: the picture shows no checkerboard.
    """
    fewest = 12  # corners in one piece for a picture to count as a checkerboard
    pitches = (23.0, 15.0, 10.0, 34.0)  # distances between corners that are tried [px]
    best, most = None, 0
    for pitch in pitches:
        style: CornerStyle | None = CornerStyle(pitch)
        board = connect_corners(find_rings(grey, style), pitch)
        if (board.piece == 0).sum() < fewest:
            continue  # without a fit
        for _ in range(2):
            style = style and _refined(grey, style, fewest)
        if style is None:
            continue
        corners = find_corners(grey, style)
        count = len(corners.position)
        hull = cv2.convexHull(corners.position.astype(np.float32)) if count else None
        if hull is not None and count > most and cv2.contourArea(hull) > covered * grey.size:
            best, most = style, count
    if best is None:
        raise ValueError(
            "no checkerboard was found in the first usable frame: the sensor has no continuous "
            "marker pattern, or its corners are less than 8 px apart"
        )
    return best


def _refined(
    grey: Float32[np.ndarray, "h w"], style: CornerStyle, fewest: int
) -> CornerStyle | None:
    """The style of the largest piece found with another style; None for fewer corners."""
    corners = find_corners(grey, style)
    board = connect_corners(corners, style.pitch)
    whole = np.flatnonzero(board.piece == 0)
    if len(whole) < fewest:
        return None
    pitch = _pitch(corners.position[whole], board.place[whole])
    return CornerStyle(pitch, float(np.median(corners.blur[whole])))


def _pitch(position: Float[np.ndarray, "n 2"], index: Int[np.ndarray, "n 2"]) -> float:
    """Mean distance between lattice neighbours [px], from the area of a cell."""
    terms = np.column_stack([np.ones(len(index)), index])
    affine = np.linalg.lstsq(terms, position, rcond=None)[0][1:]
    return float(np.sqrt(abs(np.linalg.det(affine))))


def _seen(corners: Corners, turn: Int[np.ndarray, " n"]) -> Seen:
    """Positions of corners, and directions of their edges along the lattice coordinates."""
    rows = np.arange(len(turn))
    directions = corners.directions
    heading = np.stack([directions[rows, turn], directions[rows, (turn + 1) % 4]], axis=1)
    return Seen(
        position=corners.position,
        variance=0.5 * np.einsum("nii->n", corners.covariance[:, :2, :2]),
        heading=heading,
        heading_variance=0.25 * corners.covariance[:, 2:, 2:].sum(axis=(1, 2)),
    )


def _look(
    grey: Float32[np.ndarray, "h w"], style: CornerStyle, part: Part = Part()
) -> tuple[Corners, Board, list[Cells]]:
    """Corners of a picture, their coordinates, and the cells of every large enough piece."""
    corners = find_corners(grey, style)
    corners = corners.take(part.shows(corners.position, style.radius))
    board = connect_corners(corners, style.pitch)
    sizes = np.bincount(board.piece[board.piece >= 0], minlength=1)
    pieces = [
        read_cells(grey, corners, board, int(piece))
        for piece in np.flatnonzero(sizes >= SMALLEST_PIECE)
    ]
    return corners, board, pieces


def _everywhere(corners: Corners, placed: Placed) -> Seen:
    """The markers of the reference in a picture; NaN where not visible."""
    here = placed.corner >= 0
    seen = _seen(corners.take(placed.corner[here]), placed.turn[here])
    parts = [np.full((len(here), *part.shape[1:]), np.nan) for part in seen[:4]]
    for whole, part in zip(parts, seen[:4], strict=True):
        whole[here] = part
    position, variance, heading, heading_variance = parts
    return Seen(position, variance, heading, heading_variance)


def _rest(
    corners: Corners, turn: Int[np.ndarray, " m"], index: Int[np.ndarray, "m 2"], unloaded: bool
) -> tuple[Seen, str]:
    """The corners at rest, measured or on a fitted lattice; and a note on their origin."""
    # share of the corners on a regular lattice from which a picture counts as unloaded
    rests = 0.95
    seen = _seen(corners, turn)
    if unloaded:
        return seen, "The reference is the frame that was given."
    pitch = _pitch(corners.position, index)
    fitted = fit_lattice(Lattice(np.arange(len(index)), index, pitch), corners.position)
    if fitted.on.mean() > rests:
        note = "The reference is an unloaded frame: its corners lie on a regular lattice."
        return seen, note
    if fitted.on.sum() < 15 or fitted.on.mean() < 0.3:
        note = (
            f"The clip starts loaded, and only {fitted.on.sum()} of {len(index)} corners lie on a "
            "regular lattice: the first frame is the reference, and angles count from it."
        )
        return seen, note
    place = fitted.place(index)
    edges = [
        fitted.place(index + step) - fitted.place(index - step) for step in np.eye(2, dtype=int)
    ]
    heading = np.stack([np.arctan2(edge[:, 1], edge[:, 0]) for edge in edges], axis=1)
    variance = np.zeros(len(index))
    note = (
        f"The clip starts loaded: the reference is a regular lattice, fitted to {fitted.on.sum()} "
        f"of {len(index)} corners of the first frame, away from contact."
    )
    return Seen(place, variance, heading, variance), note
