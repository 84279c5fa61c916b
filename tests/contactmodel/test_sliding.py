"""The object's shape goes along with what slides."""

import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    Contact,
    Domed,
    Ellipsoid,
    Grid,
    HalfSpace,
    Pose,
    Rigid,
    Sphere,
    make_path,
    solve_path,
)

GRID = Grid((32, 32), (14.0, 14.0))
PAD = HalfSpace(0.2, 0.5)
REST, PRESSED = Pose(0.0), Pose(0.3)


def long_axis(pressure):
    """Direction of the contact's long axis, from the second moments of the pressure [rad]."""
    x, y = GRID.points
    xx, xy, yy = (float(jnp.sum(pressure * p)) for p in (x * x, x * y, y * y))
    return 0.5 * np.arctan2(2.0 * xy, xx - yy)


def test_the_outline_turns_with_an_object_that_slips():
    shape = Domed(Ellipsoid((20.0, 8.0, 10.0)), 60.0)
    turned = Pose(0.3, twist=0.7)
    path = make_path([REST, PRESSED, turned, turned], [1, 8, 2])
    ahead = solve_path(Contact(PAD, Rigid(), shape, GRID, 0.02), path, rtol=1e-6, sliding=True)
    still = solve_path(Contact(PAD, Rigid(), shape, GRID, 0.02), path, rtol=1e-6)
    # μ small: what the gel is taken along by is a degree; cells of 0.44 mm
    assert long_axis(ahead.pressure[-1]) == pytest.approx(0.7, abs=0.03)
    assert long_axis(still.pressure[-1]) == pytest.approx(0.0, abs=0.03)


def test_a_ball_that_slides_takes_its_contact_along():
    shifted = Pose(0.3, shift=(2.0, 0.0))
    path = make_path([REST, PRESSED, shifted, shifted], [1, 8, 3])
    slid = solve_path(Contact(PAD, Rigid(), Sphere(12.0), GRID, 0.1), path, rtol=1e-6, sliding=True)
    pressure, slip = slid.pressure[-1], slid.slip[-1, 0]
    middle = float(jnp.sum(pressure * GRID.points[0]) / jnp.sum(pressure))
    # the ball is where it has slid to; its contact stands over it
    assert middle == pytest.approx(float(jnp.sum(pressure * slip) / jnp.sum(pressure)), abs=0.02)
    assert middle > 1.0
    # and presses as hard as where it touched, but for the cells that the rim cuts
    assert float(slid.force[-1, 2]) == pytest.approx(float(slid.force[0, 2]), rel=5e-3)
