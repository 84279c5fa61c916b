"""Recordings of the solver against those of the closed forms, and against their truth."""

import numpy as np
import pytest

from contactmodel import Contact, Grid, HalfSpace, Paraboloid, Pose, Rigid, make_path, solve_path
from estimation.frames.recording import MarkerLayout
from estimation.virtual.contact import simulate_recording
from estimation.virtual.recording import Camera, PivotModel, Timing, lay_out_markers, simulate_pivot

MODEL = PivotModel(grid_shape=(12, 12), poisson_ratio=0.5)
PERFECT = Camera((0.0, 0.0), Timing(dropped=0.0, jitter=0.0))


@pytest.fixture(scope="module")
def path():
    """The pivot of the closed forms: pressed, turned by 6°, and back by 3°."""
    radius = MODEL.contact_radius**2 / MODEL.approach
    modulus = 2.0 * MODEL.shear_modulus / (1.0 - MODEL.poisson_ratio)
    peak = 2.0 * modulus * MODEL.approach / (np.pi * MODEL.contact_radius)
    friction = MODEL.friction_ratio * 2.0 * MODEL.shear_modulus / peak
    poses = [Pose(0.0), Pose(MODEL.approach)]
    poses += [Pose(MODEL.approach, twist=np.radians(angle)) for angle in (6.0, 3.0)]
    return solve_path(
        Contact(
            HalfSpace(MODEL.shear_modulus, MODEL.poisson_ratio),
            Rigid(),
            Paraboloid(radius),
            Grid((64, 64), (14.0, 14.0)),
            friction,
        ),
        make_path(poses, [2, 3, 2]),
    )


def test_the_solver_and_the_closed_forms_make_the_same_recording(path):
    layout = lay_out_markers(MODEL)
    recording, truth = simulate_recording(path, layout, PERFECT, unloaded=1)
    other, exact = simulate_pivot(
        MODEL._replace(noise=0.0, normal_noise=0.0),
        angles_deg=(0.0, 6.0, 3.0),
        frames=(3, 2),
        unloaded=1,
        pressing=2,
        timing=PERFECT.timing,
    )
    # The closed forms turn each point on its circle, the solver moves it along (R−I)r and lets the
    # traction pull it inward: at 6° they differ by 1−cos θ = 0.5 % of the radius where it slips.
    difference = recording.positions - other.positions
    assert np.abs(difference[:3]).max() < 2e-3  # pressing alone: the grid
    assert np.abs(difference[3:]).max() < 0.03
    np.testing.assert_allclose(truth.angle, exact.angle, atol=1e-12)
    np.testing.assert_allclose(truth.moment, exact.moment, rtol=0.02, atol=1e-9)
    assert np.mean(truth.contact != exact.contact) < 0.02  # two of 144 on cells of the rim
    assert np.mean(truth.sticking_now[3:] != exact.sticking_now[3:]) < 0.03
    assert truth.stiffness_ratio == 0.0
    # across the radius only: along it they differ as their positions do
    x, y = layout.reference[:, :2].T
    along, expected = (
        (x * slip[..., 1] - y * slip[..., 0]) / np.hypot(x, y) for slip in (truth.slip, exact.slip)
    )
    inner = truth.contact & exact.contact & (np.hypot(x, y) < 4.5)  # at the rim a root begins
    assert expected[inner].max() > 0.1
    np.testing.assert_allclose(along[inner], expected[inner], atol=0.01)  # 3 % of the largest


def test_sticking_markers_go_where_the_object_takes_them(path):
    layout = lay_out_markers(MODEL)
    recording, truth = simulate_recording(path, layout, PERFECT, unloaded=2)
    pressed = recording.positions[3, :, :2]
    assert truth.stick[-1].sum() > 10
    for frame in range(4, 9):
        # inner ones: a marker between cells follows the mean of what they do
        stuck = truth.stick[frame] & (np.hypot(*layout.reference[:, :2].T) < 2.0)
        c, s = np.cos(truth.angle[frame]), np.sin(truth.angle[frame])
        turned = pressed @ np.array([[c, s], [-s, c]])
        np.testing.assert_allclose(recording.positions[frame, stuck, :2], turned[stuck], atol=2e-3)


def test_noise_lost_frames_and_clock_are_reproducible(path):
    layout = lay_out_markers(MODEL)
    camera = Camera(timing=Timing(dropped=0.3), seed=3)
    first, truth = simulate_recording(path, layout, camera, unloaded=20)
    again, _ = simulate_recording(path, layout, camera, unloaded=20)
    other, _ = simulate_recording(path, layout, camera._replace(seed=4), unloaded=20)
    np.testing.assert_array_equal(first.positions, again.positions)
    assert len(first) < 27
    assert len(first) == len(truth.angle)
    assert np.all(np.diff(first.time) > 0)
    assert not np.array_equal(first.source_index, other.source_index)
    early = first.positions[first.source_index < 20] - layout.reference
    assert np.std(early[..., :2]) == pytest.approx(1e-3, rel=0.1)  # 4000 correlated numbers
    assert np.all(np.isnan(truth.angle[first.source_index < 20]))


def test_markers_below_the_surface_turn_less(path):
    """By 4z/πa on the axis of a disc that sticks; here a = 5 mm, most of which sticks."""
    layout = lay_out_markers(MODEL)
    inner = np.hypot(*layout.reference[:, :2].T) < 2.0
    x, y = layout.reference[inner, :2].T

    def turned(depth):
        recording, _ = simulate_recording(path, layout, PERFECT, depth=depth, unloaded=1)
        u = (recording.positions[5] - recording.positions[2])[inner]  # turned since pressed, by 6°
        return (x @ u[:, 1] - y @ u[:, 0]) / (x @ x + y @ y)

    surface = turned(0.0)
    assert surface == pytest.approx(np.sin(np.radians(6.0)), rel=0.01)
    for depth in (0.1, 0.5):
        # less stick than the whole disc: somewhat more is lost
        assert 4.0 < (1.0 - turned(depth) / surface) * np.pi * 5.0 / depth < 8.0


def test_wrong_input_is_told(path):
    layout = lay_out_markers(MODEL)
    with pytest.raises(ValueError, match="path of contacts"):
        simulate_recording(path.at_step(0), layout)
    flat = MarkerLayout(layout.reference[:, :2], layout.neighbours, layout.grid_shape)
    with pytest.raises(ValueError, match="x, y and z"):
        simulate_recording(path, flat)
    with pytest.raises(ValueError, match="depth must not be below 0"):
        simulate_recording(path, layout, depth=-0.1)
