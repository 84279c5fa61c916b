"""Numbers of a contact from its fields: recovered where the data tell them, flagged where not."""

import json
from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from scipy.stats import chi2

from calibration.field_fit import _minimise, fit_fields
from calibration.field_problem import Problem
from calibration.field_report import find_pad, format_numbers, write_fit
from calibration.field_result import FieldData
from calibration.forward import FieldModel, Unknown, press_and_move
from contactmodel import Grid, Pad

NOISE = np.array([1e-3, 1e-3, 3e-3])
TRUTH = {
    "shear_modulus": 0.2,
    "poisson_ratio": 0.45,
    "thickness": 4.0,
    "friction_coefficient": 0.6,
    "radius": 15.0,
    "approach": 0.5,
    "twist": np.array([0.0, 0.15]),
}
SOUGHT = {
    "shear_modulus": Unknown(0.3, 0.02, 2.0),
    "thickness": Unknown(6.0, 1.5, 20.0),
    "friction_coefficient": Unknown(0.4, 0.05, 3.0),
    "radius": Unknown(20.0, 5.0, 60.0),
    "approach": Unknown(0.4, 0.05, 2.0),
}


@pytest.fixture(scope="module")
def model():
    """A ball pressed on and twisted, seen by 100 markers in both states."""
    at = np.linspace(-4.0, 4.0, 10)
    markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
    return FieldModel(press_and_move("sphere"), Grid((18, 18), (11.0, 11.0)), markers, frames=2)


@pytest.fixture(scope="module")
def data(model):
    """Fields with 1 µm of noise in the plane, and forces."""
    seen = model.predict(TRUTH)
    rng = np.random.default_rng(4)
    return FieldData(
        np.asarray(seen.displacement) + NOISE * rng.normal(size=seen.displacement.shape),
        tuple(NOISE),
        np.asarray(seen.force) + 0.01 * rng.normal(size=(2, 3)),
        0.01,
        np.asarray(seen.moment) + 0.05 * rng.normal(size=2),
        0.05,
    )


@pytest.fixture(scope="module")
def fit(model, data):
    return fit_fields(model, TRUTH | SOUGHT, data)


@pytest.fixture(scope="module")
def blind(model, data):
    """The fit of the displacements alone."""
    unknown = data._replace(force=np.full((2, 3), np.nan), moment=np.full(2, np.nan))
    return fit_fields(model, TRUTH | SOUGHT, unknown)


def test_five_numbers_are_found_to_one_percent(fit):
    truth = np.array([TRUTH[name] for name in fit.names])
    assert fit.determined.all()
    assert fit.converged
    np.testing.assert_allclose(fit.values, truth, rtol=1e-2)  # what was asked for
    assert ((fit.low < truth) & (truth < fit.high)).sum() >= 4  # 95 % each: 97.7 % of the time
    assert fit.trusted
    assert fit.verdict[0].startswith("The model describes")
    # 600 values of known noise: χ² by the degrees of freedom is 1 ± 0.058
    assert abs(fit.misfit - 1.0) < 4 * 0.058


def test_without_forces_the_modulus_is_flagged_and_the_rest_is_not(blind):
    assert dict(zip(blind.names, blind.determined, strict=True)) == {
        name: name != "shear_modulus" for name in SOUGHT
    }
    assert np.isnan(blind.values[0])
    assert "shear_modulus" in blind.verdict[0]
    np.testing.assert_allclose(blind.values[1:], [4.0, 0.6, 15.0, 0.5], rtol=1e-2)


@pytest.fixture(scope="module")
def wrong(model, data):
    """Data that the model does not describe, and their fit."""
    moved = data.displacement + 0.01 * np.sin(3.0 * np.arange(600)).reshape(2, 100, 3)
    measured = data._replace(displacement=moved)
    return measured, fit_fields(model, TRUTH | SOUGHT, measured)


def test_a_wrong_model_is_not_trusted(wrong):
    _, fit = wrong
    assert not fit.trusted
    assert "does not describe" in fit.verdict[0]
    assert "No intervals are given" in fit.verdict[1]
    assert np.isfinite(fit.values).all()
    assert np.isnan(fit.low).all()
    assert np.isnan(fit.high).all()


def test_what_is_written_of_a_wrong_model(model, wrong, tmp_path):
    data, fit = wrong
    write_fit(fit, data, model.markers, (3, 4), tmp_path)
    summary = json.loads((tmp_path / "field.json").read_text())
    assert not summary["model_describes_data"]
    assert all(row["low"] is None and row["high"] is None for row in summary["numbers"])
    assert "No intervals are given" in (tmp_path / "report.html").read_text()
    assert format_numbers(fit)[0].endswith("undetermined without forces)")


def test_angles_are_printed_in_degrees(model, wrong, tmp_path):
    data, fit = wrong
    turned = replace(fit, names=("twist", *fit.names[1:]), determined=np.ones(len(fit.names), bool))
    turned = replace(turned, values=np.concatenate([[np.radians(8.0)], fit.values[1:]]))
    write_fit(turned, data, model.markers, (3, 4), tmp_path)
    assert format_numbers(turned)[0].startswith("twist = 8° (")
    assert "<td>8</td>" in (tmp_path / "report.html").read_text()
    row = json.loads((tmp_path / "field.json").read_text())["numbers"][0]
    assert (row["unit"], row["value"]) == ("rad", pytest.approx(np.radians(8.0), rel=1e-5))


def test_the_pad_takes_over_what_a_fit_found_of_it(wrong):
    _, fit = wrong
    known = Pad(size=(20.0, 20.0))
    assert find_pad(fit, known) is None  # the model does not describe the data
    found = find_pad(replace(fit, p_value=0.5), known)
    place = fit.names.index("shear_modulus")
    assert found.shear_modulus == fit.values[place]
    assert found.poisson_ratio == TRUTH["poisson_ratio"]  # what it was fitted with
    assert found.size == known.size
    assert found.radius is None  # the fitted radius is the object's


def test_a_smooth_error_of_the_model_widens_the_intervals(model, data, fit):
    """u_r is off by up to 10 µm at the edge of the contact; without an error nothing changes."""
    same = fit_fields(model, TRUTH | SOUGHT, data, discrepancy=True)
    assert same.discrepancy == 0.0
    np.testing.assert_array_equal(same.low, fit.low)
    distance = np.linalg.norm(model.markers, axis=1)[:, None]
    off = 0.01 * model.markers / distance * np.exp(-((distance - 2.5) ** 2))
    moved = data.displacement + np.pad(off, [(0, 0), (0, 1)])
    plain, wide = (
        fit_fields(model, TRUTH | SOUGHT, data._replace(displacement=moved), discrepancy=allow)
        for allow in (False, True)
    )
    assert not plain.trusted
    assert wide.trusted
    truth = np.array([TRUTH[name] for name in wide.names])
    assert ((wide.low < truth) & (truth < wide.high)).all()
    assert 0.0 < wide.discrepancy < 0.1
    assert "an error of the model of" in wide.verdict[0]


def test_two_wrong_moments_are_enough_to_reject_the_model(model, data):
    """Four times their error hides among 600 displacements, but not among two moments."""
    moment = data.moment + np.array([0.25, -0.25])
    fit = fit_fields(model, TRUTH | SOUGHT, data._replace(moment=moment))
    assert fit.misfits["moment"] > 10.0
    assert chi2.sf(603 * fit.misfit, 603) > 1e-3  # by all data it would pass
    assert not fit.trusted


def test_what_is_left_out_tells_what_a_number_depends_on(fit, blind):
    """To first order the estimates without forces, or without a third of the markers."""
    assert fit.depends_on(0) == ["forces"]  # only they tell the modulus
    assert (fit.span[0] <= fit.values).all()
    assert (fit.values <= fit.span[1]).all()
    assert set(fit.left_out) > {
        "displacements along z",
        "inner third of the markers",
        "frame 1 of 2",
    }
    # the second order of shifts of 0.1 %, and where the fit stops: 0.1 standard errors of 0.2 %
    np.testing.assert_allclose(fit.left_out["forces"][1:], blind.values[1:], rtol=5e-4)


def test_what_does_not_fit_is_refused(model, data):
    with pytest.raises(ValueError, match="nothing is unknown"):
        fit_fields(model, TRUTH, data)
    with pytest.raises(ValueError, match="shape"):
        fit_fields(model, TRUTH | SOUGHT, data._replace(displacement=data.displacement[:1]))
    with pytest.raises(ValueError, match="larger grid"):
        FieldModel(press_and_move("sphere"), Grid((18, 18), (5.0, 5.0)), np.array([[3.0, 0.0]]))
    with pytest.raises(ValueError, match="unknown shape"):
        press_and_move("banana")
    with pytest.raises(ValueError, match="between the bounds"):
        Unknown(3.0, 1.0, 2.0)
    with pytest.raises(ValueError, match=r"Poisson's ratio must lie from 0 to 0.5, got 0.6"):
        fit_fields(model, TRUTH | SOUGHT | {"poisson_ratio": 0.6}, data)


def test_a_fit_leaves_numbers_that_are_not_valid(model, data):
    """From a layer thinner than a cell nothing is solved; the second start is valid."""
    thin = SOUGHT | {"thickness": Unknown(0.3, 0.1, 20.0)}
    fit = fit_fields(model, TRUTH | thin, data, starts=2, seed=1)
    assert fit.converged
    assert fit.agreeing == 0.5
    np.testing.assert_allclose(fit.values, [TRUTH[name] for name in fit.names], rtol=1e-2)


def test_the_program_of_a_fit_calls_nothing_on_the_host(model, data):
    """JAX's compilation cache keeps only programs without callbacks."""
    problem = Problem.make(model, TRUTH | SOUGHT, data)
    program = str(eqx.filter_make_jaxpr(_minimise)(problem, problem.start, 60)[0])
    assert "while" in program
    assert "callback" not in program


def test_friction_is_flagged_where_no_ring_of_cells_slips(model, data):
    """μ = 2 and a twist of 0.5°: what slips is narrower than a cell, and what it tells is wrong."""
    held = TRUTH | {"friction_coefficient": 2.0, "twist": np.radians([0.0, 0.5])}
    seen = model.predict(held)
    measured = data._replace(displacement=seen.displacement, force=seen.force, moment=seen.moment)
    fit = fit_fields(model, held | SOUGHT, measured)
    flags = dict(zip(fit.names, fit.determined, strict=True))
    assert flags == {name: name != "friction_coefficient" for name in SOUGHT}
