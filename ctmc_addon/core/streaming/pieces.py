# SPDX-License-Identifier: GPL-3.0-or-later
"""The surface of a volume piece by piece, for surfaces that are not held in memory either.

Pieces are in RAS+ mm, at the alpha of the settings, in the order of the slices. One after the other they are the mesh
of the volume in memory; or, where the order of its vertices does not matter, they are cut where the values were, which
spares a look at all values beforehand.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import MeshError
from ..extraction.grid import Axis, make_axes
from ..extraction.marching_cubes import Counts, no_surface_text
from ..mesh.face_normals import vertex_normals
from ..mesh.triangle_mesh import SurfacePiece, SurfacePieces, blend
from ..parallel import map_steps, worker_count
from ..progress import PAUSE, Stages, Steps, finish
from ..settings import ReconstructionSettings
from ..volume.affine import transform_faces, transform_normals, transform_points
from ..volume.region import Box
from ..volume.scalar_field import ScalarField
from ..volume.slabs import SlabVolume
from ..volume.thresholding import check_threshold
from ..volume.volume import Volume
from .choice import field_steps
from .field_slabs import FieldSlabs
from .kept_pieces import KeptPieces, pieces_between_steps
from .parts import PartMaker
from .slab_parts import Regrouping, SlabPart, faces_of
from .slab_tasks import DistributedMaker, SlabWorkers

COUNTING, EXTRACTING = "Counting slab by slab", "Extracting slab by slab"


@dataclass(frozen=True)
class SurfaceFacts:
    """What is known of a surface besides its pieces.

    Parameters
    ----------
    threshold : float
        The gray value that was used.
    notes : tuple of str
    window : Box
        What was extracted, in voxel indices.
    slice_steps : int
    wrong_side : int or None
        As in `Reconstruction`.
    """

    threshold: float
    notes: tuple[str, ...]
    window: Box
    slice_steps: int
    wrong_side: int | None


class ValuesOfField:
    """A field in memory as one that is fetched."""

    skips_slices = True

    def __init__(self, field: ScalarField) -> None:
        self.values = field.values.view(np.uint8) if field.values.dtype == bool else field.values
        self.shape: tuple[int, int, int] = field.values.shape  # type: ignore[assignment]
        self.dtype = self.values.dtype

    def slices_steps(self, numbers: list[int]) -> Steps[NDArray[Any]]:
        """Fetch the values of slices with rising numbers, (slices, rows, columns)."""
        yield PAUSE
        run = bool(numbers) and len(numbers) == numbers[-1] - numbers[0] + 1
        return self.values[numbers[0] : numbers[-1] + 1] if run else self.values[numbers]


def surface_pieces_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
    normals: bool | None = None,
    any_order: bool = False,
) -> SurfacePieces[SurfaceFacts]:
    """Yield the pieces of a surface, and steps between them; before simplification.

    Parameters
    ----------
    normals : bool, optional
        Whether to give those of the gray values' gradient; by default as the settings ask.
    any_order : bool
        Whether vertices may stand in another order than in memory, which saves fetching all values twice. They do not
        where small components are dropped: which these are depends on sums in the order of the triangles.
    """
    field = yield from field_steps(volume, settings, threads, memory_limit)
    normals = settings.normals == "gradient" if normals is None else normals
    return (yield from field_pieces_steps(field, field.affine(volume), settings, threads, normals, any_order))


def field_pieces_steps(
    field: ScalarField | FieldSlabs,
    affine: NDArray[np.float64],
    settings: ReconstructionSettings,
    threads: int | None,
    normals: bool,
    any_order: bool,
    workers: SlabWorkers | None = None,
) -> SurfacePieces[SurfaceFacts]:
    """`surface_pieces_steps` of a field whose values have this affine."""
    axes = make_axes(field.window_in_values, settings.stride, settings.close_border)
    threads = worker_count(threads)

    def maker(normals: bool, workers: SlabWorkers | None) -> PartMaker:
        if workers is not None and isinstance(field, FieldSlabs):
            return DistributedMaker(field.again(), normals, settings.topology, workers)
        values = field.again() if isinstance(field, FieldSlabs) else ValuesOfField(field)
        return PartMaker(values, axes, float(field.level), normals, settings.topology, threads, settings.upper)

    def one_pass(normals: bool) -> SurfacePieces[SurfaceFacts]:
        placing = Placing(affine, settings.alpha, normals, None if ranges is None else Regrouping(ranges), threads)
        return _extracted_steps(field, maker(normals, workers), placing, settings.upper)

    drops = settings.keep_parts > 0 or settings.min_part_mm3 > 0
    ranges: list[tuple[int, int]] | None = None
    if any_order and not drops:
        return (yield from one_pass(normals))
    counting = maker(False, None).ranges_steps()
    stages = Stages({COUNTING: 3, EXTRACTING: 10})
    ranges = yield from stages.run(COUNTING, counting)
    if drops:
        extracting = KeptPieces(one_pass, settings.keep_parts, settings.min_part_mm3).pieces_steps(normals)
    else:
        extracting = one_pass(normals)
    return (yield from pieces_between_steps(extracting, *stages.shares[EXTRACTING]))


def counted_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    threads: int | None = None,
    memory_limit: int | None = None,
) -> Steps[Counts]:
    """The size of a surface before simplification, counted slab by slab."""
    field = yield from field_steps(volume, settings, threads, memory_limit)
    axes = make_axes(field.window_in_values, settings.stride, settings.close_border)
    values = field if isinstance(field, FieldSlabs) else ValuesOfField(field)
    maker = PartMaker(values, axes, float(field.level), False, settings.topology, worker_count(threads), settings.upper)
    return (yield from maker.counts_steps())


def _extracted_steps(
    field: ScalarField | FieldSlabs, maker: PartMaker, placing: Placing, upper: float | None
) -> SurfacePieces[SurfaceFacts]:
    """Yield all pieces once."""
    stages = Stages({EXTRACTING: 1})
    for steps in maker.parts_steps():
        parts = yield from stages.run(EXTRACTING, steps)
        yield from placing.add(parts)
    yield from placing.end()
    fetched = maker.values
    if isinstance(fetched, FieldSlabs):
        fetched.check()
    if not placing.faces:
        if isinstance(fetched, FieldSlabs):
            yield from fetched.check_extracted_steps()
        assert isinstance(field, ScalarField)
        check_threshold(field.level, _window(field, maker.axes), field.kind, field.place, upper)
        raise MeshError(no_surface_text(field.level))
    return SurfaceFacts(
        threshold=field.threshold,
        notes=field.notes,
        window=field.window,
        slice_steps=field.slice_steps,
        wrong_side=fetched.wrong_side if isinstance(fetched, FieldSlabs) else field.wrong_side,
    )


def _window(field: ScalarField, axes: tuple[Axis, Axis, Axis]) -> NDArray[Any]:
    x, y, z = axes
    return field.values[z.start : z.stop, y.start : y.stop, x.start : x.stop]


class Placing:
    """Takes parts and gives pieces: two parts later, as triangles and normals reach into the neighbors."""

    def __init__(
        self,
        affine: NDArray[np.float64],
        alpha: float,
        normals: bool,
        regrouping: Regrouping | None,
        threads: int,
    ) -> None:
        self.affine, self.alpha, self.normals, self.threads = affine, alpha, normals, threads
        self.regrouping = regrouping
        self.waiting: list[SlabPart] = []  # parts without a piece
        self.before: tuple[SlabPart, NDArray[np.int32]] | None = None
        self.faces = 0

    def add(self, parts: Sequence[SlabPart]) -> Iterator[SurfacePiece]:
        """Take the next parts."""
        for part in parts:
            self.waiting += [part] if self.regrouping is None else self.regrouping.add(part)
        yield from self._pieces(len(self.waiting) - 1)

    def end(self) -> Iterator[SurfacePiece]:
        """Give the rest."""
        yield from self._pieces(len(self.waiting))

    def _pieces(self, count: int) -> Iterator[SurfacePiece]:
        """Give the first so many of what waits."""
        if count < 1:
            return
        parts, before = self.waiting, self.before
        following = [*parts[1:], None]
        faces = finish(map_steps(lambda at: faces_of(parts[at], following[at]), range(count), self.threads))

        def piece(at: int) -> SurfacePiece:
            return self._piece(parts[at], faces[at], following[at], (parts[at - 1], faces[at - 1]) if at else before)

        pieces = finish(map_steps(piece, range(count), self.threads))
        self.before, self.waiting = (parts[count - 1], faces[-1]), parts[count:]
        for made in pieces:
            self.faces += len(made.faces)
            yield made

    def _piece(
        self,
        part: SlabPart,
        faces: NDArray[np.int32],
        following: SlabPart | None,
        before: tuple[SlabPart, NDArray[np.int32]] | None,
    ) -> SurfacePiece:
        midpoints, linear = (transform_points(self.affine, points).astype(np.float32) for points in part.vectors[:2])
        normals = None
        if self.normals:
            normals = completed_normals(part, faces, following, before)
            normals = transform_normals(self.affine, normals).astype(np.float32)
        return SurfacePiece(blend(midpoints, linear, self.alpha), transform_faces(self.affine, faces), normals)


def completed_normals(
    part: SlabPart,
    faces: NDArray[np.int32],
    following: SlabPart | None,
    before: tuple[SlabPart, NDArray[np.int32]] | None,
) -> NDArray[np.float32]:
    """The normals of a part, those without gradient or on a cap from the mesh, as gradients.py completes them."""
    normals = part.vectors[2]
    missing = (normals[:, 0] == 0) & (normals[:, 1] == 0) & (normals[:, 2] == 0)
    if not missing.any():
        return normals
    points, blocks, first = [part.vectors[1]], [faces], 0
    if before is not None:
        points, first = [before[0].vectors[1], *points], len(before[0].vectors[1])
        blocks = [before[1], faces + np.int32(first)]
    if following is not None:
        points.append(following.vectors[1])
    around, triangles = np.concatenate(points), np.concatenate(blocks)
    wanted = np.zeros(len(around), bool)
    wanted[first : first + len(normals)] = missing
    touched = wanted.take(triangles[:, 0]) | wanted.take(triangles[:, 1]) | wanted.take(triangles[:, 2])
    normals = normals.copy()
    normals[missing] = vertex_normals(around, triangles[touched])[wanted]
    return normals
