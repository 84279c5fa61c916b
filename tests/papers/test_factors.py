"""Corrected force and moment against finite elements that the fit leaves out."""

import numpy as np
import pytest

from papers.finite_strain import field_fits
from papers.finite_strain.factors import LIMIT, compare, measure_field, twist_errors
from papers.finite_strain.samples import read_samples
from papers.finite_strain.settings import SERIES

HELD = [sample for sample in read_samples() if sample.held_out]


def test_the_shipped_samples_are_those_of_the_settings():
    named = sorted((*s[:2], d, *s[3:7], s.held_out) for s in SERIES for d in s.depths_mm)
    assert sorted((*s[:7], s.held_out) for s in read_samples()) == named


@pytest.mark.parametrize(
    ("index", "before", "after"),
    [  # worst error of force or moment up to 20° [%], rounded up by 0.3
        pytest.param(1, 4.1, 1.1, id="6 mm gel, sphere of 15 mm, 0.13 h"),
        pytest.param(2, 9.3, 1.9, id="the same, 0.25 h"),
        pytest.param(6, 5.2, 1.3, id="punch with a rounded edge"),
        pytest.param(12, 22.3, 2.3, id="pad of 24 mm, 0.22 h"),
    ],
)
def test_samples_left_out_of_the_fit(index, before, after):
    """Targets: 2 % up to 0.13 h, 4 % up to 0.25 h, 3 % on a pad of 24 mm."""
    errors = compare(HELD[index])
    assert errors.covered
    worst = [100.0 * np.abs([e[0], [0.0, *e[1][1:]]]).max() for e in (errors.before, errors.after)]
    assert worst[0] == pytest.approx(before, abs=0.6)
    assert worst[1] < after


def test_the_twist_under_a_punch_left_out_of_the_fit():
    """Of the norm of u_θ, at 10 and 20°."""
    place = 17
    one = measure_field(field_fits.CASES[place], field_fits.read_fields()[place])
    errors = twist_errors(one, np.array(LIMIT)).reshape(2, -1)
    assert np.linalg.norm(errors, axis=1).max() < 0.018  # 1.4 % on 40² cells
    far = twist_errors(one, np.array([-2.0, LIMIT[1]])).reshape(2, -1)
    assert np.linalg.norm(far) > np.linalg.norm(errors)
