"""Grey values on a grid, where they lie in the patient, and what is read from them before extraction."""

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
from .statistics import Survey, histogram_picture, survey_steps
from .thresholding import otsu, slabs, value_range
from .tissues import TISSUES
from .volume import Volume

__all__ = [
    "EDGES",
    "TISSUES",
    "Survey",
    "Volume",
    "histogram_picture",
    "otsu",
    "picture",
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
    "survey_steps",
    "usual_window",
    "value_range",
    "volume_box",
]
