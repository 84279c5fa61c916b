"""Tracking of a speckle pattern; each picture is matched to the reference independently.

Points of interest lie on a square lattice, and are recognised by the print around them. The place
of a point is guessed from the previous picture, from rest, from the shift of the whole picture,
from neighbouring points or from features. The guess is confirmed by the reference alone. The method
therefore needs no continuity, and errors do not persist.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from estimation.frames.state import WithoutCaches
from estimation.pictures.part import Part
from estimation.pictures.speckle.seeds import FeatureSeeds, Guess, find_shift, flatten_light, stay
from estimation.pictures.speckle.subsets import (
    Match,
    Sampler,
    Subsets,
    count_clipped,
    make_subsets,
    match_subsets,
)

MOST_CLIPPED = 0.1
"""Largest share of a subset's pixels that may be nearly black or white [-]."""
FEWEST_AGREEING = 4
"""Least number of neighbouring points that must agree with each other."""


class SpeckleStyle(NamedTuple):
    """Appearance of a speckle pattern, and the lattice of points on it.

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
        centre: of the points [px].
        number: of the point at each place of the lattice; −1 for none.
        around: the eight points next to each point; −1 for none.
        left_out: number of places without a point, by reason.
    """

    centre: Float[np.ndarray, "m 2"]
    number: Int[np.ndarray, "rows columns"]
    around: Int[np.ndarray, "m 8"]
    left_out: dict[str, int]


def find_speckle_style(grey: Float32[np.ndarray, "h w"], part: Part = Part()) -> SpeckleStyle:
    """Estimate the size of the speckles, and choose subsets that contain enough of them.

    Args:
        grey: the picture, 0 to 255.
        part: the part of the sensor's pictures that is read.

    Raises:
        ValueError: the picture has no fine texture, or its texture repeats.
    """
    points = 400  # approximate number of points of interest in a picture
    sides = 5.0  # half side of a subset, in half widths of the texture's autocorrelation
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
        raise ValueError("the texture is not fine: all structures are larger than 20 px")
    i = below[0]
    size = float(i - 1 + (rings[i - 1] - 0.5) / (rings[i - 1] - rings[i]))
    peak = np.where(distance > 5.0 * size, correlation, 0.0)
    if peak.max() > 0.5:
        place = np.unravel_index(np.argmax(peak), peak.shape)
        raise ValueError(
            f"the texture repeats every {distance[place]:.0f} px, so points on it are ambiguous"
        )
    radius = _unique_radius(grey, round(sides * size), part)
    pitch = max(round(float(np.sqrt(grey.size / points))), radius)
    return SpeckleStyle(size, radius, pitch)


def _unique_radius(grey: Float32[np.ndarray, "h w"], least: int, part: Part) -> int:
    """The smallest half side, from `least` on, of subsets that rarely recur in the picture."""
    # number of subsets that are searched elsewhere, and the largest share that may recur
    fewest, rare_share = 40, 0.05
    radii = (8, 10, 12, 14, 17, 20)  # candidate half sides [px]
    largest = radii[-1]
    low, high = np.full(2, largest), np.array(grey.shape[::-1]) - largest
    if (low >= high).any():
        return min(radii[0], min(grey.shape) // 8)
    sample = np.random.default_rng(0).integers(low, high, (fewest, 2))
    sample = sample[part.shows(sample.astype(float), float(largest))]
    sample = sample[count_clipped(grey, sample.astype(float), float(largest)) < MOST_CLIPPED]
    if not len(sample):
        return largest
    for radius in radii:
        if radius >= min(least, largest) and _recurs(grey, sample, radius).mean() < rare_share:
            return radius
    return largest


def lay_points(
    grey: Float32[np.ndarray, "h w"], style: SpeckleStyle, part: Part = Part()
) -> Lattice:
    """Lay points of interest wherever the picture has enough texture that is unique.

    Args:
        grey: the picture, 0 to 255.
        style: appearance of its speckle.
        part: the part of the sensor's pictures that is read.

    Raises:
        ValueError: too few places of the picture are usable.
    """
    # noise [grey levels] for which a point's error must stay below a limit [px]
    sensor_noise, least_error = 3.0, 0.1
    usable = 0.5  # least share of the lattice that must be usable [-]
    ways = np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]])
    rim = style.radius + 2
    ys, xs = (
        np.arange(rim + (n - 1 - 2 * rim) % style.pitch // 2, n - rim, style.pitch)
        for n in grey.shape
    )
    x, y = np.meshgrid(xs, ys)
    centre = np.stack([x.ravel(), y.ravel()], axis=1)
    if len(centre) < 2 * FEWEST_AGREEING:
        raise ValueError(
            f"the picture has room for {len(centre)} points of its texture; at least "
            f"{2 * FEWEST_AGREEING} are needed"
        )
    subsets = make_subsets(grey, centre, style.radius)
    hidden = ~part.shows(subsets.centre, np.sqrt(2.0) * style.radius)
    clipped = ~hidden & (count_clipped(grey, subsets.centre, float(style.radius)) > MOST_CLIPPED)
    error = sensor_noise * np.sqrt(subsets.unit[:, :2, :2].trace(axis1=1, axis2=2))
    faint = ~(hidden | clipped) & ((error > least_error) | _is_noise(grey, centre, style.radius))
    again = np.zeros(len(centre), dtype=bool)
    textured = np.flatnonzero(~(hidden | clipped | faint))
    again[textured] = _recurs(grey, centre[textured], style.radius)
    clear = ~(hidden | clipped | faint | again)
    left_out = {
        "hidden by the mask": int(hidden.sum()),
        "black or white": int(clipped.sum()),
        "without texture": int(faint.sum()),
        "ambiguous": int(again.sum()),
    }
    if clear.sum() < max(usable * (~hidden).sum(), 2 * FEWEST_AGREEING):
        reasons = ", ".join(f"{count} {why}" for why, count in left_out.items() if count)
        raise ValueError(f"too many of {len(clear)} places in the picture are unusable: {reasons}")
    number = np.full(len(clear), -1)
    number[clear] = np.arange(clear.sum())
    number = number.reshape(len(ys), len(xs))
    padded = np.pad(number, 1, constant_values=-1)
    at = np.argwhere(number >= 0) + 1
    around = np.stack([padded[tuple((at + way).T)] for way in ways], axis=1)
    return Lattice(subsets.centre[clear], number, around, left_out)


def _is_noise(
    grey: Float32[np.ndarray, "h w"], centre: Int[np.ndarray, "n 2"], radius: int
) -> Bool[np.ndarray, " n"]:
    """Whether neighbouring pixels around each point are uncorrelated."""
    # least correlation of neighbouring pixels in a texture; below, they are noise [-]
    grain = 0.3
    side, (x, y) = (2 * radius + 1,) * 2, centre.T
    texture = grey - cv2.blur(grey, side)
    shifted = 0.5 * (np.roll(texture, 1, axis=0) + np.roll(texture, 1, axis=1))
    covariance = cv2.blur(texture * shifted, side)[y, x]
    return covariance < grain * cv2.blur(texture * texture, side)[y, x]


def _recurs(
    grey: Float32[np.ndarray, "h w"], centre: Int[np.ndarray, "n 2"], radius: int
) -> Bool[np.ndarray, " n"]:
    """Whether the print around each point recurs elsewhere in the picture, at half size."""
    # least correlation of a subset with another place for it to count as ambiguous [-]
    repeated = 0.75
    half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    size, ambiguous = radius // 2, []
    last = np.array(half.shape[::-1]) - size - 1
    for x, y in np.clip(centre // 2, size, last):
        template = half[y - size : y + size + 1, x - size : x + size + 1]
        score = cv2.matchTemplate(half, template, cv2.TM_CCOEFF_NORMED)
        itself = slice(max(y - 2 * size, 0), y + 1), slice(max(x - 2 * size, 0), x + 1)
        score[itself] = 0.0
        ambiguous.append(np.nanmax(np.where(np.isfinite(score), score, 0.0)) > repeated)
    return np.array(ambiguous, dtype=bool)


class SpeckleTracker(WithoutCaches):
    """Locates the points of a reference in each picture.

    Attributes:
        style: appearance of the speckle.
        part: the part of the sensor's pictures that all pictures show.
        lattice: the points.
        reference: grey levels of the reference, 0 to 255.
        last: the points in the last picture; None if they were not recognised.
        searched: number of pictures in which features were needed.
    """

    def __init__(self, grey: Float32[np.ndarray, "h w"], part: Part = Part()) -> None:
        """Make the reference from a picture.

        Args:
            grey: the picture, 0 to 255.
            part: the part of the sensor's pictures that all pictures show.

        Raises:
            ValueError: the picture has no fine texture, a repeating texture, or too little texture.
        """
        self.style, self.part = find_speckle_style(grey, part), part
        self.lattice = lay_points(grey, self.style, part)
        self.reference = grey
        self.last: Guess | None = None
        self.searched = 0

    @cached_property
    def subsets(self) -> Subsets:
        """The subset around each point."""
        return make_subsets(self.reference, self.lattice.centre.astype(int), self.style.radius)

    @cached_property
    def _flat(self) -> Float32[np.ndarray, "h w"]:
        """The reference with flattened light."""
        return flatten_light(self.reference)

    @cached_property
    def _features(self) -> FeatureSeeds:
        return FeatureSeeds(self._flat)

    def find(self, grey: Float32[np.ndarray, "h w"]) -> tuple[Match, str]:
        """Locate the points in the next picture.

        Returns:
            The points, NaN where not recognised; and why the picture cannot be used, empty if it
            can.
        """
        firm = 0.7  # share of recognised points from which no other guess is tried [-]
        lost = 0.3  # share of recognised points below which the picture cannot be used [-]
        subsets, sampler = self.subsets, Sampler(grey)
        match = _nothing(len(subsets.centre))
        for guess in self._guesses(grey):
            match = _join(match, _follow(subsets, sampler, guess, ~match.good))
            match = self._spread(sampler, match)
            if match.good.mean() >= firm:
                break
        clipped = count_clipped(grey, match.position, float(self.style.radius)) > MOST_CLIPPED
        shown = self.part.shows(match.position, np.sqrt(2.0) * self.style.radius)
        match = _blank(match, match.good & shown & ~clipped)
        match = _blank(match, self._fits(match))
        seen = int(match.good.sum())
        self.last = Guess(match.position, match.deformation)
        if seen < max(lost * len(match.good), FEWEST_AGREEING):
            self.last = None
            flaw = f"only {seen} of {len(match.good)} points of the speckle were recognised"
            if clipped.sum() > seen:
                flaw += f", {clipped.sum()} are nearly black or white"
            return _blank(match, np.zeros_like(match.good)), flaw
        return match, ""

    def _guesses(self, grey: Float32[np.ndarray, "h w"]) -> Iterator[Guess]:
        """Guesses: as in the last picture, at rest, shifted with the whole, by features."""
        centre = self.lattice.centre
        if self.last is not None:
            yield self.last
        yield stay(centre, np.zeros(2))
        texture = flatten_light(grey)
        yield stay(centre, find_shift(self._flat, texture))
        self.searched += 1
        guess = self._features.guess(texture, centre)
        if guess is not None:
            yield guess

    def _spread(self, sampler: Sampler, match: Match) -> Match:
        """Extend a match from recognised points to the points next to them."""
        around, centre = self.lattice.around, self.lattice.centre
        fresh = match.good
        while fresh.any():
            rim = ~match.good & ((around >= 0) & fresh[around]).any(axis=1)
            linked = (around >= 0) & match.good[around] & rim[:, None]
            arm = centre[:, None] - centre[around]
            shape = match.deformation[around]
            there = match.position[around] + np.einsum("nkij,nkj->nki", shape, arm)
            weight = np.where(linked, 1.0, 0.0) / np.maximum(linked.sum(axis=1), 1)[:, None]
            guess = Guess(
                np.einsum("nk,nki->ni", weight, np.where(linked[..., None], there, 0.0)),
                np.einsum("nk,nkij->nij", weight, np.where(linked[..., None, None], shape, 0.0)),
            )
            grown = _join(match, _follow(self.subsets, sampler, guess, rim))
            fresh, match = grown.good & ~match.good, grown
        return match

    def _fits(self, match: Match) -> Bool[np.ndarray, " m"]:
        """Whether each point lies where most of its neighbours predict it, at least three."""
        apart = 0.15  # largest distance of a point from its neighbour's prediction [pitches]
        around, centre = self.lattice.around, self.lattice.centre
        linked = (around >= 0) & match.good[around] & match.good[:, None]
        arm = centre[:, None] - centre[around]
        mean = 0.5 * (match.deformation[:, None] + match.deformation[around])
        there = match.position[around] + np.einsum("nkij,nkj->nki", mean, arm)
        off = np.linalg.norm(match.position[:, None] - there, axis=2)
        agree = linked & (off < apart * self.style.pitch)
        count = agree.sum(axis=1)
        return match.good & (count >= FEWEST_AGREEING - 1) & (2 * count >= linked.sum(axis=1))


def _follow(
    subsets: Subsets, sampler: Sampler, guess: Guess, which: Bool[np.ndarray, " n"]
) -> Match:
    """Match the chosen subsets from a guess."""
    least = 0.7  # least correlation of a recognised subset with the reference [-]
    if which.all():
        match = match_subsets(subsets, sampler, *guess)
        return _blank(match, match.good & (match.correlation > least))
    part = np.flatnonzero(which)
    match = match_subsets(
        subsets.take(part), sampler, guess.position[part], guess.deformation[part]
    )
    whole = _nothing(len(which))
    for everywhere, value in zip(whole, match, strict=True):
        everywhere[part] = value
    return _blank(whole, whole.good & (whole.correlation > least))


def _nothing(count: int) -> Match:
    """A match without recognised points."""
    shapes = (2,), (2, 2), (6, 6), (), ()
    values = (np.full((count, *shape), np.nan) for shape in shapes)
    return Match(*values, good=np.zeros(count, bool))


def _blank(match: Match, good: Bool[np.ndarray, " n"]) -> Match:
    """The match with only the good points recognised."""
    values = [
        np.where(good.reshape(-1, *[1] * (value.ndim - 1)), value, np.nan) for value in match[:5]
    ]
    return Match(*values, good=good)


def _join(one: Match, other: Match) -> Match:
    """The first match, completed by points that only the second one has recognised."""
    values = [
        np.where(one.good.reshape(-1, *[1] * (first.ndim - 1)), first, second)
        for first, second in zip(one[:5], other[:5], strict=True)
    ]
    return Match(*values, good=one.good | other.good)
