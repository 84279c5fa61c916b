"""Clips drawn by the renderer show what their truth says."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from contactmodel import (
    Contact,
    Grid,
    HalfSpace,
    Pose,
    Rigid,
    Sphere,
    SquarePunch,
    make_path,
)
from estimation.estimators.result import State
from estimation.pictures.dots.find import DotStyle
from estimation.pictures.dots.style import find_dots
from estimation.pictures.light import to_grey
from estimation.pictures.render import Camera
from estimation.pictures.stream import read_pictures
from estimation.virtual.clip import Scene, VirtualClip, write_pictures
from estimation.virtual.relief import make_relief

FRICTION, APPROACH = 0.25, 0.6
SLID = Pose(APPROACH, (0.6, 0.3), np.radians(20.0))
PATH = make_path(
    [Pose(0.0), Pose(0.0), Pose(APPROACH), SLID, SLID, Pose(0.0, (0.6, 0.3), SLID.twist)],
    [1, 1, 8, 2, 2],
)
PRESSED, LAST, EMPTY = 1, 11, 13
"""Frames: before it moves, the last one in full contact, and the pad when it is empty again."""
SCENE = Scene(
    contact=Contact(
        HalfSpace(0.2, 0.5), Rigid(), Sphere(12.0), Grid((32, 32), (14.0, 14.0)), FRICTION
    ),
    path=PATH,
    centre=(0.7, -0.4),
    dot_angle=0.1,
    camera=Camera(108, 84, 0.1, background=125.0, contrast=95.0, noise=1.0),
)


@pytest.fixture(scope="module")
def clip():
    return VirtualClip(SCENE)


def test_the_truth_begins_with_the_contact_and_ends_with_it(clip):
    truth = clip.truth
    assert len(clip) == 14
    assert np.isnan(truth.angle[[0, EMPTY]]).all()
    assert truth.state[0] == truth.state[EMPTY] == State.NO_CONTACT
    assert np.degrees(truth.angle[[PRESSED, LAST]]) == pytest.approx([0.0, 20.0])
    np.testing.assert_allclose(truth.shift[LAST], [0.6, 0.3], atol=1e-6)


def test_gel_sticks_then_slips_then_rests(clip):
    truth = clip.truth
    sticking = np.flatnonzero(truth.stick_ratio > 0.2)
    moving = sticking[(sticking > PRESSED) & (sticking < truth.onset)]
    assert len(moving)
    # what sticks turns as the object does; the solver's residual is 1e-5
    np.testing.assert_allclose(truth.gel_angle[moving], truth.angle[moving], rtol=1e-3)
    assert truth.slip[moving].max() < 1e-4  # of 0.6 mm
    assert truth.onset is not None
    assert truth.state[truth.onset] == State.MACRO_SLIP
    assert truth.slip_angle[LAST] > np.radians(5.0)
    assert truth.state[LAST] == State.STICK  # at rest all that touches does


def test_friction_limits_the_shear_and_falls_to_its_share():
    slid = Pose(APPROACH, (3.0, 0.0))
    path = make_path([Pose(0.0), Pose(APPROACH), slid], [1, 8])
    for kinetic in (1.0, 0.6):
        clip = VirtualClip(replace(SCENE, path=path, kinetic=kinetic, weakening=0.05))
        x, _, z = clip.truth.force[-1]
        # all slides; after 2 mm the fall is complete but for e^-40
        assert x == pytest.approx(kinetic * FRICTION * -z, rel=1e-3)
    gel, slip = clip.truth.gel_shift[-1, 0], clip.truth.slip[-1]
    # where it has slipped least the gel has gone furthest: object = gel + slip there
    assert gel + slip == pytest.approx(3.0, abs=0.01)


def test_dots_lie_where_the_gel_has_taken_them(clip):
    radius = SCENE.dot_radius / SCENE.camera.mm_per_px
    found = find_dots(to_grey(clip.draw(LAST), True), DotStyle(True, radius)).centre
    moved = SCENE.camera.project(clip.dots + clip.moved(LAST, clip.dots))
    inside = (moved > 6.0).all(axis=1) & (moved < np.array([101.0, 77.0])).all(axis=1)
    nearest = np.linalg.norm(found[:, None] - moved[inside], axis=2).min(axis=0)
    assert inside.sum() > 15
    # dots of 3 px on shaded ground; some tenths where an edge of the print passes
    assert np.median(nearest) < 0.1
    assert np.linalg.norm(clip.moved(LAST, clip.dots), axis=1).max() > 0.15  # mm


def taken_along(clip, field, frame):
    """A field of the first picture in contact, moved as the object has moved."""
    camera, truth = SCENE.camera, clip.truth
    axis = camera.project(np.array([SCENE.centre]))[0]
    turn = cv2.getRotationMatrix2D(tuple(axis), -np.degrees(truth.angle[frame]), 1.0)
    turn[:, 2] += truth.shift[frame] / camera.mm_per_px
    return cv2.warpAffine(field, turn, (camera.width, camera.height), flags=cv2.INTER_CUBIC)


def alike(one, other):
    """Correlation in the middle of the view."""
    inner = slice(14, 62), slice(33, 89)
    return np.corrcoef(one[inner].ravel(), other[inner].ravel())[0, 1]


def test_the_print_goes_with_the_object_and_not_with_the_gel(clip):
    before, now = (clip.relief_at(frame) for frame in (PRESSED, LAST))
    assert alike(taken_along(clip, before, LAST), now) > 0.99
    assert alike(before, now) < 0.6


def direction(clip, frame):
    """Direction of the square face in a frame, up to quarter turns [deg]."""
    height = clip.height(frame)
    face = np.clip(height / height.max() - 0.5, 0.0, 0.2)
    y, x = np.indices(face.shape)
    arm = x + 1j * y
    arm = arm - np.average(arm, weights=face)
    return np.degrees(np.angle(np.sum(face * arm**4))) / 4.0


@pytest.mark.parametrize("friction", [5.0, 0.2])
def test_the_face_turns_with_the_object_whether_the_gel_follows_or_not(friction):
    """The contact is solved on cells of the gel, whose steps and slips no picture must show."""
    ball = SCENE.contact
    grid = Grid((32, 32), (19.0, 19.0))
    cube = Contact(ball.elastomer, ball.object_, SquarePunch(4.0, 0.5), grid, friction)
    turned = Pose(0.4, twist=np.radians(10.0))
    scene = replace(SCENE, contact=cube, path=make_path([Pose(0.0), Pose(0.4), turned], [1, 4]))
    clip = VirtualClip(replace(scene, relief="smooth", camera=Camera(216, 168, 0.05)))
    for frame in (1, 2, 3, 4):
        turn = (direction(clip, frame) - direction(clip, 0)) % 90.0
        assert turn == pytest.approx(np.degrees(clip.truth.angle[frame]), abs=0.7)


def test_an_empty_pad_is_the_unloaded_one_and_a_print_is_seen(clip):
    rest, printed, empty = (clip.draw(frame).astype(float) for frame in (0, PRESSED, EMPTY))
    # noise of two pictures
    assert np.abs(empty - rest).mean() == pytest.approx(2.0 / np.sqrt(np.pi), rel=0.1)
    middle = slice(30, 54), slice(45, 75)
    assert np.abs(printed - rest)[middle].mean() > 5.0


def test_a_clip_that_starts_loaded_is_the_rest_of_one_that_does_not(clip):
    late = VirtualClip(replace(SCENE, first=6))
    assert len(late) == 8
    np.testing.assert_allclose(late.truth.angle, clip.truth.angle[6:])
    assert late.truth.angle[0] > 0.0
    difference = late.draw(0).astype(float) - clip.draw(6)
    assert np.abs(difference).mean() < 1.5  # noise of another picture


def test_a_written_clip_is_read_as_pictures(tmp_path):
    late = VirtualClip(replace(SCENE, first=10))
    write_pictures(late, tmp_path / "clip")
    pictures = list(read_pictures(tmp_path / "clip"))
    assert [picture.number for picture in pictures] == [0, 1, 2, 3]
    assert pictures[3].time == pytest.approx(3 / SCENE.rate)
    assert np.array_equal(pictures[1].image, late.draw(1))


@pytest.mark.parametrize("kind", ["texture", "edges", "stripes"])
def test_a_relief_is_as_steep_as_asked(kind):
    relief = make_relief(kind, 0.1, 12.0, 0.03, np.random.default_rng(1))
    steepness = np.hypot(*np.gradient(relief.height, relief.step))
    assert 0.1 < steepness.max() < 0.5


def test_wrong_scenes_are_refused():
    with pytest.raises(ValueError, match="a path of two poses"):
        replace(SCENE, first=20)
    with pytest.raises(ValueError, match="share from 0 to 1"):
        replace(SCENE, kinetic=1.2)
    with pytest.raises(ValueError, match="unknown relief 'wood'"):
        make_relief("wood", 0.1, 12.0, 0.03, np.random.default_rng(1))
