# SPDX-License-Identifier: GPL-3.0-or-later
"""The values that the small files of every format hold."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

SHAPE = (4, 34, 40)  # (slices, rows, columns); JPEG 2000's encoder wants 32 at least
VALUES = np.random.default_rng(0).integers(0, 250, SHAPE).astype(np.int16)
BYTES = VALUES.astype(np.uint8)

Seed = Callable[[Path], Path]  # writes into a folder, and returns what is to be opened
