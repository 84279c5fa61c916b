"""A part of the pictures, and a picture of the unloaded sensor: markers stay where they are."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import KDTree
from typer.testing import CliRunner

from estimation.__main__ import app
from estimation.inputs import identity_of
from estimation.output.record import RecordReader
from estimation.pictures.dots.reader import DotReader
from estimation.pictures.dots.surroundings import find_mirrors
from estimation.pictures.part import Part
from estimation.pictures.reader import ImageSettings
from estimation.pictures.reading import read_images
from estimation.pictures.sensor import Lens, Sensor
from estimation.pictures.still import Still, read_still
from estimation.pictures.stream import Picture, read_pictures
from estimation.settings import Settings
from tests.estimation.pictures import boards, speckles
from tests.estimation.pictures.scenes import PITCH, RADIUS, REST, picture, twisted
from tests.estimation.pictures.test_reading import write_folder

RIM = (44, 30)
"""Columns and rows of a frame around the pad, left and above; a mirror is on the right."""
SENSORS = {
    "dots": Sensor(marker="dots", dark=True, radius=4.3),
    "corners": Sensor(marker="corners"),
    "speckle": Sensor(marker="speckle"),
}


def clip(kind):
    """The pad at rest, twisted and twisted further."""
    if kind == "dots":
        rng = np.random.default_rng(0)
        return [picture(twisted(angle, rigid=50.0), rng) for angle in (0.0, 2.0, 4.0)]
    if kind == "corners":
        return [boards.scene(boards.CODED, boards.twist(angle)).image for angle in (0.0, 2.0, 4.0)]
    small = speckles.CAMERA._replace(width=180, height=140)
    motions = [speckles.Motion(angle, rigid=40.0, still=70.0) for angle in (0.0, 2.0, 4.0)]
    return [speckles.speckle(motion, camera=small) for motion in motions]


def framed(image):
    """The picture in a black frame, beside a mirror that shows it once more."""
    mirror = image[:, ::-1]
    left, above = RIM
    return cv2.copyMakeBorder(
        np.hstack([image, mirror]), above, 10, left, 6, cv2.BORDER_CONSTANT, value=(0, 0, 0)
    )


@pytest.fixture(scope="module", params=SENSORS)
def alone(request, tmp_path_factory):
    """Kind of markers, pictures of them, and what is read of the pictures as they are."""
    images = clip(request.param)
    folder = write_folder(tmp_path_factory.mktemp("alone") / "clip", images)
    settings = ImageSettings(SENSORS[request.param], 0)
    return request.param, images, read_images(folder, settings)


def test_a_crop_leaves_frame_and_mirror_out_and_positions_in_the_whole_picture(alone, tmp_path):
    kind, images, whole = alone
    folder = write_folder(tmp_path / "framed", [framed(one) for one in images])
    part = Part((*RIM, images[0].shape[1], images[0].shape[0]))
    cropped = read_images(folder, ImageSettings(SENSORS[kind], 0, part=part))
    assert np.allclose(cropped.positions, whole.positions + RIM, atol=1e-9, equal_nan=True)
    assert np.allclose(cropped.layout.reference, whole.layout.reference + RIM, atol=1e-9)
    assert np.array_equal(cropped.contact, whole.contact)
    assert "px from column 44, row 30 on" in cropped.notes[0]


def test_a_mask_leaves_out_what_lies_under_it(alone, tmp_path):
    kind, images, whole = alone
    edge = round(0.72 * images[0].shape[1])
    shown = np.full(images[0].shape, 255, np.uint8)
    shown[:, edge:] = 0
    covered = [one.copy() for one in images]
    for number, one in enumerate(covered):  # what is masked changes wildly
        one[:, edge:] = np.random.default_rng(number).integers(0, 255, one[:, edge:].shape)
    mask = Still(tmp_path / "mask.png", shown)
    folder = write_folder(tmp_path / "covered", covered)
    masked = read_images(folder, ImageSettings(SENSORS[kind], 0, part=Part(mask=mask)))
    rest = masked.layout.reference
    assert 0.5 < len(rest) / len(whole.layout.reference) < 0.8
    assert rest[:, 0].max() < edge
    assert not any("recognised" in flaw for flaw in masked.flaws)
    # what is read is read as it was; speckle may choose other points
    off, same = KDTree(whole.layout.reference).query(rest)
    same = same[off < 0.02]
    assert len(same) > 0.9 * len(rest) or kind == "speckle"
    moved = masked.positions[2][off < 0.02] - whole.positions[2][same]
    assert not len(moved) or np.nanquantile(np.abs(moved), 0.95) < 0.03


def test_a_mask_over_a_contact_is_noticed():
    square = np.array([[20.0, 20.0], [20.0, 60.0], [60.0, 20.0], [60.0, 60.0], [np.nan, np.nan]])
    mask = np.full((100, 120), 255, np.uint8)
    for width, hidden in ((10, False), (20, True)):
        mask[:, 40 : 40 + width] = 0  # a quarter of the square, then a half
        part = Part(crop=(10, 0, 100, 90), mask=Still(Path("mask.png"), mask))
        assert part.hides(square - part.origin) == hidden
    assert not Part().hides(square)
    assert not part.hides(square[-1:])


def test_a_crop_keeps_scale_and_lens_right(tmp_path):
    matrix = np.array([[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]])
    lens = Lens(matrix, np.array([-0.15, 0.02, 0.0, 0.0, 0.0]))
    sensor = replace(SENSORS["dots"], lens=lens, mm_per_px=0.05, size=(320, 240))
    rng = np.random.default_rng(0)
    images = [picture(lens.distort(twisted(angle, rigid=50.0)), rng) for angle in (0.0, 5.0)]
    folder = write_folder(tmp_path / "bent", images)
    whole = read_images(folder, ImageSettings(sensor, 0))
    part = read_images(folder, ImageSettings(sensor, 0, part=Part((30, 20, 250, 190))))
    off, same = KDTree(whole.layout.reference).query(part.layout.reference)
    inside = off < 1e-3  # but for dots that the crop cuts
    assert inside.sum() > 50
    moved = part.positions[1][inside] - whole.positions[1][same[inside]]
    assert np.nanmax(np.abs(moved)) < 1e-3
    known = replace(sensor, reference=whole.layout.reference)
    described = read_images(folder, ImageSettings(known, part=Part((30, 20, 250, 190))))
    assert np.allclose(described.layout.reference, whole.layout.reference, atol=1e-9)


@pytest.mark.parametrize(
    ("part", "why"),
    [
        (lambda _: Part((300, 0, 40, 40)), "reaches beyond the pictures, which are 320×240"),
        (lambda _: Part((-1, 0, 40, 40)), "must begin within the picture"),
        (lambda _: Part((0, 0, 9, 40)), "at least 16 px"),
        (lambda path: Part(mask=Still(path, np.zeros((240, 320)))), "completely black"),
        (lambda path: Part(mask=Still(path, np.full((24, 32), 255))), "32×24, the pictures are"),
    ],
)
def test_a_part_that_the_pictures_do_not_have_is_refused(part, why, tmp_path):
    folder = write_folder(tmp_path / "clip", clip("dots")[:1])
    with pytest.raises(ValueError, match=why):
        read_images(folder, ImageSettings(SENSORS["dots"], part=part(tmp_path / "mask.png")))


def test_an_unloaded_picture_is_the_reference(tmp_path):
    images = clip("dots")
    settings = ImageSettings(SENSORS["dots"], 0)
    named = read_images(write_folder(tmp_path / "named", images), settings)
    cv2.imwrite(str(tmp_path / "rest.png"), images[0])
    still = read_still(tmp_path / "rest.png", "the unloaded picture (--unloaded)")
    folder = write_folder(tmp_path / "clip", images[1:])
    given = read_images(folder, replace(settings, unloaded=still))
    assert np.array_equal(given.layout.reference, named.layout.reference)
    assert np.array_equal(given.positions, named.positions[1:], equal_nan=True)
    assert not [one for one in given.warnings if "unloaded" in one]
    large = Still(still.path, cv2.resize(still.image, (640, 480)))
    with pytest.raises(ValueError, match=r"rest\.png is 640×480, .*; those of .* are 320×240, "):
        read_images(folder, replace(settings, unloaded=large))
    grey = still.image.ndim == 2
    other = cv2.cvtColor(still.image, cv2.COLOR_GRAY2BGR if grey else cv2.COLOR_BGR2GRAY)
    kind = "in colour; those of .* grey" if grey else "grey; those of .* in colour"
    with pytest.raises(ValueError, match=rf"rest\.png is 320×240, {kind}: give one like them"):
        read_images(folder, replace(settings, unloaded=Still(still.path, other)))
    (tmp_path / "bad.png").write_bytes(b"no picture")
    with pytest.raises(ValueError, match=r"bad\.png, given as x, is not an image"):
        read_still(tmp_path / "bad.png", "x")


def test_an_unloaded_picture_of_another_sensor_is_refused_or_doubted(tmp_path):
    rng = np.random.default_rng(1)
    folder = write_folder(tmp_path / "clip", clip("dots"))
    settings = ImageSettings(SENSORS["dots"])
    other = Still(tmp_path / "other.png", picture(1.4 * REST, rng))
    with pytest.raises(ValueError, match=r"are not those of .*give a picture of the same sensor"):
        read_images(folder, replace(settings, unloaded=other))
    shifted = Still(tmp_path / "shifted.png", picture(REST + np.array([0.25 * PITCH, 0.0]), rng))
    doubted = read_images(folder, replace(settings, unloaded=shifted))
    assert "is it of the same sensor" in " ".join(doubted.warnings)


@pytest.mark.parametrize(("width", "doubted"), [(320, False), (368, True), (426, True)])
def test_pictures_that_are_stretched_are_doubted(width, doubted, tmp_path):
    images = [cv2.resize(image, (width, 240)) for image in clip("dots")[:2]]
    folder = write_folder(tmp_path / "clip", images)
    read = read_images(folder, ImageSettings(Sensor(marker="dots")))
    assert ("the pictures are stretched" in " ".join(read.warnings)) == doubted


def test_run_takes_crop_mask_and_unloaded_picture_and_shows_them(tmp_path):
    images = [framed(one) for one in clip("dots")]
    folder = write_folder(tmp_path / "clip", images)
    shown = np.zeros(images[0].shape, np.uint8)
    shown[RIM[1] : RIM[1] + 240, RIM[0] : RIM[0] + 320] = 255
    cv2.imwrite(str(tmp_path / "mask.png"), shown)
    cv2.imwrite(str(tmp_path / "rest.png"), images[0])
    out = tmp_path / "out"
    options = ["--mask", str(tmp_path / "mask.png"), "--unloaded", str(tmp_path / "rest.png")]
    options += ["--crop", "20", "20", "360", "252", "--noise-px", "0.01", "--preview"]
    done = CliRunner().invoke(app, ["run", str(folder), "--out", str(out), "--fps", "30", *options])
    assert done.exit_code == 0, done.output
    summary = (out / "summary.json").read_text()
    for text in ('"mask": ', '"unloaded": ', '"crop_px": [', "positions are in the whole picture"):
        assert text in summary
    frame = next(iter(read_pictures(out / "preview.mp4"))).image
    bright = frame[100:500:40, 3 * 200].mean(), frame[100:500:40, 3 * 600].mean()
    assert bright[0] > 1.5 * bright[1]  # the mirror is left out
    with RecordReader(out / "record.sqlite") as record:
        kept = list(record.markers())
    assert len(kept) == len(images)
    for one in kept:  # small copies of the part, whose dots lie where the markers are
        copy = cv2.imdecode(np.frombuffer(one.picture, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert copy.shape == (224, 320)
        column, row = np.rint(one.spots[0][one.valid]).astype(int).T
        dots, beside = copy[row, column], copy[row, np.clip(column + 11, 0, 319)]
        assert np.median(dots) < 0.6 * np.median(beside)


def test_another_part_or_unloaded_picture_is_another_command(tmp_path):
    dark = Still(tmp_path / "mask.png", np.full((24, 32), 255, np.uint8))
    grey = Still(tmp_path / "mask.png", np.full((24, 32), 250, np.uint8))
    identities = [
        str(identity_of("", Settings(images=images)))
        for images in (
            ImageSettings(),
            ImageSettings(part=Part((0, 0, 20, 20))),
            ImageSettings(part=Part(mask=dark)),
            ImageSettings(part=Part(mask=grey)),
            ImageSettings(unloaded=dark),
        )
    ]
    assert len(set(identities)) == len(identities)


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("width", [15, 24, 40])  # between rows, and just beyond one
def test_a_strip_that_reflects_the_dots_is_found(side, width):
    pad = picture(twisted(6.0, rigid=50.0), np.random.default_rng(3)).astype(float)
    turned = np.rot90(pad, side)
    turned[:width] = 0.8 * turned[width : 2 * width][::-1]
    hidden = np.rot90(find_mirrors(pad, RADIUS, PITCH), side)
    assert hidden[: width + 1].all()
    assert not hidden[width + 3 * round(RADIUS) :].any()


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("tilt", [-4.0, -1.7, 2.6])  # of the mirror's edge [deg]
def test_an_oblique_mirror_is_found(side, tilt):
    pad = picture(twisted(6.0, rigid=50.0), np.random.default_rng(3)).astype(np.float32)
    turned = np.rot90(pad, side)
    height, width = turned.shape
    along = np.array([np.cos(np.radians(tilt)), np.sin(np.radians(tilt))])
    reflect = 2.0 * np.outer(along, along) - np.eye(2)
    on = np.array([0.5 * width, 36.0])
    mirrored = np.column_stack([reflect, on - reflect @ on])
    reflected = cv2.warpAffine(np.ascontiguousarray(turned), mirrored, (width, height))
    y, x = np.indices(turned.shape)
    beyond = along[0] * (y - on[1]) - along[1] * (x - on[0])  # distance from the edge, inwards
    turned[beyond < 0.0] = 0.7 * reflected[beyond < 0.0]
    hidden = np.rot90(find_mirrors(pad, RADIUS, PITCH), side)
    assert hidden[beyond < 0.0].mean() > 0.99
    assert not hidden[beyond > 3.0 * RADIUS].any()


def test_rows_of_dots_alone_and_a_shadow_along_a_side_are_no_mirror():
    pad = picture(REST, np.random.default_rng(3)).astype(float)
    assert not find_mirrors(pad, RADIUS, PITCH).any()
    shadow = pad.copy()
    shadow[:30] *= 0.8  # the rows go on in it: its edge is no line of symmetry
    assert not find_mirrors(shadow, RADIUS, PITCH).any()


def test_a_dark_frame_and_a_mirror_are_named(tmp_path):
    images = [picture(REST, np.random.default_rng(i)) for i in range(2)]
    for image in images:
        image[:, :30] = 4
        image[-30:] = 0.8 * image[-60:-30][::-1]
    read = read_images(write_folder(tmp_path / "clip", images))
    notes = " ".join(read.notes)
    assert "a dark frame" in notes
    assert "mirrors" in notes
    assert read.layout.reference[:, 0].min() > 30.0
    assert read.layout.reference[:, 1].max() < 210.0


def test_a_frame_whose_print_was_rejected_keeps_nothing_of_it():
    first = Picture(picture(REST, np.random.default_rng(0)), time=0.0, number=0)
    reader = DotReader(first, ImageSettings(SENSORS["dots"]))
    none = reader.frame(reader.read(first))
    touched = np.ones(len(reader.layout.reference), dtype=bool)
    print_ = {"imprint": (0.1, 0.01), "print_point": (1.0,) * 7, "hold": (1.0,) * 3}
    frames = [replace(none, contact=touched, source_index=i, **print_) for i in range(2)]
    reader.by_dots.clear()
    reader.unprinted.add(1)
    kept, rejected = reader.reevaluate(frames)
    for name, values in print_.items():
        assert getattr(kept, name) == values
        assert np.isnan(getattr(rejected, name)).all()
