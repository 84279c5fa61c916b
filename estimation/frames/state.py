"""The state of a run as bytes, to go on from: pickled, and read without trust.

Python's pickle can be made to run anything that it can import. What is read here may be of classes
of this project and of NumPy's arrays only, and those only hold values.
"""

import io
import pickle
from typing import Any

from contactmodel.common.version import __version__

OTHERS = {
    ("collections", "Counter"),
    ("collections", "deque"),
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
    ("pathlib", "PosixPath"),
    ("pathlib", "WindowsPath"),
}


class _Reader(pickle.Unpickler):
    """Refuses whatever is not a value of ours."""

    def find_class(self, module: str, name: str) -> Any:
        """A class by name."""
        packages = ("contactmodel.", "estimation.")
        writers = "estimation.output."
        if (module, name) in OTHERS:
            return super().find_class(module, name)
        ours = module.startswith(packages) and not module.startswith(writers)
        if ours and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and found.__module__ == module:
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is not read")


def save_state(state: Any) -> bytes:
    """The state as bytes, with the version that wrote it."""
    return pickle.dumps((__version__, state), protocol=5)


def load_state(data: bytes) -> Any:
    """What `save_state` was given.

    Raises:
        ValueError: it is damaged, of another version, or holds what it may not.
    """
    try:
        version, state = _Reader(io.BytesIO(data)).load()
    except (
        pickle.UnpicklingError,
        EOFError,
        AttributeError,
        ImportError,
        LookupError,
        MemoryError,
        OverflowError,
        TypeError,
    ) as error:
        raise ValueError(
            f"the run cannot be resumed: its state cannot be read ({error})"
        ) from error
    if version != __version__:
        raise ValueError(
            f"the run cannot be resumed: its state is of version {version}, this is {__version__}"
        )
    return state
