import numpy as np
import pytest

from estimation.estimators.body import fit_body
from estimation.estimators.plane import in_contact_plane, in_plane_of_edge
from estimation.estimators.rigid import Rigid
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.noise import Noise
from estimation.virtual.recording import PivotModel, simulate_pivot


def test_plane_of_the_edge_does_not_depend_on_hidden_markers():
    recording, _ = simulate_pivot(PivotModel(), angles_deg=(0.0, 5.0), frames=(10,))
    stencils, (*_, frame) = make_stencils(recording.layout), recording
    touched = np.flatnonzero(measure_fields(stencils, frame).contact)
    valid = frame.valid.copy()
    valid[touched[:3]] = False  # on one side

    def move(project):
        seen = []
        for frame.valid[:] in (np.ones_like(valid), valid):
            fields = measure_fields(stencils, frame)
            seen.append(project(fields)[1])
        off = (seen[1] - seen[0])[touched[3:]]  # its even part is no error of the angle
        return np.abs(off - off.mean()).max()

    edge = move(lambda fields: in_plane_of_edge(stencils, fields))
    mean = move(lambda fields: in_contact_plane(stencils, fields, fields.contact))
    assert edge < 0.2 * mean


@pytest.mark.parametrize("misread", [(12,), (11, 7)])
def test_misread_markers_beside_the_centre_do_not_spoil_the_core(misread):
    rng, noise = np.random.default_rng(0), 0.01
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    before = (x + 1j * y).ravel()
    after = before * np.exp(0.1j) + noise * (rng.normal(size=25) + 1j * rng.normal(size=25))
    after[list(misread)] += 0.15
    body, scale = fit_body(before, after, np.ones(25, dtype=bool), 12, noise, misread=True)
    assert scale == noise
    assert not body.weights[list(misread)].any()
    assert (body.weights > 0.0).sum() == 25 - len(misread)
    assert np.angle(body.motion.turn) == pytest.approx(0.1, abs=0.005)


def test_a_misread_marker_beside_the_stick_centre_does_not_hide_those_that_stick():
    recording, truth = simulate_pivot(PivotModel(friction_ratio=0.3), seed=1)
    row = int(np.argmax(truth.angle > np.radians(5.0)))
    stencils, noise = make_stencils(recording.layout), Noise.from_std(1e-3)
    fields = measure_fields(stencils, list(recording)[row])
    turned = fields.rotation.copy()
    turned[fields.centre] += 0.2  # by a neighbour off by 0.4 mm
    spoilt = fields._replace(rotation=turned, misread=True)
    found, expected = (Rigid(stencils, noise).fit(one) for one in (spoilt, fields))
    assert found is not None
    assert expected is not None
    assert found.angle == pytest.approx(expected.angle, abs=1e-3)
