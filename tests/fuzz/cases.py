"""One case: a sound input, damaged, read and used, and what came of it."""

import os
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import av
import jax
import numpy as np

from tests.fuzz.contents import Input, write_input
from tests.fuzz.kinds import KINDS
from tests.fuzz.memory import Memory
from tests.fuzz.mutations import mutate
from tests.fuzz.runner import Verdict

FEWEST_LETTERS = 12
"""Of a message, beside the file's name, below which it names no cause."""


WAYS = 5
"""Ways to use a sound input, of those that chance decides."""


def kind_of(case: int) -> str:
    """The kind of a case's input; the kinds take turns."""
    return list(KINDS)[case % len(KINDS)]


def prepare() -> None:
    """Use the sound inputs in every way, so that what is imported and compiled counts for no case.

    Raises:
        AssertionError: there is no sound answer to one.
    """
    jax.config.update("jax_enable_x64", True)
    av.logging.set_level(av.logging.PANIC)
    for name, kind in KINDS.items():
        with _written(kind.make()) as folder:
            for way in range(WAYS):
                wrong = kind.use(folder / kind.target, np.random.default_rng(way))
                assert not wrong, f"{name}: {wrong}"


def run_case(seed: int, case: int) -> Verdict:
    """Damage an input and see that it ends in an answer or in an error that helps."""
    kind = KINDS[kind_of(case)]
    rng = np.random.default_rng((seed, case))
    content, damage = mutate(rng, kind.make())
    with _written(content) as folder:
        names = {folder.name, kind.target or folder.name, *(Path(name).name for name in content)}
        memory, started = Memory(), time.process_time()
        with warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
            outcome, message = judge_use(kind.use, folder / kind.target, rng, names)
        seconds = time.process_time() - started
    return Verdict(case, outcome, damage, message, seconds, memory.used())


@contextmanager
def _written(content: Input) -> Iterator[Path]:
    """The folder of an input's files, while they are used."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as outer:
        folder = Path(outer) / "input"
        folder.mkdir()
        write_input(content, folder)
        yield folder


def judge_use(
    use: Callable[[Path, np.random.Generator], str],
    path: Path,
    rng: np.random.Generator,
    names: Collection[str],
) -> tuple[str, str]:
    """The outcome, and what there is to say about it."""
    try:
        wrong = use(path, rng)
    except (ValueError, OSError) as error:
        text = str(error)
        if not any(name in text for name in (*names, path.stem)):
            return "failed", f"{_describe(error)}: names no file"
        if len(text.replace(str(path), "").strip()) < FEWEST_LETTERS:
            return "failed", f"{_describe(error)}: names no cause"
        return "refused", text
    except Exception as error:  # any other error is what the fuzzer looks for
        return "failed", _describe(error)
    return ("failed", wrong) if wrong else ("answered", "")


def _describe(error: Exception) -> str:
    """Its type and text, and where it was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "site-packages" not in frame.filename]
    place = f"{os.path.relpath(ours[-1].filename)}:{ours[-1].lineno}"
    return f"{type(error).__name__} at {place}: {error}"[:500]
