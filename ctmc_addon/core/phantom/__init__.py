# SPDX-License-Identifier: GPL-3.0-or-later
"""An abdominal CT with known truth."""

from .phantom import Phantom, phantom_steps

__all__ = [
    "Phantom",
    "phantom_steps",
]
