# SPDX-License-Identifier: GPL-3.0-or-later
"""The volumes that are measured, (slices, rows, columns), and real CT where it is there.

All of them are made from closed forms or from the phantom's seed: the same bytes everywhere.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ctmc_addon.core.phantom.phantom import Phantom, centered, phantom
from ctmc_addon.core.phantom.shapes import Blob, grow_tumors, liver_shape
from ctmc_addon.core.volume.volume import Volume
from ctmc_addon.readers import read_volume

SLICES, SIZE = 250, 512
FINE_MM = (0.477, 0.477, 0.58)  # A field of view of 244 mm around the liver.
LIVER_MM = (0.67, 0.67, 0.58)
EDGE = 127.5  # Gray value of the surface in volumes of closed forms.
DENSE_THRESHOLD = 142  # HU: vessels, bone, and the noise that reaches as far
BONE, SKIN = 200, -300  # HU
REAL_CT = ("lidc0314_abdomen30", "ts_dicom_j2k", "ircadb01_abdomen")  # Folders of 512 x 512 DICOM slices.


def tumors(seed: int = 0) -> NDArray[np.uint8]:
    """Return only the phantom's tumors, 250 slices of 512 x 512: 0 outside, 255 inside, an edge of a few pixels."""
    chance = np.random.Generator(np.random.PCG64(seed))
    liver = liver_shape(chance, 1.0, FINE_MM[2])
    axes = grid_about(liver, FINE_MM)
    return painted(grow_tumors(chance, liver, 1.0, FINE_MM, axes), axes)


def whole_liver(seed: int = 0) -> NDArray[np.uint8]:
    """Return the phantom's liver, on as many samples."""
    liver = liver_shape(np.random.Generator(np.random.PCG64(seed)), 1.0, LIVER_MM[2])
    return painted([liver], grid_about(liver, LIVER_MM))


def grid_about(shape: Blob, spacing: tuple[float, float, float]) -> list[NDArray[np.float64]]:
    """Return positions of columns, rows and slices, mm, about the middle of a body."""
    return [shape.center[axis] + centered(count, spacing[axis]) for axis, count in enumerate((SIZE, SIZE, SLICES))]


def painted(shapes: list[Blob], axes: list[NDArray[np.float64]]) -> NDArray[np.uint8]:
    """Paint bodies into an empty volume."""
    values = np.zeros((SLICES, SIZE, SIZE), np.uint8)
    for shape in shapes:
        paint(values, shape, axes)
    return values


def paint(values: NDArray[np.uint8], shape: Blob, axes: list[NDArray[np.float64]]) -> None:
    """Add a body whose gray value falls with the distance from its surface."""
    windows = []
    for axis in range(3):
        low, high = shape.box(axis)
        windows.append(slice(*np.searchsorted(axes[axis], (low - 3, high + 3)).tolist()))
    x, y, z = ((axes[axis][windows[axis]] - shape.center[axis]) / shape.half_axes[axis] for axis in range(3))
    rim = 3.0 / min(shape.half_axes)  # beyond it the gray value is 0 or 255 whatever the direction
    for k, height in enumerate(z.tolist()):
        length = np.sqrt(x[None, :] ** 2 + y[:, None] ** 2 + height**2)  # (rows, columns)
        near = (length > shape.limits[0] - rim) & (length < shape.limits[1] + rim) & (length > 0)
        rows, columns = np.nonzero(near)
        far = length[near]
        depth = shape.limits[0] - length
        depth[near] = shape.radius(x[columns] / far, y[rows] / far, height / far) - far
        gray = np.clip(np.rint(127.5 + 110 * min(shape.half_axes) * depth), 0, 255).astype(np.uint8)
        window = values[windows[2].start + k, windows[1], windows[0]]
        np.maximum(window, gray, out=window)


def ball(size: int) -> NDArray[np.uint8]:
    """Return a ball that fills 0.8 of a cube, gray at its edge."""
    return spheres(size, 1, 0.4 * size)


def spheres(size: int, across: int, radius: float) -> NDArray[np.uint8]:
    """Paint `across` cubed balls of a radius in voxels into a cube of `size`, slice by slice."""
    pitch = size / across
    offset = (np.arange(size) + 0.37) % pitch - pitch / 2  # from the middle of the nearest ball
    square = (offset**2).astype(np.float32)
    plane = square[:, None] + square[None, :]
    values = np.empty((size, size, size), np.uint8)
    for k in range(size):
        values[k] = np.clip(127.5 + 64 * (radius - np.sqrt(plane + square[k])), 0, 255)
    return values


def abdomen(scratch: Path) -> NDArray[np.int16]:
    """Return HU of the phantom, 250 slices of 512 x 512; made once per run."""
    path = scratch / "abdomen.npy"
    if not path.exists():
        np.save(path, abdomen_phantom().volume.values)
    return np.load(path)


def abdomen_phantom(slices: int = SLICES) -> Phantom:
    """Return the phantom with its geometry."""
    return phantom(slices=slices)


def real_ct(data: Path, also: list[Path]) -> dict[str, Volume]:
    """Return the available real volumes by name."""
    paths = [data / name for name in REAL_CT] + list(also)
    return {path.name: read_volume(path) for path in paths if path.exists()}


def affine(spacing: tuple[float, float, float] = (0.74, 0.74, 0.58)) -> NDArray[np.float64]:
    """Return an affine with axes towards the patient's left, back and head."""
    return np.diag([-spacing[0], -spacing[1], spacing[2], 1.0])
