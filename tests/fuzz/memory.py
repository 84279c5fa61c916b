"""The memory that a case takes, and a limit to it."""

import resource
from pathlib import Path


class Memory:
    """Measures the most memory in use from here on."""

    def __init__(self) -> None:
        """Begin; the kernel forgets the process's earlier peak."""
        Path("/proc/self/clear_refs").write_text("5")
        self._before = _status("VmRSS")

    def used(self) -> float:
        """Most memory in use since, beyond what was in use before [MB]."""
        return max(_status("VmHWM") - self._before, 0.0)


def limit_memory(megabytes: int) -> None:
    """Let this process take so much more memory than it has now; more is a `MemoryError`."""
    most = int((_status("VmData") + megabytes) * 1e6)
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _status(field: str) -> float:
    """A figure of this process's status [MB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(f"{field}:")) * 1.024e-3
