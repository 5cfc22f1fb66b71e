# SPDX-License-Identifier: GPL-3.0-or-later
"""End a pytest process as soon as it has reported its last test: a plugin.

Blender as a module can hang or crash while Python shuts down; by then the process that collects the results has them.
"""

from __future__ import annotations

import atexit
import os
from typing import Any


def pytest_unconfigure(config: Any) -> None:
    """Exit before all functions that tests have registered with atexit, which run last in, first out."""
    if hasattr(config, "workerinput"):  # one of several processes; the only one leaves by itself
        atexit.register(os._exit, 0)
