"""The report of a fit: one picture, what was found, and notes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from estimation.files import write_whole
from estimation.report import figure_png, render_page


def write_findings(
    out: Path,
    name: str,
    figure: Figure,
    *,
    title: str,
    lead: Sequence[str],
    caption: str,
    lists: Mapping[str, Sequence[str]] | None = None,
    tables: Mapping[str, Any] | None = None,
) -> None:
    """Write the picture and a self-contained report.html with it.

    Args:
        out: folder.
        name: file of the picture.
        figure: the picture.
        title: of the page.
        lead: lines of what was found.
        caption: below the picture.
        lists: lines under headings of their own.
        tables: rows under headings of their own.
    """
    image = figure_png(figure)
    page = render_page(
        "findings.html",
        {name: image},
        title=title,
        lead=lead,
        lists=lists or {},
        captions={name: caption},
        tables=tables or {},
    )
    write_whole(out / name, image)
    write_whole(out / "report.html", page)
