import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ellipe, ellipk, ellipkm1

from contactmodel import analytic
from contactmodel.analytic.elliptic import complete_elliptic

# Lubkin's torsion: κ, G*a²θ/(μP), M/(μPa), independent quadrature to seven digits
LUBKIN = [
    (0.9, 0.0385139, 0.1763454),
    (0.7, 0.1234363, 0.4097385),
    (0.5, 0.2257119, 0.5285760),
    (0.3, 0.3655699, 0.5768680),
]
A, G, MU_P0 = 5.0, 0.8, 0.32
RATIO = MU_P0 / (2 * G)
FORCE = 2.0 / 3.0 * np.pi * A**2 * MU_P0  # μP
DENSITY = analytic.hertz_density(A, RATIO)
stick_ratio = jax.jit(analytic.lubkin_stick_ratio)


def same(actual, expected, rel=0.0, abs=0.0):
    if not rel and not abs:
        rel = 1e-9
    np.testing.assert_allclose(np.asarray(actual), np.asarray(expected), rtol=rel, atol=abs)


def test_complete_elliptic_integrals():
    kappa = np.array([1.0, 0.999, 0.5, 0.01, 1e-6, 1.01e-9, 0.99e-9, 1e-12, 1e-40, 1e-150])
    first, second = complete_elliptic(kappa)
    np.testing.assert_allclose(first, ellipkm1(kappa**2), rtol=1e-14)
    np.testing.assert_allclose(second, ellipe(1 - kappa**2), rtol=1e-14)


def test_hertz_contact_carries_its_force():
    hertz = analytic.hertz_from_approach(0.8, 20.0, 0.5)
    same(hertz.radius, 4.0)
    carried = quad(
        lambda r: (
            2 * np.pi * r * float(analytic.hertz_pressure(r, hertz.radius, hertz.peak_pressure))
        ),
        0,
        float(hertz.radius),
    )[0]
    same(carried, float(hertz.force), rel=1e-09)
    # work of the force over the approach: dU/dδ = P with P ~ δ^{3/2}
    slope = jax.grad(lambda d: analytic.hertz_from_approach(d, 20.0, 0.5).force)(0.8)
    same(slope, 1.5 * hertz.force / 0.8, rel=1e-12)


def test_there_is_no_hertz_contact_before_touch():
    for approach in (0.0, -0.1):
        hertz = analytic.hertz_from_approach(approach, 20.0, 0.5)
        assert hertz.radius == hertz.peak_pressure == hertz.force == 0.0
    assert jax.grad(lambda d: analytic.hertz_from_approach(d, 20.0, 0.5).force)(0.0) == 0.0


def test_nothing_is_pressed_in_before_touch():
    hertz = analytic.hertz_from_approach(np.array([-0.1, 0.0]), 20.0, 0.5)
    for r in (0.0, 2.0):
        pressed = (r, hertz.radius, hertz.peak_pressure)
        assert (analytic.hertz_pressure(*pressed) == 0.0).all()
        assert (analytic.hertz_indentation(*pressed, 0.5) == 0.0).all()
        assert (analytic.hertz_radial_displacement(*pressed, 0.3, 0.3) == 0.0).all()


def test_hertz_indentation_fills_the_gap():
    hertz = analytic.hertz_from_approach(0.8, 20.0, 0.5)
    r = np.linspace(0.0, 4.0, 9)
    inside = analytic.hertz_indentation(r, hertz.radius, hertz.peak_pressure, 0.5)
    np.testing.assert_allclose(inside, 0.8 - r**2 / 40.0, rtol=1e-12)
    far = analytic.hertz_indentation(1e3, hertz.radius, hertz.peak_pressure, 0.5)
    # Boussinesq's point force on a half-space of modulus 2G/(1−ν)
    same(far, float(hertz.force) / (np.pi * 0.5 * 1000.0), rel=1e-05)


def test_hertz_indentation_is_a_sum_of_point_forces():
    r = 6.1

    def ring(s):
        pressure = float(analytic.hertz_pressure(s, A, 1.0))
        kernel = quad(lambda t: 1 / np.sqrt(r**2 + s**2 - 2 * r * s * np.cos(t)), 0, np.pi)[0]
        return pressure * s * 2 * kernel

    expected = quad(ring, 0, A)[0] / (np.pi * 0.7)
    same(analytic.hertz_indentation(r, A, 1.0, 0.7), expected, rel=1e-08)


def test_hertz_radial_displacement():
    g, nu = 0.3, 0.3
    # Outside and inside: Gauss's theorem for the radial point-force field −(1−2ν)P/4πG r
    for r in (1.0, 3.0, 5.0, 8.0):
        within = quad(
            lambda s: 2 * np.pi * s * float(analytic.hertz_pressure(s, A, 1.0)), 0, min(r, A)
        )[0]
        expected = -(1 - 2 * nu) * within / (4 * np.pi * g * r)
        same(analytic.hertz_radial_displacement(r, A, 1.0, g, nu), expected, rel=1e-09)
    assert analytic.hertz_radial_displacement(0.0, A, 1.0, g, nu) == 0.0
    assert analytic.hertz_radial_displacement(2.0, A, 1.0, g, 0.5) == 0.0


@pytest.mark.parametrize(("kappa", "twist", "moment"), LUBKIN)
def test_lubkin_against_quadrature(kappa, twist, moment):
    # with μP = a = G* = 1: μp0/2G* = 3/4π
    same(analytic.lubkin_twist(kappa, 3 / (4 * np.pi)), twist, abs=1e-07)
    same(analytic.lubkin_moment(kappa, 1.0, 1.0, 1.0), moment, abs=1e-07)


def test_lubkin_limits():
    same(analytic.lubkin_moment(1e-9, 0.5, 2.0, 3.0), 3 * np.pi / 16 * 3.0, rel=1e-09)
    same(analytic.lubkin_twist(1.0, 0.3), 0.0, abs=1e-15)


@pytest.mark.parametrize("kappa", [0.0, 1e-300, 1e-40, 1e-6])
def test_moments_meet_their_limits_where_nothing_sticks(kappa):
    # what a core of κ = 1e-6 adds is of order κ³; the rest is quadrature of s² ln s near 0
    same(analytic.lubkin_moment(kappa, 0.5, 2.0, 3.0), 3 * np.pi / 16 * 3.0, rel=1e-11)
    same(analytic.torsion_moment(DENSITY, kappa * A, A, G), 3 * np.pi / 16 * FORCE * A, rel=1e-11)
    same(analytic.flat_disc_moment(kappa, 0.5, 2.0, 3.0), np.pi / 4 * 3.0, rel=1e-11)


def test_stick_ratio_of_a_twist_far_beyond_slip():
    # K = ln(4/κ), E = 1: κ = 4 exp(−1 − θ/ratio), until a double can hold no less
    same(stick_ratio(0.5, 0.01), 4 * np.exp(-51.0), rel=1e-11)
    assert 0.0 < stick_ratio(3.0, 1e-4) < 1e-300


@given(st.floats(-3.0, 3.0), st.floats(0.05, 2.0))
def test_stick_ratio_inverts_the_twist(twist, ratio):
    kappa = stick_ratio(twist, ratio)
    assert 0.0 < kappa <= 1.0
    same(analytic.lubkin_twist(kappa, ratio), abs(twist), abs=1e-12 * ratio + 1e-13)


def test_gradient_of_the_stick_ratio():
    slope = jax.grad(lambda t: analytic.lubkin_stick_ratio(t, 0.3))(0.1)
    inverse = jax.grad(lambda k: analytic.lubkin_twist(k, 0.3))(
        analytic.lubkin_stick_ratio(0.1, 0.3)
    )
    same(slope, 1 / inverse, rel=1e-09)
    step = 1e-5
    difference = (
        analytic.lubkin_stick_ratio(0.1 + step, 0.3) - analytic.lubkin_stick_ratio(0.1 - step, 0.3)
    ) / (2 * step)
    same(slope, difference, rel=1e-07)  # central difference: step² times curvature


def test_moment_rises_by_that_of_the_stick_disc():
    """dM/dθ = (16/3) G* c³: only the stick region resists more."""

    def moment(twist):
        kappa = analytic.lubkin_stick_ratio(twist, RATIO)
        return analytic.lubkin_moment(kappa, 1.0, FORCE, A)

    for twist in (0.01, 0.1, 0.3):
        c = A * analytic.lubkin_stick_ratio(twist, RATIO)
        same(jax.grad(moment)(twist), 16 / 3 * G * c**3, rel=1e-09)


def test_jaegers_density_of_a_hertz_pressure():
    density = analytic.jaeger_density(lambda r: analytic.hertz_pressure(r, A, MU_P0), A, G)
    s = np.array([0.3, 1.0, 2.5, 4.0, 4.9])
    np.testing.assert_allclose(density(s), DENSITY(s), rtol=1e-9)


@pytest.mark.parametrize("kappa", [0.9, 0.5, 0.1])
def test_jaegers_sums_are_lubkins_closed_forms(kappa):
    same(
        analytic.torsion_twist(DENSITY, kappa * A, A),
        float(analytic.lubkin_twist(kappa, RATIO)),
        rel=1e-12,
    )
    same(
        analytic.torsion_moment(DENSITY, kappa * A, A, G),
        float(analytic.lubkin_moment(kappa, 1.0, FORCE, A)),
        rel=1e-12,
    )


@pytest.mark.parametrize("kappa", [0.8, 0.4])
def test_traction_is_friction_where_it_slips_and_less_where_it_sticks(kappa):
    c = kappa * A
    slipping = np.linspace(c * 1.001, A * 0.999, 7)
    np.testing.assert_allclose(
        analytic.torsion_traction(slipping, DENSITY, c, A, G),
        analytic.hertz_pressure(slipping, A, MU_P0),
        rtol=1e-9,
    )
    sticking = np.linspace(0.05 * c, 0.99 * c, 7)
    assert (
        analytic.torsion_traction(sticking, DENSITY, c, A, G)
        < analytic.hertz_pressure(sticking, A, MU_P0)
    ).all()


def test_traction_carries_the_moment():
    c = 2.5

    def ring(r):
        return 2 * np.pi * r**2 * float(analytic.torsion_traction(r, DENSITY, c, A, G))

    carried = quad(ring, 0, c, epsabs=1e-9)[0] + quad(ring, c, A, epsabs=1e-9)[0]
    same(carried, float(analytic.torsion_moment(DENSITY, c, A, G)), rel=1e-06)


def test_displacement_is_rigid_where_it_sticks_and_that_of_a_moment_far_away():
    c = 2.0
    twist = float(analytic.torsion_twist(DENSITY, c, A))
    r = np.array([0.1, 1.0, 1.99])
    np.testing.assert_allclose(
        analytic.torsion_displacement(r, DENSITY, c, A), r * twist, rtol=1e-12
    )
    outside = analytic.torsion_displacement(np.array([2.1, 4.0, 6.0]), DENSITY, c, A)
    assert (outside < np.array([2.1, 4.0, 6.0]) * twist).all()
    moment = float(analytic.torsion_moment(DENSITY, c, A, G))
    far = 500.0  # point moment on the pair: u = M/(4πG r²)
    same(
        analytic.torsion_displacement(far, DENSITY, c, A),
        moment / (4 * np.pi * G * far**2),
        rel=0.0001,
    )


def test_displacement_from_the_traction_by_cerruti():
    """u_θ as the surface integral of the traction with the torsion kernel of a ring."""
    c, r = 2.0, 3.7

    def ring(s):
        def kernel(t):
            distance = np.sqrt(r**2 + s**2 - 2 * r * s * np.cos(t))
            return np.cos(t) / distance

        # ν drops out under torsion: the transverse compliance of a half-space is 1/(Gq)
        return (
            float(analytic.torsion_traction(s, DENSITY, c, A, G))
            * s
            * 2
            * quad(kernel, 0, np.pi, limit=200)[0]
        )

    total = sum(
        quad(ring, low, high, limit=100, epsabs=1e-8)[0] for low, high in ((0, c), (c, r), (r, A))
    )
    same(analytic.torsion_displacement(r, DENSITY, c, A), total / (2 * np.pi * G), rel=1e-05)


FIELDS = {
    "indentation": lambda r, a, _: analytic.hertz_indentation(r, a, 1.0, 0.7),
    "radial": lambda r, a, _: analytic.hertz_radial_displacement(r, a, 1.0, 0.3, 0.3),
    "punch": lambda r, a, _: analytic.punch_displacement(r, a),
    "torsion": lambda r, a, c: analytic.torsion_displacement(
        r, analytic.hertz_density(a, RATIO), c, a
    ),
}


@pytest.mark.parametrize("name", FIELDS)
def test_fields_differentiate_in_r_a_and_c(name):
    field = jax.jit(jnp.vectorize(FIELDS[name]))
    slopes = jax.jit(jnp.vectorize(jax.grad(FIELDS[name], argnums=(0, 1, 2))))
    r, step = np.array([0.3, 1.9, 2.1, 4.9, 5.1, 9.0]), 1e-5  # around c = 2 and a = 5
    for i, slope in enumerate(slopes(r, A, 2.0)):
        shift = step * np.eye(3)[i]
        high = field(r + shift[0], A + shift[1], 2.0 + shift[2])
        low = field(r - shift[0], A - shift[1], 2.0 - shift[2])
        # central difference: step² times a third derivative below 100 beside the edges
        np.testing.assert_allclose(slope, (high - low) / (2 * step), atol=1e-7)
    corners = np.asarray(slopes(np.array([0.0, 2.0, A]), A, 2.0))
    assert np.isfinite(corners).all()


def test_torsion_turns_rigidly_at_the_rim_of_the_stick_region():
    twist = float(analytic.torsion_twist(DENSITY, 2.0, A))
    slope = jax.grad(lambda r: analytic.torsion_displacement(r, DENSITY, 2.0, A))
    same(slope(2.0), twist, rel=1e-12)
    same(slope(0.0), twist, rel=1e-12)


def test_reissner_sagoci():
    carried = quad(
        lambda t: (
            2
            * np.pi
            * (A * np.sin(t)) ** 2
            * float(analytic.reissner_sagoci_traction(A * np.sin(t), 0.1, A, G))
            * A
            * np.cos(t)
        ),
        0,
        np.pi / 2,
    )[0]
    same(carried, float(analytic.reissner_sagoci_moment(0.1, A, G)), rel=1e-09)
    assert analytic.punch_displacement(3.0, 5.0) == 3.0
    same(analytic.punch_displacement(5.0 + 1e-12, 5.0), 5.0, abs=1e-05)
    far = float(analytic.punch_displacement(1e3, A))
    same(far, 16 / 3 * A**3 / (4 * np.pi * 1000000.0), rel=0.0001)


def test_flat_disc_starts_to_slip_and_ends_where_friction_ends():
    start = analytic.flat_disc_twist(1.0, 1.0, FORCE, A, G)
    same(start, FORCE / (8 * G * A**2), rel=1e-14)
    stuck = analytic.reissner_sagoci_moment(start, A, G)
    same(stuck, 2 / 3 * FORCE * A, rel=1e-12)
    same(analytic.flat_disc_moment(1.0, 1.0, FORCE, A), stuck, rel=1e-12)


def test_flat_disc_moment_is_the_work_of_its_stick_discs():
    """dM = (16/3) G* c³ dθ from the first slip on, by a quadrature of its own."""

    def twist(kappa):
        return FORCE * ellipk(1 - kappa**2) / (4 * np.pi * G * A**2)

    for kappa in (0.8, 0.3):
        # ∫ c³ dθ by parts, θ by scipy
        rest = kappa**3 * twist(kappa) + 3 * quad(lambda s: s**2 * twist(s), kappa, 1)[0]
        expected = 16 / 3 * G * A**3 * rest
        same(analytic.flat_disc_moment(kappa, 1.0, FORCE, A), expected, rel=1e-9)
        slope = jax.grad(analytic.flat_disc_moment)(kappa, 1.0, FORCE, A) / jax.grad(
            analytic.flat_disc_twist
        )(kappa, 1.0, FORCE, A, G)
        same(slope, 16 / 3 * G * (kappa * A) ** 3, rel=1e-9)


def test_mindlin_shift():
    compliance = (2 - 0.0) / 0.5 + (2 - 0.0) / 2.0
    small, ratio = analytic.mindlin_shift(1e-6, 0.5, 4.0, 3.0, compliance)
    # first order: the full-stick compliance of a Hertz contact, Q/8a times the sum
    same(small, 1e-06 / (8 * 3.0) * compliance, rel=1e-05)
    same(ratio, 1.0, abs=1e-06)
    last, ratio = analytic.mindlin_shift(2.0, 0.5, 4.0, 3.0, compliance)
    assert ratio == 0.0
    same(last, 3 * 2.0 / (16 * 3.0) * compliance)


@jax.jit
def virgin_moment(twist):
    kappa = analytic.lubkin_stick_ratio(twist, RATIO)
    return jnp.sign(twist) * analytic.lubkin_moment(kappa, 1.0, FORCE, A)


@pytest.mark.parametrize("ratio", [0.0, -0.1, np.nan])
def test_a_contact_without_friction_has_no_stick_ratio(ratio):
    with pytest.raises(ValueError, match="friction ratio μp0/2G\\* must be above 0"):
        analytic.lubkin_stick_ratio(0.1, ratio)


def test_masing_closes_its_loops():
    top, bottom = 0.2, -0.05
    at_top = virgin_moment(top)
    same(analytic.masing(virgin_moment, [top], top), float(at_top), rel=1e-12)
    # the loop closes: reloading from the bottom reaches the top again
    same(analytic.masing(virgin_moment, [top, bottom], top), float(at_top), rel=1e-09)
    # and unloading to −θ₁ meets the first-loading curve of the other side
    same(analytic.masing(virgin_moment, [top], -top), -float(at_top), rel=1e-09)


def test_masing_unloads_with_the_stiffness_of_full_stick():
    slope = jax.grad(lambda t: analytic.masing(virgin_moment, [0.2], t))(0.2 - 1e-7)
    same(slope, 16 / 3 * G * A**3, rel=1e-05)


def test_open_turns():
    path = [0.0, 1.0, 2.0, 1.0, 0.0, -1.0, -0.5, -1.2, -2.5, 0.0, 3.0]
    assert analytic.open_turns(path) == [
        (),
        (),
        (),
        (2.0,),
        (2.0,),
        (2.0,),
        (2.0, -1.0),
        (2.0,),
        (),
        (-2.5,),
        (),
    ]
    assert analytic.open_turns([0.0, 0.0, 1.0, 1.0, 0.5]) == [(), (), (), (), (1.0,)]


@given(st.lists(st.floats(-0.5, 0.5), min_size=2, max_size=12))
def test_the_moment_never_exceeds_friction(path):
    limit = 3 * np.pi / 16 * FORCE * A
    turns = analytic.open_turns(path)
    assert all(abs(later) <= abs(t[0]) + 1e-12 for t in turns if t for later in t)
    assert abs(float(analytic.masing(virgin_moment, turns[-1], path[-1]))) <= limit * (1 + 1e-12)


@given(st.lists(st.sampled_from(np.linspace(-1.0, 1.0, 21).tolist()), min_size=1, max_size=15))
def test_masing_is_a_stack_of_sliding_springs(path):
    """Springs in parallel, each held by its own friction, know nothing of Masing's rule."""
    limits, stiffness = np.array([0.05, 0.2, 0.45, 0.8]), np.array([3.0, 1.0, 2.0, 0.5])
    stretch, last = np.zeros(4), 0.0
    for twist, turns in zip(path, analytic.open_turns(path), strict=True):
        for _ in range(2):  # a monotonic step may be taken in parts
            stretch = np.clip(stretch + 0.5 * (twist - last), -limits, limits)
        last = twist
        moment = analytic.masing(
            lambda t: np.sum(stiffness * np.clip(t, -limits, limits)), turns, twist
        )
        same(moment, np.sum(stiffness * stretch), abs=1e-12)


def test_nothing_turns_in_the_middle_when_all_of_it_slips():
    u = analytic.torsion_displacement(np.array([0.0, 1.0]), DENSITY, 0.0, A)
    hardly = analytic.torsion_displacement(np.array([0.0, 1.0]), DENSITY, 1e-9 * A, A)
    assert float(u[0]) == 0.0
    same(u[1], hardly[1], rel=1e-6)  # the quadrature of a stick region that is hardly there


def test_a_shift_has_the_sign_of_its_force():
    forth, ratio = analytic.mindlin_shift(0.7, 0.5, 4.0, 3.0, 2.0)
    back, same_ratio = analytic.mindlin_shift(-0.7, 0.5, 4.0, 3.0, 2.0)
    assert float(back) == -float(forth) < 0.0
    assert float(same_ratio) == float(ratio)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda: analytic.mindlin_shift(2.1, 0.5, 4.0, 3.0, 2.0), "friction carries no more"),
        (lambda: analytic.mindlin_shift(1.0, 0.5, 4.0, -3.0, 2.0), "above 0"),
        (lambda: analytic.mindlin_shift(1.0, 0.5, -4.0, 3.0, 2.0), r"P presses .*-force\[2\]"),
        (lambda: analytic.lubkin_moment(0.5, 0.5, -4.0, 3.0), r"P presses .*-force\[2\]"),
        (lambda: analytic.lubkin_moment(1.2, 0.5, 4.0, 3.0), "lie from 0 to 1, got 1.2"),
        (lambda: analytic.flat_disc_moment(-0.1, 0.5, 4.0, 3.0), "lie from 0 to 1, got -0.1"),
        (lambda: analytic.flat_disc_twist(1.0, 0.5, -4.0, 3.0, 0.2), "P presses the bodies"),
        (lambda: analytic.lubkin_twist(1.5, 0.1), r"\(0, 1\], got 1.5"),
        (lambda: analytic.lubkin_twist(np.array([0.5, 0.0]), 0.1), r"\(0, 1\]"),
        (lambda: analytic.hertz_from_approach(0.1, -1.0, 1.0), "above 0"),
        (lambda: analytic.hertz_from_approach(0.1, 1.0, 0.0), "above 0"),
    ],
)
def test_what_no_contact_can_have_is_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        wrong()


def test_shift_under_hertz_pressure_is_cattaneo_and_mindlins():
    ratio = np.linspace(1.0, 0.1, 400)
    shift, force = analytic.shift_curve(lambda r: np.sqrt(1.0 - r**2), ratio)
    np.testing.assert_allclose(shift, 1.5 * (1.0 - ratio**2), atol=1e-5)
    np.testing.assert_allclose(force, 1.0 - ratio**3, atol=1e-5)


def test_torsion_under_hertz_pressure_is_lubkins():
    curve = analytic.torsion_curve(lambda r: np.sqrt(1.0 - r**2))
    kappa, full = curve.stick_ratio[1:], 3.0 * np.pi / 16.0
    same(curve.moment[1:], analytic.lubkin_moment(kappa, 1.0, 1.0, 1.0) / full, abs=1e-5)
    same(curve.twist[1:], analytic.lubkin_twist(kappa, 1.0) * 4.0 / np.pi / full, abs=1e-4)


@pytest.mark.parametrize("flat", [0.0, 0.5, 0.85])
def test_torsion_begins_with_the_stiffness_and_ends_at_the_limit(flat):
    curve = analytic.torsion_curve(analytic.rounded_punch_pressure(flat))
    assert curve.moment[1] / curve.twist[1] == pytest.approx(1.0, abs=1e-4)
    assert curve.moment[-1] == pytest.approx(1.0, abs=3e-4)


def test_rounded_punch_goes_from_hertz_to_a_flat_disc():
    r = np.linspace(0.0, 0.8, 5)
    hertz = analytic.rounded_punch_pressure(0.0)(r)
    np.testing.assert_allclose(hertz / hertz[0], np.sqrt(1.0 - r**2), rtol=1e-4)
    flat = analytic.rounded_punch_pressure(0.99)(r)
    np.testing.assert_allclose(flat / flat[0], 1.0 / np.sqrt(1.0 - r**2), rtol=0.02)


def test_flat_part_must_lie_within_the_contact():
    with pytest.raises(ValueError, match=r"below 1 radius, but it is 1\.2"):
        analytic.rounded_punch_pressure(1.2)
