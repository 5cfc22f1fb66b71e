# SPDX-License-Identifier: GPL-3.0-or-later
"""Marching Cubes on voxels of any stride, in three passes; marching_cubes.py says in which order to read the files."""

from .grid import Grid, make_grid
from .marching_cubes import Counts, count_steps, extract_steps, marching_cubes
from .scan import TOPOLOGIES
