# SPDX-License-Identifier: GPL-3.0-or-later
"""All quantities, in the order of the help and of the panel."""

from __future__ import annotations

from .angle import SmallestAngle
from .deviation import Deviation
from .distance import DistanceTo
from .painted import Painted
from .quantity import Quantity
from .thickness import Gap, Thickness

QUANTITIES: tuple[type[Quantity], ...] = (Painted, Thickness, Gap, DistanceTo, Deviation, SmallestAngle)
