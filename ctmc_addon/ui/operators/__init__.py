# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators `ctmc.*`, one subject a file."""

from typing import Any


def modules() -> tuple[Any, ...]:
    """Every module that registers, in order; imported only when Blender asks."""
    from . import (
        components,
        export,
        figure,
        figure_view,
        histogram,
        load,
        reconstruct,
        region,
        results,
        rotation,
        rulers,
        simplify,
        slice,
        slice_object,
        threshold,
        view,
        volume_object,
    )

    viewing = (load, view, threshold, histogram, slice, slice_object, volume_object, region)
    return (*viewing, reconstruct, simplify, components, rotation, results, rulers, export, figure, figure_view)
