# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of volumes that are not held in memory: values are fetched a slab at a time.

Read in this order: `choice` (when), `field_slabs` (the values), `parts` (active voxels and vertices of a slab),
`slab_parts` (parts grouped anew), `slab_tasks` (parts made by workers), `surface` (all of it, with the bytes of a
volume in memory), `pieces` (where the surface does not fit either), `kept_pieces` (without small components),
`piece_measures` (area, volume and the like).
"""

from .choice import field_steps, fits_in_memory, in_memory, widest_slices
from .field_slabs import FieldSlabs
from .piece_measures import PieceMeasures
from .pieces import SurfaceFacts, counted_steps, field_pieces_steps, surface_pieces_steps
from .slab_tasks import SlabResult, SlabTask, SlabWorkers, slab_result_steps
from .surface import slab_surface_steps

__all__ = [
    "FieldSlabs",
    "PieceMeasures",
    "SlabResult",
    "SlabTask",
    "SlabWorkers",
    "SurfaceFacts",
    "counted_steps",
    "field_pieces_steps",
    "field_steps",
    "fits_in_memory",
    "in_memory",
    "slab_result_steps",
    "slab_surface_steps",
    "surface_pieces_steps",
    "widest_slices",
]
