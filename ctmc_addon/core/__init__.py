# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers: from gray values to triangles, with NumPy and the standard library alone."""

from typing import TYPE_CHECKING

from ..version import VERSION
from .described import AUTO, Described, Setting, checked, defaults, descriptions, setting
from .errors import (
    AbsentLabelError,
    CtmcError,
    LabelError,
    MemoryLimitError,
    MeshError,
    OutputError,
    ReadError,
    SettingsError,
    ThresholdError,
    VolumeError,
    one_line,
)
from .extraction.field_pieces import SlabResult, SlabTask, slab_result_steps
from .extraction.marching_cubes import marching_cubes
from .files.mesh_files import STRUCTURE_SUFFIXES, files_of
from .later import lazy_names
from .machine.budget import Budget, SlabWorkers
from .machine.memory import (
    NO_THREAD,
    address_space_available,
    amount,
    available_bytes,
    give_back,
    keep_little,
    peak_bytes,
    reset_peak_bytes,
    resident_bytes,
)
from .machine.memory import refusal as memory_refusal
from .machine.memory import require as require_memory
from .machine.own_process import BOOT, ending, first_request, interpreter, own_output, requests, say, temporary_files_in
from .machine.parallel import map_steps, processors, side_by_side_steps, worker_count
from .measures import (
    GRAY_VALUES,
    HU,
    MEASURES,
    UNKNOWN,
    FinishedSurface,
    Measure,
    Place,
    columns_in,
    combined,
    measure,
    measures_in,
)
from .mesh.triangle_mesh import Surface, TriangleMesh, replayed_steps
from .planning.case_plan import (
    asked_bytes,
    asks_for_memory,
    case_bytes,
    case_process_is_large,
    cases_at_once,
    cases_bytes,
)
from .planning.plan import advised_steps, fits_in_memory, plan_steps, reads_at_once, shown_stride, triangle_bytes
from .progress import PAUSE, Stages, Step, Steps, equal_part, finish, timed_steps
from .reconstruction import Reconstruction, Stage
from .settings import (
    EXCLUSIVE,
    GOALS,
    SETTINGS,
    SIMPLIFICATION,
    ReconstructionSettings,
    is_allowed,
    settings_of_stage,
    with_present_names,
)
from .sinks import HOLD, Hold, Sink, Write
from .smoothing.choices import done_smoothing, has_width
from .smoothing.methods import SMOOTHINGS, smoothing_of, used_settings
from .surfaces.extract import reconstruct, reconstruct_steps, result_and_full_steps
from .surfaces.finish import simplified_steps, without_small_steps
from .surfaces.make import make_surfaces_steps
from .surfaces.request import MadeSurface, SurfaceRequest, share_walls
from .units import Unit, length_text, unit_of, volume_text
from .volume.volume import Volume

if TYPE_CHECKING:
    from .files.structures import Structure, write_structures, write_structures_steps
    from .mesh.angles.alpha_choice import AlphaChoice, chosen_alpha_steps
    from .mesh.distance.triangle_tree import distances
    from .planning.cost_estimate import CALIBRATION, CostEstimate, FieldCache, cost_estimate_steps
    from .preview import LEAVE_IT, Preview, PreviewResult
    from .simplification.simplify import simplify, simplify_steps
    from .structure_table import (
        StructureRow,
        measure_structures,
        measure_structures_steps,
        structure_row_steps,
        table_cells,
        table_csv,
        table_heads,
    )
    from .structures import (
        chosen_opacities,
        opacities_of,
        require_opacities,
        save_structures,
        structure_names,
        structures_of,
    )
    from .surfaces.labels import LabelSurfaces, reconstruct_labels, reconstruct_labels_steps

__getattr__ = lazy_names(__name__)
