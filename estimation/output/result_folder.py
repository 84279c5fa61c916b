"""Folders of results: what a run writes replaces what an earlier run of the same command wrote.

A run writes to a hidden folder inside and moves its files to their places once they are whole.
`manifest.json` lists, for each command, the files it wrote and the SHA-256 of each. At the end of a
run that wrote something, the files are removed that its last run wrote and it did not. Nothing else
is removed: a file that is not listed, or whose content is no longer the listed one, is the user's.
It stays, and is renamed (`angles.csv` to `angles.kept.csv`) where its name is needed. Names in the
manifest that lead out of the folder, or through a link, are ignored.
"""

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path, PureWindowsPath

from filelock import FileLock, Timeout

from estimation.frames.files import check_writable, write_whole

MANIFEST = "manifest.json"
FORMAT_VERSION = 1

Listed = dict[str, dict[str, str]]
"""SHA-256 of files, by command and by name in the folder."""


class ResultFolder:
    """A folder of results during a run; made by `renew_results`.

    Attributes:
        path: the folder.
        draft: a folder for the files of this run, which `publish` moves to their places in `path`.
    """

    def __init__(self, path: Path, draft: Path, command: str, say: Callable[[str], None]) -> None:
        """Read what earlier runs wrote there."""
        self.path = path
        self.draft = draft
        self._command = command
        self._say = say
        self._listed = _read_manifest(path / MANIFEST)
        self._stale = dict(self._listed.get(command, {}))
        self._published = False

    def publish(self) -> None:
        """Move the files of the draft to their places, and list them; but for hidden ones.

        Those are what a run that was killed had not written to the end.

        Raises:
            OSError: the folder cannot be written to.
        """
        found = (one for one in self.draft.rglob("*") if one.is_file())
        files = sorted(one for one in found if not one.name.startswith("."))
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
        """Leave the files of the last run, or of it those in an inner folder."""
        self._stale = {
            name: sha256
            for name, sha256 in self._stale.items()
            if inner and not name.startswith(f"{inner}/")
        }

    def clear(self) -> None:
        """Remove what the last run of the command wrote and this one has not.

        Nothing is removed where this run has published nothing.

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
                self._say(f"{file} was changed after an earlier run wrote it: it stays")
            del self._listed[self._command][name]
        self._stale = {}
        self._write_manifest()
        if removed:
            files = "1 file" if removed == 1 else f"{removed} files"
            self._say(f"removed {files} that an earlier run wrote to {self.path}")

    def _is_ours(self, name: str) -> bool:
        """Whether a command wrote the file, and nobody has changed it since."""
        known = [files[name] for files in self._listed.values() if name in files]
        file = _find(self.path, name)
        return file is not None and bool(known) and _hash(file) == known[0]

    def _set_aside(self, target: Path) -> None:
        """Free a name of a file that is not ours."""
        names = (f"{target.stem}.kept{n or ''}{target.suffix}" for n in count())
        kept = next(one for one in map(target.with_name, names) if not os.path.lexists(one))
        target.rename(kept)
        self._say(f"{target} is not as an earlier run wrote it: kept as {kept.name}")

    def _write_manifest(self) -> None:
        path = self.path / MANIFEST
        if os.path.lexists(path) and not _read_manifest(path):
            self._set_aside(path)
        content = {"format_version": FORMAT_VERSION, "written": self._listed}
        write_whole(path, json.dumps(content, indent=2) + "\n")


@contextmanager
def renew_results(
    folder: Path, command: str, say: Callable[[str], None] = lambda line: None, draft: str = ""
) -> Iterator[ResultFolder]:
    """A folder of results, for one run of a command.

    What is in the draft at the end is published. Where the run ends in an error it is published as
    well, so that nothing that was computed is lost, and the files of the last run stay beside it;
    but a draft with a name stays what it is then.

    Args:
        folder: made if it is not there.
        command: that runs; it replaces its own results, and those of others only by name.
        say: told, in a line each, what is removed, kept or renamed.
        draft: name of the folder inside for files that are not whole yet, which an earlier run may
            have left; without it a new one, which never stays.

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
        with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as made:
            results = ResultFolder(folder, Path(made), command, say)
            try:
                yield results
            finally:
                results.publish()
    results.clear()


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    """Let no other run write to the folder; a run that is killed lets go."""
    path = folder / ".lock"
    lock = FileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise OSError(
            f"another run is writing to {folder}: wait until it ends, or give another folder"
        ) from error
    try:
        yield
    finally:
        lock.release()
        path.unlink(missing_ok=True)


def _read_manifest(path: Path) -> Listed:
    """What the manifest lists; nothing where there is none, or one that is not ours or damaged."""
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
    """A listed file, if it is a plain file inside the folder that no link leads to."""
    windows = PureWindowsPath(name)  # whose rules for what is absolute include the others'
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
