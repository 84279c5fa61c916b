"""Content of a report's player: curves over all frames, markers and pictures of some of them.

The content consists of plain values for JSON. `templates/player.js` plays it, and
`templates/draw.js` draws it.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from estimation.output.found import Run
from estimation.output.preview import TICKS_PER_SECOND, to_ticks
from estimation.output.record import KeptMarkers
from estimation.output.scene import (
    Field,
    json_numbers,
    page_colours,
    picture_url,
    points_down,
    show_markers,
    sticking_markers,
)

Values = Float[np.ndarray, " frames"]


def describe_play(run: Run, references: Mapping[str, Values]) -> dict[str, Any]:
    """The content of the player for a run.

    Args:
        run: run over a recording.
        references: other angles over the same frames, by label [rad].
    """
    main, count = run.main, len(run.main.time)
    step, most_frames = 1, 4000  # of more frames, every second, fourth, … is in the curves
    while count > step * most_frames:
        step *= 2  # the record stores markers of every second, fourth, … frame too
    rows = np.arange(0, count, step)
    alerts = run.grips.level or ("",) * count
    stored = [
        markers
        for markers in run.markers()
        if not markers.row % step and len(markers.turned) == len(run.reference)
    ]
    return {
        "colours": page_colours(),
        "time": json_numbers(to_ticks(main.time)[rows] / TICKS_PER_SECOND, 4),
        "frame": main.source_index[rows].tolist(),
        "states": _runs(str(main.state[row]) for row in rows),
        "reasons": _runs(main.reason[row] for row in rows),
        "alerts": _runs(str(alerts[row]) for row in rows),
        "curves": _describe_curves(run, references, rows),
        "scenes": _describe_scenes(run, stored, step),
    }


def _describe_curves(
    run: Run, references: Mapping[str, Values], rows: Int[np.ndarray, " rows"]
) -> list[dict[str, Any]]:
    """The curves from top to bottom, in the form that `drawCurve` takes."""
    main = run.main
    lines = [
        {
            "name": name,
            "values": json_numbers(np.degrees(values[rows])),
            "colour": "#8c510a" if name == "gel" else "#222222",
            "dash": [2, 2] if name == "gel" else [6, 3],
            "fit": name == "truth",
        }
        for name, values in references.items()
    ]
    if main.withdrawn is not None and main.withdrawn.rows.any():
        withdrawn = json_numbers(np.degrees(main.withdrawn.angle[rows]))
        shown = {"colour": "#4292c6", "dash": [2, 2], "fit": True}
        lines.append({"name": "withdrawn", "values": withdrawn, **shown})
    angle, low, high = (
        json_numbers(np.degrees(values[rows])) for values in (main.angle, main.low, main.high)
    )
    stick, contact = main.stick_markers[rows].tolist(), main.contact_markers[rows].tolist()
    touching = {"name": "in contact", "values": contact, "colour": "#737373", "fit": True}
    curves: list[dict[str, Any]] = [
        {"label": "angle [°]", "angle": angle, "low": low, "high": high, "lines": lines},
        {"label": "markers", "name": "stick", "angle": stick, "lines": [touching]},
    ]
    if np.isfinite(main.moment).any():
        curves.append({"label": "moment [N·mm]", "angle": json_numbers(main.moment[rows])})
    if np.isfinite(slipped := run.shears.slip_probability).any():
        shown = json_numbers(slipped[rows])
        curves.append({"label": "probability", "name": "of a slip", "angle": shown})
    if np.isfinite(run.shears.slip).any():
        slip, error = run.shears.slip[rows], run.shears.slip_error[rows]
        ends = {"low": json_numbers(slip - error), "high": json_numbers(slip + error)}
        curves.append({"label": f"slid [{run.unit}]", "angle": json_numbers(slip), **ends})
    return curves


def _describe_scenes(run: Run, stored: Sequence[KeptMarkers], step: int) -> list[dict[str, Any]]:
    """Evenly spread frames in the form that `drawMarkers` takes; frames with pictures, if any."""
    stored = [markers for markers in stored if markers.picture] or stored
    if not stored:
        return []
    first = _describe_scene(run, stored[0], step)
    most = 3e6  # largest total size of markers and pictures [bytes]
    count = int(min(max(most / len(str(first)), 2), len(stored)))
    chosen = np.unique(np.linspace(0, len(stored) - 1, count).astype(int))
    return [_describe_scene(run, stored[i], step) for i in chosen]


def _describe_scene(run: Run, markers: KeptMarkers, step: int) -> dict[str, Any]:
    """A frame with its picture, or with the field of its markers as the source sees it."""
    spots, size, picture = markers.spots, None, None  # no size: that of the picture
    if spots is None or markers.picture is None:
        field = Field.around(run.reference, points_down(run.convention))
        spots, size = field.place(markers.positions)[None], field.size
    else:
        picture = picture_url(markers.picture)
    shown = show_markers(spots, markers.valid, sticking_markers(run.main, markers), markers.contact)
    return {"row": markers.row // step, "size": size, "picture": picture, **shown}


def _runs(words: Iterable[str]) -> list[tuple[int, str]]:
    """The first frame of each run of equal words, and the word."""
    runs, first = [], 0
    for word, same in groupby(words):
        runs.append((first, word))
        first += len(list(same))
    return runs
