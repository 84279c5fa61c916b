"""A bonded layer against an independent spectral solution, asymptotes and its own limits."""

from functools import lru_cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import jv, roots_legendre

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    Layer,
    Paraboloid,
    Pose,
    Rigid,
    SquarePunch,
    fit_scalar_transfer,
    layer_gain,
    make_path,
    solve_contact,
    solve_path,
)
from contactmodel.elasticity.cells import cell_integrals
from contactmodel.elasticity.layer import base_kernels
from contactmodel.elasticity.transfer import base_transfer, half_space_transfer
from contactmodel.equations import object_rotation
from contactmodel.solution import ContactSolution

GRID = Grid((32, 32), (10.0, 10.0))
BALL = Paraboloid(30.0)


def matrices(q, thickness, nu, depth):
    """Displacement (û_L/i, ŵ) of a layer by (τ_L/i, p), times G, and û_T by τ_T.

    From the stiffness of growing and decaying waves as they stand, at the price of cancellation.
    """
    x, y = np.minimum(q * thickness, 300.0), np.minimum(q * thickness, 300.0) - q * depth
    f, s = 0.25 / (1.0 - nu), 3.0 - 4.0 * nu
    sh, ch = np.sinh(x), np.cosh(x)
    loose = 1.0 - 2.0 * nu
    stress = np.array(
        [
            [ch + 2 * f * x * sh, -2 * f * (loose * sh - x * ch)],
            [-2 * f * (loose * sh + x * ch), ch - 2 * f * x * sh],
        ]
    )
    sy, cy = np.sinh(y), np.cosh(y)
    moved = f * np.array([[s * sy + y * cy, y * sy], [-y * sy, s * sy - y * cy]])
    inverse = np.linalg.inv(np.moveaxis(stress, (0, 1), (-2, -1)))
    return np.moveaxis(moved, (0, 1), (-2, -1)) @ inverse / q[..., None, None], sy / ch / q


def spectral_solution(pressure, traction, spacing, body, depth, parts=5, cells=640):
    """Displacement by a large periodic grid, each cell divided, wave by wave."""
    fine = np.ones((parts, parts))
    size = len(pressure) * parts
    field = np.stack([np.kron(f, fine) for f in (pressure, *traction)])
    p, tx, ty = np.fft.fft2(np.pad(field, ((0, 0), (0, cells - size), (0, cells - size))))
    wave = 2.0 * np.pi * np.fft.fftfreq(cells, spacing / parts)
    qx, qy = np.meshgrid(wave, wave, indexing="ij")
    q = np.hypot(qx, qy)
    q[0, 0] = 1e-3  # the mean displacement is finite; a small wave stands for it
    nx, ny = qx / q, qy / q
    nx[0, 0] = 1.0
    along, across = nx * tx + ny * ty, nx * ty - ny * tx
    m, turn = matrices(q, float(body.thickness), float(body.poisson_ratio), depth)
    # i τ and i u: the matrix acts on (τ_L/i, p)
    u_l = 1j * (m[..., 0, 0] * along / 1j + m[..., 0, 1] * p)
    w = m[..., 1, 0] * along / 1j + m[..., 1, 1] * p
    u_t = turn * across
    u = np.fft.ifft2(np.stack([nx * u_l - ny * u_t, ny * u_l + nx * u_t, w])).real
    middle = slice(parts // 2, size, parts)
    return u[:, middle, middle] / float(body.shear_modulus)


def loaded(body, grid, pressure, traction):
    """A solution that holds given loads, for its displacements only."""
    contact = Contact(body, Rigid(), BALL, grid, 0.0)
    shapes = eqx.filter_eval_shape(solve_contact, contact, Pose(-1.0))  # nothing is compiled
    blank = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
    given = {"pressure": jnp.asarray(pressure), "traction": jnp.asarray(traction)}
    return ContactSolution(**{**vars(blank), **given, "problem": contact})


@pytest.mark.parametrize(("nu", "thickness"), [(0.0, 1.0), (0.48, 2.0), (0.5, 0.5)])
def test_fields_against_a_spectral_solution(nu, thickness):
    grid, body = Grid((24, 24), (6.0, 6.0)), Layer(1.3, nu, thickness)
    x, y = grid.points
    bump = np.exp(-(x**2 + y**2) / 2.25)
    rough = 1.0 + 0.3 * np.random.default_rng(0).random(grid.shape)
    pressure, traction = bump * rough, np.stack([bump * (x + 0.5), -bump * (y - 0.2)])
    solution = loaded(body, grid, pressure, traction)
    for depth in (0.0, 0.4 * thickness):
        u = np.asarray(solution.elastomer_displacement(depth)) * np.array([1, 1, -1])[:, None, None]
        exact = spectral_solution(pressure, traction, 0.25, body, depth)
        # cells divided by 5 resolve the spectral solution to some 5e-4 of the largest displacement
        assert np.abs(u - exact).max() < 1e-3 * np.abs(exact).max()


@pytest.mark.parametrize("depth", [0.0, 0.35, 1.0])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_difference_of_layer_and_half_space_has_no_cancellation(nu, depth):
    q = np.array([1e-2, 0.5, 2.0, 6.0])
    m, turn = matrices(q, 1.0, nu, depth)
    base, half = base_transfer(q, nu, depth), half_space_transfer(q * depth, nu)
    total = [q * np.asarray(m[:, 0, 0]), q * m[:, 1, 1], q * m[:, 0, 1], q * m[:, 1, 0], q * turn]
    names = ("longitudinal", "normal", "pull", "lift", "transverse")
    for name, value in zip(names, total, strict=True):
        # the matrices as they stand lose five digits at q = 1e-2
        np.testing.assert_allclose(
            getattr(base, name) + getattr(half, name), value, atol=1e-11, err_msg=name
        )


def test_kernels_against_quadrature():
    rho, nu = np.array([0.02, 0.7, 4.0, 20.0, 39.0]), 0.48
    kernel = base_kernels(rho, nu, 0.0, 0.0)
    nodes, weights = roots_legendre(3000)  # 260 waves of the Bessel functions
    x, weights = 15.0 * (nodes + 1.0), 15.0 * weights
    base = base_transfer(x, nu, 0.0)
    turn = jv(0, np.outer(rho, x)) @ (weights * base.normal)
    pull = jv(1, np.outer(rho, x)) @ (weights * base.pull)
    np.testing.assert_allclose(kernel.normal, turn, atol=1e-11)
    np.testing.assert_allclose(kernel.pull * rho, pull, atol=1e-11)


@lru_cache
def first_term(nu):
    """∫δ_z dx / 2π, by which a force sinks less, times Gh."""
    nodes, weights = roots_legendre(200)
    return float(weights @ base_transfer(15.0 * (nodes + 1.0), nu, 0.0).normal) * 7.5 / np.pi


@pytest.mark.parametrize("ratio", [100.0, 1000.0])
def test_thick_layer_has_the_first_term_in_contact_size_over_thickness(ratio):
    """A force F on a small area sinks less by F ∫δ_z dx / 2πGh than on a half-space."""
    nu, modulus, thickness = 0.45, 1.3, ratio
    distance = jnp.asarray(0.3)
    spacing = (1.0, 1.0)
    cell = cell_integrals(distance, 0.0 * distance, spacing)
    layer = Layer(modulus, nu, thickness).coefficients(cell, spacing)
    half = HalfSpace(modulus, nu).coefficients(cell, spacing)
    expected = first_term(nu) / (modulus * thickness)
    # the next term is smaller by the square of distance over thickness
    assert float(layer.zz - half.zz) == pytest.approx(expected, rel=10.0 / ratio**2)


def test_gradient_with_respect_to_thickness_is_that_of_the_first_term():
    """F(h) = Hertz(δ + cF/h), c = −∫δ_z dx / 2πG: dF/dh = −kcF/h² / (1 − kc/h), k = 2E*a."""
    nu, thickness, approach, radius = 0.45, 1000.0, 0.3, 30.0
    grid = Grid((48, 48), (10.0, 10.0))

    def force(thickness):
        layer = Layer(1.0, nu, thickness)
        pose = Pose(approach)
        return -solve_contact(Contact(layer, Rigid(), Paraboloid(radius), grid, 0.0), pose).force[2]

    pair = 2.0 / (1.0 - nu)  # E* in G
    stiffness = 2.0 * pair * np.sqrt(radius * approach)
    pressed = 2.0 / 3.0 * stiffness * approach
    c = -first_term(nu)
    expected = -stiffness * c * pressed / thickness**2 / (1.0 - stiffness * c / thickness)
    slope = jax.jvp(force, (thickness,), (1.0,))[1]
    # cells are counted whole at the rim: 2 % of the stiffness, as of Hertz; F's own change 0.4 %
    assert float(slope) == pytest.approx(expected, rel=2e-2)


def test_far_away_a_layer_does_not_move():
    c = Layer(1.0, 0.5, 1.0).coefficients(
        cell_integrals(jnp.asarray([25.0, 45.0]), jnp.zeros(2), (0.5, 0.5)), (0.5, 0.5)
    )
    assert np.abs(np.asarray(c.zz)).max() < 1e-9  # e^{−0.74·25}; the half-space has 3e-3
    assert float(c.zz[1]) == 0.0


def test_uneven_cells_are_as_good_as_their_halves():
    body, wide, square = Layer(1.0, 0.4, 1.0), (0.5, 0.25), (0.25, 0.25)
    x, y = jnp.asarray([0.0, 0.6, 1.5]), jnp.asarray([0.1, -0.4, 0.7])
    whole = body.coefficients(cell_integrals(x, y, wide), wide)
    halves = [body.coefficients(cell_integrals(x + s, y, square), square) for s in (-0.125, 0.125)]
    for name in whole._fields:
        both = getattr(halves[0], name) + getattr(halves[1], name)
        # of the second order both; 1e-4 of the largest at this ratio of cell to thickness
        np.testing.assert_allclose(getattr(whole, name), both, atol=1e-4, err_msg=name)


def test_reciprocity_and_rotation_of_a_layer():
    body, spacing = Layer(0.7, 0.45, 1.5), (0.3, 0.3)

    def at(point):
        return body.coefficients(cell_integrals(point[0], point[1], spacing), spacing)

    point = jnp.asarray([0.8, -0.5])
    c = at(point)
    assert float(c.zx) == pytest.approx(-float(c.xz), rel=1e-12)
    slope = jax.jacfwd(at)(point)
    half_curl = 0.5 * (slope.xy[0] - slope.xx[1])  # ½(∂u_y/∂x − ∂u_x/∂y) by τ_x
    # the two cell means of the base's share agree to the fourth order of cell over thickness
    assert float(c.turn_x) == pytest.approx(float(half_curl), rel=1e-4)


def test_thin_layer_is_a_foundation():
    """A compressible layer much thinner than the contact: p = 2(1−ν)G/((1−2ν)h) overlap."""
    nu, h = 0.3, 0.16
    grid = Grid((64, 64), (10.0, 10.0))
    solution = solve_contact(Contact(Layer(1.0, nu, h), Rigid(), BALL, grid, 0.0), Pose(0.05))
    overlap = np.asarray(0.05 - BALL.height(jnp.asarray(grid.points)))
    expected = 2.0 * (1.0 - nu) / ((1.0 - 2.0 * nu) * h) * np.maximum(overlap, 0.0)
    # corrections of the order (h/a)², a = 1.7 mm, away from the rim
    inner = np.hypot(*grid.points) < 1.0
    np.testing.assert_allclose(np.asarray(solution.pressure)[inner], expected[inner], rtol=2e-2)


@pytest.mark.parametrize(
    ("nu", "friction", "thickness"),
    # one cell thick, eleven times less than the contact's radius; with friction, an
    # incompressible layer as thin as that does not settle, and `result` says so
    [(0.3, 0.0, 0.16), (0.499, 0.0, 0.16), (0.5, 0.0, 0.16), (0.3, 0.5, 0.16), (0.499, 0.2, 0.5)],
)
def test_thin_layers_converge(nu, friction, thickness):
    grid = Grid((64, 64), (10.0, 10.0))
    pose = Pose(0.1, twist=0.05, shift=(0.01, 0.0))
    solution = solve_contact(
        Contact(Layer(1.0, nu, thickness), Rigid(), BALL, grid, friction), pose
    )
    if friction == 0.0:
        assert int(solution.normal.steps) <= 20
    assert float(solution.normal.residual) <= 1e-8


def test_gradients_with_history_meet_central_differences():
    grid = Grid((24, 24), (10.0, 10.0))
    points = np.array([[0.4, -0.3], [2.0, 1.0]])
    mixed = np.random.default_rng(1).normal(size=9)

    @jax.jit
    @jax.value_and_grad  # one program for the differences as well
    def output(values):
        thickness, nu, depth, twist = values
        path = make_path([Pose(0.0), Pose(0.3, twist=twist), Pose(0.3, twist=0.3 * twist)], [1, 1])
        bodies = Layer(1.0, nu, thickness), HalfSpace(3.0, 0.3)
        last = solve_path(Contact(*bodies, BALL, grid, 0.5), path, rtol=1e-12).at_step(-1)
        moved = last.elastomer_displacement_at(points, depth)
        scalars = jnp.stack([last.moment, last.force[2], 100.0 * last.dissipated_energy])
        return mixed @ jnp.concatenate([scalars, 10.0 * moved.reshape(-1)])

    values = jnp.asarray([2.0, 0.47, 0.3, 0.05])
    slope = output(values)[1]
    for i in range(len(values)):
        step = jnp.zeros(4).at[i].set(1e-5)
        difference = (output(values + step)[0] - output(values - step)[0]) / 2e-5
        # the solver's 1e-12 over the step: 1e-7 and less; and curvature
        assert float(slope[i]) == pytest.approx(float(difference), rel=1e-6, abs=1e-6)
    assert bool(jnp.all(jnp.isfinite(output(values.at[1].set(0.5))[1])))


def test_depth_of_a_half_space_under_a_twisted_disc():
    """Full stick: φ(z)/θ = (2/π)[acot(z/a) − (z/a)/(1+z²/a²)] on the axis, S alone."""
    radius, twist = 3.0, 0.01
    grid = Grid((65, 65), (8.0, 8.0))
    r = np.hypot(*grid.points)
    inside = r < radius
    size = np.where(
        inside, 4.0 / np.pi * twist * r / np.sqrt(np.where(inside, radius**2 - r**2, 1)), 0
    )
    x, y = grid.points / np.maximum(r, 1e-9)
    solution = loaded(HalfSpace(1.0, 0.48), grid, 0.0 * r, np.stack([-size * y, size * x]))
    near = 1e-3 * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    for ratio in (0.1, 0.5, 1.0):
        u = np.asarray(solution.elastomer_displacement_at(near, ratio * radius))
        turn = 0.25e3 * ((u[0, 1] - u[1, 1]) - (u[2, 0] - u[3, 0]))
        exact = 2.0 / np.pi * (np.arctan(1.0 / ratio) - ratio / (1.0 + ratio**2))
        assert turn / twist == pytest.approx(exact, rel=2e-2)  # cells cut the singular edge


def test_depth_zero_and_the_base():
    body = Layer(1.0, 0.48, 2.0)
    solution = solve_contact(Contact(body, Rigid(), BALL, GRID, 0.5), Pose(0.3, twist=0.05))
    points = np.array([[0.4, -0.3], [2.0, 1.0]])
    surface = solution.elastomer_displacement_at(points)
    np.testing.assert_allclose(
        solution.elastomer_displacement_at(points, 1e-9), surface, atol=1e-8
    )  # continuous
    base = solution.elastomer_displacement_at(points, 2.0)
    # the mean over a cell of the layer's correction: (d/h)⁴ with d/h = 0.16, times some units
    assert float(jnp.max(jnp.abs(base))) < 4e-6 * float(jnp.max(jnp.abs(surface)))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: Layer(1.0, 0.48, 0.0), "above 0, got 0.0"),
        (lambda: Layer(1.0, 0.48, -2.0), "above 0"),
        (lambda: Layer(1.0, 0.48, 0.1).checked(GRID.spacing), "thinner than a cell"),
    ],
)
def test_wrong_layers_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wrong()


def test_wrong_depths_and_thin_layers_while_solving():
    solution = solve_contact(Contact(Layer(1.0, 0.48, 2.0), Rigid(), BALL, GRID, 0.5), Pose(0.3))
    points = np.zeros((1, 2))
    with pytest.raises(ValueError, match="larger than the layer's thickness"):
        solution.elastomer_displacement_at(points, 2.1)
    with pytest.raises(ValueError, match="depth must not be below 0"):
        solution.elastomer_displacement_at(points, -0.1)
    with pytest.raises(ValueError, match="thinner than a cell"):
        solve_contact(Contact(Layer(1.0, 0.48, 0.1), Rigid(), BALL, GRID, 0.5), Pose(0.05))


def test_gain_of_a_layer_wave_by_wave():
    """k̂(q)/k = coth qh, D = sinh(q(h − z))/sinh(qh), k̂_L/k by the compliances at ν = ½."""
    q, h, z = np.array([1e-6, 0.3, 2.0, 20.0]), 2.0, 0.4
    gain = layer_gain(q * h, q * z)
    np.testing.assert_allclose(gain.transverse, 1.0 / np.tanh(q * h) - 1.0, rtol=1e-9, atol=1e-15)
    motion = np.sinh(q * (h - z)) / np.sinh(q * h)
    # of waves a million times as long as thick the two compliances keep ten digits
    np.testing.assert_allclose(1.0 + gain.below, 1.0 / motion, rtol=1e-9)
    block, _ = matrices(q[1:], h, 0.5, 0.0)
    np.testing.assert_allclose(
        1.0 + gain.longitudinal[1:], 0.5 / q[1:] / block[..., 0, 0], rtol=1e-12
    )
    # long waves turn a layer by thickness over modulus: of two, h_B/h_S
    ratio = (1.0 + gain.transverse[0]) / (1.0 + layer_gain(q * 1.0, 0.0 * q).transverse[0])
    assert ratio == pytest.approx(1.0 / 2.0)
    assert layer_gain(q * np.inf, q * z).transverse == pytest.approx(0.0, abs=0.0)
    np.testing.assert_allclose(layer_gain(q * np.inf, q * z).below, np.expm1(q * z), rtol=1e-12)


def scalar_transfer(solution, region=None):
    turned = solution.elastomer_rotation(), solution.object_rotation()
    return fit_scalar_transfer(*turned, solution.contact if region is None else region)


def test_scalar_transfer_of_half_spaces_is_exact_and_of_a_layer_larger():
    pose = Pose(0.3, twist=0.05)
    object_ = HalfSpace(2.0, 0.3)
    thick, thin = HalfSpace(1.0, 0.48), Layer(1.0, 0.48, 2.0)
    exact = scalar_transfer(solve_contact(Contact(thick, object_, BALL, GRID, 0.5), pose))
    assert float(exact.stiffness_ratio) == pytest.approx(0.5, rel=1e-10)
    assert abs(float(exact.load_term)) < 1e-12
    solution = solve_contact(Contact(thin, object_, BALL, GRID, 0.5), pose)
    fit = scalar_transfer(solution)
    assert 0.5 < float(fit.stiffness_ratio) < 1.0
    assert 0.0 < float(fit.residual) < 0.1 * 0.05  # a tenth of the twist
    # By Eq. (13) k and L give the mean angle by which the two surfaces have turned apart: L's sign.
    region = np.asarray(solution.contact)
    phi = np.asarray(solution.elastomer_rotation())[region]
    apart = phi - np.asarray(solution.object_rotation())[region]
    assert abs(float(fit.load_term)) > 1e-4
    turned = object_rotation(phi.mean(), float(fit.stiffness_ratio), float(fit.load_term))
    assert turned == pytest.approx(apart.mean(), rel=1e-12)
    assert scalar_transfer(
        solve_contact(Contact(thick, object_, BALL, GRID, 0.5), Pose(0.3))
    ).stiffness_ratio == pytest.approx(0.0, abs=1.0)


# Share of the rotation that the elastomer does not show, %: a square face of 15 mm that sticks,
# ν = 0.48 both, mean over the inner 0.7; rows k, columns thickness [mm].
THICKNESSES = (None, 8.0, 5.0, 3.0, 2.0)
SHARES = {
    0.01: (0.99, 1.07, 1.22, 1.56, 2.05),
    0.1: (9.09, 9.78, 10.98, 13.73, 17.38),
    0.5: (33.33, 35.15, 38.18, 44.45, 51.64),
    1.0: (50.00, 52.02, 55.28, 61.63, 68.33),
}


def square_face(k, thickness, cells):
    """Share that φ misses [%], and the k fitted, with so many cells along the side."""
    side = 15.0 / cells
    grid = Grid((cells + 4, cells + 4), (15.0 + 4 * side, 15.0 + 4 * side))
    elastomer = Layer(1.0, 0.48, thickness) if thickness else HalfSpace(1.0, 0.48)
    pose = Pose(0.1, twist=0.01, linear=True)
    solution = solve_contact(
        Contact(elastomer, HalfSpace(1.0 / k, 0.48), SquarePunch(15.0), grid, 1e8), pose, rtol=1e-7
    )
    inner = np.abs(grid.points).max(axis=0) < 0.7 * 7.5
    share = 100.0 * (1.0 - float(jnp.mean(solution.elastomer_rotation()[inner])) / 0.01)
    return np.array([share, float(scalar_transfer(solution, inner).stiffness_ratio)])


def extrapolated(k, thickness, cells):
    """To cells of no size; the edge's singularity makes the error one of first order."""
    return 2.0 * square_face(k, thickness, 2 * cells) - square_face(k, thickness, cells)


@pytest.mark.parametrize("column", [0, 3])
def test_rotation_share_of_a_square_face(column):
    share, k = extrapolated(1.0, THICKNESSES[column], 20)
    assert share == pytest.approx(SHARES[1.0][column], abs=0.1)
    # where it sticks θ = (1+k) φ, but k weighs the squares of φ
    assert k == pytest.approx(share / (100.0 - share), rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("k", SHARES)
@pytest.mark.parametrize("column", range(5))
def test_table_of_rotation_shares(k, column):
    share, _ = extrapolated(k, THICKNESSES[column], 40)
    assert share == pytest.approx(SHARES[k][column], abs=0.1)
