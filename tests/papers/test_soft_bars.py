"""Bricks of a soft square bar on a gel against the rigid cube, the balance of forces, and k."""

import jax.numpy as jnp
import numpy as np
import pytest

from papers.finite_strain.gel import Gel, cut, grow
from papers.finite_strain.solids.bricks import lay_bricks
from papers.finite_strain.solids.faces import Face, meet
from papers.finite_strain.solids.press import Block, press
from papers.finite_strain.solids.two_bodies import Bar, cut_bar, hold
from papers.finite_strain.steps import Motion
from papers.finite_strain.two_bodies import Ball, cut_ball
from papers.finite_strain.two_bodies import hold as round_hold

pytest.importorskip("skfem")

_GEL, _BAR = Gel(thickness=6.0), Bar(flat=2.5, edge=1.5, height=4.0)
_ACROSS = np.array([0.0, 1.0, 2.0, 2.7, 3.35, 4.0])
_BESIDE = np.append(_ACROSS, [4.7, 6.0, 8.5, 12.0])
_BRICKS = lay_bricks(_BESIDE, _BESIDE, grow(6.0, 0.8, 1.8))
_PATH = [Motion(0.2, 0.0), Motion(0.4, 0.0)]
_PATH += [Motion(0.4, float(np.radians(angle))) for angle in (2.0, 6.0)]


def test_a_stiff_bar_is_the_rigid_cube_and_forces_balance():
    bar = _BAR._replace(shear_modulus=2e4)
    mesh = cut_bar(bar, np.linspace(0.0, 4.0, 17), 2.0, 1.8)  # fine, for its edges
    held = hold((_GEL, _BRICKS), (bar, mesh), 0.5, _PATH)
    found, rigid = held.gel, press(_GEL, _BRICKS, Block(_BAR.flat, _BAR.edge), 0.5, _PATH)
    np.testing.assert_allclose(found.normal_force, rigid.normal_force, rtol=0.01)
    np.testing.assert_allclose(found.moment[2:], rigid.moment[2:], rtol=0.01)
    np.testing.assert_allclose(found.moment[:2], 0.0, atol=1e-6)
    assert found.stick[3].sum() < found.contact[3].sum()  # friction slides beside what sticks
    np.testing.assert_allclose(held.grip_force, found.normal_force, rtol=1e-4)
    np.testing.assert_allclose(held.grip_moment[2:], found.moment[2:], rtol=1e-4)


def test_what_sticks_is_shared_by_two_bodies_as_1_to_k():
    """A bar as wide and as high as the gel: Eq. (2) of [Li2024], whatever the contact's form."""
    k, twist = 0.5, 0.02
    bar = Bar(flat=11.0, edge=1.0, height=6.0, shear_modulus=_GEL.shear_modulus / k)
    mesh = cut_bar(bar, _BESIDE, 0.8, 1.8)
    path = [Motion(0.03, 0.0), Motion(0.06, 0.0), Motion(0.06, twist)]
    found = hold((_GEL, _BRICKS), (bar, mesh), 1e3, path).gel
    x, y = np.meshgrid(_BESIDE, _BESIDE, indexing="ij")
    inner = (np.hypot(x, y) > 0.0) & (np.hypot(x, y) < 5.0)
    turned = found.moved[2] - found.moved[1]
    around = (x * turned[..., 1] - y * turned[..., 0])[inner] / (x**2 + y**2)[inner]
    np.testing.assert_allclose(around / twist, 1.0 / (1.0 + k), rtol=0.01)


def test_a_soft_ball_meets_the_elements_in_r_and_z():
    gel, ball = Gel(thickness=6.0, radius=16.0), Ball(10.0, 5.0, 16.0, 16.0)
    meshes = cut(gel, 0.3, 3.3, 1.5), cut_ball(ball, 0.3, 3.3, 1.5)
    expected = round_hold((gel, meshes[0]), (ball, meshes[1]), 0.5, _PATH).gel
    across = np.append(np.linspace(0.0, 3.2, 6), [4.2, 5.8, 9.0, 14.2])  # of the same area
    face = ball.profile(np.hypot(*np.meshgrid(across, across)))
    gel_mesh = lay_bricks(across, across, grow(6.0, 0.65, 1.6))
    mesh = lay_bricks(across, across, grow(16.0, 0.65, 1.6), face)
    found = hold((gel, gel_mesh), (ball, mesh), 0.5, _PATH).gel
    # bricks of 0.65 mm
    np.testing.assert_allclose(found.normal_force[1:], expected.normal_force[1:], rtol=0.03)
    np.testing.assert_allclose(found.moment[2:], expected.moment[2:], rtol=0.06)
    # the turn of what sticks, which the angle is measured by
    stuck = found.moved[2, 1, 0], expected.moved[2, 2]
    np.testing.assert_allclose(stuck[0][1] / across[1], stuck[1][1] / expected.radius[2], rtol=5e-3)


def test_a_face_goes_through_its_nodes_and_finds_what_is_over_it():
    mesh = cut_bar(_BAR, _ACROSS, 0.8, 1.8)
    face = Face.of(mesh)
    c, s = np.cos(0.2), np.sin(0.2)
    turned = mesh.place @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) - mesh.place
    place = face.positions(turned)
    at = np.array([[0.3, -0.2], [-2.1, 3.0], [1.0, 1.0], [-3.4, -0.1], [6.0, 1.0]])
    now = at @ np.array([[c, s], [-s, c]])
    side, share, over = face.find(place, now)
    np.testing.assert_array_equal(over, [True, True, True, True, False])
    met = np.asarray(meet(jnp.asarray(place[face.around(side)]), share))[over]
    np.testing.assert_allclose(met[:, :2], now[over], atol=1e-9)
    # a slope in elements of 0.7 mm
    np.testing.assert_allclose(met[:, 2], _BAR.profile(*at[over].T), atol=0.03)
