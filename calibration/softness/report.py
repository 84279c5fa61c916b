"""`python -m calibration softness`: fit objects to recordings and references; write a report."""

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
from estimation.frames.files import write_json
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
    """Pair each recording with its reference and its object.

    Args:
        recordings: recordings of grasps.
        references: a CSV for each recording, or `outline` once for all.
        object_names: name of the object in each recording, or one name for all.
        settings: options for reading the CSVs.
        noise: noise of the markers; None to estimate it from each recording.

    Raises:
        ValueError: the numbers of recordings, references and names do not match, or a reference
            cannot be used.
        OSError: a CSV cannot be read.
    """
    if not references:
        raise ValueError(f"no --reference: {NO_REFERENCE}")
    each = list(references) * (len(recordings) if len(references) == 1 else 1)
    named = list(object_names or ["object"]) * (len(recordings) if len(object_names) <= 1 else 1)
    for what, values in (("references", each), ("objects", named)):
        if len(values) != len(recordings):
            raise ValueError(
                f"{len(values)} {what} for {len(recordings)} recordings: give one for each"
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
    """Fit each object separately and, if there are several, all of them together.

    Args:
        grasps: grasps of all objects.
        model: model of L, one of `LOAD_MODELS`; None to choose it by BIC.
        clock_search: largest offset between two clocks [s].
        layer: the elastomer; None for a thick one.
        track: shows the progress.

    Returns:
        The fits by name of the object.

    Raises:
        ValueError: the grasps cannot determine k.
    """
    names = list(dict.fromkeys(grasp.object_name for grasp in grasps))
    groups = {name: [grasp for grasp in grasps if grasp.object_name == name] for name in names}
    if len(names) > 1:
        groups[POOLED] = list(grasps)
    if layer is not None:
        references = [grasp.reference for grasp in grasps]
        if not all(reference.zeroed and reference.same_clock for reference in references):
            raise ValueError(
                "an elastomer of finite thickness, markers below its surface, or an object's "
                "shape require CSVs whose angles count from the onset of contact on the "
                "recording's clock: use --zeroed --same-clock, or treat both bodies as half-spaces "
                "with --thickness-mm inf --depth-mm 0, without --radius-mm, --height-mm, --side-mm "
                "and --width-mm"
            )
        if model not in (None, "none"):
            raise ValueError(
                "an elastomer of finite thickness, markers below its surface, or an object's "
                f"shape have no load term {model!r}: leave out --load"
            )
        return {
            name: fit_layered_softness(group, layer, clock_search=clock_search)
            for name, group in groups.items()
        }
    trials = {
        id(grasp): make_trials(
            grasp.recording, grasp.reference, object_name=grasp.object_name, noise=grasp.noise
        )
        for grasp in track(grasps)
    }
    return {
        name: fit_softness(
            [trial for grasp in group for trial in trials[id(grasp)]],
            model=model,
            clock_search=clock_search,
        )
        for name, group in groups.items()
    }


def write_fits(fits: Mapping[str, SoftnessFit], out: Path) -> list[str]:
    """Write `softness.toml`, a file for each of several objects, a report and its figures.

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
            "Where the elastomer sticks to the object and turns by φ, an object of stiffness ratio "
            "k turns by (1 + k) φ − L/2 (Eq. 13).",
        ],
        lists=lists,
        tables=tables,
    )
    summary = {name: summarise_fit(fit) for name, fit in fits.items()}
    write_json(out / "softness.json", summary)
    main = POOLED if POOLED in fits else next(iter(fits))
    for name, fit in fits.items():
        file = "softness.toml" if name == main else f"{_file(name)}.toml"
        write_softness(fit.softness, out / file)
    remarks = [f"  {line}" for fit in fits.values() for line in (*fit.undetermined, *fit.notes)]
    return [*lines, *remarks]


CAPTION = (
    "Left: reference against the elastomer's rotation, without zeros and loads, and the fitted "
    "line of slope 1 + k. Crosses have no weight. Middle: residuals of the line; a trend means "
    "that the model does not fit. Right: k of each grasp with its 95 % interval, and k of all "
    "grasps (line and band)."
)


def write_two_fingers(
    recordings: Sequence[Recording],
    ratio: float,
    noise: Noise | None,
    clock_search: float,
    out: Path,
) -> list[str]:
    """Fit k from two fingers without a reference; write `first.toml`, `second.toml` and a report.

    Args:
        recordings: recordings of the first and of the second finger.
        ratio: k on the first finger over k on the second [-].
        noise: noise of the markers; None to estimate it from each recording.
        clock_search: largest offset between the fingers' clocks [s].
        out: folder to write to.

    Returns:
        Lines for the terminal.

    Raises:
        ValueError: there are not two recordings, or they cannot determine k.
        OSError: a file cannot be written.
    """
    if len(recordings) != 2:
        raise ValueError(f"two fingers require two recordings, got {len(recordings)}")
    no_reference = Reference(np.zeros(0), np.zeros(0), np.zeros(0), False, False, "none")
    first, second = (make_trials(finger, no_reference, noise=noise) for finger in recordings)
    if len(first) != len(second):
        raise ValueError(
            f"the fingers have {len(first)} and {len(second)} contacts; record both fingers at once"
        )
    fit = fit_two_fingers(first, second, ratio, clock_search)
    fitted = zip(recordings, (fit.first, fit.second), fit.low, fit.high, strict=True)
    lines = [
        f"k on {finger.name}: {softness.stiffness_ratio:.4f} (95 %: {low:.4f} to {high:.4f})"
        for finger, softness, low, high in fitted
    ]
    write_findings(
        out,
        {
            "two-fingers.png": (
                plot_fit(fit.fit),
                "Left: rotation of the softer finger against that of the stiffer finger, with the "
                "fitted line. Middle: its residuals. Right: slope of the line minus 1 for each "
                "grasp, with 95 % intervals.",
            )
        },
        title="Softness from two fingers",
        lead=lines,
        lists={"notes": fit.fit.notes},
        tables={"grasps": _grasps(fit.fit)},
    )
    write_softness(fit.first, out / "first.toml")
    write_softness(fit.second, out / "second.toml")
    return lines


def _state(fit: SoftnessFit) -> str:
    """One line with the result."""
    softness, more = fit.softness, ""
    if isinstance(softness, LayeredSoftness):
        shape = _describe_shape(softness)
        thick = softness.thickness == float("inf")
        elastomer = "a thick elastomer" if thick else f"an elastomer of {softness.thickness:.4g} mm"
        more = f"{shape} on {elastomer} with markers at {softness.depth:.4g} mm depth,"
    elif fit.model != "none":
        error = softness.covariance[1][1] ** 0.5
        unit = "rad/N" if softness.load_by_force else "rad"
        more = f", L = {softness.load_term:.4f} ± {1.96 * error:.4f} {unit} ({fit.model})"
    return (
        f"k = {fit.stiffness_ratio:.4f} (95 %: {fit.low:.4f} to {fit.high:.4f}){more} from "
        f"{counted(len(fit.grasps), 'grasp', 'grasps')}"
    )


def _describe_shape(softness: LayeredSoftness) -> str:
    """Words for the object's shape; none for a half-space."""
    _, _, *lengths, _ = softness.sizes
    words = "a round tip of radius", "a height of", "a side of radius", "an edge of radius"
    known = [
        f"{what} {length:.4g} mm"
        for what, length in zip(words, lengths, strict=True)
        if 0.0 < length < float("inf")
    ]
    return f" of an object with {' and '.join(known)}" if known else ""


def summarise_fit(fit: SoftnessFit) -> dict[str, object]:
    """Numbers of a fit for JSON."""
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
            "recording": grasp.name,
            "object": grasp.object_name,
            "k": round(grasp.stiffness_ratio, 4),
            "standard error": round(grasp.standard_error, 4),
            "L [rad]": None if np.isnan(grasp.load_term) else round(grasp.load_term, 5),
            "clock offset [s]": round(grasp.clock_offset, 4),
            "readings": grasp.points,
            "without weight": grasp.outliers,
            "frames left out": sum(grasp.excluded.values()),
        }
        for grasp in fit.grasps
    ]


def _candidates(fit: SoftnessFit) -> list[dict[str, object]]:
    best = min(candidate.bic for candidate in fit.candidates)
    return [
        {
            "L": candidate.model + (" (chosen)" if candidate.model == fit.model else ""),
            "parameters": candidate.parameters,
            "BIC above the best": round(candidate.bic - best, 1),
            "k": round(candidate.stiffness_ratio, 4),
            "standard error": round(candidate.standard_error, 4),
        }
        for candidate in fit.candidates
    ]


def plot_fit(fit: SoftnessFit) -> Figure:
    """Plot the line, its residuals, and k of each grasp."""
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    line = fit.line
    rotation = np.degrees(line.points.rotation)
    residual = np.degrees(line.residual)
    for i, grasp in enumerate(fit.grasps):
        own = line.points.trial == i
        outliers = own & (line.weight == 0)
        for axis, values in ((left, line.slope * rotation + residual), (middle, residual)):
            axis.plot(rotation[own], values[own], ".", ms=4, color=f"C{i % 10}", label=grasp.name)
            axis.plot(rotation[outliers], values[outliers], "x", ms=6, color="0.3")
    ends = np.array([rotation.min(), rotation.max()])
    left.plot(ends, line.slope * ends, "k-", lw=1, label=f"1 + k = {line.slope:.3f}")
    left.plot(ends, ends, "k:", lw=1, label="rigid object")
    left.set_ylabel("object's angle [°]")
    left.legend(fontsize=7, frameon=False)
    middle.axhline(0.0, color="k", lw=1)
    middle.set_ylabel("reference − line [°]")
    for axis in (left, middle):
        axis.set_xlabel("rotation φ of the elastomer [°]")
        axis.grid(alpha=0.3)
    names = [grasp.name for grasp in fit.grasps]
    right.axvspan(fit.low, fit.high, color="0.85")
    right.axvline(fit.stiffness_ratio, color="k", lw=1)
    right.errorbar(
        [grasp.stiffness_ratio for grasp in fit.grasps],
        range(len(names)),
        xerr=[1.96 * grasp.standard_error for grasp in fit.grasps],
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
    """A file name for an object."""
    return "".join(c if c.isalnum() or c in "-_" else "-" for c in name)
