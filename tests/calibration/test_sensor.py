"""A sensor description from rendered pictures of a known sensor."""

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.__main__ import app
from calibration.sensor import calibrate_sensor, fit_lens
from contactmodel import Pad
from estimation.pictures.sensor import Lens, Sensor, read_sensor, write_sensor
from tests.estimation.pictures.scenes import PITCH, REST, picture, twisted

MATRIX = np.array([[400.0, 0.0, 158.0], [0.0, 405.0, 122.0], [0.0, 0.0, 1.0]])
LENS = Lens(MATRIX, np.array([-0.2, 0.05, 0.0, 0.0, 0.0]))


def board_picture(turn, shift, size=(320, 240), cell=1.0):
    """A checkerboard of 5×7 inner corners seen through the lens, by tracing every ray."""
    fine = 3
    y, x = (np.mgrid[: size[1] * fine, : size[0] * fine] + 0.5) / fine - 0.5
    straight = LENS.undistort(np.stack([x.ravel(), y.ravel()], axis=1))
    rays = np.column_stack([straight, np.ones(len(straight))]) @ np.linalg.inv(MATRIX).T
    rotation = cv2.Rodrigues(np.array(turn, dtype=float))[0]
    origin, direction = -rotation.T @ np.array(shift), rays @ rotation
    hit = origin + direction * (-origin[2] / direction[:, 2])[:, None]
    u, v = hit[:, 0] / cell, hit[:, 1] / cell
    dark = ((np.floor(u) + np.floor(v)) % 2 == 0) & (np.abs(u) < 4) & (np.abs(v) < 3)
    grey = np.where(dark, 30.0, 220.0).reshape(y.shape)
    grey = grey.reshape(size[1], fine, size[0], fine).mean(axis=(1, 3))
    return cv2.GaussianBlur(grey, (0, 0), 0.7).astype(np.uint8)


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boards")
    turns = [
        (0, 0, 0),
        (0.5, 0, 0),
        (-0.5, 0.1, 0.2),
        (0, 0.5, 0.1),
        (0.1, -0.5, -0.2),
        (0.3, 0.4, 1),
    ]
    for i, turn in enumerate(turns):
        shift = (0.8 * np.cos(i), 0.5 * np.sin(2 * i), 13.0)
        cv2.imwrite(str(folder / f"{i}.png"), board_picture(turn, shift))
    return folder


@pytest.fixture(scope="module")
def stills(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stills")
    rng = np.random.default_rng(0)
    for i in range(6):
        cv2.imwrite(str(folder / f"{i}.png"), picture(REST, rng))
    return folder


def test_the_lens_is_found(boards):
    lens, error = fit_lens(boards, (5, 7))
    assert error < 0.1
    points = np.array([[60.0, 50.0], [160.0, 120.0], [260.0, 190.0], [60.0, 190.0]])
    away = lens.undistort(points) - LENS.undistort(points)
    # focal length and distortion trade off; what the lens takes off is known to 0.1 px or so
    away -= away.mean(axis=0)
    assert np.abs(away).max() < 0.5


def test_another_board_is_refused(boards):
    with pytest.raises(ValueError, match="0 of 6 pictures"):
        fit_lens(boards, (4, 9))


def test_layout_scale_and_noise(stills):
    found = calibrate_sensor(stills, pitch_mm=1.2).sensor
    assert found.mm_per_px == pytest.approx(1.2 / PITCH, rel=1e-3)  # 0.01 px over 11 pitches
    truth = 1.2 / PITCH * REST
    off = np.linalg.norm(found.reference[:, None] - truth, axis=2).min(axis=1)
    assert off.max() < 1e-3 + 1e-3 * truth.max()  # noise of 6 pictures, and the scale's error
    assert len(off) == len(REST)
    # 0.0085 px is the Cramér–Rao bound; the fit is within 1.5 times of it
    assert 0.8 * 0.0085 < found.noise.in_plane / found.mm_per_px < 1.6 * 0.0085


def test_the_command_writes_what_run_reads(stills, tmp_path):
    known = Sensor(pad=Pad(thickness=3.0))
    write_sensor(known, tmp_path / "known.toml")
    arguments = [
        "--pitch-mm",
        "1.2",
        "--sensor",
        str(tmp_path / "known.toml"),
        "--out",
        str(tmp_path),
    ]
    done = CliRunner().invoke(app, ["sensor", str(stills), *arguments])
    assert done.exit_code == 0, done.output
    written = read_sensor(tmp_path / "sensor.toml")
    assert written.size == (320, 240)
    assert written.pad == known.pad
    assert written.noise.unit == "mm"
    again = calibrate_sensor(stills, known=written).sensor  # the scale stays as it was known
    assert again.mm_per_px == written.mm_per_px
    np.testing.assert_allclose(again.reference, written.reference, atol=1e-5)  # as it is rounded
    assert "<img" in (tmp_path / "report.html").read_text()


def test_dots_that_move_between_the_pictures_are_not_at_rest(tmp_path):
    rng = np.random.default_rng(0)
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(REST + 2.0 * i, rng))
    with pytest.raises(ValueError, match="pad at rest"):
        calibrate_sensor(tmp_path, pitch_mm=1.2)


def test_dots_that_turn_in_a_part_of_the_pictures_are_not_at_rest(tmp_path):
    """As in a clip of a contact, around which most dots rest."""
    rng = np.random.default_rng(0)
    for i in range(6):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(twisted(2.0 * i, still=90.0), rng))
    with pytest.raises(ValueError, match="pad at rest"):
        calibrate_sensor(tmp_path)


def test_a_wrong_pitch_is_refused(stills):
    with pytest.raises(ValueError, match="pitch"):
        calibrate_sensor(stills, pitch_mm=0.0)
