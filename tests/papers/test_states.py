"""The tables of states read by eye, the sheets they are read from, and how ours are scored."""

import csv
from importlib import resources
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from papers.marker_images import reading as read
from papers.marker_images import sheets, states
from papers.marker_images.reading import Place, Run, Span
from papers.marker_images.settings import SheetSettings
from papers.marker_images.states import Ours, Scored

WORDS = [
    "yes rest stick",
    "yes rest stick",
    "yes moving stick",
    "yes moving macro_slip",
    "no rest no_contact",
    "unclear moving unclear",
]


def reading(words=WORDS):
    return {
        Place("a/b/c", frame): dict(zip(read.ALLOWED, row.split(), strict=True))
        for frame, row in enumerate(words)
    }


def answers(*given, touched=False):
    return {Place("a/b/c", frame): Ours(state, "", touched) for frame, state in enumerate(given)}


def test_the_table_is_as_large_as_the_study_says():
    found = read.read_readings()
    frames = read.read_frames()
    assert sum(map(len, frames.values())) == 360
    assert len(frames) == 24
    assert all(len(one) == 360 for one in found.values())


def test_the_kappa_is_that_of_a_worked_example():
    # 20 yes-yes, 5 yes-no, 10 no-yes, 15 no-no: 35 of 50 alike, 25 expected, κ = 0.2/0.5
    one = ["yes"] * 25 + ["no"] * 25
    other = ["yes"] * 20 + ["no"] * 5 + ["yes"] * 10 + ["no"] * 15
    assert read.kappa(one, other) == pytest.approx(0.4)
    assert read.kappa(["yes"], ["yes"]) == 1.0


def test_ours_are_scored_where_the_readers_agree():
    second = reading([*WORDS[:2], "yes moving incipient", *WORDS[3:]])
    ours = answers("incipient", "macro_slip", "stick", "macro_slip", "unknown", "stick")
    result = Scored({"first": reading(), "second": second}, ours)
    shown = states.tables(result)
    figures = {row[""]: (row["frames"], row["of"]) for row in shown[""]}
    assert figures["contact right"] == (4, 5)  # the last is unclear to the readers
    assert figures["contact wrong"] == (0, 5)  # the fifth to us
    assert figures["macro_slip at rest"] == (1, 3)
    right = {row["read"]: (row["frames"], row["right [%]"]) for row in shown["_states"]}
    assert right == {"stick, rest": (2, 50.0), "macro_slip": (1, 100.0), "no_contact": (1, 0.0)}
    assert [row["frame"] for row in shown["_wrong"]] == [1, 4]
    by_column = {row["column"]: row for row in shown["_readers"]}
    assert by_column["state"]["the same [%]"] == 83.3
    assert by_column["state"]["clear to both"] == 5
    assert by_column["contact"]["kappa"] == 1.0
    plt.close(states.plot(result))


def test_contact_may_be_known_without_the_state():
    for touched, right in ((False, 0), (True, 4)):
        scored = Scored({"first": reading()}, answers(*["unknown"] * 6, touched=touched))
        assert states.tables(scored)[""][1]["frames"] == right


def test_one_reading_is_scored_alone():
    shown = states.tables(Scored({"first": reading()}, answers(*["stick"] * 6)))
    assert shown["_readers"] == []
    assert shown[""][1]["share [%]"] == 80.0


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("a/b/c,3,perhaps,rest,stick", "contact is 'perhaps'; it must be one of yes, no, unclear"),
        ("a/b/c,3,yes,,stick", "motion is ''"),
        ("a/b/c,1,yes,rest,stick", "frame 1 is listed twice"),
    ],
)
def test_a_wrong_word_is_named_with_its_line(tmp_path, row, message):
    table = tmp_path / "third.csv"
    table.write_text(f"clip,frame,contact,motion,state\na/b/c,1,yes,rest,stick\n{row}\n")
    with pytest.raises(ValueError, match=f"third.csv, line 3: {message}"):
        read.read_reading(table)


SPANS = [("stick", 0, 9, 0), ("macro_slip", 10, 14, 2), ("stick", 15, 29, 1)]


def whole(*spans):
    return {
        "a/b/c": [
            Span(first, last, {"contact": "yes", "motion": "moving", "state": state}, unsure)
            for state, first, last, unsure in spans
        ]
    }


def test_whole_clips_are_read_without_gaps_by_two_readers():
    found = read.read_whole_clips()
    assert list(found) == ["first", "second"]
    for spans in found.values():
        assert {clip: parts[-1].last for clip, parts in spans.items()} == {
            "lemon/exp_num_2/camera_0": 449,
            "wallet/exp_num_3/camera_0": 449,
        }
        assert len(read.spread(spans)) == 900
        states_seen = {span.words["state"] for parts in spans.values() for span in parts}
        assert {"stick", "macro_slip", "unclear"} <= states_seen
    # no clip of the single frames, so that neither table leans on the other
    assert not set(found["first"]) & set(read.read_frames())
    again = resources.files("papers.marker_images") / "readings/whole_clips/again/first.csv"
    with resources.as_file(again) as path:
        assert read.spread(read.read_spans(path)).keys() == read.spread(found["first"]).keys()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("a/b/c,6,9,yes,rest,stick,0", "6 to 9, unsure by 0; the span must begin at frame 5"),
        ("a/b/c,5,4,yes,rest,stick,0", "not end before it"),
        ("a/b/c,5,9,yes,rest,stick,-1", "unsure by -1"),
        ("a/b/c,5,,yes,rest,stick,1", "from, to and unsure must be numbers of frames"),
        ("a/b/c,5,9,yes,rest,slip,1", "state is 'slip'"),
    ],
)
def test_spans_with_a_gap_or_without_numbers_are_refused(tmp_path, row, message):
    table = tmp_path / "third.csv"
    table.write_text(
        f"clip,from,to,contact,motion,state,unsure\na/b/c,0,4,no,rest,stick,0\n{row}\n"
    )
    with pytest.raises(ValueError, match=f"third.csv, line 3: .*{message}"):
        read.read_spans(table)


def test_a_change_whose_time_is_unsure_leaves_frames_out():
    sure = read.spread(whole(*SPANS), sure=True)
    left_out = [place.frame for place, row in sure.items() if row["state"] == "unclear"]
    assert left_out == [8, 9, 10, 11, 14, 15]
    assert {row["contact"] for row in sure.values()} == {"yes"}  # which does not change
    assert [row["state"] for row in read.spread(whole(*SPANS)).values()].count("macro_slip") == 5


def test_the_alike_run_is_the_nearest_that_shares_frames():
    runs = read.find_runs([Run(word, t, t) for t, word in enumerate("aabbabaa")])
    assert [(run.state, run.first, run.last) for run in runs] == [
        ("a", 0, 1),
        ("b", 2, 3),
        ("a", 4, 4),
        ("b", 5, 5),
        ("a", 6, 7),
    ]
    assert read.find_alike(Run("b", 3, 6), runs) == Run("b", 2, 3)
    assert read.find_alike(Run("b", 6, 7), runs) is None


def test_changes_are_late_beyond_what_the_readers_leave_open():
    other = [("stick", 0, 10, 0), ("macro_slip", 11, 14, 1), ("stick", 15, 29, 1)]
    ours = answers(*["stick"] * 15, *["macro_slip"] * 5, *["unknown"] * 10)
    result = Scored({"first": reading()}, ours, {"first": whole(*SPANS), "second": whole(*other)})
    shown = states.tables(result)
    begin, end = shown["_changes"]
    assert (begin["to"], begin["frame"], begin["other reader"]) == ("macro_slip", 10, 11)
    assert (begin["ours"], begin["late"]) == ("", "")  # ours begins when theirs is over
    assert (end["to"], end["ours"], end["ours mostly"]) == ("stick", "", "unknown")
    ours = answers(*["stick"] * 13, *["macro_slip"] * 3, *["stick"] * 14)
    result = Scored({"first": reading()}, ours, result.whole)
    shown = states.tables(result)
    begin, end = shown["_changes"]
    assert (begin["ours"], begin["late"]) == (13, 1)  # 12 is the latest that a reader allows
    blind = Scored({"first": reading()}, answers(*["stick"] * 30), result.whole)
    assert [row["ours"] for row in states.tables(blind)["_changes"]] == ["", ""]
    assert (end["ours"], end["late"], end["ours the same [%]"]) == (16, 0, 93.3)
    right = {row["read"]: (row["frames"], row["right [%]"]) for row in shown["_whole_states"]}
    assert right == {"stick, moving": (22, 100.0), "macro_slip": (2, 50.0)}
    (state,) = [row for row in shown["_whole_readers"] if row["column"] == "state"]
    assert state["the same [%]"] == 96.7
    assert [axes.get_title() for axes in states.plot(result).axes] == ["", "a/b/c"]
    plt.close("all")


def test_a_reader_who_saw_one_run_in_place_of_two_does_not_date_the_second():
    first = [("incipient", 0, 4, 0), ("stick", 5, 9, 1), ("incipient", 10, 14, 1)]
    other = [("incipient", 0, 14, 0)]
    ours = answers(*["incipient"] * 5, *["stick"] * 3, *["incipient"] * 7)
    result = Scored({"first": reading()}, ours, {"first": whole(*first), "second": whole(*other)})
    _, begin = states.tables(result)["_changes"]
    assert (begin["to"], begin["frame"], begin["other reader"]) == ("incipient", 10, "")
    assert (begin["ours"], begin["late"]) == (8, -1)  # 9 is the earliest that the first allows


def draw_clip(frames=17, still=9):
    """Dots at rest on a pad under a rough print, which moves by half a pixel a frame in the end."""
    rough = np.random.default_rng(0).normal(size=(160, 240))
    rough = np.fft.ifft2(
        np.fft.fft2(rough) * np.exp(-20.0 * np.add.outer(*map(frequencies, (160, 240))))
    )
    rough = 8.0 * rough.real / rough.real.std()
    y, x = np.mgrid[:120, :160]
    dots = np.hypot((x + 16) % 32 - 16, (y + 16) % 32 - 16) < 5
    clip = []
    for i in range(frames):
        shift = 0.5 * max(i - still, 0)
        columns = np.fft.fft(rough, axis=1) * np.exp(2j * np.pi * np.fft.fftfreq(240) * -shift)
        grey = np.where(dots, 20.0, 140.0 + np.fft.ifft(columns, axis=1).real[:120, :160])
        clip.append(np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2))
    return np.array(clip)


def frequencies(n):
    return (2.0 * np.pi * np.fft.fftfreq(n)) ** 2 / 4.0


@pytest.fixture(scope="module")
def clip():
    return draw_clip()


def test_the_sheets_show_what_slides_over_the_gel(clip):
    near = list(clip[8:17])
    motion = sheets.measure_motion(near, [sheets.paint_out_dots(one) for one in near])
    assert np.nanmedian(np.abs(motion.dots_moved)) < 0.1
    apart = motion.apart[np.isfinite(motion.apart[:, 0])]
    assert len(apart) > 20
    # the print moves by 3.5 px to the right; filled-in dots hold back what is near them
    np.testing.assert_allclose(np.median(apart, axis=0), [3.5, 0.0], atol=0.5)


def test_the_slip_that_a_reader_sees_may_begin_after_the_frame(clip):
    slip = sheets.follow_slip(clip, 10)
    np.testing.assert_allclose(slip[:3], 0.0, atol=0.1)  # up to the last frame at rest, 9
    np.testing.assert_allclose(slip[3:], [0.5, 1.0, 1.5, 2.0, 2.5], atol=0.3)
    assert np.isnan(sheets.follow_slip(clip, 4)).all()  # the print rests
    reader = reading(["yes moving stick"] * 10 + ["yes moving macro_slip"] * 5)
    late, place = answers(*["stick"] * 12, *["macro_slip"] * 3), Place("a/b/c", 10)
    scored = Scored({"first": reader}, late, live=answers(*["stick"] * 15), slips={place: slip})
    shown = states.tables(scored)
    (row,) = shown["_slips"]
    assert row["slip until it [px]"] == pytest.approx(0.5, abs=0.2)
    assert row["slip in the frames seen [px]"] == pytest.approx(2.5, abs=0.3)
    assert (row["read"], row["ours"]) == ("macro_slip", "stick")
    assert late[Place("a/b/c", int(str(row["fastest in"])))].state == row["ours then"]
    assert [row["right [%]"] for row in shown["_states"]] == [60.0, 100.0]
    assert [row["right [%]"] for row in shown["_live"]] == [0.0, 100.0]


def test_frames_are_drawn_from_all_strata_and_shown_without_answers(clip, monkeypatch):
    settings = SheetSettings(before=4, draws=2, rows=3)
    drawn = sheets.draw_frames(clip, np.random.default_rng(1), settings)
    assert drawn == sheets.draw_frames(clip, np.random.default_rng(1), settings)
    assert len(set(drawn)) == len(drawn) == 6
    assert 4 <= min(drawn) <= max(drawn) < 13
    monkeypatch.setattr(sheets, "read_clip", lambda path: clip)
    assert sheets.every_frame(Path("videos"), ["a/b/c"]) == {"a/b/c": range(4, 13)}
    pages = list(sheets.make_sheets(clip, "a/b/c", drawn, settings))
    assert [len(page) for page in pages] == [26 + 60 + 3 * 120, 26 + 60 + 3 * 120]
    assert {page.shape[1] for page in pages} == {5 * 160}


def test_every_video_that_was_read_is_in_the_data_set(monkeypatch, tmp_path):
    monkeypatch.setenv("CONTACTMODEL_DATA", str(tmp_path))
    monkeypatch.setenv("CONTACTMODEL_CACHE", str(tmp_path))
    sheets.check_clips([*read.read_frames(), *next(iter(read.read_whole_clips().values()))])
    with pytest.raises(ValueError, match="no video 'lemon' in state-videos: choose from artif"):
        sheets.check_clips(["lemon"])


def test_the_folder_of_sheets_has_guide_and_empty_table(tmp_path, clip, monkeypatch):
    monkeypatch.setattr(sheets, "read_clip", lambda path: clip)
    sheets.write_sheets(Path("videos"), tmp_path, {"a/b/c": [8]})
    assert (tmp_path / "a_b_c_0.png").stat().st_size > 1000
    assert "macro_slip" in (tmp_path / "README.md").read_text()
    (row,) = csv.DictReader((tmp_path / "reading.csv").read_text().splitlines())
    assert row == {"clip": "a/b/c", "frame": "8", "contact": "", "motion": "", "state": ""}
