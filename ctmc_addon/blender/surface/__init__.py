"""A surface as an object of the Blender file, and read back from it."""

from .alpha_key import set_alpha
from .closeness import Closeness, Trees, closeness_steps, middle_of
from .evaluate import evaluated_triangles
from .mesh_data import edges_steps
from .objects import MEMORY, placement_of, require_changeable, settings_of
from .placement import SCALE
from .readback import as_shown, own_mesh, read_back

__all__ = [
    "MEMORY",
    "SCALE",
    "Closeness",
    "Trees",
    "as_shown",
    "closeness_steps",
    "edges_steps",
    "evaluated_triangles",
    "middle_of",
    "own_mesh",
    "placement_of",
    "read_back",
    "require_changeable",
    "set_alpha",
    "settings_of",
]
