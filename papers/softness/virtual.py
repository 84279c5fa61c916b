"""Virtual objects: k is fitted on some grasps and tested on grasps of other contact sizes.

Spheres on a half-space elastomer, by closed forms. In the fitted grasps a stage with 0.05° of noise
and its own zero measures the angle. A frame counts if at least ten markers have always stuck.
"""

from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from calibration.softness.fit import fit_softness
from calibration.softness.references import Reference
from calibration.softness.trials import make_trials
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording
from estimation.softness import ScalarSoftness
from estimation.tracking.tracker import estimate_angles
from estimation.virtual.recording import PivotModel, Truth, simulate_pivot
from papers.items import Track
from papers.tables import finish

RATIOS = (0.1, 0.3, 0.5, 1.0, 2.0)
NOISES_MM = (1e-3, 1e-2)
FITTED_RADII, TESTED_RADII = (5.0, 5.5), (3.5, 7.0)
STAGE_DEG = 0.05
FIRM = 10


class Case(NamedTuple):
    """One object at one noise."""

    k: float  # true stiffness ratio [-]
    noise: float  # noise of the markers in the plane [mm]
    found: float  # fitted k [-]
    low: float  # lower end of its 95 % interval [-]
    high: float  # upper end of its 95 % interval [-]
    # mean absolute error without softness [deg], and its mean over θ [-]
    before: tuple[float, float]
    after: tuple[float, float]  # the same errors with the fitted softness
    inside: float  # share of the 95 % intervals that hold the truth, with the fitted softness [-]
    frames: int  # number of tested frames


def compute(quick: bool = False, track: Track = iter) -> list[Case]:
    """Fit and test each object at each noise."""
    grid = [(k, noise) for k in RATIOS for noise in NOISES_MM]
    return [_case(k, noise) for k, noise in track(grid[:1] if quick else grid)]


def _case(k: float, noise_mm: float) -> Case:
    noise = Noise.from_std(noise_mm)
    trials = []
    for seed, radius in enumerate(FITTED_RADII):
        recording, truth = _pivot(k, radius, noise_mm, seed)
        trials += make_trials(recording, _stage(recording, truth, seed), noise=noise)
    fit = fit_softness(trials)
    errors: dict[str, list[np.ndarray]] = {"before": [], "after": []}
    angles, inside = [], []
    for seed, radius in enumerate(TESTED_RADII, start=10):
        recording, truth = _pivot(k, radius, noise_mm, seed)
        firm = (truth.stick.sum(axis=1) >= FIRM) & (np.abs(truth.angle) > np.radians(1.0))
        for name, softness in (("before", ScalarSoftness()), ("after", fit.softness)):
            result = estimate_angles(recording, "incremental", noise=noise, softness=softness)
            errors[name].append((np.nan_to_num(result.angle) - truth.angle)[firm])
            if name == "after":
                inside.append(((result.low <= truth.angle) & (truth.angle <= result.high))[firm])
        angles.append(truth.angle[firm])
    size = np.abs(np.concatenate(angles))

    def shown(parts: list[np.ndarray]) -> tuple[float, float]:
        error = np.abs(np.concatenate(parts))
        return float(np.degrees(error.mean())), float(np.mean(error / size))

    return Case(
        k=k,
        noise=noise_mm,
        found=fit.stiffness_ratio,
        low=fit.low,
        high=fit.high,
        before=shown(errors["before"]),
        after=shown(errors["after"]),
        inside=float(np.concatenate(inside).mean()),
        frames=len(size),
    )


def _pivot(k: float, radius: float, noise: float, seed: int) -> tuple[Recording, Truth]:
    model = PivotModel(
        stiffness_ratio=k,
        contact_radius=radius,
        friction_ratio=0.3,
        noise=noise,
        normal_noise=3.5 * noise,
        offset=(0.3 + 0.1 * seed, -0.2),
    )
    return simulate_pivot(model, angles_deg=(0.0, 10.0, -6.0), frames=(20, 32), seed=seed)


def _stage(recording: Recording, truth: Truth, seed: int) -> Reference:
    noise = np.radians(STAGE_DEG) * np.random.default_rng(100 + seed).normal(size=len(recording))
    unknown = np.full(len(recording), np.nan)
    return Reference(recording.time, truth.angle + noise + seed, unknown, False, True, "stage")


def tables(result: list[Case]) -> dict[str, list[dict[str, object]]]:
    """A row for each object and noise."""
    return {
        "": [
            {
                "k": case.k,
                "noise [µm]": round(1e3 * case.noise, 3),
                "k fitted": round(case.found, 4),
                "95 %": f"{case.low:.4f} to {case.high:.4f}",
                "error before [°]": round(case.before[0], 3),
                "before [%]": round(100 * case.before[1], 2),
                "error after [°]": round(case.after[0], 3),
                "after [%]": round(100 * case.after[1], 2),
                "interval holds truth": round(case.inside, 3),
                "frames": case.frames,
            }
            for case in result
        ]
    }


def plot(result: list[Case]) -> Figure:
    """Error over k, without and with the fitted softness."""
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for noise, marker in zip(NOISES_MM, "os", strict=True):
        chosen = [case for case in result if case.noise == noise]
        for name, colour in (("before", "C3"), ("after", "C0")):
            error = [100 * getattr(case, name)[1] for case in chosen]
            label = f"{name}, {1e3 * noise:g} µm"
            axis.loglog([case.k for case in chosen], error, f"{marker}-", color=colour, label=label)
    finish(axis, legend=8, minor=True, xlabel="k", ylabel="mean error of the angle [%]")
    return figure
