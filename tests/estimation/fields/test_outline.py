import numpy as np
import pytest

from estimation.fields.measure import measure_fields
from estimation.fields.outline import follow_outline, measure_axis, unwrap
from estimation.fields.stencils import make_stencils
from estimation.frames.recording import layout_markers
from tests.cases import domed_pad, frame_of, recording_of


def pressed_by_an_ellipsoid(
    points, direction, curvatures=(0.02, 0.12), depth=1.0, noise=4e-3, seed=0
):
    """Markers of a dome into which an ellipsoid is pressed: it takes its shape where they touch."""
    c, s = np.cos(direction), np.sin(direction)
    x, y = points[:, 0], points[:, 1]
    along, across = c * x + s * y, c * y - s * x
    gap = 0.5 * (curvatures[0] * along**2 + curvatures[1] * across**2)
    indentation = np.where(
        gap < 0.5 * depth, depth - gap, 0.5 * depth * np.exp(1.0 - 2 * gap / depth)
    )
    positions = points - np.outer(indentation, [0.0, 0.0, 1.0])
    return positions + np.random.default_rng(seed).normal(size=positions.shape) * noise


@pytest.mark.parametrize("direction_deg", [-80, -30, 0, 45, 89])
def test_the_long_axis_of_an_ellipsoid(direction_deg):
    layout = domed_pad()
    stencils = make_stencils(layout)
    positions = pressed_by_an_ellipsoid(layout.reference, np.radians(direction_deg))
    axis = measure_axis(measure_fields(stencils, frame_of(positions)))
    found = np.degrees(unwrap(axis.angle, np.radians(direction_deg)))
    # noise of 4 µm over some 40 markers: 0.2°; the local normals of the dome add a few tenths
    assert found == pytest.approx(direction_deg, abs=0.8)
    assert axis.elongation == pytest.approx(np.sqrt(6.0), rel=0.1)
    assert axis.curvature == pytest.approx(0.12, rel=0.1)


def test_its_error_is_the_scatter_over_draws():
    layout = domed_pad()
    stencils = make_stencils(layout)
    axes = [
        measure_axis(
            measure_fields(
                stencils, frame_of(pressed_by_an_ellipsoid(layout.reference, 0.4, seed=seed))
            )
        )
        for seed in range(200)
    ]
    scatter = np.std([axis.angle for axis in axes])
    # the misfit holds the shape's own deviation from a quadratic too, never less than the noise
    # 200 draws know the scatter to 5 %
    stated = np.median([axis.standard_error for axis in axes])
    assert 0.9 * scatter < stated < 3 * scatter


def test_its_error_holds_where_few_markers_show_the_shape():
    x, y = np.meshgrid(np.arange(-6.0, 7.0), np.arange(-6.0, 7.0), indexing="ij")
    layout = layout_markers(np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3))
    stencils, over = make_stencils(layout), []
    for seed in range(200):
        positions = pressed_by_an_ellipsoid(
            layout.reference, 0.4, (0.05, 0.25), depth=0.4, noise=5e-4, seed=seed
        )
        axis = measure_axis(measure_fields(stencils, frame_of(positions)))
        over.append((unwrap(axis.angle, 0.4) - 0.4) / axis.standard_error)
    # the misfit of eleven markers has five degrees of freedom, and is small by chance
    assert np.mean(np.abs(over) < 1.96) > 0.92


def test_a_round_contact_is_refused():
    layout = domed_pad()
    positions = pressed_by_an_ellipsoid(layout.reference, 0.3, curvatures=(0.1, 0.11))
    axis = measure_axis(measure_fields(make_stencils(layout), frame_of(positions)))
    assert np.isnan(axis.angle)
    assert "too round" in axis.reason
    assert axis.elongation == pytest.approx(1.05, abs=0.05)


def test_too_few_markers_are_refused():
    layout = domed_pad()
    positions = pressed_by_an_ellipsoid(layout.reference, 0.3, curvatures=(0.5, 3.0))
    axis = measure_axis(measure_fields(make_stencils(layout), frame_of(positions)))
    assert np.isnan(axis.angle)
    assert "markers in contact" in axis.reason


def test_followed_through_half_turns_and_begun_anew_after_a_gap():
    layout = domed_pad()
    directions = np.radians(np.arange(60.0, 420.0, 12.0))
    frames = [
        pressed_by_an_ellipsoid(layout.reference, d, seed=i) for i, d in enumerate(directions)
    ]
    frames += [layout.reference, pressed_by_an_ellipsoid(layout.reference, 0.2)]
    outline = follow_outline(recording_of(layout, np.stack(frames)))
    turned = np.degrees(outline.angle[: len(directions)] - outline.angle[0])
    assert turned == pytest.approx(np.degrees(directions - directions[0]), abs=1.5)
    assert np.isnan(outline.angle[-2])
    assert np.degrees(outline.angle[-1]) == pytest.approx(np.degrees(0.2), abs=1.0)
