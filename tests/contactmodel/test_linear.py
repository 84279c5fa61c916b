"""Linear systems against a direct solver."""

import jax.numpy as jnp
import numpy as np

from contactmodel.solver.linear import conjugate_residuals


def test_a_system_that_is_not_symmetric():
    """With more steps than directions are kept; the preconditioner is the diagonal's inverse."""
    rng = np.random.default_rng(0)
    matrix = np.diag(np.linspace(1.0, 30.0, 60)) + 0.3 * rng.normal(size=(60, 60))
    rhs = rng.normal(size=60)
    dense, diagonal = jnp.asarray(matrix), jnp.asarray(np.diag(matrix))

    def solve(rtol):
        return conjugate_residuals(
            lambda x: dense @ x, jnp.asarray(rhs), lambda x: x / diagonal, rtol=rtol, max_steps=60
        )

    found, steps = solve(1e-10)
    assert 16 < int(steps) < 60
    defect = np.linalg.norm(matrix @ np.asarray(found) - rhs) / np.linalg.norm(rhs)
    assert defect < 2e-10  # its own tolerance, and rounding
    assert int(solve(1e-2)[1]) < int(steps)
