"""Scores of a slip, how well they separate the outcomes, and the fit of our probability.

The logistic function of the probability is that of [Platt1999] J. Platt, "Probabilistic outputs for
support vector machines"; the prior on its spread is ours.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.stats import rankdata

from estimation.slip.outcome import find_onset
from estimation.slip.shear import ShearPath, ShearSettings, find_slip_probability
from papers.slip_lifts.settings import FitSettings, RuleSettings


def measure_auc(score: Float[np.ndarray, " n"], slipped: Bool[np.ndarray, " n"]) -> float:
    """Share of the pairs of a slip and a hold in which the slip has the higher score [-].

    Ties count half. The result is NaN if all lifts have the same outcome.
    """
    slips, holds = int(slipped.sum()), int((~slipped).sum())
    if not slips or not holds:
        return np.nan
    return float((rankdata(score)[slipped].sum() / slips - 0.5 * (slips + 1)) / holds)


def draw_roc(
    score: Float[np.ndarray, " n"], slipped: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " bounds"], Float[np.ndarray, " bounds"]]:
    """ROC curve: shares of holds and of slips at or above each threshold, from 0 to 1 [-]."""
    bounds = [np.inf, *np.unique(score)[::-1]]
    false, true = (
        np.array([np.mean(score[group] >= bound) for bound in bounds])
        for group in (~slipped, slipped)
    )
    return false, true


def first_called(slipped: Float[np.ndarray, " frames"]) -> int | None:
    """First frame with a probability of a slip above one half; None without such a frame."""
    over = slipped > 0.5
    return int(over.argmax()) if over.any() else None


def date_onset(shears: ShearPath) -> int | None:
    """First frame of the first slip in view of all frames, as in `Outcome`; None without one."""
    called = first_called(shears.slip_probability)
    return None if called is None else find_onset(shears, called)


def choose_bound(score: Float[np.ndarray, " n"], slipped: Bool[np.ndarray, " n"]) -> float:
    """The threshold of the score with the most right calls, in the middle of its gap."""
    values = np.unique(score)
    bounds = np.concatenate([values[:1] - 1.0, 0.5 * (values[1:] + values[:-1])])
    right = [np.mean((score > bound) == slipped) for bound in bounds]
    best = bounds[np.isclose(right, np.max(right))]
    return float(best[len(best) // 2])


def leave_out(score: Float[np.ndarray, " n"], slipped: Bool[np.ndarray, " n"], group: np.ndarray):
    """Calls of a slip, each with the threshold that is best for the other groups.

    Returns:
        Whether each recording is called a slip.
    """
    called = np.zeros(len(score), dtype=bool)
    for name in np.unique(group):
        own = group == name
        called[own] = score[own] > choose_bound(score[~own], slipped[~own])
    return called


def apply_rule(moved: Float[np.ndarray, "frames n 2"], settings: RuleSettings) -> float:
    """Share of the peak shear that the most sheared markers have lost at the end [-].

    Args:
        moved: motion of each marker since the first frame [px]; NaN if hidden.
        settings: settings of the rule.
    """
    far = np.max(np.nan_to_num(np.linalg.norm(moved, axis=-1)), axis=0)
    top = np.argsort(-far)[: settings.markers]
    shear = np.linalg.norm(np.nanmedian(moved[:, top], axis=1), axis=-1)
    peak = float(shear.max())
    return 1.0 - float(shear[-1]) / peak if peak > settings.least else 0.0


def fit_probability(
    signs: Float[np.ndarray, "3 lifts frames"],
    slipped: Bool[np.ndarray, " lifts"],
    settings: FitSettings,
) -> ShearSettings:
    """Fit the settings of the probability to the outcomes by maximum likelihood with a prior.

    Args:
        signs: inputs of `find_slip_probability` [-].
        slipped: whether the object slipped out, by lift.
        settings: settings of the fit.
    """

    names = ("kept", "fallen", "fallen_spread", "kept_spread")
    medians = np.array([settings.fallen, settings.spread, settings.spread])

    def unpack(x: np.ndarray) -> ShearSettings:
        numbers = map(float, (x[0], *np.exp(x[1:]) * medians))
        return replace(ShearSettings(), **dict(zip(names, numbers, strict=True)))

    def cost(x: np.ndarray) -> float:
        p = np.nan_to_num(find_slip_probability(signs, unpack(x))).max(axis=1)
        right = np.where(slipped, p, 1.0 - p)
        prior = 0.5 * np.sum((x[1:] / settings.width) ** 2)
        return float(prior - np.sum(np.log(np.maximum(right, 1e-12))))

    fits = [
        minimize(cost, [start, 0.0, 0.0, 0.0], method="Nelder-Mead", options={"fatol": 1e-6})
        for start in settings.starts
    ]
    return unpack(min(fits, key=lambda fit: fit.fun).x)
