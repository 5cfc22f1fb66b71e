# SPDX-License-Identifier: GPL-3.0-or-later
"""Provide the operators `ctmc.*`: a folder for each page of the tab, one subject a file."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Return every module that registers, in order; imported only when Blender asks."""
    from .ct import load, load_labels, patient_table, pick_point, scans, slice, slice_object, view
    from .draw import edits, grow, quad_view, radius, refuse, scissors, stroke, structures
    from .render import figure, figure_view, rotation, studio, volume_object
    from .results import alpha, components, cut_away, export, maps, pick_component, results, rulers, simplify, table
    from .surface import drag_solid, histogram, reconstruct, region, solid, structure_list, threshold

    return (
        *(load, load_labels, patient_table, scans, view, slice, slice_object, pick_point),
        *(structure_list, threshold, histogram, region, reconstruct, solid, drag_solid),
        *(structures, stroke, grow, scissors, edits, radius, quad_view, refuse),
        *(alpha, simplify, components, pick_component, cut_away, results, maps, table, rulers, export),
        *(rotation, volume_object, figure, figure_view, studio),
    )
