"""A disc that turns on a bonded layer."""

import numpy as np
import pytest

from contactmodel.analytic import punch_displacement, turn_layer_disc

R = np.array([0.3, 1.0, 1.0 + 1e-9, 1.2, 2.0, 5.0])
ETA_3 = 0.9015426773696957  # Σ (−1)ⁿ⁺¹/n³


def test_a_thick_layer_is_a_half_space():
    disc = turn_layer_disc(R, 1e3)
    np.testing.assert_allclose(disc.displacement, punch_displacement(R, 1.0), atol=1e-9)


def test_the_moment_grows_with_the_cube_of_radius_over_thickness():
    # the first term of the kernel's series in kc; the next is of fifth order
    disc = turn_layer_disc(R, 10.0)
    first = ETA_3 / (3.0 * np.pi * 10.0**3)
    assert disc.moment - 1.0 == pytest.approx(first, rel=0.02)


def test_a_thin_layer_shears_under_the_disc_and_a_little_beyond():
    # simple shear up to the rim, moved outward by that of a strip, (2 ln 2/π) h
    h = 0.25
    rim = 1.0 + 2.0 * np.log(2.0) / np.pi * h
    shear = np.pi * rim**4 / (2.0 * h) / (16.0 / 3.0)
    assert turn_layer_disc(R, h).moment == pytest.approx(shear, rel=0.01)


@pytest.mark.parametrize("thickness", [0.25, 0.5, 2.0])
def test_gel_at_the_rim_turns_with_the_disc(thickness):
    # inside it does so by construction, outside by the solution alone
    displacement = turn_layer_disc(R, thickness).displacement
    assert displacement[2] == pytest.approx(1.0, abs=1e-4)
    assert np.all(np.diff(displacement[2:]) < 0.0)


def test_its_points_suffice():
    r = np.array([1.0, 1.02, 1.2, 2.0])
    few, many = (turn_layer_disc(r, 0.25, points).displacement for points in (64, 256))
    np.testing.assert_allclose(few, many, atol=1e-6)


@pytest.mark.parametrize("thickness", [0.0, -1.0, np.nan])
def test_a_layer_has_a_thickness(thickness):
    with pytest.raises(ValueError, match="thickness must be positive"):
        turn_layer_disc(R, thickness)
