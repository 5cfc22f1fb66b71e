# SPDX-License-Identifier: GPL-3.0-or-later
"""Turn clicks and strokes into structures: masks on a grid, without a trained model, with NumPy only.

A mask is (slices, rows, columns) bool, a byte for each voxel. For a region, hand in `volume.part(box)` and masks of its
shape: nothing else is read or touched.
"""

from ..arrays import Flags as Flags
from .between.planes import Outline as Outline, between_planes_steps as between_planes_steps
from .between.slices import between_slices_steps as between_slices_steps, drawn_axis as drawn_axis
from .changes import Change as Change, change_of as change_of
from .competition.compete import (
    HU_PER_MM as HU_PER_MM,
    MAX_MM as MAX_MM,
    Click as Click,
    compete_steps as compete_steps,
)
from .distance import Window as Window, grown_window as grown_window, window_of as window_of
from .layers import (
    MOST_STRUCTURES as MOST_STRUCTURES,
    Layers as Layers,
    layers_of as layers_of,
    require_count as require_count,
)
from .packed import packed_slices as packed_slices, unpack_into as unpack_into, unpacked_mask as unpacked_mask
from .points import Sample as Sample, sample_at as sample_at
from .shown import cropped as cropped, veiled as veiled
from .tools.combine import COMBINATIONS as COMBINATIONS, combined as combined
from .tools.connected import connected_steps as connected_steps
from .tools.islands import holes_filled_steps as holes_filled_steps, islands_steps as islands_steps
from .tools.margin import margin_steps as margin_steps
from .tools.patient_table import without_table_steps as without_table_steps
from .tools.range_mask import range_mask_steps as range_mask_steps
from .tools.scissors import scissors_steps as scissors_steps
from .tools.strokes import brush as brush, brushed_window as brushed_window
