"""Two contacts apart from each other: one is followed, and its angle is that of its object."""

from dataclasses import replace

import numpy as np
import pytest

from estimation import PivotModel, estimate_angles
from estimation.estimators.result import State
from estimation.fields.separate import separate
from estimation.fields.stencils import make_stencils
from estimation.frames.recording import Recording
from estimation.virtual.recording import deform, lay_out_markers, see_all

MODEL = PivotModel(contact_radius=3.0, approach=0.8, friction_ratio=0.3, grid_shape=(14, 24))
UNLOADED, PRESSED, TURNED = 5, 8, 25
FRAMES = UNLOADED + PRESSED + TURNED


def one_load() -> np.ndarray:
    """The load while an object is pressed on and stays, as a share of the full one."""
    return np.r_[np.zeros(UNLOADED), np.arange(1, PRESSED + 1) / PRESSED, np.ones(TURNED)]


def one_turn(end_deg: float) -> np.ndarray:
    """The twist of an object that is pressed on and then turned [rad]."""
    turned = np.linspace(0.0, np.radians(end_deg), TURNED)
    return np.r_[np.full(UNLOADED, np.nan), np.zeros(PRESSED), turned]


def press_two(
    turns: tuple[np.ndarray, np.ndarray],
    loads: tuple[np.ndarray, np.ndarray] | None = None,
    depths: tuple[float, float] = (1.0, 0.8),
    apart: float = 10.0,
) -> Recording:
    """Two spheres on one pad, whose displacements add up; depths are shares of the model's."""
    layout = lay_out_markers(MODEL._replace(offset=(0.0, 0.0)))
    positions = np.repeat(layout.reference[None], FRAMES, axis=0)
    for side, twist, load, depth in zip(
        (-0.5, 0.5), turns, loads or (one_load(), one_load()), depths, strict=True
    ):
        sphere = MODEL._replace(
            contact_radius=MODEL.contact_radius * np.sqrt(depth), approach=MODEL.approach * depth
        )
        around = replace(layout, reference=layout.reference - [side * apart, 0.0, 0.0])
        positions += deform(sphere, around, load, twist)[0] - around.reference
    noise = np.random.default_rng(3).normal(size=positions.shape) * [1e-3, 1e-3, 3.5e-3]
    return see_all(layout, positions + noise)


@pytest.mark.parametrize("apart", [10.0, 7.5])
def test_deeper_object_is_followed_beside_one_at_rest(apart: float) -> None:
    """An object that turns beside one at rest has its own turn, and the reason tells of both."""
    result = estimate_angles(press_two((one_turn(10.0), one_turn(0.0)), apart=apart))
    truth, turned = one_turn(10.0), slice(UNLOADED + PRESSED, None)
    assert np.isfinite(result.angle[turned]).all()
    covers = (result.low <= truth) & (truth <= result.high)
    assert covers[turned].mean() > 0.85
    np.testing.assert_allclose(result.angle[turned], truth[turned], atol=np.radians(0.1))
    assert all("several contacts" in reason for reason in result.reason[turned])


def test_object_that_was_first_stays_the_followed_one() -> None:
    """A second object that comes later and presses deeper does not change the angle."""
    late = np.r_[np.zeros(FRAMES - 15), np.arange(1, 9) / 8, np.ones(7)]
    turn, rest = one_turn(6.0), np.where(late > 0, 0.0, np.nan)
    result = estimate_angles(press_two((turn, rest), (one_load(), late), depths=(0.7, 1.0)))
    np.testing.assert_allclose(result.angle[-1], turn[-1], atol=np.radians(0.1))
    assert result.restarts[-1] == 0


def test_other_object_is_followed_after_the_first_has_left() -> None:
    """When the followed object leaves, one frame has no contact, then the other's turn counts."""
    gone = one_load()
    gone[-10:] = np.r_[np.linspace(0.8, 0.1, 6), np.zeros(4)]
    first = np.where(gone > 0, one_turn(0.0), np.nan)
    result = estimate_angles(press_two((first, one_turn(6.0)), (gone, one_load())))
    assert State.NO_CONTACT in result.state[-10:]
    assert result.state[-1] != State.NO_CONTACT
    assert not result.reason[-1]
    assert result.low[-1] <= np.radians(6.0) <= result.high[-1]


def test_one_contact_is_not_split() -> None:
    """A sphere, and a ring that is pressed in around a free middle, are one contact each."""
    layout = lay_out_markers(MODEL)
    stencils = make_stencils(layout)
    r = np.hypot(*layout.reference[:, :2].T)
    for depth in (np.exp(-0.1 * r**2), np.exp(-((r - 4.0) ** 2)), np.zeros_like(r)):
        noisy = depth + np.random.default_rng(0).normal(0.0, 0.03, len(r))
        assert separate(stencils, noisy, 0.1) is None
    apart = np.abs(layout.reference[:, 0])
    two = np.exp(-0.2 * ((apart - 5.0) ** 2 + layout.reference[:, 1] ** 2))
    two[np.random.default_rng(1).random(len(r)) < 0.1] = np.nan
    labels = separate(stencils, two, 0.1)
    assert labels is not None
    assert len(set(labels)) == 2
    left = layout.reference[:, 0] < -1.0
    assert len(set(labels[left])) == 1
    assert len(set(labels[layout.reference[:, 0] > 1.0])) == 1
