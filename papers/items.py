"""The papers and studies, and their items.

An item is a module with up to four functions. `compute(quick, track)` returns the result.
`tables(result)` returns tables, each under the suffix of its file name. `plot(result)` returns a
figure. `numbers(result)`, only for published numbers, returns ours by the quantity's name in
`published.csv`. With `quick`, a few draws are computed instead of all; `track` wraps the outermost
loop to show progress.
"""

import hashlib
from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path

Track = Callable[[Iterable], Iterable]

ITEMS = {
    "li2024": ("method", "fig6", "fig7b", "fig8b", "fig9b", "error_comparison", "section_vi"),
    "model_error": (
        "equation2",
        "equation14",
        "equation15",
        "rotation_forms",
        "stencil_bias",
        "reversals",
        "marker_depth",
        "large_strain",
    ),
    "marker_images": (
        "dots",
        "corners",
        "speckle",
        "pivots",
        "clips",
        "registered",
        "changed",
        "states",
        "rendered",
    ),
    "slip_lifts": ("lifts", "worst", "onset", "virtual", "again"),
    "finite_strain": (
        "atlas",
        "factors",
        "field_fits",
        "fields",
        "reference",
        "samples",
        "soft",
        "solids",
        "torsion",
    ),
    "softness": ("virtual", "layered", "fields", "pivot", "branch", "press"),
    "virtual_pivots": (
        "accuracy",
        "reversal",
        "elongated",
        "margin",
        "rendered",
        "slides",
        "few_markers",
        "assumptions",
        "sheared",
        "contact_edge",
    ),
}
"""Items of each paper: modules of its package."""

EXTRAS = {
    ("li2024", "fig9b"): "sweeps",
    ("li2024", "error_comparison"): "sweeps",
    ("model_error", "equation14"): "sweeps",
    ("marker_images", "clips"): "video",
    ("marker_images", "registered"): "video",
    ("marker_images", "changed"): "video",
    ("marker_images", "states"): "video",
    ("softness", "layered"): "sweeps",
    ("finite_strain", "reference"): "finite-elements",
    ("finite_strain", "samples"): "finite-elements",
    ("finite_strain", "solids"): "finite-elements",
    ("finite_strain", "torsion"): "finite-elements",
}
"""The extra that an item requires, by paper and item; the other items require none."""

STUDIES = ("papers.li2024.lifts", "papers.model_error.atlas", "papers.softness.contacts")
"""Modules whose cases `python -m papers sweep` evaluates."""


def choose_items(paper: str | None, item: str | None) -> list[tuple[str, str]]:
    """Pairs of paper and item to compute; without a paper or item, all of them.

    Raises:
        ValueError: the paper or the item does not exist.
    """
    if paper is not None and paper not in ITEMS:
        raise ValueError(f"unknown paper {paper!r}; choose from {', '.join(ITEMS)}")
    if paper is not None and item is not None and item not in ITEMS[paper]:
        raise ValueError(f"{paper} has no item {item!r}; it has {', '.join(ITEMS[paper])}")
    return [
        (name, part)
        for name, parts in ITEMS.items()
        for part in parts
        if paper in (None, name) and item in (None, part)
    ]


def hash_code(module: str, packages: Iterable[str], given: bytes = b"") -> str:
    """Hash of a module and of all of some packages, and of what else a result depends on."""
    files = [Path(import_module(module).__file__ or "")]
    for package in packages:
        files += sorted(Path(import_module(package).__file__ or "").parent.rglob("*.py"))
    digest = hashlib.sha256(given)
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
