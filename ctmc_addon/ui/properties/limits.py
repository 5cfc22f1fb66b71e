# SPDX-License-Identifier: GPL-3.0-or-later
"""Adapt a setting of core to Blender: whether it has a switch, and its limits in float32.

As in settings.py, this module must not hold `bpy` itself.
"""

from __future__ import annotations

import numpy as np

from ...core import ReconstructionSettings, Setting

DEFAULTS = ReconstructionSettings()


def optional(name: str) -> bool:
    """Return whether a setting is optional."""
    return getattr(DEFAULTS, name) is None


def lowest(about: Setting) -> float:
    """Return the smallest float32 that the setting allows."""
    low = np.float32(about.low)
    return float(np.nextafter(low, np.float32(np.inf)) if about.low_open else low)


def highest(about: Setting) -> float:
    """Return the largest float32 that the setting allows."""
    high = np.float32(about.high)
    return float(np.nextafter(high, np.float32(0.0)) if about.high_open else high)


def switch(name: str) -> str:
    """Return the property that switches an optional setting on."""
    return f"use_{name}"
