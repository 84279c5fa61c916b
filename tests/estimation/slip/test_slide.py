"""How far the object has slid over the gel, from where its print and the markers are."""

import numpy as np
import pytest

from estimation.frames.recording import layout_markers
from estimation.slip.slide import RECENT_FRAMES, SlideWatch

REST = np.stack(np.meshgrid(np.arange(9.0), np.arange(9.0)), -1).reshape(-1, 2)
LAYOUT = layout_markers(REST)
MIDDLE = np.array([4.0, 4.0])
AWAY = np.linalg.norm(REST - MIDDLE, axis=1)
TOUCHED = AWAY < 3.5
ALL = np.ones_like(TOUCHED)
SURE = (1e-4, 1e-4, 0.0)
"""Variances of the print's place, and their covariance [mm²]."""
RADIUS = 2.4477
NOWHERE = (np.nan,) * 7


def turned(points, angle):
    c, s = np.cos(angle), np.sin(angle)
    return MIDDLE + (points - MIDDLE) @ np.array([[c, s], [-s, c]])


def watch(places, turns, gels, spread=SURE, turn_error=0.0):
    """Slip while the object goes to places and turns, and the gel under it to others [mm, rad]."""
    watched = SlideWatch(LAYOUT)
    return [
        watched.update(
            gel, TOUCHED, (turn, turn_error), (*MIDDLE, *(MIDDLE + place), *spread), float(i)
        )
        for i, (place, turn, gel) in enumerate(zip(places, turns, gels, strict=True))
    ]


def test_gel_that_goes_with_the_object_is_not_slid_over():
    """A core of three pitches sticks, around it the gel stays behind."""
    share = np.clip(1.8 - 0.4 * AWAY, 0.0, 1.0)[:, None]
    far, turn = np.array([1.5, -0.7]), 0.2
    held = REST + share * (turned(REST, turn) + far - REST)
    slide = watch([0.0, far], [0.0, turn], [REST, held])[-1]
    assert slide.slip == pytest.approx(0.0, abs=1e-12)
    assert slide.slip_since == 0.0


@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_the_slip_is_how_far_the_object_has_gone_beyond_the_gel(turn):
    far, gel = np.array([2.0, 1.0]), np.array([0.3, 0.15])
    slide = watch([0.0, far], [0.0, turn], [REST, turned(REST, turn) + gel])[-1]
    assert slide.slip == pytest.approx(np.linalg.norm(far - gel))


def test_the_contact_may_leave_the_markers_that_it_began_on():
    far = np.array([6.0, 0.0])
    watched = SlideWatch(LAYOUT)
    watched.update(REST, TOUCHED, (0.0, 0.0), (*MIDDLE, *MIDDLE, *SURE), 0.0)
    there = np.linalg.norm(REST - MIDDLE - far, axis=1) < 3.5
    slide = watched.update(REST, there, (0.01, 0.0), (*MIDDLE, *(MIDDLE + far), *SURE), 1.0)
    assert slide.slip == pytest.approx(6.0, abs=0.05)


@pytest.mark.parametrize("error", [0.0, 0.01])
def test_an_error_of_the_rotation_does_not_lower_the_slip(error):
    """The object slides by 1 mm, and its print seems to turn by 0.01 rad."""
    far = np.array([1.0, 0.0])
    slide = watch([0.0, far], [0.0, 0.01], [REST, REST], turn_error=error)[-1]
    assert (slide.slip == pytest.approx(1.0, abs=1e-4)) == (error > 0.0)
    assert slide.slip + slide.slip_error > 1.0


def test_the_slip_counts_from_the_first_frame_with_contact():
    """The print has been followed before, in frames that turned out to be without contact."""
    watched, slides = SlideWatch(LAYOUT), []
    for i, x in enumerate((0.0, 1.0, 2.0, 3.5)):
        point = (*MIDDLE, *(MIDDLE + np.array([x, 0.0])), *SURE)
        slides.append(watched.update(REST, TOUCHED & (i != 1), (0.02 * x, 0.0), point, float(i)))
    again, later = slides[2:]
    assert again.slip == 0.0
    assert again.slip_since == later.slip_since == 2.0
    assert later.slip == pytest.approx(1.5, abs=0.1)


def test_the_interval_has_the_errors_of_place_turn_and_shear():
    """Of the markers that go with the object the first is that with the least of them."""
    far = np.array([1.0, 0.0])
    spread = (4e-4, 1e-4, 0.0)
    place, sheared = (
        watch([0.0, far], [0.0, 0.0], [REST, REST + gel], spread)[-1] for gel in (0.0, far / 2.0)
    )
    sheared_error = np.hypot(0.02, 0.08 * 0.5)
    assert place.slip_error == pytest.approx(RADIUS * np.hypot(0.02, 0.003))
    assert sheared.slip_error == pytest.approx(RADIUS * np.hypot(sheared_error, 0.003))
    one = np.zeros_like(TOUCHED)
    one[np.flatnonzero(AWAY == 3.0)[0]] = True
    watched = SlideWatch(LAYOUT)
    turned_about = watched.update(REST, one, (0.0, 0.01), (*MIDDLE, *MIDDLE, 0.0, 0.0, 0.0), 0.0)
    assert turned_about.slip_error == pytest.approx(RADIUS * np.hypot(0.03, 0.003))


def test_a_print_that_is_alike_along_a_line_does_not_show_slip_that_way():
    along, across = (
        watch([0.0, np.array(way)], [0.0, 0.0], [REST, REST], (1e-4, 9.0, 0.0))[-1]
        for way in ((0.0, 0.5), (0.5, 0.0))
    )
    assert np.isnan(along.slip)
    assert np.isnan(across.slip)
    assert along.slip_error == pytest.approx(RADIUS * 3.0, rel=1e-4)
    assert along.beyond < 0.1
    assert across.beyond > 15.0


def test_slip_counts_anew_where_the_print_does():
    watched = SlideWatch(LAYOUT)
    still = (0.0, 0.0), (*MIDDLE, *MIDDLE, *SURE)
    watched.update(REST, TOUCHED, *still, 0.0)
    gone = watched.update(REST, TOUCHED, (0.0, 0.0), (*MIDDLE, *(MIDDLE + 1.0), *SURE), 1.0)
    assert gone.slip == pytest.approx(np.sqrt(2.0))
    assert is_unknown(watched.update(REST, TOUCHED, (np.nan, np.nan), NOWHERE, 2.0))
    anew = watched.update(REST, TOUCHED, *still, 3.0)
    assert (anew.slip, anew.slip_since) == (0.0, 3.0)


def test_nothing_is_known_without_contact_or_markers():
    watched = SlideWatch(LAYOUT)
    known = (0.0, 0.0), (*MIDDLE, *MIDDLE, *SURE), 0.0
    assert is_unknown(watched.update(REST, ~ALL, *known))
    assert is_unknown(watched.update(np.full_like(REST, np.nan), ALL, *known))


def test_recent_slip_is_that_over_each_marker():
    """The object turns over resting gel, and stands still for the last frames."""
    turns = np.append(0.01 * np.arange(RECENT_FRAMES + 1), np.full(2, 0.01 * RECENT_FRAMES))
    still = np.zeros(len(turns))
    recent = watch(still, turns, [REST] * len(turns))[-1].recent
    chord = 2.0 * np.sin(0.5 * 0.01 * (RECENT_FRAMES - 2)) * AWAY
    np.testing.assert_allclose(recent.lately[TOUCHED], chord[TOUCHED], atol=1e-9)
    np.testing.assert_allclose(recent.just[TOUCHED], 2.0 * np.sin(0.01) * AWAY[TOUCHED], atol=1e-9)
    assert np.isnan(recent.lately[~TOUCHED]).all()
    goes_along = watch(still, turns, [turned(REST, turn) for turn in turns])[-1].recent
    assert np.nanmax(goes_along.lately) == pytest.approx(0.0, abs=1e-9)


def test_recent_slip_leaves_out_by_how_much_a_print_may_lead_sheared_gel():
    ways = np.linspace(0.0, 1.0, RECENT_FRAMES + 1)[:, None] * [1.0, 0.0]
    gels = [REST + 0.9 * way for way in ways]
    assert np.nanmax(watch(ways, np.zeros(len(ways)), gels)[-1].recent.lately) == 0.0


def test_recent_slip_is_unknown_where_the_print_is_alike_along_a_line():
    along = (1e-4, 9.0, 0.0)
    assert watch([0.0] * 9, np.zeros(9), [REST] * 9, along)[-1].recent is None


def test_recent_slip_leaves_out_the_error_of_a_rotation_that_a_search_has_found():
    """After a loss of the print the object seems to have turned by 0.05 ± 0.06 rad."""
    place, slips = (*MIDDLE, *MIDDLE, *SURE), []
    for error in (0.03, 0.005):
        watched = SlideWatch(LAYOUT)
        for i in range(6):
            watched.update(REST, TOUCHED, (0.0 if i == 0 else 1e-9, 0.005), place, float(i))
        slips.append(watched.update(REST, TOUCHED, (0.05, error), place, 6.0).recent)
    doubtful, known = slips
    assert doubtful is not None
    assert known is not None
    assert np.nanmax(doubtful.lately) == 0.0
    assert np.nanmax(known.lately) == pytest.approx(0.05 * AWAY[TOUCHED].max(), rel=0.01)


def is_unknown(slide):
    return slide.recent is None and np.isnan(slide[:4]).all()


def test_the_interval_reaches_to_the_slip_over_the_middle():
    """Outer markers at rest seem to follow an object that slides and turns best."""
    far, turn = np.array([2.0, 0.0]), 0.1
    slide = watch([0.0, far], [0.0, turn], [REST, REST])[-1]
    assert slide.slip < 1.7
    assert slide.slip + slide.slip_error > 2.0
    straight = watch([0.0, far], [0.0, 0.0], [REST, REST])[-1]
    assert straight.slip_error == pytest.approx(0.025, abs=0.005)


def test_recent_slip_does_not_begin_where_the_print_was_alike_along_a_line():
    watched, hidden = SlideWatch(LAYOUT), (9.0, 1e-4, 0.0)
    found = [
        watched.update(
            REST,
            TOUCHED,
            (0.0 if not i else 1e-9, 0.0),
            (*MIDDLE, *(MIDDLE + place), *(hidden if 0 < i < 4 else SURE)),
            float(i),
        )
        for i, place in enumerate([[0.0, 0.0], *[[0.6, 0.0]] * 3, *[[0.0, 0.0]] * 5])
    ]
    assert all(slide.recent is None for slide in found[1:4])
    lately = [slide.recent.lately[TOUCHED].max() for slide in found[4:]]
    assert np.isfinite(lately).all()
    assert max(lately) < 0.01
    assert np.nanmax([slide.recent.just[TOUCHED] for slide in found[4:]]) < 0.01
