"""Folders of results: a run's files replace those of the last run of the same command.

A run writes to a hidden folder inside and moves its files to their places once they are complete.
`manifest.json` lists, for each command, the files it wrote and the SHA-256 of each. A run that
wrote files removes at its end the files that its last run wrote and it did not. Other files are
never removed: a file that is not listed, or whose content has changed, belongs to the user. It is
kept, and renamed (`angles.csv` to `angles.kept.csv`) if a run needs its name. Names in the manifest
that lead out of the folder or through a link are ignored.
"""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path, PureWindowsPath

from filelock import FileLock, Timeout

from estimation.frames.files import check_writable, write_whole

MANIFEST_NAME = "manifest.json"
"""Name of the file that lists the files of each command."""
FORMAT_VERSION = 1
"""Version of the format that is written and read."""

Listed = dict[str, dict[str, str]]
"""SHA-256 of files, by command and by name in the folder."""


class ResultFolder:
    """A folder of results during a run; made by `renew_results`.

    Attributes:
        path: the folder.
        draft: folder for this run's files, which `publish` moves to their places in `path`.
    """

    def __init__(self, path: Path, draft: Path, command: str, say: Callable[[str], None]) -> None:
        """Read the manifest of earlier runs."""
        self.path = path
        self.draft = draft
        self._command = command
        self._say = say
        self._listed = _read_manifest(path / MANIFEST_NAME)
        self._stale = dict(self._listed.get(command, {}))
        self._published = False

    def publish(self) -> None:
        """Move the files of the draft to their places, and list them.

        Hidden files are skipped: they are incomplete files of a killed run.

        Raises:
            OSError: the folder cannot be written to.
        """
        drafts = (file for file in self.draft.rglob("*") if file.is_file())
        files = sorted(file for file in drafts if not file.name.startswith("."))
        for file in files:
            name, sha256 = file.relative_to(self.draft).as_posix(), _hash(file)
            target = self.path / name
            target.parent.mkdir(parents=True, exist_ok=True)
            if os.path.lexists(target) and not self._is_ours(name):
                self._set_aside(target)
            file.replace(target)
            self._stale.pop(name, None)
            for listed in self._listed.values():
                listed.pop(name, None)
            self._listed.setdefault(self._command, {})[name] = sha256
        if files:
            self._write_manifest()
            self._published = True

    def keep_earlier(self, inner: str = "") -> None:
        """Keep the files of the last run, or only those in an inner folder."""
        self._stale = {
            name: sha256
            for name, sha256 in self._stale.items()
            if inner and not name.startswith(f"{inner}/")
        }

    def clear(self) -> None:
        """Remove the files that the command's last run wrote and this run did not.

        If this run has published nothing, no file is removed.

        Raises:
            OSError: a file cannot be removed.
        """
        if not self._published:
            return
        removed = 0
        for name, sha256 in self._stale.items():
            file = _find(self.path, name)
            if file is not None and _hash(file) == sha256:
                file.unlink()
                _remove_empty(file.parent, self.path)
                removed += 1
            elif file is not None:
                self._say(f"{file} was changed after an earlier run wrote it: it is kept")
            del self._listed[self._command][name]
        self._stale = {}
        self._write_manifest()
        if removed:
            files = "1 file" if removed == 1 else f"{removed} files"
            self._say(f"removed {files} that an earlier run wrote to {self.path}")

    def _is_ours(self, name: str) -> bool:
        """Whether a command wrote the file and it has not changed since."""
        hashes = [files[name] for files in self._listed.values() if name in files]
        file = _find(self.path, name)
        return file is not None and bool(hashes) and _hash(file) == hashes[0]

    def _set_aside(self, target: Path) -> None:
        """Rename a file of the user whose name is needed."""
        names = (f"{target.stem}.kept{n or ''}{target.suffix}" for n in count())
        kept = next(path for path in map(target.with_name, names) if not os.path.lexists(path))
        target.rename(kept)
        self._say(f"{target} is not as an earlier run wrote it: kept as {kept.name}")

    def _write_manifest(self) -> None:
        path = self.path / MANIFEST_NAME
        if os.path.lexists(path) and not _read_manifest(path):
            self._set_aside(path)
        content = {"format_version": FORMAT_VERSION, "written": self._listed}
        write_whole(path, json.dumps(content, indent=2) + "\n")


@contextmanager
def renew_results(
    folder: Path, command: str, say: Callable[[str], None] = lambda line: None, draft: str = ""
) -> Iterator[ResultFolder]:
    """A folder of results for one run of a command.

    At the end the draft is published. After an error an unnamed draft is published too, so that no
    result is lost, and the files of the last run are kept; a named draft then stays in its folder.

    Args:
        folder: folder of results, created if it does not exist.
        command: command of the run. It replaces its own results, and those of other commands only
            if they have the same name.
        say: receives a line for each file that is kept or renamed, and the number of removed files.
        draft: name of the folder inside for incomplete files, which an earlier run may have left;
            empty for a new, temporary one.

    Raises:
        OSError: the folder cannot be written to, or another run is writing to the draft.
    """
    check_writable(folder)
    if draft:
        (folder / draft).mkdir(exist_ok=True)
        with _lock(folder / draft):
            results = ResultFolder(folder, folder / draft, command, say)
            yield results
            results.publish()
        shutil.rmtree(folder / draft)
    else:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as temporary:
            results = ResultFolder(folder, Path(temporary), command, say)
            try:
                yield results
            finally:
                results.publish()
    results.clear()


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Lock the folder against other runs; a killed run releases the lock."""
    path = folder / ".lock"
    try:
        held = FileLock(path, timeout=0).acquire()
    except Timeout as error:
        raise OSError(
            f"another run is writing to {folder}: wait until it ends, or give another folder"
        ) from error
    try:
        with held:
            yield
    finally:
        path.unlink(missing_ok=True)


def has_results(folder: Path) -> bool:
    """Whether a command has written its results to the folder."""
    return bool(_read_manifest(folder / MANIFEST_NAME))


def expect_apart(recordings: Sequence[str], out: Path) -> None:
    """Check that no recording is the output folder itself.

    Raises:
        ValueError: one is. A later run would take pictures of the report for its own.
    """
    for path in map(Path, recordings):
        if path.is_dir() and path.resolve() == out.resolve():
            raise ValueError(
                f"{path} is the folder of the recording: write the results to another one (--out), "
                "such as a new folder inside"
            )


def _read_manifest(path: Path) -> Listed:
    """The content of the manifest; empty if it is missing, damaged or of another format."""
    if path.is_symlink() or not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError):
        return {}
    if not isinstance(content, dict) or content.get("format_version") != FORMAT_VERSION:
        return {}
    written = content.get("written")
    if isinstance(written, dict) and all(map(_lists_files, written.values())):
        return written
    return {}


def _lists_files(files: object) -> bool:
    return isinstance(files, dict) and all(isinstance(sha256, str) for sha256 in files.values())


def _find(folder: Path, name: str) -> Path | None:
    """A listed file, if it is a plain file inside the folder and not reached through a link."""
    windows = PureWindowsPath(name)  # its rules for absolute paths include those of POSIX
    if windows.anchor or ".." in windows.parts:
        return None
    file = folder / name
    return file if os.path.isfile(file) and file.resolve() == folder.resolve() / name else None


def _remove_empty(inner: Path, folder: Path) -> None:
    """Remove folders that have become empty, up to the folder of results."""
    while inner != folder and not any(inner.iterdir()):
        inner.rmdir()
        inner = inner.parent


def _hash(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
