"""Run a simulation step by step, and write it to a folder.

Every step is written to its own file, so that an interrupted run resumes.
"""

import csv
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from contactmodel import plots
from contactmodel.common.inputs import read_text
from contactmodel.common.stored import read_arrays
from contactmodel.simulate.configuration import Simulation
from contactmodel.solution import ContactSolution
from contactmodel.solve import solve_contact


def run_simulation(simulation: Simulation, folder: Path) -> Iterator[tuple[int, ContactSolution]]:
    """Solve and write each step; steps that the folder already holds are read instead.

    A step whose file is damaged is solved again.

    Yields:
        Number of the step, from 1, and its contact.

    Raises:
        ValueError: the folder is a file, or holds another simulation.
        RuntimeError: a step failed.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder} is a file; choose a folder to write to")
    steps = folder / "steps"
    steps.mkdir(parents=True, exist_ok=True)
    copy = folder / "config.toml"
    if copy.is_file() and read_text(copy) != simulation.text:
        raise ValueError(f"{folder} holds another simulation; choose an empty folder")
    _write(copy, lambda part: part.write_text(simulation.text, encoding="utf-8"))
    last: ContactSolution | None = None
    skeleton = _make_skeleton(simulation)
    for index in range(len(simulation)):
        file = steps / f"{index + 1:04d}.npz"
        done = _load_if_whole(skeleton, file)
        if done is None:
            try:
                done = _solve(simulation, index, last)
            except RuntimeError as error:
                raise RuntimeError(f"step {index + 1} of {len(simulation)}: {error}") from error
            save_step(done, file)
        last = done
        yield index + 1, last


def write_results(path: ContactSolution, folder: Path) -> None:
    """Write `path.csv` of the steps of a path, and pictures of the path and of its last contact."""
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


def save_step(solution: ContactSolution, file: Path) -> None:
    """Write the arrays of a contact under their names, and `u_marker`, to an `.npz` file.

    `u_marker` is the displacement of the elastomer below the cells at the markers' depth [mm].
    """
    bare = eqx.tree_at(lambda s: s.problem, solution, None)
    leaves = jax.tree_util.tree_leaves_with_path(bare)
    arrays: dict[str, Any] = {_key(path): np.asarray(leaf) for path, leaf in leaves}
    moved = solution.elastomer_displacement(solution.problem.marker_depth)
    arrays["u_marker"] = np.asarray(moved)
    _write(file, lambda part: np.savez_compressed(part, **arrays))


def load_step(skeleton: ContactSolution, file: Path) -> ContactSolution:
    """Read a contact that `save_step` has written; the skeleton is another one, or its shapes.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is damaged or belongs to another simulation.
    """
    bare = eqx.tree_at(lambda s: s.problem, skeleton, None)
    leaves, tree = jax.tree_util.tree_flatten_with_path(bare)
    arrays = read_arrays(file)
    for path, leaf in leaves:
        stored = arrays.get(_key(path))
        if stored is None or (stored.shape, stored.dtype) != (leaf.shape, leaf.dtype):
            raise ValueError(f"{file} holds no {_key(path)} of this simulation")
    read = jax.tree.unflatten(tree, [jnp.asarray(arrays[_key(path)]) for path, _ in leaves])
    return eqx.tree_at(
        lambda s: s.problem, read, skeleton.problem, is_leaf=lambda leaf: leaf is None
    )


def _make_skeleton(simulation: Simulation) -> ContactSolution:
    """The array shapes of a step's contact, with the problem that is solved."""
    shapes = eqx.filter_eval_shape(lambda: _solve(simulation, 0, None))
    return eqx.tree_at(lambda s: s.problem, shapes, simulation.contact)


def _load_if_whole(skeleton: ContactSolution, file: Path) -> ContactSolution | None:
    """The contact of a step from its file; None if the file is missing or damaged."""
    try:
        return load_step(skeleton, file)
    except (FileNotFoundError, ValueError):
        return None


def _solve(simulation: Simulation, index: int, previous: ContactSolution | None) -> ContactSolution:
    steps = simulation.path, simulation.resultants
    pose, resultants = jax.tree.map(lambda leaf: leaf[index], steps)
    how = {"previous": previous, "sliding": simulation.sliding}
    return solve_contact(simulation.contact, pose, resultants, **how)


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
    """Write to a temporary name, then rename, so that no incomplete file remains."""
    part = file.with_name(f".part-{file.name}")
    try:
        write(part)
        os.replace(part, file)
    finally:
        part.unlink(missing_ok=True)


def _key(path: tuple[Any, ...]) -> str:
    """Name of an array: its path in the solution."""
    return jax.tree_util.keystr(path, simple=True, separator=".")
