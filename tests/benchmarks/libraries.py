"""Our functions compared with those of scikit-image, SciPy and NumPy for the same job, in one run.

`python -m tests.benchmarks.libraries`, after `pip install scikit-image`, which nothing else needs.
All inputs are rendered or drawn with known truth. Errors are root mean squares over dots or lattice
points; times are the shortest of a few laps, in processor time of one thread.
"""

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

import importlib
import time
from collections.abc import Callable
from itertools import starmap
from typing import Any, NamedTuple

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.stats import median_abs_deviation

from estimation.frames.neighbours import delaunay_neighbours
from estimation.pictures.dots.find import DotStyle, find_seeds, fit_dots
from estimation.pictures.dots.matching import _label_pieces
from estimation.pictures.hold import _take_quantiles
from estimation.pictures.imprint.registration import search_motions
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture
from estimation.pictures.lattice import fit_lattice, index_lattice
from estimation.pictures.light import to_grey
from estimation.pictures.render import Camera, render_dots
from tests.benchmarks.arguments import make_parser

LAPS = 15
RADIUS = 4.3  # of the dots [px]


class Rival(NamedTuple):
    """A function with its job's name and the measure of its error."""

    job: str
    code: str
    run: Callable[[], Any]
    error: Callable[[Any], float]


def main() -> None:
    """Print the table."""
    make_parser(__doc__).parse_args()
    cv2.setNumThreads(1)
    skimage = importlib.import_module("skimage")
    for part in ("feature", "measure", "registration", "transform"):
        importlib.import_module(f"skimage.{part}")
    table = Table("job", "function", "error", "time [ms]")
    rng = np.random.default_rng(0)
    for rivals in (seeds_and_centres, lattices, prints, helpers):
        for job, code, error, duration in starmap(measure, rivals(skimage, rng)):
            table.add_row(job, code, f"{error:.2g}", f"{1e3 * duration:.3g}")
    Console(width=110).print(table)


def measure(
    job: str, code: str, run: Callable[[], Any], error: Callable[[Any], float]
) -> tuple[str, str, float, float]:
    """A function's error and shortest time [s]."""
    found, durations = run(), []
    for _ in range(LAPS):
        start = time.process_time()
        run()
        durations.append(time.process_time() - start)
    return job, code, error(found), min(durations)


def seeds_and_centres(skimage: Any, rng: np.random.Generator) -> list[Rival]:
    """Pixels of dots, and their centres [px], in a picture of 640×480 with 300 dots."""
    grid = np.stack(np.meshgrid(np.arange(20) * 30 + 35, np.arange(15) * 30 + 30), -1)
    truth = grid.reshape(-1, 2) + rng.uniform(-0.5, 0.5, (300, 2))
    rims = np.broadcast_to(RADIUS * np.eye(2), (300, 2, 2))
    grey = to_grey(render_dots(Camera(noise=2.0), truth, rims, rng), dark=True)
    style = DotStyle(dark=True, radius=RADIUS)

    def off(found: Any) -> float:
        return float(np.sqrt(np.mean(KDTree(found).query(truth)[0] ** 2)))

    def peaks() -> Any:
        narrow = cv2.GaussianBlur(grey, (0, 0), 0.6 * RADIUS)
        response = cv2.GaussianBlur(narrow, (0, 0), 0.8 * RADIUS) - narrow
        return skimage.feature.peak_local_max(
            response, min_distance=round(RADIUS), threshold_rel=0.3
        )[:, ::-1]

    def dark() -> Any:
        byte = np.clip(grey, 0, 255).astype(np.uint8)
        return cv2.threshold(byte, 0, 1, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)

    def regions() -> Any:
        shown = skimage.measure.label(dark()[1])
        found = skimage.measure.regionprops(shown, intensity_image=grey.max() - grey)
        return np.array([one.centroid_weighted[::-1] for one in found])

    def ellipses() -> Any:
        rims = skimage.measure.find_contours(grey, dark()[0])
        fits = [skimage.measure.EllipseModel.from_estimate(rim) for rim in rims if len(rim) > 8]
        return np.array([fit.center[::-1] for fit in fits])

    at = find_seeds(grey, style)
    return [
        Rival("pixels of dots (px)", "ours (find_seeds)", lambda: find_seeds(grey, style), off),
        Rival("", "feature.peak_local_max", peaks, off),
        Rival("centres (px)", "ours (fit_dots)", lambda: fit_dots(grey, at, style).centre, off),
        Rival("", "measure.regionprops", regions, off),
        Rival("", "measure.EllipseModel", ellipses, off),
    ]


def lattices(skimage: Any, rng: np.random.Generator) -> list[Rival]:
    """A square lattice of 20 × 20 dots, a tenth of them displaced by up to half a pitch."""
    index = np.stack(np.meshgrid(np.arange(20), np.arange(20)), -1).reshape(-1, 2)
    truth = index @ np.array([[20.0, 1.0], [-1.0, 20.0]]) + 50.0
    centre = truth + rng.normal(0.0, 0.05, truth.shape)
    displaced = rng.choice(400, 40, replace=False)
    centre[displaced] += rng.uniform(-10.0, 10.0, (40, 2))
    lattice = index_lattice(centre)
    kept = ~np.isin(lattice.dot, displaced)
    points, numbers = centre[lattice.dot], lattice.coordinates.astype(float)

    def ransac() -> Any:
        model = skimage.transform.AffineTransform
        fit, _ = skimage.measure.ransac(
            (numbers, points), model, 3, 0.12 * lattice.pitch, max_trials=500, rng=0
        )
        return fit(numbers)

    def off(place: Any) -> float:
        return float(np.sqrt(np.mean((place - truth[lattice.dot])[kept] ** 2)))

    return [
        Rival(
            "lattice (px)",
            "ours (fit_lattice)",
            lambda: fit_lattice(lattice, centre).place(lattice.coordinates),
            off,
        ),
        Rival("", "measure.ransac", ransac, off),
    ]


def prints(skimage: Any, rng: np.random.Generator) -> list[Rival]:
    """A print of 160×160 px that has turned by 13° and shifted by (9, −5) px, searched anew.

    Both searches try rotations in steps of 6°; a registration refines what ours finds.
    """
    rough = cv2.GaussianBlur(rng.normal(size=(160, 160)), (0, 0), 4.0).astype(np.float32)
    y, x = np.indices(rough.shape) - 79.5
    mask = (255 * (np.hypot(x, y) < 55.0)).astype(np.uint8)
    motion = cv2.getRotationMatrix2D((79.5, 79.5), -13.0, 1.0)
    motion[:, 2] += (9.0, -5.0)
    moved = [cv2.warpAffine(one, motion, rough.shape) for one in (rough, mask)]
    before, now = Texture(rough, mask), Texture(*moved)
    settings = ImprintSettings()
    ends = np.array([[40.0, 79.5, 1.0], [120.0, 79.5, 1.0], [79.5, 40.0, 1.0]])

    def phase() -> Any:
        best, highest = motion, -np.inf
        for turn in np.arange(-settings.searched_deg, settings.searched_deg + 3.0, 6.0):
            ahead = cv2.getRotationMatrix2D((79.5, 79.5), -turn, 1.0)
            value, shown = (cv2.warpAffine(one, ahead, rough.shape) for one in (rough, mask))
            shift, _, _ = skimage.registration.phase_cross_correlation(
                now.value, value, reference_mask=now.mask > 0, moving_mask=shown > 0
            )
            ahead[:, 2] += shift[::-1]
            back = cv2.warpAffine(rough, ahead, rough.shape)
            alike = float(np.corrcoef(back[now.mask > 0], now.value[now.mask > 0])[0, 1])
            if alike > highest:
                best, highest = ahead, alike
        return best

    def warp() -> Any:
        turned = skimage.transform.EuclideanTransform(np.vstack([motion, [0.0, 0.0, 1.0]]))
        return skimage.transform.warp(rough, turned.inverse)

    def off(found: Any) -> float:
        return float(np.sqrt(np.mean((ends @ (np.asarray(found) - motion).T) ** 2)))

    def differs(picture: Any) -> float:
        return float(np.abs(picture - moved[0])[mask > 0].max())

    return [
        Rival(
            "print, searched (px)",
            "ours (search_motions)",
            lambda: search_motions(before, now, settings),
            off,
        ),
        Rival("", "registration.phase_cross_correlation", phase, off),
        Rival(
            "picture, turned",
            "OpenCV (warpAffine)",
            lambda: cv2.warpAffine(rough, motion, rough.shape),
            differs,
        ),
        Rival("", "transform.warp", warp, differs),
    ]


def helpers(skimage: Any, rng: np.random.Generator) -> list[Rival]:
    """Statistics and pieces of a frame of 400 markers; errors are differences from ours."""
    place = rng.uniform(0.0, 20.0, (400, 2))
    neighbours = delaunay_neighbours(place)
    joined = (neighbours >= 0) & (rng.uniform(size=neighbours.shape) < 0.3)
    values, weight = rng.normal(size=400), rng.uniform(size=400)
    shares = (0.25, 0.5, 0.75)
    start = np.repeat(np.arange(400), neighbours.shape[1])[joined.ravel()]

    def spread() -> Any:
        return 1.4826 * np.median(np.abs(values - np.median(values)))

    def pieces() -> Any:
        links = csr_array((np.ones(len(start)), (start, neighbours[joined])), (400, 400))
        return connected_components(links, directed=False)[1]

    both = joined | np.array(
        [[joined[j][neighbours[j] == i].any() for j in row] for i, row in enumerate(neighbours)]
    )
    ours = _label_pieces(neighbours, both)
    quantiles = np.array(_take_quantiles(values, weight, *shares))

    def weighted() -> Any:
        return np.quantile(values, shares, weights=weight, method="inverted_cdf")

    def apart(label: Any) -> float:
        pairs = np.unique(np.stack([label, ours]), axis=1).shape[1]
        return float(pairs - len(np.unique(ours)))

    def differs(found: Any) -> float:
        return float(np.abs(np.subtract(found, quantiles)).max())

    return [
        Rival("spread", "ours (NumPy)", spread, lambda found: abs(found - spread())),
        Rival(
            "",
            "stats.median_abs_deviation",
            lambda: median_abs_deviation(values, scale="normal"),
            lambda found: abs(found - spread()),
        ),
        Rival("pieces", "ours (_label_pieces)", lambda: _label_pieces(neighbours, both), apart),
        Rival("", "csgraph.connected_components", pieces, apart),
        Rival(
            "weighted quantiles",
            "ours (_take_quantiles)",
            lambda: _take_quantiles(values, weight, *shares),
            differs,
        ),
        Rival("", "numpy.quantile(weights=…)", weighted, differs),
    ]


if __name__ == "__main__":
    main()
