"""Which of the law of friction and the sticking markers gives a frame's angle."""

from dataclasses import replace

import numpy as np
import pytest

from estimation.estimators.incremental import Incremental
from estimation.estimators.keyframe import Keyframe
from estimation.estimators.law.fit import fit_law
from estimation.estimators.law.reader import LawReader
from estimation.estimators.law.state import Reading
from estimation.estimators.rotation import RigidFit
from estimation.estimators.strain import Press
from estimation.estimators.tracked import Tracked
from estimation.fields.measure import Fields, measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.noise import Noise
from estimation.tracking.observation import Observer
from estimation.tracking.tracker import Tracker, estimate_angles
from estimation.tracking.trackers import Trackers
from estimation.virtual.recording import PivotModel, simulate_pivot
from tests.cases import in_plane


class Law:
    """A law that gives one reading, and explains the contact or does not."""

    turned, closed, fit, noise = False, False, None, 1e-3

    def __init__(self, reading: Reading | None, follows: bool = True) -> None:
        self.reading, self.follows = reading, follows

    def reject(self) -> None:
        self.reading, self.follows = None, False

    def observe(self, edge: object) -> bool:
        return True

    def update(self, *args: object, **options: object) -> Reading | None:
        return self.reading

    def slides(self, *args: object) -> None:
        return None


@pytest.fixture(scope="module")
def observed() -> tuple[Observer, Fields]:
    recording, _ = simulate_pivot(angles_deg=(0.0, 2.0), frames=(4,))
    observer = Observer(recording.layout)
    fields = [observer.observe(frame).fields for frame in recording][-1]
    assert fields is not None
    return observer, fields


def read(reader: LawReader, law: Law, fields: Fields, angle: float, monkeypatch):
    """What a reader gives with this law, and an angle by five markers that stick."""
    for name in ("_law", "_rough"):
        monkeypatch.setattr(reader, name, law)
    stick = np.arange(len(fields.contact)) < 5
    return reader.read(fields, (Keyframe(None, 0, angle, 0.1), fit_of(stick)), 0, Press())


def fit_of(stick: np.ndarray) -> RigidFit:
    return RigidFit(0.0, 0.1, 0.0, stick, scale=1e-3, noise=1e-3, strain=0.0)


def read_disc(fields: Fields, held: int) -> Reading:
    disc = np.arange(len(fields.contact)) < held
    return Reading(1.0, 0.1, 0.1, disc, firm=True, ahead=0.0, near=False)


def test_a_law_whose_angle_jumps_while_its_markers_stay_is_rejected(observed, monkeypatch):
    observer, fields = observed
    reader, reading = LawReader(observer.stencils, Noise.from_std(1e-3), 12), read_disc(fields, 30)
    law = Law(reading._replace(step_error=1e-3))
    for angle, believed in ((1.0, True), (1.003, True), (1.02, False)):
        law.reading = law.reading._replace(angle=angle)
        assert (read(reader, law, fields, 1.0, monkeypatch)[0] is not None) is believed
    assert not law.follows
    assert not reader.leads


def test_the_count_goes_on_where_the_law_stops(observed, monkeypatch):
    observer, fields = observed
    reader = LawReader(observer.stencils, Noise.from_std(1e-3), 12)
    reading, _ = read(reader, Law(read_disc(fields, 5)), fields, 1.0, monkeypatch)
    assert reading is not None
    assert reader.leads
    reading, counted = read(reader, Law(None, follows=False), fields, 1.1, monkeypatch)
    assert reading is None
    assert counted is not None
    assert not reader.leads


def test_where_the_law_stops_the_angle_counts_from_frames_that_it_has_read(monkeypatch):
    """From frame to frame, gel that slips hardly turns: most of it would seem to stick."""
    model = PivotModel(friction_ratio=0.1)
    recording, truth = simulate_pivot(model, angles_deg=(0.0, 12.0), frames=(60,), seed=2)
    count = truth.stick.sum(axis=1)
    stop = int(np.argmax((count > 0) & (count <= 16)))
    tracker = Tracker(recording.layout, "incremental", noise=Noise.from_std(1e-3))
    assert isinstance(tracker.estimator, Incremental)
    law, row = tracker.estimator.law, 0
    own = law.read

    def read_truth(fields, counted, *others):
        if row <= 20:
            return own(fields, counted, *others)
        law.leads, angle, disc = row < stop, float(truth.angle[row]), truth.stick[row]
        reading = Reading(angle, 1e-3, 1e-3, disc, True, 0.0, False)
        return (reading if law.leads else None), counted

    monkeypatch.setattr(law, "read", read_truth)
    for row, frame in enumerate(recording):
        answer = tracker.update(frame)
        if stop <= row < stop + 3:
            assert np.degrees(abs(answer.angle - truth.angle[row])) < 0.05
            assert answer.stick.sum() <= count[row] + 2


@pytest.mark.parametrize("sheared", [False, True])
def test_gel_that_stops_in_a_sheared_contact_may_rest_under_a_slide(observed, sheared):
    """Nine of 24 markers lie in the disc, and four of them move as one body."""
    observer, fields = observed
    fields = fields._replace(contact=np.arange(len(fields.contact)) < 24)
    gel, rate, rest = Incremental(observer.stencils, Noise.from_std(1e-3)), 0.01, 10
    answer = gel.follow(fields)
    for angle in rate * np.minimum(np.arange(10 + rest), 10):
        gel.keyframes.number += 1
        reading = read_disc(fields, 9)._replace(
            angle=float(angle), error=1e-4, step_error=1e-4, sheared=sheared
        )
        counted = Keyframe(fields, gel.keyframes.number, float(angle)), fit_of(np.arange(24) < 4)
        answer = gel.widen(gel._follow_law(fields, reading, counted), np.inf)
    assert (answer.high - answer.low < rate) != sheared
    assert (answer.high - answer.angle > rest * rate) == sheared


@pytest.mark.parametrize(
    ("held", "sheared", "turned", "covers"),
    [
        (9, False, False, False),
        (9, True, False, True),
        (30, False, False, True),
        (30, False, True, False),
    ],
)
def test_the_interval_covers_the_markers_angle_under_shear_and_where_the_law_has_many_stick(
    observed, monkeypatch, held, sheared, turned, covers
):
    observer, fields = observed
    fields = fields._replace(contact=np.ones_like(fields.contact))
    gel = Incremental(observer.stencils, Noise.from_std(1e-3))
    gel.follow(fields)
    law = Law(None)
    monkeypatch.setattr(law, "turned", turned, raising=False)
    monkeypatch.setattr(gel.law, "_law", law)
    reading = read_disc(fields, held)._replace(angle=0.1, error=1e-3, sheared=sheared)
    counted = (
        Keyframe(fields, gel.keyframes.number, 0.08),
        fit_of(np.arange(len(fields.contact)) < 4),
    )
    answer = gel._follow_law(fields, reading, counted)
    assert answer.angle == pytest.approx(0.1)
    assert (answer.low < 0.08) == covers
    assert answer.high < 0.103


@pytest.mark.parametrize("given", [True, False])
def test_markers_in_the_plane_are_read_by_the_law(given):
    model = PivotModel(friction_ratio=0.2, grid_angle=0.4)
    legs = {"angles_deg": (0.0, 25.0), "frames": (40,)}
    recording, truth = simulate_pivot(model, noise_window=1, seed=1, **legs)
    case = replace(in_plane(recording), contact=truth.contact if given else None)
    result = estimate_angles(case, noise=Noise.from_std(1e-3))
    count = truth.stick.sum(axis=1)
    few = (count >= 3) & (count < 10) & (truth.contact.sum(axis=1) > 20)
    assert few.sum() > 10
    assert ((result.low < truth.angle) & (truth.angle < result.high))[few].all()
    half = np.degrees(0.5 * (result.high - result.low)[few])
    assert half.max() < 1.0  # the markers that stick, alone: 1.9
    assert np.median(half) < 0.35  # the markers that stick, alone: 0.5
    if given:
        assert 0.9 < np.nanmedian(result.contact_radius[few]) / model.contact_radius < 1.1


@pytest.mark.parametrize("given", [True, False])
def test_gel_that_a_turn_back_leaves_behind_contradicts_no_contact(given):
    model = PivotModel(friction_ratio=0.2, grid_angle=0.3)
    recording, truth = simulate_pivot(model, seed=3)
    case = replace(in_plane(recording), contact=truth.contact if given else None)
    result = estimate_angles(case)
    angle, seen = result.angle, result.contact.any(axis=1)
    known = (truth.stick.sum(axis=1) >= 10) & (truth.contact.sum(axis=1) > 20) & seen
    assert known.sum() > 100
    assert np.degrees(np.abs(angle - truth.angle)[known].max()) < 0.2  # none is missing


def test_the_law_bounds_a_contact_in_the_plane():
    model = PivotModel(friction_ratio=0.2)
    recording, truth = simulate_pivot(model, angles_deg=(0.0, 8.0), frames=(20,))
    recording = in_plane(recording)
    tracker = Tracked(make_stencils(recording.layout), Noise.from_std(1e-3))
    bound = tracker.incremental.bound
    regions = []
    for frame in recording:
        fields = measure_fields(tracker.incremental.keyframes.rigid.stencils, frame)
        tracker.update(fields)
        regions.append(bound(fields).contact)
    assert regions[0].sum() in (0, len(regions[0]))
    missed = regions[-1] ^ truth.contact[-1]
    assert missed.sum() < 0.1 * truth.contact[-1].sum()


def test_methods_share_the_fits_of_the_law(monkeypatch):
    made = []

    def count(*arguments):
        made.append(1)
        return fit_law(*arguments)

    monkeypatch.setattr("estimation.estimators.law.fit.fit_law", count)
    recording, _ = simulate_pivot(angles_deg=(0.0, 6.0), frames=(20,))
    noise = Noise.from_std(1e-3)

    def follow(*methods):
        made.clear()
        trackers = Trackers(recording.layout, {name: {} for name in methods}, noise=noise)
        answers = [trackers.update(frame)["incremental"].angle for frame in recording]
        return len(made), answers

    alone, angles = follow("incremental")
    both, shared = follow("tracked", "incremental")
    assert alone == both > 10
    np.testing.assert_array_equal(shared, angles)
