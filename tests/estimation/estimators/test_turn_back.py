"""The angle from all frames since the object turned back."""

import numpy as np
import pytest

from estimation.estimators.law.turn_back import Angle, Mean, TurnBack, correct_law, fit_disc

POINTS = np.random.default_rng(0).uniform(-5.0, 5.0, (2, 40))
ALL, HELD = np.full(40, True), np.arange(40) < 8
NOISE = 1e-2


def places_of(markers: np.ndarray) -> np.ndarray:
    """Places of some markers well inside a disc, and of all others outside."""
    return np.where(markers, 0.5, 2.0)


def see(turn: float, rng: np.random.Generator) -> np.ndarray:
    """Positions of the markers after a turn."""
    noise = NOISE * (rng.normal(size=40) + 1j * rng.normal(size=40))
    return (POINTS[0] + 1j * POINTS[1]) * np.exp(1j * turn) + noise


def turn_back(
    rng: np.random.Generator, sticking: list[np.ndarray], correlated: float
) -> tuple[list[float], list[Angle]]:
    """Errors and angles, by the law and by the disc, in the last frame after a turn of 0.3 rad.

    Args:
        rng: of the noise.
        sticking: markers that stick since the turn, in each frame.
        correlated: frames over which noise counts as correlated.
    """
    error, before = 5e-3, POINTS[0] + 1j * POINTS[1]
    since, angles, step = TurnBack(see(0.3, rng), correlated), (Angle(np.nan, np.inf),) * 2, 0.0
    for i, stick in enumerate(sticking):
        step = -0.004 * (i + 1)
        law = Angle(0.3 + step + error * rng.normal(), error)
        after, places = see(0.3 + step, rng), (places_of(HELD), places_of(stick))
        angles = since.update(before, after, *places, law, NOISE, known=0.0)
    return [angle.value - 0.3 - step for angle in angles], list(angles)


def error_of(stick: np.ndarray) -> float:
    """Standard error of the rotation of some markers."""
    points = POINTS[:, stick]
    return NOISE / np.sqrt(np.sum((points - points.mean(axis=1, keepdims=True)) ** 2))


@pytest.mark.parametrize("correlated", [1.0, 3.0])
def test_frames_since_the_turn_back_share_the_angle_of_the_turn(correlated):
    """Errors of single frames average out, and so does the noise of the turn itself."""
    rng, frames = np.random.default_rng(0), 60
    runs = [turn_back(rng, [ALL] * frames, correlated) for _ in range(60)]
    errors, angles = [run[0] for run in runs], runs[0][1]
    scatter = np.std(errors, axis=0)
    for angle, alone, spread in zip(angles, (5e-3, error_of(HELD)), scatter, strict=True):
        expected = np.hypot(alone * np.sqrt(correlated / frames), error_of(ALL))
        assert angle.error == pytest.approx(expected, rel=0.02)
        # independent errors scatter by less than is allowed for correlated ones
        independent = np.hypot(alone / np.sqrt(frames), error_of(ALL))
        assert spread == pytest.approx(independent, rel=0.1)


def test_places_of_markers_are_averaged_over_the_frames_since_the_turn_back():
    """Fewer markers stick at the end: the noise of their places at the turn hardly counts."""
    rng, few = np.random.default_rng(1), np.arange(40) < 6
    runs = [turn_back(rng, [ALL] * 30 + [few] * 2, 1.0) for _ in range(200)]
    spread = np.sqrt(np.mean(np.square([run[0][0] for run in runs])))
    last = runs[0][1][0]
    assert last.error == pytest.approx(spread, rel=0.12)
    of_turn = np.hypot(5e-3 / np.sqrt(32.0), error_of(ALL))
    assert last.error < 1.05 * np.hypot(of_turn, error_of(few))


@pytest.mark.parametrize("slip", [0.0, 0.05])
def test_outer_markers_count_as_long_as_they_turn_along(slip):
    """The interval holds either way, and is narrower where they do."""
    rng = np.random.default_rng(2)
    places = np.where(HELD, 0.5, np.linspace(0.76, 0.94, 40))
    before = POINTS[0] + 1j * POINTS[1]
    slipped = before * np.exp(-1j * slip * (places > 0.75))
    angles = []
    for _ in range(200):
        after = slipped + see(0.0, rng) - before
        markers, angle = fit_disc(before, after, np.full(40, NOISE), places)
        angles.append(angle)
        if slip:
            assert not markers[~HELD].any()
    errors, stated = np.array(angles).T
    assert np.mean(np.abs(errors) < 1.96 * stated) > 0.94
    widest = 1.1 if slip else 0.7
    assert np.median(stated) < widest * error_of(HELD)


@pytest.mark.parametrize("known", [0.2, 0.7])
def test_what_was_known_at_the_turn_back_is_not_averaged(known):
    rng = np.random.default_rng(4)
    own, common = np.sqrt(1.0 - known), np.sqrt(known)
    means = []
    for _ in range(400):
        mean, shared = Mean(3.0), common * rng.normal()
        angles = [mean.add(Angle(shared + own * rng.normal(), 1.0), known) for _ in range(60)]
        means.append(angles[-1])
    assert means[0].error == pytest.approx(np.sqrt(known + (1.0 - known) / 20.0))
    scatter = np.std([angle.value for angle in means])
    assert 0.8 * means[0].error < scatter < 1.05 * means[0].error


def test_markers_that_have_never_slipped_correct_the_law():
    """Angles whose errors are known scatter as stated, and less than those of the law alone."""
    rng = np.random.default_rng(1)
    fitted, discrepancy, error = 1e-3, 3e-3, 2e-3
    noise = fitted * rng.normal(size=4000)
    more = np.sqrt(error**2 - fitted**2) * rng.normal(size=4000)
    wrong = discrepancy * rng.normal(size=4000)
    angles = [
        correct_law(Angle(n + w, fitted), fitted, discrepancy, Angle(n + m, error))[0]
        for n, w, m in zip(noise, wrong, more, strict=True)
    ]
    spread = np.std([angle.value for angle in angles])
    assert angles[0].error == pytest.approx(spread, rel=0.05)
    assert spread < 0.6 * np.hypot(fitted, discrepancy)


def test_the_law_stays_as_it_is_without_markers_that_have_never_slipped():
    angle, share = correct_law(Angle(0.1, 3e-3), 3e-3, 4e-3, Angle(np.nan, np.inf))
    assert share == 1.0
    assert angle == (0.1, pytest.approx(5e-3))


def test_markers_that_have_never_slipped_give_the_angle_where_they_know_it_better():
    disc = Angle(0.2, 1e-3)
    assert correct_law(Angle(0.1, 2e-3), 1.5e-3, 4e-3, disc) == (disc, 0.0)
