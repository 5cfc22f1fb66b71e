# SPDX-License-Identifier: GPL-3.0-or-later
"""Store a surface as an object of the Blender file, and read it back."""

from .alpha_key import key_state, set_alpha
from .components import PICKED, component_at, give_triangles, own_surface, separated
from .decimate import decimated
from .light import is_large, is_prepared, light_modifier, other_modifiers, prepare, shown_faces
from .mesh_data import edges_steps
from .objects import (
    add_reconstruction,
    apply_shape_and_modifiers,
    call,
    refresh_normals,
    require_editable,
    require_updatable,
    surface_mesh_steps,
    temporary_surfaces,
    update_reconstruction,
)
from .placement import SCALE
from .provenance import Provenance, read_provenance, require_provenance, set_drawn, set_part, settings_of
from .readback import as_shown, evaluated_triangles, own_mesh, placement_of, read_back, reconstruction_of
