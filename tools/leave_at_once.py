# SPDX-License-Identifier: GPL-3.0-or-later
"""A pytest plugin: a process of tests leaves as soon as it has reported its last one.

Blender as a module can hang or crash while Python shuts down; by then the process that collects the results has them.
"""

from __future__ import annotations

import atexit
import os
from typing import Any


def pytest_unconfigure(config: Any) -> None:
    """Leave before whatever the tests have registered for Python's end, which is called last in, first out."""
    if hasattr(config, "workerinput"):  # one of several processes; the only one leaves by itself
        atexit.register(os._exit, 0)
