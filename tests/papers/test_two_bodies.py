"""Finite elements of a soft ball on a gel against closed forms and the rigid object."""

import numpy as np
import pytest

from contactmodel.analytic import reissner_sagoci_moment
from papers.finite_strain.gel import Gel, cut
from papers.finite_strain.press import Round, press
from papers.finite_strain.steps import Motion
from papers.finite_strain.two_bodies import Ball, cut_ball, hold

pytest.importorskip("skfem")

GEL = Gel(thickness=6.0, radius=16.0)
TIP = Ball(radius=10.0, cone=5.0, width=16.0, height=16.0)
PATH = [Motion(0.25, 0.0), Motion(0.5, 0.0)]
PATH += [Motion(0.5, float(np.radians(angle))) for angle in (3.0, 6.0, 10.0, 5.0)]
TURNED = slice(2, None)


def solve(ball, cell=0.3):
    meshes = cut(GEL, 0.3, 3.3, 1.5), cut_ball(ball, cell, 3.3, 1.5)
    return hold((GEL, meshes[0]), (ball, meshes[1]), 0.5, PATH)


@pytest.fixture(scope="module")
def soft():
    return solve(TIP)


def test_a_stiff_ball_is_the_rigid_sphere():
    found = solve(TIP._replace(shear_modulus=2e4), 0.14).gel
    rigid = press(GEL, cut(GEL, 0.3, 3.3, 1.5), Round(0.0, TIP.radius), 0.5, PATH)
    # the ball's edges are chords, up to 0.14²/(8 · 10) mm = 0.25 µm above the sphere
    np.testing.assert_allclose(found.normal_force, rigid.normal_force, rtol=5e-3)
    np.testing.assert_allclose(found.moment[TURNED], rigid.moment[TURNED], rtol=5e-3)
    np.testing.assert_allclose(found.moved, rigid.moved, atol=3e-3)
    assert np.array_equal(found.stick[TURNED], rigid.stick[TURNED])


def test_forces_and_moments_balance(soft):
    """The grip carries what friction and pressure put on the gel, also in slip and back."""
    assert not np.array_equal(soft.gel.stick[-2], soft.gel.contact[-2])
    np.testing.assert_allclose(soft.grip_force, soft.gel.normal_force, rtol=1e-6)
    np.testing.assert_allclose(soft.grip_moment[TURNED], soft.gel.moment[TURNED], rtol=1e-6)


def test_a_soft_ball_is_pressed_in_and_turned_less(soft):
    """Both surfaces meet: sticking nodes have the ball's present place."""
    step, gel = 3, soft.gel
    stuck = gel.stick[step] & (gel.radius > 0.0)
    assert np.count_nonzero(stuck) > 3
    r, moved = gel.radius[stuck], gel.moved[step][stuck]
    own = [np.interp(r, soft.radius, part) for part in soft.moved[step].T]
    turned = PATH[step].twist + np.arctan2(own[1], r + own[0])
    # of 6° the ball's tip turns back by 2; its material points are not exactly those of the gel
    np.testing.assert_allclose(np.arctan2(moved[:, 1], r + moved[:, 0]), turned, atol=2e-4)
    height = TIP.profile(r) + own[2] - PATH[step].approach
    np.testing.assert_allclose(moved[:, 2], height, atol=2e-3)
    assert np.degrees(PATH[step].twist - turned).min() > 1.5


def test_shallow_contact_of_two_thick_bodies_is_that_of_hertz_and_reissner():
    gel = Gel(thickness=60.0, radius=60.0, poisson_ratio=0.45)
    ball = Ball(400.0, 40.0, 60.0, 60.0, shear_modulus=0.4, poisson_ratio=0.25)
    reach, twist, k = 0.8, 0.02, 0.5
    approach = reach**2 / ball.radius
    cell = reach / 10.5  # the edge is midway between nodes
    meshes = cut(gel, cell, 1.0, 1.6), cut_ball(ball, cell, 1.0, 1.6)
    path = [Motion(0.5 * approach, 0.0), Motion(approach, 0.0), Motion(approach, twist)]
    found = hold((gel, meshes[0]), (ball, meshes[1]), 1e4, path)
    soft = [(1.0 - body.poisson_ratio) / (2.0 * body.shear_modulus) for body in (gel, ball)]
    # 4 % and 8 % as for a rigid sphere: friction in pressing, and ten elements along the radius
    force = 4.0 / 3.0 / sum(soft) * np.sqrt(ball.radius) * approach**1.5
    assert found.gel.normal_force[1] == pytest.approx(force, rel=0.04)
    moment = reissner_sagoci_moment(twist, reach, gel.shear_modulus) / (1.0 + k)
    assert found.gel.moment[2] == pytest.approx(moment, rel=0.08)
    inner = (found.gel.radius > 0.0) & (found.gel.radius < 0.8 * reach)
    share = found.gel.moved[2][inner, 1] / (np.sin(twist) * found.gel.radius[inner])
    # Eq. (2) of [Li2024]: 1/(1 + k) everywhere; the far ends leave 0.1 %
    np.testing.assert_allclose(share, 1.0 / (1.0 + k), rtol=2e-3)
