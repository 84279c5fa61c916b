"""k on a thin elastomer: found on one grasp, true on a larger one, where a number k is not."""

import jax.numpy as jnp
import numpy as np
import pytest

from calibration.layered_fit import fit_layered_softness, gather_turns
from contactmodel import Grid, HalfSpace, Layer, Paraboloid, Pose, solve_path
from estimation import LayeredSoftness, ScalarSoftness, estimate_angles
from estimation.fields import Fields
from estimation.layered_softness import missed_rotation
from estimation.noise import Noise
from estimation.recording import MarkerLayout, grid_neighbours
from estimation.softness import Contact, read_softness, write_softness
from estimation.virtual.contact import simulate_recording
from estimation.virtual.recording import Camera

K, THICKNESS = 0.5, 2.0
TWIST = np.radians(np.linspace(0.0, 11.0, 23))
MICRON = Noise.given(1e-3)


def grasp(approach, seed):
    """A soft ball on a thin elastomer, turned by 11°, and its truth."""
    at = np.arange(16) - 7.5
    x, y = np.meshgrid(at + 0.13, at - 0.21)
    markers = np.stack([x, y, 0.0 * x], -1).reshape(-1, 3)
    path = Pose(jnp.full(len(TWIST), approach), twist=jnp.asarray(TWIST))
    contacts = solve_path(
        Layer(0.2, 0.48, THICKNESS),
        HalfSpace(0.2 / K, 0.48),
        Paraboloid(20.0),
        path,
        Grid((32, 32), (16.0, 16.0)),
        0.9,
        rtol=1e-6,
    )
    camera = Camera((1e-3, 3e-3), dropped=0.0, jitter=0.0, noise_window=1, seed=seed)
    layout = MarkerLayout(markers, grid_neighbours((16, 16)), (16, 16))
    return simulate_recording(contacts, layout, camera)


def worst(recording, truth, softness):
    """Largest error where ten markers stick, by 0.1° or 2 % of the angle, whichever is larger."""
    result = estimate_angles(recording, "incremental", noise=MICRON, softness=softness)
    firm = (truth.stick.sum(axis=1) >= 10) & (truth.angle > np.radians(1.0))
    assert result.answered[firm].mean() > 0.9
    firm &= result.answered
    limit = np.maximum(np.radians(0.1), 0.02 * truth.angle[firm])
    return np.max(np.abs(result.angle - truth.angle)[firm] / limit)


def test_a_larger_grasp_is_corrected_by_what_a_smaller_one_told():
    turns = gather_turns(*_with_angle(grasp(0.4, seed=1)), MICRON)
    fit = fit_layered_softness(turns, (THICKNESS, 0.0))
    assert fit.softness.stiffness_ratio == pytest.approx(K, abs=0.03)  # 1 % of θ: see the study
    assert fit.determined[0]
    k = float(np.median([turn.reference / turn.rotation for turn in turns])) - 1.0
    recording, truth = grasp(0.8, seed=2)
    assert worst(recording, truth, fit.softness) < 1.0
    assert worst(recording, truth, ScalarSoftness(k)) > 2.0
    assert worst(recording, truth, ScalarSoftness()) > 15.0


def _with_angle(recording_and_truth):
    recording, truth = recording_and_truth
    return recording, truth.angle


def disc(rotation=0.1):
    """A sensor that shows the same rotation everywhere."""
    at = np.arange(20) - 9.5
    points = np.stack([*np.meshgrid(at, at), np.zeros((20, 20))], -1).reshape(-1, 3)
    inside = np.hypot(*points.T[:2]) < 3.0
    none = np.zeros_like(points)
    phi = np.full(400, rotation)
    return Contact(Fields(points, none, none[:, 2], none, phi, phi, inside, 0))


def test_a_thick_elastomer_with_markers_at_its_surface_misses_nothing():
    assert missed_rotation(disc(), np.inf, 0.0) == (0.0, 0.0)
    softness = LayeredSoftness(0.5, np.inf).at(disc())
    assert (softness.stiffness_ratio, softness.load_term) == (0.5, 0.0)
    # e^{−2qh} of the waves that matter, 1/q about 3 mm: 2e-5 at h of ten times that, and its tail
    assert abs(missed_rotation(disc(), 100.0, 0.0)[1]) < 0.01 * 0.1 * 3.0


def test_markers_below_the_centre_of_a_disc():
    """φ falls by 4z/πa there (Reissner and Sagoci's disc, half-space, first order)."""
    at = np.arange(-12.0, 12.1, 0.5)
    points = np.stack([*np.meshgrid(at, at), np.zeros((49, 49))], -1).reshape(-1, 3)
    r, a, z = np.hypot(*points.T[:2]), 5.0, 0.4
    # u = (2/π) r [asin(a/r) − (a/r)√(1 − a²/r²)] outside the disc, r inside
    ratio = np.minimum(a / np.maximum(r, a), 1.0)
    turned = 2.0 / np.pi * (np.arcsin(ratio) - ratio * np.sqrt(1.0 - ratio**2))
    u_x, u_y = (-turned * points[:, 1]).reshape(49, 49), (turned * points[:, 0]).reshape(49, 49)
    surface = 0.5 * (np.gradient(u_y, 0.5, axis=1) - np.gradient(u_x, 0.5, axis=0)).ravel()
    none = np.zeros_like(points)
    centre = r < 1.0
    contact = Contact(Fields(points, none, none[:, 2], none, surface, surface, centre, 0))
    below, _ = missed_rotation(contact, np.inf, z)
    # of the singular rim, markers see no waves shorter than a pitch: a quarter is lost
    assert below == pytest.approx(4.0 * z / (np.pi * a), rel=0.3)


def test_layered_files(tmp_path):
    path = tmp_path / "soft.toml"
    covariance = ((1e-4, 1e-5, 0.0), (1e-5, 0.01, 0.0), (0.0, 0.0, 0.0))
    softness = LayeredSoftness(0.3, 4.0, 0.5, covariance, provenance={"object": "salmon"})
    write_softness(softness, path)
    assert read_softness(path) == softness
    path.write_text("format_version = 1\nkind = 'layered'\nstiffness_ratio = 0.3\n")
    with pytest.raises(ValueError, match="no thickness_mm"):
        read_softness(path)
    with pytest.raises(ValueError, match="between 0 and the thickness"):
        LayeredSoftness(0.3, 1.0, 2.0)


def test_errors_of_thickness_and_depth_widen_the_interval():
    known = LayeredSoftness(0.5, 4.0, 0.3)
    loose = LayeredSoftness(0.5, 4.0, 0.3, ((0.0, 0.0, 0.0), (0.0, 0.04, 0.0), (0.0, 0.0, 0.01)))
    assert known.at(disc()).covariance[1][1] == 0.0
    slopes = [
        (LayeredSoftness(0.5, 4.0 + h, 0.3 + z).at(disc()).load_term
         - LayeredSoftness(0.5, 4.0 - h, 0.3 - z).at(disc()).load_term) / (2.0 * (h + z))
        for h, z in ((0.01, 0.0), (0.0, 0.01))
    ]  # fmt: skip
    expected = (0.2 * slopes[0]) ** 2 + (0.1 * slopes[1]) ** 2
    assert loose.at(disc()).covariance[1][1] == pytest.approx(expected, rel=1e-2)  # of the steps
    with pytest.raises(ValueError, match="0 frames"):
        fit_layered_softness([], (4.0, 0.0))
