"""The guess at the edge of an unknown contact, from the rotation of the markers."""

import numpy as np
import pytest

from estimation.fields.measure import Fields, measure_fields
from estimation.fields.stencils import Stencils, make_stencils
from estimation.fields.turned import turned_edge
from estimation.virtual.recording import PivotModel, simulate_pivot
from tests.cases import frame_of, in_plane


def measure(recording, positions: np.ndarray) -> tuple[Stencils, Fields]:
    stencils = make_stencils(recording.layout)
    return stencils, measure_fields(stencils, frame_of(positions))


@pytest.mark.parametrize(("radius", "pitch"), [(3.0, 0.8), (5.0, 1.0), (4.0, 1.4)])
@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_the_markers_that_turn_lie_within_the_edge(radius, pitch, noise):
    model = PivotModel(
        contact_radius=radius, pitch=pitch, offset=(0.7, -0.4), friction_ratio=0.3, noise=noise
    )
    recording, truth = simulate_pivot(model, angles_deg=(0.0, -4.0), frames=(20,))
    recording = in_plane(recording)
    stencils, fields = measure(recording, recording.positions[-1])
    assert not fields.bounded
    found = turned_edge(stencils, fields.displacement, fields.rotation)
    assert found is not None
    edge, angle = found
    assert abs(np.log(edge.radius / radius)) < 2.0 * edge.error
    middle = recording.layout.reference[truth.contact[-1]].mean(axis=0)
    assert np.hypot(*(edge.parameters[:2] - middle)) < 2.0 * edge.error * radius
    assert -4.0 < np.degrees(angle) < -2.5


def test_shear_turns_gel_beside_the_contact():
    recording, _ = simulate_pivot(angles_deg=(0.0, 1.0), frames=(4,))
    recording = in_plane(recording)
    reference = recording.layout.reference
    shift = 0.3 / (1.0 + (np.hypot(*reference.T) / 4.0) ** 4)
    stencils, fields = measure(recording, reference + shift[:, None] * [1.0, 0.0])
    assert np.degrees(np.nanmax(fields.rotation)) > 1.0
    assert turned_edge(stencils, fields.displacement, fields.rotation) is None


def test_few_markers_that_turn_give_no_edge():
    model = PivotModel(contact_radius=1.2, friction_ratio=0.3)
    recording, _ = simulate_pivot(model, angles_deg=(0.0, 4.0), frames=(10,))
    recording = in_plane(recording)
    stencils, fields = measure(recording, recording.positions[-1])
    assert turned_edge(stencils, fields.displacement, fields.rotation) is None
