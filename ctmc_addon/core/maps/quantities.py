# SPDX-License-Identifier: GPL-3.0-or-later
"""All quantities, in the order of the help and of the panel."""

from __future__ import annotations

from .angle import SmallestAngle
from .deviation import Deviation
from .distance import DistanceTo
from .quantity import Quantity

QUANTITIES: tuple[type[Quantity], ...] = (DistanceTo, Deviation, SmallestAngle)
