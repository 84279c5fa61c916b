"""Which dot is which: each frame matched to the reference, without continuity.

Dots of a printed lattice keep their neighbours, however far they move. A frame is matched to the
reference by that alone: dots that lie where the reference has them, and whose neighbours do too,
are the gel that nothing has moved; from there the match spreads dot by dot, each step predicted
from the neighbours found before. Earlier frames play no part, so none can mislead.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from estimation.pictures.lattice import NEAR, Reference, nearest


def match_dots(reference: Reference, centre: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " m"]:
    """The dot that each point of the reference is now, −1 where not seen.

    Args:
        reference: the reference.
        centre: dots of the frame [px].
    """
    match = grow_match(reference, centre, match_piece(reference, centre, reference.position))
    return _drop_doubtful(reference, centre, match) if (match >= 0).any() else match


def match_piece(
    reference: Reference, centre: Float[np.ndarray, "n 2"], expected: Float[np.ndarray, "m 2"]
) -> Int[np.ndarray, " m"]:
    """The largest piece of neighbours that lie where they are expected, −1 for all others.

    Args:
        reference: the reference.
        centre: dots of the frame [px].
        expected: where the points may be [px], NaN where unknown.
    """
    match = np.full(len(reference.position), -1)
    known = np.flatnonzero(np.isfinite(expected[:, 0]))
    if len(centre) < 4 or not len(known):
        return match
    off, dot = nearest(KDTree(centre), expected[known])
    back = nearest(KDTree(expected[known]), centre)[1]
    mutual = (off < NEAR * reference.pitch) & (back[dot] == np.arange(len(dot)))
    match[known[mutual]] = dot[mutual]
    return _largest_piece(reference, centre, match, expected)


def grow_match(
    reference: Reference, centre: Float[np.ndarray, "n 2"], match: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " m"]:
    """A match spread from the matched points to their neighbours, as far as it goes."""
    if (match < 0).all():
        return match
    tree = KDTree(centre)
    for _ in range(len(match)):
        grown = _spread(reference, centre, tree, match)
        if (grown == match).all():
            break
        match = grown
    return match


def _drop_doubtful(
    reference: Reference, centre: Float[np.ndarray, "n 2"], match: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " m"]:
    """Leave out dots that are not where the others have them, or nearer to another's place."""
    # farthest a dot may lie from where all its neighbours together have it [pitches]
    sure_share = 0.3
    place = predict(reference, centre, match)
    there = np.flatnonzero((match >= 0) & np.isfinite(place[:, 0]))
    if not len(there):
        return np.full_like(match, -1)
    off = np.linalg.norm(place[there] - centre[match[there]], axis=1)
    owner = there[nearest(KDTree(place[there]), centre[match[there]])[1]]
    sure = there[(owner == there) & (off < sure_share * reference.pitch)]
    kept = np.full_like(match, -1)
    kept[sure] = match[sure]
    return kept


def _largest_piece(
    reference: Reference,
    centre: Float[np.ndarray, "n 2"],
    match: Int[np.ndarray, " m"],
    expected: Float[np.ndarray, "m 2"],
) -> Int[np.ndarray, " m"]:
    """The largest set of neighbours that have kept their places to each other."""
    stretch = 0.5  # most that the vector to a neighbour may change among dots at rest [pitches]
    neighbours = reference.neighbours
    known = match >= 0
    both = (neighbours >= 0) & known[neighbours] & known[:, None]
    off = centre[match] - expected
    moved = off[neighbours] - off[:, None]
    firm = both & (np.einsum("nki,nki->nk", moved, moved) < (stretch * reference.pitch) ** 2)
    label = _label_pieces(neighbours, firm)
    largest = np.argmax(np.bincount(label[known], minlength=1))
    return np.where((label == largest) & known, match, -1)


def _label_pieces(
    neighbours: Int[np.ndarray, "m k"], joined: Bool[np.ndarray, "m k"]
) -> Int[np.ndarray, " m"]:
    """For each point the lowest number of a point that joints connect it to."""
    label = np.arange(len(neighbours))
    while True:
        lower = np.minimum(label, np.where(joined, label[neighbours], len(label)).min(axis=1))
        lower = lower[lower]  # as far as the label's own label: pieces are long
        if (lower == label).all():
            return label
        label = lower


def _spread(
    reference: Reference,
    centre: Float[np.ndarray, "n 2"],
    tree: KDTree,
    match: Int[np.ndarray, " m"],
) -> Int[np.ndarray, " m"]:
    """Match the points next to matched ones, where a free dot lies within reach of the guess."""
    free = np.ones(len(centre), dtype=bool)
    free[match[match >= 0]] = False
    known = (reference.neighbours >= 0) & (match[reference.neighbours] >= 0)
    rim = np.flatnonzero((match < 0) & (known.sum(axis=1) >= 2))
    if not (len(rim) and free.any()):
        return match
    guess = predict(reference, centre, match, rim)
    off, dot = nearest(tree, guess)
    match = match.copy()
    for k in np.argsort(off):
        if off[k] < NEAR * reference.pitch and free[dot[k]]:
            match[rim[k]] = dot[k]
            free[dot[k]] = False
    return match


def predict(
    reference: Reference,
    centre: Float[np.ndarray, "n 2"],
    match: Int[np.ndarray, " m"],
    points: Int[np.ndarray, " k"] | None = None,
) -> Float[np.ndarray, "k 2"]:
    """Where points should be, by a rotation and a strain fitted to the matched ones around each.

    The strain is held back: few points tell it badly.

    Args:
        reference: the reference.
        centre: dots of the frame [px].
        match: the dot that each point of the reference is, −1 where not known.
        points: of the reference; all by default.
    """
    # how much predictions are drawn towards no rotation and no strain, as a share of the data
    stiffness = 0.1
    points = np.arange(len(match)) if points is None else points
    around = reference.around[points]
    known = (around >= 0) & (match[around] >= 0)
    to_complex = np.array([1.0, 1.0j])
    rest, now = reference.position @ to_complex, centre[match] @ to_complex
    ahead = rest[around] - rest[points][:, None]
    weight = known / np.maximum(np.abs(ahead) ** 2, 1e-9)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    motion = np.where(known, now[around] - rest[around], 0.0)
    origin, shift = (weight * ahead).sum(axis=1), (weight * motion).sum(axis=1)
    arm, motion = ahead - origin[:, None], motion - shift[:, None]
    # normal equations of motion = turn · arm + strain · conj(arm)
    size = (weight * np.abs(arm) ** 2).sum(axis=1) * (1.0 + stiffness) + 1e-12
    mixed = (weight * np.conj(arm) ** 2).sum(axis=1)
    first = (weight * np.conj(arm) * motion).sum(axis=1)
    second = (weight * arm * motion).sum(axis=1)
    determinant = size**2 - np.abs(mixed) ** 2
    turn = (size * first - mixed * second) / determinant
    strain = (size * second - np.conj(mixed) * first) / determinant
    place = rest[points] + shift - turn * origin - strain * np.conj(origin)
    return np.stack([place.real, place.imag], axis=1)
