"""Which equations hold at finite strain: Eqs. (2) to (14) on finite-element fields.

The fields are those of `papers.finite_strain`: gels pressed by up to a quarter of their thickness
and turned by 20°. Motion counts from the press. Under rigid spheres and punches the slip is known
exactly; under soft balls the points that stick show the object's surface too, since both surfaces
move together there. On a round contact, a point at the radius ρ₀ moves to ρ and turns by ψ. In the
radial basis the deformation gradient is F = R(ψ) [[ρ', 0], [ρψ', ρ/ρ₀]].
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from contactmodel.common.arrays import AnyArray
from contactmodel.equations import (
    mean_line_rotation,
    object_rotation,
    polar_rotation,
    rotation_change,
    rotation_difference,
    slip_shear,
    slip_shear_as_printed,
    small_rotation,
    small_slip_shears,
)
from papers.finite_strain.field_fits import CASES, read_fields
from papers.finite_strain.grasps import BALLS, read_grasps
from papers.finite_strain.surface import Surface
from papers.items import Track
from papers.tables import cell, finish

_AZIMUTHS = np.radians(np.arange(0.0, 90.0, 5.0))


class Rigid(NamedTuple):
    """Deviations under a rigid object, largest of the points [deg], [-].

    Attributes:
        name: the contact.
        depth: depth over thickness [-].
        turn: twist [rad].
        stick_deg: rotation of the points that stick minus the twist (Eq. 14).
        shear: Eqs. (3), (3) as printed and (4), where the gel sticks: shear of the slip over
            sin θ; the true one is 0.
        curl_deg: half the curl minus the polar rotation, in the contact (Eq. 8).
        lines_deg: mean of two lines minus the polar rotation, in the contact (Eqs. 7 and 8).
        slip_deg: polar rotation minus the twist, minus the same by Eq. (11) from the slip. With
            half the curl and sin θ in their place Eq. (11) is an identity.
    """

    name: str
    depth: float
    turn: float
    stick_deg: float
    shear: Float[np.ndarray, "3"]
    curl_deg: float
    lines_deg: float
    slip_deg: float


class Soft(NamedTuple):
    """Ratios under a soft ball, by twist of its grip.

    Attributes:
        name: the ball.
        k: shear modulus of the gel over the ball's [-].
        size: radius of the contact over the ball's [-].
        turn: twist [rad].
        total: θ/φ − 1, mean of the points that have always stuck; k by Eq. (13) [-].
        rate: Δθ/Δφ − 1 of the last step; k by Eq. (12) [-].
        spread: standard deviation of φ over these points, over its mean [-].
        components: residual of Eq. (2) with k from the curl, by component ρρ, ρψ, ψρ and ψψ:
            standard deviation over the points, over the norm of the ball's gradient [-].
    """

    name: str
    k: float
    size: float
    turn: Float[np.ndarray, " steps"]
    total: Float[np.ndarray, " steps"]
    rate: Float[np.ndarray, " steps"]
    spread: Float[np.ndarray, " steps"]
    components: Float[np.ndarray, "steps 4"]


class Result(NamedTuple):
    """Deviations under rigid objects and under soft balls."""

    rigid: list[Rigid]
    soft: list[Soft]


def compute(quick: bool = False, track: Track = iter) -> Result:
    """Read all stored contacts, in seconds; the quick size has some of the rigid objects."""
    stored = list(zip(CASES, read_fields(), strict=True))[:: 4 if quick else 1]
    rigid = []
    for case, one in track(stored):
        name = f"punch {case.flat_mm:g}" if case.flat_mm else f"sphere {case.edge_mm:g}"
        name = f"{name}, h {case.thickness_mm:g}, μ {case.friction:g}"
        inside = _within(one.surface, one.contact_mm)
        for step in (1, 2):
            rigid.append(_under_rigid(one.surface, inside, step, name, case.depth_mm / case[6]))
    soft = [
        _under_soft(grasp.surface, _within(grasp.surface, grasp.contact_mm), name, ball.ratio,
                    grasp.contact_mm / ball.radius_mm)
        for name, ball in BALLS.items()
        for grasp in read_grasps()[name]
        if isinstance(grasp.surface, Surface)
    ]  # fmt: skip
    return Result(rigid, soft)


def _within(surface: Surface, contact_mm: float) -> Bool[np.ndarray, " points"]:
    return (surface.radius > 0.0) & (surface.radius < contact_mm)


def find_gradient(surface: Surface, step: int) -> Float[np.ndarray, "points 2 2"]:
    """F of the surface's motion in its plane since the press, in the radial basis [-].

    Args:
        surface: the motion; its first step is the press.
        step: index of the step.
    """
    before, now = (surface.radius + m[:, 0] + 1j * m[:, 1] for m in surface.moved[[0, step]])
    first, after = np.abs(before), np.abs(now)
    turned = np.angle(now * before.conj())
    turned[0] = turned[1]  # on the axis, where it is not defined
    with np.errstate(divide="ignore", invalid="ignore"):  # on the axis
        long, shear = np.gradient(after, first), after * np.gradient(turned, first)
        wide = after / first
    none = np.zeros_like(first)
    stretched = np.stack([np.stack([long, none], -1), np.stack([shear, wide], -1)], -2)
    return (np.eye(2) + rotation_change(turned)) @ stretched


def _under_rigid(surface: Surface, inside: np.ndarray, step: int, name: str, depth: float) -> Rigid:
    theta = float(surface.twist[step] - surface.twist[0])
    f = find_gradient(surface, step)[inside]
    # neighbours within the stick region, so that no difference reaches into the slip
    still = np.all(surface.stick[1 : step + 1], axis=0)
    still = (still & np.roll(still, 1) & np.roll(still, -1))[inside]
    polar, moved = polar_rotation(f), f - np.eye(2)
    clockwise = np.asarray(-theta)
    forms = [
        slip_shear(moved[still, 0, 1], 0.0, 0.0, clockwise),
        slip_shear_as_printed(moved[still, 0, 1], 0.0, 0.0, clockwise),
        small_slip_shears(moved[still], 0.0, (0.0, 0.0), clockwise)[0],
    ]
    shear = (
        [np.max(np.abs(form)) / np.sin(theta) for form in forms] if still.any() else [np.nan] * 3
    )
    slip_curl = 2.0 * (np.sin(theta) - small_rotation(moved))
    expected = rotation_difference(slip_curl)
    by_lines = [mean_line_rotation(_turn(f, azimuth)) for azimuth in _AZIMUTHS]

    def largest(values: AnyArray) -> float:
        return float(np.degrees(np.max(np.abs(np.asarray(values)), initial=0.0)))

    return Rigid(
        name,
        depth,
        theta,
        largest(np.asarray(object_rotation(polar[still])) - theta) if still.any() else np.nan,
        np.array(shear),
        largest(small_rotation(moved) - polar),
        largest(np.stack(by_lines) - polar),
        largest(polar - theta - expected),
    )


def _turn(f: np.ndarray, azimuth: float) -> np.ndarray:
    """F in axes turned by an azimuth."""
    turn = np.eye(2) + rotation_change(np.asarray(azimuth))
    return turn.T @ f @ turn


def _under_soft(surface: Surface, inside: np.ndarray, name: str, k: float, size: float) -> Soft:
    steps = np.arange(1, len(surface.twist))
    still = np.logical_and.accumulate(surface.stick[1:], axis=0)
    still = still & np.roll(still, 1, axis=1) & np.roll(still, -1, axis=1) & inside
    theta = surface.twist[1:] - surface.twist[0]
    gradients = [find_gradient(surface, int(step)) for step in steps]
    angle = np.array([polar_rotation(f) for f in gradients])
    total, rate, spread, parts = [], [], [], []
    for i, (mask, f) in enumerate(zip(still, gradients, strict=True)):
        if mask.sum() < 4:
            for found in (total, rate, spread):
                found.append(np.nan)
            parts.append(np.full(4, np.nan))
            continue
        phi = angle[i, mask]
        past = (angle[i - 1, mask].mean(), theta[i - 1]) if i else (0.0, 0.0)
        total.append(theta[i] / phi.mean() - 1.0)
        rate.append((theta[i] - past[1]) / (phi.mean() - past[0]) - 1.0)
        spread.append(phi.std() / phi.mean())
        # the ball's surface in the frame of its grip: both surfaces move together
        back = np.eye(2) + rotation_change(np.asarray(-theta[i]))
        ball, gel = (back @ f[mask] - np.eye(2)), f[mask] - np.eye(2)
        ratio = -small_rotation(ball).mean() / small_rotation(gel).mean()
        residual = (ball + ratio * gel).reshape(-1, 4)
        parts.append(residual.std(axis=0) / np.sqrt(np.mean(np.sum(ball**2, axis=(1, 2)))))
    return Soft(name, k, size, theta, *map(np.array, (total, rate, spread, parts)))


def tables(result: Result) -> dict[str, list[dict[str, object]]]:
    """Rows for each rigid contact and twist, and for each soft ball, in degrees and per cent."""
    rigid = [
        {
            "contact": one.name,
            "depth/h": round(one.depth, 3),
            "twist [°]": round(float(np.degrees(one.turn))),
            "Eq. 14, where it sticks [°]": cell(one.stick_deg, 4),
            "Eq. 3 exact [%]": cell(100 * one.shear[0], 2),
            "Eq. 3 as printed [%]": cell(100 * one.shear[1], 2),
            "Eq. 4 [%]": cell(100 * one.shear[2], 2),
            "Eq. 8, half the curl [°]": cell(one.curl_deg, 2),
            "Eqs. 7 and 8, two lines [°]": cell(one.lines_deg, 2),
            "Eq. 11, rotation [°]": cell(one.slip_deg, 2),
        }
        for one in result.rigid
    ]
    soft = []
    for one in result.soft:
        row: dict[str, object] = {"ball": one.name, "k": one.k, "a/R": round(one.size, 2)}
        for degrees in (2, 10, 20):
            i = int(np.argmin(np.abs(np.degrees(one.turn) - degrees)))
            row[f"k by Eq. 13 over k, {degrees}°"] = cell(one.total[i] / one.k, 3)
            row[f"k by Eq. 12 over k, {degrees}°"] = cell(one.rate[i] / one.k, 3)
            row[f"spread of φ, {degrees}° [%]"] = cell(100 * one.spread[i], 2)
            row[f"Eq. 2, {degrees}° [%]"] = cell(100 * one.components[i], 1, np.max)
        soft.append(row)
    return {"": rigid, "_soft": soft}


def plot(result: Result) -> Figure:
    """Left: errors of rotation under rigid objects at 20°. Right: k by Eq. 13 over the twist."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.2), layout="constrained")
    names = ("curl_deg", "lines_deg", "slip_deg", "stick_deg")
    labels = ("Eq. 8: half the curl", "Eqs. 7, 8: two lines", "Eq. 11: from the slip",
              "Eq. 14: points that stick")  # fmt: skip
    for i, (name, label) in enumerate(zip(names, labels, strict=True)):
        shown = [one for one in result.rigid if one.turn > 0.3]
        left.plot([one.depth for one in shown], [getattr(one, name) for one in shown], "os^v"[i],
                  color=f"C{i}", ms=4, label=label)  # fmt: skip
    for one in result.soft:
        colour = f"C{list(BALLS).index(one.name)}"
        right.plot(np.degrees(one.turn), one.total / one.k, "-", color=colour,
                   label=f"{one.name}, a/R {one.size:.2f}", lw=0.8 + 5 * one.size)  # fmt: skip
    finish(left, legend=8, title="rigid objects, turned by 20°", xlabel="depth over thickness [-]",
           ylabel="largest error in the contact [°]")  # fmt: skip
    right.legend(fontsize=6, loc="center left", bbox_to_anchor=(1.0, 0.5))
    finish(right, title="soft balls; wider lines: larger contacts",
           xlabel="twist of the grip [°]", ylabel="k by Eq. 13 over k [-]")  # fmt: skip
    return figure
