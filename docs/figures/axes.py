"""Axes and the sign of a rotation, seen from the side and from the object."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Rectangle

figure, (side, top) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")


def arrow(axis, start, end, colour="black"):
    """An arrow from a point to another."""
    axis.add_patch(
        FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=14, color=colour, lw=1.6)
    )


side.add_patch(Rectangle((-3, -2), 6, 2, color="#bcd7ea"))
side.add_patch(Circle((0, 1.75), 2.0, color="#e8c9a0"))
side.add_patch(Rectangle((-3, -2.3), 6, 0.3, color="#888888"))
side.text(-2.8, -1.0, "elastomer S")
side.text(0, 2.4, "object B", ha="center")
side.text(0, -3.0, "camera", ha="center")
arrow(side, (0, 0), (0, 1.6), "#c0392b")
side.text(0.15, 1.2, "z", color="#c0392b")
arrow(side, (0, 0), (1.8, 0), "#1f618d")
side.text(1.9, -0.1, "x", color="#1f618d")
side.set_title("from the side")

top.add_patch(Circle((0, 0), 2.3, color="#e8c9a0"))
arrow(top, (0, 0), (2.9, 0), "#1f618d")
arrow(top, (0, 0), (0, 2.9), "#1e8449")
top.text(3.0, -0.1, "x", color="#1f618d")
top.text(0.15, 2.8, "y", color="#1e8449")
top.plot(0, 0, "o", ms=9, mfc="white", mec="#c0392b")
top.plot(0, 0, ".", color="#c0392b")
top.text(-0.6, -0.7, "z, towards you", color="#c0392b")
top.add_patch(Arc((0, 0), 3.2, 3.2, theta1=15, theta2=75, lw=1.8))
angle = np.radians(75)
arrow(top, 1.6 * np.array([np.cos(angle - 0.1), np.sin(angle - 0.1)]), (0.28, 1.6))
top.text(1.25, 1.25, "+θ, +φ")
top.set_title("from the object")
for axis in (side, top):
    axis.set(xlim=(-3.4, 3.4), ylim=(-3.3, 4.0), aspect="equal")
    axis.set_axis_off()
