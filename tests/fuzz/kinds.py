"""The kinds of input: a sound one of each, and how the project reads and uses it."""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np

from calibration.experiment import read_experiment
from calibration.softness.references import read_reference
from calibration.softness.squeeze import Bodies, read_travel, squeeze_by_travel
from contactmodel.simulate.configuration import read_simulation
from estimation.estimators import METHODS, PUBLISHED_METHODS
from estimation.estimators.result import Result
from estimation.frames.noise import Noise
from estimation.pictures.reader import ImageSettings
from estimation.pictures.rig import read_rig, triangulate
from estimation.pictures.sensor import Sensor, read_sensor
from estimation.softness import read_softness
from estimation.sources import read_recording
from estimation.tracking.tracker import estimate_angles
from papers.leaderboard.board import score_case, tabulate
from papers.leaderboard.cases import Case, Truth
from papers.leaderboard.entries import read_entry
from papers.leaderboard.sources import Source
from tests.fuzz import inputs
from tests.fuzz.contents import Input

NOISE = Noise.from_std(1e-3)
SENSOR = Sensor(marker="dots", radius=inputs.RADIUS, dark=True, reference=inputs.GRID)
METHOD_NAMES = (*METHODS, *PUBLISHED_METHODS)


class Kind(NamedTuple):
    """A kind of input.

    Attributes:
        make: a sound one.
        use: reads a path, uses what it holds, in one of several ways that chance decides, and
            returns what is wrong with the answer, if anything.
        target: the file that is read; the folder of the files where empty.
    """

    make: Callable[[], Input]
    use: Callable[[Path, np.random.Generator], str]
    target: str = ""


def use_recording(path: Path, rng: np.random.Generator) -> str:
    """Read a recording and estimate its angles."""
    known = ImageSettings(SENSOR) if rng.random() < 0.9 else None  # faster than to find it out
    recording = read_recording(path, known)
    noise = Noise.from_std(NOISE.in_plane, recording.unit) if rng.random() < 0.5 else None
    method = METHOD_NAMES[rng.integers(len(METHOD_NAMES))]
    return judge(estimate_angles(recording, method, noise=noise))


def use_softness(path: Path, rng: np.random.Generator) -> str:
    """Read a softness and correct angles by it."""
    softness = read_softness(path)
    method = METHOD_NAMES[rng.integers(len(METHOD_NAMES))]
    return judge(estimate_angles(inputs.pressed(), method, softness=softness, noise=NOISE))


def judge(result: Result) -> str:
    """What is wrong with the angles: infinite, or missing without a reason."""
    ends = np.stack([result.angle, result.low, result.high])
    if np.isinf(ends).any():
        return "an infinite angle"
    missing = np.isnan(result.angle)
    reasons = zip(missing, result.reason, strict=True)
    return "" if all(reason for none, reason in reasons if none) else "no angle and no reason"


def use_sensor(path: Path, rng: np.random.Generator) -> str:
    """Read a sensor description, and pictures that it is for."""
    recording = read_recording(path.parent / "pad", ImageSettings(read_sensor(path)))
    return "" if np.isfinite(recording.layout.reference).all() else "markers are nowhere"


def use_stereo(path: Path, rng: np.random.Generator) -> str:
    """Read a stereo calibration and find points in space."""
    rig = read_rig(path)
    seen = np.array([[300.0, 200.0], [320.0, 240.0]])
    triangulate(rig, seen, seen)
    return ""


def use_simulation(path: Path, rng: np.random.Generator) -> str:
    """Read a configuration; solving it is left to other tests."""
    read_simulation(path)
    return ""


def use_experiment(path: Path, rng: np.random.Generator) -> str:
    """Read an experiment and lay out its plan."""
    read_experiment(str(path)).plan()
    return ""


def use_reference(path: Path, rng: np.random.Generator) -> str:
    """Read a reference."""
    reference = read_reference(path)
    known = np.isfinite(reference.time).all() and not np.isinf(reference.angle).any()
    return "" if known else "a reading that is not finite"


def use_travel(path: Path, rng: np.random.Generator) -> str:
    """Read a gripper's travel and find a softness from it."""
    found = squeeze_by_travel(*read_travel(path), Bodies(0.48, (0.3, 0.5)), source=path.name)
    ends = found.low, found.stiffness_ratio, found.high
    return "" if np.isfinite(ends).all() else "a softness that is not finite"


def use_answers(path: Path, rng: np.random.Generator) -> str:
    """Read another group's entry and score it."""
    recording = inputs.pressed()
    frames = len(recording)
    case = Case("pressed", "virtual", "pressed", "scored", frames)
    truth = Truth(np.zeros(frames), {"pressed": np.ones(frames, dtype=bool)})
    entry = read_entry(path, {case.name: case})
    tabulate(score_case(entry, Source(case, truth, inputs.pressed)), "case")
    return "an infinite angle" if any(np.isinf(one).any() for one in entry.angle.values()) else ""


KINDS = {
    "archive": Kind(partial(inputs.make_archive, flat=False), use_recording, "lift.npz"),
    "flat archive": Kind(partial(inputs.make_archive, flat=True), use_recording, "lift.npz"),
    "Tac3D folder": Kind(inputs.make_tac3d, use_recording),
    "PNG folder": Kind(partial(inputs.make_pictures, ".png"), use_recording),
    "JPEG and TIFF folder": Kind(partial(inputs.make_pictures, ".jpg", ".tif"), use_recording),
    "AVI": Kind(
        partial(inputs.make_video, "clip.avi", "mjpeg", "yuvj420p"), use_recording, "clip.avi"
    ),
    "MP4": Kind(
        partial(inputs.make_video, "clip.mp4", "libx264", "yuv420p"), use_recording, "clip.mp4"
    ),
    "Matroska": Kind(
        partial(inputs.make_video, "clip.mkv", "ffv1", "gray"), use_recording, "clip.mkv"
    ),
    **{
        name: Kind(partial(inputs.make_bag, name), use_recording, name)
        for name in ("points.mcap", "pictures.mcap", "points.bag", "ros2")
    },
    **{
        name: Kind(partial(inputs.make_rows, name), use_recording, name)
        for name in ("lift.zarr", *(["lerobot"] if find_spec("pyarrow") else []))
    },
    "episodes": Kind(inputs.make_episodes, use_recording, f"set/{inputs.GEL}/episode_1"),
    "scalar softness": Kind(inputs.make_softness, use_softness, "softness.toml"),
    "layered softness": Kind(inputs.make_layered, use_softness, "softness.toml"),
    "sensor": Kind(inputs.make_sensor, use_sensor, "sensor.toml"),
    "stereo": Kind(inputs.make_stereo, use_stereo, "stereo.toml"),
    "simulation": Kind(inputs.make_simulation, use_simulation, "simulation.toml"),
    "shipped simulation": Kind(
        partial(inputs.make_shipped, "contactmodel.simulate", "pivoting_cube"),
        use_simulation,
        "example.toml",
    ),
    "experiment": Kind(
        partial(inputs.make_shipped, "calibration", "tac3d_press", "soft_ball"),
        use_experiment,
        "example.toml",
    ),
    "reference": Kind(inputs.make_reference, use_reference, "stage.csv"),
    "travel": Kind(inputs.make_travel, use_travel, "travel.csv"),
    "answers": Kind(inputs.make_answers, use_answers, "answers.csv"),
}
