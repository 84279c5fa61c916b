"""The sensor description: its file, its one conversion, and pictures read with it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from contactmodel import Pad
from contactmodel.common.inputs import RenamedKeyWarning
from estimation.frames.noise import Noise
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import read_images
from estimation.pictures.render import Camera, render_dots
from estimation.pictures.sensor import Lens, Sensor, read_sensor, write_sensor
from tests.estimation.pictures.scenes import GRID, REST, picture, twisted

MATRIX = np.array([[700.0, 0.0, 310.0], [0.0, 690.0, 250.0], [0.0, 0.0, 1.0]])
LENS = Lens(MATRIX, np.array([-0.2, 0.05, 0.001, -0.002, 0.01]))


def everything():
    return Sensor(
        mm_per_px=0.04,
        lens=LENS,
        size=(640, 480),
        marker="dots",
        radius=4.3,
        dark=False,
        reference=np.array([[0.5, 0.25], [1.5, 0.25], [0.5, 1.25]]),
        noise=Noise(1e-3, 3e-3, (0.67, 0.35), 80),
        pad=Pad(shear_modulus=0.2, thickness=3.0, dome_radius=np.inf, size=(20.0, 16.0)),
    )


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "sensor.toml"
    write_sensor(everything(), path)
    read = read_sensor(str(path))
    assert np.array_equal(read.lens.matrix, MATRIX)
    assert np.array_equal(read.lens.distortion, LENS.distortion)
    assert np.array_equal(read.reference, everything().reference)
    bare = {"lens": None, "reference": None}
    assert replace(read, **bare) == replace(everything(), **bare)


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("shape", [(5,), (1, 5), (5, 1)])
def test_a_lens_takes_what_opencv_and_lists_give(shape):
    lens = Lens(MATRIX, LENS.distortion.reshape(shape))
    lists, place = Lens(MATRIX.tolist(), LENS.distortion.tolist()), LENS.undistort(REST)
    for other in (lens, lists):
        np.testing.assert_array_equal(other.undistort(REST), place)


def test_a_lens_of_another_size_is_refused():
    Sensor(lens=LENS).expect_size(640, 480)
    with pytest.raises(ValueError, match="calibrate the lens at 320×240"):
        Sensor(lens=LENS).expect_size(320, 240)
    with pytest.raises(ValueError, match="calibrate the lens at 1280×960"):
        Sensor(lens=LENS).expect_size(1280, 960)
    Sensor(lens=LENS, size=(1280, 960)).expect_size(1280, 960)  # stated: the centre may be off


def test_lengths_are_in_mm_or_in_px_as_their_keys_say(tmp_path):
    path = tmp_path / "sensor.toml"
    noise = Noise(0.02, float("nan"), (0.5, 0.2), 9, "px")
    in_pixels = Sensor(noise=noise, reference=np.array([[10.0, 20.0]]))
    write_sensor(in_pixels, path)
    text = path.read_text()
    assert "in_plane_px = 0.02" in text
    assert "reference_px" in text
    assert repr(read_sensor(path)) == repr(in_pixels)  # NaN is not equal to itself
    path.write_text(text + "\n[camera]\nmm_per_px = 0.05\n")
    scaled = read_sensor(path)
    assert scaled.noise.unit == "mm"
    assert scaled.noise.in_plane == pytest.approx(0.001, rel=1e-12)
    np.testing.assert_allclose(scaled.reference, [[0.5, 1.0]])
    write_sensor(Sensor(noise=Noise.from_std(1e-3)), path)  # of a sensor that gives mm itself
    assert read_sensor(path).noise.in_plane == 1e-3


OLD = """
format_version = 1
[camera]
width = 640
height = 480
mm_per_px = 0.04
[markers]
reference = [[0.5, 0.25], [1.5, 0.25]]
[noise]
in_plane = 0.001
normal = 0.003
[elastomer]
shear_modulus = 0.2
thickness = 3.0
friction_coefficient = 0.6
"""


def test_files_of_version_0_1_0_are_read_and_say_what_changed(tmp_path):
    path = tmp_path / "sensor.toml"
    path.write_text(OLD)
    with pytest.warns(RenamedKeyWarning) as notes:
        read = read_sensor(path)
    assert read.size == (640, 480)
    assert read.pad == Pad(shear_modulus=0.2, thickness=3.0)
    assert (read.noise.in_plane, read.noise.normal) == (1e-3, 3e-3)
    np.testing.assert_array_equal(read.reference, [[0.5, 0.25], [1.5, 0.25]])
    (said,) = (str(note.message) for note in notes)
    assert "sensor.toml is of version 0.1.0, change its keys" in said
    assert "elastomer.thickness is now called pad.thickness_mm" in said
    assert "elastomer.friction_coefficient is no longer used" in said
    path.write_text(OLD + "\n[pad]\nthickness_mm = 2.0\n")
    with pytest.raises(
        ValueError, match=r"elastomer\.thickness and pad\.thickness_mm are the same key"
    ):
        read_sensor(path)


def test_an_empty_description_knows_nothing(tmp_path):
    path = tmp_path / "sensor.toml"
    path.write_text("format_version = 1\n")
    assert read_sensor(path) == Sensor()
    assert Sensor().unit == "px"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "format_version"),
        (
            "format_version = 1\n[lens]\n",
            "unknown key 'lens'; known are camera, markers, noise, pad",
        ),
        ("format_version = 1\n[camera]\nmm_per_pixel = 1.0", "camera: unknown key 'mm_per_pixel'"),
        (
            "format_version = 1\n[camera]\nmm_per_px = -1.0",
            "mm_per_px is -1.0; it must be a number above 0",
        ),
        ("format_version = 1\n[camera]\nmm_per_px = true", "camera.mm_per_px must be a number"),
        (
            "format_version = 1\n[camera]\nwidth_px = 640",
            "camera: width_px and height_px belong together",
        ),
        ("format_version = 1\n[camera]\nmatrix = [[1]]\ndistortion = [0]", "camera matrix"),
        (
            "format_version = 1\n[markers]\nreference_px = [[1.0], [2.0]]",
            "reference must have two or three",
        ),
        ("format_version = 1\n[markers]\nkind = 'stars'", "choose from corners, dots, speckle"),
        ("format_version = 1\n[markers]\nreference_px = [[1, 2], [2]]", "rows of one length"),
        ("format_version = 1\n[markers]\nreference_mm = [[1, 2]]", "give mm_per_px"),
        ("format_version = 1\n[noise]\nnormal_mm = 1.0", "noise: give in_plane_mm"),
        ("format_version = 1\n[noise]\nin_plane_mm = 1.0\nnormal_px = 1.0", "or both in px"),
        ("format_version = 1\n[noise]\nin_plane_mm = 0.0", "in_plane_mm is 0.0; it must be"),
        ("format_version = 1\nnoise = 3", "noise must be a table, got 3"),
        ("format_version = 1\n[pad]\npoisson_ratio = 0.6", "pad: poisson_ratio is 0.6; .* to 0.5"),
        ("format_version = 1\n[pad]\nthickness = 3.0", "pad: unknown key 'thickness'"),
        ("format_version =", "no TOML|not a TOML"),
    ],
)
def test_wrong_files_are_refused(tmp_path, text, words):
    path = tmp_path / "sensor.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=words) as caught:
        read_sensor(path)
    assert "sensor.toml" in str(caught.value)


def test_the_lens_is_that_of_the_textbook():
    """Brown's radial and tangential model, written out."""
    x, y = 0.3, -0.2
    k1, k2, p1, p2, k3 = LENS.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    straight = np.array([[700.0 * x + 310.0, 690.0 * y + 250.0]])
    bent = np.array([[700.0 * bent_x + 310.0, 690.0 * bent_y + 250.0]])
    assert LENS.distort(straight) == pytest.approx(bent, abs=1e-9)  # rounding of 500 px
    assert LENS.undistort(bent) == pytest.approx(straight, abs=1e-6)  # iteration's end


def test_pixels_and_lengths_are_each_others_inverse():
    sensor = everything()
    corner = np.array([[0.0, 0.0], [639.0, 479.0], [np.nan, 3.0], [320.0, 240.0]])
    back = sensor.to_pixels(sensor.to_lengths(corner))
    assert back[[0, 1, 3]] == pytest.approx(corner[[0, 1, 3]], abs=1e-6)  # iteration's end
    assert np.isnan(back[2]).all()


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A twist seen through a lens that bends the picture's corners by 6 px."""
    matrix = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
    sensor = Sensor(
        mm_per_px=0.05,
        lens=Lens(matrix, np.array([-0.1, 0.0, 0.0, 0.0])),
        size=(320, 240),
        radius=4.3,
        dark=True,
    )
    folder = tmp_path_factory.mktemp("bent")
    rng = np.random.default_rng(0)
    for i, angle in enumerate((0.0, 3.0, 6.0)):
        seen = sensor.lens.distort(twisted(angle, rigid=50.0))
        cv2.imwrite(str(folder / f"{i}.png"), picture(seen, rng))
    return folder, sensor


def test_the_lens_is_taken_off(bent):
    folder, sensor = bent
    recording = read_images(folder, ImageSettings(sensor, unloaded=0))
    rest = recording.layout.reference
    order = np.argmin(np.linalg.norm(rest[:, None] - 0.05 * REST, axis=-1), axis=1)
    truth = 0.05 * twisted(6.0, rigid=50.0)[order]
    off = recording.positions[2] - truth
    # noise 0.0085 px, and up to 0.03 px because the lens squeezes a dot's far side more
    assert np.sqrt(np.mean(off**2)) < 0.05 * 0.03
    assert np.abs(0.05 * REST[order] - rest).max() < 0.05 * 0.06


def test_a_described_layout_is_the_reference_of_a_loaded_clip(bent, tmp_path):
    _, sensor = bent
    known = replace(sensor, reference=0.05 * REST)
    rng = np.random.default_rng(1)
    for i, angle in enumerate((6.0, 6.0)):
        image = picture(known.lens.distort(twisted(angle, rigid=50.0)), rng)
        cv2.imwrite(str(tmp_path / f"{i}.png"), image)
    recording = read_images(tmp_path, ImageSettings(known))
    assert np.array_equal(recording.layout.reference, known.reference)
    assert "description" in " ".join(recording.notes)
    inner = np.linalg.norm(REST - np.array([160.0, 120.0]), axis=1) < 50.0
    to_complex = np.array([1.0, 1.0j])
    before, after = (p[inner] @ to_complex for p in (known.reference, recording.positions[0]))
    turn = np.angle(np.sum(np.conj(before - before.mean()) * (after - after.mean())))
    # 13 dots with a lever of 35 px and 0.01 px of noise: 0.005°, five times that
    assert np.degrees(turn) == pytest.approx(6.0, abs=0.025)


def test_pictures_of_another_size_are_refused(tmp_path):
    rng = np.random.default_rng(0)
    axes = np.broadcast_to(4.3 * np.eye(2), (len(GRID), 2, 2))
    cv2.imwrite(str(tmp_path / "0.png"), render_dots(Camera(330, 240), REST, axes, rng))
    with pytest.raises(ValueError, match="330×240"):
        read_images(tmp_path, ImageSettings(Sensor(size=(320, 240))))


@pytest.mark.parametrize("scale", [4e-5, 40.0])
def test_a_scale_that_fits_no_tactile_sensor_is_refused(scale):
    Sensor(mm_per_px=0.04).expect_size(640, 480)
    with pytest.raises(ValueError, match=rf"at {scale:g} mm/px a picture would be"):
        Sensor(mm_per_px=scale).expect_size(640, 480)
