"""Markers that stick although the press strains them, or their neighbours' curl reaches beyond."""

import numpy as np
import pytest

from estimation.estimators.measurement import Z95
from estimation.estimators.rigid import Rigid
from estimation.estimators.rotation import fit_rigid_rotation
from estimation.estimators.strain import Bulge, Press, fit_bulge
from estimation.fields.measure import measure_fields
from estimation.frames.noise import Noise
from papers.limits import angle_limit
from tests.cases import frame_of, pad_stencils

MICRON = Noise(in_plane=1e-3, normal=3e-3, correlation=(0.0, 0.0), frames=100)
TURN = np.radians(5.0)
RADIUS = 4.2
"""Of a round face that sticks all over [mm]."""


def pressed_face(seed, strain=0.0, slip=0.0, contact=RADIUS + 0.6, shift=0.0):
    """Stencils, fields and sticking markers of a face that turns, with noise of 1 µm.

    Args:
        seed: of the noise.
        strain: uneven strain by the press at the face's edge [-].
        slip: of the markers in the outer millimetre of the face [mm].
        contact: radius of the contact [mm].
        shift: along x, without slip [mm].
    """
    layout, stencils = pad_stencils()
    flat = (layout.reference[:, :2] - [0.3, -0.2]) @ [1.0, 1.0j]
    distance = np.maximum(np.abs(flat), 1e-9)
    stick = distance < RADIUS
    behind = TURN * (1.0 - np.exp(-np.clip(distance - RADIUS, 0.0, None)))
    behind += np.where(stick & (distance > RADIUS - 1.0), slip / distance, 0.0)
    strained = flat * (1.0 + strain * np.minimum(distance / RADIUS, 1.0) ** 2)
    moved = strained * np.exp(1j * (TURN - behind)) - flat + shift * (1.0 - behind / TURN)
    positions = layout.reference + np.random.default_rng(seed).normal(size=(len(flat), 3)) * [
        *(1e-3, 1e-3, 3e-3)
    ]
    positions[:, :2] += np.stack([moved.real, moved.imag], -1)
    positions[:, 2] -= 0.5 * np.exp(-((distance / 5.0) ** 4))
    fields = measure_fields(stencils, frame_of(positions, contact=distance < contact))
    return layout.reference[:, :2], stencils, fields, stick


@pytest.mark.parametrize("strain", [0.0, 5e-3])
def test_markers_that_the_press_strains_unevenly_narrow_the_interval(strain):
    """A strain of 0.5 % moves the face's edge by twenty times the noise."""
    counted, inside, wide = [], [], []
    for seed in range(20):
        points, stencils, fields, stick = pressed_face(seed, strain)
        reading = Rigid(stencils, MICRON).update(fields)
        counted.append(reading.stick[stick].mean())
        inside.append(reading.low <= TURN <= reading.high)
        limit = 2.0 * Z95 * angle_limit(points, stick, 1e-3)
        wide.append((reading.high - reading.low) / limit)
        assert (reading.stick & ~stick).sum() <= 2  # just beyond the edge
    assert np.median(counted) > 0.95
    assert np.mean(inside) >= 0.9
    assert np.median(wide) < 1.3


@pytest.mark.parametrize(("contact", "bulges"), [(RADIUS + 0.6, True), (8.0, False)])
def test_slip_is_no_bulge_where_most_of_the_contact_slips(contact, bulges):
    _, stencils, fields, _ = pressed_face(0, strain=5e-3, contact=contact)
    rigid = Rigid(stencils, MICRON)
    rigid.update(fields)
    assert (rigid.press.bulge is not None) == bulges


def test_a_bulge_lasts_where_most_of_the_contact_slips_later():
    counted = []
    for seed in range(10):
        _, stencils, fields, stick = pressed_face(seed, strain=5e-3, contact=8.0)
        rigid = Rigid(stencils, MICRON)
        counted.append([rigid.update(fields).stick[stick].mean()])
        rigid.update(pressed_face(seed + 100, strain=5e-3)[2])
        counted[-1].append(rigid.update(fields).stick[stick].mean())
    alone, known = np.median(counted, axis=0)
    assert known > alone + 0.1


def test_strain_is_no_lead_of_markers_that_stuck():
    """Those at the edge towards which the object shifts have moved further than the others."""
    fits = []
    for seed in range(10):
        points, stencils, fields, stick = pressed_face(seed, strain=5e-3, shift=1.0)
        rigid = Rigid(stencils, MICRON)
        rigid.update(fields)
        fits.append(rigid.fit(fields, lately=stick & (points[:, 0] > 0.5)))
    assert all(fit is not None and fit.stick.sum() > 30 for fit in fits)


def test_a_bulge_within_the_noise_is_none():
    """At 10 µm, slip of twenty markers by less than the noise looks like it."""
    rng = np.random.default_rng(1)
    x = 4.0 * np.sqrt(rng.random(60)) * np.exp(2j * np.pi * rng.random(60))
    noise, moved = rng.normal(size=60) + 1j * rng.normal(size=60), x + 8e-4 * x * np.abs(x) ** 2
    fine, coarse = (
        fit_bulge(x, moved + std * noise, np.ones(60), std, 1.0 + 0j)[0] for std in (1e-3, 1e-2)
    )
    assert fine is not None
    assert coarse is None


def test_strain_beyond_the_region_grows_evenly():
    """Twice as far, the polynomial of a bulge would be 8 to 32 times as large."""
    bulge = Bulge(0.0 + 0j, 3.0, np.array([1e-3, 0.0, 0.0, 1e-3]))
    rim, beyond = Press(0j, bulge).displace(np.array([3.0, 6.0j]), np.exp(0.1j))
    assert beyond == pytest.approx(2j * rim)


def test_a_bulge_does_not_turn_and_a_swirl_is_none():
    """The press has no curl, so what grows like it around the axis is slip."""
    rng = np.random.default_rng(1)
    before = 4.0 * np.sqrt(rng.random(60)) * np.exp(2j * np.pi * rng.random(60))
    weights, noise = np.ones(60), 1e-3 * (rng.normal(size=60) + 1j * rng.normal(size=60))
    aside = before - (0.5 + 0.2j)  # from the axis
    outwards = 3e-4 * aside * np.abs(aside) ** 2
    bulge, spread = fit_bulge(before, before + outwards + noise, weights, 1e-3, 1.0 + 0j)
    assert bulge is not None
    left = outwards - bulge.displace(before)
    columns = np.stack([np.ones(60), before], axis=1)
    left = left - columns @ np.linalg.lstsq(columns, left)[0]
    # 120 coordinates give six numbers beside the four of the bulge
    assert np.sqrt(np.mean(np.abs(left) ** 2)) < 1e-3
    assert 1.0 <= spread < 1.1
    assert fit_bulge(before, before + 1j * outwards + noise, weights, 1e-3, 1.0 + 0j)[0] is None


@pytest.mark.parametrize(("slip", "least", "most"), [(0.0, 0.7, 1.0), (2e-3, 0.0, 0.1)])
def test_neighbours_join_unless_they_slip_alike(slip, least, most):
    """Each one's slip of 2 µm hides in 1 µm of noise; that of twenty of them does not."""
    joined = []
    for seed in range(20):
        _, stencils, fields, stick = pressed_face(seed, slip=slip)
        inner = stick & (np.hypot(*(fields.positions[:, :2] - [0.3, -0.2]).T) < RADIUS - 1.0)
        fit = fit_rigid_rotation(stencils, fields, inner, 1e-3)
        joined.append(2 * (fit.stick & ~inner).sum() > (stick & ~inner).sum())
        assert (fit.stick & ~stick).sum() <= 2
    assert least <= np.mean(joined) <= most
