import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from estimation.estimators import METHODS, Paper, Rigid
from estimation.estimators.body import BIWEIGHT_CUT, BIWEIGHT_ERROR, Body, noise_or_misfit
from estimation.estimators.hidden_slip import Region, allow_for_slip, bound_hidden_slip
from estimation.estimators.paper import PaperSettings
from estimation.fields.edge import Edge
from estimation.fields.measure import measure_fields
from estimation.fields.plane import Motion, fit_motion
from estimation.fields.stencils import make_stencils
from estimation.frames.noise import Noise
from estimation.frames.recording import MarkerLayout
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, simulate_pivot
from tests.cases import domed_pad, frame_of, pad_stencils, turn_about_z, twisted_pad

MICRON = Noise(in_plane=1e-3, normal=3e-3, correlation=(0.0, 0.0), frames=100)


def noisy(layout, angle, seed=0, **others):
    positions, stick = twisted_pad(layout, angle, **others)
    noise = np.random.default_rng(seed).normal(size=positions.shape) * [1e-3, 1e-3, 3e-3]
    return positions + noise, stick


@pytest.mark.parametrize("angle_deg", [-20, -5, 2, 10, 20])
def test_rigid_reads_the_angle_through_slip(angle_deg):
    layout, stencils = pad_stencils()
    positions, stick = noisy(layout, np.radians(angle_deg))
    reading = Rigid(stencils, MICRON).update(measure_fields(stencils, frame_of(positions)))
    # 40-odd markers with 2.7 mm lever: standard error 0.003°
    assert np.degrees(reading.angle) == pytest.approx(angle_deg, abs=0.015)
    assert reading.low <= np.radians(angle_deg) <= reading.high
    assert reading.stick[stick].mean() > 0.6
    assert (reading.stick & ~stick).sum() <= 4


@pytest.mark.parametrize("method", ["paper", "rigid"])
def test_translation_is_not_rotation(method):
    layout, stencils = pad_stencils()
    positions, _ = noisy(layout, np.radians(8.0))
    fields = measure_fields(stencils, frame_of(positions))
    moved = measure_fields(stencils, frame_of(positions + np.array([0.4, -0.3, 0.0])))
    here, there = (METHODS[method](stencils, MICRON).update(f) for f in (fields, moved))
    # the contact region is the same; a shift across the dome changes nothing else
    assert there.angle == pytest.approx(here.angle, abs=np.radians(0.02))


def same_after(change, mirror, method, seed, angle):
    """Readings before and after the markers were turned, mirrored or numbered anew."""
    layout = domed_pad((14, 14))
    positions, _ = noisy(layout, angle, seed)
    order = np.arange(len(positions)).reshape(14, 14)
    if change == "renumber":
        order = order[::-1].T  # a grid numbered along the other axis, from another corner
    order = order.ravel()
    place = np.argsort(order)

    def moved(points):
        points = points[order] * ([-1.0, 1.0, 1.0] if mirror else [1.0, 1.0, 1.0])
        return turn_about_z(points, 0.7) if change == "turn" else points

    neighbours = layout.neighbours[order]
    neighbours = np.where(neighbours >= 0, place[neighbours], -1)
    other = MarkerLayout(moved(layout.reference), neighbours, (14, 14))
    readings = []
    for pad, points in ((layout, positions), (other, moved(positions))):
        stencils = make_stencils(pad)
        estimator = METHODS[method](stencils, MICRON)
        readings.append(estimator.update(measure_fields(stencils, frame_of(points))))
    return readings, order


@settings(max_examples=30)
@given(
    change=st.sampled_from(["turn", "renumber", "none"]),
    mirror=st.booleans(),
    method=st.sampled_from(list(METHODS)),
    seed=st.integers(0, 1000),
    angle=st.floats(0.05, 0.35),
)
def test_readings_do_not_depend_on_axes_handedness_or_numbering(
    change, mirror, method, seed, angle
):
    (before, after), order = same_after(change, mirror, method, seed, angle)
    sign = -1.0 if mirror else 1.0
    assert (after.stick == before.stick[order]).all()
    # rounding only, through an iteration that stops at 1e-6 of a weight
    assert sign * after.angle == pytest.approx(before.angle, abs=1e-9, nan_ok=True)
    ends = (after.high, after.low) if mirror else (after.low, after.high)
    assert sign * ends[0] == pytest.approx(before.low, abs=1e-9, nan_ok=True)
    assert sign * ends[1] == pytest.approx(before.high, abs=1e-9, nan_ok=True)


def test_weighted_error_constant_is_the_integral_it_stands_for():
    def density(r):
        return r * np.exp(-0.5 * r**2)

    def weight(r):
        return (1 - (r / BIWEIGHT_CUT) ** 2) ** 2

    def influence(r):
        q = (r / BIWEIGHT_CUT) ** 2
        return (1 - q) * (1 - 3 * q)

    def mean(f):
        return quad(lambda r: f(r) * density(r), 0, BIWEIGHT_CUT)[0]

    spread = np.sqrt(mean(lambda r: weight(r) ** 2 * r**2 / 2)) / mean(influence)
    assert pytest.approx(spread * np.sqrt(mean(weight)), abs=5e-4) == BIWEIGHT_ERROR


def test_without_known_noise_the_misfit_sets_the_interval():
    layout, stencils = pad_stencils()
    positions, _ = noisy(layout, 0.2)
    fields = measure_fields(stencils, frame_of(positions))
    known, unknown = (Rigid(stencils, noise).update(fields) for noise in (MICRON, None))
    ratio = (unknown.high - unknown.low) / (known.high - known.low)
    assert 0.4 < ratio < 2.5  # the scatter of nine markers: 15 degrees of freedom


def test_misfit_beyond_the_noise_widens_the_interval():
    layout, stencils = pad_stencils()
    positions, _ = twisted_pad(layout, 0.2)
    rough = positions + 0.02 * np.random.default_rng(0).normal(size=positions.shape)
    fields = measure_fields(stencils, frame_of(rough))
    told_too_little = Rigid(stencils, MICRON).update(fields)
    # twenty times the noise that it was told: half-width at least ten times 0.003° · 1.96
    assert np.degrees(told_too_little.high - told_too_little.low) > 0.1
    assert told_too_little.low < 0.2 < told_too_little.high
    fit = Rigid(stencils, MICRON).fit(fields)
    assert 10.0 * fit.noise_error < fit.standard_error


def test_paper_takes_the_mean_and_its_interval_comes_from_the_noise():
    layout, stencils = pad_stencils()
    readings = []
    for seed in range(300):
        positions, _ = noisy(layout, 0.1, seed, stick_radius=9.0, contact_radius=4.0)
        readings.append(
            Paper(stencils, MICRON, PaperSettings(window_frames=1)).update(
                measure_fields(stencils, frame_of(positions))
            )
        )
    angles = np.array([reading.angle for reading in readings])
    half = np.array([reading.high - reading.low for reading in readings]) / 2
    # full stick, so no bias from slip; 300 draws know the spread to 4 %
    assert angles.std() * 1.96 == pytest.approx(half.mean(), rel=0.15)


def test_paper_averages_over_a_trailing_window_and_starts_anew():
    layout, stencils = pad_stencils()
    estimator = Paper(stencils, MICRON, PaperSettings(window_frames=3))

    def reading(angle):
        positions, _ = twisted_pad(layout, angle, stick_radius=9.0, contact_radius=4.0)
        return estimator.update(measure_fields(stencils, frame_of(positions))).angle

    first = [reading(angle) for angle in (0.10, 0.12, 0.14, 0.16)]
    single = Paper(stencils, MICRON, PaperSettings(window_frames=1))
    alone = [
        single.update(
            measure_fields(
                stencils,
                frame_of(twisted_pad(layout, a, stick_radius=9.0, contact_radius=4.0)[0]),
            )
        ).angle
        for a in (0.10, 0.12, 0.14, 0.16)
    ]
    assert first[3] == pytest.approx(np.mean(alone[1:]), abs=1e-12)
    estimator.update(measure_fields(stencils, frame_of(layout.reference)))
    assert reading(0.2) == pytest.approx(
        single.update(
            measure_fields(
                stencils,
                frame_of(twisted_pad(layout, 0.2, stick_radius=9.0, contact_radius=4.0)[0]),
            )
        ).angle,
        abs=1e-12,
    )


def test_paper_takes_off_the_zero_drift_seen_while_unloaded():
    layout, stencils = pad_stencils()
    drifted = turn_about_z(layout.reference, np.radians(0.5))
    positions, _ = twisted_pad(layout, 0.1, stick_radius=9.0, contact_radius=4.0)
    loaded = turn_about_z(positions, np.radians(0.5))
    fresh, warned = (Paper(stencils, MICRON) for _ in range(2))
    unloaded = measure_fields(stencils, frame_of(drifted))
    assert not unloaded.contact.any()
    warned.update(unloaded)
    fields = measure_fields(stencils, frame_of(loaded))
    taken_off = fresh.update(fields).angle - warned.update(fields).angle
    assert np.degrees(taken_off) == pytest.approx(0.5, abs=0.02)
    plain = Paper(stencils, MICRON, PaperSettings(zero_drift=False))
    plain.update(unloaded)
    assert plain.update(fields).angle == Paper(stencils, MICRON).update(fields).angle


def test_fewer_than_three_sticking_markers_give_no_angle():
    layout, stencils = pad_stencils()
    rng = np.random.default_rng(0)
    positions, _ = twisted_pad(layout, 0.0)
    tumbled = positions + np.c_[rng.uniform(-0.3, 0.3, (400, 2)), np.zeros(400)]
    fields = measure_fields(stencils, frame_of(tumbled))
    assert fields.contact.any()
    for method in METHODS.values():
        reading = method(stencils, MICRON).update(fields)
        assert reading.stick.sum() < 3 or np.isfinite(reading.angle)
    strict = METHODS["paper_strict"](stencils, MICRON).update(fields)
    assert np.isnan(strict.angle)


def test_a_neighbour_without_an_arm_leaves_the_interval_finite():
    """A marker that has slipped in the middle of a ring lies on the ring's own centre."""
    layout = domed_pad((5, 5))
    stencils = make_stencils(layout)
    before = layout.reference[:, 0] + 1j * layout.reference[:, 1]
    stick = (np.abs(before) > 0.5) & (np.abs(before) < 1.5)
    after = before.copy()
    after[~stick] += 1e-2
    motion = Motion(1.0 + 0.0j, 0.0j, 0.0j)
    region = Region(stencils, motion, before, after, stick, scale=1e-3)
    lag = bound_hidden_slip(region, stick / 8.0, few=True)
    assert np.isfinite(lag)


def bound_of_six(lag_at):
    """Bound on the error of six markers about the middle [rad], and how far they lag.

    Args:
        lag_at: how far the gel lags behind the object at a distance from the middle [rad].
    """
    layout = domed_pad((7, 7))
    stencils = make_stencils(layout)
    before = layout.reference[:, 0] + 1j * layout.reference[:, 1]
    before = before - 0.5
    distance = np.abs(before)
    stick = np.argsort(np.argsort(distance)) < 6
    after = before * np.exp(1j * (np.radians(10.0) - lag_at(distance)))
    motion = fit_motion(before[stick], after[stick])
    arm = np.abs(before - motion.origin)
    influence = np.where(stick, arm / np.sum(arm[stick] ** 2), 0.0)
    region = Region(stencils, motion, before, after, stick, scale=1e-3)
    bound = bound_hidden_slip(region, influence, few=True)
    return bound, np.radians(10.0) - np.angle(motion.turn)


def test_few_markers_inside_an_edge_are_believed():
    """Slip grows from the edge like the distance to the power 3/2."""
    bound, lag = bound_of_six(lambda r: 0.15 * np.maximum(r - 1.2, 0.0) ** 1.5 / r)
    assert abs(lag) < 1e-4
    assert abs(bound) < np.radians(0.15)


def test_few_markers_that_all_slip_are_not():
    """In macro slip the rotation falls like the logarithm of the distance from the middle."""
    bound, lag = bound_of_six(lambda r: 0.02 + 0.002 * np.log(r))
    assert lag > np.radians(1.0)
    assert bound > np.radians(0.05)  # as far as the neighbours lag behind these six


@pytest.mark.parametrize("noise_mm", [0.0, 1e-12])
def test_a_perfect_fit_has_a_scale_to_divide_by(noise_mm):
    assert noise_or_misfit(np.zeros(9, dtype=complex), noise_mm) > 0.0


@pytest.mark.parametrize("turn_deg", [0.5, 0.8, 1.2])
def test_slip_of_several_rows_within_the_noise_widens_the_interval(turn_deg):
    """At low friction a third of the markers that seem to stick slips by less than the noise."""
    model = PivotModel(friction_ratio=0.035, noise=1e-2, normal_noise=3.5e-2)
    path = {"angles_deg": (0.0, turn_deg, turn_deg), "frames": (4, 60)}
    recording, truth = simulate_pivot(model, seed=4, **path)
    result = estimate_angles(recording, "rigid")
    still = np.flatnonzero(np.isclose(truth.angle, np.radians(turn_deg)))
    assert truth.stick[still].sum(axis=1).min() >= 20
    covers = (result.low <= truth.angle) & (truth.angle <= result.high)
    assert covers[still].mean() >= 0.9
    # 58 frames with 10 µm of noise average to 0.003 to 0.01°
    assert np.degrees(np.mean(result.angle[still])) < turn_deg - 0.015


@pytest.mark.parametrize("creep_mm", [0.0, 5e-3])
def test_residuals_far_beyond_the_noise_are_no_evidence_of_slip_that_grows(creep_mm):
    """Slip of 20 µm in outer markers is bounded, unless gel that creeps leaves other residuals."""
    layout = domed_pad((9, 9))
    before = layout.reference[:, 0] + 1j * layout.reference[:, 1]
    distance, angle = np.abs(before), np.angle(before)
    lag = 0.02 * (np.maximum(distance - 1.0, 0.0) / 2.0) ** 1.5
    moved = (lag + creep_mm * np.cos(4.0 * angle)) * np.exp(1j * angle)
    after = before * np.exp(1j * np.radians(5.0)) - 1j * moved * np.exp(1j * np.radians(5.0))
    stick = distance < 3.0
    motion = fit_motion(before[stick], after[stick])
    arm = np.abs(before - motion.origin)
    influence = np.where(stick, arm / np.sum(arm[stick] ** 2), 0.0)
    region = Region(make_stencils(layout), motion, before, after, stick, scale=1e-3)
    bound = bound_hidden_slip(region, influence, few=False)
    lags = np.radians(5.0) - np.angle(motion.turn)
    assert lags > np.radians(0.1)
    assert (bound > 0.5 * lags) == (creep_mm == 0.0)


def test_noise_hides_slip_in_several_rows_under_a_flat_face():
    """Slip grows steeply beyond 25 markers, whose inner half is no proof that they stick."""
    layout = domed_pad((9, 9))
    before = layout.reference[:, 0] + 1j * layout.reference[:, 1]
    distance, turn = np.abs(before), np.exp(1j * np.radians(10.0))
    slip = 0.05 * np.maximum(distance - 2.8, 0.0) ** 1.5
    after = turn * (before - 1j * slip * np.exp(1j * np.angle(before)))
    stick = distance < 3.0
    body = Body(np.ones(stick.sum()), fit_motion(before[stick], after[stick]))
    bounds = {}
    for flat in (0.0, 0.5, 0.9):
        edge = Edge(4.5, 0.01, 0.01, 0.3, flat, distance / 4.5, np.zeros(10))
        fitted = make_stencils(layout), body, before, after, stick, 5e-4
        _, region, bounds[flat] = allow_for_slip(*fitted, edge)
        assert region.ends_under_flat_face == (flat == 0.9)
        assert region.grows_steeply
    assert bounds[0.5] == bounds[0.0] > 0.0
    assert bounds[0.9] > 1.5 * bounds[0.5]


@pytest.mark.parametrize("stretch", [0.0, 2e-3 * np.exp(1.0j)])
def test_gel_that_the_press_stretches_unevenly_does_not_turn_the_angle(stretch):
    """An oblique stretch of 0.2 % turns a rigid fit of a long group of markers by 0.06°.

    Once found, it is known in all later frames.
    """
    layout = domed_pad((4, 20))
    stencils = make_stencils(layout)
    flat = layout.reference[:, 0] + 1j * layout.reference[:, 1]
    moved = stretch * np.conj(flat) * np.exp(1j * np.radians(5.0))
    rigid, errors, inside, naive = Rigid(stencils, MICRON), [], [], []
    for seed in range(20):
        positions, stick = noisy(layout, np.radians(5.0), seed)
        positions[:, 0] += moved.real
        positions[:, 1] += moved.imag
        reading = rigid.update(measure_fields(stencils, frame_of(positions)))
        errors.append(np.degrees(reading.angle) - 5.0)
        inside.append(reading.low <= np.radians(5.0) <= reading.high)
        now = positions[:, 0] + 1j * positions[:, 1]
        turn = fit_motion(flat[stick], now[stick]).turn
        naive.append(np.degrees(np.angle(turn)) - 5.0)
    assert np.abs(np.mean(errors)) < 0.01
    assert np.mean(inside) >= 0.9
    assert (np.abs(np.mean(naive)) > 0.05) == (stretch != 0.0)


@pytest.mark.parametrize("rows", [20, 4])
def test_slip_is_no_stretch_where_most_of_the_contact_slips(rows):
    """Four rows are stretched unevenly: by the press if they are all of the contact."""
    layout, stencils = pad_stencils()
    flat = layout.reference[:, 0] + 1j * layout.reference[:, 1]
    stick = np.abs(flat.imag) < 2.0
    turn = np.exp(1j * np.radians(5.0))
    moved = (turn - 1.0) * flat + 2e-3 * turn * np.exp(1.0j) * np.conj(flat)
    moved = np.where(stick, moved, 0.0)
    noise = np.random.default_rng(0).normal(size=(len(flat), 2)) * 1e-3
    positions = layout.reference.copy()
    positions[:, :2] += np.stack([moved.real, moved.imag], -1) + noise
    contact = np.abs(flat.imag) < 0.5 * rows
    rigid = Rigid(stencils, MICRON)
    fit = rigid.fit(measure_fields(stencils, frame_of(positions, contact=contact)))
    assert fit is not None
    assert (abs(rigid.press.stretch) > 1e-3) == (rows == 4)


def test_markers_that_stuck_are_found_again_where_their_neighbours_slip():
    """Three rows of three: the curl at all but the middle one reaches into gel that slips."""
    layout, stencils = pad_stencils()
    arm = (layout.reference[:, :2] - 0.5) @ [1.0, 1.0j]
    distance = np.maximum(np.abs(arm), 1e-9)
    stick = distance < 1.5
    slip = 0.2j * arm / distance * np.clip(distance - 1.4, 0.0, None) ** 1.5
    moved = arm * (np.exp(1j * np.radians(5.0)) - 1.0) - np.where(stick, 0.0, slip)
    noise = np.random.default_rng(0).normal(size=(len(arm), 2)) * 1e-3
    positions = layout.reference.copy()
    positions[:, :2] += np.stack([moved.real, moved.imag], -1) + noise
    fields = measure_fields(stencils, frame_of(positions, contact=distance < 3.0))
    rigid = Rigid(stencils, MICRON)
    curled, found = rigid.fit(fields), rigid.fit(fields, lately=distance < 2.1)
    assert curled is None or curled.stick.sum() < 5
    assert found is not None
    assert (found.stick == stick).all()
    assert np.degrees(found.angle) == pytest.approx(5.0, abs=0.05)
    # gel at rest and markers that mostly slip are no body that has held
    assert rigid.fit(fields, lately=stick & (arm.real > 0.5)) == curled
    assert rigid.fit(fields, lately=distance < 3.0) == curled
    # coarse noise hides whether they slip alike
    coarse = Rigid(stencils, Noise.from_std(2e-2))
    assert coarse.fit(fields, lately=stick) is coarse.fit(fields)
