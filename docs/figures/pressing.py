"""Hertz's pressure under a sphere, and the largest moment that friction carries, by softness."""

import matplotlib.pyplot as plt
import numpy as np

from contactmodel import analytic

SPHERE, GEL, FRICTION = 20.0, 0.2, 0.5  # R [mm], G of the gel [MPa], μ; ν of both bodies is ½


def press(force, ratio):
    """Hertz's contact under a force [N], for a stiffness ratio k."""
    modulus = 4.0 * GEL / (1.0 + ratio)  # E* [MPa]
    radius = np.cbrt(3.0 * force * SPHERE / (4.0 * modulus))
    return analytic.hertz_from_approach(radius**2 / SPHERE, SPHERE, modulus)


r, forces = np.linspace(0.0, 6.5, 300), np.linspace(0.0, 6.0, 60)
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
for ratio, name in ((0.0, "rigid object"), (1.0, "as soft as the gel")):
    for force, style in ((3.0, "-"), (6.0, "--")):
        hertz = press(force, ratio)
        pressure = analytic.hertz_pressure(r, hertz.radius, hertz.peak_pressure)
        colour = "C0" if ratio == 0.0 else "C1"
        left.plot(r, 1e3 * pressure, style, color=colour, label=f"{name}, {force:.0f} N")
    radius = press(forces, ratio).radius
    right.plot(forces, analytic.lubkin_moment(0.0, FRICTION, forces, radius), label=name)
left.set(xlabel="distance from the axis [mm]", ylabel="pressure [kPa]", ylim=(0, None))
right.set(xlabel="force [N]", ylabel="largest moment [N·mm]")
left.legend(fontsize=8)
right.legend()
