"""Mirror-split stereo: calibration, positions in space, and what does not fit."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from calibration.__main__ import app
from calibration.stereo import Pose, calibrate_from_pictures, calibrate_stereo
from contactmodel.common.inputs import RenamedKeyWarning
from estimation.__main__ import app as run_app
from estimation.fields.contact import CONTACT_SHARE
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.neighbours import grid_neighbours
from estimation.frames.recording import ONSET_MM, Frame, MarkerLayout
from estimation.pictures.corners.pattern import Pattern, render_pattern
from estimation.pictures.reader import ImageSettings
from estimation.pictures.render import Camera
from estimation.pictures.rig import Rig, View, read_rig, triangulate, write_rig
from estimation.pictures.sensor import Sensor
from estimation.pictures.stream import read_pictures
from estimation.sources import read_recording
from estimation.virtual.recording import PivotModel
from estimation.virtual.surface import simulate_surface
from tests.estimation.pictures.rigs import dome, make_rig, tilted
from tests.estimation.pictures.test_reading import write_folder

PITCH = 1.1
TARGET = PITCH * np.stack(np.meshgrid(np.arange(13) - 6.0, np.arange(9) - 4.0), -1).reshape(-1, 2)
SMALL = make_rig(320, 240)
CODED, PLAIN = Pattern.coded((9, 12), PITCH, seed=2), Pattern((9, 12), PITCH)
MODEL = PivotModel(
    contact_radius=3.0, approach=0.5, friction_ratio=0.2, grid_shape=(9, 12), pitch=PITCH
)
ANGLES = np.radians([0.0, 0.0, 3.0, 6.0])


def see(rig, points, rng, noise=0.02):
    """Both views of points, with noise [px]."""
    return [
        view.project(points) + rng.normal(0.0, noise, (len(points), 2))
        for view in (rig.left, rig.right)
    ]


def calibrated(rig, rng, noise=0.02, poses=12, orthographic=True):
    seen = [Pose(*see(rig, tilted(TARGET, rng), rng, noise)) for _ in range(poses)]
    return calibrate_stereo(seen, TARGET, (rig.width, rig.height), orthographic)


def align(points, onto):
    """Points moved rigidly onto others: a calibration's axes are its own."""
    middle, target = points.mean(axis=0), onto.mean(axis=0)
    u, _, vt = np.linalg.svd((onto - target).T @ (points - middle))
    return (points - middle) @ (u @ vt).T + target


def photograph(rig, move, pattern, seed, noise=2.0):
    """The split picture of a pattern on a moved surface."""
    camera, rng = Camera(rig.width, rig.height, noise=noise), np.random.default_rng(seed)
    views = [
        render_pattern(camera, lambda points, view=view: view.project(move(points)), pattern, rng)
        for view in (rig.left, rig.right)
    ]
    return np.concatenate(views, axis=1)


@pytest.fixture(scope="module")
def surface():
    return simulate_surface(MODEL, np.array([0.0, 1.0, 1.0, 1.0]), ANGLES)


@pytest.fixture(scope="module")
def pictures(surface):
    return [photograph(SMALL, move, CODED, i) for i, move in enumerate(surface.motions)]


def read(folder, pictures, rig=SMALL, **settings):
    path = write_folder(folder, pictures)
    return read_recording(path, ImageSettings(Sensor(), rig=rig, **settings))


@pytest.mark.parametrize("known", [True, False])
def test_a_dome_is_measured_to_5_um(known):
    rng = np.random.default_rng(0)
    rig, points = make_rig(), dome()
    used = rig if known else calibrated(rig, rng)
    found = triangulate(used, *see(rig, points, rng)).points
    error = (found if known else align(found, points)) - points
    # 0.02 px at 0.05 mm/px are 1 µm across; in depth, at 45°, √(1 + cos²45°)/sin 45° times that
    assert 1e3 * error[:, :2].std() < 1.2
    assert 1e3 * error[:, 2].std() < 2.2
    assert 1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1))) < 3.0
    assert np.percentile(1e3 * np.linalg.norm(error, axis=1), 95) < 5.0


def test_two_perspective_views_are_calibrated_too():
    rng = np.random.default_rng(1)
    centre = (319.5, 239.5)
    left = View(False, 1200.0, centre, 0.01, (0.0, 0.0, 0.0), (0.0, 0.0, 60.0))
    rig = replace(make_rig(), left=left)
    used = calibrated(rig, rng, poses=12, orthographic=False)
    assert used.error == pytest.approx(0.02, rel=0.05)  # 5600 coordinates less 84 unknowns
    found = align(triangulate(used, *see(rig, dome(), rng)).points, dome())
    assert 1e3 * np.sqrt(np.mean(np.sum((found - dome()) ** 2, axis=1))) < 5.0


def test_points_that_two_views_cannot_locate_are_nowhere():
    rig = make_rig()
    blind = replace(rig, right=rig.left)  # both see along the same rays
    found = triangulate(blind, np.full((2, 2), 200.0), np.full((2, 2), 200.0))
    assert np.isnan(found.points).all()


def test_a_calibration_is_written_and_read(tmp_path):
    rig = calibrated(make_rig(), np.random.default_rng(2), poses=5)
    assert rig.error == pytest.approx(0.02, rel=0.1)
    write_rig(rig, tmp_path / "rig.toml")
    assert read_rig(tmp_path / "rig.toml") == rig
    (tmp_path / "other.toml").write_text("format_version = 1\nwidth_px = 3\n")
    with pytest.raises(ValueError, match="no stereo calibration: the key 'left' is missing"):
        read_rig(tmp_path / "other.toml")
    text = (tmp_path / "rig.toml").read_text()
    for old in ("width_px", "height_px", "centre_px", "rotation_rad", "translation_mm"):
        text = text.replace(old, old.rpartition("_")[0])
    (tmp_path / "old.toml").write_text(text)  # as version 0.1.0 wrote it
    with pytest.warns(RenamedKeyWarning, match=r"left\.centre is now called left\.centre_px"):
        assert read_rig(tmp_path / "old.toml") == rig
    with pytest.raises(ValueError, match="at least 4"):
        calibrated(make_rig(), np.random.default_rng(2), poses=3)


def test_a_calibration_from_pictures(tmp_path):
    rng, pattern = np.random.default_rng(3), Pattern((7, 9), PITCH)
    design, pictures = np.column_stack([pattern.corners(), np.ones(63)]), []
    for seed in range(5):
        points = tilted(pattern.corners(), rng, tilt=0.35, shift=1.0)
        axes = np.linalg.lstsq(design, points, rcond=None)[0]

        def move(at, axes=axes):
            return np.column_stack([at, np.ones(len(at))]) @ axes

        pictures.append(photograph(SMALL, move, pattern, seed))
    half = pictures[0].copy()
    half[:, 320:450] = 128
    folder = write_folder(tmp_path / "target", [*pictures, half])
    arguments = ["--rows", "7", "--columns", "9", "--pitch-mm", str(PITCH), "--out", str(tmp_path)]
    done = CliRunner().invoke(app, ["stereo", str(folder), *arguments])
    assert done.exit_code == 0, done.output
    assert "picture 5" in done.output
    rig = read_rig(tmp_path / "stereo.toml")
    assert rig.error < 0.03  # corners are good to 0.009 px, foreshortened ones to twice that
    assert rig.left.focal == pytest.approx(20.0, rel=1e-3)
    turned = Rotation.from_rotvec(rig.right.rotation).inv()
    turned *= Rotation.from_rotvec(SMALL.right.rotation)
    assert np.degrees(turned.magnitude()) < 0.5
    with pytest.raises(ValueError, match="0 pictures show the target"):
        calibrate_from_pictures(folder, (8, 9), PITCH)


def test_the_contact_region_is_that_of_the_arrays(surface):
    rng, move, pitch = np.random.default_rng(4), surface.motions[3], 0.5
    flat = Pattern((20, 20), pitch).corners()
    rest = np.column_stack([flat, np.zeros(400)])
    regions = []
    for points in (move(flat), triangulate(SMALL, *see(SMALL, move(flat), rng)).points):
        frame = Frame(points, 0.0, 0)
        stencils = make_stencils(MarkerLayout(rest, grid_neighbours((20, 20)), (20, 20)))
        regions.append(
            measure_fields(stencils, frame, onset_mm=ONSET_MM, share=CONTACT_SHARE).contact
        )
    assert regions[0].sum() > 50
    # 2 µm of noise shifts the rim, where the depth falls by 0.1 mm per mm, by 0.04 pitches
    assert (regions[0] != regions[1]).sum() <= 2


def test_a_rendered_pivot(pictures, surface, tmp_path):
    recording = read(tmp_path / "pivot", pictures)
    assert recording.unit == "mm"
    assert recording.positions.shape[2] == 3
    assert not any(recording.flaws)
    corners = CODED.corners()
    nearest = np.linalg.norm(recording.layout.reference[:, None, :2] - corners, axis=-1).argmin(1)
    assert len(nearest) >= 90
    for frame, move in enumerate(surface.motions):
        error = 1e3 * (recording.positions[frame] - move(corners)[nearest])
        # about 0.01 and 0.015 px in the two views; edges are curved where the gel bends
        assert np.nanmedian(np.linalg.norm(error, axis=1)) < 3.0
        assert np.nanmax(np.linalg.norm(error, axis=1)) < 40.0


def test_a_plain_pattern_is_matched_by_how_the_views_fit(surface, tmp_path):
    pictures = [photograph(SMALL, move, PLAIN, 7) for move in surface.motions[:2]]
    recording = read(tmp_path / "plain", pictures)
    error = recording.layout.reference[:, 2]
    assert np.abs(error).max() < 0.01  # a match beside would lie 2 mm off
    assert not any(recording.flaws)


def test_what_is_wrong_with_a_view_is_labelled(pictures, tmp_path):
    dark, covered = pictures[1].copy(), pictures[2].copy()
    dark[:, 320:] = 0
    covered[:, 320:520] = 128
    recording = read(tmp_path / "views", [pictures[0], dark, covered, pictures[3]])
    assert recording.flaws[1] == "the right view is black"
    assert "right view: only" in recording.flaws[2]
    assert recording.flaws[3] == ""
    spot = pictures[3].copy()  # a cover of 4.5 mm on a contact of 6 mm
    cv2.circle(spot, (160, 120), 45, 128, -1)
    cv2.circle(spot, (480, 120), 45, 128, -1)
    torn = pictures[3].copy()  # by 0.55 mm, from a line on the pad onwards
    torn[:, 160:320] = np.roll(torn, 11, axis=0)[:, 160:320]
    torn[:, 480:] = np.roll(torn, 11, axis=0)[:, 480:]
    recording = read(tmp_path / "pads", [pictures[0], pictures[3], spot, torn])
    assert recording.flaws[:2] == ("", "")
    assert "contact's centre is visible" in recording.flaws[2]
    assert "torn" in recording.flaws[3] or "is ambiguous" in recording.flaws[3]
    first_dark = read(tmp_path / "first", [dark, *pictures[:2]])
    assert first_dark.flaws == ("the right view is black", "", "")


def test_swapped_views_and_other_calibrations_are_refused(pictures, tmp_path):
    swapped = [np.roll(one, 320, axis=1) for one in pictures[:2]]
    with pytest.raises(ValueError, match="views are swapped"):
        read(tmp_path / "swapped", swapped)
    right = replace(SMALL.right, focal=1.05 * SMALL.right.focal)
    other = Rig(SMALL.left, right, 320, 240, 0.02)
    with pytest.raises(ValueError, match="another camera's calibration"):
        read(tmp_path / "other", pictures[:2], other)
    with pytest.raises(ValueError, match="calibrate at this size"):
        read(tmp_path / "size", pictures[:2], make_rig(640, 480))
    with pytest.raises(ValueError, match=r"tilted by 7\.5°"):  # seen from 45°, taken for 38°
        read(tmp_path / "turned", pictures[:2], make_rig(320, 240, degrees=38.0))


def test_a_mirrored_view_is_turned_round_or_refused(pictures, tmp_path):
    mirrored = [np.concatenate([one[:, :320], one[:, :319:-1]], axis=1) for one in pictures[:3]]
    with pytest.raises(ValueError, match="is one mirrored"):
        read(tmp_path / "refused", mirrored)
    mirrored_rig = replace(SMALL, mirrored=("right",))
    write_rig(mirrored_rig, tmp_path / "rig.toml")
    folder = write_folder(tmp_path / "mirrored", mirrored)
    turned = read_recording(folder, ImageSettings(Sensor(), rig=read_rig(tmp_path / "rig.toml")))
    plain = read(tmp_path / "plain", pictures[:3])
    np.testing.assert_array_equal(turned.positions, plain.positions)
    there = turned.positions[0]
    spots, unturned = mirrored_rig.locate(there), SMALL.locate(there)
    np.testing.assert_allclose(spots[1, :, 0] + unturned[1, :, 0], 2 * 320 + 319)
    with pytest.raises(ValueError, match="left or right"):
        replace(SMALL, mirrored=("top",))


def test_run_shows_both_views(pictures, tmp_path):
    folder, out = write_folder(tmp_path / "pivot", pictures), tmp_path / "out"
    write_rig(SMALL, tmp_path / "rig.toml")
    options = ["--stereo", str(tmp_path / "rig.toml"), "--preview", "--noise-um", "2"]
    done = CliRunner().invoke(run_app, ["run", str(folder), "--out", str(out), *options])
    assert done.exit_code == 0, done.output
    shown = [one.image for one in read_pictures(out / "preview.mp4")]
    assert len(shown) == len(pictures)
    assert shown[3].shape == (3 * 240 + 2 * 30, 3 * 640, 3)  # two lines of text
    for half in np.split(shown[3], 2, axis=1):
        assert (half[..., 1].astype(int) - half[..., 2] > 60).any()  # green rings: what sticks
