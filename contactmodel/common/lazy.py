"""Lazy packages: public names are imported when they are first used.

`import contactmodel` is therefore fast, and `--help` does not wait for JAX. The public names of a
package are listed once, as imports in its `__init__.pyi`, which type checkers read too.
"""

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

Getter = Callable[[str], Any]


def public_names(package: str, file: str) -> tuple[Getter, Callable[[], list[str]], list[str]]:
    """Make `__getattr__`, `__dir__` and `__all__` of a package from its stub `__init__.pyi`.

    Args:
        package: `__name__` of the package.
        file: `__file__` of the package.
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
        setattr(sys.modules[package], name, value)  # later look-ups do not call this function
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return get, names, [name for name in homes if not name.startswith("_")]
