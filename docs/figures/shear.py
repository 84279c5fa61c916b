"""What sticks under a weight and a moment: a map, and the share that sticks over both loads."""

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Resultants, Rigid, solve_path

jax.config.update("jax_enable_x64", True)
PRESS, FRICTION, SPHERE = 3.0, 0.5, 20.0  # N, μ, mm
grid, gel = Grid((32, 32), (8.4, 8.4)), HalfSpace(shear_modulus=0.2, poisson_ratio=0.5)
contact = Contact(gel, Rigid(), Paraboloid(SPHERE), grid, FRICTION)
radius = np.cbrt(3.0 * PRESS * SPHERE / (4.0 * 0.8))  # Hertz, with E* = 0.8 MPa
most_shear = FRICTION * PRESS
most_moment = 3.0 * np.pi / 16.0 * most_shear * radius


def load(shear, moment):
    """Loads on the elastomer: the force, the weight along −y, and the moment."""
    weight = np.stack(np.broadcast_arrays(0.0, -shear), axis=-1)
    return Resultants(normal_force=PRESS, shear_force=weight, moment=moment)


def slide(centre):
    """Shares of the largest shear and moment if all slides about a point at x = `centre` [a]."""
    x, y = np.meshgrid(*[np.linspace(-0.995, 0.995, 200)] * 2)
    pressure = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    along = (x - centre) / np.hypot(x - centre, y)  # direction of the slip, its y component
    across = -y / np.hypot(x - centre, y)
    whole, arm = pressure.sum(), 3.0 * np.pi / 16.0
    moment = (pressure * (x * along - y * across)).sum() / whole / arm
    return -(pressure * along).sum() / whole, moment


figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.6), layout="constrained")
weight, moment = 0.4905, 0.4905 * 5.0  # half of 100 g, held 5 mm beside its centre of mass
rise = np.linspace(0.0, 0.97, 15)  # the loads rise together
whole = rise[1:] / rise[-1]
pose = Pose(np.full(len(whole), 0.7), linear=True)  # as in the closed forms
held = solve_path(contact, pose, load(whole * weight, whole * moment)).at_step(-1)
state = np.where(held.stick, 2, np.where(held.sliding, 1, 0)).T
colours = ListedColormap(["white", "#f0b27a", "#5dade2"])
left.imshow(state, origin="lower", extent=(-4.2, 4.2, -4.2, 4.2), cmap=colours, vmin=0, vmax=2)
x, y = (points[::3, ::3] for points in grid.points)
u, v = (part[::3, ::3] for part in np.asarray(held.traction))
left.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=0.04, width=0.006)
left.set(xlabel="x [mm]", ylabel="y [mm]", title=f"{float(held.stick_ratio):.0%} sticks")

limit = np.array([slide(centre) for centre in np.append(np.geomspace(100.0, 0.01, 60), 0.0)]).T
directions = np.radians(np.linspace(0.0, 90.0, 10))  # from shear alone to moment alone
ends = np.interp(directions, np.arctan2(limit[1], limit[0]), np.hypot(*limit))
shears, moments = (np.outer(ends * f(directions), rise) for f in (np.cos, np.sin))
sticks = np.ones(shears.shape)
for row, (shear, turn) in enumerate(zip(shears[:, 1:], moments[:, 1:], strict=True)):
    loads = load(shear * most_shear, turn * most_moment)
    sticks[row, 1:] = solve_path(contact, pose, loads).stick_ratio
drawn = right.contourf(shears, moments, sticks, levels=np.linspace(0.0, 1.0, 5), cmap="Blues")
figure.colorbar(drawn, label="share that sticks", format="{x:.0%}")
right.plot(*limit, "k", label="all slides")
right.plot(np.cos(directions), np.sin(directions), "k--", lw=1, label="ellipse")
right.plot(weight / most_shear, moment / most_moment, "o", color="#c0392b", label="contact at left")
right.set(xlabel="shear force / μP", ylabel="moment / largest moment", xlim=(0, 1), ylim=(0, 1.05))
right.legend(fontsize=8, loc="lower left")
