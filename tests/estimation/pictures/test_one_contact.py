"""Of two objects beside each other, one is followed, and each frame says so."""

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

from contactmodel import Contact, Grid, HalfSpace, Pose, Rigid, Sphere, make_path
from estimation.estimators.result import State
from estimation.pictures.lattice import lay_reference
from estimation.pictures.reader import ImageSettings
from estimation.pictures.region import OneContact, _label_parts
from estimation.sources import read_recording
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.clip import Scene, VirtualClip, write_pictures
from tests.estimation.pictures.scenes import PITCH, REST

LEFT = REST[:, 0] < 3.5 * PITCH
RIGHT = REST[:, 0] > 6.5 * PITCH
NOWHERE = np.zeros(len(REST), dtype=bool)


class _Pair(VirtualClip):
    """A virtual clip with another object beside the first."""

    def __init__(self, scene, beside):
        super().__init__(scene)
        self._beside = VirtualClip(beside)

    def moved(self, frame, points):
        return super().moved(frame, points) + self._beside.moved(frame, points)

    def height(self, frame):
        return super().height(frame) + self._beside.height(frame)


def scene(x, radius, turn, seed):
    """An object at x that is pressed on, and turned by an angle [mm, deg]."""
    turned = Pose(0.8, twist=np.radians(turn))
    contact = Contact(
        HalfSpace(0.2, 0.5), Rigid(), Sphere(radius), Grid((32, 32), (20.0, 20.0)), 0.8
    )
    path = make_path([Pose(0.0), Pose(0.0), Pose(0.8), turned, turned], [2, 4, 12, 3])
    return Scene(contact=contact, path=path, centre=(x, 0.3), slope=0.14, seed=seed)


def follow(one, *parts):
    """The contact of the next frame, as a reader sets it."""
    one.last = one.follow(np.logical_or.reduce(parts))
    return one.last


@pytest.mark.parametrize("share", [0.01, 0.03, 0.1])
def test_connected_dots_are_those_of_scipy(share):
    linked = np.random.default_rng(0).uniform(size=(60, 60)) < share
    linked |= linked.T | np.eye(60, dtype=bool)
    part, theirs = _label_parts(linked), connected_components(linked, directed=False)[1]
    assert np.array_equal(part == part[:, None], theirs == theirs[:, None])


@pytest.mark.parametrize(("left", "right", "unloaded"), [(0.0, 6.0, None), (-6.0, 0.0, 0)])
def test_of_two_objects_the_followed_one_has_its_own_angle(left, right, unloaded, tmp_path):
    clip = _Pair(scene(-5.0, 5.5, left, 3), scene(5.0, 6.5, right, 4))
    write_pictures(clip, tmp_path / "clip")
    recording = read_recording(tmp_path / "clip", ImageSettings(unloaded=unloaded))
    result = estimate_angles(recording)
    others = recording.others
    assert others is not None
    assert others[-12:].any(axis=1).all()
    x = recording.layout.reference[:, 0]
    assert x[result.contact[-1]].max() < x.mean()
    assert x[others[-1]].min() > x.mean()
    assert np.isnan(recording.positions[-1, others[-1]]).all()
    assert set(result.reason[-12:]) == {"of several contacts, one is followed"}
    assert State.UNKNOWN not in result.state[-12:]
    turned = np.degrees([result.angle, result.low, result.high])[:, -1]
    assert turned[0] == pytest.approx(left, abs=0.5)
    assert turned[1] <= left <= turned[2]
    assert not turned[1] <= right <= turned[2]


def test_the_first_contact_is_followed_to_its_end():
    one = OneContact(lay_reference(REST, ""))
    small = LEFT & (REST[:, 1] < 4.0 * PITCH)
    np.testing.assert_array_equal(follow(one, small), small)
    assert not one.others.any()
    np.testing.assert_array_equal(follow(one, small, RIGHT), small)  # the larger one comes later
    assert one.others[RIGHT].all()
    assert not one.others[small].any()
    np.testing.assert_array_equal(follow(one, RIGHT), NOWHERE)  # a frame without contact
    np.testing.assert_array_equal(follow(one, RIGHT), RIGHT)
    assert not one.others.any()


def test_a_gap_of_one_dot_or_a_few_dots_are_no_other_contact():
    one, middle = OneContact(lay_reference(REST, "")), REST[:, 0].mean()
    gap = np.abs(REST[:, 0] - REST[np.abs(REST[:, 0] - middle).argmin(), 0]) < 0.5 * PITCH
    np.testing.assert_array_equal(follow(one, ~gap), ~gap)
    few = RIGHT & (np.cumsum(RIGHT) <= 4)
    np.testing.assert_array_equal(follow(one, LEFT, few), LEFT | few)
    assert not one.others.any()
