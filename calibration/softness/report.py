"""Softness of objects from recordings and references: `python -m calibration softness`."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from calibration.findings import write_findings
from calibration.softness.fit import MOST_COVERED, SoftnessFit, fit_softness
from calibration.softness.layered import Grasp, LayeredFit, fit_layered_softness
from calibration.softness.references import (
    NO_REFERENCE,
    Reference,
    outline_reference,
    read_reference,
)
from calibration.softness.trials import Trial, make_trials
from calibration.softness.two_fingers import fit_two_fingers
from estimation.files import write_whole
from estimation.noise import Noise, estimate_noise
from estimation.recording import Recording
from estimation.report import figure_png, render_page
from estimation.softness import write_softness

POOLED = "all objects"


class ReferenceSettings(NamedTuple):
    """How references are read.

    Attributes:
        flip: whether their sign is to be turned.
        zeroed: whether they count from the onset of contact.
        same_clock: whether their clock is the recording's.
    """

    flip: bool = False
    zeroed: bool = False
    same_clock: bool = False


def gather_trials(
    recordings: Sequence[Recording],
    references: Sequence[str],
    things: Sequence[str],
    settings: ReferenceSettings,
    noise: Noise | None,
    track: Iterable[Recording] | None = None,
) -> list[Trial]:
    """The trials of all recordings.

    Args:
        recordings: the recordings.
        references: a CSV for each recording, or `outline` once for all.
        things: name of the object in each recording, or one for all.
        settings: how the CSVs are read.
        noise: of the markers; estimated from each recording unless given.
        track: the recordings again, by what shows how far the work is.

    Raises:
        ValueError: numbers that do not match, or a recording or reference that cannot be used.
        OSError: a CSV cannot be read.
    """
    if not references:
        raise ValueError(f"no --reference: {NO_REFERENCE}")
    each = list(references) * (len(recordings) if len(references) == 1 else 1)
    named = list(things or ["object"]) * (len(recordings) if len(things) <= 1 else 1)
    for what, found in (("references", each), ("objects", named)):
        if len(found) != len(recordings):
            raise ValueError(
                f"{len(found)} {what} for {len(recordings)} recordings: give one for each"
            )
    if len(recordings) > 1 and len(references) == 1 and references[0] != "outline":
        raise ValueError(f"one CSV for {len(recordings)} recordings: give one for each")
    trials = []
    for recording, source, thing in zip(track or recordings, each, named, strict=True):
        reference = _read(recording, source, settings)
        trials += make_trials(recording, reference, thing=thing, noise=noise)
    return trials


def _read(recording: Recording, source: str, settings: ReferenceSettings) -> Reference:
    if source == "outline":
        return outline_reference(recording)
    reference = read_reference(Path(source), zeroed=settings.zeroed, same_clock=settings.same_clock)
    return replace(reference, angle=-reference.angle) if settings.flip else reference


def fit_objects(
    trials: Sequence[Trial], model: str | None, clock_search: float
) -> dict[str, SoftnessFit]:
    """Each object by itself, and all of them together where there are several.

    Raises:
        ValueError: what the trials hold cannot give k.
    """
    things = list(dict.fromkeys(trial.thing for trial in trials))
    fits = {
        thing: fit_softness(
            [trial for trial in trials if trial.thing == thing],
            model=model,
            clock_search=clock_search,
        )
        for thing in things
    }
    if len(things) > 1:
        fits[POOLED] = fit_softness(trials, model=model, clock_search=clock_search)
    return fits


def write_fits(fits: Mapping[str, SoftnessFit], out: Path) -> list[str]:
    """Write `softness.toml`, one more file for each of several objects, a report and its figures.

    Returns:
        Lines for the terminal.

    Raises:
        OSError: a file cannot be written.
    """
    pictures = {f"{_file(name)}.png": figure_png(plot_fit(fit)) for name, fit in fits.items()}
    captions = {
        f"{_file(name)}.png": f"{name}: left, reference over the elastomer's rotation, zeros and "
        "loads taken off, with the line 1 + k; middle, what the line leaves; right, k of each "
        "grasp by itself with its 95 % interval, and that of all (band)."
        for name in fits
    }
    lists = {
        f"{name}: {what}": lines
        for name, fit in fits.items()
        for what, lines in (("what the data cannot tell", fit.undetermined), ("notes", fit.notes))
    }
    tables = {}
    for name, fit in fits.items():
        tables[f"{name}: grasps"] = _grasps(fit)
        tables[f"{name}: ways to take L"] = _candidates(fit)
    lines = [f"{name}: {_state(fit)}" for name, fit in fits.items()]
    page = render_page(
        "findings.html",
        pictures,
        title="Softness of objects",
        lead=[
            *lines,
            "An object of stiffness ratio k turns by (1 + k) φ − L/2 where the elastomer turns by "
            "φ and sticks to it (Eq. 13).",
        ],
        lists=lists,
        captions=captions,
        tables=tables,
    )
    summary = {name: summarise_fit(fit) for name, fit in fits.items()}
    for name, image in pictures.items():
        write_whole(out / name, image)
    write_whole(out / "report.html", page)
    write_whole(out / "softness.json", json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    main = POOLED if POOLED in fits else next(iter(fits))
    for name, fit in fits.items():
        file = "softness.toml" if name == main else f"{_file(name)}.toml"
        write_softness(fit.softness, out / file)
    said = [f"  {line}" for fit in fits.values() for line in (*fit.undetermined, *fit.notes)]
    return [*lines, *said]


def write_two_fingers(
    recordings: Sequence[Recording],
    ratio: float,
    noise: Noise | None,
    clock_search: float,
    out: Path,
) -> list[str]:
    """Write `first.toml` and `second.toml`, and a report, from two fingers without a reference.

    Returns:
        Lines for the terminal.

    Raises:
        ValueError: not two recordings, or nothing that tells k.
        OSError: a file cannot be written.
    """
    if len(recordings) != 2:
        raise ValueError(f"two fingers are two recordings, not {len(recordings)}")
    none = Reference(np.zeros(0), np.zeros(0), np.zeros(0), False, False, "none")
    first, second = (make_trials(one, none, noise=noise) for one in recordings)
    if len(first) != len(second):
        raise ValueError(f"{len(first)} and {len(second)} contacts: record both fingers at once")
    found = fit_two_fingers(first, second, ratio, clock_search)
    lines = [
        f"k on {one.name}: {made.stiffness_ratio:.4f} (95 %: {low:.4f} to {high:.4f})"
        for one, made, low, high in zip(
            recordings, (found.first, found.second), found.low, found.high, strict=True
        )
    ]
    write_findings(
        out,
        "two-fingers.png",
        plot_fit(found.fit),
        title="Softness from two fingers",
        lead=lines,
        caption="The softer finger's rotation over the other's.",
        lists={"notes": found.fit.notes},
        tables={"grasps": _grasps(found.fit)},
    )
    write_softness(found.first, out / "first.toml")
    write_softness(found.second, out / "second.toml")
    return lines


def write_layered(
    recordings: Sequence[Recording],
    references: Sequence[str],
    settings: ReferenceSettings,
    noise: Noise | None,
    layer: tuple[float, float],
    out: Path,
) -> list[str]:
    """Write `softness.toml` of an elastomer of known thickness, and a report.

    Args:
        recordings: grasps of one object, each from the unloaded state on.
        references: a CSV for each.
        settings: how they are read; they count from the onset of contact on the recording's clock.
        noise: of the markers; estimated from each recording unless given.
        layer: thickness of the elastomer and depth of its markers [mm].
        out: folder to write to.

    Returns:
        Lines for the terminal.

    Raises:
        ValueError: references that do not fit, or nothing that tells k.
        OSError: a file cannot be read or written.
    """
    if not references:
        raise ValueError(f"no --reference: {NO_REFERENCE}")
    if not (settings.same_clock and settings.zeroed):
        raise ValueError(
            "on an elastomer of finite thickness frames are fitted one by one: the references must "
            "count from the onset of contact on the recording's clock (--zeroed --same-clock)"
        )
    if len(references) != len(recordings):
        raise ValueError(f"{len(references)} references for {len(recordings)} recordings")
    grasps, errors, notes = [], [], []
    for recording, source in zip(recordings, references, strict=True):
        found = _read(recording, source, settings)
        if not (found.same_clock and found.zeroed):
            raise ValueError(f"{found.source} has a zero of its own: give a CSV")
        angle = np.interp(recording.time, found.time, found.angle, left=np.nan, right=np.nan)
        if not np.isfinite(angle).any():
            raise ValueError(
                f"{recording.name}: the reference runs from {found.time[0]:.2f} to "
                f"{found.time[-1]:.2f} s, the recording from {recording.time[0]:.2f} to "
                f"{recording.time[-1]:.2f} s: record both over the same time, on one clock"
            )
        known = np.isfinite(angle)
        if known.mean() < MOST_COVERED:
            notes.append(
                f"{recording.name}: the reference covers {known.sum()} of {len(known)} frames"
            )
        grasps.append(Grasp(recording, angle, noise or estimate_noise(recording)))
        errors.append(found.error)
    known = np.concatenate(errors)
    known = known[np.isfinite(known)]
    error = {"reference_error": float(np.median(known))} if len(known) else {}
    thickness, depth = layer
    fit = fit_layered_softness(grasps, (thickness, 0.0), (depth, 0.0), **error)
    lines = [
        f"k = {fit.softness.stiffness_ratio:.4f} (95 %: {fit.low[0]:.4f} to {fit.high[0]:.4f}) on "
        f"{thickness:g} mm, markers {depth:g} mm deep, from {len(fit.residual)} frames of "
        f"{len(grasps)} grasps"
    ]
    if fit.slipping:
        notes.append(f"left out: {fit.slipping} frames in macro slip, the gel standing still")
    write_findings(
        out,
        "layered.png",
        plot_layered(fit),
        title="Softness of an object on a thin elastomer",
        lead=lines,
        caption="What the fit leaves of the object's angle, frame by frame.",
        lists={"notes": notes},
    )
    write_softness(fit.softness, out / "softness.toml")
    return [*lines, *notes]


def plot_layered(fit: LayeredFit) -> Figure:
    """What is left of the object's angle."""
    figure, axis = plt.subplots(figsize=(6, 3.5), layout="constrained")
    axis.plot(np.degrees(fit.reference), np.degrees(fit.residual), ".")
    axis.axhline(0.0, color="k", lw=1)
    axis.set_xlabel("object's angle [°]")
    axis.set_ylabel("corrected − object's angle [°]")
    axis.grid(alpha=0.3)
    return figure


def _state(fit: SoftnessFit) -> str:
    """The result in a line."""
    load = ""
    if fit.model != "none":
        error = fit.softness.covariance[1][1] ** 0.5
        unit = "rad/N" if fit.softness.load_by_force else "rad"
        load = f", L = {fit.softness.load_term:.4f} ± {1.96 * error:.4f} {unit} ({fit.model})"
    return (
        f"k = {fit.stiffness_ratio:.4f} (95 %: {fit.low:.4f} to {fit.high:.4f}){load} from "
        f"{len(fit.grasps)} grasps"
    )


def summarise_fit(fit: SoftnessFit) -> dict[str, object]:
    """The figures of a fit, ready for JSON."""
    return {
        "stiffness_ratio": fit.stiffness_ratio,
        "low": fit.low,
        "high": fit.high,
        "load_model": fit.model,
        "load_term": fit.softness.load_term,
        "covariance": [list(row) for row in fit.softness.covariance],
        "scatter_between_grasps": fit.scatter,
        "residual_deg": float(np.degrees(1.4826 * np.median(np.abs(fit.line.residual)))),
        "grasps": _grasps(fit),
        "candidates": _candidates(fit),
        "undetermined": list(fit.undetermined),
        "notes": list(fit.notes),
    }


def _grasps(fit: SoftnessFit) -> list[dict[str, object]]:
    return [
        {
            "recording": one.name,
            "object": one.thing,
            "k": round(one.stiffness_ratio, 4),
            "standard error": round(one.standard_error, 4),
            "L [rad]": None if np.isnan(one.load_term) else round(one.load_term, 5),
            "clock offset [s]": round(one.clock_offset, 4),
            "readings": one.points,
            "without weight": one.outliers,
            "frames left out": sum(one.excluded.values()),
        }
        for one in fit.grasps
    ]


def _candidates(fit: SoftnessFit) -> list[dict[str, object]]:
    best = min(one.bic for one in fit.candidates)
    return [
        {
            "L": one.model + (" (chosen)" if one.model == fit.model else ""),
            "parameters": one.parameters,
            "BIC above the best": round(one.bic - best, 1),
            "k": round(one.stiffness_ratio, 4),
            "standard error": round(one.standard_error, 4),
        }
        for one in fit.candidates
    ]


def plot_fit(fit: SoftnessFit) -> Figure:
    """The line, what it leaves, and k of each grasp."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    line = fit.line
    rotation = np.degrees(line.points.rotation)
    residual = np.degrees(line.residual)
    for i, one in enumerate(fit.grasps):
        mine = line.points.trial == i
        out = mine & (line.weight == 0)
        for axis, values in ((left, line.slope * rotation + residual), (middle, residual)):
            axis.plot(rotation[mine], values[mine], ".", ms=4, color=f"C{i % 10}", label=one.name)
            axis.plot(rotation[out], values[out], "x", ms=6, color="0.3")
    ends = np.array([rotation.min(), rotation.max()])
    left.plot(ends, line.slope * ends, "k-", lw=1, label=f"1 + k = {line.slope:.3f}")
    left.plot(ends, ends, "k:", lw=1, label="a rigid object")
    left.set_ylabel("object's angle [°]")
    left.legend(fontsize=7, frameon=False)
    middle.axhline(0.0, color="k", lw=1)
    middle.set_ylabel("reference − line [°]")
    for axis in (left, middle):
        axis.set_xlabel("rotation φ of the elastomer [°]")
        axis.grid(alpha=0.3)
    names = [one.name for one in fit.grasps]
    right.axvspan(fit.low, fit.high, color="0.85")
    right.axvline(fit.stiffness_ratio, color="k", lw=1)
    right.errorbar(
        [one.stiffness_ratio for one in fit.grasps],
        range(len(names)),
        xerr=[1.96 * one.standard_error for one in fit.grasps],
        fmt="o",
        ms=4,
        color="#08306b",
    )
    right.set_yticks(range(len(names)), names, fontsize=7)
    right.set_ylim(len(names) - 0.5, -0.5)
    right.set_xlabel("k")
    right.grid(alpha=0.3, axis="x")
    return figure


def _file(name: str) -> str:
    """A name for a file."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)
