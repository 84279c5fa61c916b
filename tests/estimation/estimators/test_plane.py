import numpy as np

from estimation.estimators.plane import in_contact_plane, in_plane_of_edge
from estimation.fields.measure import measure_fields
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
