"""Packages that only some jobs need: declared, and named with what to install where they lack."""

import re
import sys
import tomllib

import pytest
from ruamel.yaml import YAML

from estimation.frames.extras import EXTRA_PACKAGES, MissingExtraError, require_extra
from estimation.sources import read_recording
from papers import items
from papers.__main__ import main
from papers.leaderboard import sources
from tests.structure import PACKAGES, ROOT, imported_modules, needs_sources

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
IMPORTED_AS = {
    "opencv-contrib-python-headless": "cv2",
    "pillow": "PIL",
    "rerun-sdk": "rerun",
    "scikit-fem": "skfem",
    "tomli-w": "tomli_w",
}


def packages(requirements):
    names = [re.split(r"[^\w-]", requirement)[0] for requirement in requirements]
    return {IMPORTED_AS.get(name, name) for name in names}


def reached_from(module):
    """Modules of `papers` that a module imports, directly or through others."""
    reached, open_ = set(), [module]
    while open_:
        name = open_.pop()
        path = ROOT / f"{name.replace('.', '/')}.py"
        if name not in reached and path.is_file():
            open_ += [one for one in imported_modules(path) if one.startswith("papers.")]
        reached.add(name)
    return reached


def test_extras_are_those_of_the_project():
    for extra, names in EXTRA_PACKAGES.items():
        assert set(names) == packages(PROJECT["optional-dependencies"][extra])


@needs_sources
@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_imported_is_required_or_in_an_extra(package):
    extra = {one for names in EXTRA_PACKAGES.values() for one in names}
    known = {*PACKAGES} | packages(PROJECT["dependencies"]) | extra
    for path in sorted((ROOT / package).rglob("*.py")):
        roots = {name.split(".")[0] for name in imported_modules(path)}
        assert roots <= known | set(sys.stdlib_module_names), path


@needs_sources
def test_the_conda_recipe_requires_what_the_project_does():
    recipe = YAML(typ="safe").load(ROOT / ".github" / "conda" / "recipe.yaml")["requirements"]
    renamed = {"opencv-contrib-python-headless": "py-opencv", "matplotlib": "matplotlib-base"}
    wanted = [f"python {PROJECT['requires-python']}"]
    for requirement in PROJECT["dependencies"]:
        name, version = requirement.split(">=")
        wanted.append(f"{renamed.get(name, name)} >={version}")
    assert sorted(recipe["run"]) == sorted(wanted)


@needs_sources
def test_items_that_sweep_say_so():
    for paper, parts in items.ITEMS.items():
        for part in parts:
            sweeps = "papers.sweeps" in reached_from(f"papers.{paper}.{part}")
            assert (items.EXTRAS.get((paper, part)) == "sweeps") == sweeps, part


@needs_sources
def test_the_studies_listed_are_those_there_are():
    there = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in (ROOT / "papers").rglob("*.py")
        if "\nSTUDY = " in path.read_text(encoding="utf-8")
    }
    assert set(items.STUDIES) == there


def run(monkeypatch, capsys, *arguments):
    """The exit status, what was printed, and what was said on stderr."""
    monkeypatch.setattr(sys, "argv", ["papers", *map(str, arguments)])
    with pytest.raises(SystemExit) as done:
        main()
    captured = capsys.readouterr()
    return done.value.code, captured.out, " ".join(captured.err.split())


def test_items_without_their_extra_are_left_out_before_anything_runs(tmp_path, monkeypatch, capsys):
    def compute(**_):
        raise OSError("no data")

    monkeypatch.setitem(sys.modules, "zarr", None)
    monkeypatch.setattr("papers.li2024.method.compute", compute)
    chosen = [("li2024", "method"), ("li2024", "fig9b"), ("model_error", "equation14")]
    monkeypatch.setattr("papers.__main__.choose_items", lambda paper, item: chosen)
    status, _, said = run(monkeypatch, capsys, "run", "--quick", "--out", tmp_path)
    assert status == 2
    for item in ("li2024 fig9b", "model_error equation14"):
        why = f'error: {item} needs zarr (not installed): run `pip install "contactmodel[sweeps]"`'
        assert 0 <= said.index(why) < said.index("li2024 method: no data")
    every = "li2024 fig9b, model_error equation14, li2024 method"
    assert f"{every} left out of the results in {tmp_path}" in said


def test_sweep_without_its_extra_names_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, said = run(monkeypatch, capsys, "sweep", items.STUDIES[0])
    assert status == 2
    assert said == (
        f"error: sweep {items.STUDIES[0]} needs distributed (not installed): "
        'run `pip install "contactmodel[sweeps]"`'
    )


def test_a_video_without_its_extra_names_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    (tmp_path / "clip.mp4").touch()
    with pytest.raises(ValueError, match=r"clip\.mp4 needs av .*contactmodel\[video\]"):
        read_recording(tmp_path / "clip.mp4")


def test_the_leaderboard_leaves_out_videos_without_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    monkeypatch.setattr(sources.datasets, "find", lambda name: tmp_path)
    said = []
    assert sources.find_group("pivot-videos", said.append) is None
    assert 'run `pip install "contactmodel[video]"`' in said[0]
    assert sources.find_group("slip-lifts", said.append) == tmp_path


def test_a_missing_extra_is_an_import_error_too(monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ModuleNotFoundError, match=r"this needs zarr"):
        require_extra("sweeps", "this")
    assert issubclass(MissingExtraError, ValueError)


def test_list_names_items_and_studies(monkeypatch, capsys):
    _, out, _ = run(monkeypatch, capsys, "list")
    assert "li2024 method fig6" in out
    assert all(study in out for study in items.STUDIES)
