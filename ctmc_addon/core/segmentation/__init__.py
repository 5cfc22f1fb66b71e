# SPDX-License-Identifier: GPL-3.0-or-later
"""Turn clicks and strokes into structures: masks on a grid, without a trained model, with NumPy only.

A mask is (slices, rows, columns) bool, a byte for each voxel. For a region, hand in `volume.part(box)` and masks of its
shape: nothing else is read or touched.
"""

from ..arrays import Flags
from .between.planes import Outline, between_planes_steps
from .between.slices import between_slices_steps, drawn_axis
from .changes import Change, change_of
from .combine import COMBINATIONS, combined
from .competition.compete import HU_PER_MM, MAX_MM, Click, compete_steps
from .connected import connected_steps
from .distance import Window, grown_window, window_of
from .islands import holes_filled_steps, islands_steps
from .layers import MOST_STRUCTURES, Layers, layers_of, require_count
from .margin import margin_steps
from .packed import packed_slices, unpack_into, unpacked_mask
from .patient_table import without_table_steps
from .points import Sample, sample_at
from .range_mask import range_mask_steps
from .scissors import scissors_steps
from .shown import cropped, veiled
from .strokes import brush, brushed_window
