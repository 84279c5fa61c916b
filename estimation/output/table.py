"""Tables of results: a column for each quantity that a `Record` declares, a row for each frame."""

import csv
import io
from collections.abc import Iterable, Mapping

import numpy as np
from jaxtyping import Float

from estimation.estimators.result import Result, Withdrawn, show_degrees, show_number
from estimation.slip.margin import MarginPath

MARGIN_COLUMNS = (
    "stick_ratio",
    "angle_left_deg",
    "angle_left_low_deg",
    "angle_left_high_deg",
    "moment_left_Nmm",
    "moment_left_low_Nmm",
    "moment_left_high_Nmm",
)
"""Beside the chosen method's angles; empty where they cannot be told."""


def tabulate(
    result: Result, series: Mapping[str, Float[np.ndarray, " frames"]] | None = None
) -> dict[str, list[str]]:
    """The cells of a result by column, withdrawn answers in columns of their own.

    Args:
        result: of one method.
        series: other angles over its frames, by column [rad].
    """
    frames, table = range(len(result.time)), dict[str, list[str]]()
    for name, column in result.columns().items():
        if column.name:
            table[column.name] = [column.show(value) for value in getattr(result, name)]
        if name == "time":
            table["frame"] = [str(i) for i in frames]
    for name, angles in (series or {}).items():
        table[name] = [show_degrees(angle) for angle in angles]
    gone = result.withdrawn
    for name, column in Withdrawn.columns().items():
        if column.name and column.answer:
            table[f"withdrawn_{column.name}"] = [
                "" if gone is None or not gone.rows[i] else column.show(getattr(gone, name)[i])
                for i in frames
            ]
    return table


def tabulate_margin(result: Result, margin: MarginPath) -> dict[str, list[str]]:
    """The cells of `MARGIN_COLUMNS`, by column; empty where there is no number."""
    stick, contact = result.stick.sum(axis=1), result.contact.sum(axis=1)
    ratio = np.sqrt(np.where(contact, stick / np.maximum(contact, 1), np.nan))
    left = np.array(margin.margins).reshape(-1, len(MARGIN_COLUMNS) - 1)
    values = np.column_stack([ratio, np.degrees(left[:, :3]), left[:, 3:]])
    return {
        name: [show_number(value) if np.isfinite(value) else "" for value in column]
        for name, column in zip(MARGIN_COLUMNS, values.T, strict=True)
    }


def csv_text(tables: Iterable[Mapping[str, list[str]]]) -> str:
    """Tables with the same columns as CSV, one below the other."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for number, table in enumerate(tables):
        if number == 0:
            writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))
    return text.getvalue()
