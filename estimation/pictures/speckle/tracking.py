"""A speckle pattern followed from picture to picture, each matched to the reference by itself.

Points of interest lie on a square lattice; what is printed around each says where it is. Where a
point may be is guessed from the picture before, from rest, from the shift of the whole, from points
next to it or from features; whether it is there only the reference tells. So no continuity is
needed, and nothing that was wrong once stays wrong.
"""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int

from estimation.pictures.part import WHOLE, Part
from estimation.pictures.speckle.seeds import FeatureSeeds, Guess, find_shift, flatten_light, stay
from estimation.pictures.speckle.subsets import (
    Match,
    Sampler,
    Subsets,
    count_clipped,
    make_subsets,
    match_subsets,
)

CLIPPED = 0.1
"""Most of a subset's pixels that may be as good as black or white [-]."""
PIECE = 4
"""Fewest points that must fit each other."""


class SpeckleStyle(NamedTuple):
    """What a speckle pattern looks like.

    Attributes:
        size: distance at which the texture's autocorrelation falls to one half [px].
        radius: half the side of a subset [px].
        pitch: of the lattice of points [px].
    """

    size: float
    radius: int
    pitch: int


class Lattice(NamedTuple):
    """Points of interest of a reference.

    Attributes:
        subsets: about each.
        number: of the point at each place of the lattice, −1 for none.
        around: the eight points next to each, −1 for none.
        left_out: how many places have no point, and why.
    """

    subsets: Subsets
    number: Int[np.ndarray, "rows columns"]
    around: Int[np.ndarray, "m 8"]
    left_out: dict[str, int]


def find_speckle_style(grey: Float32[np.ndarray, "h w"], part: Part = WHOLE) -> SpeckleStyle:
    """Size of the speckles, and of subsets that hold enough of them.

    Args:
        grey: the picture.
        part: of the sensor's pictures that it shows.

    Raises:
        ValueError: the picture has no fine texture, or one that repeats.
    """
    points = 400  # points of interest in a picture, about
    sides = 5.0  # half the side of a subset in half widths of the texture's autocorrelation
    texture = flatten_light(grey)
    padded = [cv2.getOptimalDFTSize(2 * n) for n in grey.shape]
    power = np.abs(np.fft.rfft2(texture, padded)) ** 2
    correlation = np.fft.fftshift(np.fft.irfft2(power, padded))
    middle = np.array(padded) // 2
    y, x = (np.arange(n) - m for n, m in zip(padded, middle, strict=True))
    overlap = np.maximum(1.0 - np.abs(y) / grey.shape[0], 0.0)[:, None]
    overlap = overlap * np.maximum(1.0 - np.abs(x) / grey.shape[1], 0.0)
    correlation = np.where(overlap > 0.2, correlation / np.maximum(overlap, 0.2), 0.0)
    correlation /= max(correlation[tuple(middle)], 1e-9)
    distance = np.hypot(y[:, None], x)
    rings = [correlation[(distance >= r - 0.5) & (distance < r + 0.5)].mean() for r in range(21)]
    below = np.flatnonzero(np.array(rings) < 0.5)
    if not len(below):
        raise ValueError("no fine texture: all structures are larger than 20 px")
    i = below[0]
    size = float(i - 1 + (rings[i - 1] - 0.5) / (rings[i - 1] - rings[i]))
    peak = np.where(distance > 5.0 * size, correlation, 0.0)
    if peak.max() > 0.5:
        place = np.unravel_index(np.argmax(peak), peak.shape)
        raise ValueError(
            f"the texture repeats every {distance[place]:.0f} px, so places in it are ambiguous"
        )
    radius = _unique_radius(grey, round(sides * size), part)
    pitch = max(round(float(np.sqrt(grey.size / points))), radius)
    return SpeckleStyle(size, radius, pitch)


def _unique_radius(grey: Float32[np.ndarray, "h w"], least: int, part: Part) -> int:
    """The smallest half side of subsets that are hardly found twice, and not below `least`."""
    # subsets that are looked for elsewhere, and the share that may be found, to choose their size
    fewest, rare_share = 40, 0.05
    radii = (8, 10, 12, 14, 17, 20)  # half sides of subsets to choose from [px]
    largest = radii[-1]
    low, high = np.full(2, largest), np.array(grey.shape[::-1]) - largest
    if (low >= high).any():
        return min(radii[0], min(grey.shape) // 8)
    sample = np.random.default_rng(0).integers(low, high, (fewest, 2))
    sample = sample[part.shows(sample.astype(float), float(largest))]
    sample = sample[count_clipped(grey, sample.astype(float), float(largest)) < CLIPPED]
    for radius in radii:
        if radius >= min(least, largest) and _recurs(grey, sample, radius).mean() < rare_share:
            return radius
    return largest


def lay_points(
    grey: Float32[np.ndarray, "h w"], style: SpeckleStyle, part: Part = WHOLE
) -> Lattice:
    """Points of interest wherever the picture has enough texture that is found nowhere else.

    Args:
        grey: the picture.
        style: of its speckle.
        part: of the sensor's pictures that it shows.

    Raises:
        ValueError: that is in too little of the picture.
    """
    # grey levels of noise at which a point must be found to so many px
    sensor_noise, least_error = 3.0, 0.1
    usable = 0.5  # share of the lattice that must be usable for a picture to be one of speckle [-]
    ways = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]])
    rim = style.radius + 2
    ys, xs = (
        np.arange(rim + (n - 1 - 2 * rim) % style.pitch // 2, n - rim, style.pitch)
        for n in grey.shape
    )
    x, y = np.meshgrid(xs, ys)
    centre = np.stack([x.ravel(), y.ravel()], axis=1)
    if len(centre) < 2 * PIECE:
        raise ValueError("the picture is too small for its texture")
    subsets = make_subsets(grey, centre, style.radius)
    hidden = ~part.shows(subsets.centre, np.sqrt(2.0) * style.radius)
    clipped = ~hidden & (count_clipped(grey, subsets.centre, float(style.radius)) > CLIPPED)
    error = sensor_noise * np.sqrt(subsets.unit[:, :2, :2].trace(axis1=1, axis2=2))
    faint = ~(hidden | clipped) & ((error > least_error) | _is_noise(grey, centre, style.radius))
    again = np.zeros(len(centre), dtype=bool)
    clear = np.flatnonzero(~(hidden | clipped | faint))
    again[clear] = _recurs(grey, centre[clear], style.radius)
    kept = ~(hidden | clipped | faint | again)
    left_out = {
        "hidden by the mask": int(hidden.sum()),
        "black or white": int(clipped.sum()),
        "without texture": int(faint.sum()),
        "found elsewhere too": int(again.sum()),
    }
    if kept.sum() < max(usable * (~hidden).sum(), 2 * PIECE):
        reasons = ", ".join(f"{count} {why}" for why, count in left_out.items() if count)
        raise ValueError(f"of {len(kept)} places in the picture too many are {reasons}")
    number = np.full(len(kept), -1)
    number[kept] = np.arange(kept.sum())
    number = number.reshape(len(ys), len(xs))
    padded = np.pad(number, 1, constant_values=-1)
    at = np.argwhere(number >= 0) + 1
    around = np.stack([padded[tuple((at + way).T)] for way in ways], axis=1)
    return Lattice(subsets.take(kept), number, around, left_out)


def _is_noise(
    grey: Float32[np.ndarray, "h w"], centre: Int[np.ndarray, "n 2"], radius: int
) -> Bool[np.ndarray, " n"]:
    """Whether neighbouring pixels around each point have nothing to do with each other."""
    # correlation of a pixel with the next from which there is texture rather than noise [-]
    grain = 0.3
    side, (x, y) = (2 * radius + 1,) * 2, centre.T
    texture = grey - cv2.blur(grey, side)
    beside = 0.5 * (np.roll(texture, 1, axis=0) + np.roll(texture, 1, axis=1))
    alike = cv2.blur(texture * beside, side)[y, x]
    return alike < grain * cv2.blur(texture * texture, side)[y, x]


def _recurs(
    grey: Float32[np.ndarray, "h w"], centre: Int[np.ndarray, "n 2"], radius: int
) -> Bool[np.ndarray, " n"]:
    """Whether what is about each point is found elsewhere in the picture as well, at half size."""
    # correlation of a subset with another place of the reference from which it is ambiguous [-]
    repeated = 0.75
    half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    size, found = radius // 2, []
    last = np.array(half.shape[::-1]) - size - 1
    for x, y in np.clip(centre // 2, size, last):
        template = half[y - size : y + size + 1, x - size : x + size + 1]
        score = cv2.matchTemplate(half, template, cv2.TM_CCOEFF_NORMED)
        itself = slice(max(y - 2 * size, 0), y + 1), slice(max(x - 2 * size, 0), x + 1)
        score[itself] = 0.0
        found.append(np.nanmax(np.where(np.isfinite(score), score, 0.0)) > repeated)
    return np.array(found, dtype=bool)


class SpeckleTracker:
    """Says where the points of a reference are, picture by picture.

    Attributes:
        style: what the speckles look like.
        lattice: the points.
        searched: pictures in which features had to be looked for.
    """

    def __init__(self, grey: Float32[np.ndarray, "h w"], part: Part = WHOLE) -> None:
        """Learn a reference.

        Args:
            grey: the picture.
            part: of the sensor's pictures that this and the next ones show.

        Raises:
            ValueError: it has no fine texture, a repeating one, or too little of it.
        """
        self.style, self.part = find_speckle_style(grey, part), part
        self.lattice = lay_points(grey, self.style, part)
        self.rest = flatten_light(grey)
        self.features: FeatureSeeds | None = None
        self.last: Guess | None = None
        self.searched = 0

    def find(self, grey: Float32[np.ndarray, "h w"]) -> tuple[Match, str]:
        """The points in the next picture, NaN where not recognised; and why it cannot be used."""
        firm = 0.7  # share of the points that must be recognised for no other guess to be tried [-]
        lost = 0.3  # share of the reference's points below which a picture counts as not recognised
        subsets, sampler = self.lattice.subsets, Sampler(grey)
        match = _nothing(len(subsets.centre))
        for guess in self._guesses(grey):
            match = _join(match, _follow(subsets, sampler, guess, ~match.good))
            match = self._spread(sampler, match)
            if match.good.mean() >= firm:
                break
        clipped = count_clipped(grey, match.position, float(self.style.radius)) > CLIPPED
        shown = self.part.shows(match.position, np.sqrt(2.0) * self.style.radius)
        match = _blank(match, match.good & shown & ~clipped)
        match = _blank(match, self._fits(match))
        seen = int(match.good.sum())
        self.last = Guess(match.position, match.deformation)
        if seen < max(lost * len(match.good), PIECE):
            self.last = None
            flaw = f"only {seen} of {len(match.good)} points of the speckle were recognised"
            if clipped.sum() > seen:
                flaw += f", {clipped.sum()} are nearly black or white"
            return _blank(match, np.zeros_like(match.good)), flaw
        return match, ""

    def _guesses(self, grey: Float32[np.ndarray, "h w"]) -> Iterator[Guess]:
        """Where the points may be: as before, at rest, moved with the whole, by features."""
        centre = self.lattice.subsets.centre
        if self.last is not None:
            yield self.last
        yield stay(centre, np.zeros(2))
        texture = flatten_light(grey)
        yield stay(centre, find_shift(self.rest, texture))
        if self.features is None:
            self.features = FeatureSeeds(self.rest)
        self.searched += 1
        found = self.features.guess(texture, centre)
        if found is not None:
            yield found

    def _spread(self, sampler: Sampler, match: Match) -> Match:
        """Go on from the points that are recognised to those next to them."""
        around, centre = self.lattice.around, self.lattice.subsets.centre
        fresh = match.good
        while fresh.any():
            rim = ~match.good & ((around >= 0) & fresh[around]).any(axis=1)
            known = (around >= 0) & match.good[around] & rim[:, None]
            arm = centre[:, None] - centre[around]
            shape = match.deformation[around]
            there = match.position[around] + np.einsum("nkij,nkj->nki", shape, arm)
            weight = np.where(known, 1.0, 0.0) / np.maximum(known.sum(axis=1), 1)[:, None]
            guess = Guess(
                np.einsum("nk,nki->ni", weight, np.where(known[..., None], there, 0.0)),
                np.einsum("nk,nkij->nij", weight, np.where(known[..., None, None], shape, 0.0)),
            )
            grown = _join(match, _follow(self.lattice.subsets, sampler, guess, rim))
            fresh, match = grown.good & ~match.good, grown
        return match

    def _fits(self, match: Match) -> Bool[np.ndarray, " m"]:
        """The points that lie where most of their neighbours have them, in pieces of several."""
        apart = 0.15  # farthest a point may lie from where its neighbour has it [pitches]
        around, centre = self.lattice.around, self.lattice.subsets.centre
        both = (around >= 0) & match.good[around] & match.good[:, None]
        arm = centre[:, None] - centre[around]
        mean = 0.5 * (match.deformation[:, None] + match.deformation[around])
        there = match.position[around] + np.einsum("nkij,nkj->nki", mean, arm)
        off = np.linalg.norm(match.position[:, None] - there, axis=2)
        agree = both & (off < apart * self.style.pitch)
        count = agree.sum(axis=1)
        return match.good & (count >= PIECE - 1) & (2 * count >= both.sum(axis=1))


def _follow(
    subsets: Subsets, sampler: Sampler, guess: Guess, which: Bool[np.ndarray, " n"]
) -> Match:
    """Match some of the subsets from a guess."""
    least = 0.7  # correlation with the reference from which a subset is recognised [-]
    if which.all():
        found = match_subsets(subsets, sampler, *guess)
        return _blank(found, found.good & (found.correlation > least))
    part = np.flatnonzero(which)
    found = match_subsets(
        subsets.take(part), sampler, guess.position[part], guess.deformation[part]
    )
    whole = _nothing(len(which))
    for everywhere, value in zip(whole, found, strict=True):
        everywhere[part] = value
    return _blank(whole, whole.good & (whole.correlation > least))


def _nothing(count: int) -> Match:
    """No point recognised."""
    shapes = (2,), (2, 2), (6, 6), (), ()
    return Match(*(np.full((count, *one), np.nan) for one in shapes), good=np.zeros(count, bool))


def _blank(match: Match, good: Bool[np.ndarray, " n"]) -> Match:
    """The match with only some of its points recognised."""
    values = [
        np.where(good.reshape(-1, *[1] * (value.ndim - 1)), value, np.nan) for value in match[:5]
    ]
    return Match(*values, good=good)


def _join(one: Match, other: Match) -> Match:
    """The first match, with what only the second has recognised."""
    values = [
        np.where(one.good.reshape(-1, *[1] * (first.ndim - 1)), first, second)
        for first, second in zip(one[:5], other[:5], strict=True)
    ]
    return Match(*values, good=one.good | other.good)
