"""What a report plays: curves over the frames, and markers and pictures of some of them.

All of it is plain values, ready for JSON; `templates/player.js` shows it and `templates/draw.js`
draws it.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from estimation.output.found import Run
from estimation.output.preview import TICKS, to_ticks
from estimation.output.record import KeptMarkers
from estimation.output.scene import (
    Field,
    page_colours,
    picture_url,
    points_down,
    show_markers,
    show_numbers,
)

Values = Float[np.ndarray, " frames"]


def describe_play(
    run: Run,
    references: Mapping[str, Values],
    most_frames: int = 4000,
    most_bytes: float = 3e6,
) -> dict[str, Any]:
    """What the page plays of a run.

    Args:
        run: over a recording.
        references: other angles over the same frames, by label [rad].
        most_frames: frames that the curves have at most; of more every second, fourth, … is taken.
        most_bytes: size of markers and pictures, of which fewer frames have them then [bytes].
    """
    main, count = run.main, len(run.main.time)
    step = 1
    while count > step * most_frames:
        step *= 2  # as the record does, whose markers are of such frames
    rows = np.arange(0, count, step)
    alerts = run.grips.level or ("",) * count
    kept = [
        one for one in run.markers() if not one.row % step and len(one.turned) == len(run.reference)
    ]
    return {
        "colours": page_colours(),
        "time": show_numbers(to_ticks(main.time)[rows] / TICKS, 4),
        "frame": main.source_index[rows].tolist(),
        "states": _runs(str(main.state[row]) for row in rows),
        "reasons": _runs(main.reason[row] for row in rows),
        "alerts": _runs(str(alerts[row]) for row in rows),
        "curves": _describe_curves(run, references, rows),
        "scenes": _describe_scenes(run, kept, step, most_bytes),
    }


def _describe_curves(
    run: Run, references: Mapping[str, Values], rows: Int[np.ndarray, " rows"]
) -> list[dict[str, Any]]:
    """The curves from above, each as `drawCurve` takes it; what sticks is in the second one."""
    main = run.main
    lines = [
        {
            "name": name,
            "values": show_numbers(np.degrees(values[rows])),
            "colour": "#8c510a" if name == "gel" else "#222222",
            "dash": [2, 2] if name == "gel" else [6, 3],
            "fit": name == "truth",
        }
        for name, values in references.items()
    ]
    if main.withdrawn is not None and main.withdrawn.rows.any():
        gone = show_numbers(np.degrees(main.withdrawn.angle[rows]))
        shown = {"colour": "#4292c6", "dash": [2, 2], "fit": True}
        lines.append({"name": "withdrawn", "values": gone, **shown})
    angle, low, high = (
        show_numbers(np.degrees(values[rows])) for values in (main.angle, main.low, main.high)
    )
    stick, contact = main.stick_markers[rows].tolist(), main.contact_markers[rows].tolist()
    touching = {"name": "in contact", "values": contact, "colour": "#737373", "fit": True}
    curves: list[dict[str, Any]] = [
        {"label": "angle [°]", "angle": angle, "low": low, "high": high, "lines": lines},
        {"label": "markers", "name": "stick", "angle": stick, "lines": [touching]},
    ]
    if np.isfinite(main.moment).any():
        curves.append({"label": "moment [N·mm]", "angle": show_numbers(main.moment[rows])})
    if np.isfinite(slipped := run.shears.slipped).any():
        shown = show_numbers(slipped[rows])
        curves.append({"label": "probability", "name": "of a slip", "angle": shown})
    if np.isfinite(run.shears.slip).any():
        slip, error = run.shears.slip[rows], run.shears.slip_error[rows]
        ends = {"low": show_numbers(slip - error), "high": show_numbers(slip + error)}
        curves.append({"label": f"slid [{run.unit}]", "angle": show_numbers(slip), **ends})
    return curves


def _describe_scenes(
    run: Run, kept: Sequence[KeptMarkers], step: int, most_bytes: float
) -> list[dict[str, Any]]:
    """Some frames as `drawMarkers` takes them, evenly spread: those with a picture, if any."""
    kept = [one for one in kept if one.picture] or kept
    if not kept:
        return []
    first = _describe_scene(run, kept[0], step)
    each = len(str(first))
    count = int(min(max(most_bytes / each, 2), len(kept)))
    chosen = np.unique(np.linspace(0, len(kept) - 1, count).astype(int))
    return [_describe_scene(run, kept[i], step) for i in chosen]


def _describe_scene(run: Run, markers: KeptMarkers, step: int) -> dict[str, Any]:
    """A frame: its picture, or the field of its markers as the source sees it."""
    spots, size, picture = markers.spots, None, None  # that of the picture
    if spots is None or markers.picture is None:
        field = Field.around(run.reference, points_down(run.convention))
        spots, size = field.place(markers.positions)[None], field.size
    else:
        picture = picture_url(markers.picture)
    sticks = markers.stick & bool(run.main.stick_markers[markers.row])  # unless it was withdrawn
    shown = show_markers(spots, markers.valid, sticks, markers.contact)
    return {"row": markers.row // step, "size": size, "picture": picture, **shown}


def _runs(words: Iterable[str]) -> list[tuple[int, str]]:
    """From which frame on each word holds."""
    runs, first = [], 0
    for word, same in groupby(words):
        runs.append((first, word))
        first += len(list(same))
    return runs
