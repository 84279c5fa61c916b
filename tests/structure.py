"""The imports of a package as a picture: `python -m tests.structure estimation --out picture.png`.

A room is a file or a folder of one level; it stands a floor above all that it imports.
"""

import argparse
import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

ROOT = Path(__file__).parents[1]
PACKAGES = ("contactmodel", "estimation", "calibration", "papers")
"""Packages in the order in which they may import each other."""


def is_checkout(folder: Path) -> bool:
    """Whether a folder is a checkout or an unpacked source archive, rather than a copy of tests."""
    return any((folder / name).exists() for name in (".git", *PACKAGES))


needs_sources = pytest.mark.skipif(
    not is_checkout(ROOT), reason="it reads the sources, which are not beside the tests"
)
"""Mark of tests that read sources; they run in every checkout and unpacked source archive."""

Rooms = dict[str, set[str]]
"""Rooms of a level, and the rooms of it that each imports."""


@cache
def imported_modules(path: Path) -> frozenset[str]:
    """Whole names of the modules that a file imports, and of what it imports from them."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(found)


def find_constants(path: Path) -> list[str]:
    """Names in capitals that a file assigns at its top level."""
    names = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else []
        targets = [node.target] if isinstance(node, ast.AnnAssign) else targets
        for target in targets:
            parts = target.elts if isinstance(target, ast.Tuple | ast.List) else [target]
            names += [part.id for part in parts if isinstance(part, ast.Name) and part.id.isupper()]
    return names


def find_levels(package: str) -> list[Path]:
    """The folders of a package, itself the first, from the root of the checkout."""
    folders = {path.parent for path in (ROOT / package).rglob("*.py")}
    return sorted(folder.relative_to(ROOT) for folder in folders)


def find_rooms(level: Path) -> Rooms:
    """The rooms of a level, and what they import of each other; faces are left out."""
    rooms: Rooms = {}
    for path in sorted((ROOT / level).rglob("*.py")):
        inside = path.relative_to(ROOT / level).parts
        if inside[0] in ("__init__.py", "__pycache__"):
            continue
        room = rooms.setdefault(inside[0].removesuffix(".py"), set())
        for name in imported_modules(path):
            parts = name.split(".")
            if tuple(parts[: len(level.parts)]) == level.parts and len(parts) > len(level.parts):
                room.add(parts[len(level.parts)])
    return {name: (found & set(rooms)) - {name} for name, found in rooms.items()}


def draw_rooms(level: Path) -> Figure:
    """The rooms of a level, floor by floor, and an arrow to each room that another imports.

    Raises:
        graphlib.CycleError: rooms import each other.
    """
    rooms, floors = find_rooms(level), {}
    for name in TopologicalSorter(rooms).static_order():
        floors[name] = 1 + max((floors[one] for one in rooms[name]), default=0)
    places = {}
    for floor in set(floors.values()):
        here = [name for name in floors if floors[name] == floor]
        across = (np.arange(len(here)) + 0.5) / len(here)
        places |= {name: (x, floor) for name, x in zip(here, across, strict=True)}
    figure, axis = plt.subplots(figsize=(10, 1.0 + 0.9 * max(floors.values())))
    for name, imports in rooms.items():
        for other in imports:
            arrow = {"arrowstyle": "->", "color": "0.7", "shrinkA": 12, "shrinkB": 12}
            axis.annotate("", places[other], places[name], arrowprops=arrow)
    for name, place in places.items():
        is_folder = (ROOT / level / name).is_dir()
        box = {"boxstyle": "round", "fc": "#d4ecd0" if is_folder else "white", "ec": "0.4"}
        axis.text(*place, name, ha="center", va="center", bbox=box)
    axis.set(xlim=(0, 1), ylim=(0.5, max(floors.values()) + 0.5), title=level.as_posix())
    axis.axis("off")
    return figure


def main() -> None:
    """Draw the package or folder that was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("level", type=Path, help="a package, or a folder of it")
    parser.add_argument("--out", type=Path, default=Path("structure.png"), help="the picture")
    arguments = parser.parse_args()
    draw_rooms(arguments.level).savefig(arguments.out, dpi=130)


if __name__ == "__main__":
    main()
