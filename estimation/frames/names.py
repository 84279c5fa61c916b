"""Names of files, the frame numbers in them, and the table that gives each number its time."""

import os
import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from contactmodel.common.inputs import cell_number, cell_whole, read_rows


class Numbering(NamedTuple):
    """The frame number of each picture, and problems of the numbers in the names, in sentences."""

    numbers: tuple[int, ...]
    warnings: tuple[str, ...]


def counted(number: int, singular: str, plural: str) -> str:
    """A number with its noun: `1 frame`, `2 frames`."""
    return f"{number} {singular if number == 1 else plural}"


def natural_key(path: Path) -> tuple[list[str | int], str]:
    """Sort key of a file's name that orders numbers by value: `frame2` before `frame10`."""
    return _split(path.name), path.name


def name_recordings(paths: Sequence[Path]) -> list[str]:
    """Unique names for recordings, from the names of their files or folders.

    Equal names from different places are extended by the file's suffix or the folders above:
    `lemon-exp_num_1-camera_0`. Names that are still equal are numbered.
    """
    own = [_tail(path, 1) for path in paths]
    names = list(own)
    for name in {name for name in own if own.count(name) > 1}:
        alike = [i for i, candidate in enumerate(own) if candidate == name]
        longest = max(len(Path(os.path.abspath(paths[i])).parts) for i in alike)
        forms = ((length, suffix) for length in range(1, longest) for suffix in (False, True))
        for length, suffix in forms:
            tails = [_tail(paths[i], length, suffix=suffix) for i in alike]
            if len(set(tails)) == len(alike):
                for i, tail in zip(alike, tails, strict=True):
                    names[i] = tail
                break
    return number_alike(names)


def number_alike(names: Sequence[str]) -> list[str]:
    """Number the names that occur more than once."""
    return [
        name if names.count(name) == 1 else f"{name}-{names[: i + 1].count(name)}"
        for i, name in enumerate(names)
    ]


def _tail(path: Path, length: int, *, suffix: bool = False) -> str:
    """The last parts of a path, joined to a valid name for a folder."""
    whole = Path(os.path.abspath(path))
    last = whole.name if suffix or whole.is_dir() else whole.stem
    above = whole.parts[max(1, len(whole.parts) - length) : -1]
    return "-".join((*above, last)).replace(":", "-") or "recording"


def number_pictures(files: Sequence[Path]) -> Numbering:
    """Read the frame numbers in the names of pictures in natural order.

    The names may differ in one number only, and most of these numbers must be consecutive.
    Otherwise the pictures are counted from 0.
    """
    numbers, doubt = _find_numbers(files)
    if doubt:
        text = (
            f"The file names do not number the pictures ({doubt}). The pictures are counted from 0 "
            "in the order of their names, and this count is the frame number."
        )
        return Numbering(tuple(range(len(files))), (text,) if len(files) > 1 else ())
    return Numbering(tuple(numbers), (*_find_duplicates(files, numbers), *_find_gaps(numbers)))


def table_beside(path: Path) -> Path:
    """Path of the table with the times of a folder or a video, whether or not it exists."""
    return path / "times.csv" if path.is_dir() else path.with_suffix(".csv")


def read_times(path: Path) -> dict[int, float]:
    """Time stamps by frame number; empty without a table.

    Raises:
        ValueError: the table has no valid time stamps, or gives one frame two times.
    """
    if not path.is_file():
        return {}
    try:
        rows = read_rows(path, ("frame", "time_s"))
    except ValueError as error:
        other = "rename the file if it is not a table of the pictures' times"
        raise ValueError(f"{error}; {other}") from error
    stamps: dict[int, float] = {}
    for at, row in rows:
        frame = cell_whole(row["frame"], f"{at}: frame")
        stamp = cell_number(row["time_s"], f"{at}: time_s")
        if stamps.setdefault(frame, stamp) != stamp:
            raise ValueError(
                f"{at}: frame {frame} has the time {stamp:g} s here and {stamps[frame]:g} s "
                "above: remove one of the two rows"
            )
    return stamps


def _split(name: str) -> list[str | int]:
    """Texts and numbers in turn, with a text, perhaps empty, at both ends."""
    parts = re.split(r"([0-9]+)", name)
    return [int(part) if i % 2 else part for i, part in enumerate(parts)]


def _find_numbers(files: Sequence[Path]) -> tuple[list[int], str]:
    """The number in each name, or why the names do not number the pictures."""
    names = [_split(file.stem) for file in files]
    unlike = [
        file.name for file, name in zip(files, names, strict=True) if name[::2] != names[0][::2]
    ]
    if unlike:
        return [], f"{files[0].name} and {unlike[0]} differ in more than a number"
    columns = [i for i in range(1, len(names[0]), 2) if len({name[i] for name in names}) > 1]
    if len(columns) > 1:
        return [], f"{files[0].name} and {files[-1].name} differ in more than one number"
    if len(names[0]) == 1:
        return [], f"there is no number in {files[0].name}"
    column = columns[0] if columns else -2
    numbers = [int(name[column]) for name in names]
    if numbers[-1] >= 2**53:  # floating-point times could not distinguish larger numbers
        return [], f"the number of {files[-1].name} is too large"
    steps = Counter(after - before for before, after in _gaps(numbers))
    if steps and 2 * steps[1] < steps.total():
        return [], f"most of their numbers rise by {steps.most_common(1)[0][0]}, not by 1"
    return numbers, ""


def _gaps(numbers: Sequence[int]) -> list[tuple[int, int]]:
    """Each number with the next larger one."""
    different = sorted(set(numbers))
    return list(pairwise(different))


def _find_duplicates(files: Sequence[Path], numbers: Sequence[int]) -> list[str]:
    same = [i for i in range(1, len(numbers)) if numbers[i] == numbers[i - 1]]
    if not same:
        return []
    return [
        counted(len(same), "picture has", "pictures have")
        + " the same number as the one before and will not be used: "
        f"{files[same[0]].name} after {files[same[0] - 1].name}{', …' if same[1:] else ''}."
    ]


def _find_gaps(numbers: Sequence[int]) -> list[str]:
    gaps = [(before + 1, after - 1) for before, after in _gaps(numbers) if after > before + 1]
    if not gaps:
        return []
    shown = [str(first) if first == last else f"{first} to {last}" for first, last in gaps[:5]]
    missing = sum(last - first + 1 for first, last in gaps)
    return [
        counted(missing, "frame number is", "frame numbers are")
        + f" missing in the names of the pictures ({', '.join(shown)}{', …' if gaps[5:] else ''}). "
        "Missing numbers count as dropped frames: the times of the other pictures allow for them."
    ]
