# SPDX-License-Identifier: GPL-3.0-or-later
"""Provide the operators `ctmc.*`, one subject a file."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Return every module that registers, in order; imported only when Blender asks."""
    from . import figure, figure_view, rotation
    from .ct import histogram, load, load_labels, patient_table, region, scans, slice, structure_list, threshold, view
    from .draw import edits, grow, quad_view, radius, refuse, scissors, stroke, structures
    from .scene import cut_away, pick_point, rulers, slice_object, studio, volume_object
    from .surface import (
        alpha,
        components,
        drag_solid,
        export,
        maps,
        pick_component,
        reconstruct,
        results,
        simplify,
        solid,
        table,
    )

    viewing = (
        load,
        load_labels,
        patient_table,
        scans,
        structure_list,
        view,
        threshold,
        histogram,
        slice,
        slice_object,
        cut_away,
        pick_point,
        volume_object,
        region,
    )
    return (
        *viewing,
        *(structures, stroke, grow, scissors, edits, radius, quad_view, refuse),
        reconstruct,
        solid,
        drag_solid,
        alpha,
        simplify,
        components,
        pick_component,
        rotation,
        results,
        maps,
        table,
        rulers,
        export,
        figure,
        figure_view,
        studio,
    )
