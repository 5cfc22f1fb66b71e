# SPDX-License-Identifier: GPL-3.0-or-later
"""Gray values on a grid, their position in the patient, and what is found out about them before extraction."""

from .affine import (
    LEAST_SPACING_MM,
    MOST_SPACING_MM,
    SPACING_LIMITS,
    axis_codes,
    determinant,
    farthest_corner_mm,
    index_to_index,
    is_spacing,
    product,
    spacing_of,
    to_index,
    transform_faces,
    transform_normals,
    transform_points,
)
from .finish import finish_of
from .labels.anatomy import Anatomy, anatomy_of, is_lesion
from .labels.extents import (
    ALL,
    LabelExtent,
    chosen_labels_steps,
    compared_name,
    existing_labels_steps,
    label_extents_steps,
    labels_region,
    not_a_label_steps,
    require_labels,
)
from .labels.label_sources import combined_labels, free_offset, placed_labels_steps, samples_on_grid
from .labels.structure_colors import label_rgb, linear, part_rgb, structure_color
from .labels.whole_labels import NotWholeError, WholeLabels, WholeNumbers
from .region import (
    EDGES,
    box_of,
    converted_region,
    moved_region,
    region_axes,
    region_box,
    region_corners,
    region_limits,
    region_shift,
    settings_of_copy,
    side_positions,
    volume_box,
    with_moved_face,
)
from .reslice import resliced, value_at
from .slice_reader import SliceReader, ValuesInMemory, as_slice, fitting_stride
from .slices import (
    PLANES,
    TINT_SHARE,
    SliceIndex,
    default_window,
    in_label_colors,
    label_slices,
    position_through,
    slice_at,
    slice_corners,
    slice_normal,
    slice_position_text,
    slice_through,
    slice_values,
    stepped_position,
    where_ray_meets,
    windowed,
    with_labels,
)
from .statistics.histogram import (
    Bars,
    ThresholdLimits,
    TissueRange,
    grabbed_limit,
    histogram_bars,
    moved_limit,
    round_ticks,
    rounded_to,
    shown_range,
    tissue_bands,
)
from .statistics.inside import InsideValues, inside_values_steps, lie_in_one_place, range_values_steps
from .statistics.outside import AIR, ends_of_body, outside_air
from .statistics.thresholding import otsu, quick_threshold, used_threshold_steps
from .statistics.tissues import TISSUES, surface_name, tissue_name
from .statistics.values import (
    ValueFacts,
    VolumeStatistics,
    histogram_picture,
    slabs_of,
    value_facts_steps,
    value_range,
    volume_statistics_steps,
)
from .value_kind import ValueKind
from .volume import Box, SampleGrid, Volume
