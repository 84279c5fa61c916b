"""Fig. 9(b): error on ten objects, without and with their softness calibrated on other lifts.

The module `lifts` simulates the lifts. For the calibration, k and L of Eq. (13) are fitted to all
other lifts of the object, by least squares of the reference over the elastomer's rotation. The loss
is robust, so that a failed lift does not spoil the fit. A lift without an answer counts as an error
of its full angle.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from contactmodel.equations import object_rotation
from estimation.estimators import DEFAULT_METHOD
from papers.items import Track
from papers.li2024 import settings
from papers.li2024.lifts import METHODS
from papers.limits import MEAN_ABSOLUTE
from papers.sweeps import run_study
from papers.tables import cell, finish

CALIBRATED = f"{DEFAULT_METHOD}, calibrated"

PRINTED_DEG = 1.34
"""Mean absolute error as printed, on hardware [deg]."""

_WRONG_DEG = 0.1  # ten times the effect of noise; larger residuals get less weight


class Lifts(NamedTuple):
    """One value per lift.

    Attributes:
        object_index: row of the object.
        reference: angle of the angular sensor [deg].
        error: error of each method, and of the default one after calibration [deg].
        answered: whether each of them has an answer.
        limit: mean absolute error at the Cramér–Rao bound of one frame, for the object's angle with
            known softness [deg].
        stick: number of markers that truly stick at the end.
    """

    object_index: Int[np.ndarray, " lifts"]
    reference: Float[np.ndarray, " lifts"]
    error: dict[str, Float[np.ndarray, " lifts"]]
    answered: dict[str, Bool[np.ndarray, " lifts"]]
    limit: Float[np.ndarray, " lifts"]
    stick: Int[np.ndarray, " lifts"]


def compute(quick: bool = False, track: Track = iter) -> Lifts:
    """Evaluate the lifts; results of `python -m papers sweep papers.li2024.lifts` are reused."""
    results = run_study("papers.li2024.lifts", quick, track)
    object_index, reference = results.table["object_index"], results.values["reference"]
    elastomer = dict(zip(METHODS, results.values["elastomer"].T, strict=True))
    corrected = calibrate_on_others(elastomer[DEFAULT_METHOD], reference, object_index)
    answers = elastomer | {CALIBRATED: corrected}
    error = {method: np.nan_to_num(angle) - reference for method, angle in answers.items()}
    answered = {method: np.isfinite(angle) for method, angle in answers.items()}
    limit = MEAN_ABSOLUTE * results.values["limit"] * reference / elastomer[DEFAULT_METHOD]
    return Lifts(object_index, reference, error, answered, limit, results.values["stick"])


def calibrate_on_others(
    elastomer: Float[np.ndarray, " lifts"],
    reference: Float[np.ndarray, " lifts"],
    object_index: Int[np.ndarray, " lifts"],
) -> Float[np.ndarray, " lifts"]:
    """The object's angle by Eq. (13), with k and L fitted to the object's other lifts [deg]."""
    angle = np.full(len(object_index), np.nan)
    for lift in range(len(object_index)):
        others = (object_index == object_index[lift]) & np.isfinite(elastomer)
        others[lift] = False
        phi, theta = elastomer[others], reference[others]
        fit = least_squares(
            lambda kl, phi=phi, theta=theta: object_rotation(phi, *kl) - theta,
            [0.0, 0.0],
            loss="soft_l1",
            f_scale=_WRONG_DEG,
        )
        angle[lift] = object_rotation(elastomer[lift], *fit.x)
    return angle


def numbers(result: Lifts) -> dict[str, float]:
    """Our numbers for `published.csv`: mean and scatter over the objects, and the worst object."""
    each = per_object(result, CALIBRATED)
    return {
        "mean_absolute_error": float(each.mean()),
        "standard_deviation": float(each.std(ddof=1)),
        "worst_object": float(each.max()),
    }


def per_object(result: Lifts, method: str) -> Float[np.ndarray, " objects"]:
    """Mean absolute error of each object [deg]."""
    return _by_object(np.abs(result.error[method]), result)


def limit_per_object(result: Lifts) -> Float[np.ndarray, " objects"]:
    """Mean absolute error of each object at the Cramér–Rao bound [deg]."""
    return _by_object(result.limit, result)


def _by_object(values: Float[np.ndarray, " lifts"], result: Lifts) -> np.ndarray:
    return np.array([values[result.object_index == i].mean() for i in range(len(settings.OBJECTS))])


def tables(result: Lifts) -> dict[str, list[dict[str, object]]]:
    """Mean absolute error of each method: a row for each object, and one for their mean."""
    means = {method: per_object(result, method) for method in result.error}
    means["Cramér–Rao bound"] = limit_per_object(result)
    rows: list[dict[str, object]] = [
        {
            "object": name,
            "k": shape.stiffness_ratio,
            "elastomer [mm]": shape.thickness,
            "lifts": int((result.object_index == i).sum()),
            "sticking markers": cell(result.stick[result.object_index == i], 1),
            **{f"{method} [°]": cell(mean[i], 3) for method, mean in means.items()},
        }
        for i, (name, shape) in enumerate(settings.OBJECTS.items())
    ]
    pooled: dict[str, object] = {f"{method} [°]": cell(mean, 3) for method, mean in means.items()}
    rows.append(dict.fromkeys(rows[0]) | {"object": "mean of the objects"} | pooled)
    return {"": rows}


def plot(result: Lifts) -> Figure:
    """Box plots of the absolute error by object, uncalibrated and calibrated, with the bound."""
    figure, axes = plt.subplots(3, 1, figsize=(10, 11), sharex=True, sharey=True,
                                layout="constrained")  # fmt: skip
    place = np.arange(1, len(settings.OBJECTS) + 1)
    limit = limit_per_object(result)
    for axis, method in zip(axes, ("paper", DEFAULT_METHOD, CALIBRATED), strict=True):
        error = np.abs(result.error[method])
        axis.boxplot(
            [error[result.object_index == i] for i in range(len(place))],
            widths=0.6,
            flierprops={"ms": 3},
        )
        axis.hlines(limit, place - 0.4, place + 0.4, colors="k", linestyles="--",
                    label="Cramér–Rao bound of one frame")  # fmt: skip
        axis.axhline(PRINTED_DEG, color="0.5", ls=":", label=f"paper, hardware: {PRINTED_DEG}°")
        mean = per_object(result, method)
        errors = f"mean absolute error {mean.mean():.3f}°, worst object {mean.max():.3f}°"
        finish(axis, title=f"{method}: {errors}", ylabel="absolute error [°]", yscale="log")
    axes[-1].legend(fontsize=8, loc="upper left")
    labels = [f"{name}\nk = {t.stiffness_ratio:g}, {t.thickness:g} mm"
              for name, t in settings.OBJECTS.items()]  # fmt: skip
    axes[-1].set_xticks(place, labels, fontsize=8)
    return figure
