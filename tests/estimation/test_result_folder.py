"""A folder of results: renewed by each run, and nothing in it lost that is not ours to remove."""

import hashlib
import json

import pytest

from estimation.output.result_folder import renew_results

RUN = "estimation run"


def write(folder, files, command=RUN):
    """One run of a command that writes these files; what it says."""
    said = []
    with renew_results(folder, command, said.append) as results:
        for name, content in files.items():
            (results.draft / name).parent.mkdir(exist_ok=True)
            (results.draft / name).write_text(content)
    return said


def files(folder):
    """Content by name, less the manifest's."""
    return {
        path.relative_to(folder).as_posix(): path.read_text()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "manifest.json"
    }


def listed(folder):
    return json.loads((folder / "manifest.json").read_text())["written"]


def list_in_manifest(folder, names):
    """A manifest that lists files with the content that they have, wherever they are."""
    written = {
        name: hashlib.sha256(
            (folder / name).read_bytes() if (folder / name).is_file() else b""
        ).hexdigest()
        for name in names
    }
    content = {"format_version": 1, "written": {RUN: written}}
    (folder / "manifest.json").write_text(json.dumps(content))


def test_a_run_replaces_what_the_last_one_wrote_and_nothing_else(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    write(tmp_path, {"report.html": "1", "grasp.png": "1", "left/angles.csv": "1"})
    said = write(tmp_path, {"report.html": "2", "angles.csv": "2"})
    assert files(tmp_path) == {"notes.txt": "mine", "report.html": "2", "angles.csv": "2"}
    assert not (tmp_path / "left").exists()
    assert said == [f"removed 2 files that an earlier run wrote to {tmp_path}"]
    assert set(listed(tmp_path)[RUN]) == {"report.html", "angles.csv"}


def test_what_the_user_changed_is_kept_and_said(tmp_path):
    write(tmp_path, {"report.html": "1", "grasp.png": "1", "left/angles.csv": "1"})
    for name in ("report.html", "grasp.png", "left/angles.csv"):
        (tmp_path / name).write_text("changed")
    said = write(tmp_path, {"report.html": "2"})
    assert files(tmp_path) == {
        "report.html": "2",
        "report.kept.html": "changed",
        "grasp.png": "changed",
        "left/angles.csv": "changed",
    }
    assert any("kept as report.kept.html" in line for line in said)
    assert sum("changed after an earlier run wrote it: it is kept" in line for line in said) == 2
    (tmp_path / "report.html").write_text("changed again")
    write(tmp_path, {"report.html": "3"})
    assert files(tmp_path)["report.kept.html"] == "changed"
    assert files(tmp_path)["report.kept1.html"] == "changed again"


def test_results_of_another_command_stay(tmp_path):
    write(tmp_path, {"noise.toml": "n", "report.html": "n"}, "calibration noise")
    said = write(tmp_path, {"angles.csv": "1", "report.html": "1"})
    assert said == []  # the report is replaced: it was ours
    write(tmp_path, {"angles.csv": "2"})
    assert files(tmp_path) == {"noise.toml": "n", "angles.csv": "2"}
    assert listed(tmp_path)["calibration noise"].keys() == {"noise.toml"}


def test_a_run_that_wrote_nothing_removes_nothing(tmp_path):
    write(tmp_path, {"angles.csv": "1"})
    before = (tmp_path / "manifest.json").read_text()
    assert write(tmp_path, {}) == []
    assert files(tmp_path) == {"angles.csv": "1"}
    assert (tmp_path / "manifest.json").read_text() == before


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_a_run_that_breaks_off_keeps_the_old_results_beside_its_own(tmp_path, error):
    write(tmp_path, {"report.html": "1", "angles.csv": "1"})

    def break_off():
        with renew_results(tmp_path, RUN) as results:
            (results.draft / "angles.csv").write_text("2")
            (results.draft / "new.csv").write_text("2")
            raise error

    with pytest.raises(type(error)):
        break_off()
    assert files(tmp_path) == {"report.html": "1", "angles.csv": "2", "new.csv": "2"}
    write(tmp_path, {"angles.csv": "3"})  # which knows the files of both
    assert files(tmp_path) == {"angles.csv": "3"}


def test_what_is_published_is_there_before_the_run_ends(tmp_path):
    write(tmp_path, {"b/angles.csv": "old"})
    with renew_results(tmp_path, RUN) as results:
        (results.draft / "a").mkdir()
        (results.draft / "a" / "angles.csv").write_text("new")
        assert "a/angles.csv" not in files(tmp_path)
        results.publish()
        assert files(tmp_path)["a/angles.csv"] == "new"
        assert listed(tmp_path)[RUN].keys() == {"a/angles.csv", "b/angles.csv"}
    assert files(tmp_path) == {"a/angles.csv": "new"}


def test_two_runs_do_not_write_to_one_draft(tmp_path):
    with renew_results(tmp_path, RUN, draft="half"):
        with pytest.raises(OSError, match="another run is writing to"):
            renew_results(tmp_path, RUN, draft="half").__enter__()
        with renew_results(tmp_path, RUN):  # as a report does
            pass
    with renew_results(tmp_path, RUN, draft="half") as results:
        (results.draft / "angles.csv").write_text("1")
    assert {one.name for one in tmp_path.iterdir()} == {"angles.csv", "manifest.json"}


def test_an_incomplete_run_leaves_what_it_did_not_replace(tmp_path):
    write(tmp_path, {"a.csv": "1", "b.csv": "1"})
    with renew_results(tmp_path, RUN) as results:
        (results.draft / "a.csv").write_text("2")
        results.keep_earlier()
    assert files(tmp_path) == {"a.csv": "2", "b.csv": "1"}
    write(tmp_path, {"a.csv": "3"})  # the next complete run knows the files of both
    assert files(tmp_path) == {"a.csv": "3"}


def test_names_that_lead_out_of_the_folder_are_not_followed(tmp_path):
    outside, folder = tmp_path / "outside", tmp_path / "out"
    for place in (outside, folder):
        place.mkdir()
    (outside / "precious.txt").write_text("precious")
    (folder / "to_folder").symlink_to(outside)
    (folder / "to_file").symlink_to(outside / "precious.txt")
    names = ["../outside/precious.txt", str(outside / "precious.txt"), "to_folder/precious.txt"]
    names += [
        "to_file",
        "C:\\precious.txt",
        "..\\outside\\precious.txt",
        "",
        ".",
        "a\0b",
        "n" * 999,
    ]
    list_in_manifest(folder, [name for name in names if "\0" not in name and len(name) < 999])
    write(folder, {"angles.csv": "1"})
    assert (outside / "precious.txt").read_text() == "precious"
    assert (folder / "to_file").is_symlink()
    assert (folder / "to_folder").is_symlink()
    content = {"format_version": 1, "written": {RUN: dict.fromkeys(names, "0" * 64)}}
    (folder / "manifest.json").write_text(json.dumps(content))
    write(folder, {"angles.csv": "2"})
    assert (outside / "precious.txt").read_text() == "precious"


def test_a_link_in_the_place_of_a_result_is_renamed_and_not_written_through(tmp_path):
    (tmp_path / "precious.txt").write_text("precious")
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "angles.csv").symlink_to(tmp_path / "precious.txt")
    write(folder, {"angles.csv": "1"})
    assert (tmp_path / "precious.txt").read_text() == "precious"
    assert (folder / "angles.kept.csv").is_symlink()


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        '{"name": "my app"}',
        '{"format_version": 1, "written": [1]}',
        '{"format_version": 1, "written": {"run": {"angles.csv": 1}}}',
        "[" * 100_000,
    ],
)
def test_a_manifest_that_is_not_ours_is_kept(tmp_path, content):
    (tmp_path / "manifest.json").write_text(content)
    (tmp_path / "angles.csv").write_text("mine")
    write(tmp_path, {"angles.csv": "1"})
    assert (tmp_path / "manifest.kept.json").read_text() == content
    assert (tmp_path / "angles.kept.csv").read_text() == "mine"
    assert listed(tmp_path)[RUN].keys() == {"angles.csv"}
