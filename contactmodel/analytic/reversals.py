"""Twist to and fro: which reversals a contact remembers, and what follows from them.

[Masing1926] G. Masing, "Eigenspannungen und Verfestigung beim Messing".
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


def masing(virgin: Callable[[Any], Any], turns: Sequence[Any], twist: Any) -> Any:
    """A quantity after reversals at constant pressure ([Masing1926]).

    Each branch is the first-loading curve enlarged twice from the point where it turned, as long
    as the twist stays within the last two turns.

    Args:
        virgin: the quantity on first loading, odd in its argument (moment, u_θ at a radius, …).
        turns: twists at the reversals that are still open, oldest first [rad].
        twist: twist now [rad].
    """
    first, *rest = (*turns, twist)
    value = virgin(first)
    for start, end in zip(turns, rest, strict=True):
        value = value + 2.0 * virgin(0.5 * (end - start))
    return value


def open_turns(path: Sequence[float]) -> list[tuple[float, ...]]:
    """For each twist of a path from 0, the reversals that it still remembers.

    A reversal is forgotten with its partner when the path passes the twist at which it began; one
    that goes beyond every earlier twist is on the first-loading curve again.
    """
    remembered: list[tuple[float, ...]] = []
    turns: list[float] = []
    last = 0.0
    direction = 0.0
    for twist in path:
        step = float(np.sign(twist - last))
        if step and direction and step != direction:
            turns.append(last)
        direction = step or direction
        while turns and _passed(turns, twist):
            del turns[-2:]
        remembered.append(tuple(turns))
        last = twist
    return remembered


def _passed(turns: Sequence[float], twist: float) -> bool:
    """Whether the branch from the last turn has closed the loop it is part of."""
    if len(turns) == 1:
        return abs(twist) > abs(turns[0])
    return abs(twist - turns[-1]) >= abs(turns[-2] - turns[-1])
