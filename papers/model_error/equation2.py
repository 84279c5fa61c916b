"""The residual of Eq. (2) by component; it vanishes in the curl.

By Eq. (2), the gradients of the two bodies' displacements are proportional up to a constant:
D_m u_B,n = −k D_m u_S,n + l_mn. Here the contact model gives both, for a ball pressed and turned by
10°. Poisson's ratio of the object, the approach and the elastomer's thickness vary. The residual of
a component is its deviation from its mean over the contact, relative to the gradients that it
should cancel.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.ndimage import binary_erosion

from contactmodel import (
    Contact,
    ContactSolution,
    Grid,
    HalfSpace,
    Layer,
    Paraboloid,
    Pose,
    solve_contact,
    stiffness_ratio,
)
from papers.items import Track
from papers.model_error import settings
from papers.tables import cell, finish

K = 0.5
RADIUS, APPROACH = 20.0, 0.8  # mm
NU_OBJECT = (0.0, 0.1, 0.2, 0.3, 0.4, 0.48)
APPROACHES = (0.2, 0.4, 0.8, 1.2)
THICKNESSES = (2.0, 3.0, 5.0, 8.0, 20.0, np.inf)
COMPONENTS = ("x of x", "y of x", "x of y", "y of y", "curl")
_GRID = Grid((64, 64), (14.0, 14.0))
_FRICTION = 0.8


class Residuals(NamedTuple):
    """Relative root mean square of the residual in each of `COMPONENTS` [-].

    Attributes:
        over_poisson: by ν of the object; both bodies are half-spaces.
        over_approach: by the approach; ν of the object is 0.3.
        over_thickness: by the elastomer's thickness; Poisson's ratios are equal.
    """

    over_poisson: Float[np.ndarray, "nu components"]
    over_approach: Float[np.ndarray, "approaches components"]
    over_thickness: Float[np.ndarray, "thicknesses components"]


def compute(quick: bool = False, track: Track = iter) -> Residuals:
    """Solve each contact; the quick size has every second one."""
    every = slice(None, None, 2 if quick else 1)
    nu = settings.POISSON_RATIO
    cases = (
        [(np.inf, nu_b, APPROACH) for nu_b in NU_OBJECT[every]]
        + [(np.inf, 0.3, approach) for approach in APPROACHES[every]]
        + [(h, nu, APPROACH) for h in THICKNESSES[every]]
    )
    residuals = np.array([_residuals(*case) for case in track(cases)])
    first, second = len(NU_OBJECT[every]), len(APPROACHES[every])
    return Residuals(
        residuals[:first], residuals[first : first + second], residuals[first + second :]
    )


def _residuals(thickness: float, object_poisson: float, approach: float) -> list[float]:
    modulus, nu = settings.SHEAR_MODULUS, settings.POISSON_RATIO
    pad = HalfSpace(modulus, nu) if np.isinf(thickness) else Layer(modulus, nu, thickness)
    solution = solve_contact(
        Contact(pad, HalfSpace(modulus / K, object_poisson), Paraboloid(RADIUS), _GRID, _FRICTION),
        Pose(approach, twist=np.radians(settings.ANGLE_DEG), linear=True),
        rtol=1e-7,
    )
    inner = np.asarray(binary_erosion(solution.contact), bool)  # no difference reaches outside
    k = float(stiffness_ratio(pad, solution.problem.object_))
    left = [_gradient(solution, "object_displacement", inner)]
    right = [k * _gradient(solution, "elastomer_displacement", inner)]
    residual, scale = left[0] + right[0], right[0]
    curl = np.asarray(solution.object_rotation() + k * solution.elastomer_rotation())[inner]
    turned = k * np.asarray(solution.elastomer_rotation())[inner]
    norm = np.sqrt((scale[[1, 2]] ** 2).mean())  # of the gradients that contain the rotation
    return [*(residual.std(axis=1) / norm), _rms(curl) / _rms(turned)]


def _gradient(solution: ContactSolution, name: str, inner: np.ndarray) -> np.ndarray:
    """D_x u_x, D_y u_x, D_x u_y, D_y u_y in the cells of a mask, by central differences."""
    u_x, u_y = np.asarray(getattr(solution, name)())[:2]
    parts = [d for u in (u_x, u_y) for d in np.gradient(u, *_GRID.spacing)]
    return np.stack([part[inner] for part in parts])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def tables(result: Residuals) -> dict[str, list[dict[str, object]]]:
    """Three tables in one: the varied quantity, and the residual of each component [%]."""
    rows = []
    for name, (unit, values, residuals) in _panels(result).items():
        for value, row in zip(values, residuals, strict=True):
            percent = {c: cell(100 * r, 3) for c, r in zip(COMPONENTS, row, strict=True)}
            rows.append({"varied": name, "value": f"{value:g} {unit}"} | percent)
    return {"": rows}


def _panels(result: Residuals) -> dict[str, tuple[str, tuple[float, ...], np.ndarray]]:
    def taken(values: tuple[float, ...], found: np.ndarray) -> tuple[float, ...]:
        return values if len(found) == len(values) else values[::2]

    return {
        "ν of the object": ("", taken(NU_OBJECT, result.over_poisson), result.over_poisson),
        "approach": ("mm", taken(APPROACHES, result.over_approach), result.over_approach),
        "thickness": ("mm", taken(THICKNESSES, result.over_thickness), result.over_thickness),
    }


def plot(result: Residuals) -> Figure:
    """Residual of each component, a panel for each varied quantity."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4), sharey=True, layout="constrained")
    for axis, (name, (unit, values, found)) in zip(axes, _panels(result).items(), strict=True):
        place = np.arange(len(values))
        for i, component in enumerate(COMPONENTS):
            style = "k-" if component == "curl" else f"C{i}--"  # pairs coincide by symmetry
            shown = np.maximum(100 * found[:, i], 1e-7)
            label = component if component == "curl" else f"D_{component}".replace(" of ", " u_")
            axis.semilogy(place, shown, style, marker="os^vD"[i], ms=9 - 1.5 * i, label=label)
        axis.set_xticks(place, [f"{value:g}".replace("inf", "∞") for value in values])
        finish(axis, minor=True, xlabel=f"{name} [{unit or '-'}]")
    axes[0].set_ylabel("residual of Eq. 2 [% of k D u_S]\n(drawn at 10⁻⁷ if smaller)")
    axes[0].legend(fontsize=8)
    return figure
