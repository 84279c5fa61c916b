"""Placing pieces of a checkerboard in the reference, unless their place is ambiguous.

A piece with a code is compared with the reference in every position and orientation. Each agreeing
cell makes a position likelier, by the error rate of reading. A piece is placed if neither another
position nor a chance agreement is likely. A plain checkerboard repeats after two steps, so its
pieces are placed by corners at rest, of which a piece must have enough.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial import KDTree

from estimation.pictures.corners.board import Board, Cells, spin
from estimation.pictures.corners.fit import Corners

SMALLEST_PIECE = 9
"""Number of corners of the smallest piece that is placed."""


Misfit = Callable[[Int[np.ndarray, " k"], Float[np.ndarray, "k 2"]], float]
"""Maps numbers of markers and points that may show them [px] to a misfit [px]."""


class Plan(NamedTuple):
    """The reference as a checkerboard.

    Attributes:
        cells: its lattice, whose corners are numbers of markers.
        position: of each marker [px].
        heading: of each marker, the direction of the edge along the first coordinate [rad].
        pitch: typical distance between markers [px].
    """

    cells: Cells
    position: Float[np.ndarray, "m 2"]
    heading: Float[np.ndarray, " m"]
    pitch: float

    @property
    def coded(self) -> bool:
        """Whether enough cells carry a dot, so that the cells form a code."""
        fewest_dots = 0.1  # share of cells with a dot from which the reference has a code
        count = np.abs(self.cells.code).sum()
        return bool((self.cells.code < 0).sum() > fewest_dots * max(count, 1))


class Placed(NamedTuple):
    """The corner of a picture that shows each marker of the reference.

    Attributes:
        corner: number of the corner; −1 where not visible or uncertain.
        turn: which of the corner's four half edges leads along the reference's first coordinate.
        left_out: number of corners in pieces that could not be placed.
    """

    corner: Int[np.ndarray, " m"]
    turn: Int[np.ndarray, " m"]
    left_out: int


def place_board(plan: Plan, corners: Corners, board: Board, pieces: list[Cells]) -> Placed:
    """Place all pieces of a picture whose place is unambiguous.

    Args:
        plan: the reference.
        corners: of the picture.
        board: coordinates of the corners.
        pieces: cells of the pieces, the largest piece first.
    """
    placed = _nothing(plan)
    for cells in pieces:
        spot = _by_code(plan, cells) if plan.coded else _by_rest(plan, corners, board, cells)
        if spot is None:
            left_out = placed.left_out + int((cells.corner >= 0).sum())
            placed = placed._replace(left_out=left_out)
        else:
            _put(plan, board, cells, *spot, placed)
    return placed


def place_by_misfit(
    plan: Plan, corners: Corners, board: Board, cells: Cells, misfit: Misfit
) -> Placed | None:
    """Place a piece without a code where its misfit is smallest by far; None if there is no such.

    Args:
        plan: the reference.
        corners: of the picture.
        board: coordinates of the corners.
        cells: of the piece.
        misfit: misfit of points to markers [px].
    """
    sample = 40  # corners whose misfit is computed in each position
    clearly = 3.0  # factor by which the best position must fit better than any other
    tried, misfits = [], []
    enough = 0.5 * min((cells.corner >= 0).sum(), len(plan.position))
    for quarter in range(4):
        rows, columns = spin(cells, quarter).corner.shape
        for i in range(1 - rows, plan.cells.corner.shape[0]):
            for j in range(1 - columns, plan.cells.corner.shape[1]):
                placed = _nothing(plan)
                if not _put(plan, board, cells, quarter, np.array([i, j]), placed):
                    continue
                here = np.flatnonzero(placed.corner >= 0)
                if len(here) >= enough:
                    markers = here[:: max(len(here) // sample, 1)]
                    tried.append(placed)
                    misfits.append(misfit(markers, corners.position[placed.corner[markers]]))
    order = np.argsort(misfits)
    if not tried or (len(tried) > 1 and misfits[order[1]] < clearly * misfits[order[0]]):
        return None
    return tried[order[0]]


def _nothing(plan: Plan) -> Placed:
    count = len(plan.position)
    return Placed(np.full(count, -1), np.zeros(count, dtype=int), 0)


def _put(
    plan: Plan, board: Board, cells: Cells, quarter: int, shift: np.ndarray, placed: Placed
) -> bool:
    """Enter a piece into `placed`; false if its colours differ from the reference's there."""
    turned = spin(cells, quarter)
    if (_there(plan.cells.colour, turned.colour, shift) * turned.colour < 0).any():
        return False
    sure = _agreeing(plan, turned, shift) if plan.coded else turned.corner >= 0
    at = np.argwhere(sure) + shift
    inside = ((at >= 0) & (at < plan.cells.corner.shape)).all(axis=1)
    number = np.full(len(at), -1)
    number[inside] = plan.cells.corner[tuple(at[inside].T)]
    free = (number >= 0) & (placed.corner[number] < 0)
    corner = turned.corner[sure]
    placed.corner[number[free]] = corner[free]
    placed.turn[number[free]] = (board.turn[corner[free]] + 3 * quarter) % 4
    return True


def _there(reference: np.ndarray, cells: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Values of the reference at the cells of a shifted piece; 0 outside the reference."""
    values = np.zeros_like(cells)
    i, j = np.indices(cells.shape)
    i, j = i + shift[0], j + shift[1]
    inside = (i >= 0) & (j >= 0) & (i < reference.shape[0]) & (j < reference.shape[1])
    values[inside] = reference[i[inside], j[inside]]
    return values


def _by_code(plan: Plan, cells: Cells) -> tuple[int, np.ndarray] | None:
    """Quarter turns and shift of the one likely position; None if no or several are likely."""
    misread = 0.03  # share of cells whose dot is misread
    doubt = 1e-6  # probability of another position below which a piece is placed
    # logarithm of the likelihood ratio from which other positions are neglected in that sum
    hopeless = 50.0
    read = int(np.abs(cells.code).sum())
    reference, size = plan.cells, max(cells.code.shape)
    shape = [1 << (length + size - 2).bit_length() for length in reference.code.shape]
    ahead = np.fft.rfft2(_channels(reference), shape)
    scores, shifts = [], []
    for quarter in range(4):
        turned = spin(cells, quarter)
        product = ahead * np.conj(np.fft.rfft2(_channels(turned), shape))
        agree, shared, colour = np.rint(np.fft.irfft2(product, shape))
        score = 0.5 * (shared + agree) * np.log(1.0 - misread)
        score += 0.5 * (shared - agree) * np.log(misread) - (read - shared) * np.log(2.0)
        scores.append(np.where((colour > 0) & (shared > 0), score, -np.inf))
        shifts.append(turned.code.shape)
    scores = np.stack(scores)
    best = np.unravel_index(np.argmax(scores), scores.shape)
    quarter, shift = int(best[0]), np.array(best[1:])
    highest = scores[best]
    chance = np.exp(-read * np.log(2.0) - highest)
    near = scores[scores > highest - hopeless]
    rivals = np.exp(near - highest).sum() - 1.0
    beyond = shift > np.array(shape) - np.array(shifts[quarter])  # negative shifts wrap to the end
    return (quarter, shift - np.where(beyond, shape, 0)) if rivals + chance < doubt else None


def _channels(cells: Cells) -> Float32[np.ndarray, "3 rows columns"]:
    return np.stack([cells.code, np.abs(cells.code), cells.colour]).astype(np.float32)


def _agreeing(plan: Plan, cells: Cells, shift: np.ndarray) -> np.ndarray:
    """Corners of a placed piece next to at most one cell whose code disagrees."""
    code = _there(plan.cells.code, cells.code, shift)
    wrong = np.pad((code * cells.code < 0).astype(int), 1)
    around = wrong[:-1, :-1] + wrong[1:, :-1] + wrong[:-1, 1:] + wrong[1:, 1:]
    return (cells.corner >= 0) & (around < 2)


def _by_rest(
    plan: Plan, corners: Corners, board: Board, cells: Cells
) -> tuple[int, np.ndarray] | None:
    """Quarter turns and shift by a vote of the corners at rest; None if too few agree."""
    # largest share of a plain piece's corners at places where the reference has none
    most_strange = 0.08
    near = 0.35  # largest distance of a corner at rest from its place [pitches]
    resting = 0.3  # share of a plain piece's corners that must rest at the same shift
    members = cells.corner[cells.corner >= 0]
    off, marker = KDTree(plan.position).query(corners.position[members])
    marker = np.asarray(marker)
    votes = []
    places = np.zeros((len(plan.position), 2), dtype=int)
    at = np.argwhere(plan.cells.corner >= 0)
    places[plan.cells.corner[tuple(at.T)]] = at
    colour = np.pad(plan.cells.colour, ((0, 1), (0, 1)))[tuple(places[marker].T)]
    for quarter in range(4):
        turn = (board.turn[members] + 3 * quarter) % 4
        aside = corners.directions[members, turn] - plan.heading[marker]
        alike = np.abs(np.angle(np.exp(1j * aside))) < 0.5
        # the next cell is bright if a rising edge leads along the first coordinate
        alike &= (colour == 0) | (colour == np.where(turn % 2 == 0, 1, -1))
        rests = (np.asarray(off) < near * plan.pitch) & alike
        turned = spin(cells, quarter).corner
        here = np.argwhere(turned >= 0)
        index = np.zeros((len(corners.position), 2), dtype=int)
        index[turned[tuple(here.T)]] = here
        shift = places[marker[rests]] - index[members[rests]]
        votes.append(np.column_stack([np.full(len(shift), quarter), shift]))
    choices, count = np.unique(np.concatenate(votes), axis=0, return_counts=True)
    if not len(count):
        return None
    order = np.argsort(count)
    most, second = count[order[-1]], count[order[-2]] if len(count) > 1 else 0
    if most < max(SMALLEST_PIECE // 2, resting * len(members)) or most < 2 * second:
        return None
    quarter, shift = int(choices[order[-1], 0]), choices[order[-1], 1:]
    at = np.argwhere(spin(cells, quarter).corner >= 0) + shift
    inside = ((at >= 0) & (at < plan.cells.corner.shape)).all(axis=1)
    strange = len(at) - (plan.cells.corner[tuple(at[inside].T)] >= 0).sum()
    return None if strange > most_strange * len(at) else (quarter, shift)
