# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the pieces of a surface go: they are held as a mesh, or written as they come."""

from .hold import HOLD, Hold
from .sink import Sink, Taken
from .write import Write
