"""The site: `python -m sphinx -W -c docs . build/docs`, run in the repository's root.

The root is the source folder, so that every README is a page where it stands, and its links work
on the site as they do in the repository. The README beside this folder is the start page.
"""

import inspect
import re
from pathlib import Path
from typing import Any

from tests import compile_fast

compile_fast()

import docutils.nodes
import jax
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.domains.python import PyObject
from sphinx.writers.html5 import HTML5Translator

from contactmodel import __version__

jax.config.update("jax_enable_x64", True)

project, author, release = "contactmodel", "The contactmodel developers", __version__
copyright = "The contactmodel developers"
root_doc = "README"
include_patterns = ["*.md", "*/README.md", "papers/**/README.md", "docs/**"]
exclude_patterns = ["docs/tutorials", "docs/contents.md", "build", ".*"]
extensions = [
    "matplotlib.sphinxext.plot_directive",
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
]
myst_enable_extensions = ["attrs_inline", "colon_fence", "deflist", "dollarmath", "html_image"]
myst_heading_anchors = 3
default_role = "code"  # a single backtick in a docstring

autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_default_options = {"members": True}
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 88

plot_formats = ["svg"]
plot_html_show_formats = plot_html_show_source_link = False
plot_rcparams = {"figure.facecolor": "white", "savefig.bbox": "tight"}

sphinx_gallery_conf = {
    "examples_dirs": "docs/tutorials",
    "gallery_dirs": "docs/made/tutorials",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "ExampleTitleSortKey",
    "remove_config_comments": True,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": 3600,
    "abort_on_example_error": True,
    "capture_repr": (),
}

html_theme = "furo"
html_title = "contactmodel"
html_math_renderer = "mathml"
html_copy_source = html_show_sphinx = False
html_additional_pages = {"index": "redirect.html"}
templates_path, html_static_path, html_css_files = ["templates"], ["static"], ["site.css"]


def add_contents(app: Sphinx, page: str, source: list[str]) -> None:
    """The list of all pages follows the README; the scripts follow the README of the examples."""
    if page == root_doc:
        source[0] += Path(app.confdir, "contents.md").read_text(encoding="utf-8")
    if page == "examples/README":
        for script in sorted(Path(app.srcdir, "examples").glob("*.py")):
            source[0] += f"\n## {script.name}\n\n```{{literalinclude}} {script.name}\n```\n"


def link_tutorials(app: Sphinx, tree: docutils.nodes.document) -> None:
    """A link to a tutorial's script opens its page, where the script has been run."""
    for link in list(tree.findall(addnodes.download_reference)):
        path = Path(link["reftarget"])
        if path.parent.name == "tutorials":
            options = {"refdomain": "std", "reftype": "doc", "refexplicit": True}
            page = addnodes.pending_xref("", refdoc=app.env.docname, **options)
            page["reftarget"] = f"/docs/made/tutorials/{path.stem}"
            page += link.children
            link.replace_self(page)


def skip_member(
    app: Sphinx, what: str, name: str, member: Any, skip: bool, options: Any
) -> bool | None:
    """Leave out what only names a field of a tuple, which the class's docstring describes."""
    return (getattr(member, "__doc__", None) or "").startswith("Alias for field number") or None


def add_arguments(
    app: Sphinx, what: str, name: str, member: Any, options: Any, lines: list[str]
) -> None:
    """A class is described with the arguments of its constructor, before its examples."""
    text = (inspect.getdoc(member.__init__) or "") if what == "class" else ""
    if "Args:" in text:
        end = lines.index("Examples:") if "Examples:" in lines else len(lines)
        lines[end:end] = ["", *text[text.index("Args:") :].splitlines(), ""]


def tidy_docstring(
    app: Sphinx, what: str, name: str, member: Any, options: Any, lines: list[str]
) -> None:
    """Shapes of arrays as code, without the modules of their types; trailing underscores stay."""
    for row, line in enumerate(lines):
        if found := re.fullmatch(r"(:vartype \w+): (.*jaxtyping.*)", line):
            lines[row] = f"{found[1]}: ``{re.sub(r'(?:[a-z_]+[.])+(?=[A-Za-z])', '', found[2])}``"
        lines[row] = re.sub(r"^(:vartype .*: )([a-z_.]+[.][A-Z]\w+)$", r"\1~\2", lines[row])
        lines[row] = re.sub(r"^(:\w+ \w+)_:", r"\1\_:", lines[row])


def show_math(
    writer: HTML5Translator, node: docutils.nodes.math | docutils.nodes.math_block
) -> None:
    """Formulas as MathML, which browsers draw themselves: no script, no network."""
    block = isinstance(node, docutils.nodes.math_block)
    writer.body.append(tex2mathml(node.astext(), as_block=block))
    raise docutils.nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Connect the functions above."""
    app.connect("source-read", add_contents)
    app.connect("doctree-read", link_tutorials)
    app.connect("autodoc-skip-member", skip_member)
    app.connect("autodoc-process-docstring", add_arguments, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", tidy_docstring, priority=600)  # after napoleon
    for field in PyObject.doc_field_types:
        field.label = "Attributes" if field.name == "variable" else field.label
    app.add_html_math_renderer("mathml", (show_math, None), (show_math, None))
