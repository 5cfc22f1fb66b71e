# SPDX-License-Identifier: GPL-3.0-or-later
"""Keep the structures that `ctmc segment` makes: their names, labels and colors, from a file and back to one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .. import readers
from ..core import LabelError, OutputError, Steps, Volume, mm_text
from ..core.files.file_names import printable
from ..core.files.label_files import Segment
from ..core.segmentation import MOST_STRUCTURES, Flags, Layers, Window, margin_steps, require_count
from ..core.volume import (
    ValueKind,
    index_to_index,
    label_extents_steps,
    not_a_label_steps,
    placed_labels_steps,
    structure_color,
)
from .flags.arguments import with_flags

RGB = tuple[int, int, int]


class Structures:
    """Structures on the grid of a CT, by name.

    Parameters
    ----------
    shape : (slices, rows, columns)

    Attributes
    ----------
    layers : Layers
    label_of : dict of str to int
        The label of each structure.
    notes : list of str
        Notes on assumptions, and on results that a person may not expect.
    """

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self.layers = Layers(shape)
        self.label_of: dict[str, int] = {}
        self.colors: dict[str, RGB] = {}
        self.notes: list[str] = []

    def mask(self, name: str) -> Flags:
        """Return the mask of a structure."""
        return self.layers.mask(self.label_of[name])

    def add(self, name: str, mask: Flags, window: Window) -> None:
        """Add voxels of a window to a structure; a new one gets the label after the largest, or the first free one."""
        if name in self.label_of:
            whole = self.mask(name)
            whole[window] |= mask
            self.layers.put(self.label_of[name], whole)
            return
        used = set(self.label_of.values())
        require_count(len(used) + 1)
        label = max(used, default=0) + 1
        if label > MOST_STRUCTURES:
            label = next(label for label in range(1, MOST_STRUCTURES + 1) if label not in used)
        self.label_of[name] = label
        self.layers.put(label, mask, window)

    def read_steps(self, path: str, ct: Volume) -> Steps[None]:
        """Take the labels of a file, which lie on the grid of a CT in any order of the axes, or on a part of it.

        They keep their numbers, names and colors. If one is above 255, all are renumbered, and of two with one
        name the second gets its number as a second name; a note says either.
        """
        read = yield from readers.read_volume_steps(path)
        if read.kind != ValueKind.LABEL:
            value = yield from not_a_label_steps(read)
            what = f"{read.kind.plural}, such as {value}" if value else read.kind.plural
            raise LabelError(f"{read.name} holds {what}, not labels; give a label volume to --from")
        labels = yield from placed_labels_steps(read, ct)
        extents = yield from label_extents_steps(labels)
        if not extents:
            raise LabelError(f"{read.name} has no labeled voxel; leave --from out")
        require_count(len(extents))
        self.notes += map(with_flags, labels.notes)
        kept = max(extents) <= MOST_STRUCTURES
        if not kept:
            self.notes.append(
                f"Labels of {read.name} are renumbered, because one is {max(extents)} and the largest possible is 255."
            )
        for number, (label, extent) in enumerate(extents.items(), 1):
            name = called = printable(labels.label_names.get(label, "")) or f"label {label}"
            while name in self.label_of:
                name = f"{name} {label}"
            if name != called:
                self.notes.append(f"{read.name} has two structures called {called}; the second is renamed {name}.")
            x, y, z = (slice(*side) for side in extent.box)
            mask = np.zeros((z.stop - z.start, y.stop - y.start, x.stop - x.start), bool)
            for layer in labels.each_layer:
                mask |= layer.samples(*(range(side.start, side.stop) for side in (z, y, x))) == label
            self.label_of[name] = label if kept else number
            self.layers.put(self.label_of[name], mask, (z, y, x))
            if label in labels.label_colors:
                self.colors[name] = labels.label_colors[label]

    def grow_steps(self, margins: Mapping[str, float], spacing_mm: tuple[float, float, float]) -> Steps[None]:
        """Grow and shrink structures; refuse one that vanishes, and note unchanged ones."""
        for name, margin_mm in margins.items():
            if name not in self.label_of:
                raise LabelError(
                    f"--margin names '{name}', but no structure has that name; there are {', '.join(self.label_of)}"
                )
            before = self.mask(name)
            mask = yield from margin_steps(before, spacing_mm, margin_mm)
            if not mask.any():
                raise LabelError(f"nothing is left of {name} with a margin of {mm_text(margin_mm)}; shrink it less")
            if margin_mm and np.array_equal(mask, before):
                step_mm = min(spacing_mm)
                self.notes.append(
                    f"A margin of {mm_text(margin_mm)} does not change {name}, because voxels are "
                    f"{mm_text(step_mm, 3)} apart."
                )
            self.layers.put(self.label_of[name], mask)
        self.layers.compact()

    def segments(self, in_order: bool) -> list[Segment]:
        """Return the segments for a file; `in_order` numbers them 1, 2, 3, as DICOM does."""
        segments = []
        for number, (name, label) in enumerate(self.label_of.items(), 1):
            color = structure_color(label, self.colors.get(name), name).rgb
            segments.append(Segment(name, color, number if in_order else label, self.layers.layer_of[label]))
        return segments

    def check_steps(self, path: Path, segments: list[Segment], affine: NDArray[np.float64]) -> Steps[None]:
        """Read a file back; an `OutputError` where a voxel or the grid is not what was written.

        DICOM leaves out slices without a structure, so what comes back may be a part of the CT.
        """
        back = yield from readers.read_volume_steps(path)
        to_ct = index_to_index(back.affine, affine)
        first = np.rint(to_ct[:3, 3]).astype(int)
        x, y, z = (slice(start, start + side) for start, side in zip(first.tolist(), back.size, strict=True))
        same = np.allclose(to_ct[:3, :3], np.eye(3), atol=1e-3) and np.allclose(to_ct[:3, 3], first, atol=1e-2)
        layers = [layer.values for layer in back.each_layer]
        for segment, voxels in zip(segments, self.layers.voxels().values(), strict=True):
            part = self.mask(segment.name)[z, y, x]
            same = same and np.count_nonzero(part) == voxels
            same = same and any(np.array_equal(values == segment.label, part) for values in layers)
        if not same:
            raise OutputError(f"{path.name} does not read back as it was written; choose another disk or format")
