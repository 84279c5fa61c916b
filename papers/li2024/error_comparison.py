"""The error comparison of Section V-B: all methods that can be run, on the same ten objects.

The paper compares its own error with numbers that others measured with other sensors and objects.
Here every method sees the same frames, and none knows the softness. [6] and [34] are trained
networks without public code; their numbers are compared with the best method that we can run.
`castano` follows the outline of the contact as [13], without its trained segmentation; it is scored
only on contacts with a long axis.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from papers.li2024 import settings
from papers.li2024.fig9b import (
    CALIBRATED,
    PRINTED_DEG,
    Lifts,
    compute,
    limit_per_object,
    per_object,
)
from papers.tables import cell

__all__ = ["compute", "numbers", "plot", "tables"]

ELONGATED = np.array(
    [shape.semi_axes[0] != shape.semi_axes[1] for shape in settings.OBJECTS.values()]
)
"""Objects whose contact has a long axis."""

PRINTED = {
    "paper": PRINTED_DEG,
    "kolamuri": 4.39,
    "castano": 1.85,
    "trained [6]": 3.96,
    "trained [34]": 3.23,
}
"""Mean absolute errors as printed [deg]."""


def numbers(result: Lifts) -> dict[str, float]:
    """Our numbers for `published.csv`."""
    ours = {}
    for method in ("paper", "kolamuri", "castano"):
        each = per_object(result, method)
        each = each[ELONGATED] if method == "castano" else each
        ours |= {method: float(each.mean()), f"{method}_deviation": float(each.std(ddof=1))}
    uncalibrated = [method for method in result.error if method != CALIBRATED]
    best = min((per_object(result, method) for method in uncalibrated), key=np.mean)
    return ours | {
        "best_uncalibrated": float(best.mean()),
        "best_uncalibrated_deviation": float(best.std(ddof=1)),
    }


def tables(result: Lifts) -> dict[str, list[dict[str, object]]]:
    """A row for each method and the bound, pooled over the objects."""
    objects = {method: per_object(result, method) for method in result.error}
    unanswered = {method: 100 * (1 - given.mean()) for method, given in result.answered.items()}
    return {
        "": [
            {
                "method": method,
                "unanswered [%]": cell(unanswered.get(method), 0),
                "mean absolute error [°]": cell(each, 3),
                "of it elongated objects [°]": cell(each[ELONGATED], 3),
                "between objects [°]": cell(each.std(ddof=1), 3),
                "worst object [°]": cell(each.max(), 3),
                "printed, hardware [°]": PRINTED.get(method),
            }
            for method, each in (objects | {"Cramér–Rao bound": limit_per_object(result)}).items()
        ]
    }


def plot(result: Lifts) -> Figure:
    """Our errors and the printed ones side by side, on a logarithmic axis."""
    figure, axis = plt.subplots(figsize=(8, 4), layout="constrained")
    ours = {method: per_object(result, method) for method in result.error}
    names = [*ours, *(name for name in PRINTED if name not in ours)]
    place = np.arange(len(names))
    for i, name in enumerate(names):
        if name in ours:
            axis.barh(place[i] - 0.2, ours[name].mean(), 0.38, color="C0")
            axis.plot(ours[name][ELONGATED].mean(), place[i] - 0.2, "wD", mec="k", ms=5)
        if name in PRINTED:
            axis.barh(place[i] + 0.2, PRINTED[name], 0.38, color="0.7")
    axis.barh(np.nan, np.nan, color="C0", label="here, ten virtual objects")
    axis.plot(np.nan, np.nan, "wD", mec="k", ms=5, label="of them elongated")
    axis.barh(np.nan, np.nan, color="0.7", label="printed, hardware")
    axis.axvline(
        limit_per_object(result).mean(), color="k", ls="--", label="Cramér–Rao bound, here"
    )
    axis.set_xscale("log")
    axis.set_yticks(place, names)
    axis.invert_yaxis()
    axis.set_xlabel("mean absolute error [°]")
    axis.grid(alpha=0.3, axis="x")
    figure.legend(loc="outside upper center", ncols=4, fontsize=8)
    return figure
