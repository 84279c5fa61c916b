"""Reversed twists: the reversals that a contact remembers, and their effect.

[Masing1926] G. Masing, "Eigenspannungen und Verfestigung beim Messing".
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np


def masing(virgin: Callable[[Any], Any], turns: Sequence[Any], twist: Any) -> Any:
    """A quantity after reversals at constant pressure ([Masing1926]).

    Each branch is the first-loading curve, enlarged by two and started at the reversal. The twist
    must stay between the last two reversals.

    Args:
        virgin: the quantity on first loading, odd in its argument (moment, u_θ at a radius, …).
        turns: twists at the reversals that are still open, oldest first [rad].
        twist: present twist [rad].
    """
    first, *rest = (*turns, twist)
    value = virgin(first)
    for start, end in zip(turns, rest, strict=True):
        value = value + 2.0 * virgin(0.5 * (end - start))
    return value


def open_turns(path: Sequence[float]) -> list[tuple[float, ...]]:
    """Open reversals for each twist of a path that starts at 0 [rad].

    A reversal and its partner are forgotten when the path passes the twist at which the loop began.
    A path beyond every earlier twist is on the first-loading curve again.

    Args:
        path: twists [rad].

    Returns:
        For each twist, the twists at the open reversals, oldest first.
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
    """Whether the branch from the last reversal has closed its loop."""
    if len(turns) == 1:
        return abs(twist) > abs(turns[0])
    return abs(twist - turns[-1]) >= abs(turns[-2] - turns[-1])
