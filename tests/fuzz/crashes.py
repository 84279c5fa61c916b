"""Cases that go wrong in every way: what the runner is tested with."""

import os

from tests.fuzz.runner import Verdict


def run(case: int) -> Verdict:
    """Die, hang, or take too much memory."""
    if case == 0:
        os.abort()
    if case == 1:
        while True:
            pass
    if case == 2:
        try:
            return Verdict(case, "answered", message=str(len(bytes(3 * 10**9))))
        except MemoryError:
            return Verdict(case, "failed", message="memory")
    return Verdict(case, "answered")
