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
from .slab_tasks import DistributedMaker, SlabWorkers

EXTRACTING, PUTTING = "Extracting slab by slab", "Putting slabs together"
GROUPING, TRIANGLES, COMPLETING = "Grouping slabs", "Placing triangles", "Completing normals"
REMEDY = "simplify it, use a larger stride or a region"


def slab_surface_steps(
    field: FieldSlabs,
    normals: bool,
    topology: str,
    threads: int | None = None,
    memory_limit: int | None = None,
    workers: SlabWorkers | None = None,
) -> Steps[Surface]:
    """The surface of values that are fetched, here or by workers, both ends of alpha, in index space.

    Raises
    ------
    ThresholdError, LabelError, VolumeError, MeshError, MemoryLimitError
    """
    threads = worker_count(threads)
    stages = Stages({EXTRACTING: 9, PUTTING: 1})
    if workers is None:
        maker = PartMaker(field, field.axes(), float(field.level), normals, topology, threads, field.settings.upper)
    else:
        maker = DistributedMaker(field, normals, topology, workers)
    parts = yield from stages.run(EXTRACTING, _all_parts_steps(maker, memory_limit))
    field.check()
    if not any(part.slab.face_count for part in parts):
        yield from field.check_extracted_steps()
    return (yield from stages.run(PUTTING, joined_surface_steps(parts, maker.ranges(), threads)))


def joined_surface_steps(parts: list[SlabPart], ranges: list[tuple[int, int]], threads: int) -> Steps[Surface]:
    """The surface of all parts from the first layer to the last, in the order of a volume in memory.

    Parameters
    ----------
    parts : list of SlabPart
        Used up.
    ranges : list of (low, high)
        In which the vertices are numbered: `PartMaker.ranges`.
    threads : int
    """
    stages = Stages({GROUPING: 3, TRIANGLES: 5, COMPLETING: 2})
    vectors, slabs = yield from stages.run(GROUPING, _grouped_steps(parts, ranges))
    first_vertex = np.cumsum([0] + [slab.vertex_count for slab in slabs], dtype=np.int64)
    first_face = np.cumsum([0] + [slab.face_count for slab in slabs], dtype=np.int64)
    faces = np.empty((first_face[-1], 3), np.int32)

    def fill(number: int) -> None:
        following = slabs[number + 1] if number + 1 < len(slabs) else None
        out = faces[first_face[number] : first_face[number + 1]]
        fill_faces(slabs[number], following, int(first_vertex[number]), out)

    yield from stages.run(TRIANGLES, map_steps(fill, range(len(slabs)), threads))
    midpoints, linear, *normals = vectors
    if normals:
        yield from stages.run(COMPLETING, complete_normals_steps(normals[0], linear, faces))
    return Surface(midpoints, linear, faces, normals[0] if normals else None)


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


def _grouped_steps(
    parts: list[SlabPart], ranges: list[tuple[int, int]]
) -> Steps[tuple[list[NDArray[np.float32]], list[Slab]]]:
    """All vertices in the order of a volume in memory, and the slabs; `parts` are used up."""
    regrouping = Regrouping(ranges)
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
    while pieces[0]:
        together = np.empty((count, 3), np.float32)
        start = 0
        for of_slab in pieces:
            piece = of_slab.pop(0)
            together[start : start + len(piece)] = piece
            start += len(piece)
            yield PAUSE
        vectors.append(together)
    return vectors, slabs
