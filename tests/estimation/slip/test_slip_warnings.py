"""Slip warnings: their signals on motions whose value is known, and when they speak."""

import numpy as np
import pytest

from estimation.slip.warnings import (
    SLIP_WARNINGS,
    warn_by_entropy,
    warn_by_stick_ratio,
    warn_by_turning_ratio,
)
from estimation.virtual.recording import PivotModel, lay_out_markers
from tests.cases import recording_of

PAD = lay_out_markers(PivotModel())  # flat: what is pressed does not move along the surface


def pressed(*displacements):
    """A free pad, then the pad pressed by a round object, moved along by each displacement."""
    r = np.hypot(*PAD.reference[:, :2].T)
    depth = np.stack([0.0 * r, 0.0 * r, -0.8 * np.exp(-((r / 5.0) ** 2))], axis=-1)
    frames = [PAD.reference, *(PAD.reference + depth + d for d in displacements)]
    return recording_of(PAD, np.stack(frames))


def shear(amount):
    return amount * np.array([1.0, 0.0, 0.0])


def test_an_even_shear_has_no_entropy_and_all_of_it_sticks():
    recording = pressed(shear(0.5))
    # all in one bin, to rounding
    assert warn_by_entropy(recording).signal[1] == pytest.approx(0.0, abs=1e-9)
    assert warn_by_stick_ratio(recording).signal[1] == 1.0
    for warning in (warn_by_entropy, warn_by_stick_ratio):
        assert not warning(recording).warned.any()


def test_displacements_spread_evenly_over_the_bins_have_all_the_entropy():
    rank = np.argsort(np.argsort(np.random.default_rng(0).random(len(PAD.reference))))
    amount = (rank + 0.5) / len(rank)
    recording = pressed(shear(0.0), amount[:, None] * shear(1.0))
    # some 60 markers in ten bins: 9/(2·60) less than log 10 on average
    assert warn_by_entropy(recording).signal[2] == pytest.approx(1.0, abs=0.1)
    # and 20 % of them move with 80 % of the largest
    assert warn_by_stick_ratio(recording).signal[2] == pytest.approx(0.2, abs=0.12)
    assert warn_by_entropy(recording).warned.tolist() == [False, False, True]
    assert warn_by_stick_ratio(recording).warned.tolist() == [False, False, True]


def test_a_twist_without_slip_alarms_what_was_made_for_shear():
    x, y, z = PAD.reference.T
    twist = np.stack([-0.1 * y, 0.1 * x, 0.0 * z], axis=-1)
    recording = pressed(twist)
    # displacement grows with the radius: the outer 36 % of a disc have 80 % of it
    assert warn_by_stick_ratio(recording).signal[1] == pytest.approx(0.36, abs=0.12)
    assert warn_by_turning_ratio(recording).signal[1] > 0.9


@pytest.mark.parametrize("warning", SLIP_WARNINGS.values())
def test_without_contact_or_motion_there_is_no_signal(warning):
    signal = warning(pressed(shear(0.0))).signal
    assert np.isnan(signal).all()
