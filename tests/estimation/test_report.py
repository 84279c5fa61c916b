"""The report: its answer in words, what it plays, and that it needs nothing and lets nothing in."""

import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from estimation.estimators.result import MOVES_ON, RESTS_OR_SLIDES, State, Track
from estimation.output.answer import describe_run, describe_turns, find_turns, show_time
from estimation.output.explain import explain_settings
from estimation.output.found import Run, _clock_notes, _reference_notes
from estimation.output.overview import _count_outcomes
from estimation.output.plots import choose_frames
from estimation.output.record import KeptMarkers
from estimation.output.report import render_report, summarise
from estimation.pictures.still import Album, copy_picture
from estimation.slip.alert import AlertLevel, GripPath
from estimation.slip.onset import MacroSlip
from estimation.slip.shear import Shear, ShearPath
from estimation.tracking.tracker import estimate_angles
from tests.browser import Browser
from tests.cases import lift

NAME = "</script><script>alert(1)</script><b>&"


@pytest.fixture(scope="module")
def answered():
    recording = lift(np.radians(np.linspace(0.0, 10.0, 4)))
    return recording, estimate_angles(recording)


def make_run(answered, angles, half=0.1, states=State.STICK, slip_probability=np.nan, **others):
    """A run of frames 0.1 s apart, with these angles of the object [deg]."""
    _, result = answered
    count, angle = len(angles), np.radians(np.asarray(angles, dtype=float))
    last = {name: getattr(result, name)[-1:] for name in Track.columns()}
    columns = {
        name: values * count if isinstance(values, tuple) else np.repeat(values, count)
        for name, values in last.items()
    }
    columns |= {
        "time": 5.0 + 0.1 * np.arange(count),
        "source_index": np.arange(count),
        "angle": angle,
        "low": angle - np.radians(half),
        "high": angle + np.radians(half),
        "state": (states,) * count if isinstance(states, str) else tuple(states),
        "reason": (others.pop("reason", ""),) * count,
        "since": np.full(count, 5.0),
        "restarts": np.asarray(others.pop("restarts", np.zeros(count, dtype=int))),
        "contact_markers": np.full(count, others.pop("contact", 20)),
    }
    track = Track(method="tracked", **columns)
    reference = np.random.default_rng(0).uniform(0.0, 20.0, (400, 3))
    slide = others.pop("slide", {})
    shears = [
        Shear(slip_probability=one, **slide)
        for one in np.broadcast_to(slip_probability, count).tolist()
    ]
    return Run(
        name="pivot",
        source="a test",
        convention="z out of the elastomer",
        unit="mm",
        reference=reference,
        settings={"onset_mm": 0.1, "softness": {"kind": "scalar", "load_term_rad": 0.0}},
        sha256="0" * 64,
        notes=others.pop("notes", ()),
        results={"tracked": track},
        method="tracked",
        outline=np.full(count, np.nan),
        imprint=np.full(count, np.nan),
        shears=ShearPath.of(*shears),
        grips=GripPath(*np.full((7, count), np.nan), level=(AlertLevel.WATCH,) * count),
        **{"markers": keep_markers(reference, range(count)), **others},
    )


def keep_markers(reference, rows, picture=None):
    """Kept markers that move to the right, with a picture if there is one."""
    spots = None if picture is None else 10.0 * reference[None, :, :2]

    def markers():
        for row in rows:
            seen = np.arange(len(reference)) > 3
            positions = reference + 1e-2 * row
            turned = np.zeros(len(reference))
            sticks = seen & (np.arange(len(reference)) < 300 - row % 200)
            yield KeptMarkers(row, positions, turned, seen, sticks, seen, picture, spots)

    return markers


def paint(width, height):
    """A noisy picture as JPEG, and as PNG."""
    image = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 2.0)
    return cv2.imencode(".jpg", image)[1].tobytes(), cv2.imencode(".png", image)[1].tobytes()


def render(run, size=(1170, 40)):
    """The page of a run, its figures being pictures of a size."""
    figures = dict.fromkeys(("angles.png", "maps.png", "moment.png"), paint(*size)[1])
    return render_report(run, summarise(run), figures)


UP_AND_BACK = [0, 4, 10, 5, -18.4]
SLIPS = (State.STICK,) * 3 + (State.MACRO_SLIP,) * 2


@pytest.mark.parametrize(
    ("angles", "others", "words"),
    [
        (
            UP_AND_BACK,
            {"states": SLIPS, "slips": (MacroSlip(5.25, 5.2, 5.3),)},
            "Turned to +10.0° ± 0.1°, back to −18.4° ± 0.1°; slipped 0.25 s after the first "
            "frame, at time_s 5.25",
        ),
        (
            UP_AND_BACK,
            {"states": SLIPS, "slips": (MacroSlip(5.25, 5.2, 5.3, 5.4),), "half": 0.023},
            "Turned to +10.00° ± 0.02°, back to −18.40° ± 0.02°; slipped 0.25 s after the first "
            "frame, at time_s 5.25, held again from 0.40 s",
        ),
        (
            UP_AND_BACK,
            {"states": SLIPS},
            "Turned to +10.0° ± 0.1°, back to −18.4° ± 0.1°; slipped, first seen 0.30 s "
            "after the first frame, at time_s 5.30",
        ),
        (
            [0, 12.34],
            {"half": 0.012, "slip_probability": 0.02},
            "Turned to +12.34° ± 0.01°; held to the end (probability of a slip 0.02)",
        ),
        (
            [0, 9, 0, 9],
            {"slip_probability": [0, 0, 0.9, 0]},
            "Turned to +9.0° ± 0.1°, back to 0.0° ± 0.1°, then to +9.0° ± 0.1°; slipped 0.20 s "
            "after the first frame, at time_s 5.20 (probability of a slip 0.90)",
        ),
        (
            [0, 9, 0, 9],
            {"slip_probability": [0, 0.9, 0, 0.9], "slide": {"slip": 0.734, "slip_error": 0.06}},
            "Turned to +9.0° ± 0.1°, back to 0.0° ± 0.1°, then to +9.0° ± 0.1°; first slipped "
            "0.10 s after the first frame, at time_s 5.10, slid by 0.73 ± 0.06 mm by the end "
            "(probability of a slip 0.90)",
        ),
        (
            [0, 9],
            {"slip_probability": 0.9, "slide": {"slip": 0.734, "slip_error": 0.06}},
            "Turned to +9.0° ± 0.1°; slipped 0.00 s after the first frame, at time_s 5.00, slid by "
            "0.73 ± 0.06 mm (probability of a slip 0.90)",
        ),
        (
            [0, 12.34],
            {"half": 0.012, "slip_probability": 0.3},
            "Turned to +12.34° ± 0.01°; probably held to the end (probability of a slip 0.30)",
        ),
        (
            [0, 9],
            {"slip_probability": [0, 0.7]},
            "Turned to +9.0° ± 0.1°; probably slipped 0.10 s after the first frame, at time_s 5.10 "
            "(probability of a slip 0.70)",
        ),
        (
            [0, 9, 0, 9],
            {"slip_probability": [0, 0.6, 0, 0.7]},
            "Turned to +9.0° ± 0.1°, back to 0.0° ± 0.1°, then to +9.0° ± 0.1°; probably slipped, "
            "for the first time 0.10 s after the first frame, at time_s 5.10 (probability of a "
            "slip 0.70)",
        ),
        (
            [0, 9, 0, 9, 0, 9, -1],
            {},
            "Turned back and forth between −1.0° ± 0.1° and +9.0° ± 0.1°; last −1.0° ± 0.1°; held "
            "to the end",
        ),
        (
            [0, 0.1, -0.3],
            {"half": 0.5},
            "No clear turn (largest angle −0.3° ± 0.5°); held to the end",
        ),
        (
            [0, 5, np.nan, 0, -7],
            {"restarts": [0, 0, 0, 1, 1]},
            "Turned to +5.0° ± 0.1°; angle restarted 0.00 s after the first frame, at time_s 5.00: "
            "turned to −7.0° ± 0.1°; held to the end, but without an angle in 1 frame of the "
            "contact",
        ),
        (
            [0, 5, np.nan, 0, -7],
            {"states": [*[State.STICK] * 2, State.NO_CONTACT, *[State.STICK] * 2]},
            "Turned to +5.0° ± 0.1°; new contact 0.00 s after the first frame, at time_s 5.00: "
            "turned to −7.0° ± 0.1°; held to the end",
        ),
        (
            [0, 5, np.nan, 0, 0.1],
            {"states": [*[State.STICK] * 2, State.NO_CONTACT, *[State.STICK] * 2]},
            "Turned to +5.0° ± 0.1°; no clear turn in 1 later contact; held to the end",
        ),
        ([6.5, 6.5, 6.4], {}, "Turned to +6.5° ± 0.1°; held to the end"),
        (
            [6.5, 6.4, np.nan, np.nan],
            {"states": [State.STICK, State.STICK, State.NO_CONTACT, State.UNKNOWN]},
            "Turned to +6.5° ± 0.1°; held until the contact ended, 0.10 s after the first frame, "
            "at time_s 5.10",
        ),
        (
            [6.5, 6.4, np.nan, np.nan],
            {"states": [*[State.STICK] * 2, *[State.UNKNOWN] * 2]},
            "Turned to +6.5° ± 0.1°; held to the end",
        ),
        (
            [6.5, 6.4, np.nan, np.nan, np.nan],
            {"states": [*[State.STICK] * 2, *[State.UNKNOWN] * 3]},
            "Turned to +6.5° ± 0.1°; held until last seen, 0.10 s after the first frame, at time_s "
            "5.10",
        ),
        (
            [np.nan] * 3,
            {"states": State.NO_CONTACT, "contact": 0},
            "No angle in any of 3 frames (3 frames before contact); nothing touched",
        ),
        (
            [np.nan] * 3,
            {
                "states": [State.NO_CONTACT, State.UNKNOWN, State.UNKNOWN],
                "contact": 0,
                "reason": "the picture is black",
            },
            "No angle in any of 3 frames (2 frames the picture is black, 1 frame before contact); "
            "outcome unknown",
        ),
        (
            [np.nan] * 2,
            {"states": State.UNKNOWN, "contact": 0, "reason": "the picture is black"},
            "No angle in any of 2 frames (2 frames the picture is black); no frame could be used",
        ),
        (
            [0, 3, 3],
            {"reason": RESTS_OR_SLIDES},
            "Turned to +3.0° ± 0.1°; outcome unknown: the object may have slid over gel at rest",
        ),
        ([0, 3, 3], {"reason": MOVES_ON}, "Turned to +3.0° ± 0.1°; outcome unknown"),
    ],
)
def test_the_answer_comes_first_in_words(answered, angles, others, words):
    run = make_run(answered, angles, **others)
    assert describe_run(run) == words
    page = render(run)
    assert page.index(words) < page.index("<canvas") < page.index("<img") < page.index("Glossary")


@pytest.mark.parametrize(
    ("probability", "phrase", "word"),
    [
        (0.1, "held", "held"),
        (0.11, "probably held", "held"),
        (0.49, "probably held", "held"),
        (0.5, "unknown", "unknown"),
        (0.51, "probably slipped", "slipped"),
        (0.89, "probably slipped", "slipped"),
        (0.9, "slipped", "slipped"),
        (np.nan, "held", "held"),
    ],
)
def test_a_doubtful_outcome_is_probable_in_words_only(answered, probability, phrase, word):
    run = make_run(answered, [0, 9], slip_probability=probability)
    assert run.outcome.phrase == phrase
    assert _count_outcomes([run, run]) == f"Of 2 recordings 2 {phrase}"
    assert summarise(run)["outcome"]["word"] == word


def test_printed_times_count_from_the_first_frame(answered):
    assert show_time(5.25, 5.0) == "0.25 s after the first frame, at time_s 5.25"
    assert show_time(0.25, 0.0) == "0.25 s after the first frame"
    run = make_run(answered, UP_AND_BACK, states=SLIPS)
    assert summarise(run)["first_time_s"] == 5.0
    page = " ".join(render(run).split())
    assert "Times count from the first frame; add 5.000 s" in page


def test_a_loaded_start_says_what_angles_count_from(answered):
    for anew, words in ((0, "have turned as one body"), (1, "earlier rotation is unknown")):
        run = make_run(answered, UP_AND_BACK, restarts=[anew] * 5)
        clock, reference = _clock_notes(run.main) + _reference_notes(run.main)
        assert "whose time_s is 5.000 s" in clock
        assert words in reference
    assert _clock_notes(replace(run.main, time=run.main.time - 5.0)) == ()


def test_maps_show_the_slip_and_the_largest_angle(answered):
    states = [State.STICK] * 40
    states[17:21] = [State.MACRO_SLIP] * 4
    angles = np.linspace(0.0, 1.0, 40)
    angles[33] = -7.0
    run = make_run(answered, angles, states=states)
    shown = choose_frames(run.main, run.markers, len(run.reference))
    assert [frame.row for frame in shown] == [0, 17, 20, 33, 39]
    some = keep_markers(run.reference, range(0, 40, 8))  # the slip is not stored, only around it
    shown = choose_frames(run.main, some, len(run.reference))
    assert {16, 32} <= {frame.row for frame in shown}
    still = make_run(answered, [np.nan] * 6, states=State.UNKNOWN)
    shown = choose_frames(still.main, still.markers, len(run.reference))
    assert [frame.row for frame in shown] == [0, 1, 2, 3, 5]


def test_intervals_that_lie_askew_are_given_by_their_ends():
    angle, low, high = np.radians([[0.0, -18.4], [0.0, -21.5], [0.0, -18.3]])
    assert describe_turns(angle, low, high) == "turned to −18.4° (−21.5° to −18.3°)"
    unknown = np.full(2, np.nan)
    assert describe_turns(angle, unknown, unknown) == "turned to −18.4°"
    assert find_turns([0.0, 1.0, 0.5, 2.0, -1.0, -0.5], np.full(6, 0.7)) == [3, 4]
    assert find_turns([0.0, 0.1], np.full(2, 0.7)) == []


def test_a_turn_counts_by_its_own_interval():
    """A clear turn is not hidden by wide intervals afterwards."""
    angle, half = np.radians([[0.0, 10.0, -5.0, 12.0, 8.0, 12.0], [0.3, 0.3, 2.0, 4.0, 4.0, 4.0]])
    assert describe_turns(angle, angle - half, angle + half) == (
        "turned to +10.0° ± 0.3°, back to −5.0° ± 2.0°, then to +12.0° ± 4.0°"
    )


def test_settings_have_units_and_meaning():
    settings = {"noise_in_plane_um": 1.5, "onset_mm": 0.1, "crop_px": [1, 2, 3, 4], "new": None}
    settings |= {"softness": {"kind": "layered", "thickness_mm": 3.0}, "keep_withdrawn": True}
    shown = {one.name: one for one in explain_settings(settings, "tracked")}
    assert shown["noise_in_plane_um"][1:3] == ("1.5", "µm")
    (in_px,) = explain_settings({"noise_in_plane_px": 0.01277}, "tracked")
    assert in_px[1:3] == ("0.01277", "px")
    (earlier,) = explain_settings({"noise_in_plane_millipx": 12.77}, "tracked")
    assert earlier[1:3] == ("12.77", "px/1000")
    assert shown["onset_mm"].unit == "mm"
    assert "stick centre" in shown["onset_mm"].meaning
    assert shown["crop_px"].value == "1, 2, 3, 4"
    assert shown["softness.thickness_mm"].unit == "mm"
    assert shown["softness.thickness_mm"].meaning
    assert shown["keep_withdrawn"].value == "yes"
    assert shown["new"][1:] == ("–", "", "")
    assert not explain_settings({"seed": None}, "tracked")  # of a recording
    assert len(explain_settings({"seed": 0}, "tracked")) == 1


def played(page):
    """What a page plays, as its script reads it."""
    return json.loads(re.search(r'id="play">(.*?)</script>', page, re.DOTALL)[1])


def test_names_from_outside_let_nothing_in(answered):
    run = make_run(answered, UP_AND_BACK, reason=NAME, notes=(NAME,))
    page = render(replace(run, name=NAME, source=NAME, settings={NAME: NAME}))
    assert page.count("</script>") == page.count("<script") == 2
    assert "<b>&" not in page
    assert played(page)["reasons"] == [[0, NAME]]
    assert not re.search(r"https?:|url\(|@import|(?:src|href)=\"(?!data:)", page)


@pytest.mark.parametrize("pictured", [False, True])
def test_a_long_run_stays_below_5_mb(answered, pictured):
    angles = 10.0 * np.sin(np.arange(2000) / 100.0) + 1e-3
    run = make_run(answered, angles, states=State.MACRO_SLIP)
    picture = paint(320, 240)[0] if pictured else None
    kept = keep_markers(run.reference, range(0, 2000, 8), picture)
    page = render(replace(run, markers=kept), (400, 300))
    assert len(page.encode()) < 5e6
    play = played(page)
    assert len(play["time"]) == len(play["curves"][0]["angle"]) == 2000
    rows = [scene["row"] for scene in play["scenes"]]
    assert rows[0] == 0
    assert rows[-1] == 1992
    assert len(rows) > 50
    assert all(bool(scene["picture"]) == pictured for scene in play["scenes"])
    assert len(play["scenes"][0]["kinds"]) == 396


def test_a_copy_of_a_picture_that_is_a_line_keeps_a_pixel():
    assert copy_picture(np.zeros((1, 900), np.uint8), 100, 80).size == (100, 1)


def test_an_album_keeps_small_copies_evenly_spread():
    album = Album(most=4, largest=100)
    for row in range(11):
        album.take(row, 100 + row, np.zeros((60, 200), dtype=np.uint16))
    found = {number: album.find(number) for number in range(100, 111)}
    assert [number for number, one in found.items() if one] == [100, 104, 108]
    assert cv2.imdecode(np.frombuffer(found[104].jpeg, np.uint8), -1).shape == (30, 100)
    assert (found[104].scale, found[104].size) == (0.5, (100, 30))


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    opened = Browser(tmp_path_factory.mktemp("profile"))
    yield opened
    opened.close()


@pytest.mark.parametrize("pictured", [False, True])
def test_one_moves_through_the_report(answered, browser, tmp_path, pictured):
    run = replace(make_run(answered, np.arange(20.0)), name=NAME)
    if pictured:
        run = replace(run, markers=keep_markers(run.reference, range(20), paint(320, 240)[0]))
    path = tmp_path / "report.html"
    path.write_text(render(run, (1170, 900)))
    browser.open(path.as_uri())
    assert browser.run("document.querySelector('h1').textContent") == f"{NAME}: angle of the object"
    draw = "[...document.querySelectorAll('canvas')].map((one) => one.toDataURL())"
    now = "document.getElementById('now').textContent"
    browser.run("Promise.all([...document.images].map((one) => one.decode()))")
    browser.run("new Promise((done) => setTimeout(done, 100))")  # pictures are drawn when decoded
    at_rest, words = browser.run(draw), browser.run(now)
    assert words.startswith("0.00 s · frame 0 · stick")
    browser.run(
        "(() => { const s = document.querySelector('input'); s.value = 7; s.oninput(); })()"
    )
    moved = browser.run(draw)
    assert all(one != other for one, other in zip(at_rest, moved, strict=True))
    assert browser.run(now).startswith("0.70 s · frame 7 · stick · +7.0° ± 0.1°")
    browser.press("ArrowRight")
    assert browser.run(now).startswith("0.80 s · frame 8")
    box = browser.run(
        "(({left, top, width}) => [left, top, width])"
        "(document.querySelector('.curves canvas').getBoundingClientRect())"
    )
    browser.click(box[0] + box[2] - 12, box[1] + 30)
    assert browser.run(now).startswith("1.90 s · frame 19")
    browser.run("document.querySelector('button').click()")  # plays from the start again
    assert not browser.run(now).startswith("1.90 s")
    wide = "document.documentElement.scrollWidth - window.innerWidth"
    assert browser.run(wide) <= 0
    browser.open(path.as_uri(), width=390)
    assert browser.run(wide) <= 0
    assert browser.complaints == []
    browser.ask("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(path.as_uri())
    shown = "[...document.images].every((one) => one.clientHeight > 100)"
    assert browser.run(f"document.getElementById('player').hidden && {shown}")
    browser.ask("Emulation.setScriptExecutionDisabled", value=False)
