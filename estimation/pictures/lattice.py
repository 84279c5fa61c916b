"""Lattice coordinates of dots, and the reference from which displacements are measured."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from estimation.frames.neighbours import delaunay_neighbours
from estimation.frames.recording import MarkerLayout

NEAR_PITCHES = 0.4
"""Largest distance of a dot from its expected position [pitches]; half a pitch is ambiguous."""
LATTICE_STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""Steps to the next points of a square lattice: ahead along each axis, then back."""


class Lattice(NamedTuple):
    """Dots with integer lattice coordinates.

    Attributes:
        dot: numbers of the dots that have coordinates.
        coordinates: lattice coordinates of these dots.
        pitch: distance between neighbours [px].
    """

    dot: Int[np.ndarray, " m"]
    coordinates: Int[np.ndarray, "m 2"]
    pitch: float


def index_lattice(centre: Float[np.ndarray, "n 2"]) -> Lattice:
    """Assign integer coordinates to dots, neighbour by neighbour from the most regular place.

    Dots that continue no row get no coordinates. A dot keeps the coordinates of the first path that
    reaches it, and no two dots share coordinates.
    """
    nothing = Lattice(np.zeros(0, dtype=int), np.zeros((0, 2), dtype=int), np.nan)
    if len(centre) < 9:
        return nothing
    candidates = 12  # nearest dots among which the next dot of a row is searched
    tree = KDTree(centre)
    distance, near = nearest(tree, centre, min(candidates + 1, len(centre)))
    pitch = float(np.median(distance[:, 1:4]))
    vectors = centre[near[:, 1:5]] - centre[:, None]
    short = vectors[distance[:, 1:5] < 1.4 * pitch]
    basis = _common_basis(short, pitch)
    if basis is None:
        return nothing
    spots = centre[:, None] + LATTICE_STEPS @ basis
    off = nearest(tree, spots.reshape(-1, 2))[0].reshape(len(centre), 4)
    start = int(np.argmin(np.sort(off, axis=1)[:, 3]))
    place, local = centre @ np.array([1.0, 1.0j]), np.zeros((len(centre), 2), dtype=complex)
    front, local[start] = np.array([start]), basis @ np.array([1.0, 1.0j])
    number = {start: (0, 0)}
    taken, steps = {(0, 0)}, LATTICE_STEPS.tolist()
    while len(front):
        around, row = near[front], np.arange(len(front))[:, None]
        ahead = place[front, None] + local[front] @ LATTICE_STEPS.T
        off = np.abs(place[around][:, None] - ahead[:, :, None])
        closest = off.argmin(axis=2)
        close = off[row, np.arange(4), closest] < NEAR_PITCHES * pitch
        following, links = around[row, closest], list[tuple[int, int, int]]()
        for k, step in np.argwhere(close).tolist():
            i, j = int(front[k]), int(following[k, step])
            index = (number[i][0] + steps[step][0], number[i][1] + steps[step][1])
            if index not in taken and j not in number:
                number[j] = index
                taken.add(index)
                links.append((i, j, step))
        behind, front, step = np.array(links, dtype=int).reshape(-1, 3).T
        local[front] = local[behind]
        half = 0.5 * LATTICE_STEPS[step].sum(axis=1) * (place[front] - place[behind])
        local[front, step % 2] = 0.5 * local[front, step % 2] + half
    dots = np.array(sorted(number))
    return Lattice(dots, np.array([number[i] for i in dots]), pitch)


def _common_basis(
    vectors: Float[np.ndarray, "m 2"], pitch: float
) -> Float[np.ndarray, "2 2"] | None:
    """The two most common vectors between neighbours that are not parallel to each other."""
    vectors = np.where(
        (vectors[:, :1] + 1e-3 * vectors[:, 1:] < 0), -vectors, vectors
    )  # one vector of each opposite pair
    if len(vectors) < 8:
        return None
    signed = np.concatenate([vectors, -vectors])
    popular = KDTree(signed).query_ball_point(vectors, 0.15 * pitch, return_length=True)
    popular = np.asarray(popular)  # the opposite vectors have the same counts
    first = _mean_near(signed, vectors[np.argmax(popular)], 0.15 * pitch)
    length = np.linalg.norm(first)
    if length == 0.0:  # opposite vectors, too short to be distinguished
        return None
    across = np.abs(first[0] * vectors[:, 1] - first[1] * vectors[:, 0]) / length
    popular = np.where(across > 0.6 * pitch, popular, 0)
    if popular.max() < 4:
        return None
    second = _mean_near(signed, vectors[np.argmax(popular)], 0.15 * pitch)
    if abs(first[0]) < abs(second[0]):
        first, second = second, first
    return np.stack([first * np.sign(first[0]), second * np.sign(second[1])])


def nearest(tree: KDTree, points: np.ndarray, count: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Distances to the nearest points of the tree, and the numbers of those points."""
    distance, number = tree.query(points, count)
    return np.asarray(distance), np.asarray(number)


def _mean_near(vectors: np.ndarray, target: np.ndarray, radius: float) -> np.ndarray:
    return vectors[np.linalg.norm(vectors - target, axis=1) < radius].mean(axis=0)


class Fitted(NamedTuple):
    """A regular lattice fitted to dots.

    Attributes:
        coefficients: of 1, i, j, i², ij, j² for x and y [px]; a lens bends the rows a little.
        on: which dots lie on the lattice.
    """

    coefficients: Float[np.ndarray, "6 2"]
    on: Bool[np.ndarray, " m"]

    def place(self, index: Int[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
        """Positions of lattice points [px]."""
        return _terms(index) @ self.coefficients


def fit_lattice(lattice: Lattice, centre: Float[np.ndarray, "n 2"]) -> Fitted:
    """Fit a regular lattice to as many dots as possible, by random samples.

    Each sample of three dots, neither in a row nor next to each other, determines an affine
    lattice.
    """
    fit = 0.06  # largest distance of a dot that lies on the lattice [pitches]
    points, terms = centre[lattice.dot], _terms(lattice.coordinates)
    rng = np.random.default_rng(0)
    best = np.zeros(len(points), dtype=bool)
    for _ in range(500):
        sample = rng.choice(len(points), 3, replace=False)
        design = terms[sample][:, :3]
        if abs(np.linalg.det(design)) < 4.0:
            continue
        off = np.linalg.norm(
            points - terms[:, :3] @ np.linalg.solve(design, points[sample]), axis=1
        )
        on = off < 2.0 * fit * lattice.pitch
        if on.sum() > best.sum():
            best = on
    columns = 6 if best.sum() >= 20 else 3
    coefficients = np.zeros((6, 2))
    for _ in range(10):
        if best.sum() < 6:
            break
        coefficients[:columns] = np.linalg.lstsq(
            terms[best][:, :columns], points[best], rcond=None
        )[0]
        best = np.linalg.norm(points - terms @ coefficients, axis=1) < fit * lattice.pitch
    return Fitted(coefficients, best)


def _terms(index: Int[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 6"]:
    i, j = index.T.astype(float)
    return np.stack([np.ones_like(i), i, j, i * i, i * j, j * j], axis=1)


class Irregularity(NamedTuple):
    """Distances of dots from rows bent only by a lens.

    Attributes:
        largest: largest distance of a dot [pitches]; infinite if fewer than 30 are visible.
        mean: root mean square of all distances [pitches].
    """

    largest: float
    mean: float

    @property
    def rests(self) -> bool:
        """Whether the distances are small enough for an unloaded gel."""
        return self.largest < 0.065 and self.mean < 0.02


def leave_cubic(
    at: Float[np.ndarray, "n 2"], values: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "n k"]:
    """What the cubic in two coordinates that fits values best leaves of them.

    Args:
        at: the coordinates, which differ by about 1.
        values: at these coordinates.
    """
    i, j = (at - at.mean(axis=0)).T
    terms = np.stack([i**a * j**b for a in range(4) for b in range(4 - a)], axis=1)
    return values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0]


def find_irregularity(lattice: Lattice, position: Float[np.ndarray, "n 2"]) -> Irregularity:
    """Measure how far dots, at least 30, are from a lattice bent only by a lens.

    The cubic that is fitted describes a lens's distortion to first order, and errors of print and
    mounting.

    Args:
        lattice: of the dots at rest or nearly so.
        position: of all dots [px]; NaN where not visible.
    """
    place = position[lattice.dot]
    seen = np.isfinite(place[:, 0])
    if seen.sum() < 30:
        return Irregularity(np.inf, np.inf)
    index = lattice.coordinates[seen] / np.abs(lattice.coordinates).max()
    cubic = 10  # terms that are fitted
    squared = (leave_cubic(index, place[seen]) ** 2).sum(axis=1) / lattice.pitch**2
    mean = squared.sum() / (len(squared) - cubic)
    return Irregularity(float(np.sqrt(squared.max())), float(np.sqrt(mean)))


class Reference(NamedTuple):
    """The dots at rest, from which displacements are measured.

    Attributes:
        position: of each dot [px].
        neighbours: of each dot; −1 for none.
        around: the nearest other dots of each dot, nearest first; −1 beyond 2.3 pitches.
        pitch: distance between neighbours [px].
        note: origin of the reference, in a sentence.
        doubt: possible error of each position [px]; None if the positions were measured.
        strained: whether these are the dots of a loaded gel, for want of others.
    """

    position: Float[np.ndarray, "n 2"]
    neighbours: Int[np.ndarray, "n k"]
    around: Int[np.ndarray, "n a"]
    pitch: float
    note: str
    doubt: Float[np.ndarray, " n"] | None = None
    strained: bool = False

    def layout(self, mm_per_px: float, origin: Float[np.ndarray, " 2"]) -> MarkerLayout:
        """The reference as a recording's layout.

        Args:
            mm_per_px: scale [mm/px].
            origin: position of these pictures' first pixel in the recording's pictures [px].
        """
        return MarkerLayout(mm_per_px * (self.position + origin), self.neighbours)


def make_reference(
    centre: Float[np.ndarray, "n 2"], size: tuple[int, int], unloaded: bool = False
) -> Reference:
    """Make the reference from the dots of one frame.

    If nearly all dots lie on a regular lattice, or `unloaded` is true, the frame is unloaded and
    its dots are the reference. Otherwise a lattice is fitted to the dots that lie on one, and its
    points are the reference for all dots. If too few dots lie on a lattice, the frame itself is
    the reference, and only changes since this frame are measured.

    Args:
        centre: dots [px].
        size: width and height of the picture [px].
        unloaded: whether the frame is known to be unloaded.

    Raises:
        ValueError: too few dots lie on a lattice.
    """
    # error of a fitted lattice point at a dot that is off the lattice [pitches]
    least_doubt = 0.15
    lattice = index_lattice(centre)
    if len(lattice.dot) < 9:
        raise ValueError(
            f"{len(lattice.dot)} dots lie in rows, at least 9 are needed: does this sensor have "
            "printed dots? (--marker)"
        )
    fitted = fit_lattice(lattice, centre)
    share = fitted.on.mean()
    doubt = None
    if unloaded or share > 0.95:
        position, note = (
            centre[lattice.dot],
            "The dots of the first frame lie on a regular lattice, so this frame counts as "
            "unloaded. If something already touched the pad, angles and contact count from it."
            if not unloaded
            else "The reference is the frame that was given.",
        )
    elif fitted.on.sum() >= 15 and share >= 0.3:
        index = _inside(fitted, lattice, size)
        rest = lattice.coordinates[fitted.on]
        same = (index[:, None] == rest).all(axis=2)
        position = fitted.place(index)
        doubt = np.where(same.any(axis=1), 0.0, least_doubt * lattice.pitch)
        note = (
            f"The clip starts loaded: the reference is a regular lattice, fitted to "
            f"{fitted.on.sum()} of {len(fitted.on)} dots of the first frame, away from contact. "
            "Dots that were not found are filled in."
        )
    else:
        position = centre[lattice.dot]
        note = (
            f"The clip starts loaded, and only {fitted.on.sum()} of {len(fitted.on)} dots lie on "
            "a regular lattice: the first frame is the reference, and angles count from it."
        )
        return lay_reference(position, note)._replace(strained=True)
    return lay_reference(position, note, doubt)


def lay_reference(
    position: Float[np.ndarray, "n 2"], note: str, doubt: Float[np.ndarray, " n"] | None = None
) -> Reference:
    """Make the reference from positions of dots at rest.

    Args:
        position: of each dot [px].
        note: origin of the reference, in a sentence.
        doubt: possible error of each position [px]; None if the positions were measured.

    Raises:
        ValueError: there are fewer than three dots, or all are on one line.
    """
    most_around = 12  # nearest dots that may help
    reach = 2.3  # distance up to which dots help to predict the position of another [pitches]
    neighbours = delaunay_neighbours(position, 1.3)
    count = min(most_around + 1, len(position))
    distance, around = nearest(KDTree(position), position, count)
    pitch = float(np.median(distance[:, 1:4]))
    around = np.where(distance < reach * pitch, around, -1)[:, 1:]
    return Reference(position, neighbours, around, pitch, note, doubt)


def find_rows(reference: Reference) -> Int[np.ndarray, "m 3"]:
    """A neighbour of a dot, the dot, and the neighbour on its other side; −1 for none."""
    off = 0.4  # largest distance of that neighbour from a straight row [pitches]
    place, near = reference.position, reference.neighbours
    dot, which = np.nonzero(near >= 0)
    before = near[dot, which]
    ahead = 2.0 * place[dot] - place[before]
    apart = np.linalg.norm(place[near[dot]] - ahead[:, None], axis=2)
    apart[(near[dot] < 0) | (apart > off * reference.pitch)] = np.inf
    nearest_one = apart.argmin(axis=1)
    after = np.where(np.isfinite(apart.min(axis=1)), near[dot, nearest_one], -1)
    return np.stack([before, dot, after], axis=1)


def continue_rows(
    place: Float[np.ndarray, "n 2"], rows: Int[np.ndarray, "m 3"]
) -> Float[np.ndarray, "k 2"]:
    """Places where rows go on, by their last two visible dots, without a visible dot [px].

    Args:
        place: of the dots [px]; NaN where not visible.
        rows: as from `find_rows`.
    """
    before, dot, after = rows.T
    ahead = 2.0 * place[dot] - place[before]
    missing = (after < 0) | np.isnan(place[after, 0])
    return ahead[missing & np.isfinite(ahead[:, 0])]


def _inside(fitted: Fitted, lattice: Lattice, size: tuple[int, int]) -> Int[np.ndarray, "k 2"]:
    """Coordinates of all lattice points in the picture and of all detected dots."""
    low, high = lattice.coordinates.min(axis=0) - 1, lattice.coordinates.max(axis=0) + 2
    grid = np.stack(np.meshgrid(*map(np.arange, low, high), indexing="ij"), -1).reshape(-1, 2)
    place = fitted.place(grid)
    inside = ((place >= 0) & (place <= np.array(size) - 1)).all(axis=1)
    return np.unique(np.concatenate([grid[inside], lattice.coordinates]), axis=0)


def lattice_neighbours(corner: Int[np.ndarray, "rows columns"]) -> Int[np.ndarray, "m 4"]:
    """Neighbours of each corner: before and after it on one line, then on the other; −1 for none.

    Args:
        corner: number of the corner at each lattice point; −1 for none.
    """
    padded = np.pad(corner, 1, constant_values=-1)
    at = np.argwhere(corner >= 0) + 1
    around = [padded[tuple((at + step).T)] for step in LATTICE_STEPS[[2, 0, 3, 1]]]
    neighbours = np.full((len(at), 4), -1)
    neighbours[corner[tuple((at - 1).T)]] = np.stack(around, axis=1)
    return neighbours
