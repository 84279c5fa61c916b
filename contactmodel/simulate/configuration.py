"""Simulations as TOML files describe them, with units in their keys.

`examples/` next to this module holds some with comments. Legs may give `normal_force_n`,
`shear_force_n` and `moment_nmm` in place of `approach_mm`, `shift_mm` and `twist_deg`, in all legs
alike; they run straight from the leg before, from 0 at first. With `sliding = true` the object's
shape goes along as it slides. What its table `pad` does not say is that of a sensor description.
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
"""Steps of a motion, each a file of its own."""
Pair = tuple[float, float]
LENGTH = unit("mm", above=0.0)


@dataclass(frozen=True)
class _Grid:
    cells: tuple[int, int] = field(metadata=unit(least=2.0))
    size: Pair | None = field(default=None, metadata=LENGTH)


@dataclass(frozen=True, kw_only=True)
class _Indenter:
    """An object's shape, and where it is."""

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
"""Table and class of each shape."""


@dataclass(frozen=True)
class _Friction:
    """A coefficient, or a map of it, and the law by which it falls with pressure."""

    friction_coefficient: float | None = field(default=None, metadata=unit(least=0.0))
    friction_coefficient_file: str | None = None
    reference_pressure: float | None = field(default=None, metadata=unit("mpa", above=0.0))
    pressure_exponent: float | None = field(default=None, metadata=unit())


@dataclass(frozen=True)
class _Leg:
    """Where a leg of the motion ends; what it does not name stays."""

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
    """What a configuration file asks for.

    Attributes:
        text: the file, and below it the hashes of the maps that it names.
        contact: bodies, shape, grid, friction and the depth at which `u_marker` is written.
        path: motion of B.
        resultants: given in place of some of it, for each step.
        sliding: whether the shape goes along with what slides.
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

    Args:
        path: of the file, or name of the example.
        pad: of a sensor description, for what the file's own table `pad` does not say.

    Raises:
        FileNotFoundError: neither a file nor an example, or a map that it names is not there.
        ValueError: keys that are missing, unknown or have wrong values.
    """
    example = EXAMPLES / f"{path}.toml"
    if not Path(path).is_file() and not example.is_file():
        names = sorted(item.name.removesuffix(".toml") for item in EXAMPLES.iterdir())
        raise FileNotFoundError(f"no file {path}; shipped examples are {', '.join(names)}")
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
    """Reads the maps that a configuration names, and notes their hashes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.hashes = ""

    def read(self, name: str) -> np.ndarray:
        """The array of a file that is named relative to the configuration."""
        file = self.folder / name
        values = read_array(file)
        if values.dtype.kind not in "iuf":
            raise ValueError(f"{name} holds {values.dtype}; it must hold numbers")
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
                f"{max(grid.spacing):.4g} mm: take more cells or a smaller size_mm"
            )
    with naming("pad"):
        elastomer = make_body(pad)
    with naming("object"):
        object_ = Rigid() if file.object == Material() else make_body(file.object)
    path, resultants = _make_path(file.motion)
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
    """The coefficient, or the law by which it falls with pressure."""
    coefficient: float | np.ndarray | None = table.friction_coefficient
    if table.friction_coefficient_file is not None:
        coefficient = maps.read(table.friction_coefficient_file)
        if coefficient.shape != grid.shape:
            raise ValueError(
                f"friction must be a map of shape {grid.shape}, got {coefficient.shape}"
            )
        if not ((coefficient >= 0.0) & (coefficient < inf)).all():
            raise ValueError(f"{table.friction_coefficient_file} must hold numbers from 0")
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
    """The motion, and the resultants in place of some of it; both run straight along each leg."""
    if not motion.legs:
        raise ValueError("the motion has no legs")
    keys = {one.name: key_of(one) for one in fields(_Leg)}
    given = [{k: v for k, v in vars(leg).items() if v is not None} for leg in motion.legs]
    used = {name for leg in given for name in leg}
    for name, in_place_of in IN_PLACE_OF.items():
        if {name, in_place_of} <= used:
            raise ValueError(
                f"the legs of the motion have both {keys[name]} and {keys[in_place_of]}; choose one"
            )
    if ("normal_force" in used) != (motion.first_approach is not None):
        raise ValueError("first_approach_mm, at which the bodies touch, goes with normal_force_n")
    if (count := sum(leg.steps for leg in motion.legs)) > MOST_STEPS:
        raise ValueError(f"the legs have {count} steps; {MOST_STEPS} are allowed at most")
    state: dict[str, Any] = {"shift": (0.0, 0.0), "shear_force": (0.0, 0.0)}
    state |= dict.fromkeys(("twist", "normal_force", "moment"), 0.0)
    states = [state | {"approach": motion.first_approach or 0.0}]
    for leg in given:
        states.append(states[-1] | leg)
    steps = [leg.steps for leg in motion.legs]
    poses = [Pose(s["approach"], s["shift"], s["twist"], motion.centre) for s in states]
    ramps = {name: _ramp([s[name] for s in states], steps) for name in IN_PLACE_OF if name in used}
    return make_path(poses, steps), Resultants(**ramps) if ramps else None


def _ramp(corners: list[Any], steps: list[int]) -> np.ndarray:
    """Straight from corner to corner, without the first."""
    legs = zip(corners[:-1], corners[1:], steps, strict=True)
    parts = [np.linspace(start, end, count + 1)[1:] for start, end, count in legs]
    return np.concatenate(parts)
