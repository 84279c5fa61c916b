"""The least certain lifts: pictures of the gel, with the estimates below."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from estimation.pictures.stream import read_pictures
from papers.slip_lifts import settings
from papers.slip_lifts.lifts import LEFT_OUT, OURS, Study, compute
from papers.tables import cell

__all__ = ["compute", "plot", "tables"]


def find_worst(study: Study) -> list[int]:
    """Indices of the lifts whose true outcome got the lowest probability, worst first."""
    score = study.scores.get(LEFT_OUT, study.scores[OURS])
    right = np.where(study.slipped, score, 1.0 - score)
    return [int(i) for i in np.argsort(right)[: settings.WORST]]


def tables(result: Study) -> dict[str, list[dict[str, object]]]:
    """The evidence of a slip in each of these lifts."""
    rows = []
    for i in find_worst(result):
        lift = result.lifts[i]
        row: dict[str, object] = {
            "object": lift.label.object_,
            "lift": lift.label.lift,
            "label": "slipped" if lift.label.slipped else "held",
            "greatest shear [px]": cell([shear.shear for shear in lift.shears], 1, np.max),
            "fallen by": cell([shear.fallen for shear in lift.shears], 2, np.max),
            "least print correlation": cell(lift.signs[1], 2, np.min),
        }
        shown = {n: result.scores[n][i] for n in (OURS, LEFT_OUT) if n in result.scores}
        rows.append(row | {name: cell(score, 2) for name, score in shown.items()})
    return {"": rows}


def plot(result: Study) -> Figure:
    """A row of pictures for each lift; below, shear, hold of the print and probability."""
    worst = find_worst(result)
    figure = plt.figure(figsize=(14, 3.4 * len(worst)), layout="constrained")
    parts = figure.subfigures(len(worst), 1, squeeze=False)[:, 0]
    score = result.scores.get(LEFT_OUT, result.scores[OURS])
    for part, i in zip(parts, worst, strict=True):
        lift = result.lifts[i]
        what = "slipped" if lift.label.slipped else "held"
        part.suptitle(
            f"{lift.label.object_} {lift.label.lift}: {what}, probability of a slip {score[i]:.2f}",
            fontsize=9,
        )
        shown = np.linspace(0, len(lift.frames) - 1, settings.SHOWN).round().astype(int)
        axes = part.subplot_mosaic([list(map(str, shown)), ["below"] * len(shown)])
        pictures = list(read_pictures(lift.folder))
        for k in shown:
            if (image := pictures[k].image) is not None:
                axes[str(k)].imshow(image[..., ::-1])
            axes[str(k)].set_title(f"frame {k}", fontsize=7)
            axes[str(k)].axis("off")
        _draw_below(axes["below"], lift.shears)
    return figure


def _draw_below(axis: Axes, shears: Sequence) -> None:
    size = np.array([shear.shear for shear in shears])
    most = np.nanmax(size)
    axis.plot(size / max(most, 1e-9), "C0", label=f"shear, over {most:.1f} px")
    axis.plot([shear.print_correlation for shear in shears], "C2", label="print correlation")
    axis.plot([shear.slip_probability for shear in shears], "C3", label="probability of a slip")
    axis.axhline(0.5, color="0.7", lw=0.6)
    axis.set(ylim=(-0.05, 1.05), xlim=(0, len(shears) - 1))
    axis.legend(fontsize=7, loc="center left")
