"""A softness of either kind, and the TOML files that keep it."""

from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from contactmodel.common.inputs import naming
from contactmodel.common.settings import from_table, read_toml, toml_text
from estimation.frames.files import write_whole
from estimation.softness.contact import Contact, Lifting
from estimation.softness.layered import LayeredSoftness
from estimation.softness.scalar import ScalarSoftness

FORMAT_VERSION = 1
"""Version of the format that is written and read."""


@runtime_checkable
class Softness(Protocol):
    """Turns the rotation of an elastomer into that of the object that sticks to it.

    Examples:
        >>> import numpy as np
        >>> from estimation import ScalarSoftness, Softness, estimate_angles, simulate_pivot
        >>> class Stiffening(ScalarSoftness):  # k falls as the grasp gets harder
        ...     def at(self, contact):
        ...         return ScalarSoftness(self.stiffness_ratio / (1 + contact.normal_force))
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> softness: Softness = Stiffening(0.5)
        >>> print(f"{np.degrees(estimate_angles(recording, softness=softness).angle[-1]):.1f}°")
        10.7°
    """

    @property
    def stiffness_ratio(self) -> float:
        """A typical k [-], for what must be known before there is a contact."""
        ...

    def lifting(self, points: Float[np.ndarray, "n 2"]) -> Lifting | None:
        """Displacements to add to those of the markers before a rotation is fitted; None for none.

        Args:
            points: the markers in the unloaded elastomer [mm].
        """
        ...

    def at(self, contact: Contact) -> ScalarSoftness:
        """k and L of one contact, after its fields have been lifted.

        Raises:
            ValueError: the contact lacks a quantity that the softness requires.
        """
        ...

    def content(self) -> dict[str, Any]:
        """The content of its file, `kind` first: plain values and tables of them."""
        ...


SOFTNESS_KINDS: dict[str, type[ScalarSoftness | LayeredSoftness]] = {
    "scalar": ScalarSoftness,
    "layered": LayeredSoftness,
}
"""Softnesses by their `kind` in a file."""


def expect_scale(softness: Softness, unit: str, name: str) -> None:
    """Check that lengths are in mm if a correction depends on lengths.

    Raises:
        ValueError: they are in px.
    """
    if isinstance(softness, LayeredSoftness) and softness.in_mm and unit != "mm":
        raise ValueError(
            f"{name}: lengths are in px, but the softness correction has a thickness, depth "
            "or radius in mm: give the scale of the pictures (--mm-per-px, or mm_per_px in the "
            "sensor description)"
        )


def write_softness(softness: Softness, path: str | Path) -> None:
    """Write a softness as a file that `read_softness` reads.

    Raises:
        OSError: the file cannot be written.

    Examples:
        >>> from pathlib import Path
        >>> from estimation import ScalarSoftness, write_softness
        >>> write_softness(ScalarSoftness(stiffness_ratio=0.5), Path("softness.toml"))
        >>> print(*Path("softness.toml").read_text().splitlines()[:3], sep=", ")
        format_version = 1, kind = "scalar", stiffness_ratio = 0.5
    """
    write_whole(Path(path), toml_text(softness.content(), FORMAT_VERSION))


def read_softness(path: str | Path) -> Softness:
    """Read a softness file.

    A TOML file with `format_version = 1`, `stiffness_ratio` k [-] and, if known, `load_term_rad`
    L [rad, or rad/N with `load_by_force = true`], `covariance`, the 2×2 matrix of (k, L), a table
    `validity` with `rotation_deg`, `normal_force_n` and `contact_radius_mm`, each as lowest and
    highest value, and a table `provenance` of anything that readers should know.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.

    Examples:
        >>> from pathlib import Path
        >>> from estimation import LayeredSoftness, read_softness, write_softness
        >>> write_softness(LayeredSoftness(0.5, thickness=4.0), Path("softness.toml"))
        >>> softness = read_softness(Path("softness.toml"))
        >>> print(f"k = {softness.stiffness_ratio}, {softness.thickness} mm thick")
        k = 0.5, 4.0 mm thick
    """
    # keys of version 0.1.0 and their present names
    renamed = {"validity.normal_force_N": "validity.normal_force_n"}
    path = Path(path)
    content = read_toml(path, FORMAT_VERSION, renamed)
    with naming(path):
        kind = content.pop("kind", "scalar")
        if not isinstance(kind, str) or kind not in SOFTNESS_KINDS:
            raise ValueError(
                f"unknown kind of softness {kind!r}; choose from {', '.join(SOFTNESS_KINDS)}"
            )
        return from_table(content, SOFTNESS_KINDS[kind])
