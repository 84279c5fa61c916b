from dataclasses import replace

import numpy as np
import pytest

from estimation.fields.measure import measure_fields, rotation_sensitivity
from estimation.fields.stencils import make_stencils
from estimation.frames.neighbours import delaunay_neighbours
from estimation.frames.recording import Frame, MarkerLayout
from estimation.virtual.recording import simulate_pivot
from tests.cases import domed_pad, frame_of, in_plane, pad_stencils, turn_about_z, twisted_pad


def test_a_rigid_turn_is_read_at_every_marker_of_a_dome():
    layout, stencils = pad_stencils()
    fields = measure_fields(stencils, frame_of(turn_about_z(layout.reference, 0.3)))
    inside = np.hypot(*layout.reference[:, :2].T) < 6.0
    # A turn about z leans a sloping tangent plane sideways; taking that lean back by the smallest
    # rotation leaves tan(a/2)-like differences of the order slope² (6 mm of 30 mm: 4 %).
    assert fields.rotation[inside] == pytest.approx(0.3, rel=0.03)
    apex = np.argmin(np.hypot(*layout.reference[:, :2].T))
    assert fields.rotation[apex] == pytest.approx(0.3, rel=1e-3)


def test_a_lean_without_twist_is_no_rotation():
    layout, stencils = pad_stencils()
    lean = 0.2
    turn = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]])
    fields = measure_fields(stencils, frame_of(layout.reference @ turn.T))
    apex = np.argmin(np.hypot(*layout.reference[:, :2].T))
    # half a pitch off the axis the rotation vector has a part along the marker's own normal
    assert fields.rotation[apex] == pytest.approx(lean * layout.reference[apex, 0] / 30.0, rel=0.02)
    assert fields.normals[apex] == pytest.approx([0, -np.sin(lean), np.cos(lean)], abs=0.03)


def test_uniform_strain_in_the_plane():
    layout = domed_pad(radius=1e9)
    stencils = make_stencils(layout)
    gradient = np.array([[0.02, -0.1], [0.06, -0.01]])
    positions = layout.reference.copy()
    positions[:, :2] += layout.reference[:, :2] @ gradient.T
    gridded, scattered = (
        measure_fields(each, frame_of(positions)).rotation
        for each in (stencils, replace(stencils, gridded=False))
    )
    f = gradient + np.eye(2)
    polar = np.arctan2(f[1, 0] - f[0, 1], f[0, 0] + f[1, 1])
    lines = 0.5 * (np.arctan2(f[1, 0], f[0, 0]) + np.arctan2(-f[0, 1], f[1, 1]))
    # linear fields are exact for any difference stencil, at the rim too
    assert scattered == pytest.approx(polar, abs=1e-9)
    assert gridded == pytest.approx(lines, abs=1e-9)


def test_a_share_bounds_the_contact_region():
    layout, stencils = pad_stencils()
    positions, _ = twisted_pad(layout, 0.1, contact_radius=5.0, centre=(0.0, 0.0))
    fields = measure_fields(stencils, frame_of(positions), share=0.5)
    r = np.hypot(*layout.reference[:, :2].T)
    assert fields.contact[r < 4.6].all()
    assert not fields.contact[r > 5.4].any()
    assert r[fields.centre] < 2.0


def test_no_contact_below_the_onset():
    layout, stencils = pad_stencils()
    fields = measure_fields(stencils, frame_of(layout.reference - [0.0, 0.0, 0.09]))
    assert not fields.contact.any()
    assert fields.centre == -1
    assert measure_fields(stencils, frame_of(layout.reference - [0.0, 0.0, 0.11])).contact.any()


def test_peaks_of_noise_are_no_contact():
    layout, stencils = pad_stencils()
    rng = np.random.default_rng(0)
    spread = [0.012, 0.012, 0.04]  # the deepest of 400 lies 3 σ deep: beyond the onset of 0.1 mm
    for _ in range(40):
        noise = rng.normal(size=layout.reference.shape) * spread
        assert not measure_fields(stencils, frame_of(layout.reference + noise)).contact.any()
    pressed, _ = twisted_pad(layout, 0.1)
    assert measure_fields(stencils, frame_of(pressed + noise)).contact.any()


@pytest.mark.parametrize(
    ("strain_mm", "noise_mm", "kept"), [(0.06, 0.005, True), (0.0, 0.02, False)]
)
def test_contact_in_the_plane_lasts_while_the_gel_is_strained(strain_mm, noise_mm, kept):
    recording, _ = simulate_pivot(angles_deg=(0.0, 4.0), frames=(4,))
    recording = in_plane(recording)
    layout, stencils = recording.layout, make_stencils(recording.layout)
    touched = measure_fields(stencils, frame_of(recording.positions[-1])).region
    assert touched.markers.any()
    moved = recording.positions[-1] - layout.reference
    noise = noise_mm * np.random.default_rng(0).normal(size=moved.shape)
    later = frame_of(layout.reference + strain_mm * moved / np.abs(moved).max() + noise)
    assert measure_fields(stencils, later, last=touched).contact.any() == kept
    assert not measure_fields(stencils, later).contact.any()


def test_an_unloaded_frame_of_exact_zeros_has_no_contact():
    layout, stencils = pad_stencils()
    fields = measure_fields(stencils, frame_of(layout.reference))
    assert not fields.contact.any()
    assert np.abs(fields.rotation).max() < 1e-15


def test_missing_markers_leave_the_others_right():
    layout = domed_pad(radius=1e9)
    stencils = make_stencils(layout)
    positions = turn_about_z(layout.reference, 0.2)
    valid = np.random.default_rng(0).random(len(positions)) > 0.2
    seen = np.where(valid[:, None], positions, np.nan)
    fields = measure_fields(stencils, Frame(seen, 0.0, 0, valid))
    known = np.isfinite(fields.rotation)
    assert known.sum() > 0.6 * len(positions)
    assert not known[~valid].any()
    assert fields.rotation[known] == pytest.approx(0.2, abs=1e-9)


def test_two_dimensional_markers_without_a_grid():
    rng = np.random.default_rng(1)
    reference = rng.uniform(-8, 8, (150, 2))
    layout = MarkerLayout(reference, delaunay_neighbours(reference))
    c, s = np.cos(0.25), np.sin(0.25)
    turned = reference @ np.array([[c, s], [-s, c]])
    fields = measure_fields(make_stencils(layout), frame_of(turned))
    known = np.isfinite(fields.rotation)
    assert known.mean() > 0.9
    assert fields.rotation[known] == pytest.approx(0.25, abs=1e-9)
    assert fields.contact[known].all()


def test_sensitivity_of_the_mean_rotation_is_its_derivative():
    layout = domed_pad(radius=1e9)  # on a dome the planes' lean adds a term of the slope squared
    stencils = make_stencils(layout)
    markers = np.hypot(*layout.reference[:, :2].T) < 3.0
    valid = np.ones(len(markers), dtype=bool)
    valid[170] = False
    sensitivity = rotation_sensitivity(stencils, markers & valid, valid)
    rng = np.random.default_rng(2)
    step = 1e-5 * rng.normal(size=layout.reference.shape)

    def mean_rotation(positions):
        frame = Frame(np.where(valid[:, None], positions, np.nan), 0.0, 0)
        return measure_fields(stencils, frame).rotation[markers & valid].mean()

    change = mean_rotation(layout.reference + step) - mean_rotation(layout.reference - step)
    # central difference: the cubic term is 1e-10 of the linear one
    assert change == pytest.approx(2 * np.sum(sensitivity * step), rel=1e-4)


def test_noise_of_one_markers_rotation():
    layout, stencils = pad_stencils()
    rng = np.random.default_rng(3)
    marker = 190
    readings = [
        measure_fields(
            stencils, frame_of(layout.reference + 1e-3 * rng.normal(size=(400, 3)))
        ).rotation[marker]
        for _ in range(600)
    ]
    # 600 draws: the spread is known to 3 %
    assert np.std(readings) == pytest.approx(stencils.rotation_noise(1e-3), rel=0.12)


def test_a_flat_soft_object_touches_where_it_hardly_presses_in():
    # Its rim is pressed in deepest, its middle by a tenth: the middle belongs to the contact.
    layout = domed_pad((16, 16), radius=1e4)
    x, y = layout.reference[:, :2].T
    inside = np.maximum(np.abs(x), np.abs(y)) < 4.0
    deep = 0.02 + 0.18 * (np.maximum(np.abs(x), np.abs(y)) / 4.0) ** 4
    pressed = layout.reference - np.where(inside, deep, 0.0)[:, None] * [0.0, 0.0, 1.0]
    fields = measure_fields(make_stencils(layout), frame_of(pressed))
    np.testing.assert_array_equal(fields.contact, inside)
    # Two separate contacts with the pad as it was between them are not joined: one is followed.
    two = (np.abs(np.abs(x) - 5.0) < 2.0) & (np.abs(y) < 2.0)
    apart = layout.reference - np.where(two, 0.2, 0.0)[:, None] * [0.0, 0.0, 1.0]
    contact = measure_fields(make_stencils(layout), frame_of(apart)).contact
    np.testing.assert_array_equal(contact, two & (np.sign(x) == np.sign(x[contact][0])))
    rng = np.random.default_rng(0)  # noise whose peaks surround others is no contact
    for _ in range(20):
        noisy = layout.reference + rng.normal(size=(256, 3)) * [0.01, 0.01, 0.035]
        assert not measure_fields(make_stencils(layout), frame_of(noisy)).contact.any()
