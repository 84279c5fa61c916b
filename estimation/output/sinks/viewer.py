"""Answers for Rerun's viewer: a file, or an open viewer."""

import os
import struct
import sysconfig
import warnings
from collections.abc import Callable, Iterable, Mapping
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
from estimation.slip.alert import AlertLevel
from estimation.tracking.stream import Answer


class Viewing:
    """Logs answers to Rerun.

    - `/view/picture`: the picture; `/view/markers`: its markers, coloured by state;
      `/view/motion`: their displacements.
    - `/angle`: the angle and its interval [°]; `/margin`: the angle that remains before macro slip
      and its interval [°]; `/slip`: the probability of a slip; `/markers`: numbers of markers that
      stick and of markers in contact.
    - `/state` and `/alert`: state and alert level; `/reason`: the reason for a missing or uncertain
      angle.
    """

    def __init__(self, source: Source, method: str, stream: Any) -> None:
        """Set up the curves and states."""
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
        colours = ("#d4ecd0", "#fbeebf", "#f0b27a", "#f6cfc9", "#c9c9e8")
        self._name_states("alert", dict(zip(AlertLevel, colours, strict=True)))

    def show(self, answer: Answer, shown: Shown | None) -> None:
        """Log an answer and, if there is one, the picture of its frame."""
        import rerun as rr

        estimate, log = answer.estimates[self._method], self._stream.log
        self._stream.set_time("frame", sequence=answer.row)
        if np.isfinite(answer.frame.time):
            self._stream.set_time("time", duration=answer.frame.time)
        else:
            self._stream.disable_timeline("time")
        self._show_markers(answer, shown)
        margin = answer.margin
        for path, values in {
            "angle": np.degrees([estimate.angle, estimate.low, estimate.high]),
            "margin": np.degrees([margin.angle, margin.angle_low, margin.angle_high]),
            "slip": [answer.shear.slip_probability],
            "markers": [estimate.stick_markers, estimate.contact_markers],
        }.items():
            log(path, rr.Scalars(values))
        for path, word in {"state": estimate.state, "alert": answer.alert.level}.items():
            if self._is_new(path, str(word)):
                log(path, rr.StateChange(state=str(word)))
        if self._is_new("reason", estimate.reason):
            log("reason", rr.TextLog(estimate.reason or "answered"))

    def _show_markers(self, answer: Answer, shown: Shown | None) -> None:
        import rerun as rr

        frame, reference = answer.frame, answer.layout.reference
        estimate = answer.estimates[self._method]
        view = view_markers(self._source, frame.positions, reference, shown)
        now, rest = view.spots, view_markers(self._source, reference, reference, shown).spots
        if view.jpeg is not None:
            jpeg = rr.EncodedImage(contents=view.jpeg, media_type="image/jpeg")
            self._stream.log("view/picture", jpeg)
        visible = frame.valid & np.isfinite(now + rest).all(axis=(0, 2))
        colours = dict(zip("ox.", MARKER_COLOURS.values(), strict=True))
        signs = marker_signs(estimate.stick, estimate.contact)[visible]
        colour = [int(f"{colours[sign][1:]}ff", 16) for sign in signs] * len(now)
        spots, before = now[:, visible].reshape(-1, 2), rest[:, visible].reshape(-1, 2)
        self._stream.log("view/markers", rr.Points2D(spots, colors=colour, radii=3.0))
        arrows = rr.Arrows2D(origins=before, vectors=spots - before, colors=colour)
        self._stream.log("view/motion", arrows)

    def _is_new(self, path: str, word: str) -> bool:
        """Whether a word differs from that of the last answer."""
        before, self._last[path] = self._last.get(path), word
        return before != word

    def _name_lines(self, path: str, names: tuple[str, ...]) -> None:
        import rerun as rr

        colours = [[34, 34, 34], [150, 150, 150], [150, 150, 150]][: len(names)]
        self._stream.log(path, rr.SeriesLines(colors=colours, names=names), static=True)

    def _name_states(self, path: str, colours: Mapping[Any, str]) -> None:
        import rerun as rr

        values = [str(state) for state in colours]
        shades = [int(f"{colour[1:]}ff", 16) for colour in colours.values()]
        about = rr.StateConfiguration(values=values, labels=values, colors=shades)
        self._stream.log(path, about, static=True)


class ViewerFile:
    """The sink that writes a file for Rerun's viewer."""

    def __init__(self, path: Path, source: Source, method: str, rows: int = 0) -> None:
        """Make a file `*.rrd`, or continue an existing one after so many rows.

        Raises:
            ImportError: the extra `view` is not installed.
            OSError: the file cannot be written.
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
        """Clear the file."""
        self.close()
        self._begin()

    def _begin(self) -> None:
        self._path.open("wb").close()  # raises the OSError that Rerun hides
        self._stream = open_stream(self._path)
        self._stream.save(self._path, default_blueprint=lay_out())
        self._viewing = Viewing(self._source, self._method, self._stream)

    def put(self, answer: Answer) -> None:
        """Write an answer; it is on the disc a fifth of a second later."""
        self._viewing.show(answer, self._find_picture(answer.frame))

    def close(self) -> None:
        """Write the remaining answers and close the file."""
        self._stream.flush()
        self._stream.disconnect()


class LiveViewer:
    """The sink that shows answers in a viewer as they come, without waiting for it."""

    def __init__(self, source: Source, method: str, connect: Callable[[Any], None]) -> None:
        """Connect to the viewer."""
        self._find_picture = keep_pictures(source)
        stream = open_stream()
        connect(stream)
        viewing, longest = Viewing(source, method, stream), 16
        self.outlet = Outlet[Any](lambda item: viewing.show(*item), stream.disconnect, longest)

    def put(self, answer: Answer) -> None:
        """Queue an answer and return at once."""
        self.outlet.send((answer, self._find_picture(answer.frame)))

    def restart(self) -> None:
        """Do nothing: answers that come again replace the earlier ones."""
        return


def open_stream(path: Path | None = None) -> Any:
    """A stream of Rerun: of the file that is written to a path, else of an open viewer."""
    import rerun as rr

    own = None if path is None else uuid5(NAMESPACE_URL, path.resolve().as_uri())
    return rr.RecordingStream("contactmodel", recording_id=own)


def spawn_viewer(stream: Any) -> None:
    """Open a viewer and connect to it.

    Raises:
        OSError: the viewer does not start.
    """
    # where pip installs the viewer, which is not on the PATH unless the environment is active
    scripts = sysconfig.get_path("scripts")
    os.environ["PATH"] = os.pathsep.join((os.environ.get("PATH", os.defpath), scripts))
    try:
        stream.spawn(default_blueprint=lay_out())
    except RuntimeError as error:
        raise OSError(f"Rerun's viewer does not start ({error}): try `rerun` by itself") from error


def connect_viewer(host: str, port: int, stream: Any) -> None:
    """Connect a stream to a viewer that is open or will be opened; Rerun's default port is 9876."""
    name = f"[{host}]" if ":" in host else host
    stream.connect_grpc(f"rerun+http://{name}:{port}/proxy", default_blueprint=lay_out())


def lay_out() -> Any:
    """The viewer's layout: markers on the left, curves and states over time on the right."""
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


def _read_chunks(path: Path) -> Iterable[Any]:
    """The content of a file; Rerun's warning that it was not closed is suppressed."""
    from rerun.chunk import RrdReader

    if not _drop_torn_message(path):
        return ()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return RrdReader(path).stream()


def _drop_torn_message(path: Path) -> bool:
    """Cut off a last message of which a kill left only a part; Rerun refuses files with one.

    Returns:
        Whether the file has messages.
    """
    before = 12  # length of the file's header, before its first message [bytes]
    header = struct.Struct("<QQ")  # kind and length of a message, before its content
    end = 0  # kind of the message that ends a closed file
    with path.open("r+b") as file:
        size, whole, kind = os.fstat(file.fileno()).st_size, before, None
        file.seek(whole)
        while kind != end and len(head := file.read(header.size)) == header.size:
            kind, length = header.unpack(head)
            if file.seek(length, os.SEEK_CUR) > size:
                break
            whole = file.tell()
        if kind != end:
            file.truncate(min(whole, size))
        return whole > before
