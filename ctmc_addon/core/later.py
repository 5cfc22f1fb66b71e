# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a package imports when they are first asked for, so that a command starts without what it does not use."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def names_later(package: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a package.

    Parameters
    ----------
    package : str
        Its `__name__`.
    names : mapping
        For each module, relative to the package, the names that it has, parted by spaces.
    """
    module_of = {name: module for module, all_names in names.items() for name in all_names.split()}

    def getattr_(name: str) -> Any:
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(module_of[name], package), name)
        setattr(sys.modules[package], name, value)
        return value

    return getattr_
