"""Softness is applied by Eq. (13), in one sign, within what it was found on, and kept in files."""

from dataclasses import replace

import numpy as np
import pytest

from contactmodel.common.inputs import RenamedKeyWarning
from estimation.estimators.result import State
from estimation.fields.measure import measure_fields
from estimation.fields.stencils import make_stencils
from estimation.frames.noise import Noise
from estimation.output.found import describe_softness
from estimation.softness import (
    Contact,
    ScalarSoftness,
    Softness,
    Validity,
    read_softness,
    write_softness,
)
from estimation.tracking.tracker import estimate_angles
from tests.cases import domed_pad, frame_of, lift

ANGLES = np.radians(np.linspace(0.0, 10.0, 11))
MICRON = Noise.from_std(1e-3)


def test_softness_scales_the_angle_and_widens_the_interval():
    recording = lift(ANGLES)
    rigid = estimate_angles(recording, noise=MICRON)
    soft = ScalarSoftness(0.5, 0.02, ((0.01, 0.0), (0.0, 0.0)))
    corrected = estimate_angles(recording, noise=MICRON, softness=soft)
    answered = rigid.answered
    expected = 1.5 * rigid.angle - 0.01
    np.testing.assert_allclose(corrected.angle[answered], expected[answered], atol=1e-14)
    half = (corrected.high - corrected.angle)[answered]
    from_noise = 1.5 * (rigid.high - rigid.angle)[answered]
    from_softness = 1.959964 * 0.1 * np.abs(rigid.angle[answered])
    np.testing.assert_allclose(half, np.hypot(from_noise, from_softness), rtol=1e-10)


def test_softness_files(tmp_path):
    path = tmp_path / "soft.toml"
    path.write_text("format_version = 1\nstiffness_ratio = 0.3\nload_term_rad = 0.01\n")
    assert read_softness(path) == ScalarSoftness(0.3, 0.01)
    path.write_text(
        "format_version = 1\nstiffness_ratio = 0.3\ncovariance = [[1e-4, 2e-5], [2e-5, 1e-5]]\n"
    )
    assert read_softness(path).covariance == ((1e-4, 2e-5), (2e-5, 1e-5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stiffness_ratio = 0.3", "format_version is missing"),
        (
            "format_version = 1\nload_term_rad = 0.1",
            "the key 'stiffness_ratio' is missing: give k, 0",
        ),
        ("format_version = 1\nstiffness_ratio = true", "stiffness_ratio must be a number"),
        ("format_version = 2", "format_version is 2"),
        ("format_version = 1\nk = 0.3", "unknown key 'k'"),
        ("format_version = 1\nkind = 'magic'", "unknown kind of softness 'magic'"),
        (
            "format_version = 1\nkind = ['scalar']",
            r"soft.toml: unknown kind of softness \['scalar'\]",
        ),
        ("format_version = 1\nstiffness_ratio = 1\nvalidity = 3", "validity must be a table"),
        (f"format_version = 1\nstiffness_ratio = {10**400}", "too large a number"),
        ("format_version = 1\nstiffness_ratio = 1\nload_by_force = 1", "true or false"),
        (
            "format_version = 1\nstiffness_ratio = 1\n[validity]\nrotation_deg = [2, 1]",
            "validity: rotation_deg is out of order: give the lower end first",
        ),
        (
            "format_version = 1\nstiffness_ratio = -1",
            "stiffness_ratio is -1.0; it must be a number from 0",
        ),
        (
            "format_version = 1\nstiffness_ratio = 0\ncovariance = [[1, 2], [2, 1]]",
            "negative eigenvalues",
        ),
        ("format_version = 1\ncovariance = [1, 2]", "soft.toml"),
        ("k =", "not a TOML file"),
    ],
)
def test_bad_softness_files(tmp_path, text, message):
    path = tmp_path / "soft.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_softness(path)


def test_files_return_what_was_written(tmp_path):
    soft = ScalarSoftness(
        0.3,
        -0.01,
        ((1e-4, -2e-5), (-2e-5, 1e-5)),
        load_by_force=True,
        validity=Validity(rotation=(-0.25, 0.5), normal_force=(1.0, 4.0)),
        provenance={"recordings": ["a", 'b "c"'], "grasps": 2, "reference": "outline"},
    )
    write_softness(soft, tmp_path / "soft.toml")
    again = read_softness(tmp_path / "soft.toml")
    assert isinstance(again, ScalarSoftness)
    # degrees and back: two roundings
    assert again.validity.rotation == pytest.approx(soft.validity.rotation, rel=1e-15)
    assert replace(again, validity=soft.validity) == soft


def test_files_of_version_0_1_0_are_read_and_say_what_changed(tmp_path):
    path = tmp_path / "soft.toml"
    path.write_text(
        "format_version = 1\nstiffness_ratio = 0.3\n[validity]\nnormal_force_N = [1.0, 4.0]\n"
    )
    with pytest.warns(RenamedKeyWarning, match="is now called validity.normal_force_n"):
        read = read_softness(path)
    assert read == ScalarSoftness(0.3, validity=Validity(normal_force=(1.0, 4.0)))


def test_load_in_proportion_to_the_normal_force():
    recording = lift(ANGLES)
    soft = ScalarSoftness(0.5, 0.01, ((0.0, 0.0), (0.0, 1e-6)), load_by_force=True)
    result = estimate_angles(recording, noise=MICRON, softness=soft)
    assert set(result.state[5:]) == {State.UNKNOWN}
    assert "needs the normal force" in result.reason[5]
    force = np.zeros((len(recording), 3))
    force[:, 2] = -2.0
    pressed = estimate_angles(replace(recording, force=force), noise=MICRON, softness=soft)
    same = ScalarSoftness(0.5, 0.02, ((0.0, 0.0), (0.0, 4e-6)))
    expected = estimate_angles(recording, noise=MICRON, softness=same)
    for name in ("angle", "low", "high"):
        np.testing.assert_allclose(getattr(pressed, name), getattr(expected, name), rtol=1e-12)


def test_contacts_unlike_those_of_the_fit_are_told():
    recording = lift(ANGLES)
    far = ScalarSoftness(0.5, validity=Validity(rotation=(-0.01, np.radians(5.5))))
    result = estimate_angles(recording, noise=MICRON, softness=far)
    np.testing.assert_array_equal(result.covered[5:], np.radians(5.5) > ANGLES)
    small = ScalarSoftness(0.5, validity=Validity(contact_radius=(1.0, 2.0)))
    assert not estimate_angles(recording, noise=MICRON, softness=small).covered[5:].any()


def test_angles_of_the_print_are_not_scaled_by_k():
    """A contact beyond the range of the softness, whose print is read in three of five frames."""
    track = estimate_angles(lift(ANGLES[:5], unloaded=0), noise=MICRON)
    soft = {"stiffness_ratio": np.full(5, 0.5), "covered": np.zeros(5, dtype=bool)}
    track = replace(track, angle=np.radians(np.arange(5.0)), **soft)
    imprint = np.array([0.0, 0.1, 0.2, np.nan, np.nan])
    printed, beyond = describe_softness(track, imprint)
    assert printed.startswith("3 of 5 angles come from the object's print")
    assert beyond.startswith("2 of 5 angles come from contacts unlike those in")
    (beyond,) = describe_softness(replace(track, method="incremental"), imprint)
    assert beyond.startswith("5 of 5")


def test_radius_of_a_contact_is_that_of_a_disc():
    layout = domed_pad((41, 41), pitch=0.25)
    fields = measure_fields(make_stencils(layout), frame_of(layout.reference))
    disc = np.hypot(*layout.reference[:, :2].T) < 4.0
    contact = Contact(fields._replace(contact=disc))
    assert contact.radius == pytest.approx(4.0, abs=0.125)  # half a pitch
    assert isinstance(ScalarSoftness(), Softness)
