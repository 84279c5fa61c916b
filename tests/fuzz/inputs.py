"""Sound inputs of every kind, small, so that a case takes milliseconds."""

import io
import tempfile
import tomllib
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import av
import numpy as np

from contactmodel import Pad
from contactmodel.common.settings import to_table
from contactmodel.common.stored import read_arrays
from estimation.frames.archive import write_archive
from estimation.frames.columns.lerobot import write_lerobot
from estimation.frames.columns.zarr_folder import write_zarr
from estimation.frames.recording import Recording
from estimation.pictures.render import Camera, render_dots
from tests import bags
from tests.cases import domed_pad, lift
from tests.estimation.frames.lerobot_sets import GEL, write_set, write_video
from tests.estimation.pictures.rigs import make_rig
from tests.fuzz.contents import Input

FRAMES = 8
"""Of a recording, beside three unloaded ones."""


@cache
def pressed(flat: bool = False) -> Recording:
    """A small recording of a press and a turn, with everything that a source may know."""
    layout = domed_pad((5, 5), pitch=2.5)
    found = lift(np.radians(np.linspace(0.0, 8.0, FRAMES)), unloaded=3, layout=layout)
    vectors = np.ones((len(found), 3))
    found = replace(
        found,
        force=-vectors,
        moment=vectors,
        forces=np.zeros(found.positions.shape),
        imprint=np.full((len(found), 2), 0.01),
        flaws=("",) * len(found),
    )
    if not flat:
        return found
    return replace(
        found,
        layout=replace(layout, reference=layout.reference[:, :2], grid_shape=None),
        positions=found.positions[..., :2],
        forces=None,
        rotation=np.zeros(found.valid.shape),
        contact=np.ones(found.valid.shape, dtype=bool),
    )


GRID = np.stack(np.meshgrid(np.arange(6), np.arange(5)), -1).reshape(-1, 2) * 20.0 + 14.0
"""Where the dots of small pictures are at rest [px]."""
RADIUS = 3.5
"""Of them [px]."""


@cache
def dots() -> tuple[np.ndarray, ...]:
    """Small pictures of dots, the middle ones turned more and more."""
    camera = Camera(width=128, height=108)
    middle = GRID.mean(axis=0)
    arm = GRID - middle
    share = np.exp(-((np.hypot(*arm.T) / 40.0) ** 4))
    axes = np.broadcast_to(RADIUS * np.eye(2), (len(GRID), 2, 2))
    rng, pictures = np.random.default_rng(0), []
    for degrees in (0.0, 3.0, 6.0, 9.0):
        turned = np.exp(1j * np.radians(degrees) * share) * (arm @ np.array([1.0, 1.0j]))
        centre = middle + np.stack([turned.real, turned.imag], axis=1)
        pictures.append(render_dots(camera, centre, axes, rng))
    return tuple(pictures)


@cache
def make_archive(flat: bool) -> Input:
    """An archive of every field."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lift.npz"
        write_archive(pressed(flat), path)
        return {path.name: read_arrays(path)}


def make_tac3d() -> Input:
    """A Tac3D folder."""
    recording = pressed()
    moved = recording.positions - recording.layout.reference
    moved[:3] = 0.0
    vectors = np.ones((len(moved), 1, 3))
    arrays = {
        "3D_Positions": recording.positions,
        "3D_Displacements": moved,
        "3D_Forces": np.zeros_like(moved),
        "3D_ResultantForce": -vectors,
        "3D_ResultantMoment": vectors,
        "index": recording.source_index,
        "sendTimestamp": recording.time,
    }
    return {f"{name}.npy": array for name, array in arrays.items()}


@cache
def make_bag(name: str) -> Input:
    """A bag: an MCAP file of pictures, one of points, a ROS 1 bag, or a ROS 2 folder."""
    step, recording = 33_333_333, pressed()
    sent = [
        bags.Sent("/markers", bags.cloud(one, i * step, ros1=name.endswith(".bag")), i * step)
        for i, one in enumerate(recording.positions)
    ]
    if name == "pictures.mcap":
        shown = [bags.image(one, "mono8", i * step) for i, one in enumerate(dots())]
        sent = [bags.Sent("/camera", one, i * step) for i, one in enumerate(shown)]
    write = {".mcap": bags.write_mcap, ".bag": bags.write_ros1}.get(Path(name).suffix)
    with tempfile.TemporaryDirectory() as folder:
        path = (write or bags.write_ros2)(Path(folder) / name, sent)
        inside = sorted(path.iterdir()) if path.is_dir() else [path]
        return {str(one.relative_to(folder)): one.read_bytes() for one in inside}


@cache
def make_rows(name: str) -> Input:
    """A Zarr group, or a LeRobot data set."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        (write_zarr if name.endswith(".zarr") else write_lerobot)(path, pressed())
        inside = [one for one in sorted(path.rglob("*")) if one.is_file()]
        return {str(one.relative_to(folder)): one.read_bytes() for one in inside}


@cache
def make_episodes() -> Input:
    """A LeRobot data set of another program, with two episodes."""
    with tempfile.TemporaryDirectory() as folder:
        path, images = Path(folder) / "set", list(dots())
        write_set(path, {GEL: {"dtype": "video"}}, [2, len(images)])
        write_video(path, images[:2] + images)
        inside = [one for one in sorted(path.rglob("*")) if one.is_file()]
        return {str(one.relative_to(folder)): one.read_bytes() for one in inside}


@cache
def make_pictures(*suffixes: str) -> Input:
    """A folder of pictures, with the times at which they were taken."""
    images: Input = {f"{i}{suffixes[i % len(suffixes)]}": image for i, image in enumerate(dots())}
    return images | {"times.csv": make_times()}


def make_times() -> list[list[str]]:
    """When the pictures were taken, row by row."""
    return [["frame", "time_s"], *([str(i), f"{i / 30:.4f}"] for i in range(len(dots())))]


@cache
def make_video(name: str, codec: str, pixels: str) -> Input:
    """A video, with the times of its frames beside it."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format=name.rpartition(".")[2].replace("mkv", "matroska")) as video:
        stream: Any = video.add_stream(codec, rate=30)
        stream.height, stream.width = dots()[0].shape
        stream.pix_fmt = pixels
        for image in dots():
            video.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        video.mux(stream.encode())
    return {name: buffer.getvalue(), "clip.csv": make_times()}


def make_softness() -> Input:
    """A scalar softness with every key."""
    return {
        "softness.toml": {
            "format_version": 1,
            "kind": "scalar",
            "stiffness_ratio": 0.3,
            "load_term_rad": 0.01,
            "load_by_force": True,
            "covariance": [[1e-4, 0.0], [0.0, 1e-5]],
            "validity": {"rotation_deg": [-20.0, 20.0], "normal_force_n": [0.0, 9.0]},
            "provenance": {"by": "hand"},
        }
    }


def make_layered() -> Input:
    """A layered softness with every key."""
    return {
        "softness.toml": {
            "format_version": 1,
            "kind": "layered",
            "stiffness_ratio": 0.3,
            "thickness_mm": 3.0,
            "depth_mm": 0.5,
            "covariance": [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]],
            "validity": {"contact_radius_mm": [1.0, 9.0]},
        }
    }


def make_sensor() -> Input:
    """A sensor description with every table, and pictures that it is for."""
    camera = {"width_px": 128, "height_px": 108, "mm_per_px": 0.04}
    matrix = [[200.0, 0.0, 64.0], [0.0, 200.0, 54.0], [0.0, 0.0, 1.0]]
    pad = Pad(shear_modulus=0.2, poisson_ratio=0.48, thickness=3.0, marker_depth=0.3)
    return {
        "sensor.toml": {
            "format_version": 1,
            "camera": camera | {"matrix": matrix, "distortion": [0.01, 0.0, 0.0, 0.0, 0.0]},
            "markers": {"kind": "dots", "radius_px": RADIUS, "dark": True},
            "noise": {"in_plane_mm": 0.001, "normal_mm": 0.003, "correlation": [0.5, 0.2]},
            "pad": to_table(pad),
        },
        "pad/0.png": dots()[0],
        "pad/1.png": dots()[-1],
    }


def make_stereo() -> Input:
    """A stereo calibration."""
    return {"stereo.toml": {"format_version": 1, **to_table(make_rig())}}


def make_simulation() -> Input:
    """A configuration that names maps of heights and friction, and has everything else."""
    x = np.linspace(-3.0, 3.0, 16)
    return {
        "simulation.toml": {
            "grid": {"cells": [16, 16], "size_mm": [6.0, 6.0]},
            "pad": {
                "shear_modulus_mpa": 0.2,
                "poisson_ratio": 0.48,
                "thickness_mm": 3.0,
                "marker_depth_mm": 0.5,
                "dome_radius_mm": 30.0,
            },
            "object": {"shear_modulus_mpa": 2.0, "poisson_ratio": 0.3},
            "indenter": {
                "shape": "height_map",
                "heights_mm_file": "heights.npy",
                "spacing_mm": [0.4, 0.4],
                "angle_deg": 5.0,
            },
            "contact": {
                "friction_coefficient_file": "friction.npy",
                "reference_pressure_mpa": 0.05,
                "pressure_exponent": 0.3,
            },
            "motion": {
                "centre_mm": [0.0, 0.0],
                "first_approach_mm": 0.1,
                "sliding": True,
                "legs": [{"steps": 2, "normal_force_n": 1.0}, {"steps": 2, "twist_deg": 4.0}],
            },
        },
        "heights.npy": 0.05 * (x**2 + x[:, None] ** 2),
        "friction.npy": np.full((16, 16), 0.5),
    }


def make_reference() -> Input:
    """A rotary stage's readings."""
    rows = [[f"{0.1 * i}", f"{2.0 * i}", "0.1"] for i in range(8)]
    return {"stage.csv": [["time_s", "angle_deg", "error_deg"], *rows]}


def make_travel() -> Input:
    """A gripper's travel while it closes."""
    rows = [[f"{0.25 * i}", f"{0.1 * i}"] for i in range(12)]
    return {"travel.csv": [["travel_mm", "indentation_mm"], *rows]}


def make_answers() -> Input:
    """Another group's angles."""
    rows = [["pressed", str(i), f"{i}.5"] for i in range(FRAMES)]
    return {"answers.csv": [["case", "frame", "angle_deg"], *rows]}


@cache
def make_shipped(package: str, *names: str) -> Input:
    """Shipped examples' tables, put together."""
    content: dict[str, Any] = {}
    for name in names:
        text = (files(package) / "examples" / f"{name}.toml").read_text(encoding="utf-8")
        content |= tomllib.loads(text)
    return {"example.toml": content}
