"""The fit of a dot against the Cramér–Rao bound, on pictures made without the fit's own model."""

import numpy as np
import pytest
from scipy.spatial import KDTree

import estimation.pictures.dots.style as style_module
from estimation.pictures.dots.find import Dots, DotStyle, fit_dots
from estimation.pictures.dots.style import find_dots, find_style
from estimation.pictures.light import to_grey
from estimation.pictures.render import Camera, render_dots
from papers.marker_images import settings
from papers.marker_images.dots import RADIUS, compute, position_limit, tables
from papers.marker_images.rivals import RIVALS, locate_by_blobs
from tests.estimation.pictures.scenes import REST, picture, real


def test_dark_dots_are_read_in_the_brightest_channel_and_bright_ones_in_the_darkest():
    image = _rng().integers(0, 255, (5, 7, 3)).astype(np.uint8)
    assert np.array_equal(to_grey(image, True), image.max(axis=2))
    assert np.array_equal(to_grey(image, False), image.min(axis=2))


def test_bound_is_the_known_one():
    for noise, printed in ((2.0, 0.0085), (5.0, 0.0214)):
        limit = position_limit(noise, RADIUS * np.eye(2), settings.CONTRAST, settings.BLUR)
        assert limit == pytest.approx(printed, abs=1e-4)  # its digits


def test_positions_reach_the_bound():
    """Three pictures of 300 dots: their scatter is known to 2.4 %, their mean to 1/30 of it."""
    rows = [row for row in tables(compute(quick=True))[""] if row["fit"] not in RIVALS]
    assert {row["shape"] for row in rows} == {"round", "1.3 to 1"}
    for row in rows:
        assert row["over the bound"] < 1.3
        assert row["bias over the bound"] < 1.0 / 3.0
        most = 1.1 if row["shape"] == "round" or row["fit"] == "in full" else 1.4
        assert 0.9 < row["claimed [px]"] / row["position [px]"] < most


def test_other_programs_find_the_same_dots():
    camera = Camera(240, 160, noise=2.0)
    truth = np.array([[50.3, 40.8], [120.0, 80.5], [190.6, 120.2]])
    axes = np.broadcast_to(RADIUS * np.eye(2), (3, 2, 2))
    grey = to_grey(render_dots(camera, truth, axes, _rng()), True)
    assert locate_by_blobs in RIVALS.values()
    for locate in RIVALS.values():
        dots = locate(grey, np.zeros((0, 2), dtype=int), DotStyle(True, RADIUS))
        assert KDTree(dots.centre).query(truth)[0].max() < 0.1


def test_shape_and_contrast_of_an_ellipse():
    axes = np.array([[[6.0, 1.0], [1.0, 4.0]]])
    image = render_dots(Camera(80, 60, noise=0.5), np.array([[40.3, 30.2]]), axes, _rng())
    dots = fit_dots(to_grey(image, True), np.array([[40, 30]]), DotStyle(True, 5.0))
    # the profile is that of a straight rim: at the sharp end, radius 2.3 px, it shifts by blur²/2r
    assert np.abs(dots.axes[0] - axes[0]).max() < 0.25
    assert dots.contrast[0] == pytest.approx(120.0, rel=0.02)


@pytest.mark.parametrize("bright", [False, True])
def test_style_is_found(bright):
    camera = Camera(320, 240)
    if bright:
        camera = camera._replace(background=60.0, contrast=-120.0)
    style = find_style(picture(REST, _rng(), camera))
    assert style.dark is not bright
    assert style.radius == pytest.approx(4.3, abs=0.3)  # the curved rim's 0.1 px, and rounding


def test_uneven_light_and_saturation_leave_the_dots():
    camera = Camera(320, 240, background=235.0, contrast=100.0, shading=0.5, noise=2.0)
    dots = find_dots(to_grey(picture(REST, _rng(), camera), True), DotStyle(True, 4.3))
    off = KDTree(dots.centre).query(REST)[0]
    assert off.max() < 0.1  # ten times the noise-limited error: none missing, none displaced


def test_a_round_spot_that_is_no_dot_is_not_fitted_in_full(monkeypatch):
    """A cross between the dots, which the table explains by half."""
    monkeypatch.setattr(style_module, "fit_dots", None)
    grey = to_grey(picture(REST, _rng()), True)
    x, y = REST[len(REST) // 2] + 0.5 * (REST[1] - REST[0])
    down, right = np.abs(np.mgrid[: grey.shape[0], : grey.shape[1]] - np.reshape([y, x], (2, 1, 1)))
    grey[(np.hypot(down, right) < 5.0) & (np.minimum(down, right) < 2.1)] -= 60.0
    dots = find_dots(grey, DotStyle(True, 4.3))
    assert KDTree(dots.centre).query([x, y])[0] > 5.0
    assert KDTree(dots.centre).query(REST)[0].max() < 0.2


def test_sixteen_bit_and_colour_are_read_alike():
    grey = picture(REST, _rng())
    colour = np.stack([grey] * 3, axis=-1)
    deep = grey.astype(np.uint16) * 257
    for other in (colour, deep):
        assert np.array_equal(to_grey(other, True), to_grey(grey, True))


@pytest.mark.parametrize(("radius", "dark", "uneven"), [(4, 0, 1), (11, 1, 1), (16, 0, 0)])
def test_dots_of_any_size_are_found(radius, dark, uneven):
    small = Camera(width=20 * radius + 120, height=15 * radius + 90)
    colours = {"background": 180.0, "contrast": 120.0} if dark else {}
    camera = small._replace(**(colours or {"background": 60.0, "contrast": -120.0}))
    steps = [np.arange(0.9 * radius + 8, n - radius, 4.0 * radius) for n in small[:2]]
    rest = np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)
    image = render_dots(camera, rest, np.tile(radius * np.eye(2), (len(rest), 1, 1)), _rng())
    if uneven:
        y, x = np.mgrid[: camera.height, : camera.width] / camera.height
        image = image * (0.5 + 0.4 * x) + 50.0 * np.exp(-8.0 * ((x - 0.4) ** 2 + (y - 0.6) ** 2))
        image = np.clip(image, 0, 255).astype(np.uint8)
    style = find_style(image)
    assert style.dark == bool(dark)
    # the pixel's own width is counted as blur, which takes 0.2 px off the smallest
    assert style.radius == pytest.approx(radius, abs=0.25)
    dots = find_dots(to_grey(image, style.dark), style)
    off = np.linalg.norm(dots.centre[:, None] - rest, axis=-1).min(axis=0)
    assert (off < 0.1).mean() > 0.95


@pytest.mark.parametrize("level", [0, 128])
def test_a_picture_without_dots_is_refused(level):
    flat = np.clip(_rng().normal(level, 2.0, (240, 320)), 0, 255).astype(np.uint8)
    with pytest.raises(ValueError, match="no rows of dots"):
        find_style(flat)


def test_published_stills():
    import cv2

    for number, least in ((0, 343), (1, 340), (2, 350)):  # 95 % of 361 seen by eye on the first
        image = cv2.imread(str(real("unical-stills", "Tac3D", f"000{number}.png")))
        style = find_style(image)
        assert not style.dark
        assert len(find_dots(to_grey(image, style.dark), style).centre) >= least
    for sensor in ("GelSight", "9DTact"):
        for number in range(3):
            image = cv2.imread(str(real("unical-stills", sensor, f"000{number}.png")))
            with pytest.raises(ValueError, match="no printed dots"):
                find_style(image)


def _rng():
    return np.random.default_rng(0)


def test_radius_and_elongation_of_dots_are_those_of_their_axes():
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(20, 2, 2)) + 4.0 * np.eye(2)
    axes = 0.5 * (axes + axes.transpose(0, 2, 1))
    none = np.zeros(20)
    dots = Dots(np.zeros((20, 2)), axes, axes, none, none, none)
    longest, shortest = np.linalg.svd(axes, compute_uv=False).T
    assert dots.radius == pytest.approx(np.sqrt(longest * shortest))
    assert dots.elongation == pytest.approx(longest / shortest)
