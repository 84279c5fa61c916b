"""Checks that a setting, a plain number, lies in its range."""

import math


def check_positive(name: str, value: float) -> float:
    """The value, which must be a finite number above 0.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} is {value}; it must be a number above 0")
    return value


def check_count(name: str, value: int, least: int = 1) -> int:
    """The value, which must be at least `least`.

    Raises:
        ValueError: it is less.
    """
    if value < least:
        raise ValueError(f"{name} is {value}; it must be at least {least}")
    return value


def check_share(name: str, value: float) -> float:
    """The value, which must be a share above 0 and at most 1.

    Raises:
        ValueError: it is not.
    """
    if not 0.0 < value <= 1.0:
        raise ValueError(f"{name} is {value}; it must be a share above 0 and at most 1")
    return value
