"""Marks on the gel, and uneven light, in grey pictures of a print."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from estimation.pictures.imprint.follower import ImprintFollower
from estimation.pictures.imprint.marks import find_marks
from estimation.pictures.imprint.painted import paint_out
from estimation.pictures.imprint.registration import Keyframe, register
from estimation.pictures.imprint.settings import ImprintSettings
from estimation.pictures.imprint.texture import Texture, cut_out
from tests.estimation.pictures import scenes

SIZE = 160, 120
MIDDLE = 80.0, 60.0
MASK = cv2.ellipse(np.zeros(SIZE[::-1], np.uint8), (80, 60), (62, 45), 0.0, 0.0, 360.0, 255, -1)
STILL = np.eye(2, 3, dtype=np.float32)


def pattern(seed, width):
    """A rough plane of the pictures' size, whose features have a width [px]."""
    rough = np.random.default_rng(seed).normal(size=SIZE[::-1]).astype(np.float32)
    smooth = cv2.GaussianBlur(rough, (0, 0), width)
    return smooth / smooth.std()


def move(degrees, shift):
    """A motion about the middle, counted as the follower does."""
    motion = cv2.getRotationMatrix2D(MIDDLE, -degrees, 1.0)
    motion[:, 2] += shift
    return motion


def show(object_motion, mark_motion, marked):
    """The print of an object, and marks that cover a part of the picture."""
    where = cv2.GaussianBlur(marked.astype(np.float32), (0, 0), 2.0)
    print_, marks, where = (
        cv2.warpAffine(plane, motion, SIZE, borderMode=cv2.BORDER_REFLECT)
        for plane, motion in (
            (6.0 * pattern(1, 3.0), object_motion),
            (10.0 * pattern(2, 3.0), mark_motion),
            (where, mark_motion),
        )
    )
    noise = np.random.default_rng(int(100.0 * abs(object_motion[0, 2]))).normal(size=print_.shape)
    return (print_ * (1.0 - where) + marks * where + 0.3 * noise).astype(np.float32)


def pair(degrees, mark_motion, gel_motion, marked):
    """A print before and after the object slid over the gel."""
    moved = move(degrees, (-2.0, 1.0))
    before = Texture(show(STILL, STILL, marked), MASK, grey=True)
    gel = np.vstack([gel_motion, [0.0, 0.0, 1.0]])
    return before, Texture(show(moved, mark_motion, marked), MASK, grey=True, gel=gel)


Y, X = np.mgrid[: SIZE[1], : SIZE[0]]
PART = (X > 95) & (Y < 60)
"""A part of the contact with marks: stronger than the print, and beside its middle."""


@pytest.mark.parametrize("where", ["on the gel", "in the picture"])
def test_marks_do_not_distort_the_turn_of_an_object_that_slides(where):
    drifted = move(0.0, (3.0, 0.0))
    before, now = pair(5.0, drifted if where == "on the gel" else STILL, drifted, PART)
    keyframe = Keyframe(before, np.eye(3), 0.0, np.zeros((2, 2)))
    distorted = register(keyframe, replace(now, grey=False), STILL, ImprintSettings())
    match = register(keyframe, now, STILL, ImprintSettings())
    assert match is not None
    assert distorted is None or abs(np.degrees(distorted.turned) - 5.0) > 0.5
    assert np.degrees(match.turned) == pytest.approx(5.0, abs=0.2)
    assert np.degrees(match.own_error) < 0.3
    marks = find_marks(keyframe.template, now, match.warp)
    assert marks[PART[keyframe.template.box]].mean() > 0.3
    assert marks[~PART[keyframe.template.box]].mean() < 0.1


def test_a_print_that_mostly_follows_the_gel_counts_whole():
    drifted = move(0.0, (3.0, 0.0))
    before, now = pair(5.0, drifted, drifted, X > 50)
    template = Keyframe(before, np.eye(3), 0.0, np.zeros((2, 2))).template
    assert not find_marks(template, now, move(5.0, (-2.0, 1.0))).any()


@pytest.mark.parametrize("grey", [True, False])
def test_a_grey_print_is_compared_with_one_of_about_its_size(grey):
    """The first frame shows little of it."""
    rough = np.random.default_rng(3).normal(0.0, 60.0, (240, 320)).astype(np.float32)
    level = np.clip(150.0 + cv2.GaussianBlur(rough, (0, 0), 3.0), 0, 255).astype(np.uint8)
    image = level if grey else np.repeat(level[..., None], 3, axis=2)
    follower, sizes = ImprintFollower(), []
    for reach in ([50.0, 45.0], [75.0, 65.0], [50.0, 45.0]):
        region = scenes.REST[(np.abs(scenes.REST - [160.0, 120.0]) < reach).all(axis=1)]
        found = follower.update(paint_out(image, scenes.REST, 4.3), region)
        assert follower.before is not None
        sizes.append(follower.before.texture.size)
    assert sizes[1] > 1.5 * sizes[0]
    assert [one.texture.size for one in follower.keyframes] == [sizes[1 if grey else 0]]
    assert found.angle == pytest.approx(0.0, abs=1e-3)


def test_the_gel_moves_as_its_dots_in_the_contact():
    painted = paint_out(np.full((240, 320), 150, dtype=np.uint8), scenes.REST, 4.3)
    rest = scenes.REST[(np.abs(scenes.REST - [160.0, 120.0]) < [75.0, 65.0]).all(axis=1)]
    turned = np.array([[1.02, -0.03], [0.04, 0.99]])
    now = rest @ turned.T + [3.0, -2.0]
    gel = cut_out(painted, now, now - rest).gel
    assert gel[:2, :2] == pytest.approx(turned, abs=1e-9)
    assert gel[:2, 2] == pytest.approx(np.array([3.0, -2.0]) / painted.part, abs=1e-9)
