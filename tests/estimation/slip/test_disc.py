"""The disc of markers that still stick, on gels of any thickness."""

import numpy as np
import pytest

from contactmodel.analytic import hertz_density, torsion_displacement, turn_layer_disc
from estimation.fields.profile import share_around
from estimation.slip.disc import (
    SlipSettings,
    Thickness,
    _Motion,
    describe_disc,
    fit_disc,
    learn_thickness,
)

SETTINGS = SlipSettings()
SCALE = 1e-3
R = np.linspace(0.1, 5.0, 40)


def markers(seed=0):
    x, y = np.meshgrid(np.arange(-5.0, 6.0), np.arange(-5.0, 6.0))
    rng = np.random.default_rng(seed)
    points = (x + 1j * y + complex(*rng.uniform(-0.5, 0.5, 2))).ravel()
    return points[np.abs(points) < 5.0], rng


def turn(points, radius, thickness, turned=0.02):
    """Turn points around the origin, on a layer."""
    distance = np.abs(points) / radius
    share = turn_layer_disc(distance, thickness / radius).displacement / distance
    return points * np.exp(1j * turned * share)


def shake(points, rng):
    """Noise of the difference of two positions."""
    return SCALE * rng.normal(size=(len(points), 2)) @ [1.0, 1j]


def fit(before, after, known=None, axis=None):
    known = known or Thickness(np.log(SETTINGS.thickness), SETTINGS.thickness_error)
    best = fit_disc(before, after, SCALE, None, axis, known, SETTINGS)
    return best, describe_disc(best, before, after, SCALE, SETTINGS)


def test_a_small_twist_moves_a_slipping_contact_as_a_disc_does():
    c, step = 2.0, 1e-5
    density = hertz_density(5.0, 0.2)
    before, after = (
        np.asarray(torsion_displacement(R, density, np.array([[at]]), 5.0))[0] / R
        for at in (c, c - step)
    )
    twist = before[0] - after[0]  # at the inmost point, which sticks
    share = share_around(np.minimum(c / R, 1.0), 0.0).value
    # the step's own size; its root singularity at r = c, where no point lies
    np.testing.assert_allclose((before - after) / twist, share, atol=2e-3)


@pytest.mark.parametrize("thickness", [0.7, 2.0, 10.0])
def test_the_table_meets_the_solution(thickness):
    within = np.minimum(1.0 / R, 1.0)
    exact = turn_layer_disc(R, thickness).displacement / R
    np.testing.assert_allclose(share_around(within, 1.0 / thickness).value, exact, atol=2e-5)


def test_derivatives_of_the_share():
    r, c, h, step = np.array([0.5, 2.2, 3.0, 8.0]), 2.0, 3.0, 1e-4

    def share(distance=1.0, radius=1.0, thickness=1.0):
        within = np.minimum(c * radius / (r * distance), 1.0)
        return share_around(within, c * radius / (h * thickness)).value

    exact = share_around(np.minimum(c / r, 1.0), c / h)
    for name, slope in (
        ("distance", exact.by_distance),
        ("radius", exact.by_radius),
        ("thickness", exact.by_thickness),
    ):
        above, below = (share(**{name: np.exp(sign * step)}) for sign in (1, -1))
        # the table is linear between its rows
        np.testing.assert_allclose(slope, (above - below) / (2.0 * step), atol=2e-3)


def test_derivatives_of_the_residual():
    before, rng = markers()
    after = turn(before, 2.0, 3.0, 0.05) + 1e-2 * rng.normal(size=len(before))
    motion = _Motion(before, after, SCALE, np.array([0.1, 0.2]), Thickness(1.0, 0.5), 0.05)
    at, step = np.array([0.1, -0.2, 2.1, 0.06, 1.2]), 1e-6
    for row, move in zip(motion.jacobian(at), step * np.eye(5), strict=True):
        slope = (motion.residual(at + move) - motion.residual(at - move)) / (2.0 * step)
        # the table is linear between its rows
        np.testing.assert_allclose(row, slope, atol=0.03 * np.abs(slope).max())


@pytest.mark.parametrize("thickness", [2.0, 4.0, 50.0])
def test_the_radius_is_found_on_a_layer(thickness):
    before, rng = markers()
    after = turn(before, 2.3, thickness) + SCALE / np.sqrt(2.0) * rng.normal(
        size=(len(before), 2)
    ) @ [1, 1j]
    best, disc = fit(before, after)
    assert disc.misfit < SETTINGS.round_misfit
    third = np.sort(np.abs(before - complex(*best.parameters[:2])))[2]
    assert disc.margin + third == pytest.approx(2.3, abs=3.0 * disc.error)


def test_windows_together_show_the_thickness():
    before, rng = markers()
    known = Thickness(np.log(SETTINGS.thickness), SETTINGS.thickness_error)
    for radius in np.linspace(4.0, 2.0, 30):
        after = turn(before, radius, 3.0) + shake(before, rng)
        best, _ = fit(before, after, known, axis=np.zeros(2))
        known = learn_thickness(known, best, SETTINGS)
    assert known.error < 0.15
    assert known.log == pytest.approx(np.log(3.0), abs=2.0 * known.error)


def test_motion_towards_the_axis_does_not_matter():
    # where gel slips for the first time, the shear of pressing gives way
    before, _ = markers()
    distance = np.abs(before)
    after = turn(before, 2.3, 4.0)
    relaxed = after * (1.0 + 0.01 * np.maximum(distance - 2.3, 0.0) / distance)
    _, alone = fit(before, after)
    _, both = fit(before, relaxed)
    assert both.margin == pytest.approx(alone.margin, abs=0.03)
    assert both.misfit < SETTINGS.round_misfit
