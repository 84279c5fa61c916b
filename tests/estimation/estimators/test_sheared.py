"""Markers that stick beside the middle of a contact, under an object that shifts as it turns."""

import numpy as np
import pytest

from estimation.estimators.rigid import Rigid
from estimation.fields.measure import measure_fields
from estimation.frames.noise import Noise
from tests.cases import frame_of, pad_stencils


@pytest.mark.parametrize(("noise", "precise"), [(1e-3, True), (1e-2, False)])
def test_markers_that_slip_alike_in_the_middle_are_no_body(noise, precise):
    """Twelve markers stick; the middle of the contact follows the object by nine tenths."""
    layout, stencils = pad_stencils()
    places = layout.reference[:, :2] @ [1.0, 1.0j]
    contact, stick = np.abs(places) < 4.5, np.abs(places + 3.0) < 1.6
    moved = 0.4j + (np.exp(1j * np.radians(8.0)) - 1.0) * places
    moved = np.where(stick, 1.0, 0.9) * moved
    off = np.random.default_rng(0).normal(size=(len(places), 2)) * noise
    positions = layout.reference.copy()
    positions[:, :2] += np.stack([moved.real, moved.imag], -1) + off
    fields = measure_fields(stencils, frame_of(positions, contact=contact))
    rigid = Rigid(stencils, Noise.from_std(noise))
    slips, held = rigid.fit(fields), rigid.fit(fields, lately=stick)
    assert slips is not None
    assert not (precise and (slips.stick & stick).any())
    assert np.degrees(slips.angle) == pytest.approx(7.2, abs=0.3)
    assert (held is not None) == precise
    if held is not None:
        assert not (held.stick & ~stick).any()
        assert np.degrees(held.angle) == pytest.approx(8.0, abs=0.1)
    # those that slip are kept where no others have stuck
    assert rigid.fit(fields, lately=slips.stick) is not None
