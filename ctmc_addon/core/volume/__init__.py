"""Grey values on a grid, where they lie in the patient, and what is read from them before extraction."""

from .affine import to_index, transform_faces, transform_normals, transform_points
from .region import (
    EDGES,
    region_box,
    region_corners,
    region_directions,
    region_limits,
    region_moved,
    region_shift,
    region_with,
    side_places,
    volume_box,
)
from .slices import picture, slice_corners, slice_middle, slice_place, slice_values, usual_window
from .statistics import VolumeStatistics, histogram_picture, slabs, value_range, volume_statistics_steps
from .thresholding import otsu, quick_threshold, used_threshold_steps
from .tissues import TISSUES
from .volume import Volume

__all__ = [
    "EDGES",
    "TISSUES",
    "Volume",
    "VolumeStatistics",
    "histogram_picture",
    "otsu",
    "picture",
    "quick_threshold",
    "region_box",
    "region_corners",
    "region_directions",
    "region_limits",
    "region_moved",
    "region_shift",
    "region_with",
    "side_places",
    "slabs",
    "slice_corners",
    "slice_middle",
    "slice_place",
    "slice_values",
    "to_index",
    "transform_faces",
    "transform_normals",
    "transform_points",
    "used_threshold_steps",
    "usual_window",
    "value_range",
    "volume_box",
    "volume_statistics_steps",
]
