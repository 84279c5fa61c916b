"""The report of a fit: its pictures, what was found, and notes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from estimation.frames.files import write_whole
from estimation.output.report import figure_png, render_page


def write_findings(
    out: Path,
    figures: Mapping[str, tuple[Figure, str]],
    *,
    title: str,
    lead: Sequence[str],
    lists: Mapping[str, Sequence[str]] | None = None,
    tables: Mapping[str, Any] | None = None,
) -> None:
    """Write the pictures and a self-contained report.html with them.

    Args:
        out: folder.
        figures: the pictures by the names of their files, each with its caption.
        title: of the page.
        lead: lines of what was found.
        lists: lines under headings of their own.
        tables: rows under headings of their own.
    """
    images = {name: figure_png(figure) for name, (figure, _) in figures.items()}
    page = render_page(
        "findings.html",
        images,
        title=title,
        lead=lead,
        lists=lists or {},
        captions={name: caption for name, (_, caption) in figures.items()},
        tables=tables or {},
    )
    for name, image in images.items():
        write_whole(out / name, image)
    write_whole(out / "report.html", page)
