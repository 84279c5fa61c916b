"""When macro slip began, looked back at."""

import numpy as np
import pytest

from contactmodel.analytic import punch_displacement
from estimation.frames.noise import Noise, estimate_noise
from estimation.slip.disc import SlipSettings, fit_disc
from estimation.slip.lookback import find_slips
from estimation.slip.onset import SlipWatch, describe_slips
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, simulate_pivot
from tests.cases import slow_case

MICRON = Noise(in_plane=1e-3, normal=3e-3, correlation=(0.0, 0.0), frames=100)


@pytest.mark.parametrize("seed", [slow_case(0), 5])
def test_the_onset_is_dated_to_two_frames(seed):
    # with little friction the gel all but rests when its last markers slip
    model = PivotModel(friction_ratio=0.1 + 0.024 * seed, grid_angle=0.3 * seed)
    recording, truth = simulate_pivot(model, seed=seed)
    noise = estimate_noise(recording)
    result = estimate_angles(recording, noise=noise)
    (slip,) = find_slips(recording, result, noise)
    first = int(np.argmax(truth.macro_slip))
    assert abs(int(np.argmax(result.slipping)) - first) <= 2  # live
    # the number that is asked for
    assert abs(slip.onset - recording.time[first]) < 2.0 / 30.0
    assert slip.low < slip.onset < slip.high
    assert not slip.ended
    (sentence,) = describe_slips([slip], recording.time[0])
    assert "Macro slip began at" in sentence


def test_a_turn_back_ends_macro_slip():
    model = PivotModel(friction_ratio=0.06)
    legs = {"angles_deg": (0.0, 25.0, 15.0), "frames": (75, 40)}
    recording, truth = simulate_pivot(model, seed=2, **legs)
    result = estimate_angles(recording, noise=MICRON)
    slips = find_slips(recording, result, MICRON)
    first, last = np.flatnonzero(truth.macro_slip)[[0, -1]]
    assert abs(slips[0].onset - recording.time[first]) < 2.0 / 30.0
    # a window that has the turn in it tells no disc
    assert abs(slips[0].regained - recording.time[last]) < 8.0 / 30.0
    assert len(slips) == 1
    assert not result.slipping[last + 8 :].any()


@pytest.mark.parametrize("offset", [(0.2, -0.4), (0.0, 0.5)])
def test_a_stop_with_few_sticking_markers_is_no_slip(offset):
    model = PivotModel(friction_ratio=0.1, offset=offset, grid_angle=0.3)
    path = {"angles_deg": (0.0, 10.0, 10.0), "frames": (40, 15)}
    recording, truth = simulate_pivot(model, seed=0, **path)
    assert truth.stick[-1].sum() == 6
    result = estimate_angles(recording, noise=MICRON)
    # the last windows before the stop have the motion of a disc that is about to close
    assert not result.slipping.any()


@pytest.mark.parametrize("angles_deg", [(0.0, 6.0), (0.0, 0.0)])
def test_what_sticks_has_no_date(angles_deg):
    model = PivotModel(friction_ratio=1.0)
    recording, _ = simulate_pivot(model, angles_deg=angles_deg, frames=(30,))
    result = estimate_angles(recording, noise=MICRON)
    assert find_slips(recording, result, MICRON) == []
    assert not result.slipping.any()


@pytest.mark.parametrize("round_contact", [True, False])
def test_a_contact_that_is_not_round_is_fitted_in_every_third_frame(round_contact, monkeypatch):
    recording, _ = simulate_pivot(angles_deg=(0.0, 1.0), frames=(1,))
    rest, frames, fits = recording.layout.reference[:, :2], 60, list[int]()
    arm = rest @ np.array([1.0, 1.0j])
    distance = np.abs(arm) / 3.0  # over the disc's radius
    turned = punch_displacement(distance, 1.0) / distance if round_contact else np.sign(arm.real)

    def count(*arguments):
        fits.append(1)
        return fit_disc(*arguments)

    monkeypatch.setattr("estimation.slip.onset.fit_disc", count)
    watch, window = SlipWatch(recording.layout, MICRON), SlipSettings().window
    for i in range(frames):
        moved = arm * np.exp(0.01j * i * turned)  # the halves against each other, if not round
        sight = watch.update(np.stack([moved.real, moved.imag], axis=1), distance < 2.0, i / 30.0)
        assert (sight.disc is not None) <= round_contact
    seldom = 2 * window + (frames - 3 * window) // 3
    assert len(fits) == (frames - window if round_contact else seldom)
