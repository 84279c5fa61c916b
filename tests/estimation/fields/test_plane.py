import numpy as np

from estimation.fields.measure import measure_fields
from estimation.fields.plane import in_contact_plane, in_plane_of_edge, leads
from estimation.fields.stencils import make_stencils
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


def test_markers_that_slip_fall_behind_a_body_that_sticks():
    """The object shifts and turns; half of the markers follow it by nine tenths."""
    x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    before = (x + 1j * y).ravel()
    stick, noise = before.real > 2.0, 3e-3
    moved = 0.3 + (np.exp(1j * np.radians(5.0)) - 1.0) * before
    rng = np.random.default_rng(0)
    found, alike = [], []
    for _ in range(200):
        off = noise * (rng.normal(size=20) + 1j * rng.normal(size=20))
        after = before + np.where(stick, 1.0, 0.9) * moved + off
        found.append(
            [leads(before, after, *pair, noise) for pair in ((stick, ~stick), (~stick, stick))]
        )
        alike.append(leads(before, before + moved + off, stick, ~stick, noise))
    assert np.mean(found, axis=0).tolist() == [1.0, 0.0]
    assert not any(alike)  # four standard errors
