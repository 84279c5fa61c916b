"""Labelled lifts: how well slips are detected from the gel's shear and the object's print on it.

[Li2018] R. Li, R. Dong, E. Adelson, "Slip detection with combined tactile and visual information",
ICRA 2018: a gripper with a GelSight finger lifts an object, at widths at which it just holds or
just slips out. All scores use the same frames and markers. Fitted numbers and chosen thresholds
come from the other objects.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from estimation.estimators import DEFAULT_METHOD
from estimation.estimators.result import Result
from estimation.frames import datasets
from estimation.frames.noise import Noise, find_noise
from estimation.frames.recording import Recording
from estimation.slip.outcome import Outcome, conclude
from estimation.slip.shear import Shear, ShearPath, ShearSettings, find_slip_probability
from estimation.slip.warnings import SLIP_WARNINGS
from estimation.sources import read_recording
from estimation.tracking.trackers import Trackers
from papers.items import Track
from papers.slip_lifts import settings
from papers.slip_lifts.scores import (
    apply_rule,
    draw_roc,
    first_called,
    fit_probability,
    leave_out,
    measure_auc,
)
from papers.tables import cell, finish

OURS, LEFT_OUT, RULE = "ours", "ours, object left out", "ten-line rule"
UNPRINTED = "macro slip by the markers alone"


class Label(NamedTuple):
    """A lift, its outcome, and the number of the frame in which the gripper begins to lift."""

    object_: str
    lift: str
    slipped: bool
    begins: int


@dataclass(frozen=True)
class Lift:
    """The answers to a lift."""

    label: Label  # label of the lift
    folder: Path  # folder of its pictures
    frames: tuple[int, ...]  # numbers of the frames
    shears: tuple[Shear, ...]  # shear of the gel in each frame
    outcome: Outcome  # estimated outcome of the lift
    # other scores than the outcome's probability, by name; higher for a slip [-]
    scores: Mapping[str, float]
    macro_slip: float  # share of the frames in macro slip [-]

    @property
    def slipped(self) -> Float[np.ndarray, " frames"]:
        """Probability of a slip in each frame [-]."""
        return np.array([shear.slip_probability for shear in self.shears])

    @property
    def signs(self) -> Float[np.ndarray, "3 frames"]:
        """Inputs of the probability: fall of the shear, hold and slip of the print [-]."""
        names = ("fallen", "print_correlation", "slid")
        return np.array([[getattr(shear, name) for shear in self.shears] for name in names])


@dataclass(frozen=True, eq=False)
class Study:
    """The answers to the lifts of some objects."""

    root: Path
    lifts: tuple[Lift, ...]

    @cached_property
    def slipped(self) -> Bool[np.ndarray, " lifts"]:
        """Whether the object slipped out, by lift."""
        return np.array([lift.label.slipped for lift in self.lifts])

    @cached_property
    def objects(self) -> np.ndarray:
        """The object's name, by lift."""
        return np.array([lift.label.object_ for lift in self.lifts])

    @cached_property
    def fits(self) -> dict[str, ShearSettings]:
        """Settings of the probability, fitted to all other objects, by the object left out."""
        signs = np.stack([lift.signs for lift in self.lifts], axis=1)
        signs[2] = np.nan  # otherwise lifts with a tracked print would not enter the fit
        names = np.unique(self.objects) if len(np.unique(self.objects)) > 1 else []
        return {
            str(name): fit_probability(
                signs[:, self.objects != name],
                self.slipped[self.objects != name],
                settings.FitSettings(),
            )
            for name in names
        }

    @cached_property
    def scores(self) -> dict[str, Float[np.ndarray, " lifts"]]:
        """All scores of a slip by name, ours first [-]."""
        ours = {OURS: np.array([lift.outcome.probability for lift in self.lifts])}
        if self.fits:
            ours[LEFT_OUT] = np.array([_refit(lift, self.fits) for lift in self.lifts])
        others = self.lifts[0].scores
        return ours | {
            name: np.array([lift.scores[name] for lift in self.lifts]) for name in others
        }

    @cached_property
    def called(self) -> dict[str, Bool[np.ndarray, " lifts"]]:
        """Masks of the lifts called slips, by score; scores without a fixed threshold need several
        objects."""
        own = {OURS: 0.5, LEFT_OUT: 0.5, RULE: settings.RuleSettings().fallen}
        return {
            name: score > own[name] if name in own else leave_out(score, self.slipped, self.objects)
            for name, score in self.scores.items()
            if name in own or self.fits
        }


def compute(quick: bool = False, track: Track = iter) -> Study:
    """Answer all lifts; if quick, only those of one object."""
    root = datasets.fetch("slip-lifts")
    result_files = sorted(root.glob(f"{settings.QUICK if quick else 'object*'}_result.dat"))
    lift_labels = [label for table in result_files for label in read_labels(table)]
    return Study(root, tuple(answer(root, label) for label in track(lift_labels)))


def read_labels(table: Path) -> Iterator[Label]:
    """The labels of an object's lifts.

    Raises:
        ValueError: a line has another format.
    """
    for number, line in enumerate(table.read_text("utf-8").splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        if len(words) < 7 or words[2] not in ("0", "1"):
            raise ValueError(
                f"{table}, line {number}: expected width, word, label (0 or 1), three frames and "
                f"the lift's folder, got {line!r}"
            )
        object_ = table.name.removesuffix("_result.dat")
        yield Label(object_, f"{words[6]}_mm", words[2] == "0", int(words[5]))


def answer(root: Path, label: Label) -> Lift:
    """Read a lift's pictures, and compute all its scores."""
    folder = root / label.object_ / label.lift
    recording = read_recording(folder)
    noise, _ = find_noise(recording)
    track, shears = follow(recording, noise)
    unprinted = replace(recording, imprint=None, print_point=None, hold=None)
    alone, _ = follow(unprinted, noise)
    moved = (recording.positions - recording.positions[0])[..., :2]
    scores = {RULE: apply_rule(moved, settings.RuleSettings())}
    scores[UNPRINTED] = _share_of_macro_slip(alone)
    for name, warn in SLIP_WARNINGS.items():
        scores[f"warning: {name.replace('_', ' ')}"] = float(warn(recording).warned.mean())
    frames = tuple(map(int, recording.source_index))
    outcome = conclude(ShearPath.of(*shears), track)
    return Lift(label, folder, frames, shears, outcome, scores, _share_of_macro_slip(track))


def follow(recording: Recording, noise: Noise | None) -> tuple[Result, tuple[Shear, ...]]:
    """The default method's result, and the shear in each frame."""
    trackers = Trackers(recording.layout, {DEFAULT_METHOD: {}}, noise=noise)
    estimates, shears = [], []
    for frame in recording:
        estimates.append(trackers.update(frame)[DEFAULT_METHOD])
        shears.append(trackers.shear)
    return Result.gather(DEFAULT_METHOD, estimates), tuple(shears)


def _share_of_macro_slip(track: Result) -> float:
    return float(np.mean(track.slipping))


def _refit(lift: Lift, fits: Mapping[str, ShearSettings]) -> float:
    return float(np.nanmax(find_slip_probability(lift.signs, fits[lift.label.object_])))


def tables(result: Study) -> dict[str, list[dict[str, object]]]:
    """Tables with a row for each object, score, object left out, and lift."""
    every = np.ones(len(result.lifts), dtype=bool)
    objects = {name: result.objects == name for name in dict.fromkeys(result.objects)}
    result_tables = {
        "": [_row(result, str(name), mask) for name, mask in objects.items()]
        + [_row(result, "all", every)],
        "_scores": [_score_row(result, name) for name in result.scores],
        "_lifts": [_lift_row(result, i) for i in range(len(result.lifts))],
    }
    if result.fits:
        result_tables["_fits"] = [_fit_row(result, name) for name in result.fits]
    return result_tables


def _row(study: Study, name: str, mask: Bool[np.ndarray, " lifts"]) -> dict[str, object]:
    slipped = study.slipped[mask]
    macro = np.array([lift.macro_slip for lift in study.lifts])[mask]
    row: dict[str, object] = {
        "object": name,
        "lifts": int(mask.sum()),
        "slips": int(slipped.sum()),
    }
    for score in (OURS, LEFT_OUT, RULE):
        if score in study.scores:
            row[f"{score}: right"] = int((study.called[score][mask] == slipped).sum())
            row[f"{score}: AUC"] = cell(measure_auc(study.scores[score][mask], slipped), 3)
    row["held lifts with macro slip"] = int((macro[~slipped] > 0.0).sum())
    return row


def _score_row(study: Study, name: str) -> dict[str, object]:
    row: dict[str, object] = {
        "score": name,
        "AUC": cell(measure_auc(study.scores[name], study.slipped), 3),
    }
    if (called := study.called.get(name)) is None:
        return row | dict.fromkeys(("right [%]", "slips missed", "holds called slips"))
    return row | {
        "right [%]": cell(100.0 * (called == study.slipped), 1),
        "slips missed": int((~called & study.slipped).sum()),
        "holds called slips": int((called & ~study.slipped).sum()),
    }


def _lift_row(study: Study, i: int) -> dict[str, object]:
    lift = study.lifts[i]
    return {
        "object": lift.label.object_,
        "lift": lift.label.lift,
        "label": "slipped" if lift.label.slipped else "held",
        "ours": lift.outcome.word,
        **{name: cell(score[i], 3) for name, score in study.scores.items()},
        "first slipped [frame]": first_called(lift.slipped),
    }


def _fit_row(study: Study, name: str) -> dict[str, object]:
    fit, own = study.fits[name], study.objects == name
    numbers = ("fallen", "fallen_spread", "kept", "kept_spread")
    return {
        "left out": name,
        **{number: cell(getattr(fit, number), 3) for number in numbers},
        "right": int((study.called[LEFT_OUT] == study.slipped)[own].sum()),
        "of": int(own.sum()),
    }


def plot(result: Study) -> Figure:
    """Left: ROC curves of all scores. Right: the probability of a slip for each lift, by object."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for name, score in result.scores.items():
        auc = measure_auc(score, result.slipped)
        left.plot(*draw_roc(score, result.slipped), label=f"{name}: {auc:.2f}", alpha=0.8)
    left.legend(fontsize=7, title="area", title_fontsize=7)
    left.set(xlabel="held lifts called slips [-]", ylabel="slips called slips [-]")
    probability = result.scores.get(LEFT_OUT, result.scores[OURS])
    for label, mask in (("slipped", result.slipped), ("held", ~result.slipped)):
        right.plot(
            probability[mask], result.objects[mask], "o" if label == "held" else "x", label=label
        )
    right.axvline(0.5, color="0.6", lw=0.8)
    right.set(xlabel="probability of a slip, fitted to the other objects [-]")
    right.legend(fontsize=8)
    finish(left, right)
    return figure
