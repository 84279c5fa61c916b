"""The report of a calibration: results, figures, notes and tables."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from estimation.output.report import figure_png, render_page, write_page


def write_findings(
    out: Path,
    figures: Mapping[str, tuple[Figure, str]],
    *,
    title: str,
    lead: Sequence[str],
    lists: Mapping[str, Sequence[str]] | None = None,
    tables: Mapping[str, Any] | None = None,
) -> None:
    """Write the figures, and a self-contained report.html that contains them.

    Figures have captions and come by file name; lists and tables come by heading.
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
    write_page(out, images, page)
