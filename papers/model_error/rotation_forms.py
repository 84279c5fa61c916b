"""Eqs. (3), (4) and (7) over the angle: errors of the small-angle forms.

Left: errors of the rigid part of ∂s_x/∂y as Eq. (3) prints it, and in the form of Eq. (4). Middle:
mean of the two line elements of Eq. (7) minus the polar rotation, for a stretched body, over the
direction of the stretch; the angle of the turn does not matter. Right: errors of linear elasticity
under a finite rotation (`papers.limits`).
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel.equations import (
    mean_line_rotation,
    polar_rotation,
    rotation_change,
    slip_shear,
    slip_shear_as_printed,
)
from papers.items import Track
from papers.limits import curl_shortfall, line_shortfall, traction_excess
from papers.model_error import settings
from papers.tables import cell, finish

STRAINS = (0.02, 0.05, 0.1)
"""Greatest principal strain; silicone under a twist of 20° has about 0.1."""


class Forms(NamedTuple):
    """Errors over the angle; the ending of a name is its unit.

    Attributes:
        angle_deg: θ [deg].
        printed_percent: error of Eq. (3) as printed, relative to the exact rigid part [%].
        small_percent: error of Eq. (4), relative to the exact rigid part [%].
        along_deg: direction of the greatest stretch, from the element AB [deg].
        elements_deg: mean of the two elements minus the polar rotation, by strain [deg].
        linear_deg: error of a line element under the linear twist [deg].
        curl_deg: error of half the curl under a true rotation [deg].
        traction_percent: excess of the traction under (R − I)r [%].
    """

    angle_deg: Float[np.ndarray, " n"]
    printed_percent: Float[np.ndarray, " n"]
    small_percent: Float[np.ndarray, " n"]
    along_deg: Float[np.ndarray, " m"]
    elements_deg: Float[np.ndarray, "strains m"]
    linear_deg: Float[np.ndarray, " n"]
    curl_deg: Float[np.ndarray, " n"]
    traction_percent: Float[np.ndarray, " n"]


def compute(quick: bool = False, track: Track = iter) -> Forms:
    """Evaluate the closed forms; the quick size is the full one."""
    angle_deg = np.linspace(0.5, 20.0, 40)
    theta = np.radians(angle_deg)
    none = np.zeros_like(theta)
    exact = np.asarray(slip_shear(none, 0.0, 0.0, theta))
    printed = np.asarray(slip_shear_as_printed(none, 0.0, 0.0, theta))
    along_deg = np.linspace(0.0, 90.0, 91)
    return Forms(
        angle_deg=angle_deg,
        printed_percent=100.0 * (printed / exact - 1.0),
        small_percent=100.0 * (theta / exact - 1.0),
        along_deg=along_deg,
        elements_deg=np.array([_elements(strain, np.radians(along_deg)) for strain in STRAINS]),
        linear_deg=np.degrees(line_shortfall(theta)),
        curl_deg=np.degrees(curl_shortfall(theta)),
        traction_percent=100.0 * traction_excess(theta, settings.POISSON_RATIO),
    )


def _elements(strain: float, along: np.ndarray) -> np.ndarray:
    """Error of the mean of two line elements of a body that is stretched, then turned [deg]."""
    axes = np.eye(2) + rotation_change(along)
    stretch = axes @ np.diag([1.0 + strain, 1.0 - strain]) @ np.swapaxes(axes, -1, -2)
    gradient = stretch + rotation_change(np.radians([settings.ANGLE_DEG])) @ stretch
    return np.degrees(mean_line_rotation(gradient) - polar_rotation(gradient))


def tables(result: Forms) -> dict[str, list[dict[str, object]]]:
    """A row for each of 2, 5, 10 and 20°."""
    rows, largest = [], np.abs(result.elements_deg[-1]).max()
    for angle in (2.0, 5.0, 10.0, 20.0):
        i = int(np.argmin(np.abs(result.angle_deg - angle)))
        rows.append(
            {
                "angle [°]": angle,
                "Eq. 3 printed [%]": cell(result.printed_percent[i], 2),
                "Eq. 4 [%]": cell(result.small_percent[i], 2),
                f"Eq. 7 at strain {STRAINS[-1]} [°]": cell(largest, 3),
                "linear twist's lines [°]": cell(result.linear_deg[i], 3),
                "half the curl [°]": cell(result.curl_deg[i], 3),
                "traction under (R−I)r [%]": cell(result.traction_percent[i], 2),
            }
        )
    return {"": rows}


def plot(result: Forms) -> Figure:
    """Three panels over the angle."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    left.plot(result.angle_deg, result.printed_percent, "C3", label="Eq. 3 as printed")
    left.plot(result.angle_deg, result.small_percent, "C0", label="Eq. 4: θ")
    left.set_ylabel("error of the rigid part [%]")
    for strain, error in zip(STRAINS, result.elements_deg, strict=True):
        middle.plot(result.along_deg, error, label=f"strain {strain:g}")
    middle.set_ylabel("mean of two elements, less polar rotation [°]")
    right.plot(result.angle_deg, result.linear_deg, "C0", label="lines of θ × r [°]")
    right.plot(result.angle_deg, result.curl_deg, "C2", label="half the curl of R − I [°]")
    right.set_ylabel("error [°]")
    excess = right.twinx()
    excess.plot(result.angle_deg, result.traction_percent, "C3--")
    excess.set_ylabel("excess traction under (R − I)r [%], dashed", color="C3")
    finish(left, right, xlabel="angle [°]")
    finish(middle, xlabel="direction of the stretch [°]")
    for axis in (left, middle, right):
        axis.legend(fontsize=8, loc="lower left" if axis is right else "upper left")
    return figure
