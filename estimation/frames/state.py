"""The state of a run as bytes, from which a run resumes: pickled, and read without trust.

A pickle can run any code that Python can import. Only classes of this project and NumPy arrays are
therefore read, which hold nothing but values.
"""

import io
import pickle
from functools import cached_property
from typing import Any

from contactmodel.common.version import __version__


class WithoutCaches:
    """Base of classes whose cached properties are not stored, because they are computed again."""

    def __getstate__(self) -> dict[str, Any]:
        """The attributes without cached properties."""
        kind = type(self)
        return {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(kind, name, None), cached_property)
        }


class _Reader(pickle.Unpickler):
    """Rejects all classes but value classes of this project."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a class by name, if it may be read."""
        foreign = {
            ("builtins", "complex"),
            ("builtins", "slice"),
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
        packages = ("contactmodel.", "estimation.")
        writers = "estimation.output."
        if (module, name) in foreign:
            return super().find_class(module, name)
        ours = module.startswith(packages) and not module.startswith(writers)
        if ours and "." not in name:
            value_class = super().find_class(module, name)
            if isinstance(value_class, type) and value_class.__module__ == module:
                return value_class
        raise pickle.UnpicklingError(f"{module}.{name} is not read")


def save_state(state: Any) -> bytes:
    """Convert a state to bytes, together with the version that wrote it."""
    return pickle.dumps((__version__, state), protocol=5)


def load_state(data: bytes) -> Any:
    """Read the state that `save_state` has converted to bytes.

    Raises:
        ValueError: the bytes are damaged, of another version, or contain a class that is not read.
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
