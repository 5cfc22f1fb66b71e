# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole surface of a volume whose values are fetched a slab at a time, and only once.

Parts are kept as they come; when all are there, their layers are grouped as a volume in memory would have been cut,
and faces are filled in. The bytes are those of `extract_steps`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..extraction.active_voxels import Slab
from ..extraction.faces import fill_faces
from ..extraction.gradients import complete_normals_steps
from ..memory import require
from ..mesh.triangle_mesh import Surface
from ..parallel import map_steps, worker_count
from ..progress import PAUSE, Stages, Steps
from .field_slabs import FieldSlabs
from .parts import PartMaker
from .slab_parts import Regrouping, SlabPart

EXTRACTING, PUTTING, TRIANGLES, COMPLETING = STAGES = (
    "Extracting slab by slab",
    "Putting slabs together",
    "Placing triangles",
    "Completing normals",
)
REMEDY = "simplify it, use a larger stride or a region"


def slab_surface_steps(
    field: FieldSlabs, normals: bool, topology: str, threads: int | None = None, memory_limit: int | None = None
) -> Steps[Surface]:
    """The surface of values that are fetched, both ends of alpha, in index space.

    Raises
    ------
    ThresholdError, LabelError, VolumeError, MeshError, MemoryLimitError
    """
    threads = worker_count(threads)
    stages = Stages(dict(zip(STAGES, (90, 3, 5, 2), strict=True)))
    maker = PartMaker(field, field.axes(), float(field.level), normals, topology, threads)
    parts = yield from stages.run(EXTRACTING, _all_parts_steps(maker, memory_limit))
    field.check()
    first_face = np.cumsum([0] + [part.slab.face_count for part in parts], dtype=np.int64)
    if first_face[-1] == 0:
        yield from field.check_extracted_steps()
    vectors, slabs = yield from stages.run(PUTTING, _together_steps(maker, parts))
    first_vertex = np.cumsum([0] + [slab.vertex_count for slab in slabs], dtype=np.int64)
    first_face = np.cumsum([0] + [slab.face_count for slab in slabs], dtype=np.int64)
    faces = np.empty((first_face[-1], 3), np.int32)

    def fill(number: int) -> None:
        following = slabs[number + 1] if number + 1 < len(slabs) else None
        out = faces[first_face[number] : first_face[number + 1]]
        fill_faces(slabs[number], following, int(first_vertex[number]), out)

    yield from stages.run(TRIANGLES, map_steps(fill, range(len(slabs)), threads))
    if normals:
        yield from stages.run(COMPLETING, complete_normals_steps(vectors[2], vectors[1], faces))
    return Surface(vectors[0], vectors[1], faces, vectors[2] if normals else None)


def _all_parts_steps(maker: PartMaker, memory_limit: int | None) -> Steps[list[SlabPart]]:
    parts: list[SlabPart] = []
    vertices = faces = 0
    for steps in maker.parts_steps():
        made = yield from steps
        parts += made
        vertices += sum(part.slab.vertex_count for part in made)
        faces += sum(part.slab.face_count for part in made)
        if vertices > np.iinfo(np.int32).max:
            raise MeshError(f"{vertices} vertices are more than a mesh can number; use a larger stride")
        needed = 12 * faces + 12 * (2 + maker.normals) * vertices
        require(needed, f"a surface of more than {faces} triangles", REMEDY, memory_limit)
    return parts


def _together_steps(maker: PartMaker, parts: list[SlabPart]) -> Steps[tuple[list[NDArray[np.float32]], list[Slab]]]:
    """All vertices in the order of a volume in memory, and the slabs; `parts` are used up."""
    regrouping = Regrouping(maker.ranges())
    grouped: list[SlabPart] = []
    parts.reverse()
    while parts:
        yield PAUSE
        grouped += regrouping.add(parts.pop())
    slabs = [part.slab for part in grouped]
    pieces = [list(part.vectors) for part in grouped]
    del grouped
    count = sum(slab.vertex_count for slab in slabs)
    vectors: list[NDArray[np.float32]] = []
    for _ in range(2 + maker.normals):
        together = np.empty((count, 3), np.float32)
        start = 0
        for of_slab in pieces:
            piece = of_slab.pop(0)
            together[start : start + len(piece)] = piece
            start += len(piece)
            yield PAUSE
        vectors.append(together)
    return vectors, slabs
