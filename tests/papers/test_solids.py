"""Finite elements in three dimensions against closed forms and against those in r and z."""

import jax.numpy as jnp
import numpy as np
import pytest

from papers.finite_strain import press as round_press
from papers.finite_strain.gel import Gel, cut, law_of
from papers.finite_strain.solids.bricks import element_forces, element_stiffness, lay_bricks
from papers.finite_strain.solids.cases import Field, move_markers
from papers.finite_strain.solids.press import Block, Egg, press
from papers.finite_strain.steps import Motion

pytest.importorskip("skfem")

_GEL = Gel(thickness=4.0, radius=6.0, second_share=0.3)
_NEAR = np.array([0.0, 0.7, 1.4, 2.1, 3.2, 6.0])
_DOWN = np.array([0.0, 0.7, 1.8, 4.0])


@pytest.fixture(scope="module", params=[4, 2])
def bricks(request):
    half = np.append(-_NEAR[:0:-1], _NEAR)
    return lay_bricks(_NEAR if request.param == 4 else half, _NEAR, _DOWN)


def forces(bricks, moved):
    total = np.zeros_like(moved)
    each = element_forces(jnp.asarray(moved[bricks.nodes]), bricks.parts, law_of(_GEL))
    np.add.at(total, bricks.nodes, np.asarray(each))
    return total


def test_a_turned_gel_has_no_forces_and_a_strained_one_inner_forces_of_zero(bricks):
    x, y, z = bricks.place.T
    c, s = np.cos(0.8), np.sin(0.8)
    turned = np.stack([c * x - s * y - x, s * x + c * y - y, 0.0 * z], axis=1)
    np.testing.assert_allclose(forces(bricks, turned), 0.0, atol=1e-12)
    # a homogeneous strain that the sectors share: inner nodes are in balance (patch test)
    strained = np.stack([0.1 * x - 0.05 * y, 0.05 * x + 0.1 * y, -0.15 * z], axis=1)
    inside = (np.hypot(x, y) < 5.0) & (z < 0.0) & (z > -4.0) & (np.maximum(np.abs(x), y) < 6.0)
    # nodes on the axis are balanced by the other sectors
    inside &= (bricks.owner == np.arange(len(x))) & (np.hypot(x, y) > 0.0)
    found = forces(bricks, strained)[inside]
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    assert inside.sum() > 20


def test_the_stiffness_is_the_slope_of_the_forces(bricks):
    rng = np.random.default_rng(3)
    moved, step = (0.05 * rng.normal(size=(len(bricks.nodes), 8, 3)) for _ in range(2))
    stiff = np.asarray(element_stiffness(moved, bricks.parts, law_of(_GEL)))
    ahead, behind = (
        np.asarray(element_forces(moved + side * step, bricks.parts, law_of(_GEL)))
        for side in (1e-5, -1e-5)
    )
    found = np.einsum("eij,ej->ei", stiff, step.reshape(-1, 24))
    np.testing.assert_allclose(found, (ahead - behind).reshape(-1, 24) / 2e-5, atol=1e-7)


def test_a_sphere_meets_the_elements_in_r_and_z():
    gel = Gel(thickness=8.0, radius=24.0)
    path = [Motion(0.5, 0.0), Motion(1.0, 0.0), *(Motion(1.0, turn) for turn in (0.1, 0.2, 0.15))]
    x = np.concatenate([np.linspace(0.0, 5.6, 9), [7.0, 10.0, 15.0, 24.0]])
    bricks = lay_bricks(x, x, np.array([0.0, 0.7, 1.6, 3.0, 5.0, 8.0]))
    found = press(gel, bricks, Block(0.0, 20.0), 0.5, path)
    expected = round_press.press(
        gel, cut(gel, 0.3, 5.6, 1.4), round_press.Round(0.0, 20.0), 0.5, path
    )
    # elements of 0.7 mm: 1.3 % of force and 1.2 % of moment; of 0.4 mm 0.2 % and 0.1 %
    np.testing.assert_allclose(found.normal_force[1:], expected.normal_force[1:], rtol=0.02)
    np.testing.assert_allclose(found.moment[2:], expected.moment[2:], rtol=0.03)
    assert abs(found.moment[1]) < 1e-6 * found.moment[3]


def test_half_of_the_gel_gives_what_a_quarter_gives():
    path = [Motion(0.3, 0.0), Motion(0.3, 0.1)]
    half = np.append(-_NEAR[:0:-1], _NEAR)
    results = [
        press(_GEL, lay_bricks(x, _NEAR, _DOWN), Egg(6.0, 6.0, 6.0), 0.5, path)
        for x in (_NEAR, half)
    ]
    quarter, two = results
    np.testing.assert_allclose(two.normal_force, quarter.normal_force, rtol=1e-6)
    np.testing.assert_allclose(two.moment, quarter.moment, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(two.moved[:, 5:], quarter.moved, atol=1e-8)


def test_an_object_does_not_touch_from_outside_and_keeps_its_distance():
    for solid in (Block(3.0, 1.0), Egg(16.0, 8.0, 6.0)):
        assert float(solid.outside(jnp.zeros(3))) == pytest.approx(0.0, abs=1e-15)
        assert float(solid.outside(jnp.array([0.2, 0.1, -0.01]))) > 0.0
        assert float(solid.outside(jnp.array([0.2, 0.1, 0.1]))) < 0.0
    assert float(Block(3.0, 1.0).outside(jnp.array([4.5, 0.0, 1.0]))) == pytest.approx(0.5)
    assert float(Block(3.0, 1.0).outside(jnp.array([4.0, 4.0, 1.0]))) == pytest.approx(2**0.5 - 1.0)


def test_markers_move_with_the_sectors():
    """A surface that turns as one carries every marker round, in all sectors."""
    x, y = np.meshgrid(_NEAR, _NEAR, indexing="ij")
    c, s = np.cos(0.3) - 1.0, np.sin(0.3)
    moved = np.stack([c * x - s * y, s * x + c * y, 0.1 + 0.0 * x], axis=-1)[None]
    yes = np.ones((1, 6, 6), dtype=bool)
    field = Field(_NEAR, _NEAR, moved, np.array([0.3]), yes, yes)
    at = np.array([[1.0, 0.3], [-0.4, 2.0], [-2.2, -1.1], [0.5, -4.0]])
    found, stick = move_markers(field, at)
    expected = np.stack([c * at[:, 0] - s * at[:, 1], s * at[:, 0] + c * at[:, 1]], axis=1)
    np.testing.assert_allclose(found[0, :, :2], expected, atol=1e-12)
    np.testing.assert_allclose(found[0, :, 2], 0.1, atol=1e-12)
    assert stick.all()
