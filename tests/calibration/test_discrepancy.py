"""The model's error in a field fit: its size from residuals, and intervals that hold."""

import jax.numpy as jnp
import numpy as np
import pytest

from calibration.discrepancy import (
    Whitening,
    estimate_size,
    make_modes,
    share_of,
    whiten_modes,
    widen,
)
from calibration.field_problem import find_kinds
from calibration.forward import FieldModel, Prediction, press_and_move
from contactmodel import Grid

FRAMES, MARKERS, NUMBERS = 1, 60, 3


@pytest.fixture(scope="module")
def linear():
    """A linear fit: derivatives by three numbers, and smooth modes."""
    rng = np.random.default_rng(3)
    count = 3 * FRAMES * MARKERS + 7
    modes = rng.normal(size=(count, 12)) * np.exp(-0.2 * np.arange(12))
    return rng.normal(size=(count, NUMBERS)), modes


def _draw(linear, size: float, rng: np.random.Generator):
    """Estimate of the size, error of the numbers over their standard error, by one draw."""
    jacobian, modes = linear
    data = rng.normal(size=len(jacobian)) + size * modes @ rng.normal(size=modes.shape[1])

    def residual(whitening: Whitening | None):
        parts = [jacobian, data[:, None]]
        rows, b = parts if whitening is None else [whitening.apply(part) for part in parts]
        fitted = np.linalg.lstsq(rows, b[:, 0])[0]
        return rows, b[:, 0] - rows @ fitted, fitted

    rows, left, fitted = residual(None)
    found = estimate_size(left, rows, modes, None)
    covariance = np.linalg.inv(rows.T @ rows)
    if found:
        whitening = whiten_modes(found * modes, FRAMES, MARKERS)
        rows, left, fitted = residual(whitening)
        covariance = np.linalg.inv(rows.T @ rows)
        covariance = widen(covariance, rows, found * modes, whitening)
    return found, fitted / np.sqrt(np.diag(covariance))


def test_intervals_hold_with_and_without_an_error_of_the_model(linear):
    rng = np.random.default_rng(5)
    for size, low, high in ((0.0, 0.92, 0.98), (2.0, 0.95, 1.0)):  # the size is doubled on purpose
        draws = [_draw(linear, size, rng) for _ in range(300)]
        held = np.mean([np.abs(ratio) < 1.96 for _, ratio in draws])
        assert low < held <= high  # 900 intervals: 0.95 ± 0.007
        found = np.array([found for found, _ in draws])
        if size == 0.0:
            assert np.mean(found > 0.0) == pytest.approx(0.05, abs=0.05)  # the test's level
        else:
            assert np.sqrt(np.mean(found**2)) == pytest.approx(2.0 * size, rel=0.1)


def test_whitening_gives_each_marker_unit_variance(linear):
    _, modes = linear
    whitening = whiten_modes(modes, FRAMES, MARKERS)
    turned = whitening.apply(np.concatenate([np.eye(len(modes)), modes], axis=1))
    covariance = turned @ turned.T
    for marker in range(MARKERS):
        place = slice(3 * marker, 3 * marker + 3)
        np.testing.assert_allclose(covariance[place, place], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.diag(covariance), 1.0, atol=1e-12)


def test_modes_are_round_and_of_their_amplitudes():
    at = np.linspace(-4.0, 4.0, 9)
    markers = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
    model = FieldModel(press_and_move("sphere"), Grid((18, 18), (11.0, 11.0)), markers, frames=2)
    moved = np.zeros((2, 81, 3))
    moved[..., 2] = -1.0
    force = np.array([[0.0, 0.0, -2.0]] * 2)
    one = jnp.ones(())
    seen = Prediction(moved, force, np.array([0.0, 30.0]), one, 2.0 * one, one, one > 2.0)
    modes = make_modes(model, seen, np.zeros(2))
    deviation = np.sqrt(np.sum(modes**2, axis=1))
    kinds = find_kinds(model)
    np.testing.assert_allclose(deviation[kinds["force"]], [0, 0, 0.02, 0, 0, 0.02], atol=1e-12)
    np.testing.assert_allclose(deviation[kinds["moment"]], [0.0, 0.3], atol=1e-12)
    field = deviation[: moved.size].reshape(2, 9, 9, 3)
    np.testing.assert_allclose(field, np.swapaxes(field, 1, 2)[..., [1, 0, 2]], atol=1e-12)
    # at the edge of the contact, 2 mm: 1 % and 0.5 % of the depth, radially and along z; the
    # eigenvalues left out and the knots cost 2 %
    np.testing.assert_allclose(field[0, 6, 4], [0.01, 0.002, 0.005], rtol=0.02)
    whole = np.ones(len(modes))
    assert share_of(modes, whole, moved) == pytest.approx(
        np.sqrt(np.sum(field**2) / np.sum(moved**2))
    )


NUMBERS_OF_A_PRESS = {
    "shear_modulus": 0.2,
    "poisson_ratio": 0.48,
    "thickness": 4.0,
    "friction_coefficient": 0.5,
    "radius": 12.0,
    "approach": 0.5,
    "twist": np.array([0.0, 0.2]),
}


def test_the_grid_follows_the_position_at_finite_strain():
    """Markers, forces and moment of an object beside the middle are those in the middle, moved."""
    scene, grid = press_and_move("sphere", finite_strain=True), Grid((28, 28), (8.0, 8.0))
    markers = np.random.default_rng(0).uniform(-3.0, 3.0, (30, 2))
    beside = np.array([0.4, -0.7])
    place = {"position": np.zeros(2)}
    middle = FieldModel(scene, grid, markers, 2).predict(NUMBERS_OF_A_PRESS | place)
    place = {"position": beside}
    moved = FieldModel(scene, grid, markers + beside, 2).predict(NUMBERS_OF_A_PRESS | place)
    np.testing.assert_allclose(moved.displacement, middle.displacement, atol=1e-9)
    lever = beside[0] * middle.force[:, 1] - beside[1] * middle.force[:, 0]
    np.testing.assert_allclose(moved.moment, middle.moment + lever, rtol=1e-9, atol=1e-9)
    assert bool(moved.covered)


@pytest.mark.parametrize("name", ["stiffness_ratio", "marker_depth", "dome_radius"])
def test_numbers_without_a_correction_are_refused(name):
    model = FieldModel(
        press_and_move("sphere", finite_strain=True), Grid((8, 8), (9.0, 9.0)), np.zeros((1, 2))
    )
    with pytest.raises(ValueError, match=f"does not cover the number {name}"):
        model.predict(NUMBERS_OF_A_PRESS | {name: 0.5})
    without = {key: value for key, value in NUMBERS_OF_A_PRESS.items() if key != "thickness"}
    with pytest.raises(ValueError, match="requires the number thickness"):
        model.predict(without)
