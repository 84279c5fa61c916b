"""The record of a run: a database that grows with every frame and is intact at any time.

`record.sqlite` has four tables. `frames` has a row for each frame, with every quantity that a
`Record` declares by method (`tracked.angle`, …; rad, mm, s). `markers` holds the markers of some
frames, with small copies of their pictures. `about` holds facts about the run as JSON. `checkpoint`
holds the state from which the run resumes. A run's tables, summary and report are made from it.
"""

import json
import sqlite3
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from estimation.estimators.result import Flag, Label, Number, Record, State, Text, Track, Whole
from estimation.frames.files import expect_present
from estimation.pictures.reading import PictureSource
from estimation.slip.alert import AlertLevel, GripPath
from estimation.slip.disc import Disc
from estimation.slip.margin import Margin, MarginPath
from estimation.slip.onset import SightPath
from estimation.slip.shear import ShearPath
from estimation.tracking.stream import Answer

RECORD_NAME = "record.sqlite"
"""Name of the record in a run's folder."""
FORMAT_VERSION = 3
"""Version of the format that is written and read."""
_SHEAR_COLUMNS: dict[str, str] = dict.fromkeys(
    ("shear", "hold", "slipped", "slip", "slip_error", "slip_since"), "REAL"
)
"""Columns of the fields of `ShearPath`, in their order; the format keeps these names."""
_MARKER_TYPES = {"positions": "f4", "turned": "f4", "valid": "?", "stick": "?", "contact": "?"}
"""Columns of the stored markers, with the types of their values."""


class KeptMarkers(NamedTuple):
    """The stored markers of a frame.

    Attributes:
        row: row of the frame.
        positions: positions of the markers [mm].
        turned: φ of each marker since the frame that the angle counts from [rad].
        valid: markers that can be used.
        stick: markers that stick.
        contact: markers of the contact region.
        picture: small copy of the frame's picture, a JPEG; None if none is stored.
        spots: positions of the markers in each view of that picture [px].
    """

    row: int
    positions: Float[np.ndarray, "n d"]
    turned: Float[np.ndarray, " n"]
    valid: Bool[np.ndarray, " n"]
    stick: Bool[np.ndarray, " n"]
    contact: Bool[np.ndarray, " n"]
    picture: bytes | None = None
    spots: Float[np.ndarray, "views n 2"] | None = None


class RecordWriter:
    """The sink that stores the answer of each frame.

    Attributes:
        most_kept: largest number of evenly spread frames whose markers are stored, unless all are.
        patience_s: longest time that the end of a run waits for a report that reads its record [s].

    Examples:
        >>> from contextlib import closing
        >>> from pathlib import Path
        >>> from estimation import RecordWriter, Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> settings = Settings()
        >>> with closing(RecordWriter(Path("record.sqlite"), tuple(settings.methods))) as record:
        ...     for answer in Stream(recording, settings).answers(record):
        ...         pass  # stored, and on the disc within half a second
        >>> print(answer.row + 1, "frames")
        43 frames
    """

    most_kept, patience_s = 256, 60.0

    def __init__(
        self,
        path: str | Path,
        methods: tuple[str, ...],
        every_marker: bool = False,
        pictures: PictureSource | None = None,
    ) -> None:
        """Open a record, or make a new one.

        Args:
            path: path of the database.
            methods: methods whose answers are stored, the chosen one first.
            every_marker: store the markers of every frame.
            pictures: source of the pictures; small copies of some are stored with their markers.

        Raises:
            OSError: the record cannot be written.
            ValueError: the file is not a record.
        """
        self._path, self._methods, self._every = Path(path), methods, every_marker
        self._pictures = pictures
        self._stride, self._written = 1, -np.inf
        columns = _columns(methods)
        with _opening(self._path) as self._database:
            run = self._database.execute
            run("PRAGMA page_size=16384")  # checkpoints of megabytes are slow in small ones
            run("PRAGMA journal_mode=WAL")
            run("PRAGMA synchronous=NORMAL")
            named = ", ".join(f'"{name}" {kind}' for name, kind in columns.items())
            run(f"CREATE TABLE IF NOT EXISTS frames ({named})")
            blobs = ", ".join(f"{name} BLOB" for name in (*_MARKER_TYPES, "picture", "spots"))
            run(f"CREATE TABLE IF NOT EXISTS markers (row INTEGER PRIMARY KEY, {blobs})")
            run("CREATE TABLE IF NOT EXISTS about (name TEXT PRIMARY KEY, content TEXT)")
            run("CREATE TABLE IF NOT EXISTS checkpoint (row INTEGER, state BLOB)")
            run("INSERT OR REPLACE INTO about VALUES ('format_version', ?)", (FORMAT_VERSION,))
            self._database.commit()
        self._insert = f"INSERT INTO frames VALUES ({', '.join('?' * len(columns))})"

    def put(self, answer: Answer) -> None:
        """Store the answer of a frame; it is on the disc within half a second."""
        with _naming_file(self._path):
            self._database.execute(self._insert, self._values(answer))
            if self._every or answer.row % self._stride == 0:
                self._keep_markers(answer)
            if self.needs_commit:
                self.commit()

    @property
    def needs_commit(self) -> bool:
        """Whether the stored answers should be written to the disc."""
        commit_s = 0.5  # time after which answers are written with the next frame [s]
        return time.monotonic() > self._written + commit_s

    def commit(self) -> None:
        """Write the stored answers to the disc."""
        with _naming_file(self._path):
            self._database.commit()
        expect_present(self._path)  # else it would be written in vain to the end
        self._written = time.monotonic()

    def restart(self) -> None:
        """Delete all frames."""
        self.truncate(0)

    def truncate(self, rows: int) -> None:
        """Delete all frames but the first `rows`."""
        with _naming_file(self._path):
            for table in ("frames", "markers", "checkpoint"):
                self._database.execute(f"DELETE FROM {table} WHERE row >= ?", (rows,))

    def set_metadata(self, **about: Any) -> None:
        """Store facts about the run, such as settings and input, as JSON by name."""
        rows = [(name, json.dumps(value, ensure_ascii=False)) for name, value in about.items()]
        with _naming_file(self._path):
            self._database.executemany("INSERT OR REPLACE INTO about VALUES (?, ?)", rows)

    def keep_checkpoint(self, row: int, state: bytes) -> None:
        """Store the state from which a run resumes after a row."""
        with _naming_file(self._path):
            self._database.execute("DELETE FROM checkpoint")
            self._database.execute("INSERT INTO checkpoint VALUES (?, ?)", (row, state))

    def close(self) -> None:
        """Write all answers and close the record."""
        with _naming_file(self._path):
            self._database.commit()
            self._end_log()
            self._database.close()

    def _end_log(self) -> None:
        """Merge the log into the database once no program reads it, or patience ends."""
        patience = time.monotonic() + self.patience_s
        while True:
            try:
                self._database.execute("PRAGMA journal_mode=DELETE")
            except sqlite3.OperationalError:  # raised at once: SQLite does not wait here
                if time.monotonic() > patience or not self._path.exists():
                    return  # the reader merges it
                time.sleep(0.1)
            else:
                return

    def _values(self, answer: Answer) -> list[Any]:
        values: list[Any] = [answer.row]
        for method in self._methods:
            estimate = answer.estimates[method]
            values += [_plain(getattr(estimate, name)) for name in Record.columns()]
        disc = answer.sight.disc or Disc()
        others = (answer.axis, answer.frame.imprint[0], int(answer.sight.rests))
        shear = [getattr(answer.shear, name) for name in ShearPath._fields]
        grip = (*answer.friction, *answer.alert[1:], answer.alert.level)
        return [*values, *map(_plain, (*others, *disc, *answer.margin, *shear, *grip))]

    def _keep_markers(self, answer: Answer) -> None:
        main, frame = answer.estimates[self._methods[0]], answer.frame
        arrays = (frame.positions, answer.turned, frame.valid, main.stick, main.contact)
        blobs = [
            np.ascontiguousarray(values, dtype=kind).tobytes()
            for values, kind in zip(arrays, _MARKER_TYPES.values(), strict=True)
        ]
        picture = spots = None
        if self._pictures is not None:
            picture, spots = self._pictures.find_copy(frame)
        spots = None if spots is None else spots.astype("f4").tobytes()
        values = [answer.row, *blobs, picture, spots]
        marks = ", ".join("?" * len(values))
        self._database.execute(f"INSERT INTO markers VALUES ({marks})", values)
        if not self._every and answer.row // self._stride >= self.most_kept:
            self._stride *= 2
            self._database.execute("DELETE FROM markers WHERE row % ?", (self._stride,))


class RecordReader:
    """Reads a record.

    Attributes:
        about: facts about the run, such as settings and input, by name.

    Examples:
        >>> from contextlib import closing
        >>> from pathlib import Path
        >>> from estimation import RecordReader, RecordWriter, Settings, Stream, simulate_pivot
        >>> recording, _ = simulate_pivot(angles_deg=(0.0, 10.0), frames=(20,))
        >>> settings = Settings()
        >>> with closing(RecordWriter(Path("record.sqlite"), tuple(settings.methods))) as record:
        ...     rows = len(list(Stream(recording, settings).answers(record)))
        >>> with RecordReader(Path("record.sqlite")) as reader:
        ...     print(f"{reader.track('paper').answered.sum()} of {rows} frames have an angle")
        33 of 43 frames have an angle
    """

    def __init__(self, path: str | Path) -> None:
        """Open a record.

        Raises:
            FileNotFoundError: the record does not exist.
            ValueError: the file is not a record, or one of another version.
            OSError: the record cannot be read.
        """
        self.path = Path(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"{path} does not exist: give the output folder of a run")
        with _opening(self.path) as self._database:
            self._database.execute("BEGIN")  # frames that a run adds from here on stay unseen
            rows = self._database.execute("SELECT name, content FROM about").fetchall()
            self.about: dict[str, Any] = {name: json.loads(content) for name, content in rows}
            if (version := self.about.get("format_version")) != FORMAT_VERSION:
                raise ValueError(
                    f"{path} has format {version}, but this version reads {FORMAT_VERSION}: remove "
                    "it and run again, or make its report with the version that wrote it"
                )

    def __enter__(self) -> "RecordReader":
        """Itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close it."""
        self._database.close()

    def __len__(self) -> int:
        """Number of frames."""
        return self._database.execute("SELECT COUNT(*) FROM frames").fetchone()[0]

    def track(self, method: str) -> Track:
        """The answers of one method.

        Raises:
            ValueError: the record is damaged.
        """
        kinds = _kinds()
        arrays = self._arrays({f"{method}.{name}": kind for name, kind in kinds.items()})
        values: dict[str, Any] = dict(zip(kinds, arrays, strict=True))
        values["state"] = tuple(map(State, values["state"]))
        return Track(method=method, **values)

    def column(self, name: str) -> Float[np.ndarray, " frames"]:
        """A quantity other than the methods' answers: `axis` or `imprint` [rad]."""
        return self._arrays({name: "REAL"})[0]

    def sights(self) -> SightPath:
        """Observations of the slip watch, by frame."""
        kinds = {f"disc_{name}": "REAL" for name in Disc._fields} | {"rests": "BOOLEAN"}
        return SightPath(*self._arrays(kinds))

    def margins(self) -> MarginPath:
        """Margins before macro slip, by frame; without the last branch."""
        return MarginPath(*self._arrays(dict.fromkeys(Margin._fields, "REAL")), last=None)

    def shears(self) -> ShearPath:
        """Shear of the gel and slip of the object along it, by frame."""
        return ShearPath(*self._arrays(_SHEAR_COLUMNS))

    def grips(self) -> GripPath:
        """Friction and alerts, by frame."""
        *numbers, levels = self._arrays(dict.fromkeys(GripPath._fields, "REAL") | {"level": "TEXT"})
        return GripPath(*numbers, level=tuple(map(AlertLevel, levels)))

    def markers(self) -> Iterator[KeptMarkers]:
        """The stored markers, frame by frame."""
        with _naming_file(self.path):
            cursor = self._database.execute("SELECT * FROM markers ORDER BY row")
            for row, *blobs, picture, spots in cursor:
                positions, turned, valid, stick, contact = (
                    np.frombuffer(blob, dtype=kind)
                    for blob, kind in zip(blobs, _MARKER_TYPES.values(), strict=True)
                )
                count = len(turned)
                if spots is not None:
                    spots = np.frombuffer(spots, dtype="f4").reshape(-1, count, 2)
                positions = positions.reshape(count, -1)
                yield KeptMarkers(row, positions, turned, valid, stick, contact, picture, spots)

    def checkpoint(self) -> tuple[int, bytes]:
        """Number of finished rows and the state after them; 0 and empty without a checkpoint."""
        with _naming_file(self.path):
            row = self._database.execute("SELECT row, state FROM checkpoint").fetchone()
        return (0, b"") if row is None else (row[0] + 1, row[1])

    def _arrays(self, kinds: dict[str, str]) -> list[Any]:
        """Columns over all frames: arrays, or tuples of texts."""
        chunk = 10_000  # frames to read at a time
        words: dict[str, str] = {}
        parts: list[list[Any]] = [[] for _ in kinds]
        types = {"REAL": float, "INTEGER": int, "BOOLEAN": bool}
        with _naming_file(self.path):
            names = ", ".join(f'"{name}"' for name in kinds)
            cursor = self._database.execute(f"SELECT {names} FROM frames ORDER BY row")
            while rows := cursor.fetchmany(chunk):
                for part, values, kind in zip(
                    parts, zip(*rows, strict=True), kinds.values(), strict=True
                ):
                    if kind == "TEXT":
                        part += [words.setdefault(value, value) for value in values]
                    else:
                        part.append(np.array(values, dtype=types[kind]))
        return [
            tuple(part) if kind == "TEXT" else np.concatenate(part)
            for part, kind in zip(parts, kinds.values(), strict=True)
        ]


@contextmanager
def _naming_file(path: Path) -> Iterator[None]:
    """Raise errors of a database as OSError or ValueError that name its file."""
    try:
        yield
    except sqlite3.OperationalError as error:
        expect_present(path)
        advice = (
            ". Frames up to some seconds before are saved: free space, then repeat the command "
            "with --resume, or make a report of them with `python -m estimation report`"
        )  # over a quota, SQLite reports an I/O error
        fails = any(what in str(error) for what in ("full", "disk I/O error"))
        raise OSError(f"{path}: {error}{advice if fails else ''}") from error
    except sqlite3.DatabaseError as error:
        raise ValueError(f"{path} is not the record of a run, or damaged ({error})") from error


@contextmanager
def _opening(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a database that stays open, unless an error follows; errors are named after its file."""
    with _naming_file(path), ExitStack() as on_error:
        database = sqlite3.connect(path)
        on_error.callback(database.close)
        yield database
        on_error.pop_all()


def _kinds() -> dict[str, str]:
    """The SQLite type of each quantity of a record."""
    stored = {Number: "REAL", Whole: "INTEGER", Flag: "BOOLEAN", Label: "TEXT", Text: "TEXT"}
    return {name: stored[Record.__annotations__[name]] for name in Record.columns()}


def _columns(methods: tuple[str, ...]) -> dict[str, str]:
    return {
        "row": "INTEGER PRIMARY KEY",
        **{f"{method}.{name}": kind for method in methods for name, kind in _kinds().items()},
        **dict.fromkeys(("axis", "imprint"), "REAL"),
        "rests": "INTEGER",
        **{f"disc_{name}": "REAL" for name in Disc._fields},
        **{name: "REAL" for name in Margin._fields},
        **_SHEAR_COLUMNS,
        **dict.fromkeys(GripPath._fields, "REAL") | {"level": "TEXT"},
    }


def _plain(value: Any) -> Any:
    """A value of a type that SQLite can store."""
    if isinstance(value, str):
        return str(value)
    return value.item() if isinstance(value, np.generic) else value
