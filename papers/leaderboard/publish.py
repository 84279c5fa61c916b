"""The two tasks of the command: export the cases, and rank entries."""

import csv
from collections.abc import Callable, Sequence
from functools import cache
from itertools import count
from pathlib import Path
from typing import NamedTuple

from contactmodel.common.command_line import say
from estimation.frames.names import counted
from estimation.output.report import figure_png
from papers.items import Track
from papers.leaderboard import alarms, board, settings
from papers.leaderboard.cases import list_cases
from papers.leaderboard.entries import Entry, write_entry
from papers.leaderboard.export import export_cases
from papers.leaderboard.methods import METHOD_NAMES, answer_all
from papers.leaderboard.sources import Source, open_cases

PUBLISHED = Path(__file__).with_name("published.csv")
"""Right answers of all methods in the practice round by tier [%], with all data sets."""


class Ranking(NamedTuple):
    """The results of a ranking."""

    # rows of each table, by name; `leaderboard` is the short form
    tables: dict[str, list[board.Row]]
    entries: dict[str, str]  # CSV text of every entry, by file name
    picture: bytes  # PNG of the right answers by group
    shown: int = settings.SHOWN  # number of printed rows of the short form


def export_splits(splits: Sequence[str], seed: int | None, folder: Path, track: Track) -> None:
    """Write the recordings of some splits; without a seed, with that of the practice round.

    Raises:
        OSError: a file cannot be written.
    """
    note = cache(_note)  # a data set that is left out is named once
    sources = [source for split in splits for source in _open(split, seed, track, note)]
    export_cases(sources, folder, track)


def rank_entries(
    given: Sequence[Entry], split: str, seed: int | None, *, alone: bool, track: Track
) -> Ranking:
    """Rank entries, alone or with our methods and published ones.

    Without a seed, the scored cases have that of the practice round.
    """
    given = rename_known(given)
    sources = _open(split, seed, track, _note)
    for entry in given:
        _note_missing(entry, sources)
    entries = [*([] if alone else answer_all(sources, track)), *given]
    scores = board.score_all(entries, sources)
    practice = split == "scored" and seed in (None, settings.PRACTICE_SEED)
    tables = {
        "leaderboard": board.rank(scores, read_published() if alone and practice else ()),
        "groups": board.tabulate(scores, "group"),
        "cases": board.tabulate(scores, "case"),
    }
    if not alone:
        tables["warnings"] = alarms.tabulate_warnings(settings.WARNING_DRAWS)
    texts = {entry.name.replace(" ", "-"): write_entry(entry) for entry in entries}
    return Ranking(tables, texts, figure_png(board.plot(scores)))


def rename_known(given: Sequence[Entry]) -> list[Entry]:
    """Entries with a number after names of our methods, published ones or earlier entries."""
    taken = {*METHOD_NAMES}
    named = []
    for entry in given:
        name = entry.name
        if name in taken:
            numbered = (f"{entry.name} ({i})" for i in count(2))
            name = next(each for each in numbered if each not in taken)
            _note(f"{entry.name} is already the name of an entry; yours is ranked as {name}")
        taken.add(name)
        named.append(entry._replace(name=name))
    return named


def read_published() -> list[board.Line]:
    """The methods of the practice round with their right answers by tier [%]."""
    with PUBLISHED.open(encoding="utf-8") as file:
        return [
            (
                f"{row['entry']} (listed)",
                {t: float(row[t]) if row[t] else None for t in settings.TIERS},
            )
            for row in csv.DictReader(file)
        ]


def _open(split: str, seed: int | None, track: Track, note: Callable[[str], None]) -> list[Source]:
    scored = settings.PRACTICE_SEED if seed is None else seed
    own = settings.TUNING_SEED if split == "tuning" else scored
    return list(track(open_cases(list_cases(split), own, note)))


def _note_missing(entry: Entry, sources: Sequence[Source]) -> None:
    names = {source.case.name for source in sources}
    missing = len(names - set(entry.angle) - set(entry.slipped))
    if missing:
        _note(
            f"{entry.name} has no rows for {missing} of the {len(names)} ranked cases; these count "
            "as wrong"
        )
    if others := len({*entry.angle, *entry.slipped} - names):
        _note(
            f"{entry.name} answers {counted(others, 'case', 'cases')} not scored, since the "
            "recordings are not on this machine"
        )


def _note(line: str) -> None:
    say(f"note: {line}")
