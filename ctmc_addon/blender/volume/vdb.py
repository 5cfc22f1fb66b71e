# SPDX-License-Identifier: GPL-3.0-or-later
"""Write gray values as a grid of OpenVDB in a file, the only way into Blender's Volume objects.

The grid's index (x, y, z) is the volume's, and its transform leads to Blender's units around the volume's middle: what
is left to the object's location is exact in float32. A sample is a grid point, so nothing is half a voxel off.
"""

from __future__ import annotations

import importlib.util
import sys
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core import OutputError, Step, Steps, Volume, require_memory
from ...core.files.atomic_write import whole_files
from ...core.volume import transform_points

GRID = "HU"
"""The grid's name, also where the values are not HU: materials ask for it."""
SLICES = 16  # Slices copied per step.


@cache
def vdb_writer() -> Any | None:
    """Return OpenVDB's Python module of this Blender; None without one.

    The result is kept, because the panel asks at every draw.
    """
    # Blender as a module does not look where its own packages are.
    inside = Path(bpy.utils.system_resource("PYTHON"), "lib", f"python3.{sys.version_info[1]}", "site-packages")
    for name in ("openvdb", "pyopenvdb"):  # Since Blender 4.4, and before.
        try:
            if importlib.util.find_spec(name):
                return importlib.import_module(name)
            spec = PathFinder.find_spec(name, [str(inside)])  # An extension leaves `sys.path` alone.
            if spec and spec.loader:
                module = importlib.util.module_from_spec(spec)
                spec.loader.exec_module(module)
                return module
        except ImportError:
            continue
    return None


def middle_mm(volume: Volume, beyond: float = 0.0) -> tuple[float, float, float]:
    """Return the middle of a volume, RAS+ mm.

    Parameters
    ----------
    volume : Volume
    beyond : float
        Voxels along each axis by which to go beyond it.
    """
    index = (np.array(volume.size, np.float64) - 1) / 2 + beyond
    x, y, z = transform_points(volume.affine, index[None])[0].tolist()
    return x, y, z


def vdb_steps(volume: Volume, path: Path, scale: float) -> Steps[None]:
    """Write a volume as a .vdb, whole or not at all.

    Parameters
    ----------
    scale : float
        Blender units of 1 mm.

    Raises
    ------
    OutputError
        If this Blender has no OpenVDB module, or the file cannot be written.
    MemoryLimitError
        If the grid would not fit beside the volume.
    """
    module = vdb_writer()
    if module is None:
        raise OutputError("this Blender has no OpenVDB module; the Blender of blender.org has one")
    require_memory(4 * volume.values.size, "the volume's grid", "use a region or a larger stride")
    lowest = float(min(np.fmin.reduce(part, axis=None) for part in volume.values))
    grid = module.FloatGrid(lowest)
    grid.name = GRID
    matrix = np.array(volume.affine)
    matrix[:3, 3] -= middle_mm(volume)
    matrix[:3] *= scale
    grid.transform = module.createLinearTransform(matrix.T.tolist())  # Rows are the images of the axes.
    values = volume.values
    for first in range(0, len(values), SLICES):
        yield Step(0.6 * first / len(values), "Copying the values")
        part = values[first : first + SLICES].astype(np.float32)  # (slices, rows, columns)
        grid.copyFromArray(np.ascontiguousarray(part.transpose(2, 1, 0)), ijk=(0, 0, first))
    yield Step(0.6, f"Writing {path.name}")
    with whole_files([path]) as temporaries:
        module.write(str(temporaries[path]), grids=[grid])
