# SPDX-License-Identifier: GPL-3.0-or-later
"""Write drawings for other programs: a `.seg.nrrd` next to the .blend, whenever that is saved.

The .blend itself holds the drawing, so this file may be moved or deleted; 3D Slicer opens it, and so does Load Labels.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ....blender.colors import srgb
from ....core import CtmcError, finish
from ....core.files.atomic_write import whole_file
from ....core.files.file_names import file_name
from ....core.files.label_files import Segment, write_labels_steps
from ....core.segmentation import layers_of
from ...properties.surface.structures import called
from .. import change_events, session
from ..ct import volumes
from ..ct.stored_paths import states_in
from . import drawings, masks

SUFFIX = " drawn.seg.nrrd"  # A segmentation of a user next to the .blend has another name and is not overwritten.
SHORT = 4  # Letters of a fingerprint in a file name.


def _path_of(blend: str, scene: bpy.types.Scene, ct: Any) -> Path:
    """Return the path of the drawing on a CT of a scene: named after the .blend, and scene and CT if there are several.

    CTs may share a name, such as that of a file in each patient's folder, so the fingerprint tells them apart.
    """
    drawn = {(each.name, item.fingerprint) for each in bpy.data.scenes for item in each.ctmc_draw.structures}
    fingerprint = ct.volume_fingerprint
    called_ct = volumes.called_as(ct, volumes.require_ct(fingerprint))
    stem = Path(blend).stem + (f" {scene.name} {called_ct} {fingerprint[:SHORT]}" if len(drawn) > 1 else "")
    return Path(blend).with_name(file_name(stem) + SUFFIX)


def after_save(blend: str, *_: Any) -> None:
    """Write the drawings of a saved .blend, on every CT in memory; the panel shows errors."""
    for scene in bpy.data.scenes if blend else ():
        for ct in states_in(scene):
            loaded = volumes.ct_of(ct.volume_fingerprint)
            if loaded is None or loaded.file is not None:
                continue
            try:
                write(_path_of(blend, scene, ct), scene, ct)
            except (CtmcError, OSError, MemoryError) as error:
                session.of(scene).message = str(error)


def write(path: Path, scene: bpy.types.Scene, ct: Any) -> None:
    """Write the drawing on a CT of a scene, unless it is empty or written already."""
    items = [(item, masks.of(scene, item)) for item in drawings.structures_of(ct)]
    items = [(item, drawn) for item, drawn in items if any(drawn.unpacked.values())]
    lines = [next(line for line in ct.labels if line.source == item.key) for item, _ in items]
    state = [(called(line), tuple(line.color), drawn.revision) for line, (_, drawn) in zip(lines, items, strict=True)]
    written = session.of(scene).written
    if not items or (written.get(str(path)) == state and path.exists()):
        return
    layers, used = layers_of([drawn.mask for _, drawn in items])
    segments = [
        Segment(called(line), srgb(line.color), label, layer)
        for label, (line, layer) in enumerate(zip(lines, used, strict=True), 1)
    ]
    affine = np.asarray(volumes.require_ct(ct.volume_fingerprint).volume.affine)
    with whole_file(path) as temporary_path:
        finish(write_labels_steps(temporary_path, layers, segments, affine))
    written[str(path)] = state


register, unregister = change_events.following(save_post=after_save)
