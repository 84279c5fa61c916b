"""The checkerboard in a picture: neighbours of its corners, and its connected pieces.

An edge leads from one corner to the next, and rises at one corner if it falls at the other. Two
corners are neighbours if each lies on an edge of the other and the two edges agree. Connected
corners form a piece. A piece with a code in its cells is placed by comparing it with the reference
in every position and all four orientations ([Li2024] IV-A asks for rigid matching), independently
of earlier frames. A piece of plain checkerboard is placed by its corners at rest.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting".
"""

from collections import deque
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from estimation.pictures.corners.fit import Corners
from estimation.pictures.corners.rings import Rings
from estimation.pictures.lattice import LATTICE_STEPS


class Board(NamedTuple):
    """Corners with lattice coordinates, piece by piece.

    Attributes:
        piece: number of each corner's piece, 0 for the largest piece; −1 for none.
        place: lattice coordinates within the corner's piece.
        turn: which of the corner's four half edges leads along the first coordinate.
    """

    piece: Int[np.ndarray, " n"]
    place: Int[np.ndarray, "n 2"]
    turn: Int[np.ndarray, " n"]


def connect_corners(corners: Corners | Rings, pitch: float) -> Board:
    """Assign lattice coordinates to corners; a corner with contradictory paths gets none.

    Args:
        corners: of a picture.
        pitch: typical distance between corners [px].
    """
    link, back = _link(corners, pitch)
    count = len(link)
    if not count:
        return Board(np.zeros(0, dtype=int), np.zeros((0, 2), dtype=int), np.zeros(0, dtype=int))
    neighbours, slots = link.tolist(), back.tolist()
    label, place, turned = [-1] * count, [(0, 0)] * count, [0] * count
    steps = [(int(a), int(b)) for a, b in LATTICE_STEPS]
    pieces = 0
    for start in np.argsort(-(link >= 0).sum(axis=1), kind="stable").tolist():
        if label[start] >= 0:
            continue
        label[start] = pieces
        queue = deque([start])
        while queue:
            i = queue.popleft()
            for way in range(4):
                slot = (turned[i] + way) % 4
                j = neighbours[i][slot]
                if j < 0 or label[j] >= 0:
                    continue
                label[j] = pieces
                place[j] = (place[i][0] + steps[way][0], place[i][1] + steps[way][1])
                turned[j] = (slots[i][slot] - way - 2) % 4
                queue.append(j)
        pieces += 1
    index, turn, piece = np.array(place), np.array(turned), np.array(label)
    piece[_contradicted(link, back, index, turn)] = -1
    wide = 2 * count + 1  # more than the range of coordinates
    _, which, same = np.unique(
        (piece * wide + index[:, 0]) * wide + index[:, 1], return_inverse=True, return_counts=True
    )
    piece[same[which] > 1] = -1
    order = np.argsort(-np.bincount(piece[piece >= 0], minlength=pieces), kind="stable")
    rank = np.empty(pieces, dtype=int)
    rank[order] = np.arange(pieces)
    return Board(np.where(piece < 0, -1, rank[piece]), index, turn)


def _link(corners: Corners | Rings, pitch: float) -> tuple[np.ndarray, np.ndarray]:
    """The neighbour along each half edge, −1 for none, and which of its half edges leads back."""
    shortest, longest = 0.45, 1.7  # distances between neighbours [pitches]
    # largest angle between a neighbour's direction and the edge that leads to it
    aside = np.radians(25.0)
    count = len(corners.position)
    link, back = np.full((count, 4), -1), np.full((count, 4), -1)
    if count < 4:
        return link, back
    distance, nearby = KDTree(corners.position).query(corners.position, min(9, count))
    distance, nearby = np.asarray(distance)[:, 1:], np.asarray(nearby)[:, 1:]
    apart = corners.position[nearby] - corners.position[:, None]
    heading = np.arctan2(apart[..., 1], apart[..., 0])
    directions = corners.directions
    out, leave = _nearest_slot(heading, directions[:, None])
    into, arrive = _nearest_slot(heading + np.pi, directions[nearby])
    fits = (out < aside) & (into < aside) & ((leave + arrive) % 2 == 1)
    fits &= (distance > shortest * pitch) & (distance < longest * pitch)
    cost = np.where(fits, distance * (1.0 + out + into), np.inf)
    rows = np.arange(count)
    for slot in range(4):
        slot_cost = np.where(leave == slot, cost, np.inf)
        best = np.argmin(slot_cost, axis=1)
        there = np.isfinite(slot_cost[rows, best])
        link[there, slot] = nearby[there, best[there]]
        back[there, slot] = arrive[there, best[there]]
    mutual = (link >= 0) & (link[link, back] == rows[:, None])
    link, back = np.where(mutual, link, -1), np.where(mutual, back, -1)
    closed = _closes(link, back, 1) | _closes(link, back, -1)
    return np.where(closed, link, -1), np.where(closed, back, -1)


def _nearest_slot(
    heading: Float[np.ndarray, "n k"], directions: Float[np.ndarray, "#n #k 4"]
) -> tuple[np.ndarray, np.ndarray]:
    """Angle between a heading and the nearest of four directions [rad], and its number."""
    off = heading[..., None] - directions
    off = np.abs(off - 2.0 * np.pi * np.rint(off / (2.0 * np.pi)))
    slot = np.argmin(off, axis=-1)
    return np.take_along_axis(off, slot[..., None], axis=-1)[..., 0], slot


def _closes(
    link: Int[np.ndarray, "n 4"], back: Int[np.ndarray, "n 4"], side: int
) -> Bool[np.ndarray, "n 4"]:
    """Whether four steps along edges, with a turn to one side after each, return to the start."""
    start, leave = np.indices(link.shape)
    at, slot, there = start, leave, np.ones(link.shape, dtype=bool)
    for _ in range(4):
        following = link[at, slot]
        there &= following >= 0
        at, slot = following, (back[at, slot] + side) % 4
    return there & (at == start) & (slot == leave)


def _contradicted(
    link: Int[np.ndarray, "n 4"],
    back: Int[np.ndarray, "n 4"],
    index: Int[np.ndarray, "n 2"],
    turn: Int[np.ndarray, " n"],
) -> Int[np.ndarray, " k"]:
    """Corners at both ends of links that contradict their coordinates."""
    i, slot = np.nonzero(link >= 0)
    j, way = link[i, slot], (slot - turn[i]) % 4
    wrong = (index[j] != index[i] + LATTICE_STEPS[way]).any(axis=1)
    wrong |= turn[j] != (back[i, slot] - way - 2) % 4
    return np.unique(np.concatenate([i[wrong], j[wrong]]))


class Cells(NamedTuple):
    """A piece of the board as arrays over its lattice.

    Attributes:
        corner: number of the corner at each lattice point; −1 for none.
        colour: of the cell that follows each point: 1 bright, −1 dark, 0 not visible.
        code: of the same cell: 1 plain, −1 with a dot, 0 not visible or uncertain.
    """

    corner: Int[np.ndarray, "rows columns"]
    colour: Int[np.ndarray, "rows-1 columns-1"]
    code: Int[np.ndarray, "rows-1 columns-1"]


def read_cells(grey: Float[np.ndarray, "h w"], corners: Corners, board: Board, piece: int) -> Cells:
    """Read colour and code of the cells between the corners of a piece."""
    unsure = 0.3  # share of half the contrast below which a cell's code is uncertain
    members = np.flatnonzero(board.piece == piece)
    index = board.place[members] - board.place[members].min(axis=0)
    corner = np.full(index.max(axis=0) + 1, -1)
    corner[tuple(index.T)] = members
    around = np.stack([corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]])
    seen = (around >= 0).all(axis=0)
    middle = corners.position[around].mean(axis=0).astype(np.float32)
    if not middle.size:
        return Cells(corner, np.zeros(seen.shape, dtype=int), np.zeros(seen.shape, dtype=int))
    value = cv2.remap(
        grey, middle[..., 0], middle[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    bright = np.where(board.turn[around[0]] % 2 == 0, 1, -1)
    off = (value - corners.level[around].mean(axis=0)) * bright
    share = off / (0.5 * corners.contrast[around].mean(axis=0))
    code = np.where(np.abs(share) < unsure, 0, np.where(share > 0, 1, -1))
    return Cells(corner, np.where(seen, bright, 0), np.where(seen, code, 0))


def spin(cells: Cells, turns: int) -> Cells:
    """Rotate a piece's coordinates by quarter turns."""
    return Cells(*(np.rot90(values, turns) for values in cells))
