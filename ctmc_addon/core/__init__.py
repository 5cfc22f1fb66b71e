"""Numbers: from grey values to triangles, with NumPy and the standard library alone."""

from .errors import CtmcError
from .extraction.marching_cubes import marching_cubes
from .mesh.triangle_mesh import Surface, TriangleMesh
from .mesh.triangle_tree import distances
from .pipeline import Reconstruction, reconstruct, reconstruct_steps
from .progress import Step, Steps, finish
from .settings import ReconstructionSettings
from .simplification.simplify import simplify, simplify_steps
from .volume.volume import Volume

__all__ = [
    "CtmcError",
    "Reconstruction",
    "ReconstructionSettings",
    "Step",
    "Steps",
    "Surface",
    "TriangleMesh",
    "Volume",
    "distances",
    "finish",
    "marching_cubes",
    "reconstruct",
    "reconstruct_steps",
    "simplify",
    "simplify_steps",
]
