"""[Li2024] Eqs. (1) to (14) on the fields of the solver, with stick and slip present."""

import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    Paraboloid,
    Pose,
    Rigid,
    make_path,
    solve_contact,
    solve_path,
    stiffness_ratio,
)
from contactmodel import equations as eqs

GRID = Grid((64, 64), (10.0, 10.0))
SHIFT, TWIST, CENTRE = np.array([0.02, -0.01]), 0.05, np.array([0.4, 0.2])
POSE = Pose(0.3, SHIFT, TWIST, CENTRE)
SOFT = HalfSpace(1.0, 0.4)
MATCHED = HalfSpace(2.0, 0.3)  # (1−2ν)/G as the elastomer's: pressing causes no slip
OTHER = HalfSpace(3.0, 0.1)
ALIKE = HalfSpace(1.0, 0.5), HalfSpace(3.0, 0.5)  # Eq. (2) is exact for each component


@pytest.fixture(scope="module")
def matched():
    return solve_contact(Contact(SOFT, MATCHED, Paraboloid(30.0), GRID, 0.5), POSE, rtol=1e-11)


@pytest.fixture(scope="module")
def other():
    return solve_contact(Contact(SOFT, OTHER, Paraboloid(30.0), GRID, 0.5), POSE, rtol=1e-11)


def gradient(field, spacing=GRID.spacing):
    """∂u_i/∂x_j by central differences, `[..., i, j]`, the outermost cells left out."""
    along_x = (field[:, 2:, 1:-1] - field[:, :-2, 1:-1]) / (2.0 * spacing[0])
    along_y = (field[:, 1:-1, 2:] - field[:, 1:-1, :-2]) / (2.0 * spacing[1])
    return np.moveaxis(np.stack([along_x, along_y], axis=1), (0, 1), (-2, -1))


def curl(gradient):
    return gradient[..., 1, 0] - gradient[..., 0, 1]


def test_both_stick_and_slip_are_present(matched, other):
    for solution in (matched, other):
        assert 0.1 < float(solution.stick_ratio) < 0.9


def test_equation_1_is_the_slip_exactly(matched):
    u_s = jnp.moveaxis(matched.elastomer_displacement()[:2], 0, -1)
    u_b = jnp.moveaxis(matched.object_displacement()[:2], 0, -1)
    turn = eqs.rotation_change(jnp.asarray(TWIST))
    # the object's frame turns with it and has its origin on the axis of the twist
    in_object = u_b @ (turn + jnp.eye(2))  # Rᵀ u_B
    position = jnp.moveaxis(jnp.asarray(GRID.points), 0, -1) - CENTRE
    slip = eqs.pair_slip(u_s, in_object, position, jnp.asarray(SHIFT), turn)
    np.testing.assert_allclose(jnp.moveaxis(slip, -1, 0), matched.slip, atol=1e-14)  # rounding
    stuck = np.asarray(matched.stick)
    assert np.abs(np.asarray(slip)[stuck]).max() < 1e-10  # the solver's tolerance


def test_equation_2_has_a_residual_and_its_curl_has_none(other):
    k = float(stiffness_ratio(SOFT, OTHER))
    d_s = gradient(np.asarray(other.elastomer_displacement()[:2]))
    d_b = gradient(np.asarray(other.object_displacement()[:2]))
    left = d_b - eqs.object_gradient(d_s, k)
    inside = np.asarray(other.contact)[1:-1, 1:-1]
    share = np.sqrt(np.mean(left[inside] ** 2) / np.mean(d_s[inside] ** 2))
    # different Poisson's ratios and the pressure: 10 % or so, far from rounding
    assert 0.02 < share < 0.5
    assert share > 10.0 * np.sqrt(np.mean(curl(left)[inside] ** 2) / np.mean(d_s[inside] ** 2))


def test_curl_theorem_by_central_differences_converges():
    """At order 1: the traction has vertical tangents at the rims of the contact and of stick."""
    k, errors = float(stiffness_ratio(SOFT, OTHER)), []
    for count in (32, 64):
        grid = Grid((count, count), (10.0, 10.0))
        solution = solve_contact(Contact(SOFT, OTHER, Paraboloid(30.0), grid, 0.5), POSE)
        d_s = gradient(np.asarray(solution.elastomer_displacement()[:2]), grid.spacing)
        d_b = gradient(np.asarray(solution.object_displacement()[:2]), grid.spacing)
        left = curl(d_b - eqs.object_gradient(d_s, k))
        errors.append(np.sqrt(np.mean(left**2) / np.mean(curl(d_s) ** 2)))
    assert errors[-1] < 4e-3
    assert min(np.log2(np.divide(errors[:-1], errors[1:]))) > 0.8


def test_curl_theorem_with_the_coefficients_of_the_rotation(other):
    k = float(stiffness_ratio(SOFT, OTHER))
    phi, object_phi = other.elastomer_rotation(), other.object_rotation()
    assert float(jnp.max(jnp.abs(object_phi + k * phi))) < 1e-10 * float(jnp.max(jnp.abs(phi)))
    np.testing.assert_allclose(
        eqs.object_gradient(phi, k), object_phi, atol=1e-10 * float(jnp.max(jnp.abs(phi)))
    )


def test_rotation_field_is_half_the_curl_of_the_displacement():
    """By central differences, on points between which the traction is smooth: second order."""
    grid = Grid((32, 32), (10.0, 10.0))
    pose = Pose(0.3, twist=0.02, linear=True)
    solution = solve_contact(Contact(SOFT, OTHER, Paraboloid(30.0), grid, 0.5), pose)
    exact = np.asarray(solution.elastomer_rotation())[18, 17]
    here = grid.points[:, 18, 17]
    errors = []
    for step in (0.08, 0.04, 0.02):  # within the cell, half of which is 0.156 mm
        steps = step * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        u = np.asarray(solution.elastomer_displacement_at(here + steps))
        half_curl = 0.25 * ((u[0, 1] - u[1, 1]) - (u[2, 0] - u[3, 0])) / step
        errors.append(abs(half_curl - exact))
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2.0, atol=0.2)


def deep_inside(stuck):
    """Cells that stick with their four neighbours, the outermost cells left out."""
    around = stuck[2:, 1:-1] & stuck[:-2, 1:-1] & stuck[1:-1, 2:] & stuck[1:-1, :-2]
    return stuck[1:-1, 1:-1] & around


# Exact where Eq. (2) is; else central differences at 64² add their second-order error.
@pytest.mark.parametrize(("bodies", "atol"), [(ALIKE, 1e-10), ((SOFT, OTHER), 1e-4)])
def test_sticking_points_turn_with_the_object_whatever_slides(bodies, atol):
    k = float(stiffness_ratio(*bodies))
    pose = Pose(0.3, SHIFT, TWIST, CENTRE, linear=True)
    contact = solve_contact(Contact(*bodies, Paraboloid(30.0), GRID, 0.5), pose, rtol=1e-11)
    phi = eqs.small_rotation(gradient(np.asarray(contact.elastomer_displacement()[:2])))
    deep = deep_inside(np.asarray(contact.stick))
    assert deep.sum() > 20
    np.testing.assert_allclose(eqs.object_rotation(phi[deep], k), TWIST, atol=atol)
    np.testing.assert_allclose(eqs.clockwise_object_angle(phi[deep], k), -TWIST, atol=atol)


def test_equation_14_for_a_rigid_object_and_a_finite_rotation():
    contact = solve_contact(
        Contact(ALIKE[0], Rigid(), Paraboloid(30.0), GRID, 0.5), POSE, rtol=1e-11
    )
    f = np.eye(2) + gradient(np.asarray(contact.elastomer_displacement()[:2]))
    phi = eqs.polar_rotation(f)[deep_inside(np.asarray(contact.stick))]
    np.testing.assert_allclose(eqs.object_rotation(phi), TWIST, atol=1e-10)  # rtol 1e-11
    small = eqs.small_rotation(f)[deep_inside(np.asarray(contact.stick))]
    np.testing.assert_allclose(small, np.sin(TWIST), atol=1e-10)  # ½ rot of a rotation


def test_equation_3_exact_and_as_printed(matched):
    clockwise = jnp.asarray(-TWIST)
    k = float(stiffness_ratio(SOFT, MATCHED))
    d_s = gradient(np.asarray(matched.elastomer_displacement()[:2]))[..., 0, 1]
    d_b = gradient(np.asarray(matched.object_displacement()[:2]))[..., 0, 1]
    load = d_b - eqs.object_gradient(d_s, k)  # l_yx, what Eq. (2) leaves over
    slip = gradient(np.asarray(matched.slip))[..., 0, 1]
    exact = eqs.slip_shear(d_s, k, load, clockwise)
    np.testing.assert_allclose(exact, slip, atol=1e-12)  # rounding of differences
    printed = eqs.slip_shear_as_printed(d_s, k, load, clockwise)
    miss = (np.cos(TWIST) - 1.0) * np.sin(TWIST) + np.sin(TWIST) * np.cos(TWIST) - np.sin(TWIST)
    np.testing.assert_allclose(printed - exact, -miss, atol=1e-12)
    zero, angle = np.zeros(()), np.radians(20.0)
    rigid = eqs.slip_shear_as_printed(zero, 0.0, 0.0, np.asarray(angle)) / np.sin(angle)
    assert float(rigid) == pytest.approx(0.88, abs=0.005)  # 12 % low


def test_equations_4_to_6_and_9_for_a_small_twist(matched):
    linear = solve_contact(
        Contact(SOFT, MATCHED, Paraboloid(30.0), GRID, 0.5),
        Pose(0.3, SHIFT, TWIST, CENTRE, linear=True),
    )
    k = float(stiffness_ratio(SOFT, MATCHED))
    d_s = gradient(np.asarray(linear.elastomer_displacement()[:2]))
    d_b = gradient(np.asarray(linear.object_displacement()[:2]))
    d_slip = gradient(np.asarray(linear.slip))
    left = d_b - eqs.object_gradient(d_s, k)
    across, along = eqs.small_slip_shears(d_s, k, (left[..., 0, 1], left[..., 1, 0]), -TWIST)
    np.testing.assert_allclose(across, d_slip[..., 0, 1], atol=1e-12)
    np.testing.assert_allclose(along, d_slip[..., 1, 0], atol=1e-12)
    by_differences = eqs.slip_curl(curl(d_s), k, curl(left), -TWIST)
    np.testing.assert_allclose(by_differences, curl(d_slip), atol=1e-12)
    phi = linear.elastomer_rotation()  # the exact curl needs no load term
    exact = 2.0 * (TWIST + linear.object_rotation() - phi)
    np.testing.assert_allclose(eqs.slip_curl(2.0 * phi, k, 0.0, -TWIST), exact, atol=1e-12)
    np.testing.assert_allclose(eqs.slip_curl_of_rotation(phi, k, 0.0, -TWIST), exact, atol=1e-12)


def test_equations_10_to_12_along_a_path_with_a_reversal():
    k = float(stiffness_ratio(*ALIKE))
    poses = [Pose(0.0, linear=True), Pose(0.3, linear=True)]
    poses += [Pose(0.3, twist=angle, linear=True) for angle in (0.06, -0.02)]
    path = make_path(poses, [1, 3, 4])
    contacts = solve_path(Contact(*ALIKE, Paraboloid(30.0), GRID, 0.5), path, rtol=1e-11)
    phi, slip_curl, total = [], [], 0.0
    for i in range(8):
        step = contacts.at_step(i)
        phi.append(eqs.small_rotation(gradient(np.asarray(step.elastomer_displacement()[:2]))))
        slip_curl.append(curl(gradient(np.asarray(step.slip))))
    centre = (30, 30)
    for i in range(8):
        # Eq. (11), and between two steps Eq. (10)
        difference = phi[i] - phi[i][centre]
        expected = eqs.rotation_difference(slip_curl[i] - slip_curl[i][centre], k)
        np.testing.assert_allclose(difference, expected, atol=1e-12)
        np.testing.assert_allclose(
            eqs.slip_curl_difference(phi[i], phi[i][centre], k) + slip_curl[i][centre],
            slip_curl[i],
            atol=1e-12,
        )
    for i in range(1, 8):  # Eq. (12): what sticks between two steps follows the object
        deep = deep_inside(np.asarray(contacts.stick[i]))
        turn = eqs.object_rotation((phi[i] - phi[i - 1])[deep], k)
        assert deep.any()
        total += float(np.mean(turn))
        assert total == pytest.approx(float(path.twist[i]), abs=1e-9)


def test_equations_7_and_8_for_finite_strain():
    turn, stretch = 0.3, np.array([[1.1, 0.05], [0.05, 0.9]])
    f = (eqs.rotation_change(np.asarray(turn)) + np.eye(2)) @ stretch
    along_x, along_y = eqs.line_element_rotations(f)
    assert float(eqs.mean_line_rotation(f)) == pytest.approx(0.5 * float(along_x + along_y))
    assert float(eqs.polar_rotation(f)) == pytest.approx(turn, rel=1e-14)
    assert abs(float(eqs.mean_line_rotation(f)) - turn) > 1e-3  # strain misleads the two elements
