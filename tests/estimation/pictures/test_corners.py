"""X-corners in pictures: placed where they belong, or not at all."""

import cv2
import numpy as np
import pytest

from estimation.pictures.corners.fit import CornerStyle, find_corners
from estimation.pictures.corners.pattern import Pattern
from estimation.pictures.corners.reader import measure_rotation
from estimation.pictures.corners.tracking import CornerTracker
from estimation.pictures.lattice import lattice_neighbours
from estimation.pictures.lines import rotation_of_edges, rotation_of_lines
from estimation.pictures.reader import ImageSettings
from estimation.pictures.sensor import Sensor
from estimation.sources import read_recording
from tests.estimation.pictures.boards import CAMERA, CODED, PITCH, PLAIN, identities, scene, twist
from tests.estimation.pictures.scenes import expect_same_answers, picture, twisted
from tests.estimation.pictures.test_reading import write_folder


@pytest.fixture(scope="module")
def coded():
    return scene(CODED, twist(0.0))


@pytest.fixture(scope="module")
def plain():
    return scene(PLAIN, twist(0.0))


def wrong(tracker, rest, now, seen):
    """How many of the corners that were recognised are another's."""
    number, known = identities(rest, tracker), np.isfinite(seen.position[:, 0])
    off = np.linalg.norm(seen.position[known] - now.position[number[known]], axis=1)
    return int((off > 1.0).sum()), int(known.sum())


def test_corners_and_edges_of_a_sheared_pattern():
    shear = np.array([[1.0, 0.3], [0.05, 0.9]])
    now = scene(PLAIN, lambda points: points @ shear.T, camera=CAMERA._replace(noise=0.5))
    corners = find_corners(now.image.astype(np.float32), CornerStyle(22.0))
    assert len(corners.position) >= 90  # of 108, some beyond the picture's side
    off = np.linalg.norm(corners.position[:, None] - now.position, axis=-1)
    # 0.0022 px is the bound at this noise; the grid of the rendering adds to it
    assert off.min(axis=1).max() < 0.02
    angle = now.angles[off.argmin(axis=1)]
    error = (np.sort(corners.angles % np.pi, axis=1) - np.sort(angle % np.pi, axis=1)) % np.pi
    error = np.minimum(error, np.pi - error)
    assert np.degrees(error).max() < 0.3  # the expansion in the skew is good to a quarter degree
    assert np.median(corners.contrast) == pytest.approx(CAMERA.contrast, rel=0.02)


@pytest.mark.parametrize("degrees", [5.0, 25.0, -25.0])
def test_a_jump_keeps_every_identity(coded, plain, degrees):
    for pattern, rest in ((CODED, coded), (PLAIN, plain)):
        tracker = CornerTracker.learn(rest.image)
        now = scene(pattern, twist(degrees), seed=1)
        seen = tracker.find(now.image)
        assert not seen.flaw
        mistaken, known = wrong(tracker, rest, now, seen)
        assert mistaken == 0
        assert known >= 100


def test_a_code_tells_the_place_after_any_motion(coded):
    tracker = CornerTracker.learn(coded.image)
    for turn, shift in ((0.0, (2 * PITCH, 2 * PITCH)), (100.0, (0.5, -0.3))):
        now = scene(CODED, twist(turn, rigid=50.0, still=60.0, shift=shift), seed=2)
        seen = tracker.find(now.image)
        mistaken, known = wrong(tracker, coded, now, seen)
        assert mistaken == 0
        assert known >= 50
        rotation = measure_rotation(
            lattice_neighbours(tracker.plan.cells.corner), tracker.rest, seen
        )
        assert np.degrees(np.nanmedian(rotation.angle)) == pytest.approx(turn, abs=0.02)


def test_a_plain_pattern_that_may_have_moved_by_its_period_is_refused(plain):
    tracker = CornerTracker.learn(plain.image)
    assert "goes unnoticed" in tracker.describe()
    for steps in ((1, 1), (2, 0), (3, -1)):
        shift = tuple(PITCH * one for one in steps)
        now = scene(PLAIN, twist(0.0, shift=shift), seed=3)
        assert "is ambiguous" in tracker.find(now.image).flaw


def test_torn_and_covered_patterns_lose_no_identity(coded):
    tracker = CornerTracker.learn(coded.image)
    now = scene(CODED, twist(15.0), seed=4)
    torn = now.image.copy()
    torn[:, 150:] = np.roll(now.image, 31, axis=0)[:, 150:]  # the right part has slid along a tear
    torn[:31, 150:] = 128
    moved = now._replace(
        position=now.position + (now.position[:, :1] > 150) * np.array([0.0, 31.0])
    )
    seen = tracker.find(torn)
    mistaken, known = wrong(tracker, coded, moved, seen)
    assert mistaken == 0
    assert known >= 60
    covered = now.image.copy()
    cv2.circle(covered, (100, 80), 60, 30, -1)
    seen = tracker.find(covered)
    mistaken, known = wrong(tracker, coded, now, seen)
    assert mistaken == 0
    assert 60 <= known <= 95
    covered[:, 60:] = 128
    assert "corners were recognised" in tracker.find(covered).flaw


def test_edges_that_bend_are_allowed_for(coded, monkeypatch):
    tracker = CornerTracker.learn(coded.image)
    now, number = scene(CODED, twist(15.0), seed=4), identities(coded, tracker)
    error = []
    for straight in (False, True):
        if straight:
            monkeypatch.setattr(CornerTracker, "_unbend", lambda self, seen, style: seen.position)
        off = tracker.find(now.image).position - now.position[number]
        error.append(np.sqrt(np.nanmean(off**2)))
    # the curvature is that over two cells, and changes within them: half the bias goes
    assert error[0] < 0.6 * error[1]
    assert error[0] < 0.06


def test_edges_and_lines_are_fused_by_their_variances(coded):
    tracker = CornerTracker.learn(coded.image)
    neighbours = lattice_neighbours(tracker.plan.cells.corner)
    now = scene(CODED, twist(7.0, rigid=50.0, still=60.0), seed=5)
    seen = tracker.find(now.image)
    edges = rotation_of_edges(
        tracker.rest.heading, seen.heading, tracker.rest.heading_variance + seen.heading_variance
    )
    lines = rotation_of_lines(
        neighbours, tracker.rest.position, seen.position, tracker.rest.variance + seen.variance
    )
    fused = measure_rotation(neighbours, tracker.rest, seen)
    known = np.isfinite(fused.angle)
    errors = [one.angle[known] - np.radians(7.0) for one in (edges, lines, fused)]
    for one, error in zip((edges, lines, fused), errors, strict=True):
        claimed = np.sqrt(np.mean(one.variance[known]))
        # about 100 angles, neighbouring lines share corners: scatter known to some 12 %
        assert np.sqrt(np.mean(error**2)) == pytest.approx(claimed, rel=0.35)
    assert (fused.variance <= np.minimum(edges.variance, lines.variance)).all()
    assert np.std(errors[2]) < 1.02 * np.std(errors[1]) < np.std(errors[0])


def test_run_reads_a_checkerboard(coded, tmp_path):
    angles = (0.0, 0.0, 2.0, 4.0, 6.0)
    images = [scene(CODED, twist(angle), seed=i).image for i, angle in enumerate(angles)]
    images[1] = np.zeros_like(images[1])
    covered = images[-1].copy()
    covered[70:170, 110:210] = 128  # the middle of the contact, where it would stick
    torn = images[-1].copy()
    torn[:, 150:] = np.roll(torn, 15, axis=0)[:, 150:]
    folder = write_folder(tmp_path / "board", [*images, covered, torn])
    settings = ImageSettings(Sensor(mm_per_px=CAMERA.mm_per_px, marker="corners"))
    recording = read_recording(folder, settings)
    assert recording.layout.grid_shape in ((9, 12), (12, 9))
    assert recording.flaws[1] == "the picture is black"
    assert "contact's centre is visible" in recording.flaws[5]
    assert "torn" in recording.flaws[6]
    assert "code" in " ".join(recording.notes)
    middle = (
        np.linalg.norm(recording.layout.reference - 0.04 * np.array([159.5, 119.5]), axis=1) < 0.9
    )
    turned = np.degrees(recording.rotation[2:5, middle].mean(axis=1))
    # 4 corners turned rigidly, each good to 0.015°; lines to neighbours reach beyond them
    assert turned == pytest.approx(angles[2:], rel=0.05)
    expect_same_answers(recording, tmp_path / "board.npz")


def test_what_is_no_checkerboard_is_refused():
    for image in (
        picture(twisted(0.0), np.random.default_rng(0)),
        np.full((240, 320), 90, np.uint8),
    ):
        with pytest.raises(ValueError, match="no checkerboard"):
            CornerTracker.learn(image)
    small = scene(Pattern((2, 3), PITCH), twist(0.0)).image
    with pytest.raises(ValueError, match="no checkerboard"):
        CornerTracker.learn(small)
