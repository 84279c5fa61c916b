"""A contact that is followed by the law of friction."""

import numpy as np
import pytest

from estimation.estimators.law.contact import ContactLaw
from estimation.estimators.law.reader import measure_disc
from estimation.estimators.law.state import At, Reading
from estimation.fields.plane import in_contact_plane
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording
from estimation.tracking.observation import Observer
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Timing, Truth, simulate_pivot

MICRON = 1e-3
LEGS = {"angles_deg": (0.0, 12.0, 2.0), "frames": (24, 16), "pressing": 6, "noise_window": 1}


@pytest.fixture(scope="module")
def pivot() -> tuple[Recording, Truth]:
    """A turn in which all but a few markers slip, and a part of the way back."""
    model = PivotModel(friction_ratio=0.12, offset=(0.2, -0.3), grid_angle=0.4)
    return simulate_pivot(model, seed=3, **LEGS)


def follow(
    recording: Recording, noise: float = MICRON, spoil: float = 0.0, pole: complex = 0.0
) -> tuple[ContactLaw, list[Reading | None]]:
    """Readings of all frames.

    `spoil` shears the gel on one side of the contact [-]; the object turns about the pole [mm].
    """
    observer = Observer(recording.layout)
    law, readings = ContactLaw(noise), []
    for frame in recording:
        fields = observer.observe(frame).fields
        if fields is None or not fields.contact.any():
            readings.append(None)
            continue
        before, after = in_contact_plane(observer.stencils, fields, fields.contact)
        after = after + spoil * np.maximum(np.real(before), 0.0)
        angle = float(np.nanmedian(fields.rotation[fields.contact & (np.abs(before) < 1.0)]))
        after = after + (1.0 - np.exp(1j * angle)) * pole
        observed = law.observe(fields.edge)
        readings.append(law.update(before, after, angle) if observed else None)
    return law, readings


def test_the_angle_is_known_while_few_markers_stick(pivot):
    recording, truth = pivot
    _, readings = follow(recording)
    known = np.array([reading is not None for reading in readings])
    held = truth.stick.sum(axis=1)
    few = known & (held >= 3) & (held < 10)
    assert few.sum() > 10
    error = np.array([r.angle - t for r, t in zip(readings, truth.angle, strict=True) if r])
    spread = np.array([r.error for r in readings if r])
    assert np.degrees(np.abs(error)).max() < 0.15
    assert np.abs(error / spread).max() < 4.0
    sticking = np.array([r.stick.sum() for r in readings if r])
    assert np.abs(sticking - truth.sticking_now.sum(axis=1)[known]).max() <= 3


def test_markers_that_stick_again_narrow_the_angle_after_the_turn_back():
    noise = 1e-2
    model = PivotModel(friction_ratio=0.12, noise=noise, normal_noise=3.5 * noise)
    recording, truth = simulate_pivot(model, seed=6, **LEGS)
    _, readings = follow(recording, noise)
    top = int(np.nanargmax(truth.angle))
    there, last = readings[top], readings[-1]
    assert there is not None
    assert last is not None
    assert last.error < 0.7 * there.error
    for reading, angle in zip(readings[top + 4 :], truth.angle[top + 4 :], strict=True):
        assert reading is not None
        assert abs(reading.angle - angle) < 3.0 * reading.error


def test_markers_that_never_slipped_narrow_the_laws_allowance_after_the_turn_back():
    model = PivotModel(friction_ratio=0.16, offset=(0.2, -0.3), grid_angle=0.4)
    recording, truth = simulate_pivot(model, seed=3, **LEGS)
    top = int(np.nanargmax(truth.angle))
    law, readings = follow(recording)
    fit, last = law.fit, readings[-1]
    assert fit is not None
    assert last is not None
    allowance = law.settings.discrepancy * fit.furthest * (1.0 / fit.held_ratio - 1.0)
    alone = np.hypot(allowance, fit.error / np.sqrt(5.0))  # of some 15 frames
    assert last.error < 0.9 * alone
    for reading, angle in zip(readings[top + 4 :], truth.angle[top + 4 :], strict=True):
        assert reading is not None
        assert abs(reading.angle - angle) < 2.0 * reading.error


def test_noise_that_is_not_correlated_narrows_the_angle_after_the_turn_back():
    model = PivotModel(friction_ratio=0.12)
    recording, truth = simulate_pivot(model, seed=6, **LEGS)
    white, smoothed = (
        estimate_angles(recording, noise=Noise(MICRON, 3.5 * MICRON, correlation, 60))
        for correlation in ((0.0, 0.0), (2 / 3, 1 / 3))
    )
    top = int(np.nanargmax(truth.angle))
    widths = [(one.high - one.low)[top + 4 :] for one in (white, smoothed)]
    assert np.median(widths[0]) < 0.9 * np.median(widths[1])
    np.testing.assert_allclose((white.high - white.low)[:top], (smoothed.high - smoothed.low)[:top])
    inside = (white.low <= truth.angle) & (truth.angle <= white.high)
    assert inside[top + 4 :].all()


def test_gel_that_the_law_does_not_explain_is_not_read(pivot):
    recording, _ = pivot
    _, readings = follow(recording, spoil=0.05)
    assert not any(readings)


def test_the_angle_is_lost_when_fewer_than_three_markers_stick():
    model = PivotModel(friction_ratio=0.06)
    recording, truth = simulate_pivot(
        model, angles_deg=(0.0, 14.0), frames=(24,), pressing=6, noise_window=1, seed=1
    )
    _, readings = follow(recording)
    none_sticks = truth.sticking_now.sum(axis=1) == 0
    assert any(readings)
    assert not any(r for r, none in zip(readings, none_sticks, strict=True) if none)
    assert readings[-1] is None


def test_from_the_second_turn_on_the_law_is_not_asked():
    model = PivotModel(friction_ratio=0.2)
    legs = {"angles_deg": (0.0, 8.0, 4.0, 8.0), "frames": (12, 8, 8), "pressing": 6}
    recording, truth = simulate_pivot(model, noise_window=1, seed=4, **legs)
    law, readings = follow(recording)
    assert law.turned
    assert any(readings[: int(np.nanargmax(truth.angle))])
    assert not any(readings[-5:])


def test_tracked_is_closer_with_the_law_than_by_few_markers_alone(pivot, monkeypatch):
    recording, truth = pivot
    noise = Noise.from_std(MICRON)
    held = truth.stick.sum(axis=1)
    few = (held >= 3) & (held < 9) & (np.arange(len(held)) <= np.nanargmax(truth.angle))
    with_law = estimate_angles(recording, noise=noise)
    monkeypatch.setattr(ContactLaw, "update", lambda *_, **__: None)
    without = estimate_angles(recording, noise=noise)
    mean = [np.nanmean(np.abs(r.angle - truth.angle)[few]) for r in (with_law, without)]
    width = [np.nanmedian((r.high - r.low)[few]) for r in (with_law, without)]
    assert mean[0] < mean[1]
    assert width[0] < 0.7 * width[1]
    inside = (with_law.low <= truth.angle) & (truth.angle <= with_law.high)
    assert inside[few].mean() > 0.9


def test_a_law_that_was_rejected_is_asked_again_at_the_next_contact(pivot):
    recording, _ = pivot
    law, readings = follow(recording)
    assert any(readings)
    law.restart()
    assert not law.turned
    assert not law.closed


@pytest.mark.parametrize("seed", [2, 5])
def test_no_slide_under_noise_is_taken_for_stick(seed):
    """With 10 µm of noise, most of a contact that slides seems to move as one body."""
    model = PivotModel(friction_ratio=0.02, noise=1e-2, normal_noise=3.5e-2)
    recording, truth = simulate_pivot(
        model, angles_deg=(0.0, 12.0), frames=(24,), pressing=6, noise_window=1, seed=seed
    )
    result = estimate_angles(recording, noise=Noise.from_std(1e-2))
    outside = np.maximum(result.low - truth.angle, truth.angle - result.high)
    assert np.nanmax(np.degrees(outside)) < 0.5
    slid = truth.macro_slip & (truth.angle > np.radians(4.0))
    assert slid.sum() > 10
    # an answer whose interval holds is none that misleads, but the slide is noticed by then
    assert np.isfinite(result.angle[slid]).mean() < 0.1


@pytest.mark.parametrize(
    ("friction_ratio", "offset", "grid_angle", "there_deg", "seed"),
    [
        # noise makes the angle fall behind, as if the object had turned back
        (0.0213, (-0.0760, -0.3076), 0.1415, 4.71, 102206),
        # noise hides all sticking markers as the object touches
        (0.0258, (0.4937, -0.2872), 0.8372, 26.24, 102234),
    ],
)
def test_no_angle_is_far_outside_its_interval_at_low_friction(
    friction_ratio, offset, grid_angle, there_deg, seed
):
    model = PivotModel(
        friction_ratio=friction_ratio,
        noise=1e-2,
        normal_noise=3.5e-2,
        offset=offset,
        grid_angle=grid_angle,
    )
    recording, truth = simulate_pivot(model, angles_deg=(0.0, there_deg), frames=(30,), seed=seed)
    result = estimate_angles(recording)
    outside = np.maximum(result.low - truth.angle, truth.angle - result.high)
    assert np.nanmax(np.degrees(outside)) < 0.5


@pytest.mark.parametrize("seed", [1, 5])
def test_gel_at_rest_narrows_no_interval(seed):
    """Gel at rest lies under an object at rest, and under one that slides on."""
    model = PivotModel(friction_ratio=0.03, noise=1e-2, normal_noise=3.5e-2)
    recording, truth = simulate_pivot(
        model,
        angles_deg=(0.0, 2.4, 2.4),
        frames=(24, 30),
        pressing=6,
        noise_window=1,
        timing=Timing(dropped=0.0),
        seed=seed,
    )
    law, readings = follow(recording, noise=1e-2)
    rest = truth.angle == np.nanmax(truth.angle)
    errors = [r.error for r, still in zip(readings, rest, strict=True) if r and still]
    assert not law.turned
    assert len(errors) > 20
    assert min(errors) > 0.6 * errors[0]  # averaged, it falls to half of a single frame's


def test_a_firm_contact_is_not_lost_under_noise():
    """Where nothing slips, the first turns under noise do not look like a slide."""
    model = PivotModel(friction_ratio=1.0, noise=1e-2, normal_noise=3.5e-2)
    recording, truth = simulate_pivot(
        model, angles_deg=(0.0, 6.0), frames=(24,), pressing=6, noise_window=1, seed=6
    )
    result = estimate_angles(recording, noise=Noise.from_std(1e-2))
    turned = truth.angle > np.radians(0.5)
    error = np.degrees(result.angle - truth.angle)[turned]
    assert np.isfinite(error).all()
    assert np.abs(error).max() < 0.15


def test_a_disc_that_three_errors_would_close_is_not_firm():
    model = PivotModel(friction_ratio=0.06, noise=1e-2, normal_noise=3.5e-2)
    path = {"angles_deg": (0.0, 14.0), "frames": (56,), "pressing": 6, "noise_window": 1}
    recording, truth = simulate_pivot(model, seed=1, **path)
    _, readings = follow(recording, noise=1e-2)
    held = truth.stick.sum(axis=1)
    many = [r.firm for r, n in zip(readings, held, strict=True) if r and n > 8]
    last = [r.firm for r, n in zip(readings, held, strict=True) if r and n <= 3]
    assert len(many) > 5
    assert all(many)
    assert len(last) > 0
    assert not any(last)


def test_a_turn_about_a_point_outside_the_discs_inner_half_counts_as_sheared(pivot):
    recording, truth = pivot
    top = int(np.nanargmax(truth.angle))
    _, readings = follow(recording)
    there = readings[top]
    assert there is not None
    assert not there.sheared
    radius = float(np.sqrt(there.stick.sum() / np.pi))  # about, as markers are 1 mm apart
    for pole, beside in ((0.25j * radius, False), (0.8 * radius, True)):
        reading = follow(recording, pole=pole)[1][top]
        assert reading is not None
        assert reading.sheared == beside


def test_a_turn_back_at_coarse_noise_does_not_count_as_a_possible_slide():
    """Three markers hold at the turn: the law knows their disc well, but not their angle.

    Before the gel turns along, it seems to stop, as it does under an object that slides.
    """
    model = PivotModel(friction_ratio=0.17, noise=1e-2, normal_noise=3.5e-2)
    path = {"angles_deg": (0.0, 20.0, 5.0), "frames": (20, 15), "noise_window": 1}
    recording, truth = simulate_pivot(model, seed=2, **path)
    turn = int(np.nanargmax(truth.angle))
    assert 3 <= truth.stick[turn].sum() < 9
    result = estimate_angles(recording, noise=Noise.from_std(1e-2))
    back = slice(turn + 3, len(recording))
    assert np.degrees(np.median((result.high - result.low)[back])) < 2.0
    covers = (result.low <= truth.angle) & (truth.angle <= result.high)
    assert covers[back].mean() >= 0.9


def test_the_angle_is_lost_within_two_frames_of_the_loss_of_stick():
    """Just before it, the slide counts as near: the disc may have closed unseen."""
    path = {"angles_deg": (0.0, 14.0), "frames": (28,), "pressing": 6, "noise_window": 1}
    recording, truth = simulate_pivot(PivotModel(friction_ratio=0.1), seed=1, **path)
    _, readings = follow(recording)
    held = truth.stick.sum(axis=1)
    many = [r.near for r, n in zip(readings, held, strict=True) if r and n > 8]
    assert len(many) > 5
    assert not any(many)
    loss = int(np.flatnonzero((held < 3) & np.isfinite(truth.angle))[0])
    before = [r for r in readings[loss - 2 : loss] if r]
    assert before
    assert before[-1].near
    assert not any(readings[loss + 2 :])


def test_a_slow_turn_back_is_noticed():
    # 0.03° per frame: in no frame does the object come back by more than the noise
    back = 60
    recording, truth = simulate_pivot(
        angles_deg=(0.0, 11.0, 9.2),
        frames=(25, back),
        pressing=6,
        seed=1,
        timing=Timing(dropped=0.0),
    )
    result = estimate_angles(recording)
    assert np.isfinite(result.angle[-back:]).all()
    np.testing.assert_allclose(result.angle[-1], truth.angle[-1], atol=np.radians(0.05))
    assert result.stick_markers[-1] > 60


@pytest.mark.parametrize("back", [False, True])
def test_the_error_of_the_disc_counts_that_of_the_largest_angle(pivot, back):
    recording, _ = pivot
    law, _ = follow(recording.take(slice(None, None if back else 30)))
    fit = law.fit
    assert fit is not None
    largest, rest = (1 + At.turn, 0) if back else (0, 1 + At.turn)
    angle = fit.parameters[At.turn] if back else fit.angle
    certain, error = np.zeros_like(fit.covariance), np.radians(0.1)

    def widened(row: int) -> float:
        covariance = certain.copy()
        covariance[row, row] = error**2
        return measure_disc(fit._replace(covariance=covariance)).error

    least = measure_disc(fit._replace(covariance=certain)).error
    assert widened(rest) == least
    contact = fit.parameters.copy()
    contact[At.scale] -= np.log1p(error / abs(angle))  # as if the object had turned further
    smaller = measure_disc(fit).ratio - measure_disc(fit._replace(parameters=contact)).ratio
    doubt = np.sqrt(widened(largest) ** 2 - least**2) / (smaller * np.sqrt(max(fit.misfit, 1.0)))
    assert 1.2 < doubt < 1.6
