"""Softness on a thin elastomer: what lifting makes of markers, and what is kept in files.

That k found on some grasps holds on others is tested with the study (`tests/papers`).
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j1, jn_zeros

from calibration.softness.fit import fit_softness
from calibration.softness.layered import Grasp, fit_layered_softness
from calibration.softness.readings import HALF_SPACE, Layer
from calibration.softness.references import Reference
from calibration.softness.trials import Trial, make_trials
from contactmodel import Contact as Pair
from contactmodel import Grid, Pose, Rigid, Sphere, solve_contact
from contactmodel import Layer as Gel
from estimation import LayeredSoftness, Settings, Stream, simulate_pivot
from estimation.fields.measure import Fields
from estimation.frames.noise import Noise
from estimation.softness import Contact, read_softness, write_softness
from estimation.softness.bar import (
    bar_compliance,
    bar_shortening,
    force_weights,
    moment_weights,
)
from estimation.softness.lifting import small_turn
from tests.cases import lift


def lattice(step, reach=12.0):
    at = np.arange(-reach, reach + 0.1, step)
    return np.stack(np.meshgrid(at, at), -1).reshape(-1, 2)


def disc_turn(points, radius):
    """Surface of a half-space under a turned disc (Reissner and Sagoci), for a turn of 1."""
    r = np.hypot(*points.T)
    ratio = np.minimum(radius / np.maximum(r, radius), 1.0)
    turned = 2.0 / np.pi * (np.arcsin(ratio) - ratio * np.sqrt(1.0 - ratio**2))
    return turned[:, None] * np.stack([-points[:, 1], points[:, 0]], axis=1)


def turned_disc(rotation=0.1):
    """What a sensor shows of a turned disc."""
    points = lattice(1.0, 9.5)
    moved = rotation * disc_turn(points, 4.0)
    flat = np.pad(points, ((0, 0), (0, 1)))
    inside = np.hypot(*points.T) < 3.0
    space, none = np.pad(moved, ((0, 0), (0, 1))), np.zeros(len(points))
    fields = Fields(flat + space, space, none, 0.0 * flat, none, inside, 0)
    return Contact(fields, as_seen=moved)


def test_a_thick_elastomer_with_markers_at_its_surface_needs_no_lifting():
    assert LayeredSoftness(0.5, np.inf).lifting(lattice(1.0)) is None
    softness = LayeredSoftness(0.5, np.inf).at(turned_disc())
    assert (softness.stiffness_ratio, softness.load_term) == (0.5, 0.0)
    # coth qh − 1 = 2e^{−2qh} + …: of the waves of a disc of 4 mm, hardly anything at h = 100 mm
    points = lattice(1.0, 9.5)
    lifting = LayeredSoftness(0.5, 100.0).lifting(points)
    inside = np.hypot(*points.T) < 3.0
    added = lifting.of(disc_turn(points, 4.0))
    assert abs(small_turn(points[inside], added[inside])) < 1e-3


def test_markers_below_the_centre_of_a_disc_are_lifted_to_the_surface():
    """A rigid fit of the inner 0.7 a misses 15 % at z = 0.1 a (φ falls by 4z/πa in the middle)."""
    points, radius, depth = lattice(0.5, 9.0), 5.0, 0.5
    q = np.linspace(1e-4, 60.0, 6000)
    # Hankel transform of the disc's u_θ/r: below the surface every wave counts with e^{−qz}
    wave = np.sin(q * radius) / q**2 - radius * np.cos(q * radius) / q
    r = np.hypot(*points.T)
    away, place = np.unique(r.round(9), return_inverse=True)

    weight = wave * np.exp(-q * depth) * (q[1] - q[0])
    around = np.array([j1(q * one) @ weight for one in away]) * 4.0 / np.pi
    surface = np.array([j1(q * one) @ (wave * (q[1] - q[0])) for one in away]) * 4.0 / np.pi
    inner = (r < 0.7 * radius) & (r > 0)
    np.testing.assert_allclose(surface[place][inner], r[inner], rtol=0.02)  # waves up to 60/mm
    unit = np.where(r > 0, around[place] / np.maximum(r, 1e-9), 0.0)
    moved = unit[:, None] * np.stack([-points[:, 1], points[:, 0]], axis=1)
    missed = 1.0 - small_turn(points[inner], moved[inner])
    assert missed == pytest.approx(0.15, abs=0.02)
    lifting = LayeredSoftness(0.0, np.inf, depth).lifting(points)
    lifted = small_turn(points[inner], (moved + lifting.of(moved))[inner])
    # of the singular rim, markers see no waves shorter than a pitch
    assert lifted == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(("share", "gain"), [(0.021, 1.017), (0.083, 1.079), (0.28, 1.33)])
def test_a_ball_gives_way_more_than_a_half_space(share, gain):
    """k_eff/k of two bodies of equal modulus, one of them a ball, by nonlinear finite elements.

    1.5 %: modes of the whole sphere stand for waves of its pole, and lengths are along its chord.
    Waves as long as the ball are cut at the edge of the markers, which lie up to 16 mm away.
    """
    points, radius = lattice(1.0, 16.0), 5.0
    moved, inside = disc_turn(points, radius), np.hypot(*points.T) < 0.9 * radius
    lifting = LayeredSoftness(1.0, np.inf, object_radius=radius / share).lifting(points)
    turned = small_turn(points[inside], (moved + lifting.of(moved))[inside])
    seen = small_turn(points[inside], moved[inside])
    assert 2.0 * turned / seen - 1.0 == pytest.approx(gain, rel=0.015)


@pytest.mark.parametrize(("pitch", "depth"), [(0.8, 0.0), (1.6, 0.0), (1.0, 0.5)])
def test_the_lift_of_a_ball_is_that_of_all_waves_at_any_pitch(pitch, depth):
    """Waves s⁴q e^{−(qs)²/2} of u_θ = r e^{−(r/s)²/2}, seen at a depth, by quadrature."""
    spread, radius, k = 3.0, 20.0, 1.0
    points = lattice(pitch, 14.0) + np.array([0.13, -0.21]) * pitch
    r = np.hypot(*points.T)
    q = np.linspace(1e-3, 3.0, 3000)
    waves = spread**4 * q * np.exp(-0.5 * (q * spread) ** 2) * (q[1] - q[0])

    def field(factor, at):
        return np.array([j1(q * one) @ (waves * factor * q) / one for one in at])

    moved = field(np.exp(-q * depth), r)[:, None] * np.stack([-points[:, 1], points[:, 0]], 1)
    lifting = LayeredSoftness(k, np.inf, depth, object_radius=radius).lifting(points)
    flat = LayeredSoftness(k, np.inf, depth).lifting(points)
    added = lifting.of(moved) - (flat.of(moved) if flat else 0.0)
    inside = r < spread
    gain = 1.5 / (np.maximum(q * radius, 2.5) - 1.5)
    wanted = field(k / (1.0 + k) * gain, r[inside])
    weight = r[inside] ** 2
    expected = weight @ wanted / weight.sum()
    # 3 %: markers end 14 mm from the axis; with the kernel's value at the marker itself it is 40 %
    assert small_turn(points[inside], added[inside]) == pytest.approx(expected, rel=0.03)


def shown_angle(softness, contact):
    """The object's angle in a frame, as `estimate_angles` makes it from the lifted markers."""
    points = (contact.fields.positions - contact.fields.displacement)[:, :2]
    inside, lifting = contact.fields.contact, softness.lifting(points)
    moved = contact.as_seen + (lifting.of(contact.as_seen) if lifting else 0.0)
    found = softness.at(contact)
    k = found.stiffness_ratio
    return (1.0 + k) * small_turn(points[inside], moved[inside]) - 0.5 * found.load_term


def test_a_plate_as_thick_as_the_gel_turns_as_a_half_space_on_a_half_space():
    contact = turned_disc()
    plate = LayeredSoftness(0.5, 4.0, object_height=4.0)
    both = LayeredSoftness(0.5, np.inf)
    assert shown_angle(plate, contact) == pytest.approx(shown_angle(both, contact), rel=1e-6)


def test_limits_of_a_cylinder():
    """A wide and high one is a half-space, a low one rigid, a long one has M H/(GJ) more."""
    contact = turned_disc()
    flat = shown_angle(LayeredSoftness(0.5, 4.0), contact)
    wide = LayeredSoftness(0.5, 4.0, object_height=300.0, object_side=300.0)
    assert shown_angle(wide, contact) == pytest.approx(flat, rel=1e-3)
    rigid = shown_angle(LayeredSoftness(0.0, 4.0), contact)
    heights = (4.0, 2.0, 1.0)  # a plate lower than the markers' pitch is not covered
    low = [shown_angle(LayeredSoftness(0.5, 4.0, object_height=high), contact) for high in heights]
    over = np.array(low) / rigid - 1.0
    # the waves of the singular rim are shorter than these heights
    assert (over[1:] < 0.85 * over[:-1]).all()
    assert over[-1] < 0.5 * over[0]
    # without height nothing is left of the bar
    assert abs(bar_compliance(6.0, 0.01, 5.0, 4.0)) < 1e-2 * bar_compliance(6.0, 6.0, 5.0, 4.0)
    turned = [
        shown_angle(LayeredSoftness(0.5, 4.0, object_height=height, object_side=6.0), contact)
        for height in (60.0, 90.0, 120.0)
    ]
    assert turned[2] - turned[1] == pytest.approx(turned[1] - turned[0], rel=1e-3)
    sharp, rounded = (
        shown_angle(
            LayeredSoftness(0.5, 4.0, object_height=3.0, object_side=6.0, object_edge=edge), contact
        )
        for edge in (0.0, 2.0)
    )
    assert 1.001 < rounded / sharp < 1.05
    assert bar_compliance(6.0, 1200.0, 5.0, 4.0) == pytest.approx(
        1200.0 / (0.5 * np.pi * 6.0**4), rel=5e-3
    )


def test_markers_give_the_moment_of_reissner_and_sagoci():
    radius, points = 4.0, lattice(1.0, 12.5)
    r, moved = np.hypot(*points.T), disc_turn(points, radius)
    turning = points[:, 0] * moved[:, 1] - points[:, 1] * moved[:, 0]
    weights = moment_weights(r, np.inf, 0.0, 1.15 * radius)
    # 3 %: of the singular rim, markers see no waves shorter than a pitch
    scale = small_turn(points[r < 0.5 * radius], moved[r < 0.5 * radius])
    assert weights @ turning == pytest.approx(16.0 / 3.0 * radius**3 * scale, rel=0.03)


@pytest.mark.parametrize(
    ("thickness", "poisson_ratio", "within"),
    [(4.0, 0.48, 0.05), (8.0, 0.48, 0.05), (4.0, 0.5, 0.2)],
)
def test_markers_give_the_force_of_a_pressed_layer(thickness, poisson_ratio, within):
    """A sphere of 20 mm on a layer, by the contact model with friction."""
    points = lattice(1.0, 9.5) + 0.2
    gel = Gel(0.2, poisson_ratio=poisson_ratio, thickness=thickness)
    grid = Grid((32, 32), (10.0, 10.0))  # of many tests, which share its compiled program
    pair = Pair(gel, Rigid(), Sphere(20.0), grid, 1.0)
    solved = solve_contact(pair, Pose(approach=0.08 * thickness))
    down = -np.asarray(solved.elastomer_displacement_at(points))[:, 2]
    radius = float(np.sqrt(np.count_nonzero(solved.contact) * grid.cell_area / np.pi))
    weights = force_weights(np.hypot(*points.T), thickness, 0.0, 1.15 * radius + 0.5)
    assert 0.2 * weights @ down == pytest.approx(-float(solved.force[2]), rel=within)


def test_a_bar_that_is_pressed_shorter_turns_less():
    """λ of a slender neo-Hookean bar; a low one, held at its end, is pressed less."""
    assert bar_shortening(5.0, 500.0, 0.04) == pytest.approx(0.96, abs=1e-5)
    assert bar_shortening(5.0, 2.5, 0.04) == pytest.approx(1.0 - 0.04 / 1.5)


def test_a_cylinder_is_pressed_only_where_markers_have_z():
    """Pressed, the angle changes and its interval is half as wide as without z."""
    contact = turned_disc()
    fields = contact.fields
    bowl = 0.1 * np.exp(-((np.hypot(*(fields.positions[:, :2]).T) / 3.0) ** 2))
    down = fields.displacement - bowl[:, None] * [0.0, 0.0, 1.0]
    pressed = contact._replace(fields=fields._replace(displacement=down))
    rod = LayeredSoftness(1.0, 8.0, object_height=40.0, object_side=5.0)
    without, shown = rod.at(contact), rod.at(pressed)
    assert shown_angle(rod, pressed) < shown_angle(rod, contact)
    ratio = np.diag(shown.covariance) / np.diag(without.covariance)
    assert ratio == pytest.approx(0.25, rel=0.1)
    flat = LayeredSoftness(1.0, 8.0)  # a half-space is not pressed shorter
    assert shown_angle(flat, pressed) == pytest.approx(shown_angle(flat, contact))


@pytest.mark.parametrize("reach", [3.0, 4.5])
def test_the_bar_is_that_of_its_modes_whatever_the_traction(reach):
    """τ ∝ r √(1 − r²/a²) instead of r, by quadrature: 3 %."""
    side, height = 5.0, 5.0
    r = reach * np.sin((np.arange(3000) + 0.5) / 3000 * np.pi / 2)
    steps = np.gradient(r)
    load = r**2 * np.sqrt(1.0 - (r / reach) ** 2) * steps
    lam = jn_zeros(2, 400) / side
    moment = 2.0 * np.pi * load @ r
    face = np.tanh(lam * height) * (j1(np.outer(lam, r)) @ load)
    face /= lam * 0.5 * (side * j1(lam * side)) ** 2
    q = np.linspace(1e-4, 60.0 / reach, 6000)
    plate = np.tanh(q * height) * (j1(np.outer(q, r)) @ load) * (q[1] - q[0])
    stuck = 0.8 * reach
    at = np.linspace(0.01, stuck, 300)
    turned = j1(np.outer(at, lam)) @ face - j1(np.outer(at, q)) @ plate
    turned += moment * height / (0.5 * np.pi * side**4) * at
    mean = turned @ at**2 / np.sum(at**3)
    assert bar_compliance(side, height, reach, stuck) == pytest.approx(mean / moment, rel=0.03)


def test_lifting_leaves_a_squeeze_as_it_is():
    points = lattice(1.0, 9.5)
    square = np.sum(points**2, axis=1)
    squeeze = points * np.exp(-0.5 * square / 3.0**2)[:, None]  # a gradient
    added = LayeredSoftness(1.0, 2.0).lifting(points).of(squeeze)
    # what is left is that of markers a pitch apart and of the edge
    assert np.abs(added).max() < 0.02 * np.abs(squeeze).max()


def test_longitudinal_waves_add_to_the_turn_of_long_contacts_only():
    """What a sheared gradient field lacks, against the layer's compliances at ν = ½ by FFT."""
    k, thickness, side, cells = 0.5, 2.0, 48.0, 192
    at = (np.arange(cells) - cells // 2) * (side / cells)
    x, y = np.meshgrid(at, at)
    potential = x * y * np.exp(-0.5 * (x**2 + y**2) / 3.0**2)
    along = 2.0 * np.pi * np.fft.fftfreq(cells, side / cells)
    qx, qy = np.meshgrid(along, along)
    q = np.maximum(np.hypot(qx, qy), 1e-9)
    w = np.minimum(q * thickness, 30.0)
    layer = 0.5 * (np.sinh(2 * w) + 2 * w) / (2.0 * q * (np.sinh(w) ** 2 + w**2 + 1.0))
    factors = 1j * qx, 1j * qy  # of a gradient
    wave = np.fft.fft2(potential)
    seen, lacking = (
        np.stack([np.fft.ifft2(f * part).real for f in factors], -1)
        for part in (wave, wave * (0.5 / q / layer - 1.0))  # a half-space's C_LL over the layer's
    )
    middle, pitch = cells // 2, round(cells / side)
    points, moved, lacks = (
        field[middle - 9 * pitch : middle + 10 * pitch : pitch,
              middle - 9 * pitch : middle + 10 * pitch : pitch].reshape(-1, 2)
        for field in (np.stack([x, y], -1), seen, lacking)
    )  # fmt: skip
    flat, none = np.pad(points, ((0, 0), (0, 1))), np.zeros(len(points))

    def turn(region):
        space = np.pad(moved, ((0, 0), (0, 1)))
        fields = Fields(flat + space, space, none, 0.0 * flat, none, region, 0)
        softness = LayeredSoftness(k, thickness).at(Contact(fields, stick=region, as_seen=moved))
        return -0.5 * softness.load_term

    long = (np.abs(points[:, 0]) < 1.5) & (np.abs(points[:, 1]) < 4.5)
    expected = k * small_turn(points[long], lacks[long])
    assert abs(expected) > 0.03  # of gradients of about 1
    assert turn(long) == pytest.approx(expected, rel=0.01)  # markers end 9 mm from the middle
    assert abs(turn(np.hypot(*points.T) < 4.5)) < 1e-9  # by symmetry
    assert turn(np.zeros(len(points), dtype=bool)) == 0.0  # nothing sticks, nothing turns


def grasp_of(recording, angle):
    unknown = np.full(len(recording), np.nan)
    reference = Reference(recording.time, angle, unknown, True, True, "stage")
    return Grasp(recording, reference, Noise.from_std(1e-3))


def test_gel_that_stands_still_under_the_object_tells_nothing_of_k():
    turned = np.radians(np.linspace(0.0, 12.0, 31))
    recording = lift(np.minimum(turned, np.radians(6.0)))
    angle = np.concatenate([np.full(5, np.nan), 1.5 * turned])
    fit = fit_layered_softness([grasp_of(recording, angle)], HALF_SPACE)
    # of the 15 frames; told over stretches in which the object turns 2°
    assert fit.grasps[0].excluded["in macro slip"] >= 13
    wild = angle + np.radians(20.0) * np.random.default_rng(0).normal(size=len(angle))
    with pytest.raises(ValueError, match="does not follow this object"):
        fit_layered_softness([grasp_of(recording, wild)], HALF_SPACE)
    assert fit.low < 0.5 < fit.high
    assert fit.softness.stiffness_ratio == pytest.approx(0.5, abs=0.01)


def test_a_number_k_is_what_a_layer_has_that_is_thick():
    """The same trials, lifted for a layer of 100 m and not at all: one k, one interval."""
    angles = np.radians(np.linspace(0.0, 8.0, 15))
    thin, deep = Layer(1e5), LayeredSoftness(0.5, 1e5)
    trials = []
    for lifted_for in (None, deep):
        trials.append([])
        for seed in (0, 1):
            recording = lift(angles, seed=seed, name=str(seed))
            error = 1e-3 * np.random.default_rng(seed).normal(size=len(recording))
            angle = np.concatenate([np.zeros(5), 1.5 * angles]) + error
            one = grasp_of(recording, angle)
            trials[-1] += make_trials(
                one.recording, one.reference, noise=one.noise, lifted_for=lifted_for
            )
    scalar = fit_softness(trials[0], model="none")
    layered = fit_softness(trials[1], layer=thin)
    for name in ("stiffness_ratio", "low", "high", "scatter"):
        # waves as long as the field of markers are lifted by their length over the thickness
        assert getattr(layered, name) == pytest.approx(getattr(scalar, name), rel=1e-4, abs=1e-6)
    variances = [fit.softness.covariance[0][0] for fit in (scalar, layered)]
    assert variances[1] == pytest.approx(variances[0], rel=1e-3)
    # what is known of the thickness stays as it is where the turns tell nothing of it
    free = fit_softness(trials[1], layer=thin._replace(thickness_error=10.0))
    assert free.stiffness_ratio == pytest.approx(layered.stiffness_ratio, rel=1e-6)
    assert free.softness.covariance[1][1] ** 0.5 == pytest.approx(10.0, rel=1e-3)


def test_layered_files(tmp_path):
    path = tmp_path / "soft.toml"
    covariance = ((1e-4, 1e-5, 0.0), (1e-5, 0.01, 0.0), (0.0, 0.0, 0.0))
    cylinder = {"object_height": 9.0, "object_side": 5.0}
    for sizes in ({}, {"object_radius": 20.0}, cylinder, {**cylinder, "object_edge": 1.5}):
        more = {**sizes, "provenance": {"object": "salmon"}}
        softness = LayeredSoftness(0.3, 4.0, 0.5, covariance, **more)
        write_softness(softness, path)
        assert read_softness(path) == softness
    path.write_text("format_version = 1\nkind = 'layered'\nstiffness_ratio = 0.3\n")
    with pytest.raises(ValueError, match="the key 'thickness_mm' is missing"):
        read_softness(path)
    with pytest.raises(ValueError, match="between 0 and the thickness"):
        LayeredSoftness(0.3, 1.0, 2.0)
    with pytest.raises(ValueError, match="object_height_mm is missing"):
        LayeredSoftness(0.3, 4.0, object_side=5.0)
    for sizes, message in (
        ({"object_height": 9.0}, "only a cylinder with a flat face has one"),
        ({**cylinder, "object_radius": 20.0}, "only a cylinder with a flat face has one"),
        ({**cylinder, "object_side": 2.5}, "at most half of the side's radius, 2.5 mm"),
    ):
        with pytest.raises(ValueError, match=message):
            LayeredSoftness(0.3, 4.0, object_edge=1.5, **sizes)


def test_errors_of_k_thickness_and_depth_widen_the_interval():
    contact = turned_disc()
    assert LayeredSoftness(0.5, 4.0, 0.3).at(contact).covariance == ((0.0, 0.0), (0.0, 0.0))
    covariance = ((4e-4, 0.0, 0.0), (0.0, 0.04, 0.0), (0.0, 0.0, 0.01))
    found = LayeredSoftness(0.5, 4.0, 0.3, covariance).at(contact)
    points = (contact.fields.positions - contact.fields.displacement)[:, :2]
    inside = contact.fields.contact

    def angle(k, thickness, depth):
        lifting = LayeredSoftness(k, thickness, depth).lifting(points)
        moved = contact.as_seen + lifting.of(contact.as_seen)
        return (1.0 + k) * small_turn(points[inside], moved[inside])

    at, step = np.array([0.5, 4.0, 0.3]), 1e-3
    slopes = [(angle(*(at + d)) - angle(*(at - d))) / (2 * step) for d in step * np.eye(3)]
    expected = np.array(slopes) ** 2 @ np.diag(covariance)
    gel = angle(*at) / 1.5
    gradient = np.array([gel, -0.5])
    # 1e-2: finite differences
    assert gradient @ np.array(found.covariance) @ gradient == pytest.approx(expected, rel=1e-2)
    with pytest.raises(ValueError, match="0 grasps"):
        fit_layered_softness([], Layer(4.0))


def test_the_part_of_a_ball_is_known_to_eight_per_cent():
    k, contact = 0.5, turned_disc()
    points = (contact.fields.positions - contact.fields.displacement)[:, :2]
    inside = contact.fields.contact
    added = LayeredSoftness(k, np.inf, object_radius=20.0).lifting(points).of(contact.as_seen)
    part = (1.0 + k) * small_turn(points[inside], added[inside])
    found = LayeredSoftness(k, np.inf, object_radius=20.0).at(contact)
    assert 0.5 * np.sqrt(found.covariance[1][1]) == pytest.approx(0.08 * abs(part))
    assert found.covariance[0] == (0.0, 0.0)


def test_lengths_in_px_and_sizes_in_mm_are_refused():
    recording, truth = simulate_pivot(angles_deg=(0.0, 4.0), frames=(4,))
    pixels = replace(recording, unit="px", name="clip")
    known = 1e-3 + 0.0 * recording.time
    stage = Reference(recording.time, truth.angle, known, True, True, "stage")
    with pytest.raises(ValueError, match=r"clip: lengths are in px, but .* give the scale"):
        fit_layered_softness([Grasp(pixels, stage)], Layer(3.0))
    thin = Settings(softness=LayeredSoftness(0.5, 3.0))
    with pytest.raises(ValueError, match=r"clip: lengths are in px, but .* give the scale"):
        Stream(pixels, thin)
    assert Stream(recording, thin)


@pytest.mark.parametrize(
    ("angle", "message"),
    [
        (lambda phi: -1.5 * phi, "turns the other way"),
        (lambda phi: np.degrees(1.5 * phi), "seems to be in degrees"),
        (lambda phi: np.radians(1.5 * phi), "seems to be in rad"),
        (lambda phi: 0.5 * phi, "no object turns less"),
    ],
)
def test_references_that_are_not_the_objects_angle_are_told(angle, message):
    phi, unknown = np.radians(np.linspace(1.0, 8.0, 20)), np.full(20, np.nan)
    time = np.arange(20.0)

    def fit(phi, theta):
        reference = Reference(time, theta, unknown, True, True, "stage")
        error = np.full(20, 1e-4)
        trial = Trial("a", "ball", 0.0, time, phi, error, unknown, unknown, reference, {})
        return fit_softness([trial], layer=HALF_SPACE)

    with pytest.raises(ValueError, match=message):
        fit(phi, angle(phi))
    with pytest.raises(ValueError, match="at one angle"):
        fit(0.0 * phi + phi[0], 1.5 * phi)
    assert fit(phi, 1.5 * phi).stiffness_ratio == pytest.approx(0.5)
