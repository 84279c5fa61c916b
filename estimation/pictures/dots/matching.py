"""Matching of dots: each frame is matched to the reference without earlier frames.

Dots of a printed lattice keep their neighbours, however far they move. The match starts at gel that
has not moved: at dots that lie at their place in the reference together with their neighbours. From
there it spreads dot by dot, each dot predicted from its matched neighbours. Earlier frames are not
used, so their errors do not persist.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist

from estimation.pictures.lattice import NEAR_PITCHES, Reference, nearest


def match_dots(reference: Reference, centre: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, " m"]:
    """Match the dots of a frame to the reference.

    Args:
        reference: the reference.
        centre: dots of the frame [px].

    Returns:
        For each point of the reference, the number of its dot; −1 where not visible.
    """
    match = grow_match(reference, centre, match_piece(reference, centre, reference.position))
    return drop_doubtful(reference, centre, match)


def match_piece(
    reference: Reference, centre: Float[np.ndarray, "n 2"], expected: Float[np.ndarray, "m 2"]
) -> Int[np.ndarray, " m"]:
    """Match the largest connected piece of points whose dots lie at their expected places.

    Args:
        reference: the reference.
        centre: dots of the frame [px].
        expected: expected position of each point [px]; NaN where unknown.

    Returns:
        For each point of the reference, the number of its dot; −1 outside the piece.
    """
    match = np.full(len(reference.position), -1)
    points = np.flatnonzero(np.isfinite(expected[:, 0]))
    if len(centre) < 4 or not len(points):
        return match
    off, dot = _find_nearest(expected[points], centre)
    back = _find_nearest(centre, expected[points])[1]
    mutual = (off < NEAR_PITCHES * reference.pitch) & (back[dot] == np.arange(len(dot)))
    match[points[mutual]] = dot[mutual]
    return _largest_piece(reference, centre, match, expected)


def grow_match(
    reference: Reference, centre: Float[np.ndarray, "n 2"], match: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " m"]:
    """Extend a match from matched points to their neighbours as far as possible."""
    if (match < 0).all():
        return match
    for _ in range(len(match)):
        grown = _spread(reference, centre, match)
        if (grown == match).all():
            break
        match = grown
    return match


def drop_doubtful(
    reference: Reference, centre: Float[np.ndarray, "n 2"], match: Int[np.ndarray, " m"]
) -> Int[np.ndarray, " m"]:
    """Drop dots far from the place that their neighbours predict, or nearer to another place."""
    if (match < 0).all():
        return match
    # largest distance of a dot from the place that its neighbours predict [pitches]
    sure_share = 0.3
    place = predict(reference, centre, match)
    there = np.flatnonzero((match >= 0) & np.isfinite(place[:, 0]))
    if not len(there):
        return np.full_like(match, -1)
    off = np.linalg.norm(place[there] - centre[match[there]], axis=1)
    owner = there[_find_nearest(centre[match[there]], place[there])[1]]
    sure = there[(owner == there) & (off < sure_share * reference.pitch)]
    certain = np.full_like(match, -1)
    certain[sure] = match[sure]
    return certain


def _find_nearest(
    points: Float[np.ndarray, "k 2"], places: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " k"]]:
    """Distance from each point to the nearest place, and the number of that place."""
    few = 20_000  # pairs up to which all distances take less time than a tree
    if len(points) * len(places) > few:
        return nearest(KDTree(places), points)
    apart = cdist(points, places)
    number = apart.argmin(axis=1)
    return apart[np.arange(len(number)), number], number


def _largest_piece(
    reference: Reference,
    centre: Float[np.ndarray, "n 2"],
    match: Int[np.ndarray, " m"],
    expected: Float[np.ndarray, "m 2"],
) -> Int[np.ndarray, " m"]:
    """The largest set of connected neighbours that have kept their relative positions."""
    stretch = 0.5  # largest change of the vector to a neighbour among dots at rest [pitches]
    neighbours = reference.neighbours
    matched = match >= 0
    linked = (neighbours >= 0) & matched[neighbours] & matched[:, None]
    off = centre[match] - expected
    moved = off[neighbours] - off[:, None]
    firm = linked & (np.einsum("nki,nki->nk", moved, moved) < (stretch * reference.pitch) ** 2)
    label = _label_pieces(neighbours, firm)
    largest = np.argmax(np.bincount(label[matched], minlength=1))
    return np.where((label == largest) & matched, match, -1)


def _label_pieces(
    neighbours: Int[np.ndarray, "m k"], joined: Bool[np.ndarray, "m k"]
) -> Int[np.ndarray, " m"]:
    """Label connected points by the lowest number among them."""
    label = np.arange(len(neighbours))
    while True:
        lower = np.minimum(label, np.where(joined, label[neighbours], len(label)).min(axis=1))
        lower = lower[lower]  # jump to the label's own label, since pieces are long
        if (lower == label).all():
            return label
        label = lower


def _spread(
    reference: Reference,
    centre: Float[np.ndarray, "n 2"],
    match: Int[np.ndarray, " m"],
) -> Int[np.ndarray, " m"]:
    """Match points next to matched ones if a free dot lies near their predicted place."""
    free = np.ones(len(centre), dtype=bool)
    free[match[match >= 0]] = False
    matched = (reference.neighbours >= 0) & (match[reference.neighbours] >= 0)
    rim = np.flatnonzero((match < 0) & (matched.sum(axis=1) >= 2))
    if not (len(rim) and free.any()):
        return match
    guess = predict(reference, centre, match, rim)
    off, dot = _find_nearest(guess, centre)
    match = match.copy()
    for k in np.argsort(off):
        if off[k] < NEAR_PITCHES * reference.pitch and free[dot[k]]:
            match[rim[k]] = dot[k]
            free[dot[k]] = False
    return match


def predict(
    reference: Reference,
    centre: Float[np.ndarray, "n 2"],
    match: Int[np.ndarray, " m"],
    points: Int[np.ndarray, " k"] | None = None,
) -> Float[np.ndarray, "k 2"]:
    """Predict positions [px] of points by a rotation and strain fitted to matched points around.

    Rotation and strain are regularised, because few points determine them badly.

    Args:
        reference: the reference.
        centre: dots of the frame [px].
        match: number of each point's dot; −1 where unknown.
        points: of the reference; all by default.
    """
    # weight of the regularisation towards no rotation and no strain, relative to the data
    stiffness = 0.1
    points = np.arange(len(match)) if points is None else points
    around = reference.around[points]
    matched = (around >= 0) & (match[around] >= 0)
    to_complex = np.array([1.0, 1.0j])
    rest, now = reference.position @ to_complex, centre[match] @ to_complex
    ahead = rest[around] - rest[points][:, None]
    weight = matched / np.maximum(np.abs(ahead) ** 2, 1e-9)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    motion = np.where(matched, now[around] - rest[around], 0.0)
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
