"""Finite elements in three dimensions against closed forms and against those in r and z."""

import jax.numpy as jnp
import numpy as np
import pytest

from papers.finite_strain import press as round_press
from papers.finite_strain.gel import Gel, cut, law_of
from papers.finite_strain.solids.angles import follow_markers
from papers.finite_strain.solids.bars import compare_bar
from papers.finite_strain.solids.bricks import element_forces, element_stiffness, lay_bricks
from papers.finite_strain.solids.cases import (
    CASES,
    FIELDS,
    Field,
    make_whole,
    move_on_grid,
    read_fields,
    read_solids,
)
from papers.finite_strain.solids.press import Block, Egg, press
from papers.finite_strain.steps import Motion

pytest.importorskip("skfem")

_GEL = Gel(thickness=8.0, radius=24.0, second_share=0.3)
_NEAR = np.append(np.linspace(0.0, 5.6, 8), [8.0, 13.0, 24.0])
_DOWN = np.array([0.0, 0.7, 1.6, 3.0, 5.0, 8.0])
_PATH = [Motion(0.5, 0.0), Motion(1.0, 0.0), *(Motion(1.0, turn) for turn in (0.1, 0.2, 0.15))]
_QUARTER = lay_bricks(_NEAR, _NEAR, _DOWN)
_HALF = lay_bricks(np.append(-_NEAR[:0:-1], _NEAR), _NEAR, _DOWN)


@pytest.fixture(params=[_QUARTER, _HALF])
def bricks(request):
    return request.param


@pytest.fixture(scope="module")
def pressed():
    return press(_GEL, _QUARTER, Block(0.0, 20.0), 0.5, _PATH)


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
    inside = (z < 0.0) & (z > -8.0) & (np.maximum(np.abs(x), y) < 24.0)
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


def test_a_sphere_meets_the_elements_in_r_and_z(pressed):
    elements = cut(_GEL, 0.3, 5.6, 1.4)
    expected = round_press.press(_GEL, elements, round_press.Round(0.0, 20.0), 0.5, _PATH)
    # elements of 0.8 mm; of 0.4 mm within 0.5 % of force and moment
    np.testing.assert_allclose(pressed.normal_force[1:], expected.normal_force[1:], rtol=0.03)
    np.testing.assert_allclose(pressed.moment[2:], expected.moment[2:], rtol=0.05)
    assert abs(pressed.moment[1]) < 1e-6 * pressed.moment[3]


def test_half_of_the_gel_gives_what_a_quarter_gives(pressed):
    half = press(_GEL, _HALF, Egg(20.0, 20.0, 20.0), 0.5, _PATH[:3])
    np.testing.assert_allclose(half.normal_force, pressed.normal_force[:3], rtol=1e-5)
    np.testing.assert_allclose(half.moment[2], pressed.moment[2], rtol=1e-5)
    np.testing.assert_allclose(half.moved[:, 10:], pressed.moved[:3], atol=1e-5)


def test_an_object_does_not_touch_from_outside_and_keeps_its_distance():
    for solid in (Block(3.0, 1.0), Egg(16.0, 8.0, 6.0)):
        assert float(solid.outside(jnp.zeros(3))) == pytest.approx(0.0, abs=1e-15)
        assert float(solid.outside(jnp.array([0.2, 0.1, -0.01]))) > 0.0
        assert float(solid.outside(jnp.array([0.2, 0.1, 0.1]))) < 0.0
    assert float(Block(3.0, 1.0).outside(jnp.array([4.5, 0.0, 1.0]))) == pytest.approx(0.5)
    assert float(Block(3.0, 1.0).outside(jnp.array([4.0, 4.0, 1.0]))) == pytest.approx(2**0.5 - 1.0)


def test_markers_move_with_the_sectors():
    """A surface that turns as one carries every marker round, in all sectors."""
    c, s = np.cos(0.3) - 1.0, np.sin(0.3)
    for bricks in (_QUARTER, _HALF):
        x, y = np.meshgrid(*bricks.grid, indexing="ij")
        moved = np.stack([c * x - s * y, s * x + c * y, x**2 + y**2], axis=-1)[None]
        yes = np.ones((1, *x.shape), dtype=bool)
        moved, yes = np.concatenate([0.0 * moved, moved]), np.concatenate([yes, yes])
        whole = make_whole(Field(*bricks.grid, moved, np.array([0.0, 0.3]), yes, yes))
        at = np.array([[1.0, 0.3], [-0.4, 2.0], [-2.2, -1.1], [0.5, -4.0]])
        found, stick = move_on_grid(whole, at)
        expected = np.stack([c * at[:, 0] - s * at[:, 1], s * at[:, 0] + c * at[:, 1]], axis=1)
        np.testing.assert_allclose(found[1, :, :2], expected, atol=1e-10)
        np.testing.assert_allclose(found[1, :, 2], np.sum(at**2, axis=1), atol=1e-10)
        assert stick.all()


def test_a_round_bar_stands_for_a_square_one():
    bar = compare_bar(1.0, 0.3, cells=8)
    assert abs(bar.as_round) < 0.02
    assert bar.as_plate < -0.2


def test_the_shipped_cases_are_those_of_the_settings():
    table = read_solids()
    assert list(table) == list(CASES)
    for turned in table.values():
        np.testing.assert_allclose(turned.angle_deg, [0, 5, 10, 15, 20, 15, 10], atol=1e-3)
        assert np.all(turned.force_n > 0.0)
        assert abs(turned.moment_nmm[0]) < 1e-6 * turned.moment_nmm[4]
        assert turned.moment_nmm[5] < turned.moment_nmm[4]
    assert list(read_fields()) == list(FIELDS)


@pytest.mark.parametrize(("depth_mm", "seed"), [(1.0, 5015), (0.5, 5010)])
def test_the_law_explains_pressed_ellipsoids_deep_and_shallow(depth_mm, seed):
    """Without the press's waves the deep one seems to slide, at errors of 0.45°.

    With a number of markers that grows with the fitted parameters, the shallow one has no law, and
    is 1.3° off.
    """
    (field,) = (
        field
        for case, field in read_fields().items()
        if case.name.startswith("ellipsoid, 16") and case.depth_mm == depth_mm
    )
    angles = follow_markers(field, 1.0, seed)
    few = (angles.held >= 5) & (angles.held < 12)
    assert few.sum() >= 3
    assert np.abs(angles.error[few]).max() < 0.15
    assert not angles.slipping[few].any()


def test_the_stretch_by_the_press_is_no_slide():
    """Outer markers under it seem to lag behind inner ones, and 57 that stick seemed to slide."""
    (field,) = (
        field
        for case, field in read_fields().items()
        if case.name.startswith("ellipsoid, 16") and case.depth_mm == 1.0
    )
    angles = follow_markers(field, 1.0, 606)
    assert not angles.slipping[angles.held >= 10].any()
    assert np.abs(angles.error).max() < 0.2


@pytest.mark.parametrize("seed", [602, 603])
def test_eight_markers_that_stick_do_not_slide_because_one_fit_says_so(seed):
    """A fit after a frame that the law does not explain closed the disc of 15 markers."""
    (field,) = (
        field
        for case, field in read_fields().items()
        if case.name.startswith("ellipsoid, 16") and case.depth_mm == 0.5
    )
    angles = follow_markers(field, 3.0, seed)
    assert not angles.slipping[angles.held >= 5].any()
    assert np.abs(angles.error[angles.held >= 5]).max() < 0.5
