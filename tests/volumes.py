# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes whose values come as those of a file do, and what a surface of them is compared by."""

import numpy as np

from ctmc_addon.core import CtmcError, Volume, reconstruct
from ctmc_addon.core.progress import Step
from ctmc_addon.core.smoothing.gaussian import convolved, weights
from ctmc_addon.core.volume import SliceReader

AFFINE = np.array([[-0.7, 0.1, 0, 5], [0, 0.8, 0.2, -9], [0.1, 0, 1.5, 30], [0, 0, 0, 1]], float)
FACTS = (
    "threshold",
    "full_faces",
    "voxels_visited",
    "notes",
    "wrong_side",
    "slice_steps",
    "removed_components",
    "collapsed_components",
    "collapsed_mm3",
    "name",
    "label_name",
    "label_color",
    "spacing_mm",
    "settings",
)


class FileReader(SliceReader):
    """Hands out copies of an array, as of a file, and notes which slices were fetched."""

    def __init__(self, values, thread_safe=False):
        self.values, self.slices, self.thread_safe = values, [], thread_safe
        self.shape, self.dtype = values.shape, values.dtype.newbyteorder("=")

    def fill(self, out, slices, rows, columns):
        self.slices += slices
        taken = self.values[slices.start : slices.stop : slices.step]
        out[...] = taken[:, rows.start : rows.stop : rows.step, columns.start : columns.stop : columns.step]


def in_file(volume):
    """The same volume with its values fetched as those of a file are."""
    return Volume(
        FileReader(volume.values),
        volume.affine,
        volume.notes,
        volume.name,
        volume.kind,
        volume.label_names,
        volume.label_colors,
    )


def waves(shape=(23, 21, 70), dtype=np.int16):
    """Waves and noise, -500 to 500, with many components."""
    z, y, x = np.indices(shape)
    noise = np.random.default_rng(3).normal(0, 60, shape)
    return (400 * np.sin(x / 5) * np.sin(y / 4) * np.cos(z / 3) + noise).astype(dtype)


def gaussian_smoothed(values, spacing, sigma_mm):
    """Values (slices, rows, columns) smoothed as a whole, axis by axis, the border repeated."""
    smoothed = values.astype(np.float32)
    for axis, gap in ((1, spacing[1]), (2, spacing[0]), (0, spacing[2])):
        smoothed = convolved(smoothed, weights(sigma_mm / gap), axis)
    return smoothed


def bytes_of(array):
    return None if array is None else (array.dtype, array.shape, array.tobytes())


def outcome(volume, settings, budget):
    """All that a result says but its seconds, arrays as bytes; of a refusal its type and its sentence."""
    try:
        result = reconstruct(volume, settings, budget)
    except CtmcError as error:
        return type(error), str(error)
    return of_result(result)


def of_result(result):
    """All that a result says but its seconds, arrays as bytes."""
    surface, mesh = result.surface, result.mesh
    arrays = [] if surface is None else [surface.midpoints, surface.linear, surface.faces, surface.normals]
    arrays += [mesh.vertices, mesh.faces, mesh.normals]
    return *map(bytes_of, arrays), *(getattr(result, name) for name in FACTS)


def items_of(steps):
    """What steps yield beside steps, and what they return."""
    items = []
    while True:
        try:
            item = next(steps)
        except StopIteration as end:
            return items, end.value
        if not isinstance(item, Step):
            items.append(item)


def concatenated(pieces):
    """One array each of midpoints, linear positions, faces and normals of pieces."""
    first = np.cumsum([0] + [len(piece.linear) for piece in pieces])
    faces = np.concatenate([piece.faces + np.int32(start) for piece, start in zip(pieces, first, strict=False)])
    normals = None if pieces[0].normals is None else np.concatenate([piece.normals for piece in pieces])
    return (
        np.concatenate([piece.midpoints for piece in pieces]),
        np.concatenate([piece.linear for piece in pieces]),
        faces.astype(np.int32),
        normals,
    )


def label_mask(volume, label):
    """Where a label is, (slices, rows, columns) bool, whichever layer it lies in."""
    return np.logical_or.reduce([layer.values == label for layer in volume.each_layer])
