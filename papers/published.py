"""Compare the numbers that a paper prints with ours.

A paper's `published.csv` has a row for each number that the paper prints as a result or as a
constant of its method. The parameters of its experiments are in `settings`, with their place in the
paper. A row has `item`, `quantity`, `value`, `unit`, `kind`, `tolerance`, `differs` and `source`. A
number of kind `analytic` follows from the paper itself; one of kind `virtual` follows from a
simulation that can be repeated. For both, ours must lie within `tolerance`, unless `differs` gives
a reason. A number of kind `hardware` was measured with instruments that we do not have: ours is
shown next to it, and never counts as a reproduction.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import NamedTuple

KINDS = ("analytic", "virtual", "hardware")


class Published(NamedTuple):
    """A printed number."""

    item: str  # module of the paper's package that computes our number
    quantity: str  # name of our number in `numbers` of that module
    value: float  # the number as printed
    unit: str  # unit of the number
    kind: str  # one of `KINDS`
    tolerance: str  # largest allowed difference, and its reason after a colon
    differs: str  # reason why our number is out of tolerance; empty if it is within
    source: str  # place in the paper

    @property
    def allowed(self) -> float:
        """The tolerance as a number."""
        return float(self.tolerance.partition(":")[0] or "nan")

    def judge(self, ours: float) -> str:
        """Verdict on our number: `compared` (hardware), `reproduced`, `differs` or `WRONG`.

        `WRONG` means out of tolerance without a reason in `differs`, or within it despite one.
        """
        if self.kind == "hardware":
            return "compared"
        within = math.isclose(ours, self.value, rel_tol=0.0, abs_tol=self.allowed)
        if self.differs:
            return "WRONG" if within else "differs"
        return "reproduced" if within else "WRONG"


def read_published(paper: str) -> list[Published]:
    """The printed numbers of a paper; empty for our own studies, which have no `published.csv`."""
    file = resources.files(f"papers.{paper}") / "published.csv"
    if not file.is_file():
        return []
    rows = csv.DictReader(file.read_text(encoding="utf-8").splitlines())
    return [Published(value=float(row.pop("value")), **row) for row in rows]


def compare(rows: Sequence[Published], ours: Mapping[str, float]) -> list[dict[str, object]]:
    """A table row for each printed number of an item, with our number and the verdict."""
    return [
        {
            "quantity": row.quantity,
            "unit": row.unit,
            "printed": row.value,
            "ours": float(f"{ours[row.quantity]:.4g}"),
            "kind": row.kind,
            "verdict": row.judge(ours[row.quantity]),
            "source": row.source,
        }
        for row in rows
    ]
