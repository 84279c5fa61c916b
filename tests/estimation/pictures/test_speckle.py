"""Speckle in pictures: found again to its bound after any motion, or not at all."""

import cv2
import numpy as np
import pytest

from estimation.frames.state import load_state, save_state
from estimation.pictures.reader import ImageSettings
from estimation.pictures.render import project_discs, render_dots, scatter_speckle
from estimation.pictures.sensor import Sensor
from estimation.pictures.speckle.reader import SpeckleReader
from estimation.pictures.speckle.subsets import Sampler, make_subsets, match_subsets, polar_angle
from estimation.pictures.speckle.tracking import SpeckleTracker
from estimation.pictures.stream import Picture
from estimation.sources import read_recording
from tests.cases import find_published
from tests.estimation.pictures.boards import PLAIN, scene, twist
from tests.estimation.pictures.scenes import expect_same_answers, picture, real, twisted
from tests.estimation.pictures.speckles import CAMERA, RADIUS, Motion, speckle, whole
from tests.estimation.pictures.test_reading import write_folder


@pytest.fixture(scope="module")
def rest():
    return speckle(Motion())


@pytest.fixture(scope="module")
def tracker(rest):
    return SpeckleTracker(rest.astype(np.float32))


def find(tracker, image):
    """The match in a picture that nothing came before."""
    tracker.last = None
    return tracker.find(image.astype(np.float32))


def errors(tracker, match, motion):
    """Distances of the recognised points from where they are [px]."""
    truth = motion.of_pixels(tracker.lattice.centre)
    return np.linalg.norm(match.position - truth, axis=1)[match.good]


def test_subsets_reach_their_bound():
    """Position and rotation of a rigid motion, against the Cramér–Rao bound of two noisy pictures.

    The bound takes the grey levels' slopes from pictures without noise; unknown are the six of the
    motion, contrast and level.
    """
    motion = whole(2.0, (0.3, -0.4))
    clean = speckle(Motion(), camera=CAMERA._replace(noise=0.0)).astype(np.float32)
    before = speckle(Motion(), seed=1).astype(np.float32)
    after = speckle(motion, seed=2).astype(np.float32)
    x, y = np.meshgrid(np.arange(24, 300, 21), np.arange(24, 220, 21))
    centre = np.stack([x.ravel(), y.ravel()], axis=1)
    radius = 10
    noise = np.sqrt(2.0 * (CAMERA.noise**2 + 1.0 / 12.0))  # of two pictures, rounded
    bound = noise**2 * make_subsets(clean, centre, radius).unit
    truth, turn = motion.of_pixels(centre), np.radians(2.0)
    off = np.random.default_rng(3).normal(0.0, 0.3, truth.shape)
    guess = np.tile(np.eye(2), (len(centre), 1, 1))
    match = match_subsets(make_subsets(before, centre, radius), Sampler(after), truth + off, guess)
    assert match.good.mean() > 0.97
    error, spun = (match.position - truth)[match.good], polar_angle(match.deformation)[match.good]
    limit = np.sqrt(bound[match.good, :2, :2].trace(axis1=1, axis2=2))
    share = np.sqrt(np.mean((np.linalg.norm(error, axis=1) / limit) ** 2))
    assert share < 1.2  # 260 coordinates: known to 4.5 %
    assert (
        np.abs(error.mean(axis=0)).max() < 0.003
    )  # a third of the noise; its mean scatters 0.0007
    slope = np.array([0.0, -0.5, 0.5, 0.0])
    spin_limit = np.sqrt(np.einsum("i,nij,j->n", slope, bound[match.good, 2:, 2:], slope))
    assert np.sqrt(np.mean(((spun - turn) / spin_limit) ** 2)) < 1.25  # 130 angles: 6 %
    claimed = np.sqrt(match.covariance[match.good, :2, :2].trace(axis1=1, axis2=2))
    assert np.mean(claimed / limit) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    "motion",
    [whole(5.0), whole(0.0, (30.0, -20.0)), whole(100.0, (10.0, 5.0))],
    ids=["turn", "shift", "any"],
)
def test_a_jump_of_the_whole_is_followed(tracker, motion):
    match, flaw = find(tracker, speckle(motion, seed=3))
    assert not flaw
    assert match.good.mean() > 0.6  # the rest is out of view
    assert errors(tracker, match, motion).max() < 0.04  # four sigma of a coordinate, 0.007 px


@pytest.mark.parametrize("degrees", [10.0, 30.0])
def test_a_jump_of_the_middle_is_followed(tracker, degrees):
    motion = Motion(degrees)
    match, flaw = find(tracker, speckle(motion, seed=4))
    assert not flaw
    assert match.good.mean() > 0.5
    # a subset that shears takes the mean of what is in it: the ring turns by 30° over 58 px
    assert errors(tracker, match, motion).max() < 2.0
    arm = np.linalg.norm(tracker.lattice.centre - [159.5, 119.5], axis=1)
    inner = match.good & (arm < motion.rigid - 1.5 * tracker.style.radius)
    assert inner.sum() > 10
    turned = np.degrees(polar_angle(match.deformation[inner])) - degrees
    assert np.abs(turned).max() < 0.25  # four sigma of a subset, 0.05°


def test_a_tracker_resumes_from_its_saved_state(rest):
    tracker = SpeckleTracker(rest.astype(np.float32))
    assert tracker.find(np.full(rest.shape, 128.0, dtype=np.float32))[1]  # features are tried too
    resumed = load_state(save_state(tracker))
    now = speckle(Motion(10.0), seed=4).astype(np.float32)
    (after, _), (expected, _) = (one.find(now) for one in (resumed, tracker))
    assert expected.good.mean() > 0.5
    for value, other in zip(after, expected, strict=True):
        assert np.array_equal(value, other, equal_nan=value.dtype != bool)


def test_torn_covered_and_saturated_patterns_lose_no_identity(tracker):
    motion = Motion(12.0)
    now = speckle(motion, seed=5)
    torn = now.copy()
    torn[:, 150:] = np.roll(now, 31, axis=0)[:, 150:]  # the right part has slid along a tear
    torn[:31, 150:] = 128
    match, flaw = find(tracker, torn)
    truth = motion.of_pixels(tracker.lattice.centre)
    truth[:, 1] += 31.0 * (truth[:, 0] > 149.5)
    off = np.linalg.norm(match.position - truth, axis=1)[match.good]
    assert not flaw
    beside = np.abs(truth[match.good, 0] - 149.5) < tracker.style.radius
    assert off[~beside].max() < 1.0
    assert match.good.sum() > 200
    covered = now.copy()
    cv2.circle(covered, (100, 80), 60, 30, -1)
    match, flaw = find(tracker, covered)
    under = np.linalg.norm(truth - [100, 80], axis=1) < 50
    assert not flaw
    assert not match.good[under].any()
    assert errors(tracker, match, motion).max() < 1.0
    bright = now.copy()
    bright[60:180, 100:220] = 255
    match, flaw = find(tracker, bright)
    assert not flaw
    assert errors(tracker, match, motion).max() < 1.0


def test_a_tear_is_said(rest):
    settings = ImageSettings(Sensor(marker="speckle"), unloaded=0)
    reader = SpeckleReader(Picture(rest, 0.0, 0), settings)
    for degrees in (12.0, 30.0):
        assert not reader.read(Picture(speckle(Motion(degrees), seed=5), 0.0, 1)).flaw
    now = speckle(Motion(12.0), seed=5)
    for shift in (15, 46):  # one pitch, and far beyond the reach of a subset
        torn = now.copy()
        torn[:, 150:] = np.roll(now, shift, axis=0)[:, 150:]
        torn[:shift, 150:] = 128
        assert "the pattern is torn" in reader.read(Picture(torn, 0.0, 2)).flaw


def test_another_pattern_and_noise_are_not_recognised(tracker):
    rng = np.random.default_rng(6)
    other = scatter_speckle((16.0, 12.8), RADIUS, 0.45, rng)
    images = (
        render_dots(CAMERA, *project_discs(CAMERA, Motion(), other, RADIUS), rng),
        rng.integers(0, 255, (CAMERA.height, CAMERA.width)),
        np.full((CAMERA.height, CAMERA.width), 128),
    )
    for image in images:
        assert "were recognised" in find(tracker, image)[1]


def test_a_place_that_is_there_twice_is_left_out(rest):
    twice = rest.copy()
    twice[20:100, 20:110] = rest[130:210, 180:270]
    lattice = SpeckleTracker(twice.astype(np.float32)).lattice
    assert lattice.left_out["ambiguous"] > 10
    x, y = lattice.centre.T
    assert not ((x > 40) & (x < 90) & (y > 40) & (y < 80)).any()
    repeated = np.tile(rest[:60, :80], (4, 4))
    with pytest.raises(ValueError, match=r"repeats every (60|80|100)"):
        SpeckleTracker(repeated.astype(np.float32))


def test_run_reads_speckle(rest, tmp_path):
    angles = (0.0, 3.0, 6.0, 4.0)
    images = [rest, *(speckle(Motion(a), seed=i) for i, a in enumerate(angles) if i)]
    images[3] = np.zeros_like(rest)
    settings = ImageSettings(Sensor(marker="speckle", mm_per_px=CAMERA.mm_per_px))
    recording = read_recording(write_folder(tmp_path / "speckle", images), settings)
    assert recording.flaws[3] == "the picture is black"
    assert "angles count from it" in " ".join(recording.notes)
    from_middle = recording.layout.reference - CAMERA.mm_per_px * np.array([159.5, 119.5])
    middle = np.linalg.norm(from_middle, axis=1) < 30 * CAMERA.mm_per_px
    for frame in (1, 2):
        turned = np.degrees(recording.rotation[frame, middle])
        assert turned == pytest.approx(angles[frame], abs=0.1)  # 0.02° each, lines reach 44 px
    expect_same_answers(recording, tmp_path / "speckle.npz")


def test_the_kind_of_markers_is_found_out(rest, tmp_path):
    rng = np.random.default_rng(7)
    pictures = {
        "corners": scene(PLAIN, twist(0.0)).image,
        "dots": picture(twisted(0.0), rng),
        "speckle": rest,
    }
    for kind, image in pictures.items():
        recording = read_recording(write_folder(tmp_path / kind, [image]))
        assert f"detected: {kind}" in recording.notes[0]
    assert "no checkerboard" in recording.notes[0]
    flat = rng.normal(128.0, 2.0, (240, 320)).astype(np.uint8)
    with pytest.raises(ValueError, match=r"no markers.*corners.*dots.*speckle.*into view later"):
        read_recording(write_folder(tmp_path / "none", [flat]))


def test_the_published_speckle_is_tracked_from_still_to_still():
    folder = real("unical-stills", "DM-Tac")
    recording = read_recording(folder, ImageSettings(Sensor(marker="speckle")))
    assert "black or white" in recording.notes[0]  # the saturated patch
    assert not any(recording.flaws)
    assert recording.valid[1:].mean(axis=1).min() > 0.8
    still = np.linalg.norm(recording.layout.reference - [290.0, 232.0], axis=1) < 60
    assert not still.any()  # the patch of the first still
    for name in ("GelSight", "9DTact"):
        with pytest.raises(ValueError, match="no markers were detected"):
            read_recording(folder.parent / name)


def test_the_published_rigid_plate_moves_as_published():
    folder = find_published("pyvale-rigid-plate")
    before, *after = (
        cv2.imread(str(folder / f"rigid_cam0_frame{n:02d}.tiff"), cv2.IMREAD_GRAYSCALE)
        for n in (0, 25, 50)
    )
    tracker = SpeckleTracker(before.astype(np.float32))
    for image, moved in zip(after, (25.0, 50.0), strict=True):
        match, flaw = find(tracker, image)
        assert not flaw
        shift = (match.position - tracker.lattice.centre)[match.good]
        assert len(shift) > 100
        assert np.abs(shift - [moved, -moved]).max() < 0.05  # what is asked for; measured 0.0003
        assert np.degrees(np.abs(polar_angle(match.deformation[match.good]))).max() < 0.02
