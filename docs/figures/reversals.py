"""Moment over angle of a round contact that is turned to and fro, and what sticks meanwhile."""

import matplotlib.pyplot as plt
import numpy as np

from contactmodel import analytic

friction_ratio = 0.2  # μp₀/2G* [-]


def virgin(twist):
    """Moment of the first turn, odd in the twist [N·mm]; μ = 0.5, 5 N, 4 mm."""
    stick = analytic.lubkin_stick_ratio(np.abs(twist), friction_ratio)
    return np.sign(twist) * analytic.lubkin_moment(stick, 0.5, 5.0, 4.0)


legs = [(), (np.radians(15.0),), (np.radians(15.0), np.radians(-10.0))]
ends = np.radians([0.0, 15.0, -10.0, 15.0])
names = ("first turn", "back", "forward again")
figure, axis = plt.subplots(figsize=(5.5, 3.4), layout="constrained")
for turns, begin, end, name in zip(legs, ends[:-1], ends[1:], names, strict=True):
    twist = np.linspace(begin, end, 80)[1:-1]
    axis.plot(np.degrees(twist), [analytic.masing(virgin, turns, one) for one in twist], label=name)
axis.axhline(0.0, color="black", lw=0.6)
axis.set(xlabel="object's angle [°]", ylabel="moment [N·mm]")
axis.legend()
