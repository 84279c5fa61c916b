"""The ranking: the share of right answers of each entry, by tier, by group and by case.

An angle is right within `settings.TOLERANCE_DEG`. A lift is right if the entry correctly calls it
slipped or held. A scored frame without an answer counts as wrong. All groups of a tier have the
same weight, and so do all cases of a group.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from papers.leaderboard import settings
from papers.leaderboard.cases import Case
from papers.leaderboard.entries import Entry
from papers.leaderboard.sources import Source
from papers.tables import brief_cell

Row = dict[str, Any]
Line = tuple[str, Mapping[str, float | None]]


class Score(NamedTuple):
    """Score of an entry in a case, over the frames that count for a group."""

    entry: str  # name of the method
    tier: str  # tier of the case
    group: str  # group for which the frames count
    case: str  # name of the case
    right: float  # share of the frames with a right answer [-]
    error: Float[np.ndarray, " answers"]  # errors of the answered frames [deg]; empty for a lift
    frames: int  # number of frames that count
    answered: int  # number of these frames with an answer
    latency: float = np.nan  # mean time per frame [s]; NaN if unknown


def score_all(entries: Sequence[Entry], sources: Sequence[Source]) -> list[Score]:
    """Score every entry in every case; entries that need pictures only in cases with pictures."""
    return [
        score
        for entry in entries
        for source in sources
        if not entry.pictures or source.draw is not None
        for score in score_case(entry, source)
    ]


def score_case(entry: Entry, source: Source) -> list[Score]:
    """Score an entry in a case: one score for each group for which its frames count."""
    case, truth = source.case, source.truth
    latency = entry.latency.get(case.name, np.nan)
    if truth.slipped is not None:
        chance = entry.slipped.get(case.name)
        right = chance is not None and (chance >= 0.5) == truth.slipped
        no_error, answered = np.zeros(0), int(chance is not None)
        return [Score(entry.name, case.tier, case.group, case.name, right, no_error, 1, answered)]
    angle = _fit_length(entry.angle.get(case.name), case)
    scores = []
    for group, counts in truth.counts.items():
        error = np.degrees(angle - truth.angle)[counts]
        error = error[np.isfinite(error)]
        if truth.relative and len(error):
            error = error - np.median(error)
        right = float((np.abs(error) <= settings.TOLERANCE_DEG[case.tier]).sum())
        frames = int(counts.sum())
        share = right / max(frames, 1)
        scores.append(
            Score(
                entry.name, case.tier, group, case.name, share, error, frames, len(error), latency
            )
        )
    return scores


def _fit_length(angle: np.ndarray | None, case: Case) -> Float[np.ndarray, " frames"]:
    """The angle of every frame of a case; NaN where the entry has none, as at its end."""
    fitted = np.full(case.frames, np.nan)
    if angle is not None:
        fitted[: len(angle)] = angle[: case.frames]
    return fitted


def rank(scores: Sequence[Score], others: Sequence[Line] = ()) -> list[Row]:
    """A row for each entry: right answers by tier [%] and their mean, best mean first.

    Args:
        scores: scores of all entries.
        others: entries that were scored before, with their right answers by tier [%]; None where
            they have none, which counts as 0.
    """
    lines = list(others)
    for entry in dict.fromkeys(score.entry for score in scores):
        own_scores = [score for score in scores if score.entry == entry]
        lines.append((entry, {tier: _share(own_scores, tier) for tier in settings.TIERS}))
    rows = [
        {
            "entry": entry,
            **{
                f"{tier}, right [%]": None if share is None else round(share, 1)
                for tier, share in shares.items()
            },
            MEAN: round(sum(share or 0.0 for share in shares.values()) / len(settings.TIERS), 1),
        }
        for entry, shares in lines
    ]
    return sorted(rows, key=lambda row: -row[MEAN])


def tabulate(scores: Sequence[Score], by: str) -> list[Row]:
    """The full table: a row for each entry and `group` or `case`, best entry first."""
    pooled: dict[tuple[str, str, str], list[Score]] = {}
    for score in scores:
        pooled.setdefault((score.group, getattr(score, by), score.entry), []).append(score)
    rows = [_pool(place, entry, group) for (_, place, entry), group in pooled.items()]
    order = list(dict.fromkeys((row["group"], row["of"]) for row in rows))
    rows.sort(key=lambda row: (order.index((row["group"], row["of"])), -row[RIGHT]))
    return rows


RIGHT, MEAN = "right [%]", "mean [%]"


def _pool(place: str, entry: str, scores: Sequence[Score]) -> Row:
    error = np.concatenate([score.error for score in scores])
    frames = sum(score.frames for score in scores)
    return {
        "tier": scores[0].tier,
        "group": scores[0].group,
        "of": place,
        "entry": entry,
        RIGHT: round(100.0 * float(np.mean([score.right for score in scores])), 1),
        "mean absolute error [°]": brief_cell(np.abs(error)),
        "bias [°]": brief_cell(error),
        "spread [°]": brief_cell(error, summary=np.std),
        "answered [%]": round(100.0 * sum(s.answered for s in scores) / max(frames, 1), 1),
        "frames or lifts": frames,
        "latency [ms]": brief_cell(1e3 * np.mean([score.latency for score in scores])),
    }


def plot(scores: Sequence[Score]) -> Figure:
    """A map of the share of right answers [%]: a row for each entry, a column for each group."""
    rows = tabulate(scores, "group")
    entries = [row["entry"] for row in rank(scores)]
    groups = list(dict.fromkeys(row["group"] for row in rows))
    right = np.full((len(entries), len(groups)), np.nan)
    for row in rows:
        cell = entries.index(row["entry"]), groups.index(row["group"])
        right[cell] = row[RIGHT]
    size = 2.5 + 0.6 * len(groups), 1.8 + 0.35 * len(entries)
    figure, axis = plt.subplots(figsize=size, layout="constrained")
    image = axis.imshow(right, cmap="RdYlGn", vmin=0.0, vmax=100.0, aspect="auto")
    for i, j in np.argwhere(np.isfinite(right)):
        axis.text(j, i, f"{right[i, j]:.0f}", ha="center", va="center", fontsize=7)
    axis.set_xticks(range(len(groups)), groups, rotation=40, ha="right", fontsize=8)
    axis.set_yticks(range(len(entries)), entries, fontsize=8)
    axis.set_title("share of right answers [%]; empty: no pictures to answer from", fontsize=10)
    figure.colorbar(image, ax=axis)
    return figure


def _share(scores: Sequence[Score], tier: str) -> float | None:
    groups: Mapping[str, list[float]] = {}
    for score in scores:
        if score.tier == tier:
            groups.setdefault(score.group, []).append(score.right)
    means = [np.mean(shares) for shares in groups.values()]
    return 100.0 * float(np.mean(means)) if groups else None
