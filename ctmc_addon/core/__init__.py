# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers: from gray values to triangles, with only NumPy and the standard library."""

from typing import TYPE_CHECKING

from ..version import VERSION as VERSION
from .arrays import Doubles as Doubles, Floats as Floats
from .described import (
    AUTO as AUTO,
    Described as Described,
    Setting as Setting,
    checked as checked,
    defaults as defaults,
    descriptions as descriptions,
    setting as setting,
)
from .errors import (
    AbsentLabelError as AbsentLabelError,
    CtmcError as CtmcError,
    DamagedSliceError as DamagedSliceError,
    LabelError as LabelError,
    MemoryLimitError as MemoryLimitError,
    MeshError as MeshError,
    OutputError as OutputError,
    ReadError as ReadError,
    SettingsError as SettingsError,
    ThresholdError as ThresholdError,
    VolumeError as VolumeError,
    one_line as one_line,
)
from .exploded import ExplodedView as ExplodedView, shifts_of as shifts_of
from .extraction.field_pieces import (
    SlabResult as SlabResult,
    SlabTask as SlabTask,
    slab_result_steps as slab_result_steps,
)
from .extraction.marching_cubes import marching_cubes as marching_cubes
from .files.mesh_files import STRUCTURE_SUFFIXES as STRUCTURE_SUFFIXES, files_of as files_of
from .later import lazy_names
from .machine.budget import Budget as Budget, SlabWorkers as SlabWorkers
from .machine.memory import (
    NO_THREAD as NO_THREAD,
    address_space_available as address_space_available,
    amount as amount,
    available_bytes as available_bytes,
    give_back as give_back,
    keep_little as keep_little,
    peak_bytes as peak_bytes,
    refusal as memory_refusal,
    require as require_memory,
    reset_peak_bytes as reset_peak_bytes,
    resident_bytes as resident_bytes,
)
from .machine.own_process import (
    BOOT as BOOT,
    ending as ending,
    first_request as first_request,
    interpreter as interpreter,
    own_output as own_output,
    requests as requests,
    send as send,
    temporary_files_in as temporary_files_in,
)
from .machine.parallel import (
    map_steps as map_steps,
    processors as processors,
    side_by_side_steps as side_by_side_steps,
    worker_count as worker_count,
)
from .measures.measures import (
    GRAY_VALUES as GRAY_VALUES,
    GY as GY,
    HU as HU,
    MEASURES as MEASURES,
    PRINT_MEASURES as PRINT_MEASURES,
    UNKNOWN as UNKNOWN,
    FinishedSurface as FinishedSurface,
    Measure as Measure,
    Place as Place,
    columns_in as columns_in,
    combined as combined,
    map_measure as map_measure,
    map_numbers as map_numbers,
    maps_of as maps_of,
    measure as measure,
    measures_in as measures_in,
    printed_of as printed_of,
)
from .measures.reconstruction import Reconstruction as Reconstruction, Stage as Stage
from .measures.units import (
    UNITS as UNITS,
    Unit as Unit,
    distance_phrases as distance_phrases,
    fitting_unit as fitting_unit,
    length_text as length_text,
    mm_text as mm_text,
    number_text as number_text,
    one_way_text as one_way_text,
    percent_text as percent_text,
    position_text as position_text,
    sizes_text as sizes_text,
    spacing_text as spacing_text,
    specks_text as specks_text,
    unit_of as unit_of,
    volume_text as volume_text,
)
from .mesh.triangle_mesh import Surface as Surface, TriangleMesh as TriangleMesh, replayed_steps as replayed_steps
from .planning.case_plan import (
    asked_bytes as asked_bytes,
    asks_for_memory as asks_for_memory,
    case_bytes as case_bytes,
    case_process_is_large as case_process_is_large,
    cases_at_once as cases_at_once,
    cases_bytes as cases_bytes,
)
from .planning.plan import (
    advised_steps as advised_steps,
    fits_in_memory as fits_in_memory,
    plan_steps as plan_steps,
    reads_at_once as reads_at_once,
    shown_stride as shown_stride,
    triangle_bytes as triangle_bytes,
)
from .progress import (
    PAUSE as PAUSE,
    Stages as Stages,
    Step as Step,
    Steps as Steps,
    equal_part as equal_part,
    finish as finish,
    timed_steps as timed_steps,
)
from .settings import (
    COMPONENTS as COMPONENTS,
    EXCLUSIVE as EXCLUSIVE,
    GOALS as GOALS,
    SETTINGS as SETTINGS,
    SIMPLIFICATION as SIMPLIFICATION,
    ReconstructionSettings as ReconstructionSettings,
    is_allowed as is_allowed,
    settings_of_stage as settings_of_stage,
    with_present_names as with_present_names,
)
from .sinks import HOLD as HOLD, Hold as Hold, Sink as Sink, Write as Write
from .smoothing.choices import done_smoothing as done_smoothing, has_width as has_width
from .smoothing.methods import SMOOTHINGS as SMOOTHINGS, smoothing_of as smoothing_of, used_settings as used_settings
from .surfaces.extract import reconstruct_steps as reconstruct_steps, result_and_full_steps as result_and_full_steps
from .surfaces.finish import simplified_steps as simplified_steps, without_small_steps as without_small_steps
from .surfaces.make import (
    make_surfaces_steps as make_surfaces_steps,
    one_of_labels_steps as one_of_labels_steps,
    reconstruct as reconstruct,
)
from .surfaces.request import MadeSurface as MadeSurface, SurfaceRequest as SurfaceRequest, share_walls as share_walls
from .volume.volume import Volume as Volume

if TYPE_CHECKING:
    from .arithmetic import LN_2 as LN_2, natural_logarithm as natural_logarithm, power_of_two as power_of_two
    from .change.compare import (
        ChangeRow as ChangeRow,
        LabelChanges as LabelChanges,
        compare_labels as compare_labels,
        compare_labels_steps as compare_labels_steps,
    )
    from .change.limits import ChangeLimits as ChangeLimits, ChangeStatus as ChangeStatus
    from .change.table import (
        CHANGE_HEADS as CHANGE_HEADS,
        change_cells as change_cells,
        change_csv as change_csv,
        written_columns as written_columns,
    )
    from .files.structures import (
        Structure as Structure,
        write_structures as write_structures,
        write_structures_steps as write_structures_steps,
    )
    from .measures.structure_table import (
        StructureRow as StructureRow,
        measure_structures as measure_structures,
        measure_structures_steps as measure_structures_steps,
        structure_row_steps as structure_row_steps,
        table_cells as table_cells,
        table_csv as table_csv,
        table_heads as table_heads,
    )
    from .mesh.angles.alpha_choice import AlphaChoice as AlphaChoice, chosen_alpha_steps as chosen_alpha_steps
    from .mesh.distance.triangle_tree import distances as distances
    from .planning.cost_estimate import FieldCache as FieldCache, cost_estimate_steps as cost_estimate_steps
    from .planning.counted_surface import CostEstimate as CostEstimate
    from .planning.rates import CALIBRATION as CALIBRATION
    from .preview import LEAVE_IT as LEAVE_IT, Preview as Preview, PreviewResult as PreviewResult
    from .simplification.simplify import simplify as simplify, simplify_steps as simplify_steps
    from .structures import (
        chosen_opacities as chosen_opacities,
        opacities_of as opacities_of,
        require_opacities as require_opacities,
        save_structures as save_structures,
        structure_names as structure_names,
        structures_of as structures_of,
    )
    from .surfaces.labels import (
        LabelSurfaces as LabelSurfaces,
        reconstruct_labels as reconstruct_labels,
        reconstruct_labels_steps as reconstruct_labels_steps,
    )

__getattr__ = lazy_names(__name__)
