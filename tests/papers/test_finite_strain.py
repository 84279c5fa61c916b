"""The finite elements of the study against closed forms, and its shipped table."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from contactmodel.analytic import reissner_sagoci_moment
from papers.finite_strain.gel import Gel, cut, element_energy, law_of
from papers.finite_strain.press import Round, press
from papers.finite_strain.reference import read_reference
from papers.finite_strain.settings import CASES, KEPT
from papers.finite_strain.steps import Motion

pytest.importorskip("skfem")


@pytest.fixture(scope="module")
def block():
    gel = Gel(thickness=6.0, radius=5.0, second_share=0.3)
    return gel, cut(gel, 0.5, 5.0, 1.01)


def energy_of(block, moved):
    gel, elements = block
    parts = jnp.asarray(moved[elements.nodes]), elements.value, elements.slope, elements.volume
    each = jax.vmap(element_energy, (0, 0, 0, 0, None))(*parts, law_of(gel))
    return float(jnp.sum(each))


def test_a_turned_gel_has_no_energy_and_a_stretched_one_that_of_its_law(block):
    gel, elements = block
    r, z = elements.place.T
    turn = 0.8
    turned = np.stack([r * (np.cos(turn) - 1.0), r * np.sin(turn), 0.0 * z], axis=1)
    assert energy_of(block, turned) == pytest.approx(0.0, abs=1e-12)
    wide, tall = 1.1, 0.9
    stretched = np.stack([(wide - 1.0) * r, 0.0 * r, (tall - 1.0) * z], axis=1)
    jacobian = wide**2 * tall
    first = (2.0 * wide**2 + tall**2) / jacobian ** (2 / 3)
    second = (wide**4 + 2.0 * wide**2 * tall**2) / jacobian ** (4 / 3)
    modulus, bulk, share = map(float, law_of(gel))
    shape = (1.0 - share) * (first - 3.0) + share * (second - 3.0)
    density = 0.5 * (modulus * shape + bulk * (jacobian - 1.0) ** 2)
    volume = np.pi * gel.radius**2 * gel.thickness
    assert energy_of(block, stretched) == pytest.approx(density * volume, rel=1e-12)


def test_rivlin_torsion(block):
    """A twisted cylinder: W = G γ²/2 with γ = τ r, whatever the share of the second invariant."""
    gel, elements = block
    r, z = elements.place.T
    rate = 0.15
    angle = rate * z
    moved = np.stack([r * (np.cos(angle) - 1.0), r * np.sin(angle), 0.0 * z], axis=1)
    expected = 0.25 * np.pi * gel.shear_modulus * rate**2 * gel.radius**4 * gel.thickness
    # elements are chords of the turn: (τ Δz)²/12 = 5e-4, and swell by as much
    assert energy_of(block, moved) == pytest.approx(expected, rel=5e-3)


def test_a_shallow_contact_is_that_of_hertz_and_reissner():
    gel = Gel(thickness=60.0, radius=60.0, poisson_ratio=0.45)
    radius, approach, twist = 8.0, 0.05, 0.02
    elements = cut(gel, 0.06, 0.8, 1.6)
    path = [Motion(0.5 * approach, 0.0), Motion(approach, 0.0), Motion(approach, twist)]
    found = press(gel, elements, Round(0.0, radius), 50.0, path)
    modulus = 2.0 * gel.shear_modulus / (1.0 - gel.poisson_ratio)
    # 4 %: 10 elements along the radius, and friction in pressing, which Hertz has not
    force = 4.0 / 3.0 * modulus * np.sqrt(radius) * approach**1.5
    assert found.normal_force[1] == pytest.approx(force, rel=0.04)
    reach = np.sqrt(radius * approach)
    moment = reissner_sagoci_moment(twist, reach, gel.shear_modulus)
    assert found.moment[2] == pytest.approx(moment, rel=0.08)  # third power of the radius
    stuck = found.stick[2]
    assert np.count_nonzero(stuck) > 8
    r = found.radius[stuck]
    turned = found.moved[2][stuck] - found.moved[1][stuck]
    np.testing.assert_allclose(turned[:, 1], np.sin(twist) * r, atol=1e-4)


def test_the_shipped_table_has_all_cases():
    table = read_reference()
    assert set(table) == set(CASES)
    for case, one in table.items():
        assert one.angle_deg.shape == (len(KEPT),)
        assert np.all(one.force_n > 0.0)
        assert abs(one.moment_nmm[0]) < 1e-3
        most = case.friction * one.force_n * one.contact_mm
        assert np.all(np.abs(one.moment_nmm) < most)
        assert np.all(np.diff(one.moment_nmm[1:6]) > -1e-3 * one.moment_nmm[5])  # or all slides
