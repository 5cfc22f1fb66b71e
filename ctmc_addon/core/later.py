# SPDX-License-Identifier: GPL-3.0-or-later
"""Import names of a package when they are first used, so that a command starts without what it does not need."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any


def lazy_names(package: str) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package that imports the names under its `if TYPE_CHECKING:` on first use.

    The names are listed once, where type checkers read them too.

    Parameters
    ----------
    package : str
        Its `__name__`.
    """

    def getattr_(name: str) -> Any:
        module = _modules_of(package).get(name)
        if module is None:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(module, package), name)
        setattr(sys.modules[package], name, value)
        return value

    return getattr_


@cache
def _modules_of(package: str) -> dict[str, str]:
    """Return the module of each name under `if TYPE_CHECKING:`, relative to the package."""
    spec = find_spec(package)
    loader: Any = spec.loader if spec else None
    source = loader.get_source(package) or ""  # A package without its source has no lazy names.
    return {
        alias.asname or alias.name: "." * node.level + (node.module or "")
        for block in ast.parse(source).body
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
