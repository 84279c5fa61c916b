"""Softness of objects from recordings and references: `python -m calibration softness`."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from calibration.findings import write_findings
from calibration.softness.choices import ReferenceSettings
from calibration.softness.fit import SoftnessFit, fit_softness
from calibration.softness.layered import Grasp, fit_layered_softness
from calibration.softness.readings import Layer
from calibration.softness.references import (
    NO_REFERENCE,
    Reference,
    outline_reference,
    read_reference,
)
from calibration.softness.trials import make_trials
from calibration.softness.two_fingers import fit_two_fingers
from estimation.frames.files import write_whole
from estimation.frames.names import counted
from estimation.frames.noise import Noise
from estimation.frames.recording import Recording
from estimation.softness import LayeredSoftness, write_softness

POOLED = "all objects"


def gather_grasps(
    recordings: Sequence[Recording],
    references: Sequence[str],
    object_names: Sequence[str],
    settings: ReferenceSettings,
    noise: Noise | None,
) -> list[Grasp]:
    """Every recording with its reference and its object.

    Args:
        recordings: the recordings.
        references: a CSV for each recording, or `outline` once for all.
        object_names: name of the object in each recording, or one for all.
        settings: how the CSVs are read.
        noise: of the markers; estimated from each recording unless given.

    Raises:
        ValueError: numbers that do not match, or a reference that cannot be used.
        OSError: a CSV cannot be read.
    """
    if not references:
        raise ValueError(f"no --reference: {NO_REFERENCE}")
    each = list(references) * (len(recordings) if len(references) == 1 else 1)
    named = list(object_names or ["object"]) * (len(recordings) if len(object_names) <= 1 else 1)
    for what, found in (("references", each), ("objects", named)):
        if len(found) != len(recordings):
            raise ValueError(
                f"{len(found)} {what} for {len(recordings)} recordings: give one for each"
            )
    if len(recordings) > 1 and len(references) == 1 and references[0] != "outline":
        raise ValueError(f"one CSV for {len(recordings)} recordings: give one for each")
    return [
        Grasp(recording, _read(recording, source, settings), noise, name)
        for recording, source, name in zip(recordings, each, named, strict=True)
    ]


def _read(recording: Recording, source: str, settings: ReferenceSettings) -> Reference:
    if source == "outline":
        return outline_reference(recording)
    reference = read_reference(Path(source), zeroed=settings.zeroed, same_clock=settings.same_clock)
    return replace(reference, angle=-reference.angle) if settings.flip else reference


def fit_objects(
    grasps: Sequence[Grasp],
    model: str | None,
    clock_search: float,
    layer: Layer | None = None,
    track: Callable[[Iterable[Grasp]], Iterable[Grasp]] = iter,
) -> dict[str, SoftnessFit]:
    """Each object by itself, and all of them together where there are several.

    Args:
        grasps: of all objects.
        model: how L is taken, one of `LOAD_MODELS`; by BIC unless given.
        clock_search: how far two clocks may be apart at most [s].
        layer: the elastomer; a thick one unless given.
        track: shows how far the work is.

    Raises:
        ValueError: what the grasps hold cannot give k.
    """
    names = list(dict.fromkeys(grasp.object_name for grasp in grasps))
    groups = {name: [one for one in grasps if one.object_name == name] for name in names}
    if len(names) > 1:
        groups[POOLED] = list(grasps)
    if layer is not None:
        if not all(one.reference.zeroed and one.reference.same_clock for one in grasps):
            raise ValueError(
                "for an elastomer of finite thickness, or a ball, the references must be CSVs that "
                "count from the onset of contact on the recording's clock (--zeroed --same-clock); "
                "--thickness-mm inf --radius-mm inf takes elastomer and object as half-spaces"
            )
        if model not in (None, "none"):
            raise ValueError(
                f"an elastomer of finite thickness, or a ball, has no load term {model!r}: "
                "leave out --load"
            )
        return {
            name: fit_layered_softness(group, layer, clock_search=clock_search)
            for name, group in groups.items()
        }
    trials = {
        id(one): make_trials(
            one.recording, one.reference, object_name=one.object_name, noise=one.noise
        )
        for one in track(grasps)
    }
    return {
        name: fit_softness(
            [trial for one in group for trial in trials[id(one)]],
            model=model,
            clock_search=clock_search,
        )
        for name, group in groups.items()
    }


def write_fits(fits: Mapping[str, SoftnessFit], out: Path) -> list[str]:
    """Write `softness.toml`, one more file for each of several objects, a report and its figures.

    Returns:
        Lines for the terminal.

    Raises:
        OSError: a file cannot be written.
    """
    lists = {
        f"{name}: {what}": lines
        for name, fit in fits.items()
        for what, lines in (
            ("what the data cannot determine", fit.undetermined),
            ("notes", fit.notes),
        )
    }
    tables = {}
    for name, fit in fits.items():
        tables[f"{name}: grasps"] = _grasps(fit)
        tables[f"{name}: models of L"] = _candidates(fit)
    lines = [f"{name}: {_state(fit)}" for name, fit in fits.items()]
    write_findings(
        out,
        {f"{_file(name)}.png": (plot_fit(fit), f"{name}: {CAPTION}") for name, fit in fits.items()},
        title="Softness of objects",
        lead=[
            *lines,
            "An object of stiffness ratio k turns by (1 + k) φ − L/2 where the elastomer turns by "
            "φ and sticks to it (Eq. 13).",
        ],
        lists=lists,
        tables=tables,
    )
    summary = {name: summarise_fit(fit) for name, fit in fits.items()}
    write_whole(out / "softness.json", json.dumps(summary, indent=2, ensure_ascii=False) + "\n")
    main = POOLED if POOLED in fits else next(iter(fits))
    for name, fit in fits.items():
        file = "softness.toml" if name == main else f"{_file(name)}.toml"
        write_softness(fit.softness, out / file)
    said = [f"  {line}" for fit in fits.values() for line in (*fit.undetermined, *fit.notes)]
    return [*lines, *said]


CAPTION = (
    "Left: reference against the elastomer's rotation, zeros and loads subtracted, with the line "
    "of slope 1 + k. Middle: residuals of the line. Right: k of each grasp with its 95 % interval, "
    "and that of all grasps (band)."
)


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
        raise ValueError(f"two fingers require two recordings, got {len(recordings)}")
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
        {
            "two-fingers.png": (
                plot_fit(found.fit),
                "The softer finger's rotation over the other's.",
            )
        },
        title="Softness from two fingers",
        lead=lines,
        lists={"notes": found.fit.notes},
        tables={"grasps": _grasps(found.fit)},
    )
    write_softness(found.first, out / "first.toml")
    write_softness(found.second, out / "second.toml")
    return lines


def _state(fit: SoftnessFit) -> str:
    """The result in a line."""
    made, more = fit.softness, ""
    if isinstance(made, LayeredSoftness):
        radius = made.object_radius
        ball = "" if radius == float("inf") else f" of a ball of {radius:.4g} mm"
        more = f"{ball} on {made.thickness:.4g} mm, markers {made.depth:.4g} mm deep,"
    elif fit.model != "none":
        error = made.covariance[1][1] ** 0.5
        unit = "rad/N" if made.load_by_force else "rad"
        more = f", L = {made.load_term:.4f} ± {1.96 * error:.4f} {unit} ({fit.model})"
    return (
        f"k = {fit.stiffness_ratio:.4f} (95 %: {fit.low:.4f} to {fit.high:.4f}){more} from "
        f"{counted(len(fit.grasps), 'grasp', 'grasps')}"
    )


def summarise_fit(fit: SoftnessFit) -> dict[str, object]:
    """The figures of a fit, ready for JSON."""
    return {
        "stiffness_ratio": fit.stiffness_ratio,
        "low": fit.low,
        "high": fit.high,
        "load_model": fit.model,
        "load_term": getattr(fit.softness, "load_term", 0.0),
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
            "object": one.object_name,
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
