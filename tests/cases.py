"""Problems with known answers, and the published data."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Bool, Float

from estimation.fields.stencils import Stencils, make_stencils
from estimation.frames import datasets
from estimation.frames.neighbours import grid_neighbours
from estimation.frames.recording import Frame, MarkerLayout, Recording, layout_markers


def slow_case(*values: object, name: str | None = None):
    """One more case of a test, for `pytest -m slow`."""
    return pytest.param(*values, marks=pytest.mark.slow, id=name)


def find_published(name: str) -> Path:
    """Folder of a data set that has been fetched; the test is skipped without it."""
    folder = datasets.find(name)
    if folder is None:
        pytest.skip(f"{name} is neither in CONTACTMODEL_DATA nor in the cache")
    return folder


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, by column."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def in_plane(recording: Recording) -> Recording:
    """The recording without z."""
    layout = layout_markers(recording.layout.reference[:, :2])
    return replace(recording, layout=layout, positions=recording.positions[..., :2])


def domed_pad(
    shape: tuple[int, int] = (20, 20), pitch: float = 1.0, radius: float = 30.0
) -> MarkerLayout:
    """Markers of a regular grid on a spherical cap [mm]."""
    rows, columns = shape
    y, x = np.meshgrid(
        pitch * (np.arange(rows) - (rows - 1) / 2),
        pitch * (np.arange(columns) - (columns - 1) / 2),
        indexing="ij",
    )
    z = np.sqrt(radius**2 - x**2 - y**2) - radius
    return MarkerLayout(np.stack([x, y, z], -1).reshape(-1, 3), grid_neighbours(shape), shape)


def frame_of(positions: Float[np.ndarray, "n d"], **others) -> Frame:
    """A frame in which every marker is seen."""
    settings = {"time": 0.0, "source_index": 0, **others}
    return Frame(positions, **settings)


def twisted_pad(
    layout: MarkerLayout,
    angle: float,
    stick_radius: float = 4.0,
    contact_radius: float = 6.0,
    centre: tuple[float, float] = (0.17, -0.08),
) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """A pad pressed in and turned: rigidly inside the stick radius, less and less outside.

    Returns:
        Positions [mm] and the markers that stick.
    """
    points = layout.reference[:, :2] - centre
    r = np.hypot(points[:, 0], points[:, 1])
    turned = angle * np.exp(-((np.clip(r - stick_radius, 0.0, None) / 2.0) ** 1.5))
    c, s = np.cos(turned), np.sin(turned)
    x = c * points[:, 0] - s * points[:, 1] + centre[0]
    y = s * points[:, 0] + c * points[:, 1] + centre[1]
    depth = 0.8 * np.exp(-np.log(2.0) * (r / contact_radius) ** 2)
    return np.stack([x, y, layout.reference[:, 2] - depth], -1), r < stick_radius


def pad_stencils() -> tuple[MarkerLayout, Stencils]:
    """The domed pad and its stencils."""
    layout = domed_pad()
    return layout, make_stencils(layout)


def turn_about_z(points: Float[np.ndarray, "*batch 3"], angle: float) -> np.ndarray:
    """Points turned counter-clockwise about z."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def lift(
    angles: Float[np.ndarray, " frames"],
    *,
    unloaded: int = 5,
    noise_mm: float = 1e-3,
    layout: MarkerLayout | None = None,
    name: str = "lift",
    seed: int = 0,
) -> Recording:
    """A pad that is first unloaded, then pressed and turned by the angles [rad]."""
    layout = layout or domed_pad()
    rng = np.random.default_rng(seed)
    shapes = [layout.reference] * unloaded + [twisted_pad(layout, a)[0] for a in angles]
    positions = np.stack(shapes) + rng.normal(size=(len(shapes), *layout.reference.shape)) * (
        noise_mm * np.array([1.0, 1.0, 3.0])
    )
    frames = len(positions)
    return Recording(
        layout=layout,
        positions=positions,
        valid=np.ones(positions.shape[:2], dtype=bool),
        time=100.0 + np.arange(frames) / 30.0,
        source_index=np.arange(frames),
        moment=np.outer(np.arange(frames), [0.0, 0.0, 1.0]),
        name=name,
    )


def recording_of(layout: MarkerLayout, positions: Float[np.ndarray, "frames n d"]) -> Recording:
    """A recording at 30 frames per second in which every marker is seen."""
    frames = len(positions)
    return Recording(
        layout=layout,
        positions=positions,
        valid=np.ones(positions.shape[:2], dtype=bool),
        time=np.arange(frames) / 30.0,
        source_index=np.arange(frames),
    )
