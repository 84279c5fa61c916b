"""The edge of contacts that the contact model solves, on layers of several thicknesses."""

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from contactmodel import (
    Contact,
    Ellipsoid,
    Grid,
    HalfSpace,
    Layer,
    Pose,
    Rigid,
    Sphere,
    SquarePunch,
    solve_contact,
)
from estimation.fields.contact import CONTACT_SHARE
from estimation.fields.edge import Edge, find_edge, outline_edge
from estimation.fields.face import face_arm, press_face

GRID = Grid((96, 96), (24.0, 24.0))  # mm
OBJECTS = {
    "ball on thin gel": (Sphere(20.0), 3.0, 0.5),
    "ball on thick gel": (Sphere(20.0), 8.0, 0.9),
    "ball on a half-space": (Sphere(20.0), np.inf, 0.9),
    "ellipsoid": (Ellipsoid((19.0, 11.0, 10.0)), 6.0, 0.9),
    "square": (SquarePunch(7.0, 1.0), 5.0, 0.35),
}


class Pressed:
    """An object pressed into gel without friction."""

    def __init__(self, name: str) -> None:
        indenter, thickness, approach = OBJECTS[name]
        body = Layer(0.2, 0.48, thickness) if np.isfinite(thickness) else HalfSpace(0.2, 0.48)
        solution = solve_contact(Contact(body, Rigid(), indenter, GRID, 0.0), Pose(approach))
        x = np.asarray(solution.grid.x)
        self.pressure = np.asarray(solution.pressure)
        self.radius = np.sqrt((self.pressure > 0.0).sum() * (x[1] - x[0]) ** 2 / np.pi)
        distance = np.hypot(*np.meshgrid(x, x))
        self.arm = np.sum(self.pressure * distance) / self.pressure.sum() / self.radius
        self.depth = RectBivariateSpline(x, x, -np.asarray(solution.elastomer_displacement())[2])

    def edge(self, noise: float, seed: int, pitch: float = 1.0) -> Edge:
        """The fitted edge, by markers placed and turned at random."""
        rng = np.random.default_rng(seed)
        line = pitch * (np.arange(int(18.0 / pitch)) - 0.5 * int(18.0 / pitch))
        turn = np.exp(1j * rng.uniform(0.0, np.pi / 2))
        place = (np.add.outer(line, 1j * line).ravel() + 0.5 * pitch) * turn
        points = np.stack([place.real, place.imag], axis=1) + rng.uniform(-0.5, 0.5, 2)
        points = points[np.abs(points).max(axis=1) < 11.5]
        depth = self.depth(*points.T, grid=False) + noise * rng.standard_normal(len(points))
        edge = find_edge(points, depth, CONTACT_SHARE)
        assert edge is not None
        return edge


@pytest.fixture(scope="module")
def pressed():
    return {name: Pressed(name) for name in OBJECTS}


@pytest.mark.parametrize("name", list(OBJECTS))
@pytest.mark.parametrize(("noise", "pitch"), [(3.5e-3, 1.0), (1.05e-2, 1.5)])
def test_the_radius_is_right_within_5_percent(pressed, name, noise, pitch):
    one = pressed[name]
    radii = [one.edge(noise, seed, pitch).radius for seed in range(6)]
    # half of the largest indentation is 15 to 30 % off under the balls on layers
    assert np.median(radii) == pytest.approx(one.radius, rel=0.05)


def test_the_error_is_that_of_the_scatter(pressed):
    one = pressed["ball on thick gel"]
    edges = [one.edge(3.5e-2, seed) for seed in range(30)]
    scatter = np.std([np.log(edge.radius) for edge in edges])
    told = np.median([edge.error for edge in edges])
    assert 0.5 * told < scatter < 1.5 * told  # 30 draws


def test_face_and_thickness_follow_from_the_surface(pressed):
    ball = pressed["ball on thick gel"]
    edge = ball.edge(1e-3, 0)
    assert edge.flat < 0.2
    assert edge.thinness == pytest.approx(ball.radius / (ball.radius + 8.0), abs=0.03)
    assert pressed["square"].edge(1e-3, 0).flat > 0.6


# the arm of an elongated contact grows with the spread of its markers
@pytest.mark.parametrize("name", sorted(set(OBJECTS) - {"ellipsoid"}))
def test_the_arm_of_friction_follows_from_the_face(pressed, name):
    one = pressed[name]
    edge = one.edge(3.5e-3, 1)
    arm = face_arm(edge.thinness, edge.flat) * edge.radius / one.radius
    # Hertz's arm is up to a fifth shorter than a flat face's
    assert arm == pytest.approx(one.arm, rel=0.05)


def test_the_next_frame_starts_from_the_last_edge(pressed):
    one, noise = pressed["ball on thick gel"], 3.5e-3
    anew = one.edge(noise, 4)
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (350, 2))
    depth = one.depth(*points.T, grid=False)
    again, first = find_edge(points, depth, CONTACT_SHARE, anew), find_edge(points, depth, 0.5)
    assert again is not None
    assert first is not None
    assert again.radius == pytest.approx(first.radius, rel=0.01)
    # from a wrong edge it starts anew
    wrong = anew._replace(parameters=anew.parameters + np.eye(10)[2] - 4.0 * np.eye(10)[0])
    other = find_edge(points, depth, CONTACT_SHARE, wrong)
    assert other is not None
    assert other.radius == pytest.approx(first.radius, rel=0.01)


def test_nothing_pressed_has_no_edge():
    points = np.random.default_rng(0).uniform(-9.0, 9.0, (300, 2))
    assert find_edge(points, np.zeros(300), CONTACT_SHARE) is None
    assert find_edge(points, np.full(300, np.nan), CONTACT_SHARE) is None
    assert find_edge(points[:9], np.ones(9), CONTACT_SHARE) is None


@pytest.mark.parametrize(("thinness", "flat"), [(0.3, 0.2), (0.6, 0.7)])
def test_derivatives_of_the_table_are_those_of_its_values(thinness, flat):
    r, step = np.array([0.43, 0.87, 1.31, 2.05]), 0.02
    at = press_face(r, thinness, flat)
    for by, moves in (
        (at.by_distance, (step, 0.0, 0.0)),
        (at.by_thinness, (0.0, step, 0.0)),
        (at.by_flat, (0.0, 0.0, step)),
    ):
        ends = [
            press_face(
                r + sign * moves[0], thinness + sign * moves[1], flat + sign * moves[2]
            ).value
            for sign in (1.0, -1.0)
        ]
        # interpolated between knots, which are up to 0.15 apart
        np.testing.assert_allclose((ends[0] - ends[1]) / (2.0 * step), by, atol=0.06)


@pytest.mark.parametrize("elongation", [1.0, 1.4])
def test_edge_of_a_region_is_its_ellipse(elongation):
    rng, radius = np.random.default_rng(0), 4.0
    points = np.mgrid[-12.0:12.0, -12.0:12.0].reshape(2, -1).T
    off, wrong = [], []
    for _ in range(200):
        turn, centre = rng.uniform(0.0, np.pi), rng.uniform(-0.5, 0.5, 2)
        along = (points - centre) @ np.array([np.cos(turn), np.sin(turn)])
        across = (points - centre) @ np.array([-np.sin(turn), np.cos(turn)])
        region = np.hypot(along / elongation, across * elongation) < radius
        edge = outline_edge(points, region)
        assert edge is not None
        off.append(np.log(edge.radius / radius) / edge.error)
        wrong.append(((edge.distance < 1.0) != region).sum())
        assert np.hypot(*(edge.parameters[:2] - centre)) < 0.4
        assert edge.elongation == pytest.approx(elongation**2, rel=0.2)
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.5
    assert np.mean(wrong) < 2.0


def test_few_markers_or_a_row_have_no_edge():
    points = np.mgrid[:20.0, :20.0].reshape(2, -1).T
    for region in (np.equal(points[:, 0], 4.0), np.all(points < 3.0, axis=1)):
        assert region.any()
        assert outline_edge(points, region) is None
