"""The site's pages name what there is, link to what there is, and its tutorials read easily."""

import ast
import doctest
import inspect
import re
from importlib import import_module

import pytest

from contactmodel import equations
from tests.structure import PACKAGES, ROOT, needs_sources

LIBRARIES = ("contactmodel", "estimation", "calibration")
PUBLIC = [(package, name) for package in LIBRARIES for name in import_module(package).__all__]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.py"))
FOLDERS = ("examples", *PACKAGES)
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", *(f"{name}/**/README.md" for name in FOLDERS))
    for page in ROOT.glob(pattern)
    if "made" not in page.relative_to(ROOT).parts
)


def read(*path):
    return ROOT.joinpath(*path).read_text(encoding="utf-8")


@pytest.mark.parametrize("package", LIBRARIES)
def test_every_public_name_is_in_the_reference_once(package):
    listed = re.findall(
        r"^\.\. (?:auto|py:)\w+:: (\w+)$", read("docs/reference", f"{package}.md"), re.M
    )
    assert sorted(listed) == sorted(import_module(package).__all__)


def describe(package, name):
    """The text of a public name: the reference's own where it has one, else the docstring."""
    page = read("docs/reference", f"{package}.md")
    own = re.search(rf"^\.\. py:\w+:: {name}\n\n((?: {{3}}.*\n|\n)+)", page, re.M)
    member = getattr(import_module(package), name)
    return own[1] if own else inspect.cleandoc(member.__doc__ or "")


@pytest.mark.parametrize(("package", "name"), PUBLIC, ids=[".".join(each) for each in PUBLIC])
def test_every_public_name_has_an_example_that_runs(package, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # examples write their files where they are run
    case = doctest.DocTestParser().get_doctest(
        describe(package, name), {"__name__": "__main__"}, f"{package}.{name}", None, 0
    )
    assert any(example.want for example in case.examples), "no example that shows a result"
    report, runner = [], doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(case, out=report.append, clear_globs=False)
    assert not runner.failures, "".join(report)
    member, made = getattr(import_module(package), name), case.globs.values()
    assert name in case.globs or any(isinstance(each, member) for each in made), "another's example"


def anchors(page):
    """The headings of a page, as its links name them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@needs_sources
@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if not link.startswith(("http://", "https://")):
            path, _, anchor = link.partition("#")
            target = (page.parent / path) if path else page
            assert target.exists(), link
            assert not anchor or anchor in anchors(target), link


def test_pages_are_listed():
    contents, readme = read("docs/contents.md"), read("README.md")
    assert all(f"docs/tutorials/{path.name}" in readme for path in TUTORIALS)
    for page in PAGES:
        name = page.relative_to(ROOT).with_suffix("").as_posix()
        inner = name.startswith(("docs/theory/", "docs/reference/")) and page.stem != "index"
        assert inner or name in ("README", "docs/contents") or f"\n{name}\n" in contents


@needs_sources
def test_commands_of_the_readme_are_those_that_are_checked():
    first, _, test = re.findall(r"```bash\n(.*?)\n```", read("README.md"))
    assert first.endswith("pip install -q . && .venv/bin/python -m estimation run --out pivot")
    assert test in read(".ci/run").splitlines()
    assert test in read("CONTRIBUTING.md").splitlines()
    build = "python -m sphinx -W -c docs . build/docs"
    for place in ("CONTRIBUTING.md", "docs/conf.py"):
        assert build in read(place), place


def test_the_equation_index_names_what_there_is():
    rows = [
        line.split("|")[3:5] for line in read("docs/equations.md").splitlines() if "| `" in line
    ]
    functions = {name for row in rows for name in re.findall(r"`(\w+)`", row[0])}
    assert functions - {"grow_stick_region"} <= set(dir(equations))
    assert len(rows) == 12
    text = read("tests/contactmodel/test_equations.py") + read(
        "tests/contactmodel/test_kinematics.py"
    )
    for name in {name for row in rows for name in re.findall(r"`(test_\w+)`", row[1])}:
        assert f"def {name}(" in text


def prose(script):
    """The sentences of a tutorial: its docstring and the text between its pieces of code."""
    blocks = re.findall(r"^# %%\n((?:#.*\n)+)", script, re.M)
    text = "\n\n".join([ast.get_docstring(ast.parse(script)) or "", *blocks])
    lines = [re.sub(r"^# ?", "", line) for line in text.splitlines()]
    kept = [line for line in lines if not re.match(r"( {3}|\.\. |[-=]{3})", line)]
    return re.sub(r"``.*?``", "it", "\n".join(kept)).replace("\n- ", "\n\n").replace("*", "")


def reading_ease(text):
    """Flesch's number: 60 and more is plain English, below 50 is hard."""
    sentences = [part for part in re.split(r"[.?!]\s|\n\n", text) if re.search(r"[a-z]", part)]
    words = re.findall(r"[A-Za-z']+", text)
    syllables = sum(
        max(1, len(re.findall(r"[aeiouy]+", word.lower().removesuffix("e")))) for word in words
    )
    return 206.835 - 1.015 * len(words) / len(sentences) - 84.6 * syllables / len(words)


def test_reading_ease_tells_plain_from_hard():
    assert reading_ease("The cat sat on the mat. It was warm.") > 100.0
    hard = "Incompressible elastomeric configurations necessitate simultaneous determination"
    assert reading_ease(hard) < 0.0


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorials_read_easily(path):
    assert reading_ease(prose(path.read_text(encoding="utf-8"))) >= 50.0
