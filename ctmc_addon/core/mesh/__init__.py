"""The triangles of a surface, and what can be measured on them."""

from .measures import Measures, measures_steps
from .quality import SAMPLES, SEED, roughness, surface_samples, triangle_shapes
from .triangle_mesh import blend, finding_edges, vertex_normals

__all__ = [
    "SAMPLES",
    "SEED",
    "Measures",
    "blend",
    "finding_edges",
    "measures_steps",
    "roughness",
    "surface_samples",
    "triangle_shapes",
    "vertex_normals",
]
