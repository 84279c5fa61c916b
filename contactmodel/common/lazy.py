"""A package's public names, imported when they are first used.

`import contactmodel` costs nothing this way, and a command's `--help` does not wait for JAX. A
package's public names stand once, as imports in its `__init__.pyi`, which type checkers read too.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

Getter = Callable[[str], Any]


def public_names(package: str, file: str) -> tuple[Getter, Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, from the stub beside its `__init__.py`.

    Args:
        package: its `__name__`.
        file: its `__file__`.
    """
    stub = ast.parse(Path(file).with_name("__init__.pyi").read_text("utf-8"))
    homes = {
        name.name: statement.module
        for statement in stub.body
        if isinstance(statement, ast.ImportFrom) and statement.module
        for name in statement.names
    }

    def get(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)  # from now on it is found without this function
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return get, names, [name for name in homes if not name.startswith("_")]
