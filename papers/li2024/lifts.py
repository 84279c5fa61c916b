"""The lifts of ten objects of Section V-B: a study for `python -m papers sweep`.

The contact model solves each lift: an object on a domed elastic layer is pressed, turned and held.
The reference is the angle of the angular sensor: the object's turn at the finger plus its bending
between finger and sensor.
"""

import numpy as np

from contactmodel import (
    Contact,
    ContactSolution,
    Domed,
    Ellipsoid,
    Grid,
    HalfSpace,
    Layer,
    Pose,
    solve_path,
)
from estimation.estimators import DEFAULT_METHOD
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.contact import simulate_recording
from estimation.virtual.recording import Camera, PivotModel, Timing, lay_out_markers
from papers.li2024 import settings
from papers.limits import angle_limit
from papers.sweeps import Study

METHODS = ("paper", "paper_strict", "kolamuri", "castano", "kabsch", DEFAULT_METHOD)

_GRID = Grid((48, 48), (15.0, 15.0))
_SHEAR_MODULUS, _POISSON_RATIO = 0.2, 0.48
_RIGID = 1e-4  # least k: harder objects change an angle by less than a hundredth of a degree
_TURN, _HOLD, _UNLOADED = 10, 6, 20  # frames


def cases(quick: bool) -> dict[str, np.ndarray]:
    """The table of lifts: object, angle, and place of the markers under it.

    The quick table has one angle in each equal part of the range, because lifts to nearly equal
    angles cannot separate k from L.
    """
    rng = np.random.default_rng(settings.SEED)
    low, high = settings.QUICK_LIFTS if quick else settings.LIFTS
    objects = [i for i in range(len(settings.OBJECTS)) for _ in range(rng.integers(low, high + 1))]
    count = len(objects)
    angle_deg = rng.uniform(*settings.LIFT_RANGE_DEG, count)
    if quick:
        part = np.arange(count) % high
        angle_deg = np.interp(part + rng.random(count), (0, high), settings.LIFT_RANGE_DEG)
    return {
        "object_index": np.array(objects),
        "angle_deg": angle_deg,
        "offset": rng.uniform(-0.5, 0.5, (count, 2)),
        "grid_angle": rng.uniform(0.0, np.pi / 2, count),
        "seed": np.arange(count),
    }


def evaluate(
    object_index: int, angle_deg: float, offset: list[float], grid_angle: float, seed: int
) -> dict[str, np.ndarray]:
    """Reference and the elastomer's rotation by each of `METHODS`, at the end of a lift [deg].

    `limit` is the Cramér–Rao bound of that rotation, from one frame of the markers that have always
    stuck [deg].
    """
    shape = list(settings.OBJECTS.values())[object_index]
    solution = _lift(shape, float(np.radians(angle_deg)))
    layout = lay_out_markers(
        PivotModel(
            grid_shape=settings.LIFT_MARKERS,
            pitch=settings.PITCH_MM,
            offset=(offset[0], offset[1]),
            grid_angle=grid_angle,
        )
    )
    camera = Camera(settings.LIFT_NOISE_MM, Timing(settings.RATE_HZ, settings.DROPPED), seed=seed)
    recording, truth = simulate_recording(solution, layout, camera, unloaded=_UNLOADED)
    answers = [estimate_angles(recording, method).angle[-1] for method in METHODS]
    return {
        "reference": np.array(angle_deg + np.degrees(shape.deflection * truth.moment[-1])),
        "elastomer": np.degrees(answers),
        "limit": np.degrees(angle_limit(layout.reference[:, :2], truth.stick[-1], camera.noise[0])),
        "stick": truth.stick[-1].sum(),
        "contact": truth.contact[-1].sum(),
    }


def _lift(shape: settings.ObjectShape, angle: float) -> ContactSolution:
    """An object pressed, turned and held, one step per frame; its shape follows the sliding."""
    twists = [np.zeros(1), np.linspace(0.0, angle, _TURN + 1), np.full(_HOLD, angle)]
    return solve_path(
        Contact(
            Layer(_SHEAR_MODULUS, _POISSON_RATIO, shape.thickness),
            HalfSpace(_SHEAR_MODULUS / max(shape.stiffness_ratio, _RIGID), _POISSON_RATIO),
            Domed(Ellipsoid(shape.semi_axes), settings.DOME_MM),
            _GRID,
            shape.friction_coefficient,
        ),
        Pose(shape.approach, twist=np.concatenate(twists)),
        rtol=1e-6,
        sliding=True,
    )


STUDY = Study(cases, evaluate, batch=1, traced=False)
