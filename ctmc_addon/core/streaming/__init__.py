# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of volumes that are not held in memory: values are fetched a slab at a time.

Read in this order: `choice` (when), `field_slabs` (the values), `parts` (active voxels and vertices of a slab),
`slab_parts` (parts grouped anew), `slab_tasks` (parts made by workers), `surface` (all of it, with the bytes of a
volume in memory), `pieces` (where the surface does not fit either), `kept_pieces` (without small components).
"""

from .choice import field_steps, fits_in_memory, in_memory
from .field_slabs import FieldSlabs
from .pieces import SurfaceFacts, field_pieces_steps, surface_pieces_steps
from .slab_tasks import SlabResult, SlabTask, SlabWorkers, slab_result_steps
from .surface import slab_surface_steps

__all__ = [
    "FieldSlabs",
    "SlabResult",
    "SlabTask",
    "SlabWorkers",
    "SurfaceFacts",
    "field_pieces_steps",
    "field_steps",
    "fits_in_memory",
    "in_memory",
    "slab_result_steps",
    "slab_surface_steps",
    "surface_pieces_steps",
]
