"""Every row of the verification table, on a grid of 64²; tolerances and reasons are the table's."""

import numpy as np
import pytest

from contactmodel import verify
from contactmodel.verify_layers import LAYER_CHECKS, check_thin_layer

# the gradients' rows have tests of their own, against the same differences
FAST = [check for check in verify.CHECKS if check is not verify.check_gradients]
FAST += [check_thin_layer]  # the other extensions have tests of their own, too


@pytest.mark.parametrize("check", FAST, ids=lambda check: check.__name__)
def test_rows_agree(check):
    failed = [row for row in check(64) if not row.passed]
    assert not failed


def test_wrong_numbers_do_not_pass():
    row = verify.Row("nothing", np.nan, 1.0, np.nan, 1.0, "")
    assert not row.passed
    assert not row._replace(error=1.1).passed


@pytest.mark.slow
def test_rows_agree_at_the_published_grid():
    rows = [
        row for check in (*verify.CHECKS, *LAYER_CHECKS) for row in check(128)
    ] + verify.convergence()
    assert not [row for row in rows if not row.passed]


def test_errors_converge():
    rows = verify.convergence((16, 32, 64))
    assert not [row for row in rows if not row.passed]
