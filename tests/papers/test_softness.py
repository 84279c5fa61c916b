"""What the table of softness says of its first object."""

import pytest

from papers.softness import virtual


def test_a_fitted_k_mends_grasps_of_another_size():
    (case,) = virtual.compute(quick=True)
    assert case.low < case.k < case.high
    assert case.before[1] == pytest.approx(1.0 - 1.0 / 1.1, abs=0.005)  # what Eq. (14) misses
    assert case.after[1] < 0.01
    assert len(virtual.tables([case])[""]) == 1
