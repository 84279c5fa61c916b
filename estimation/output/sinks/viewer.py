"""Answers for Rerun's viewer: a recording on the disc, or a viewer that is open."""

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from estimation.frames.extras import require_extra
from estimation.frames.source import Source
from estimation.output.scene import (
    MARKER_COLOURS,
    STATE_COLOURS,
    keep_pictures,
    marker_signs,
    view_markers,
)
from estimation.output.sinks.outlet import Outlet
from estimation.pictures.still import Shown
from estimation.slip.alert import Level
from estimation.tracking.stream import Answer

APPLICATION = "contactmodel"
LEVEL_COLOURS = dict(
    zip(Level, ("#d4ecd0", "#fbeebf", "#f0b27a", "#f6cfc9", "#c9c9e8"), strict=True)
)


class Viewing:
    """What the viewer is shown of each answer.

    - `/view/picture`: the picture; `/view/markers`: its markers, by what they do; `/view/motion`:
      how far they have moved.
    - `/angle`: the angle and its interval [°]; `/margin`: the angle that remains before macro slip
      and its interval [°]; `/slip`: the probability of a slip; `/markers`: how many stick, and how
      many are in contact.
    - `/state` and `/alert`: their words; `/reason`: why there is no angle, or a warning about it.
    """

    def __init__(self, source: Source, method: str, stream: Any) -> None:
        """Make it.

        Args:
            source: of the frames.
            method: whose answers are shown.
            stream: of Rerun, that the answers go to.
        """
        self._source, self._method, self._stream = source, method, stream
        self._last: dict[str, str] = {}
        for path, names in {
            "angle": ("angle [°]", "low [°]", "high [°]"),
            "margin": ("margin [°]", "low [°]", "high [°]"),
            "slip": ("probability of a slip",),
            "markers": ("stick", "in contact"),
        }.items():
            self._name_lines(path, names)
        self._name_states("state", STATE_COLOURS)
        self._name_states("alert", LEVEL_COLOURS)

    def show(self, answer: Answer, shown: Shown | None) -> None:
        """Log an answer.

        Args:
            answer: to a frame.
            shown: its picture, where there is one.
        """
        import rerun as rr

        found, log = answer.estimates[self._method], self._stream.log
        self._stream.set_time("frame", sequence=answer.row)
        if np.isfinite(answer.frame.time):
            self._stream.set_time("time", duration=answer.frame.time)
        else:
            self._stream.disable_timeline("time")
        self._show_markers(answer, shown)
        margin = answer.margin
        for path, values in {
            "angle": np.degrees([found.angle, found.low, found.high]),
            "margin": np.degrees([margin.angle, margin.angle_low, margin.angle_high]),
            "slip": [answer.shear.slipped],
            "markers": [found.stick_markers, found.contact_markers],
        }.items():
            log(path, rr.Scalars(values))
        for path, word in {"state": found.state, "alert": answer.alert.level}.items():
            if self._is_new(path, str(word)):
                log(path, rr.StateChange(state=str(word)))
        if self._is_new("reason", found.reason):
            log("reason", rr.TextLog(found.reason or "answered"))

    def _show_markers(self, answer: Answer, shown: Shown | None) -> None:
        import rerun as rr

        frame, reference = answer.frame, answer.layout.reference
        found = answer.estimates[self._method]
        view = view_markers(self._source, frame.positions, reference, shown)
        now, rest = view.spots, view_markers(self._source, reference, reference, shown).spots
        if view.jpeg is not None:
            jpeg = rr.EncodedImage(contents=view.jpeg, media_type="image/jpeg")
            self._stream.log("view/picture", jpeg)
        seen = frame.valid & np.isfinite(now + rest).all(axis=(0, 2))
        colours = dict(zip("ox.", MARKER_COLOURS.values(), strict=True))
        kinds = [colours[sign] for sign in marker_signs(found.stick, found.contact)[seen]]
        colour = [int(f"{one[1:]}ff", 16) for one in kinds] * len(now)
        spots, before = now[:, seen].reshape(-1, 2), rest[:, seen].reshape(-1, 2)
        self._stream.log("view/markers", rr.Points2D(spots, colors=colour, radii=3.0))
        arrows = rr.Arrows2D(origins=before, vectors=spots - before, colors=colour)
        self._stream.log("view/motion", arrows)

    def _is_new(self, path: str, word: str) -> bool:
        """Whether a word is another one than that of the last answer."""
        before, self._last[path] = self._last.get(path), word
        return before != word

    def _name_lines(self, path: str, names: tuple[str, ...]) -> None:
        import rerun as rr

        colours = [[34, 34, 34], [150, 150, 150], [150, 150, 150]][: len(names)]
        self._stream.log(path, rr.SeriesLines(colors=colours, names=names), static=True)

    def _name_states(self, path: str, colours: Mapping[Any, str]) -> None:
        import rerun as rr

        values = [str(one) for one in colours]
        shades = [int(f"{one[1:]}ff", 16) for one in colours.values()]
        about = rr.StateConfiguration(values=values, labels=values, colors=shades)
        self._stream.log(path, about, static=True)


class ViewerFile:
    """The sink that writes a recording for Rerun's viewer."""

    def __init__(self, path: Path, source: Source, method: str, rows: int = 0) -> None:
        """Make the file, or go on with it.

        Args:
            path: of the file, `*.rrd`.
            source: of the frames.
            method: whose answers it has.
            rows: that are kept of a file that is there; 0 makes it anew.

        Raises:
            ImportError: the extra `view` is not installed.
            OSError: it cannot be written.
        """
        require_extra("view", f"writing {path}")
        self._path, self._source, self._method = path, source, method
        self._find_picture = keep_pictures(source)
        earlier = path.with_name(f".{path.name}")
        if rows and not earlier.is_file():
            path.rename(earlier)
        self._begin()
        if rows:
            self._stream.send_chunks(_read_chunks(earlier))
        earlier.unlink(missing_ok=True)

    def restart(self) -> None:
        """Begin the file anew."""
        self.close()
        self._begin()

    def _begin(self) -> None:
        self._path.open("wb").close()  # Rerun does not say why it cannot write
        self._stream = open_stream(self._path)
        self._stream.save(self._path, default_blueprint=lay_out())
        self._viewing = Viewing(self._source, self._method, self._stream)

    def put(self, answer: Answer) -> None:
        """Write an answer; it is on the disc a fifth of a second later."""
        self._viewing.show(answer, self._find_picture(answer.frame))

    def close(self) -> None:
        """Write what is not yet on the disc."""
        self._stream.flush()
        self._stream.disconnect()


class LiveViewer:
    """The sink that shows answers in a viewer while they come; it never waits for it."""

    def __init__(self, source: Source, method: str, connect: Callable[[Any], None]) -> None:
        """Begin.

        Args:
            source: of the frames.
            method: whose answers are shown.
            connect: connects a stream of Rerun to the viewer.
        """
        self._find_picture = keep_pictures(source)
        stream = open_stream()
        connect(stream)
        viewing, longest = Viewing(source, method, stream), 16
        self.outlet = Outlet[Any](lambda one: viewing.show(*one), stream.disconnect, longest)

    def put(self, answer: Answer) -> None:
        """Pass an answer on; returns at once."""
        self.outlet.send((answer, self._find_picture(answer.frame)))

    def restart(self) -> None:
        """Go on: answers that are given anew take the place of the earlier ones."""
        return


def open_stream(path: Path | None = None) -> Any:
    """A stream of Rerun.

    Args:
        path: of the file that it is written to, by which it is known again.
    """
    import rerun as rr

    own = None if path is None else uuid5(NAMESPACE_URL, path.resolve().as_uri())
    return rr.RecordingStream(APPLICATION, recording_id=own)


def spawn_viewer(stream: Any) -> None:
    """Open a viewer and connect to it.

    Raises:
        OSError: it does not start.
    """
    try:
        stream.spawn(default_blueprint=lay_out())
    except RuntimeError as error:
        raise OSError(f"Rerun's viewer does not start ({error}): try `rerun` by itself") from error


def connect_viewer(host: str, port: int, stream: Any) -> None:
    """Connect to a viewer that is open, or will be.

    Args:
        host: of the viewer.
        port: of the viewer; Rerun's own is 9876.
        stream: that is connected.
    """
    name = f"[{host}]" if ":" in host else host
    stream.connect_grpc(f"rerun+http://{name}:{port}/proxy", default_blueprint=lay_out())


def lay_out() -> Any:
    """How the viewer lays the answers out: the markers beside curves and states over time."""
    import rerun.blueprint as rrb

    lines = {
        "angle": "angle [°]",
        "margin": "margin before macro slip [°]",
        "slip": "probability of a slip",
        "markers": "markers",
    }
    curves = [rrb.TimeSeriesView(origin=path, name=name) for path, name in lines.items()]
    words = rrb.StateTimelineView(contents=["/state", "/alert"], name="state and alert")
    reasons = rrb.TextLogView(origin="reason", name="reason")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial2DView(origin="view", name="markers"),
            rrb.Vertical(*curves, words, reasons, row_shares=[3, 2, 2, 2, 2, 2]),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline="time", state="collapsed"),
    )


def _read_chunks(path: Path) -> Any:
    """What a file holds that was perhaps not closed, of which Rerun warns."""
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return RrdReader(path).stream()
