import numpy as np
import pytest

from contactmodel import analytic
from estimation.virtual.recording import PivotModel, Timing, simulate_frame, simulate_pivot

SILENT = PivotModel(noise=0.0, normal_noise=0.0)
EVERY_FRAME = {"timing": Timing(dropped=0.0, jitter=0.0)}


@pytest.fixture(scope="module")
def pivot():
    return simulate_pivot(SILENT, **EVERY_FRAME)


def test_markers_that_stick_go_where_the_object_takes_them(pivot):
    recording, truth = pivot
    full = truth.stick.sum(axis=1) > 0
    full[:25] = False  # after pressing
    pressed = recording.positions[24]  # the last frame before the twist
    for i in np.nonzero(full)[0][::7]:
        c, s = np.cos(truth.angle[i]), np.sin(truth.angle[i])
        turned = pressed[:, :2] @ np.array([[c, s], [-s, c]])
        stick = truth.stick[i]
        # quadrature of Jäger's sum inside the stick region: rounding only
        np.testing.assert_allclose(recording.positions[i, stick, :2], turned[stick], atol=1e-9)
        slipped = truth.contact[i] & ~truth.sticking_now[i]
        behind = np.linalg.norm(recording.positions[i, :, :2] - turned, axis=1)
        assert (behind[slipped] > 1e-9).all()
        # the slip in the truth is what they lag; pressed, they stand up to 1.2 % off their places
        lag = np.linalg.norm(truth.slip[i], axis=1)
        assert np.abs(lag[stick]).max() < 1e-9
        contact = truth.contact[i]
        np.testing.assert_allclose(lag[contact], behind[contact], rtol=0.012, atol=1e-9)


def test_moment_follows_lubkin_on_first_loading(pivot):
    recording, truth = pivot
    model = SILENT
    first = slice(25, 65)
    kappa = analytic.lubkin_stick_ratio(truth.angle[first], model.friction_ratio)
    np.testing.assert_allclose(truth.stick_radius[first], 5.0 * np.asarray(kappa), rtol=1e-9)
    force = 2 / 3 * np.pi * 25 * 2 * model.shear_modulus * model.friction_ratio
    expected = analytic.lubkin_moment(kappa, 1.0, force, 5.0)
    np.testing.assert_allclose(recording.moment[first, 2], np.asarray(expected), rtol=1e-9)


def test_the_reversal_leaves_a_core_that_carries_the_old_rotation(pivot):
    recording, truth = pivot
    half_way = np.argmin(np.abs(truth.angle[80:] - 0.0)) + 80
    # back at zero the moment has turned round, and what stuck all along reads the object's angle
    assert truth.moment[half_way] < 0 < truth.moment[79]
    inside = truth.stick[half_way]
    around = truth.sticking_now[half_way] & ~inside
    assert inside.sum() >= 3
    assert around.sum() >= 3
    r = np.hypot(*recording.layout.reference[:, :2].T)
    x, y = recording.positions[half_way, :, 0], recording.positions[half_way, :, 1]
    turned = np.arctan2(y, x) - np.arctan2(*recording.layout.reference[:, 1::-1].T)
    turned = np.angle(np.exp(1j * turned))
    np.testing.assert_allclose(turned[inside], truth.angle[half_way], atol=1e-9)
    # what slipped on the way up stays behind by what it had slipped
    assert (turned[around] < truth.angle[half_way] - 1e-9).all()
    assert r[around].min() > r[inside].max()


def test_macro_slip_is_where_the_moment_no_longer_rises(pivot):
    _, truth = pivot
    start = np.argmax(truth.macro_slip)
    assert truth.macro_slip[start:].all()
    assert np.degrees(truth.angle[start]) < -15
    limit = np.abs(truth.moment).max()
    assert np.abs(truth.moment[start]) > 0.99 * limit


def test_pressing_is_hertz(pivot):
    recording, truth = pivot
    depth = -recording.positions[24, :, 2]
    r = np.hypot(*recording.layout.reference[:, :2].T)
    inside = r < 5.0
    np.testing.assert_allclose(depth[inside], 1.2 * (1 - r[inside] ** 2 / 50.0), rtol=1e-9)
    assert truth.contact[24].tolist() == inside.tolist()
    assert not truth.contact[:10].any()
    assert np.isnan(truth.angle[:10]).all()
    np.testing.assert_array_equal(recording.positions[:10], recording.positions[:1].repeat(10, 0))


def test_a_soft_object_leaves_the_elastomer_its_share():
    model = SILENT._replace(stiffness_ratio=0.5)
    recording, truth = simulate_pivot(model, **EVERY_FRAME)
    i = 40
    stick = truth.stick[i]
    points = recording.layout.reference[stick, :2]
    turned = np.arctan2(*recording.positions[i, stick, 1::-1].T) - np.arctan2(*points[:, ::-1].T)
    np.testing.assert_allclose(np.angle(np.exp(1j * turned)), truth.angle[i] / 1.5, atol=1e-9)


def test_noise_drops_and_jitter_are_as_asked():
    recording, truth = simulate_pivot(seed=5, timing=Timing(dropped=0.1))
    silent, _ = simulate_pivot(SILENT, **EVERY_FRAME)
    error = recording.positions - silent.positions[recording.source_index]
    # 160 frames of 400 markers, about every third one new: spread known to 0.5 %
    assert error[..., :2].std() == pytest.approx(1e-3, rel=0.02)
    assert error[..., 2].std() == pytest.approx(3.5e-3, rel=0.02)
    after = np.diff(recording.source_index) == 1
    correlation = np.mean(error[1:][after] * error[:-1][after]) / np.mean(error**2)
    assert correlation == pytest.approx(2 / 3, abs=0.02)
    assert 5 <= 200 - len(recording) <= 40
    assert (np.diff(recording.source_index) > 1).any()
    assert (np.diff(recording.time) > 0).all()
    assert np.diff(recording.time).std() > 1e-3
    assert len(truth.angle) == len(recording)


def test_seeds():
    first, _ = simulate_pivot(seed=7)
    again, _ = simulate_pivot(seed=7)
    other, _ = simulate_pivot(seed=8)
    np.testing.assert_array_equal(first.positions, again.positions)
    np.testing.assert_array_equal(first.time, again.time)
    assert len(other) != len(first) or (other.positions != first.positions).any()


def test_single_frames_are_those_of_the_path(pivot):
    recording, truth = pivot
    layout, frame, stick = simulate_frame(SILENT, truth.angle[60], np.random.default_rng(0))
    np.testing.assert_array_equal(layout.reference, recording.layout.reference)
    np.testing.assert_allclose(frame.positions, recording.positions[60], atol=1e-12)
    np.testing.assert_array_equal(stick, truth.stick[60])
    assert frame.moment == pytest.approx(truth.moment[60])


@pytest.mark.parametrize("ratio", [1e-4, 1e-2])
def test_an_object_that_hardly_rubs_slips_at_once_and_turns_on(ratio):
    model = SILENT._replace(friction_ratio=ratio, offset=(0.5, 0.5))  # a marker on the axis
    recording, truth = simulate_pivot(model, **EVERY_FRAME)
    assert np.isfinite(recording.positions).all()
    force = 2 / 3 * np.pi * 25 * 2 * model.shear_modulus * ratio
    # Lubkin's limit, at −30° reached to rounding
    assert truth.moment[-1] == pytest.approx(-3 * np.pi / 16 * force * 5.0, rel=1e-9)
    assert truth.macro_slip[-20:].all()


def test_a_leg_without_frames_is_refused():
    with pytest.raises(ValueError, match="every leg must have at least 1"):
        simulate_pivot(frames=(-1, 5, 5))
