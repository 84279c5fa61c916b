"""Simulations as TOML files describe them, with units in their keys.

`examples/` next to this module holds some with comments. Legs may give `normal_force_n`,
`shear_force_n` and `moment_nmm` in place of `approach_mm`, `shift_mm` and `twist_deg`, in all legs
alike; they run straight from the leg before, from 0 at first. With `sliding = true` the object's
shape goes along as it slides.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from contactmodel.common.checks import Numbers, non_negative, number, poisson, positive
from contactmodel.common.inputs import (
    as_flag,
    as_list,
    as_number,
    as_numbers,
    as_table,
    as_text,
    expect_keys,
    naming,
    parse_toml,
    read_text,
)
from contactmodel.common.stored import read_array
from contactmodel.contact import Contact
from contactmodel.elasticity.bodies import HalfSpace, Layer, Rigid
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

SHAPES: dict[str, tuple[type[AbstractIndenter], tuple[str, ...]]] = {
    "paraboloid": (Paraboloid, ("radius",)),
    "sphere": (Sphere, ("radius",)),
    "cylinder": (Cylinder, ("radius",)),
    "ellipsoid": (Ellipsoid, ("semi_axes",)),
    "round_punch": (RoundPunch, ("radius", "edge_radius")),
    "square_punch": (SquarePunch, ("width", "edge_radius")),
}
IN_PLACE_OF = {
    "normal_force_n": "approach_mm",
    "shear_force_n": "shift_mm",
    "moment_nmm": "twist_deg",
}
PLANAR = ("shear_force_n",)
Check = Callable[[Numbers], Any]
EXAMPLES = resources.files("contactmodel.simulate") / "examples"
MOST_STEPS = 100_000
"""Steps of a motion, each a file of its own."""


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
    source = Path(path) if Path(path).is_file() else Path(str(example))
    text = read_text(source)
    content = parse_toml(text, source)
    with naming(path):
        return _parse(content, text, _Maps(Path(path).parent))


class _Maps:
    """Reads the maps that a configuration names, and notes their hashes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.hashes = ""

    def read(self, table: dict[str, Any], key: str) -> np.ndarray:
        """The array of the file that a key names, its place relative to the configuration."""
        name = as_text(table[key], key)
        file = self.folder / name
        values = read_array(file)
        if values.dtype.kind not in "iuf":
            raise ValueError(f"{name} holds {values.dtype}; it must hold numbers")
        self.hashes += f"# {name}: sha256 {hashlib.sha256(file.read_bytes()).hexdigest()}\n"
        return values.astype(float)


def _parse(content: dict[str, Any], text: str, maps: _Maps) -> Simulation:
    known = {"grid", "elastomer", "object", "indenter", "contact", "motion"}
    expect_keys(content, "the file", known)
    tables = {name: as_table(table, name) for name, table in content.items()}
    grid = tables["grid"]
    expect_keys(grid, "grid", {"cells", "size_mm"})
    cells, size = _list(grid, "cells", "xy", positive), _list(grid, "size_mm", "xy", positive)
    friction = _friction(tables["contact"], maps, _whole(cells))
    indenter = _indenter(tables["indenter"], tables["elastomer"], maps)
    elastomer = _body(tables["elastomer"], "elastomer", {"dome_radius_mm", "marker_depth_mm"})
    object_ = _body(tables["object"], "object", set()) if tables["object"] else Rigid()
    _check_thickness(tables["elastomer"], "elastomer", cells, size)
    _check_thickness(tables["object"], "object", cells, size)
    depth = _number({"marker_depth_mm": 0.0} | tables["elastomer"], "marker_depth_mm", non_negative)
    space = Grid(_whole(cells), (float(size[0]), float(size[1])))
    path, resultants = _path(tables["motion"])
    return Simulation(
        text=text + maps.hashes,
        contact=Contact(elastomer, object_, indenter, space, friction, depth),
        path=path,
        resultants=resultants,
        sliding=as_flag({"sliding": False, **tables["motion"]}["sliding"], "sliding"),
    )


def _friction(
    table: dict[str, Any], maps: _Maps, cells: tuple[int, int]
) -> float | np.ndarray | PowerLawFriction:
    """The coefficient, or the law by which it falls with pressure."""
    falls = {"reference_pressure_mpa", "pressure_exponent"}
    expect_keys(table, "contact", {"friction_coefficient", "friction_coefficient_file", *falls})
    if "friction_coefficient_file" in table:
        coefficient = maps.read(table, "friction_coefficient_file")
        if coefficient.shape != cells:
            raise ValueError(f"friction must be a map of shape {cells}, got {coefficient.shape}")
        _name("friction_coefficient_file", non_negative, coefficient)
    else:
        coefficient = _number(table, "friction_coefficient", non_negative)
    if not falls & set(table):
        return coefficient
    reference = _number(table, "reference_pressure_mpa", positive)
    return PowerLawFriction(coefficient, reference, _number(table, "pressure_exponent"))


def _body(table: dict[str, Any], name: str, others: set[str]) -> HalfSpace | Layer:
    """A layer where a thickness is given, else a half-space."""
    expect_keys(table, name, {"shear_modulus_mpa", "poisson_ratio", "thickness_mm", *others})
    modulus = _number(table, "shear_modulus_mpa", positive)
    material = modulus, _number(table, "poisson_ratio", poisson)
    if "thickness_mm" in table:
        return Layer(*material, _number(table, "thickness_mm", positive))
    return HalfSpace(*material)


def _check_thickness(
    table: dict[str, Any], name: str, cells: list[float], size: list[float]
) -> None:
    """A layer is not thinner than a cell, and its markers lie in it."""
    if "thickness_mm" not in table:
        return
    thickness, cell = table["thickness_mm"], max(np.divide(size, cells))
    if thickness < cell:
        raise ValueError(
            f"thickness_mm of the {name} is {thickness}, less than a cell of {cell:.4g} mm: "
            "take more cells or a smaller size_mm"
        )
    if table.get("marker_depth_mm", 0.0) > thickness:
        raise ValueError(f"marker_depth_mm must not be beyond thickness_mm, {thickness}")


def _indenter(table: dict[str, Any], elastomer: dict[str, Any], maps: _Maps) -> AbstractIndenter:
    place = {"position_mm": [0.0, 0.0], "angle_deg": 0.0} | table
    angle = np.radians(_number(place, "angle_deg"))
    placed = Placed(_shape(table, maps), _list(place, "position_mm", "xy"), angle)
    if "dome_radius_mm" not in elastomer:
        return placed
    return Domed(placed, _number(elastomer, "dome_radius_mm", positive))


def _shape(table: dict[str, Any], maps: _Maps) -> AbstractIndenter:
    shape = table["shape"]
    placing = {"shape", "position_mm", "angle_deg"}
    if shape == "height_map":
        expect_keys(
            table, "indenter of shape height_map", {*placing, "heights_mm_file", "spacing_mm"}
        )
        dx, dy = _list(table, "spacing_mm", "xy")
        return HeightMap(maps.read(table, "heights_mm_file"), (float(dx), float(dy)))
    if not isinstance(shape, str) or shape not in SHAPES:
        raise ValueError(f"unknown shape {shape!r}; known are height_map, {', '.join(SHAPES)}")
    kind, names = SHAPES[shape]
    keys = {f"{name}_mm" for name in names}
    expect_keys(table, f"indenter of shape {shape}", {*placing, *keys})
    given = {"edge_radius_mm": 0.0} | table
    return kind(**{name: _size(given, f"{name}_mm") for name in names})


def _size(table: dict[str, Any], key: str) -> Any:
    if key == "semi_axes_mm":
        return _list(table, key, "xyz", positive)
    return _number(table, key, non_negative if key == "edge_radius_mm" else positive)


def _path(table: dict[str, Any]) -> tuple[Pose, Resultants | None]:
    """The motion, and the resultants in place of some of it; both run straight along each leg."""
    expect_keys(table, "motion", {"centre_mm", "first_approach_mm", "sliding", "legs"})
    legs = [as_table(leg, "each leg") for leg in as_list(table["legs"], "legs")]
    if not legs:
        raise ValueError("the motion has no legs")
    centre = _list({"centre_mm": [0.0, 0.0]} | table, "centre_mm", "xy")
    first = _number({"first_approach_mm": 0.0} | table, "first_approach_mm")
    used = {key for leg in legs for key in leg}
    for key, in_place_of in IN_PLACE_OF.items():
        if {key, in_place_of} <= used:
            raise ValueError(
                f"the legs of the motion have both {key} and {in_place_of}; choose one"
            )
    by_force = "normal_force_n" in used
    if by_force != ("first_approach_mm" in table):
        raise ValueError("first_approach_mm, at which the bodies touch, goes with normal_force_n")
    state: dict[str, Any] = {key: [0.0, 0.0] if key in PLANAR else 0.0 for key in IN_PLACE_OF}
    state |= {"approach_mm": first, "shift_mm": [0.0, 0.0], "twist_deg": 0.0}
    states, steps = [state], []
    for place, leg in enumerate(legs, start=1):
        name = f"leg {place} of the motion"
        expect_keys(leg, name, {"steps", *state})
        count = leg["steps"]
        if type(count) is not int or count < 1:
            raise ValueError(f"{name} needs at least one step, a whole number, got {count!r}")
        state = state | {key: value for key, value in leg.items() if key != "steps"}
        steps.append(count)
        if sum(steps) > MOST_STEPS:
            raise ValueError(f"{name}: {sum(steps)} steps; {MOST_STEPS} are the most there may be")
        try:
            _pose(state, centre)
            _resultants({key: _given(state, key) for key in IN_PLACE_OF if key in used})
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
        states.append(state)
    path = make_path([_pose(state, centre) for state in states], steps)
    given = {
        key: _ramp([_given(state, key) for state in states], steps)
        for key in IN_PLACE_OF
        if key in used
    }
    return path, _resultants(given)


def _given(state: dict[str, Any], key: str) -> Any:
    """A resultant of a leg."""
    return _list(state, key, "xy") if key in PLANAR else _number(state, key)


def _resultants(given: dict[str, Any]) -> Resultants | None:
    """Under the names of `Resultants`."""
    return Resultants(**{key.rpartition("_")[0]: v for key, v in given.items()}) if given else None


def _ramp(corners: list[Any], steps: list[int]) -> np.ndarray:
    """Straight from corner to corner, without the first."""
    legs = zip(corners[:-1], corners[1:], steps, strict=True)
    parts = [np.linspace(start, end, count + 1)[1:] for start, end, count in legs]
    return np.concatenate(parts)


def _pose(state: dict[str, Any], centre: list[float]) -> Pose:
    twist = np.radians(_number(state, "twist_deg"))
    return Pose(_number(state, "approach_mm"), _list(state, "shift_mm", "xy"), twist, centre)


def _number(table: dict[str, Any], key: str, check: Check = number) -> float:
    """A number that passes a check, which need not know the key."""
    value = as_number(table[key], key)
    _name(key, check, value)
    return value


def _name(key: str, check: Check, value: Numbers) -> None:
    """Check a value; the error begins with its key."""
    try:
        check(value)
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error


def _list(table: dict[str, Any], key: str, axes: str, check: Check = number) -> list[float]:
    """One number for each axis, each of which passes a check."""
    value = table[key]
    numbers = isinstance(value, list) and all(type(item) in (int, float) for item in value)
    if not numbers or len(value) != len(axes):
        along = ", ".join(f"along {axis}" for axis in axes)
        raise ValueError(f"{key} must be {len(axes)} numbers, [{along}], got {value!r}")
    items = as_numbers(value, key)
    _name(key, check, items)
    return items


def _whole(cells: list[float]) -> tuple[int, int]:
    if any(not count.is_integer() for count in cells):
        raise ValueError(f"cells must be whole numbers, got {cells}")
    return int(cells[0]), int(cells[1])
