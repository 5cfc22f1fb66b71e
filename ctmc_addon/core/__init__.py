# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers: from gray values to triangles, with NumPy and the standard library alone."""

from .cost_estimate import CALIBRATION, CostEstimate, FieldCache, cost_estimate_steps
from .errors import (
    CtmcError,
    LabelError,
    MemoryLimitError,
    MeshError,
    OutputError,
    ReadError,
    SettingsError,
    ThresholdError,
    one_line,
)
from .extraction.marching_cubes import marching_cubes
from .fitting import advised_steps
from .label_surfaces import LabelSurfaces, each_label_steps, reconstruct_labels, reconstruct_labels_steps
from .memory import NO_THREAD, address_space_available, amount, available_bytes, give_back
from .memory import refusal as memory_refusal
from .memory import require as require_memory
from .mesh.distance.triangle_tree import distances
from .mesh.triangle_mesh import Surface, TriangleMesh
from .parallel import map_steps, side_by_side_steps, worker_count
from .pipeline import (
    STREAMED_NOTE,
    described_pieces_steps,
    reconstruct,
    reconstruct_steps,
    result_and_full_steps,
    simplified_steps,
    without_small_steps,
)
from .preview import Preview, PreviewResult
from .progress import PAUSE, Stages, Step, Steps, equal_part, finish, timed_steps
from .reconstruction import Reconstruction, Stage
from .settings import EXCLUSIVE, GOALS, ReconstructionSettings, Setting, described, is_allowed, with_present_names
from .simplification.simplify import simplify, simplify_steps
from .version import VERSION
from .volume.volume import Volume

__all__ = [
    "CALIBRATION",
    "EXCLUSIVE",
    "GOALS",
    "NO_THREAD",
    "PAUSE",
    "STREAMED_NOTE",
    "VERSION",
    "CostEstimate",
    "CtmcError",
    "FieldCache",
    "LabelError",
    "LabelSurfaces",
    "MemoryLimitError",
    "MeshError",
    "OutputError",
    "Preview",
    "PreviewResult",
    "ReadError",
    "Reconstruction",
    "ReconstructionSettings",
    "Setting",
    "SettingsError",
    "Stage",
    "Stages",
    "Step",
    "Steps",
    "Surface",
    "ThresholdError",
    "TriangleMesh",
    "Volume",
    "address_space_available",
    "advised_steps",
    "amount",
    "available_bytes",
    "cost_estimate_steps",
    "described",
    "described_pieces_steps",
    "distances",
    "each_label_steps",
    "equal_part",
    "finish",
    "give_back",
    "is_allowed",
    "map_steps",
    "marching_cubes",
    "memory_refusal",
    "one_line",
    "reconstruct",
    "reconstruct_labels",
    "reconstruct_labels_steps",
    "reconstruct_steps",
    "require_memory",
    "result_and_full_steps",
    "side_by_side_steps",
    "simplified_steps",
    "simplify",
    "simplify_steps",
    "timed_steps",
    "with_present_names",
    "without_small_steps",
    "worker_count",
]
