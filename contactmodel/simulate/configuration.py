"""Configuration files of simulations: TOML with units in the keys.

`examples/` next to this module holds commented files. All legs may give `normal_force_n`,
`shear_force_n` and `moment_nmm` in place of `approach_mm`, `shift_mm` and `twist_deg`. A leg runs
straight from the end of the previous leg, the first from 0. With `sliding = true` the object's
shape moves as it slides. `corotated = true` solves in a frame that turns with the object. Keys that
the table `pad` lacks come from a sensor description.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from importlib import resources
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from contactmodel.common.inputs import naming, read_text
from contactmodel.common.settings import (
    from_table,
    key_of,
    parse_toml,
    toml_text,
    unit,
)
from contactmodel.common.stored import read_array
from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import Rigid, make_body
from contactmodel.elasticity.pad import Material, Pad, complete_pad
from contactmodel.friction import PowerLawFriction
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
from contactmodel.pose import Pose, Resultants, make_path

EXAMPLES = resources.files("contactmodel.simulate") / "examples"
MOST_STEPS = 100_000
"""Largest number of steps of a motion; each is written to its own file."""
Pair = tuple[float, float]
LENGTH = unit("mm", above=0.0)


@dataclass(frozen=True)
class _Grid:
    cells: tuple[int, int] = field(metadata=unit(least=2.0))
    size: Pair | None = field(default=None, metadata=LENGTH)


@dataclass(frozen=True, kw_only=True)
class _Indenter:
    """An object's shape, position and angle."""

    shape: str
    position: Pair = field(default=(0.0, 0.0), metadata=unit("mm"))
    angle: float = field(default=0.0, metadata=unit("deg"))


@dataclass(frozen=True, kw_only=True)
class _Round(_Indenter):
    radius: float = field(metadata=LENGTH)


@dataclass(frozen=True, kw_only=True)
class _Ellipsoid(_Indenter):
    semi_axes: tuple[float, float, float] = field(metadata=LENGTH)


@dataclass(frozen=True, kw_only=True)
class _RoundPunch(_Round):
    edge_radius: float = field(default=0.0, metadata=unit("mm", least=0.0))


@dataclass(frozen=True, kw_only=True)
class _SquarePunch(_Indenter):
    width: float = field(metadata=LENGTH)
    edge_radius: float = field(default=0.0, metadata=unit("mm", least=0.0))


@dataclass(frozen=True, kw_only=True)
class _HeightMap(_Indenter):
    heights_mm_file: str
    spacing: Pair = field(metadata=LENGTH)


SHAPES: dict[str, tuple[type[_Indenter], Callable[[Any, "_Maps"], AbstractIndenter]]] = {
    "height_map": (_HeightMap, lambda t, maps: HeightMap(maps.read(t.heights_mm_file), t.spacing)),
    "paraboloid": (_Round, lambda t, _: Paraboloid(t.radius)),
    "sphere": (_Round, lambda t, _: Sphere(t.radius)),
    "cylinder": (_Round, lambda t, _: Cylinder(t.radius)),
    "ellipsoid": (_Ellipsoid, lambda t, _: Ellipsoid(t.semi_axes)),
    "round_punch": (_RoundPunch, lambda t, _: RoundPunch(t.radius, t.edge_radius)),
    "square_punch": (_SquarePunch, lambda t, _: SquarePunch(t.width, t.edge_radius)),
}
"""Table of the file and constructor of each shape."""


@dataclass(frozen=True)
class _Friction:
    """A friction coefficient or a map of it, and the law by which it falls with pressure."""

    friction_coefficient: float | None = field(default=None, metadata=unit(least=0.0))
    friction_coefficient_file: str | None = None
    reference_pressure: float | None = field(default=None, metadata=unit("mpa", above=0.0))
    pressure_exponent: float | None = field(default=None, metadata=unit())


@dataclass(frozen=True)
class _Leg:
    """End of a leg of the motion; missing values stay as in the previous leg."""

    steps: int = field(metadata=unit(least=1.0))
    approach: float | None = field(default=None, metadata=unit("mm"))
    shift: Pair | None = field(default=None, metadata=unit("mm"))
    twist: float | None = field(default=None, metadata=unit("deg"))
    normal_force: float | None = field(default=None, metadata=unit("n", least=0.0))
    shear_force: Pair | None = field(default=None, metadata=unit("n"))
    moment: float | None = field(default=None, metadata=unit("nmm"))


@dataclass(frozen=True)
class _Motion:
    legs: tuple[_Leg, ...]
    centre: Pair = field(default=(0.0, 0.0), metadata=unit("mm"))
    first_approach: float | None = field(default=None, metadata=unit("mm"))
    sliding: bool = False
    corotated: bool = False


@dataclass(frozen=True)
class _File:
    grid: _Grid
    object: Material
    indenter: Mapping[str, Any]
    contact: _Friction
    motion: _Motion
    pad: Pad = field(default_factory=Pad)


@dataclass(frozen=True)
class Simulation:
    """The simulation that a configuration file describes.

    Attributes:
        text: text of the file, followed by the hashes of the maps that it names.
        contact: bodies, shape, grid, friction, and the marker depth at which `u_marker` is written.
        path: motion of the object B.
        resultants: force and moment of each step in place of parts of the motion, or None.
        sliding: whether the object's shape moves as it slides.
    """

    text: str
    contact: Contact
    path: Pose
    resultants: Resultants | None
    sliding: bool

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.path.approach)


def read_simulation(path: str | Path, pad: Pad | None = None) -> Simulation:
    """Read a configuration file, or a shipped example by its name.

    The pad of a sensor description supplies the keys that the file's table `pad` lacks.

    Raises:
        FileNotFoundError: there is no such file or example, or a map that it names is missing.
        ValueError: a key is missing or unknown, or its value is wrong.
    """
    example = EXAMPLES / f"{path}.toml"
    if not Path(path).is_file() and not example.is_file():
        names = sorted(item.name.removesuffix(".toml") for item in EXAMPLES.iterdir())
        raise FileNotFoundError(f"{path} does not exist; shipped examples: {', '.join(names)}")
    source = Path(path) if Path(path).is_file() else Path(str(example))
    text = read_text(source)
    content = parse_toml(text, source, renamed={"elastomer": "pad"})
    if pad is not None:
        text += "".join(
            f"# {line}\n" for line in ["pad of the sensor", *toml_text(pad).splitlines()]
        )
    with naming(path):
        return _make(from_table(content, _File), pad or Pad(), text, _Maps(Path(path).parent))


class _Maps:
    """Reads the maps that a configuration names, and collects their hashes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.hashes = ""

    def read(self, name: str) -> np.ndarray:
        """Read the array of a file whose name is relative to the configuration."""
        file = self.folder / name
        values = read_array(file)
        if values.dtype.kind not in "iuf":
            raise ValueError(f"{name} holds values of type {values.dtype}; it must hold numbers")
        self.hashes += f"# {name}: sha256 {hashlib.sha256(file.read_bytes()).hexdigest()}\n"
        return values.astype(float)


def _make(file: _File, sensor: Pad, text: str, maps: _Maps) -> Simulation:
    pad = complete_pad(file.pad, sensor)
    size = file.grid.size or pad.size
    if size is None:
        raise ValueError("grid: the key 'size_mm' is missing")
    grid = Grid(file.grid.cells, size)
    friction, indenter = _make_friction(file.contact, maps, grid), _make_indenter(file, pad, maps)
    for name, body in (("pad", pad), ("object", file.object)):
        if body.thickness is not None and body.thickness < max(grid.spacing):
            raise ValueError(
                f"{name}: thickness_mm is {body.thickness}, less than a cell of "
                f"{max(grid.spacing):.4g} mm: use more cells or a smaller size_mm"
            )
    with naming("pad"):
        elastomer = make_body(pad)
    with naming("object"):
        object_ = Rigid() if file.object == Material() else make_body(file.object)
    path, resultants = _make_path(file.motion)
    motions_only = {
        "corotated": path.corotated,
        "neo_hookean": pad.neo_hookean,
        "radius_mm": pad.radius is not None,
    }
    for key, given in motions_only.items():
        if resultants is not None and given:
            raise ValueError(f"{key} cannot be combined with forces or moments of the legs")
    return Simulation(
        text=text + maps.hashes,
        contact=Contact(elastomer, object_, indenter, grid, friction, pad.marker_depth or 0.0),
        path=path,
        resultants=resultants,
        sliding=file.motion.sliding,
    )


def _make_friction(
    table: _Friction, maps: _Maps, grid: Grid
) -> float | np.ndarray | PowerLawFriction:
    """A coefficient, a map of it, or the law by which it falls with pressure."""
    coefficient: float | np.ndarray | None = table.friction_coefficient
    if table.friction_coefficient_file is not None:
        coefficient = maps.read(table.friction_coefficient_file)
        if coefficient.shape != grid.shape:
            raise ValueError(
                f"{table.friction_coefficient_file} must hold a map of shape {grid.shape}, got "
                f"the shape {coefficient.shape}"
            )
        if not ((coefficient >= 0.0) & (coefficient < inf)).all():
            raise ValueError(
                f"{table.friction_coefficient_file} must hold numbers from 0, all of them finite"
            )
    law = {
        "friction_coefficient": coefficient,
        "reference_pressure_mpa": table.reference_pressure,
        "pressure_exponent": table.pressure_exponent,
    }
    falls = (table.reference_pressure, table.pressure_exponent) != (None, None)
    for key in law if falls else ["friction_coefficient"]:
        if law[key] is None:
            raise ValueError(f"contact: the key {key!r} is missing")
    assert coefficient is not None
    return PowerLawFriction(*law.values()) if falls else coefficient


def _make_indenter(file: _File, pad: Pad, maps: _Maps) -> AbstractIndenter:
    shape = file.indenter.get("shape")
    if not isinstance(shape, str) or shape not in SHAPES:
        raise ValueError(f"indenter: unknown shape {shape!r}; known are {', '.join(SHAPES)}")
    kind, make = SHAPES[shape]
    table = from_table(file.indenter, kind, "indenter")
    placed = Placed(make(table, maps), table.position, table.angle)
    if pad.dome_radius is None or pad.dome_radius == inf:
        return placed
    return Domed(placed, pad.dome_radius)


IN_PLACE_OF = {"normal_force": "approach", "shear_force": "shift", "moment": "twist"}


def _make_path(motion: _Motion) -> tuple[Pose, Resultants | None]:
    """The motion and the resultants that replace parts of it; both are linear along each leg."""
    if not motion.legs:
        raise ValueError("the motion has no legs")
    keys = {leg_field.name: key_of(leg_field) for leg_field in fields(_Leg)}
    ends = [{k: v for k, v in vars(leg).items() if v is not None} for leg in motion.legs]
    used = {name for end in ends for name in end}
    for name, in_place_of in IN_PLACE_OF.items():
        if {name, in_place_of} <= used:
            raise ValueError(
                f"the legs of the motion have both {keys[name]} and {keys[in_place_of]}; use only "
                "one of the two keys"
            )
    if ("normal_force" in used) != (motion.first_approach is not None):
        raise ValueError(
            "first_approach_mm, at which the bodies touch, and normal_force_n must be given "
            "together"
        )
    if (count := sum(leg.steps for leg in motion.legs)) > MOST_STEPS:
        raise ValueError(f"the legs have {count} steps; at most {MOST_STEPS} are allowed")
    state: dict[str, Any] = {"shift": (0.0, 0.0), "shear_force": (0.0, 0.0)}
    state |= dict.fromkeys(("twist", "normal_force", "moment"), 0.0)
    states = [state | {"approach": motion.first_approach or 0.0}]
    for end in ends:
        states.append(states[-1] | end)
    steps = [leg.steps for leg in motion.legs]
    turning = {"centre": motion.centre, "corotated": motion.corotated}
    poses = [Pose(s["approach"], s["shift"], s["twist"], **turning) for s in states]
    ramps = {name: _ramp([s[name] for s in states], steps) for name in IN_PLACE_OF if name in used}
    return make_path(poses, steps), Resultants(**ramps) if ramps else None


def _ramp(corners: list[Any], steps: list[int]) -> np.ndarray:
    """Interpolate linearly between corners; the first corner is left out."""
    legs = zip(corners[:-1], corners[1:], steps, strict=True)
    parts = [np.linspace(start, end, count + 1)[1:] for start, end, count in legs]
    return np.concatenate(parts)
