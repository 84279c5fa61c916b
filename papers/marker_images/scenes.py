"""Random scenes of rendered clips by condition: motions of an object in a gripper."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import HalfSpace, Rigid
from contactmodel.grid import Grid
from contactmodel.indenters import AbstractIndenter, Cylinder, Domed, Sphere, SquarePunch
from contactmodel.pose import Pose, make_path
from estimation.pictures.render import Camera
from estimation.virtual.clip import Scene
from estimation.virtual.relief import Lamps

GRID = Grid((40, 40), (24.0, 24.0))
PAD = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5)
FIRM, SLIPPERY = 1.0, 0.15
"""μ at which the contact sticks at least partly, and at which all of it slips within 5° [-]."""


class Leg(NamedTuple):
    """A leg of the object's path: its number of frames and its end."""

    frames: int  # number of frames
    press: float  # share of the approach at the end [-]
    share: float  # share of the shift at the end [-]
    turn: float  # angle at the end [deg]


def shape_of(name: str, rng: np.random.Generator) -> tuple[AbstractIndenter, float]:
    """A shape with random sizes, and its random approach [mm].

    Raises:
        ValueError: the shape is unknown.
    """
    if name == "sphere":
        return Sphere(rng.uniform(10.0, 18.0)), rng.uniform(0.9, 1.3)
    if name == "cylinder":
        return Domed(Cylinder(rng.uniform(8.0, 12.0)), 40.0), rng.uniform(0.6, 0.9)
    if name == "cube":
        return SquarePunch(rng.uniform(6.0, 8.0), 1.0), rng.uniform(0.4, 0.7)
    raise ValueError(f"unknown shape {name!r}; choose from sphere, cylinder, cube")


def _held(rng: np.random.Generator) -> list[Leg]:
    turn = rng.uniform(3.0, 6.0)
    return [
        Leg(20, 1, 0, turn),
        Leg(15, 1, 0, turn),
        Leg(20, 1, 0, 0.3 * turn),
        Leg(10, 1, 0, 0.3 * turn),
    ]


def _reversal(rng: np.random.Generator) -> list[Leg]:
    return [
        Leg(25, 1, 0, rng.uniform(6.0, 9.0)),
        Leg(45, 1, 0, rng.uniform(-12.0, -8.0)),
        Leg(5, 1, 0, 0),
    ]


def _slow(rng: np.random.Generator) -> list[Leg]:
    turn = rng.uniform(10.0, 18.0)
    return [Leg(70, 1, 0, turn), Leg(15, 1, 0, turn)]


def _fast(rng: np.random.Generator) -> list[Leg]:
    turn = rng.uniform(12.0, 25.0)
    return [Leg(10, 1, 0, 0.1 * turn), Leg(6, 1, 0, turn), Leg(50, 1, 0, turn)]


def _shifted(rng: np.random.Generator) -> list[Leg]:
    return [Leg(30, 1, 1, 0.0), Leg(30, 1, 1, 0.0)]


def _released(rng: np.random.Generator) -> list[Leg]:
    turn = rng.uniform(10.0, 15.0)
    return [Leg(30, 1, 0, turn), Leg(15, 1, 0, turn), Leg(4, 0, 0, turn), Leg(25, 0, 0, turn)]


def _empty(rng: np.random.Generator) -> list[Leg]:
    return [Leg(8, 1, 0, 3.0), Leg(3, 0, 0, 3.0), Leg(55, 0, 0, 3.0)]


Motion = Callable[[np.random.Generator], list[Leg]]

CONDITIONS: dict[str, tuple[Motion, float, float, str, int]] = {
    "held, turned and back": (_held, FIRM, 0.0, "", 0),
    "reversal": (_reversal, 0.4, 0.0, "", 0),
    "slow slip": (_slow, SLIPPERY, 0.0, "", 0),
    "fast slip, then rest": (_fast, SLIPPERY, 0.0, "", 0),
    "shifted, held": (_shifted, FIRM, 0.6, "", 0),
    "shifted, slips": (_shifted, SLIPPERY, 2.0, "", 0),
    "turned and shifted, slips": (_slow, SLIPPERY, 1.0, "", 0),
    "starts loaded, slow slip": (_slow, SLIPPERY, 0.0, "", 25),
    "starts loaded, is let go": (_released, SLIPPERY, 0.0, "", 20),
    "empty pad": (_empty, FIRM, 0.0, "", 0),
    "smooth, held": (_held, FIRM, 0.0, "smooth", 0),
    "smooth, slow slip": (_slow, SLIPPERY, 0.0, "smooth", 0),
}
"""By condition: motion, friction [-], shift [mm], relief (if empty, texture and edges in turn), and
number of frames before the clip begins."""


def draw_scene(condition: str, draw: int) -> Scene:
    """A random scene of a condition; shape, relief, light and place vary from draw to draw."""
    motion, friction, distance, relief, first = CONDITIONS[condition]
    rng = np.random.default_rng((list(CONDITIONS).index(condition), draw))
    indenter, approach = shape_of(("sphere", "cube", "cylinder")[draw % 3], rng)
    sign, way = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 2.0 * np.pi)
    shift = distance * np.array([np.cos(way), np.sin(way)])
    legs: list[Leg] = [Leg(5, 0, 0, 0), Leg(6, 1, 0, 0), Leg(4, 1, 0, 0), *motion(rng)]
    turning = 0.0 if motion is _shifted else 1.0
    poses = [
        Pose(max(approach * press, 0.0), share * shift, sign * turning * np.radians(turn))
        for _, press, share, turn in legs
    ]
    if distance and motion is _slow:
        poses[-2:] = [Pose(approach, shift, pose.twist) for pose in poses[-2:]]
    return Scene(
        contact=Contact(PAD, Rigid(), indenter, GRID, friction),
        path=make_path([Pose(0.0), *poses], [leg.frames for leg in legs]),
        relief=relief or ("texture", "edges")[draw // 3 % 2 ^ draw % 2],
        first=first,
        **draw_look(rng),
    )


def draw_look(rng: np.random.Generator) -> dict[str, Any]:
    """The random look of a scene: slope of the relief, places, camera and light."""
    return {
        "slope": rng.uniform(0.08, 0.16),
        "centre": tuple(rng.uniform(-1.5, 1.5, 2)),
        "dot_angle": rng.uniform(-0.08, 0.08),
        "camera": Camera(
            320,
            240,
            0.06,
            background=125.0,
            contrast=95.0,
            shading=0.2,
            noise=rng.uniform(1.0, 2.5),
        ),
        "lamps": Lamps(azimuth=rng.uniform(0.0, 2.0 * np.pi), fall=rng.uniform(0.1, 0.4)),
        "seed": int(rng.integers(2**31)),
    }
