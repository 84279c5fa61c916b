"""Motion of a gel's round surface along a path, and markers on it."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import PchipInterpolator

from estimation.frames.files import write_whole


class Surface(NamedTuple):
    """Motion of a gel's top along a path.

    Attributes:
        radius: radius of the undeformed top's points [mm].
        moved: displacement u_r, u_θ and u_z, in the basis of the undeformed point [mm].
        twist: twist of the object, counter-clockwise [rad].
        stick: mask of the points in contact that do not slip in the step.
    """

    radius: Float[np.ndarray, " points"]
    moved: Float[np.ndarray, "steps points 3"]
    twist: Float[np.ndarray, " steps"]
    stick: Bool[np.ndarray, "steps points"]


class TurnedContact(NamedTuple):
    """A solved contact: pressed, and turned by several angles.

    Attributes:
        surface: motion of the gel's top.
        force: normal force [N].
        moment: moment about the axis [N·mm].
        contact_mm: radius of the pressed contact [mm].
    """

    surface: Surface
    force: Float[np.ndarray, " steps"]
    moment: Float[np.ndarray, " steps"]
    contact_mm: float


def read_contacts(file: Path, count: int) -> list[TurnedContact]:
    """The contacts of a file.

    Args:
        file: written by `write_contacts`.
        count: number of contacts.
    """
    with np.load(file) as stored:
        return [
            TurnedContact(
                read_surface(stored, str(i)),
                *(stored[f"{i}/{part}"].astype(float) for part in ("force", "moment")),
                contact_mm=float(stored[f"{i}/contact_mm"]),
            )
            for i in range(count)
        ]


def write_contacts(file: Path, solved: list[TurnedContact]) -> None:
    """Write contacts to a file."""
    arrays: dict[str, np.ndarray] = {}
    for i, one in enumerate(solved):
        arrays |= surface_arrays(one.surface, str(i))
        arrays |= {f"{i}/{name}": np.array(getattr(one, name)) for name in one._fields[1:]}
    write_arrays(file, arrays)


def read_surface(stored: Mapping[str, np.ndarray], place: str) -> Surface:
    """A surface of a file.

    Args:
        stored: arrays of the file.
        place: first part of their names.
    """
    radius, moved, twist, stick = (stored[f"{place}/{part}"] for part in Surface._fields)
    return Surface(*(part.astype(float) for part in (radius, moved, twist)), stick=stick)


def surface_arrays(surface: Surface, place: str) -> dict[str, np.ndarray]:
    """The arrays of a surface for a file, in single precision.

    Args:
        surface: motion of the gel's top.
        place: first part of their names.
    """
    return {
        f"{place}/{part}": value.astype(np.float32) if value.dtype == float else value
        for part, value in surface._asdict().items()
    }


def write_arrays(file: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write a compressed file of arrays, whole or not at all."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # pyright: ignore[reportArgumentType]
    write_whole(file, buffer.getvalue())


def move_markers(
    surface: Surface, reference: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "steps n 3"], Bool[np.ndarray, "steps n"]]:
    """Displacements of markers [mm], and the mask of those that stick, in each step.

    Between the points, a marker's distance from the axis, its angle about it and its height are
    interpolated. So markers between points that stick turn exactly with the object, which
    displacements interpolated beside a slipping point would not do.

    Args:
        surface: motion of the gel's top.
        reference: positions of the markers on the unloaded gel [mm].
    """
    before = reference[:, 0] + 1j * reference[:, 1]
    r = np.abs(before)
    radial, around, up = np.moveaxis(surface.moved, 2, 0)
    distance = np.abs(surface.radius + radial + 1j * around)
    angle = np.angle(surface.radius + radial + 1j * around)
    angle[:, 0] = angle[:, 1]  # on the axis
    distance, angle, up = (
        PchipInterpolator(surface.radius, part, axis=1)(r) for part in (distance, angle, up)
    )
    moved = before / r * distance * np.exp(1j * angle) - before
    outer = np.clip(np.searchsorted(surface.radius, r), 1, len(surface.radius) - 1)
    stick = surface.stick[:, outer - 1] & surface.stick[:, outer]
    return np.stack([moved.real, moved.imag, up], axis=-1), stick
