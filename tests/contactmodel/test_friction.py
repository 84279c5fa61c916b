"""Laws of friction: their limits, and what the solver makes of one that falls with pressure."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    Contact,
    Coulomb,
    Grid,
    HalfSpace,
    Paraboloid,
    Pose,
    PowerLawFriction,
    Rigid,
    solve_contact,
)

GRID = Grid((24, 24), (10.0, 10.0))
PRESSURE = jnp.asarray([0.0, 1e-9, 0.1, 0.2, 3.0])


def test_the_coefficient_falls_with_pressure():
    law = PowerLawFriction(0.5, 0.2, 0.3)
    with np.errstate(divide="ignore"):
        mu = 0.5 * (np.asarray(PRESSURE[1:]) / 0.2) ** -0.3
    np.testing.assert_allclose(law.limit(PRESSURE)[1:], mu * PRESSURE[1:], rtol=1e-12)
    np.testing.assert_allclose(law.slope(PRESSURE)[1:], 0.7 * mu, rtol=1e-12)  # (1−γ) μ(p)
    assert float(law.limit(PRESSURE)[0]) == 0.0
    for of in (jax.jacrev(law.limit)(PRESSURE), jax.jacfwd(law.limit)(PRESSURE)):
        assert bool(jnp.all(jnp.isfinite(of)))


def test_without_an_exponent_it_is_coulombs():
    law, coulomb = PowerLawFriction(0.5, 0.2, 0.0), Coulomb(0.5)
    np.testing.assert_allclose(law.limit(PRESSURE), coulomb.limit(PRESSURE), rtol=1e-15)
    np.testing.assert_allclose(law.slope(PRESSURE)[1:], coulomb.slope(PRESSURE)[1:], rtol=1e-15)


def test_gradients_meet_central_differences():
    """On bodies that couple, pressed and shifted until a ring slips."""

    @jax.jit
    @partial(jax.value_and_grad, has_aux=True)  # one program for the differences as well
    def outputs(values):
        mu, reference, exponent, approach = values
        law = PowerLawFriction(mu, reference, exponent)
        contact = Contact(HalfSpace(1.0, 0.3), Rigid(), Paraboloid(30.0), GRID, law)
        end = solve_contact(contact, Pose(approach, shift=(0.03, 0.0)), rtol=1e-11)
        return end.force[0] - 0.3 * end.force[2] + 10.0 * end.dissipated_energy, end.stick_ratio

    values = jnp.asarray([0.3, 0.2, 0.3, 0.3])
    (_, stick), gradient = outputs(values)
    assert 0.1 < float(stick) < 0.9
    for i in range(4):
        step = jnp.zeros(4).at[i].set(1e-6)
        difference = (outputs(values + step)[0][0] - outputs(values - step)[0][0]) / 2e-6
        # the solver's 1e-11 over the step, and curvature
        assert float(gradient[i]) == pytest.approx(float(difference), rel=2e-5)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: PowerLawFriction(-0.5, 0.2, 0.3), "must not be below 0"),
        (lambda: PowerLawFriction(0.5, 0.0, 0.3), "above 0"),
        (lambda: PowerLawFriction(0.5, 0.2, 1.0), "must be below 1"),
        (
            lambda: Contact(
                HalfSpace(1.0, 0.3),
                Rigid(),
                Paraboloid(30.0),
                GRID,
                PowerLawFriction(np.ones((3, 3)), 0.2, 0.3),
            ),
            r"map of shape \(24, 24\)",
        ),
    ],
)
def test_wrong_laws_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wrong()
