"""Stick and slip under a cube that is turned, and how its gel is displaced."""

import jax
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, SquarePunch, solve_contact

jax.config.update("jax_enable_x64", True)
grid, gel = Grid((32, 32), (14.0, 14.0)), HalfSpace(shear_modulus=0.2, poisson_ratio=0.5)
contact = Contact(gel, Rigid(), SquarePunch(10.3, 2.0), grid, friction_coefficient=0.4)
figure, axes = plt.subplots(1, 3, figsize=(8, 2.9), layout="constrained")
for axis, degrees in zip(axes, (2.0, 5.0, 9.0), strict=True):
    solution = solve_contact(contact, Pose(0.8, twist=np.radians(degrees)))
    state = np.where(solution.stick, 2, np.where(solution.sliding, 1, 0)).T
    colours = ListedColormap(["white", "#f0b27a", "#5dade2"])
    axis.imshow(state, origin="lower", extent=(-7, 7, -7, 7), cmap=colours, vmin=0, vmax=2)
    x, y = (points[::3, ::3] for points in grid.points)
    u, v, _ = (part[::3, ::3] for part in np.asarray(solution.elastomer_displacement()))
    axis.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=0.35, width=0.006)
    axis.set_title(f"{degrees:.0f}°: {float(solution.stick_ratio):.0%} sticks")
    axis.set(xticks=[-5, 0, 5], yticks=[-5, 0, 5], xlabel="x [mm]")
