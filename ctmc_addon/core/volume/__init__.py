# SPDX-License-Identifier: GPL-3.0-or-later
"""Gray values on a grid, their position in the patient, and what is found out about them before extraction."""

from .affine import spacing_of, transform_faces, transform_normals, transform_points
from .labels import (
    ALL,
    LabelExtent,
    chosen_labels_steps,
    label_extents_steps,
    require_labels,
)
from .region import (
    EDGES,
    Box,
    box_of,
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
from .slabs import SlabVolume, SliceReader, ValuesInMemory, as_slice, fitting_stride
from .slices import (
    default_window,
    slice_at,
    slice_corners,
    slice_position_text,
    slice_values,
    stepped_position,
    windowed,
)
from .statistics import VolumeStatistics, histogram_picture, slabs_of, value_range, volume_statistics_steps
from .thresholding import otsu, quick_threshold, used_threshold_steps
from .tissues import TISSUES, surface_name
from .volume import Placed, Volume

__all__ = [
    "ALL",
    "EDGES",
    "TISSUES",
    "Box",
    "LabelExtent",
    "Placed",
    "SlabVolume",
    "SliceReader",
    "ValuesInMemory",
    "Volume",
    "VolumeStatistics",
    "as_slice",
    "box_of",
    "chosen_labels_steps",
    "default_window",
    "fitting_stride",
    "histogram_picture",
    "label_extents_steps",
    "moved_region",
    "otsu",
    "quick_threshold",
    "region_axes",
    "region_box",
    "region_corners",
    "region_limits",
    "region_shift",
    "require_labels",
    "settings_of_copy",
    "side_positions",
    "slabs_of",
    "slice_at",
    "slice_corners",
    "slice_position_text",
    "slice_values",
    "spacing_of",
    "stepped_position",
    "surface_name",
    "transform_faces",
    "transform_normals",
    "transform_points",
    "used_threshold_steps",
    "value_range",
    "volume_box",
    "volume_statistics_steps",
    "windowed",
    "with_moved_face",
]
