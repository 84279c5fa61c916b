"""A simulation described by a TOML file, run step by step into a folder.

The file has units in its keys; `examples/` next to this module holds some with comments. Every step
is a file of its own, so that a run that was interrupted goes on where it stopped.
"""

import csv
import hashlib
import os
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from contactmodel import plots
from contactmodel.bodies import AbstractBody, HalfSpace, Layer, Rigid
from contactmodel.grid import Grid
from contactmodel.indenters import (
    AbstractIndenter,
    Cylinder,
    Domed,
    Ellipsoid,
    HeightMap,
    Paraboloid,
    Placed,
    RoundPunch,
    Sphere,
    SquarePunch,
)
from contactmodel.pose import Pose, make_path
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_contact

SHAPES: dict[str, tuple[type[AbstractIndenter], tuple[str, ...]]] = {
    "paraboloid": (Paraboloid, ("radius",)),
    "sphere": (Sphere, ("radius",)),
    "cylinder": (Cylinder, ("radius",)),
    "ellipsoid": (Ellipsoid, ("semi_axes",)),
    "round_punch": (RoundPunch, ("radius", "edge_radius")),
    "square_punch": (SquarePunch, ("width", "edge_radius")),
}
EXAMPLES = resources.files("contactmodel") / "examples"


@dataclass(frozen=True)
class Simulation:
    """What a configuration file asks for.

    Attributes:
        text: the file, and below it the hashes of the maps that it names.
        grid: cells.
        elastomer: S.
        object_: B.
        indenter: shape of B, where it touches.
        path: motion of B.
        friction_coefficient: μ, a number or a map of the grid [-].
        marker_depth: below the elastomer's surface, where `u_marker` is written [mm].
    """

    text: str
    grid: Grid
    elastomer: AbstractBody
    object_: AbstractBody
    indenter: AbstractIndenter
    path: Pose
    friction_coefficient: float | np.ndarray
    marker_depth: float

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.path.approach)


def read_simulation(path: str | Path) -> Simulation:
    """Read a configuration file, or a shipped example by its name.

    Raises:
        FileNotFoundError: neither a file nor an example, or a map that it names is not there.
        ValueError: keys that are missing, unknown or have wrong values.
    """
    example = EXAMPLES / f"{path}.toml"
    if not Path(path).is_file() and not example.is_file():
        names = sorted(item.name.removesuffix(".toml") for item in EXAMPLES.iterdir())
        raise FileNotFoundError(f"no file {path}; shipped examples are {', '.join(names)}")
    source = Path(path) if Path(path).is_file() else example
    text = source.read_text(encoding="utf-8")
    try:
        return _parse(text, _Maps(Path(path).parent))
    except KeyError as error:
        raise ValueError(f"{path}: the key {error} is missing") from error
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def run_simulation(simulation: Simulation, folder: Path) -> Iterator[tuple[int, ContactSolution]]:
    """Solve step by step, write each, and go on from what the folder already holds.

    A step whose file is damaged is solved again.

    Yields:
        Number of the step, from 1, and its contact.

    Raises:
        ValueError: the folder is a file, or holds another simulation.
        RuntimeError: a step that failed.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file; choose a folder to write to")
    steps = folder / "steps"
    steps.mkdir(parents=True, exist_ok=True)
    copy = folder / "config.toml"
    if copy.is_file() and copy.read_text(encoding="utf-8") != simulation.text:
        raise ValueError(f"{folder} holds another simulation; choose an empty folder")
    _write(copy, lambda part: part.write_text(simulation.text, encoding="utf-8"))
    last: ContactSolution | None = None
    for index in range(len(simulation)):
        file = steps / f"{index + 1:04d}.npz"
        done = _load_if_whole(simulation, file)
        if done is None:
            try:
                done = _solve(simulation, index, last)
            except RuntimeError as error:
                raise RuntimeError(f"step {index + 1} of {len(simulation)}: {error}") from error
            save_step(simulation, done, file)
        last = done
        yield index + 1, last


def write_results(path: ContactSolution, folder: Path) -> None:
    """Write the table of the path, and pictures of it and of its last contact.

    Args:
        path: the contacts, steps along the first axis.
        folder: where to write `path.csv` and the pictures.
    """
    _write(folder / "path.csv", lambda part: _write_table(path, part))
    last = path.at_step(-1)
    pictures: dict[str, Figure] = {
        "pressure": plots.plot_pressure(last),
        "traction": plots.plot_traction(last),
        "stick_slip": plots.plot_states(last),
        "slip": plots.plot_slip(last),
        "path": plots.plot_path(path),
    }
    for name, figure in pictures.items():
        _write(folder / f"{name}.png", lambda part, f=figure: f.savefig(part, dpi=150))


def save_step(simulation: Simulation, solution: ContactSolution, file: Path) -> None:
    """Write the arrays of a contact under their names, and `u_marker`.

    That is the displacement of the elastomer at the markers' depth under the cells [mm].
    """
    leaves = jax.tree_util.tree_leaves_with_path(solution)
    arrays: dict[str, Any] = {_key(path): np.asarray(leaf) for path, leaf in leaves}
    arrays["u_marker"] = np.asarray(solution.elastomer_displacement(simulation.marker_depth))
    _write(file, lambda part: np.savez_compressed(part, **arrays))


def load_step(simulation: Simulation, file: Path) -> ContactSolution:
    """Read what `save_step` has written."""
    skeleton = eqx.filter_eval_shape(lambda: _solve(simulation, 0, None))
    leaves, tree = jax.tree_util.tree_flatten_with_path(skeleton)
    with file.open("rb") as stream, np.load(stream) as arrays:  # closes a damaged file, too
        return jax.tree.unflatten(tree, [jnp.asarray(arrays[_key(path)]) for path, _ in leaves])


def _load_if_whole(simulation: Simulation, file: Path) -> ContactSolution | None:
    """A step that was solved before, if its file is there and can be read."""
    try:
        return load_step(simulation, file)
    except (FileNotFoundError, EOFError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None


def _solve(simulation: Simulation, index: int, previous: ContactSolution | None) -> ContactSolution:
    return solve_contact(
        simulation.elastomer,
        simulation.object_,
        simulation.indenter,
        jax.tree.map(lambda leaf: leaf[index], simulation.path),
        simulation.grid,
        simulation.friction_coefficient,
        previous=previous,
    )


class _Maps:
    """Reads the maps that a configuration names, and notes their hashes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.hashes = ""

    def read(self, name: str) -> np.ndarray:
        """An array from a `.npy` file, its place relative to the configuration."""
        file = self.folder / name
        try:
            values = np.asarray(np.load(file), dtype=float)
        except ValueError as error:
            raise ValueError(f"{name} is no .npy file of numbers ({error})") from error
        self.hashes += f"# {name}: sha256 {hashlib.sha256(file.read_bytes()).hexdigest()}\n"
        return values


def _parse(text: str, maps: _Maps) -> Simulation:
    known = {"grid", "elastomer", "object", "indenter", "contact", "motion"}
    tables = _only(tomllib.loads(text), "the file", known)
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise ValueError(f"{name} must be a table, [{name}], got {table!r}")
    grid = _only(tables["grid"], "grid", {"cells", "size_mm"})
    cells, size = _list(grid, "cells", "xy"), _list(grid, "size_mm", "xy")
    friction = _friction(tables["contact"], maps)
    indenter = _indenter(tables["indenter"], tables["elastomer"], maps)
    return Simulation(
        text=text + maps.hashes,
        grid=Grid(_whole(cells), (float(size[0]), float(size[1]))),
        elastomer=_body(tables["elastomer"], "elastomer", {"dome_radius_mm", "marker_depth_mm"}),
        object_=_body(tables["object"], "object", set()) if tables["object"] else Rigid(),
        indenter=indenter,
        path=_path(tables["motion"]),
        friction_coefficient=friction,
        marker_depth=_number({"marker_depth_mm": 0.0} | tables["elastomer"], "marker_depth_mm"),
    )


def _friction(table: dict[str, Any], maps: _Maps) -> float | np.ndarray:
    _only(table, "contact", {"friction_coefficient", "friction_coefficient_file"})
    if "friction_coefficient_file" in table:
        return maps.read(table["friction_coefficient_file"])
    return _number(table, "friction_coefficient")


def _body(table: dict[str, Any], name: str, others: set[str]) -> HalfSpace | Layer:
    """A layer where a thickness is given, else a half-space."""
    _only(table, name, {"shear_modulus_mpa", "poisson_ratio", "thickness_mm", *others})
    material = _number(table, "shear_modulus_mpa"), _number(table, "poisson_ratio")
    if "thickness_mm" in table:
        return Layer(*material, _number(table, "thickness_mm"))
    return HalfSpace(*material)


def _indenter(table: dict[str, Any], elastomer: dict[str, Any], maps: _Maps) -> AbstractIndenter:
    place = {"position_mm": [0.0, 0.0], "angle_deg": 0.0} | table
    angle = np.radians(_number(place, "angle_deg"))
    placed = Placed(_shape(table, maps), _list(place, "position_mm", "xy"), angle)
    if "dome_radius_mm" not in elastomer:
        return placed
    return Domed(placed, _number(elastomer, "dome_radius_mm"))


def _shape(table: dict[str, Any], maps: _Maps) -> AbstractIndenter:
    shape = table["shape"]
    placing = {"shape", "position_mm", "angle_deg"}
    if shape == "height_map":
        _only(table, "indenter of shape height_map", {*placing, "heights_mm_file", "spacing_mm"})
        dx, dy = _list(table, "spacing_mm", "xy")
        return HeightMap(maps.read(table["heights_mm_file"]), (float(dx), float(dy)))
    if not isinstance(shape, str) or shape not in SHAPES:
        raise ValueError(f"unknown shape {shape!r}; known are height_map, {', '.join(SHAPES)}")
    kind, names = SHAPES[shape]
    keys = {f"{name}_mm" for name in names}
    _only(table, f"indenter of shape {shape}", {*placing, *keys})
    given = {"edge_radius_mm": 0.0} | table
    return kind(**{name: _size(given, f"{name}_mm") for name in names})


def _size(table: dict[str, Any], key: str) -> Any:
    return _list(table, key, "xyz") if key == "semi_axes_mm" else _number(table, key)


def _path(table: dict[str, Any]) -> Pose:
    _only(table, "motion", {"centre_mm", "legs"})
    centre = _list({"centre_mm": [0.0, 0.0]} | table, "centre_mm", "xy")
    state: dict[str, Any] = {"approach_mm": 0.0, "shift_mm": [0.0, 0.0], "twist_deg": 0.0}
    poses, steps = [_pose(state, centre)], []
    for number, leg in enumerate(table["legs"], start=1):
        name = f"leg {number} of the motion"
        _only(leg, name, {"steps", *state})
        count = leg["steps"]
        if type(count) is not int or count < 1:
            raise ValueError(f"{name} needs at least one step, a whole number, got {count!r}")
        state = state | {key: value for key, value in leg.items() if key != "steps"}
        steps.append(count)
        try:
            poses.append(_pose(state, centre))
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    if not steps:
        raise ValueError("the motion has no legs")
    return make_path(poses, steps)


def _pose(state: dict[str, Any], centre: list[float]) -> Pose:
    twist = np.radians(_number(state, "twist_deg"))
    return Pose(_number(state, "approach_mm"), _list(state, "shift_mm", "xy"), twist, centre)


def _number(table: dict[str, Any], key: str) -> float:
    value = table[key]
    if type(value) not in (int, float):  # true and false are not
        raise ValueError(f"{key} must be a number, got {value!r}")
    return float(value)


def _list(table: dict[str, Any], key: str, axes: str) -> list[float]:
    """One number for each axis."""
    value = table[key]
    numbers = isinstance(value, list) and all(type(item) in (int, float) for item in value)
    if not numbers or len(value) != len(axes):
        along = ", ".join(f"along {axis}" for axis in axes)
        raise ValueError(f"{key} must be {len(axes)} numbers, [{along}], got {value!r}")
    return [float(item) for item in value]


def _whole(cells: list[float]) -> tuple[int, int]:
    if any(not count.is_integer() for count in cells):
        raise ValueError(f"cells must be whole numbers, got {cells}")
    return int(cells[0]), int(cells[1])


def _only(table: dict[str, Any], name: str, known: set[str]) -> dict[str, Any]:
    """The table, if it has no other keys."""
    unknown = sorted(set(table) - known)
    if unknown:
        raise ValueError(f"unknown key {unknown[0]!r} in {name}; known are {sorted(known)}")
    return table


def _write_table(path: ContactSolution, file: Path) -> None:
    columns = {
        "step": np.arange(1, len(path.pressure) + 1),
        "approach_mm": path.pose.approach,
        "shift_x_mm": path.pose.shift[:, 0],
        "shift_y_mm": path.pose.shift[:, 1],
        "twist_deg": np.degrees(path.pose.twist),
        "force_x_n": path.force[:, 0],
        "force_y_n": path.force[:, 1],
        "force_z_n": path.force[:, 2],
        "moment_nmm": path.moment,
        "stick_ratio": path.stick_ratio,
        "dissipated_energy_nmm": path.dissipated_energy,
        "normal_steps": path.normal.steps,
        "normal_residual": path.normal.residual,
        "friction_steps": path.friction.steps,
        "friction_residual": path.friction.residual,
    }
    with file.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(columns)
        for row in zip(*map(np.asarray, columns.values()), strict=True):
            table.writerow([f"{value:.9g}" for value in row])


def _write(file: Path, write: Callable[[Path], object]) -> None:
    """Write under another name first, so that nothing half-written is left."""
    part = file.with_name(f".part-{file.name}")
    try:
        write(part)
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def _key(path: tuple[Any, ...]) -> str:
    """Name of an array: where it is in the solution."""
    return jax.tree_util.keystr(path, simple=True, separator=".")
