"""
5. A map of a model's error
===========================

The simplest equation of rotation says that the object turns as far as the gel that sticks to it.
How wrong is that for a soft object on a thin gel? Solve a few contacts, and draw a map to read the
correction from.
"""

# %%
# One case
# --------
#
# A cube's face of 15 mm is pressed against the gel and twisted by 1°, with friction so high that
# all of it sticks. The share missed is 1 − φ/θ. Here φ is the gel's rotation in the middle of the
# face, and θ is the object's. We fit φ to displacements, as an estimator does.

import jax
import matplotlib.pyplot as plt
import numpy as np

from contactmodel import Contact, Grid, HalfSpace, Layer, Pose, SquarePunch, solve_contact

jax.config.update("jax_enable_x64", True)

grid, twist = Grid((24, 24), (20.0, 20.0)), np.radians(1.0)
pose = Pose(0.3, twist=twist)
x, y = grid.points
middle = (np.abs(x) < 5.0) & (np.abs(y) < 5.0)


def missed(thickness, ratio):
    """Share of the object's turn that the gel does not show [%]; ratio is k."""
    gel = Layer(shear_modulus=0.2, poisson_ratio=0.48, thickness=thickness)
    body = HalfSpace(shear_modulus=0.2 / ratio, poisson_ratio=0.48)
    face = SquarePunch(width=15.0, edge_radius=1.0)
    solution = solve_contact(Contact(gel, body, face, grid, friction_coefficient=5.0), pose)
    u, v, _ = np.asarray(solution.elastomer_displacement())
    rotation = np.sum((x * v - y * u)[middle]) / np.sum((x**2 + y**2)[middle])
    return 100.0 * (1.0 - rotation / twist)


print(f"k = 0.1 on 3 mm of gel: {missed(3.0, 0.1):.1f} % missed")

# %%
# The map
# -------
#
# All cases run through one compiled program, so the first one takes most of the time.

ratios, thicknesses = np.array([0.03, 0.1, 0.3, 1.0]), np.array([2.0, 3.0, 5.0, 10.0])
table = np.array([[missed(thickness, ratio) for ratio in ratios] for thickness in thicknesses])

figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
drawn = axis.contourf(ratios, thicknesses, table, levels=np.arange(0, 75, 5), cmap="viridis")
axis.contour(ratios, thicknesses, table, levels=[5, 10, 20, 50], colors="white")
axis.set(xscale="log", yscale="log", xlabel="k = gel's stiffness / object's", ylabel="gel [mm]")
figure.colorbar(drawn, label="turn missed [%]")

# %%
# How to read it
# --------------
#
# Find the object's k and the gel's thickness. At 50 %, the object has turned twice as far as the
# gel shows. On a thick gel the share is k/(1 + k), whatever the shape. A thin gel misses more,
# since its base holds it back.

print("thick gel, k/(1 + k):", *(f"{100 * ratio / (1 + ratio):.1f} %" for ratio in ratios))
print("10 mm, by the solver:", *(f"{share:.1f} %" for share in table[-1]))

# %%
# Maps of more cases
# ------------------
#
# ``python -m papers run model_error`` maps every equation of the source paper. A study of
# thousands of contacts is a Python module with a table of cases, run by ``python -m papers
# sweep``. It can use several processes or a cluster. An interrupted sweep resumes. The page
# :doc:`How to … </docs/howto>` shows such a module.
