"""Section VI: an object as soft as the elastomer, and the error of "about 70 %".

The cube's whole face sticks; φ is a rigid fit of its inner 0.7, like that of a marker array. Two
half-spaces of equal shear modulus miss 50 %: the elastomer turns half as much as the object. A thin
elastomer misses more, and so do markers below its surface. The object's width matters too. The wide
extreme is a half-space. The narrow extreme is a free prism as wide as its face, loaded over the
whole face. Over its length l, up to the point where the angle is measured, it turns by M l/GJ; its
face is assumed to stay plane.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from contactmodel import (
    AbstractBody,
    Contact,
    Grid,
    HalfSpace,
    Layer,
    Pose,
    Rigid,
    SquarePunch,
    solve_contact,
)
from estimation.softness.lifting import small_turn
from papers.items import Track
from papers.li2024 import settings
from papers.tables import cell, finish

THICKNESSES_MM = (2.0, 2.5, 3.0, 4.0, 5.0, 8.0, np.inf)
DEPTHS_MM = (0.0, 0.25, 0.5, 1.0)
LENGTHS_MM = tuple(np.linspace(0.0, 10.0, 41).tolist())
"""Length of the prism between the contact and the point where the angle is measured."""

PRINTED_PERCENT, ABOUT_PERCENT = 70.0, 2.5
"""The printed error, and the tolerance assumed for "about"."""

_SHEAR_MODULUS, _POISSON_RATIO = 0.2, 0.48
_INNER = 0.7
_PRISM = 0.1406  # of a square shaft: J is this times the fourth power of its side
_GRID = Grid((48, 48), (20.0, 20.0))
_QUICK = (2.0, 5.0, np.inf)


class Missed(NamedTuple):
    """Share of the object's turn that the markers miss.

    Attributes:
        thickness: thickness of the elastomer [mm].
        wide: share for an object much wider than its face, by thickness and marker depth [%].
        prism: share for an object as wide as its face, by thickness, marker depth and length [%].
    """

    thickness: tuple[float, ...]
    wide: Float[np.ndarray, "thicknesses depths"]
    prism: Float[np.ndarray, "thicknesses depths lengths"]


def compute(quick: bool = False, track: Track = iter) -> Missed:
    """Solve two contacts for each thickness; the quick size has three thicknesses."""
    thicknesses = _QUICK if quick else THICKNESSES_MM
    shares = [_missed(thickness) for thickness in track(thicknesses)]
    wide, prism = (np.array(part) for part in zip(*shares, strict=True))
    return Missed(thicknesses, wide, prism)


def _missed(thickness: float) -> tuple[Float[np.ndarray, " depths"], np.ndarray]:
    """The missed share of a wide object, by depth, and of a prism, by depth and length [%]."""
    modulus, nu = _SHEAR_MODULUS, _POISSON_RATIO
    pad = HalfSpace(modulus, nu) if np.isinf(thickness) else Layer(modulus, nu, thickness)
    shown, _ = _twist(pad, HalfSpace(modulus, nu))
    face, moment = _twist(pad, Rigid())
    stiffness = modulus * _PRISM * settings.CUBE_MM**4
    turned = 1.0 + moment * np.array(LENGTHS_MM) / stiffness
    return 100.0 * (1.0 - shown), 100.0 * (1.0 - face[:, None] / turned)


def _twist(pad: AbstractBody, object_: AbstractBody) -> tuple[Float[np.ndarray, " depths"], float]:
    """φ at each depth, and the moment, both over the object's twist [-, N·mm/rad]."""
    twist = 1e-3
    solution = solve_contact(
        Contact(pad, object_, SquarePunch(settings.CUBE_MM), _GRID, 20.0),
        Pose(0.5, twist=twist, linear=True),
        rtol=1e-6,
    )
    reach = 0.5 * _INNER * settings.CUBE_MM
    points = np.stack(np.meshgrid(*[np.linspace(-reach, reach, 11)] * 2), -1).reshape(-1, 2)
    moved = [np.asarray(solution.elastomer_displacement_at(points, z)) for z in DEPTHS_MM]
    # the symmetric motion due to pressing cancels
    turns = np.array([small_turn(points, u[:, :2]) for u in moved])
    return turns / twist, float(solution.moment) / twist


def numbers(result: Missed) -> dict[str, float]:
    """Our numbers for `published.csv`: a wide object, thinnest and thickest, surface markers."""
    return {
        "error_thin": float(result.wide[0, 0]),
        "error_half_space": float(result.wide[-1, 0]),
    }


def tables(result: Missed) -> dict[str, list[dict[str, object]]]:
    """The effect of each cause, and the combinations that give about the printed error."""
    deep, length = DEPTHS_MM.index(0.5), LENGTHS_MM.index(4.0)
    rows, combinations = [], []
    for i, thickness in enumerate(result.thickness):
        wide, prism = result.wide[i], result.prism[i]
        rows.append(
            {
                "elastomer [mm]": thickness,
                "wide object [%]": cell(wide[0], 1),
                "markers 0.5 mm deep [%]": cell(wide[deep], 1),
                "4 mm of prism [%]": cell(prism[0, length], 1),
                "4 mm, markers 0.5 mm deep [%]": cell(prism[deep, length], 1),
            }
        )
        for j, depth in enumerate(DEPTHS_MM):
            fits = np.abs(prism[j] - PRINTED_PERCENT) <= ABOUT_PERCENT
            lengths = np.array(LENGTHS_MM)[fits]
            combinations.append(
                {
                    "elastomer [mm]": thickness,
                    "markers' depth [mm]": depth,
                    "wide object": abs(float(wide[j]) - PRINTED_PERCENT) <= ABOUT_PERCENT,
                    "prism from [mm]": float(lengths.min()) if fits.any() else None,
                    "to [mm]": float(lengths.max()) if fits.any() else None,
                }
            )
    return {"": rows, "_combinations": combinations}


def plot(result: Missed) -> Figure:
    """The missed share over thickness and depth (wide object) and length (prism); grey: 70 %."""
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.2), sharey=True, layout="constrained")
    place, deep = np.arange(len(result.thickness)), DEPTHS_MM.index(0.5)
    half_spaces = np.full(len(place), result.wide[-1, 0])
    parts = (
        ("two half-spaces", half_spaces),
        ("thickness", result.wide[:, 0] - half_spaces),
        ("markers 0.5 mm deep", result.wide[:, deep] - result.wide[:, 0]),
    )
    base = np.zeros(len(place))
    for name, height in parts:
        axes[0].bar(place, height, bottom=base, label=name)
        base = base + height
    axes[0].set_xticks(place, [f"{h:g}".replace("inf", "∞") for h in result.thickness])
    missed = "share of the turn that is missed [%]"
    axes[0].set(xlabel="thickness of the elastomer [mm]", ylabel=missed, ylim=(0, 100))
    for i, thickness in enumerate(result.thickness):
        name = f"elastomer {thickness:g} mm".replace("inf mm", "∞")
        axes[1].plot(DEPTHS_MM, result.wide[i], "o-", ms=3, label=name)
        axes[2].plot(LENGTHS_MM, result.prism[i, 0], label=name)
    axes[1].set_xlabel("depth of the markers [mm]")
    axes[2].set_xlabel("length of the prism [mm]")
    titles = ("wide object", "wide object", "prism as wide as its face, markers at the surface")
    for axis, title in zip(axes, titles, strict=True):
        axis.axhspan(PRINTED_PERCENT - ABOUT_PERCENT, PRINTED_PERCENT + ABOUT_PERCENT,
                     color="0.85", zorder=0, label="paper, hardware: about 70 %")  # fmt: skip
        finish(axis, legend=7, title=title)
    return figure
