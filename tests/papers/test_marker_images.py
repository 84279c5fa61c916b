import numpy as np
import pytest

from papers.marker_images import corners, pivots, settings


@pytest.fixture(scope="module")
def rows():
    shown = corners.tables(corners.compute(quick=True))[""]
    return {(row["noise"], row["method"]): row for row in shown}


def test_the_bounds_are_the_known_ones():
    for noise, position, angle in ((2.0, 0.0077, 0.053), (5.0, 0.0192, 0.1335)):
        square, own = corners.limits(noise)
        assert square == pytest.approx((position, np.radians(angle)), rel=0.01)  # printed digits
        assert own[0] > square[0]  # two more unknowns


@pytest.mark.parametrize("noise", settings.NOISES)
def test_the_saddle_fit_reaches_its_bound(rows, noise):
    row = rows[noise, "saddle fit"]
    # 400 corners: the scatter of 800 coordinates is known to 2.5 %, that of the angles to 3.5 %
    assert row["position [px]"] < 1.2 * row["square's bound [px]"]
    assert row["position [px]"] < 1.08 * row["own bound [px]"]
    assert row["angle [°]"] < 1.2 * row["square's bound [°]"]
    assert row["bias [px]"] < 4.0 * row["own bound [px]"] / np.sqrt(400)
    assert row["claimed [px]"] == pytest.approx(row["position [px]"], rel=0.1)
    assert row["claimed [°]"] == pytest.approx(row["angle [°]"], rel=0.1)
    assert row["found [%]"] > 98.0  # the turned pattern's last corners touch the picture's side


def test_the_rings_are_less_precise(rows):
    for noise in settings.NOISES:
        fit, rings = rows[noise, "saddle fit"], rows[noise, "two rings"]
        assert 3.0 * fit["angle [°]"] < rings["angle [°]"] < 8.0 * fit["angle [°]"]


@pytest.mark.slow
def test_rendered_pivots_are_read_from_one_view_and_from_two():
    rows = pivots.tables(pivots.compute(quick=True))[""]
    errors = [row["mean absolute error [°]"] for row in rows if row["method"] == "tracked"]
    assert len(errors) == 2
    # the study's target; 0.002° and 0.004° were found
    assert max(errors) < 0.03
