import numpy as np
import pytest

from contactmodel.analytic import press_layer_punch
from estimation.fields.edge import Edge
from estimation.slip.branch import Branch
from estimation.slip.friction import FrictionWatch
from estimation.slip.load_path import Direction

RADIUS, PRESSED = 4.0, 5.0
NODES = np.stack(np.meshgrid(*2 * [np.arange(-5.0, 5.5, 0.25)]), axis=-1).reshape(-1, 2)
DISC = NODES[np.linalg.norm(NODES, axis=1) < RADIUS]
ARM = 3.0 * np.pi / 16.0 * np.sqrt(2.0 * np.mean(np.sum(DISC**2, axis=1)))


def follow(watch, shear, moment, frames=5, slips=False, centre=(0.0, 0.0), edge=None):
    """Some frames of a load; moments are about the contact's centre."""
    x, y = centre
    about_origin = moment + x * shear[1] - y * shear[0]
    wrench = (*shear, -PRESSED, 0.0, 0.0, about_origin)
    for _ in range(frames):
        watch.update(wrench, DISC + np.array(centre), edge)
        if slips:
            watch.learn()
    return watch.estimate()


@pytest.mark.parametrize("centre", [(0.0, 0.0), (3.0, -1.5)])
def test_slip_shows_the_coefficient_in_shear_and_in_twist(centre):
    friction = 0.6
    for share in (0.0, 0.5, 1.0):  # of the limit curve's ellipse, from shear to twist
        shear = friction * PRESSED * np.sqrt(1.0 - share**2) * np.array([0.6, -0.8])
        moment = friction * PRESSED * ARM * share
        found = follow(FrictionWatch(), shear, moment, slips=True, centre=centre)
        assert found.coefficient == pytest.approx(friction, rel=1e-9)
        assert found.low < friction < found.high
        assert found.share == pytest.approx(1.0)


@pytest.mark.parametrize("centre", [(0.0, 0.0), (3.0, -1.5)])
def test_loads_are_about_the_contact(centre):
    watch = FrictionWatch()
    follow(watch, (0.6, -0.8), 2.0, centre=centre)
    np.testing.assert_allclose(watch.loads, (2.0, 0.6 * ARM, -0.8 * ARM), rtol=1e-9)


def test_a_branch_with_shear_across_foretells_the_coefficient_of_both():
    watch = FrictionWatch()
    follow(watch, (1.0, 0.0), 0.0)
    limit = 0.5 * PRESSED * ARM
    sheared, known = Direction(across=0.8 * limit), np.zeros((3, 3))
    branch = Branch(0.0, 1.0, 0.6 * limit, 10.0, 0.0, known, 0.0, 20, direction=sheared)
    assert watch.estimate(branch).coefficient == pytest.approx(0.5, rel=1e-9)


def test_arm_of_unknown_faces_widens_the_interval_of_a_twist_only():
    shear = follow(FrictionWatch(), (2.0, 0.0), 0.0, slips=True)
    twist = follow(FrictionWatch(), (0.0, 0.0), 2.0 * ARM, slips=True)
    assert twist.coefficient == pytest.approx(shear.coefficient)
    assert twist.high - twist.low > 2.0 * (shear.high - shear.low)


def test_the_edge_gives_the_arm_of_a_flat_face():
    friction, flat = 0.6, 0.9
    (punch,) = press_layer_punch(np.zeros(1), np.inf, np.array([flat]))
    moment = friction * PRESSED * ARM * punch.arm / (3.0 * np.pi / 16.0)
    edge = Edge(RADIUS, 0.01, 0.01, 0.0, flat, np.zeros(1), np.zeros(10))
    known = follow(FrictionWatch(), (0.0, 0.0), moment, slips=True, edge=edge)
    unknown = follow(FrictionWatch(), (0.0, 0.0), moment, slips=True)
    assert known.coefficient == pytest.approx(friction, rel=0.01)  # the table of faces
    assert unknown.coefficient > 1.2 * friction
    assert known.high / known.low < unknown.high / unknown.low


def test_slip_is_remembered_for_another_grasp():
    watch = FrictionWatch()
    follow(watch, (2.0, 0.0), 0.0, slips=True)
    watch.update((0.0,) * 6, np.empty((0, 2)))  # let go
    found = follow(watch, (1.0, 0.0), 0.0)
    assert found.coefficient == pytest.approx(0.4)
    assert found.share == pytest.approx(0.5)


def test_while_nothing_slips_only_the_most_in_use_is_known():
    found = follow(FrictionWatch(), (0.0, 1.5), 0.0)
    assert np.isnan(found.coefficient)
    assert found.low == found.used == pytest.approx(0.3)


def test_branch_foretells_the_coefficient():
    known = np.diag([0.01**2, 0.01**2, 0.01**2])
    branch = Branch(0.0, 1.0, 0.5 * PRESSED * ARM, 10.0, 0.0, known, 0.0, 20)
    watch = FrictionWatch()
    follow(watch, (0.0, 0.0), 0.2 * PRESSED * ARM)
    assert watch.estimate(branch).coefficient == pytest.approx(0.5, rel=1e-9)
    doubtful = branch._replace(covariance=np.diag([0.5**2, 1.0, 1.0]))
    assert np.isnan(watch.estimate(doubtful).coefficient)


def test_object_that_uses_little_friction_holds():
    watch = FrictionWatch()
    follow(watch, (2.0, 0.0), 0.0, slips=True)
    assert not watch.holds
    follow(watch, (1.2, 0.0), 0.0)
    assert watch.holds


def test_load_that_is_taken_off_is_no_slip():
    watch = FrictionWatch()
    for shear in np.linspace(2.0, 0.5, 12):
        watch.update((shear, 0.0, -PRESSED, 0.0, 0.0, 0.0), DISC)
        watch.learn()
    assert np.isnan(watch.estimate().coefficient)


@pytest.mark.parametrize("force", [(np.nan, np.nan, np.nan), (0.1, 0.0, 0.0), (0.1, 0.0, 2.0)])
def test_without_forces_or_pressure_nothing_is_known(force):
    watch = FrictionWatch()
    watch.update((*force, 0.0, 0.0, 0.0), DISC)
    watch.learn()
    assert np.isnan(watch.estimate()).all()
    assert not watch.holds
