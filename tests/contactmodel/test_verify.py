"""Every row of the verification table, on a grid of 64²; tolerances and reasons are the table's."""

import numpy as np
import pytest

from contactmodel.verify import friction, laws, layers
from contactmodel.verify.rows import Row
from contactmodel.verify.table import CHECKS, convergence

# these have tests of their own, the gradients against the same differences
OTHERS = {
    friction.check_power_law_gradients,
    laws.check_gradients,
    laws.check_coupling,
    laws.check_resultant,
    layers.check_thick_layer,
    layers.check_depth,
}
FAST = [check for check in CHECKS if check not in OTHERS]


@pytest.mark.parametrize("check", FAST, ids=lambda check: check.__name__)
def test_rows_agree(check):
    failed = [row for row in check(64) if not row.passed]
    assert not failed


def test_wrong_numbers_do_not_pass():
    row = Row("nothing", np.nan, 1.0, np.nan, 1.0, "")
    assert not row.passed
    assert not row._replace(error=1.1).passed


@pytest.mark.slow
def test_rows_agree_at_the_published_grid():
    rows = [row for check in CHECKS for row in check(128)] + convergence()
    assert not [row for row in rows if not row.passed]


def test_errors_converge():
    rows = convergence((16, 32, 64))
    assert not [row for row in rows if not row.passed]
