"""Softness of the object: what Eq. (13) adds to the rotation of the elastomer.

[Li2024] M. Li, Y. H. Zhou, T. Li, Y. Jiang, "Incipient Slip-Based Rotation Measurement via
Visuotactile Sensing During In-Hand Object Pivoting", Eq. (13).
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contactmodel.rotation import object_rotation
from estimation.estimators.measurement import Z95, Measurement

FORMAT_VERSION = 1


@dataclass(frozen=True)
class ScalarSoftness:
    """Stiffness ratio and load term of an object on a sensor.

    Attributes:
        stiffness_ratio: k = G_S/G_B, elastomer over object [-]; 0 for a rigid object.
        load_term: L = L_xy − L_yx [rad], in the paper's sign.
        covariance: of (k, L), row by row.

    Raises:
        ValueError: k below 0, or a covariance that is none.
    """

    stiffness_ratio: float = 0.0
    load_term: float = 0.0
    covariance: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.0), (0.0, 0.0))

    def __post_init__(self) -> None:
        """Check the values."""
        if not (np.isfinite(self.stiffness_ratio) and self.stiffness_ratio >= 0.0):
            raise ValueError(f"stiffness ratio k is {self.stiffness_ratio}; it must be ≥ 0")
        if not np.isfinite(self.load_term):
            raise ValueError(f"load term L is {self.load_term}; it must be a number")
        matrix = np.asarray(self.covariance, dtype=float)
        if (
            matrix.shape != (2, 2)
            or not np.isfinite(matrix).all()
            or matrix[0, 1] != matrix[1, 0]
            or np.linalg.eigvalsh(matrix)[0] < -1e-12 * np.trace(matrix)
        ):
            raise ValueError(
                f"covariance of (k, L) is {self.covariance}; it must be a symmetric 2×2 matrix "
                "without negative eigenvalues"
            )

    def correct(self, gel: Measurement) -> tuple[float, float, float]:
        """The object's angle and the ends of its 95 % interval [rad, counter-clockwise].

        [Li2024] Eq. (13) with the sign turned; the interval takes in the covariance of (k, L).
        """
        angle = float(object_rotation(gel.angle, self.stiffness_ratio, self.load_term))
        gradient = np.array([gel.angle, -0.5])
        spread = Z95 * np.sqrt(gradient @ np.asarray(self.covariance) @ gradient)
        gain = 1.0 + self.stiffness_ratio
        below = np.hypot(gain * (gel.angle - gel.low), spread)
        above = np.hypot(gain * (gel.high - gel.angle), spread)
        return angle, float(angle - below), float(angle + above)


def read_softness(path: Path) -> ScalarSoftness:
    """Read a softness file.

    A TOML file with `format_version = 1`, `stiffness_ratio` k [-] and, if known, `load_term_rad`
    L [rad] and `covariance`, the 2×2 matrix of (k, L).

    Raises:
        OSError: the file cannot be read.
        ValueError: it is not such a file.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error
    version = content.pop("format_version", None)
    if version != FORMAT_VERSION:
        raise ValueError(
            f"{path}: format_version is {version}; this version reads {FORMAT_VERSION}"
        )
    known = {"stiffness_ratio", "load_term_rad", "covariance"}
    if unknown := sorted(set(content) - known):
        raise ValueError(f"{path}: unknown key {unknown[0]!r}; known are {sorted(known)}")
    if "stiffness_ratio" not in content:
        raise ValueError(f"{path} has no stiffness_ratio: give k, 0 for a rigid object")
    for name in known - {"covariance"}:
        if isinstance(content.get(name), bool):
            raise ValueError(f"{path}: {name} is {content[name]}; it must be a number")
    try:
        rows = content.get("covariance", [[0.0, 0.0], [0.0, 0.0]])
        (kk, kl), (lk, ll) = ((float(value) for value in row) for row in rows)
        return ScalarSoftness(
            stiffness_ratio=float(content["stiffness_ratio"]),
            load_term=float(content.get("load_term_rad", 0.0)),
            covariance=((kk, kl), (lk, ll)),
        )
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
