import numpy as np
import pytest

from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.slip.gel_moment import GelMoment
from estimation.virtual.recording import PivotModel, Timing, simulate_pivot

WHOLE = Timing(dropped=0.0)


def _follow(recording):
    gel, stencils = GelMoment(recording.layout), make_stencils(recording.layout)
    return np.array([gel.update(measure_fields(stencils, frame)) for frame in recording])


@pytest.mark.parametrize("friction_ratio", [0.1, 0.4])
def test_markers_tell_the_moment_up_to_a_factor(friction_ratio):
    model = PivotModel(friction_ratio=friction_ratio)
    recording, truth = simulate_pivot(
        model, angles_deg=(0.0, 10.0, -20.0), frames=(15, 30), timing=WHOLE
    )
    told = _follow(recording)
    assert np.isnan(told[~truth.contact.any(axis=1)]).all()
    loaded = np.abs(truth.moment) > 0.2 * np.abs(truth.moment).max()
    factor = told[loaded] / truth.moment[loaded]
    # Betti: 16/3 G R³ of a disc that fills the view, whose half-width is 9.7 mm
    stiffness = 16.0 / 3.0 * model.shear_modulus * 9.7**3
    assert np.median(factor) * stiffness == pytest.approx(1.0, abs=0.06)
    np.testing.assert_allclose(factor, np.median(factor), rtol=0.03)


def test_too_narrow_a_view_tells_nothing():
    model = PivotModel(grid_shape=(11, 11))  # 5.5 mm around a contact of 5 mm
    recording, _ = simulate_pivot(model, angles_deg=(0.0, 5.0), frames=(8,), timing=WHOLE)
    assert np.isnan(_follow(recording)[-8:]).all()


def test_markers_that_are_all_missing_tell_nothing():
    recording, _ = simulate_pivot(angles_deg=(0.0, 5.0), frames=(8,), timing=WHOLE)
    fields = measure_fields(make_stencils(recording.layout), list(recording)[-1])
    unseen = fields._replace(displacement=np.full_like(fields.displacement, np.nan))
    gel = GelMoment(recording.layout)
    assert np.isfinite(gel.update(fields))
    assert np.isnan(gel.update(unseen))
