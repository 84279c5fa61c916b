"""
4. Your own indenter, and a fit of friction and softness
========================================================

The solver takes any shape whose height is a JAX function. All its results have gradients. So you
can add a shape of your own, and fit any number with a standard optimizer, in a few lines.
"""

# %%
# A shape
# -------
#
# A shape is a subclass of ``AbstractIndenter``: its sizes are fields, and ``height`` is its height
# above the pad. The base class is an ``equinox`` module, which makes the constructor from the
# fields. Write the height with ``jax.numpy``. With ``numpy`` it fails with a
# ``TracerArrayConversionError``.
#
# This shape is a paraboloid with a groove along y on its contact side, such as the seam of a tennis
# ball. The approach is measured from height 0, and the solver does not check that the shape reaches
# down to it. Here the lowest points lie beside the groove, at a height of 0.07 mm. So an approach
# of 0.8 mm presses the shape in by only 0.73 mm.

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optimistix
from matplotlib.colors import ListedColormap

from contactmodel import AbstractIndenter, Contact, Grid, HalfSpace, Pose, solve_contact

jax.config.update("jax_enable_x64", True)


class Seam(AbstractIndenter):
    """A paraboloid with a groove along y."""

    radius: float
    depth: float
    width: float

    def height(self, points):
        """Height above the pad [mm]."""
        x, y = points
        groove = self.depth * jnp.exp(-((x / self.width) ** 2))
        return (x**2 + y**2) / (2.0 * self.radius) + groove


seam = Seam(radius=12.0, depth=0.15, width=0.8)  # mm

# %%
# Press and twist
# ---------------
#
# A ``Contact`` has two bodies, a shape, a grid and a coefficient of friction. ``press`` below makes
# one from the gel, the object's body and the seam, and solves it for a pose. The pose approaches by
# 0.8 mm and twists by 6°. Its ``twist`` is in rad. The map shows where the object sticks to the gel
# and where it slips. The groove carries little pressure, so it slips early.
#
# One step is enough if pressing causes no slip: without friction, or between half-spaces of the
# same (1−2ν)/G. Here it is 0 for both, since ν is 0.5. Otherwise, or when in doubt, use two steps.
# Slip depends on the order of motions (:doc:`the contact remembers its past
# </docs/theory/reversals>`), and a single step presses and twists at once.
#
# For a thin gel write ``Layer(shear_modulus=0.2, poisson_ratio=0.5, thickness=4.0)`` in place of
# the first half-space. On a layer pressing causes slip even for a ν of 0.5. So always press first,
# then pass that solution on when you twist. With the names that ``press`` below defines:
#
# .. code-block:: python
#
#    contact = Contact(gel, body, seam, grid, friction)
#    pressed = solve_contact(contact, Pose(0.8))
#    turned = solve_contact(contact, Pose(0.8, twist=np.radians(6.0)), previous=pressed)

grid, pose = Grid((24, 24), (12.0, 12.0)), Pose(0.8, twist=np.radians(6.0))


def press(friction, ratio):
    """Solve the contact; ratio is k, the gel's stiffness over the object's."""
    gel = HalfSpace(shear_modulus=0.2, poisson_ratio=0.5)
    body = HalfSpace(shear_modulus=0.2 / ratio, poisson_ratio=0.5)
    return solve_contact(Contact(gel, body, seam, grid, friction), pose)


truth = press(friction=0.6, ratio=0.3)
state = np.where(truth.stick, 2, np.where(truth.sliding, 1, 0)).T
figure, axis = plt.subplots(figsize=(4, 3.4), layout="constrained")
axis.imshow(
    state,
    origin="lower",
    extent=(-6, 6, -6, 6),
    cmap=ListedColormap(["white", "orange", "skyblue"]),
)
axis.set(
    title=f"blue: sticks ({float(truth.stick_ratio):.0%} of the contact), orange: slips",
    xlabel="x [mm]",
)
axis.title.set_fontsize(9)

# %%
# Force and gradient
# ------------------
#
# ``jax.grad`` gives the gradient of the moment, and a small finite difference confirms it. This
# code is not run for this page, since compiling the first gradient takes about half a minute. Its
# output is in the comments:
#
# .. code-block:: python
#
#    moment = lambda friction, ratio: press(friction, ratio).moment
#    by_friction, by_ratio = jax.grad(moment, argnums=(0, 1))(0.6, 0.3)
#    steps = (moment(0.6 * 1.0001, 0.3) - moment(0.6 * 0.9999, 0.3)) / 0.00012
#    print(by_friction, steps)  # 1.0977 1.0977, in N·mm
#    print(by_ratio)  # -1.2172 N·mm
#    print(truth.force[2])  # -1.9193 N: the gel is pushed down, so its force along z is negative
#
# Give floats: JAX rejects the integer in ``jax.grad(f)(1)``. Keep the relative step of a finite
# difference near 1e-4. In larger steps cells change from stick to slip: a step of 0.1 is 6 % off
# here.
#
# The gradient belongs to the chosen grid, and converges more slowly than the moment. On 24², 48²
# and 96² cells the moment is 1.582, 1.584 and 1.584 N·mm. Its slope by friction is 1.098, 1.209 and
# 1.214 N·mm, so the slope on 24² cells is off by 10 % for this shape. Compare two grids before you
# rely on a gradient.
#
# Measure
# -------
#
# A sensor with a marker on every second cell sees displacements with noise of 1 µm. It also
# measures the moment about the axis, to 0.05 N·mm.


def observe(solution):
    """What the sensor measures, in units of its noise."""
    moved = solution.elastomer_displacement()[:2, ::2, ::2]
    return jnp.concatenate([moved.ravel() / 1e-3, solution.moment[None] / 0.05])


measured = observe(truth)
measured += np.random.default_rng(0).normal(size=measured.shape)

# %%
# Fit
# ---
#
# The residual is the model minus the measurement. We fit the logarithms of the two numbers, which
# keeps both above 0. ``optimistix`` solves the least-squares problem with the solver's derivatives.


def residual(logs, _):
    """Model minus measurement, in units of the noise."""
    friction, ratio = jnp.exp(logs)
    return observe(press(friction, ratio)) - measured


start = jnp.log(jnp.array([0.4, 0.1]))
solver = optimistix.LevenbergMarquardt(rtol=1e-6, atol=1e-6)
fit = optimistix.least_squares(residual, solver, start, options={"jac": "fwd"})

# %%
# The Jacobian at the solution gives the standard errors.

jacobian = jax.jit(jax.jacfwd(residual))(fit.value, None)
errors = jnp.sqrt(jnp.diag(jnp.linalg.inv(jacobian.T @ jacobian)))
for name, true, value, error in zip("μk", (0.6, 0.3), jnp.exp(fit.value), errors, strict=True):
    print(f"{name} = {value:.4f} ± {1.96 * error * value:.4f}, truth {true}")
freedom = len(measured) - 2
print(f"χ² per degree of freedom: {jnp.sum(residual(fit.value, None) ** 2) / freedom:.2f}")
