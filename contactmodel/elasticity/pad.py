"""The pad of a sensor, as described by the table `pad` of all files.

[pad]
shear_modulus_mpa = 0.2
poisson_ratio = 0.48
thickness_mm = 3.0           # on a rigid base; omit it, or use inf, for a half-space
marker_depth_mm = 0.3        # depth of the markers below the surface
dome_radius_mm = 30.0        # radius of the surface; omit it if the surface is flat
size_mm = [20.0, 20.0]       # size of the surface along x and y
radius_mm = 12.0             # of a round pad with a free side, to correct simulated forces
neo_hookean = true           # to correct simulated forces for the gel's stiffening with depth
"""

from dataclasses import dataclass, field
from math import inf
from pathlib import Path

from contactmodel.common.inputs import naming
from contactmodel.common.settings import check_limits, from_table, read_toml, unit

SENSOR_VERSION = 1
"""`format_version` of a sensor description."""
RENAMED = {
    "elastomer.shear_modulus": "pad.shear_modulus_mpa",
    "elastomer.poisson_ratio": "pad.poisson_ratio",
    "elastomer.thickness": "pad.thickness_mm",
    "elastomer.marker_depth": "pad.marker_depth_mm",
    "elastomer.dome_radius": "pad.dome_radius_mm",
    "elastomer.friction_coefficient": "",
}
"""Keys of version 0.1.0's sensor descriptions and their present names."""


@dataclass(frozen=True)
class Material:
    """Elastic constants and thickness of a body; None where unknown.

    Attributes:
        shear_modulus: G [MPa].
        poisson_ratio: ν [-].
        thickness: thickness on a rigid base; infinite or None for a half-space [mm].

    Raises:
        ValueError: a value is outside its range.

    Examples:
        >>> from contactmodel import Material
        >>> Material(shear_modulus=0.2, poisson_ratio=0.48)
        Material(shear_modulus=0.2, poisson_ratio=0.48, thickness=None)
        >>> Material(shear_modulus=-0.2)
        Traceback (most recent call last):
            ...
        ValueError: shear_modulus_mpa is -0.2; it must be a number above 0
    """

    shear_modulus: float | None = field(default=None, metadata=unit("mpa", above=0.0))
    poisson_ratio: float | None = field(default=None, metadata=unit(least=0.0, most=0.5))
    thickness: float | None = field(default=None, metadata=unit("mm", above=0.0, most=inf))

    def __post_init__(self) -> None:
        """Check the values."""
        check_limits(self)


@dataclass(frozen=True)
class Pad(Material):
    """The elastomer of a sensor with its markers; None where unknown.

    Attributes:
        shear_modulus: G_S [MPa].
        poisson_ratio: ν_S [-].
        thickness: thickness on a rigid base; infinite or None for a half-space [mm].
        marker_depth: depth of the markers below the surface [mm].
        dome_radius: radius of the surface; infinite or None for a flat surface [mm].
        size: size of the surface along x and y [mm].
        radius: radius of a round pad, to correct force and moment for its free side (see `Layer`)
            [mm].
        neo_hookean: whether to correct force and moment for the gel's stiffening with depth.

    Raises:
        ValueError: a value is outside its range, or the markers lie below the base.

    Examples:
        >>> from contactmodel import Pad, make_body
        >>> pad = Pad(shear_modulus=0.2, poisson_ratio=0.48, thickness=3.0, marker_depth=0.3)
        >>> print(f"G = {make_body(pad).shear_modulus} MPa, markers {pad.marker_depth} mm deep")
        G = 0.2 MPa, markers 0.3 mm deep
    """

    marker_depth: float | None = field(default=None, metadata=unit("mm", least=0.0))
    dome_radius: float | None = field(default=None, metadata=unit("mm", above=0.0, most=inf))
    size: tuple[float, float] | None = field(default=None, metadata=unit("mm", above=0.0))
    radius: float | None = field(default=None, metadata=unit("mm", above=0.0))
    neo_hookean: bool | None = None

    def __post_init__(self) -> None:
        """Check the values and the depth of the markers."""
        check_limits(self)
        if (self.marker_depth or 0.0) > (inf if self.thickness is None else self.thickness):
            raise ValueError(
                f"marker_depth_mm is {self.marker_depth}; it must not be larger than thickness_mm, "
                f"{self.thickness}"
            )


def read_pad(path: str | Path) -> Pad:
    """Read the pad of a sensor description.

    Args:
        path: TOML file.

    Returns:
        The pad; without a table `pad`, all of its values are None.

    Raises:
        OSError: the file cannot be read.
        ValueError: the file is not a sensor description, or its table `pad` is wrong.

    Examples:
        >>> from pathlib import Path
        >>> from contactmodel import read_pad
        >>> _ = Path("sensor.toml").write_text("format_version = 1\\npad.thickness_mm = 3.0")
        >>> print(f"{read_pad(Path('sensor.toml')).thickness} mm thick")
        3.0 mm thick
    """
    path = Path(path)
    content = read_toml(path, SENSOR_VERSION, RENAMED)
    with naming(path):
        return from_table(content.get("pad", {}), Pad, "pad")


def complete_pad(own: Pad, sensor: Pad) -> Pad:
    """A pad whose unknown values are taken from a sensor's pad."""
    return Pad(**{**vars(sensor), **{k: v for k, v in vars(own).items() if v is not None}})
