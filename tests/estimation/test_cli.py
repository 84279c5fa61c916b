import json
import sys

import pytest

from estimation.__main__ import main
from estimation.frames.archive import write_archive
from tests.bags import Sent, cloud, write_mcap
from tests.cases import lift


@pytest.fixture
def command(monkeypatch, capsys):
    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["estimation", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        output = capsys.readouterr()
        return stop.value.code or 0, output.out, " ".join(output.err.split())

    return call


def test_run_an_archive(command, tmp_path):
    write_archive(lift([0.0, 0.05, 0.1, 0.12]), tmp_path / "lift.npz")
    code, out, _ = command("run", tmp_path / "lift.npz", "--out", tmp_path / "out")
    assert code == 0
    assert "4 of 9 frames answered" in out
    assert (tmp_path / "out" / "report.html").exists()


def test_options_without_effect_are_named(command, tmp_path):
    write_archive(lift([0.0, 0.05, 0.1, 0.12]), tmp_path / "lift.npz")
    given = ("--mm-per-px", "0.05", "--crop", "0", "0", "90", "90", "--unloaded-frame", "0")
    out = tmp_path / "out"
    code, _, err = command("run", tmp_path / "lift.npz", *given, "--seed", "3", "--out", out)
    assert code == 0
    for remark in (
        "lift: No effect here: --mm-per-px, --crop, for pictures only.",
        "lift: No effect here: --unloaded-frame, for pictures and bags only.",
        "lift: No effect here: --seed, for the virtual pivot only.",
    ):
        assert remark in err
        assert remark.removeprefix("lift: ") in (out / "report.html").read_text()
    code, _, err = command("live", tmp_path / "lift.npz", "--window-port", "1", "--out", out)
    assert (code, err) == (2, "error: --window-port has no effect without --window: leave it out")


def test_one_damaged_recording_of_several_is_named(command, tmp_path):
    (tmp_path / "in").mkdir()
    write_archive(lift([0.0, 0.05, 0.1, 0.12]), tmp_path / "in" / "good.npz")
    (tmp_path / "in" / "bad.npz").write_bytes(b"not an archive")
    code, _, err = command("run", tmp_path / "in", "--out", tmp_path / "out")
    assert code == 2
    assert "bad.npz is not a recording archive, or is truncated" in err
    assert err.endswith("; no recording was run: leave this one out to run the others")
    assert not (tmp_path / "out").exists()
    code, _, err = command("run", tmp_path / "in" / "bad.npz", "--out", tmp_path / "out")
    assert err.endswith("truncated")


def test_run_a_topic_of_a_bag(command, tmp_path):
    positions = lift([0.0, 0.05, 0.1, 0.12]).positions
    sent = [Sent("/pad", cloud(one, i * 10**7), i * 10**7) for i, one in enumerate(positions)]
    path = write_mcap(tmp_path / "lift.mcap", sent)
    code, out, _ = command("run", path, "--topics")
    assert (code, out) == (0, "/pad: points (sensor_msgs/msg/PointCloud2, 9 messages)\n")
    code, out, _ = command("run", path, "--topic", "/pad", "--out", tmp_path / "out")
    assert code == 0
    assert "4 of 9 frames answered" in out
    code, _, err = command("run", path, "--topic", "/other", "--out", tmp_path / "out")
    assert code == 2
    assert "lift.mcap has no topic other; it holds /pad: points" in err


def test_a_bag_that_breaks_off_is_said_beside_the_answer(command, tmp_path):
    turned = lift([0.01 * i for i in range(20)], unloaded=3)
    sent = [
        Sent("/pad", cloud(one, i * 10**7), i * 10**7) for i, one in enumerate(turned.positions)
    ]
    bag = write_mcap(tmp_path / "lift.mcap", sent)
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size * 3 // 4])
    _, lines, _ = command("run", str(bag), "--out", str(tmp_path / "out"))
    assert "  last frame: the bag is damaged from here on" in lines


def test_lines_of_json_are_all_there_is_on_standard_output(tmp_path, monkeypatch, capfd):
    write_archive(lift([0.0, 0.05, 0.1, 0.12]), tmp_path / "lift.npz")
    arguments = ["run", tmp_path / "lift.npz", "--sink", "json", "--sink", "mcap"]
    monkeypatch.setattr(
        sys, "argv", ["estimation", *map(str, arguments), "--out", str(tmp_path / "out")]
    )
    with pytest.raises(SystemExit) as stop:
        main()
    printed = capfd.readouterr()
    assert not stop.value.code
    assert [json.loads(line)["frame"] for line in printed.out.splitlines()] == list(range(9))
    assert "4 of 9 frames answered" in " ".join(printed.err.split())
    assert (tmp_path / "out" / "frames.mcap").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("{archive}", "--sink", "cvs"), "unknown sink 'cvs'"),
        (("nowhere.npz",), "nowhere.npz"),
        (
            ("{archive}", "--method", "magic"),
            "unknown method 'magic'; choose from tracked, incremental",
        ),
        (("{archive}", "--softness", "nowhere.toml"), "nowhere.toml"),
        (("{archive}", "--noise-um", "-1"), "must be a number above 0"),
        (("{archive}", "--threshold", "0"), "threshold is 0.0"),
        (("{archive}", "--window-frames", "3"), "tracked has no setting 'window_frames'"),
        (("{archive}", "--onset-mm", "nan"), "onset_mm is nan"),
        (("{archive}", "--patience", "-1"), "patience is -1; it must be at least 0"),
        (("{archive}", "--watch-s", "nan"), "watch_s is nan; it must be 0 or more"),
        (("{archive}", "--contact-share", "2"), "contact_share is 2.0"),
        (("{empty}",), "empty"),
        (("{text}",), "text.npz"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_computed(command, tmp_path, arguments, message):
    write_archive(lift([0.0, 0.05, 0.1, 0.12]), tmp_path / "lift.npz")
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.npz").write_text("no archive")
    places = {
        "archive": tmp_path / "lift.npz",
        "empty": tmp_path / "empty",
        "text": tmp_path / "text.npz",
    }
    filled = [argument.format(**places) for argument in arguments]
    code, out, err = command("run", *filled, "--out", tmp_path / "out")
    assert code == 2
    assert message in err
    assert "Traceback" not in err + out
    assert not list((tmp_path / "out").glob("*"))


def test_one_bad_recording_among_good_ones_is_found_first(command, tmp_path):
    write_archive(lift([0.0, 0.05]), tmp_path / "good.npz")
    code, _, err = command(
        "run", tmp_path / "good.npz", tmp_path / "bad.npz", "--out", tmp_path / "out"
    )
    assert code == 2
    assert "bad.npz" in err
    assert not (tmp_path / "out").exists()


def test_a_name_that_is_not_utf8(command, monkeypatch, tmp_path):
    """As of an archive packed on another system: Python reads the byte E9 as a lone surrogate."""
    named = [tmp_path / "li\udce9.npz"]  # some systems store no such name
    monkeypatch.setattr("estimation.sources.find_recordings", lambda *_: named)
    code, _, err = command("run", tmp_path, "--out", tmp_path / "out")
    assert code == 2
    assert "li\\udce9.npz' is not UTF-8" in " ".join(err.split())
    assert not (tmp_path / "out").exists()


def test_unknown_data_set(command):
    code, _, err = command("fetch", "tac3d-dance")
    assert code == 2
    assert "tac3d-pivot" in err


def test_help_keeps_units(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    _, out, _ = command("run", "--help")
    units = ("noise [mm]", "keyframes [frames]", "slip later [frames]", "widen the intervals [µm]")
    for text in units:
        assert text in " ".join(out.split())


def test_paths_with_brackets_survive_in_messages(command, tmp_path):
    code, _, err = command("run", tmp_path / "[red]lift.npz", "--out", tmp_path / "out")
    assert code == 2
    assert "[red]lift.npz" in err.replace(" ", "")
    assert code == 2


def test_a_file_for_a_folder_and_a_seed_below_zero(command, tmp_path):
    write_archive(lift([0.0, 0.05]), tmp_path / "lift.npz")
    code, _, err = command("run", tmp_path / "lift.npz", "--out", tmp_path / "lift.npz")
    assert code == 2
    assert "is a file: give the name of a folder" in err
    code, _, err = command("run", tmp_path / "lift.npz", "--out", tmp_path / "lift.npz" / "in")
    assert code == 2
    assert "in cannot be written to (Not a directory): give another folder" in err
    code, _, err = command("run", "--seed", "-1", "--out", tmp_path / "out")
    assert code == 2
    assert "--seed" in err
