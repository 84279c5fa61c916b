"""Torsion of a round contact: how far the gel turns, and the shear traction, by radius."""

import matplotlib.pyplot as plt
import numpy as np

from contactmodel import analytic

friction_ratio, modulus = 0.3, 0.1  # μp₀/2G* [-], G* [MPa]
density = analytic.hertz_density(1.0, friction_ratio)
r = np.linspace(0.005, 1.0, 200)
figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
for stick in (0.9, 0.7, 0.5, 0.3):
    twist = float(analytic.torsion_twist(density, stick, 1.0))
    turned = analytic.torsion_displacement(r, density, stick, 1.0) / r
    traction = analytic.torsion_traction(r, density, stick, 1.0, modulus)
    left.plot(r, turned / twist, label=f"{np.degrees(twist):.0f}°")
    right.plot(r, traction / (2.0 * modulus * friction_ratio))
right.plot(r, np.sqrt(1.0 - r**2), "k--", lw=1, label="friction limit")
left.set(xlabel="distance from the axis, r/a", ylabel="gel's rotation / object's", ylim=(0, 1.05))
right.set(xlabel="distance from the axis, r/a", ylabel="shear traction / μp₀")
left.legend(title="object turned by")
right.legend()
