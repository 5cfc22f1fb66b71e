# SPDX-License-Identifier: GPL-3.0-or-later
"""Show the CT itself as a Volume object, which Cycles and EEVEE render: a .vdb file, its object and its material."""

from .appearance import APPEARANCES, Appearance, adjust
from .objects import add_volume, of_ct
from .vdb import vdb_steps, vdb_writer
