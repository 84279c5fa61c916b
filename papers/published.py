"""What a paper prints, and ours beside it.

`published.csv` of a paper has a row for each number it prints as a result or as a constant of its
method; what its experiments were set to stands in `settings`, with the place. A row has `item`,
`quantity`, `value`, `unit`, `kind`, `tolerance`, `differs` and `source`. A number of kind
`analytic` follows from the paper itself, one of kind `virtual` from a simulation that can be
repeated: ours must lie within `tolerance`, unless `differs` says why it does not. One of kind
`hardware` was measured with instruments that we do not have: ours stands beside it and is never
said to reproduce it.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import NamedTuple

KINDS = ("analytic", "virtual", "hardware")


class Published(NamedTuple):
    """A printed number.

    Attributes:
        item: module of the paper's package that computes ours.
        quantity: name of ours in `numbers` of that module.
        value: as printed.
        unit: of it.
        kind: one of `KINDS`.
        tolerance: by which ours may be off, with its reason after a colon.
        differs: why ours is farther off, if it is.
        source: place in the paper.
    """

    item: str
    quantity: str
    value: float
    unit: str
    kind: str
    tolerance: str
    differs: str
    source: str

    @property
    def allowed(self) -> float:
        """The tolerance as a number."""
        return float(self.tolerance.partition(":")[0] or "nan")

    def judge(self, ours: float) -> str:
        """`compared` for hardware, else `reproduced`, `differs` where told so, or `WRONG`."""
        if self.kind == "hardware":
            return "compared"
        within = math.isclose(ours, self.value, rel_tol=0.0, abs_tol=self.allowed)
        if self.differs:
            return "WRONG" if within else "differs"
        return "reproduced" if within else "WRONG"


def read_published(paper: str) -> list[Published]:
    """The rows of a paper; none if it prints nothing, as a study of our own."""
    file = resources.files(f"papers.{paper}") / "published.csv"
    if not file.is_file():
        return []
    rows = csv.DictReader(file.read_text(encoding="utf-8").splitlines())
    return [Published(value=float(row.pop("value")), **row) for row in rows]


def compare(rows: Sequence[Published], ours: Mapping[str, float]) -> list[dict[str, object]]:
    """Printed beside ours, for the rows of one item."""
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
