"""A hundred damaged inputs, and the fuzzer itself."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("resource")  # memory and time are limited as POSIX has it

from tests.fuzz import crashes
from tests.fuzz.__main__ import describe
from tests.fuzz.cases import judge_use, prepare, run_case
from tests.fuzz.contents import to_bytes
from tests.fuzz.kinds import KINDS
from tests.fuzz.mutations import mutate
from tests.fuzz.runner import Job, run_cases


def test_damaged_inputs_are_answered_or_refused():
    verdicts = list(run_cases(range(125), Job(partial(run_case, 0), prepare)))
    failed = [describe(one, 0) for one in verdicts if one.outcome == "failed"]
    assert not failed, "\n".join(failed)
    assert {one.outcome for one in verdicts} == {"answered", "refused"}


@pytest.mark.parametrize("name", ["archive", "PNG folder", "scalar softness", "reference"])
def test_damage_follows_from_the_seed_and_leaves_the_sound_input(name):
    base = KINDS[name].make()
    before = {file: to_bytes(file, part) for file, part in base.items()}
    for seed in range(20):
        (one, _), (other, _) = (mutate(np.random.default_rng(seed), base) for _ in range(2))
        assert {f: to_bytes(f, p) for f, p in one.items()} == {
            f: to_bytes(f, p) for f, p in other.items()
        }
    assert {file: to_bytes(file, part) for file, part in base.items()} == before


@pytest.mark.parametrize(
    ("error", "outcome", "words"),
    [
        (ValueError("in/soft.toml: k is -1; it must be ≥ 0"), "refused", "must be"),
        (ValueError("k is -1; it must be ≥ 0"), "failed", "names no file"),
        (ValueError("in/soft.toml: k"), "failed", "names no cause"),
        (TypeError("in/soft.toml: unhashable type"), "failed", "TypeError"),
    ],
)
def test_errors_are_judged(error, outcome, words):
    def use(path, rng):
        raise error

    path = Path("in/soft.toml")
    found, message = judge_use(use, path, np.random.default_rng(0), {path.name})
    assert found == outcome
    assert words in message


def test_processes_that_die_hang_or_grow_end_one_case_only():
    died, hung, grown, sound = run_cases(range(4), Job(crashes.run, seconds=0.2))
    assert "died, exit code -6" in died.message
    assert "took more than" in hung.message
    assert grown.message == "memory"
    assert sound.outcome == "answered"
