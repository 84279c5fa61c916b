"""Where pieces of a checkerboard belong in the reference, or that it cannot be told.

A piece with a code is compared with the reference in every position and orientation. Every cell
that agrees makes a position likelier, by the error rate of reading; a piece is placed where no
other position, and no chance, is likely. A plain checkerboard is the same after two steps: there
only corners that rest can tell, and enough of a piece must.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.spatial import KDTree

from estimation.pictures.corners.board import Board, Cells, spin
from estimation.pictures.corners.fit import Corners

SMALLEST = 9
"""Corners of the smallest piece that is placed."""


Misfit = Callable[[Int[np.ndarray, " k"], Float[np.ndarray, "k 2"]], float]
"""Takes numbers of markers and points that may be them [px] to how badly they fit [px]."""


class Plan(NamedTuple):
    """The reference as a checkerboard.

    Attributes:
        cells: its lattice; corners are numbers of markers.
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
        """Whether enough cells carry a dot."""
        fewest_dots = 0.1  # share of the reference's cells with a dot from which it has a code
        known = np.abs(self.cells.code).sum()
        return bool((self.cells.code < 0).sum() > fewest_dots * max(known, 1))


class Placed(NamedTuple):
    """Which corner each marker of the reference is.

    Attributes:
        corner: numbers, −1 where not seen or not sure.
        turn: which of the corner's four half edges leads along the reference's first coordinate.
        left_out: corners in pieces that could not be placed.
    """

    corner: Int[np.ndarray, " m"]
    turn: Int[np.ndarray, " m"]
    left_out: int


def place_board(plan: Plan, corners: Corners, board: Board, pieces: list[Cells]) -> Placed:
    """Place every piece that can be.

    Args:
        plan: the reference.
        corners: of the picture.
        board: their coordinates.
        pieces: their cells, the largest piece first.
    """
    placed = _nothing(plan)
    for cells in pieces:
        found = _by_code(plan, cells) if plan.coded else _by_rest(plan, corners, board, cells)
        if found is None:
            left_out = placed.left_out + int((cells.corner >= 0).sum())
            placed = placed._replace(left_out=left_out)
        else:
            _put(plan, board, cells, *found, placed)
    return placed


def place_by_misfit(
    plan: Plan, corners: Corners, board: Board, cells: Cells, misfit: Misfit
) -> Placed | None:
    """Place a piece where something else than its code fits best, by far; None where nothing does.

    Args:
        plan: the reference.
        corners: of the picture.
        board: their coordinates.
        cells: of the piece.
        misfit: how badly points fit markers [px].
    """
    sample = 40  # corners whose misfit is computed in each position
    clearly = 3.0  # factor by which the best position must fit better than any other
    found, best = [], []
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
                    some = here[:: max(len(here) // sample, 1)]
                    found.append(placed)
                    best.append(misfit(some, corners.position[placed.corner[some]]))
    order = np.argsort(best)
    if not found or (len(found) > 1 and best[order[1]] < clearly * best[order[0]]):
        return None
    return found[order[0]]


def _nothing(plan: Plan) -> Placed:
    count = len(plan.position)
    return Placed(np.full(count, -1), np.zeros(count, dtype=int), 0)


def _put(
    plan: Plan, board: Board, cells: Cells, quarter: int, shift: np.ndarray, placed: Placed
) -> bool:
    """Enter a piece at its place; whether its colours are the reference's there."""
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
    """Values of the reference where cells of a shifted piece lie; 0 beyond it."""
    other = np.zeros_like(cells)
    i, j = np.indices(cells.shape)
    i, j = i + shift[0], j + shift[1]
    inside = (i >= 0) & (j >= 0) & (i < reference.shape[0]) & (j < reference.shape[1])
    other[inside] = reference[i[inside], j[inside]]
    return other


def _by_code(plan: Plan, cells: Cells) -> tuple[int, np.ndarray] | None:
    """Quarter turns and shift of the one likely position, None where there is not just one."""
    misread = 0.03  # share of cells whose dot is read wrongly
    doubt = 1e-6  # probability of another position below which a piece is placed
    # logarithm of how much less likely a position must be to be left out of that sum
    hopeless = 50.0
    known = int(np.abs(cells.code).sum())
    reference, size = plan.cells, max(cells.code.shape)
    shape = [1 << (one + size - 2).bit_length() for one in reference.code.shape]
    ahead = np.fft.rfft2(_channels(reference), shape)
    scores, shifts = [], []
    for quarter in range(4):
        turned = spin(cells, quarter)
        product = ahead * np.conj(np.fft.rfft2(_channels(turned), shape))
        agree, both, colour = np.rint(np.fft.irfft2(product, shape))
        score = 0.5 * (both + agree) * np.log(1.0 - misread)
        score += 0.5 * (both - agree) * np.log(misread) - (known - both) * np.log(2.0)
        scores.append(np.where((colour > 0) & (both > 0), score, -np.inf))
        shifts.append(turned.code.shape)
    scores = np.stack(scores)
    best = np.unravel_index(np.argmax(scores), scores.shape)
    quarter, shift = int(best[0]), np.array(best[1:])
    highest = scores[best]
    chance = np.exp(-known * np.log(2.0) - highest)
    near = scores[scores > highest - hopeless]
    others = np.exp(near - highest).sum() - 1.0
    beyond = shift > np.array(shape) - np.array(shifts[quarter])  # shifts below 0 come last
    return (quarter, shift - np.where(beyond, shape, 0)) if others + chance < doubt else None


def _channels(cells: Cells) -> Float32[np.ndarray, "3 rows columns"]:
    return np.stack([cells.code, np.abs(cells.code), cells.colour]).astype(np.float32)


def _agreeing(plan: Plan, cells: Cells, shift: np.ndarray) -> np.ndarray:
    """Corners of a placed piece, less those around which two cells or more are of another code."""
    other = _there(plan.cells.code, cells.code, shift)
    wrong = np.pad((other * cells.code < 0).astype(int), 1)
    around = wrong[:-1, :-1] + wrong[1:, :-1] + wrong[:-1, 1:] + wrong[1:, 1:]
    return (cells.corner >= 0) & (around < 2)


def _by_rest(
    plan: Plan, corners: Corners, board: Board, cells: Cells
) -> tuple[int, np.ndarray] | None:
    """Quarter turns and shift that most resting corners agree on, None where too few do."""
    # share of a plain piece's corners that may lie where the reference has none
    most_strange = 0.08
    near = 0.35  # farthest that a corner at rest may lie from its place [pitches]
    resting = 0.3  # share of a plain piece's corners that must rest, all of them alike
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
        # the cell beyond: bright where a rising edge leads along the first coordinate
        alike &= (colour == 0) | (colour == np.where(turn % 2 == 0, 1, -1))
        rests = (np.asarray(off) < near * plan.pitch) & alike
        turned = spin(cells, quarter).corner
        here = np.argwhere(turned >= 0)
        mine = np.zeros((len(corners.position), 2), dtype=int)
        mine[turned[tuple(here.T)]] = here
        shift = places[marker[rests]] - mine[members[rests]]
        votes.append(np.column_stack([np.full(len(shift), quarter), shift]))
    choices, count = np.unique(np.concatenate(votes), axis=0, return_counts=True)
    if not len(count):
        return None
    order = np.argsort(count)
    most, second = count[order[-1]], count[order[-2]] if len(count) > 1 else 0
    if most < max(SMALLEST // 2, resting * len(members)) or most < 2 * second:
        return None
    quarter, shift = int(choices[order[-1], 0]), choices[order[-1], 1:]
    at = np.argwhere(spin(cells, quarter).corner >= 0) + shift
    inside = ((at >= 0) & (at < plan.cells.corner.shape)).all(axis=1)
    strange = len(at) - (plan.cells.corner[tuple(at[inside].T)] >= 0).sum()
    return None if strange > most_strange * len(at) else (quarter, shift)
