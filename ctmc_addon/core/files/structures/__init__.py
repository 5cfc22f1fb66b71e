# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that hold several structures by name, with color and opacity: GLB, OBJ with MTL, 3MF and a page, all NumPy."""

from ..mesh_files import STRUCTURE_SUFFIXES, files_of
from .structure import Structure, as_structures
from .writing import write_structures, write_structures_steps
