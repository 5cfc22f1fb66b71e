# SPDX-License-Identifier: GPL-3.0-or-later
"""From a volume to the surface of one field: a threshold's, or that of a label by itself.

Volume -> field, some slices at a time -> pieces, in RAS+ mm -> without small components -> sink, or simplified
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..budget import Budget
from ..described import AUTO
from ..errors import MemoryLimitError
from ..extraction.field_pieces import surface_pieces_steps
from ..memory import give_back
from ..mesh.faces_shown import face_notes
from ..mesh.kept_pieces import KeptPieces
from ..mesh.triangle_mesh import Held, Pieces, Surface, at_alpha_steps, held_steps, replayed_steps
from ..plan import required_steps
from ..progress import Steps, WithResult, finish
from ..reconstruction import Reconstruction
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink, Taken
from ..smoothing.prepare import field_steps
from ..volume.field import Field
from ..volume.volume import Volume
from .finish import (
    CHOOSING,
    EXTRACTING,
    KEEPING,
    LARGEST_COLLAPSED_MM3,
    PREPARING,
    SIMPLIFYING,
    WRITING,
    Finish,
    described,
    drops_components,
    goals_of,
    timed,
)
from .request import MadeSurface, Scope, scope_of

if TYPE_CHECKING:
    from ..mesh.angles.alpha_choice import AlphaChoice

MOST_SAMPLED = 1 << 19  # vertices that are looked at for a face


def reconstruct(volume: Volume, settings: ReconstructionSettings, budget: Budget | None = None) -> Reconstruction:
    """Make a surface from a volume.

    Parameters
    ----------
    volume : Volume
        In memory, or in a file that is read a slab at a time. The surface has the same bytes.
    settings : ReconstructionSettings
    budget : Budget, optional
        Threads and memory; by default what the machine has. The result does not depend on them.

    Raises
    ------
    CtmcError
        With one sentence for the user: no surface at these settings, NaN voxels, too little memory.

    Examples
    --------
    >>> distance = np.sqrt(((np.indices((24, 24, 24)) - 11.5) ** 2).sum(axis=0))
    >>> result = reconstruct(Volume(-distance, np.eye(4)), ReconstructionSettings(threshold=-9))
    >>> result.mesh.closed, round(result.mesh.volume / (4 / 3 * np.pi * 9**3), 2)
    (True, 0.99)
    """
    return finish(reconstruct_steps(volume, settings, budget))


def reconstruct_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    sink: Sink = HOLD,
    scope: Scope | None = None,
) -> Steps[Reconstruction]:
    """`reconstruct` as steps; closing the generator cancels.

    Parameters
    ----------
    sink : Sink
        Where the surface goes; by default it is held. What went into a file is not in the result.
    scope : Scope, optional
        Of volume and settings, where it is known already.
    """
    making = FieldSurface(volume, settings, budget or Budget(), sink, scope=scope)
    yield from making.field_steps()
    return (yield from making.result_steps())


def result_and_full_steps(
    volume: Volume, settings: ReconstructionSettings, budget: Budget | None = None, scope: Scope | None = None
) -> Steps[MadeSurface]:
    """`reconstruct_steps`, and what `full_steps` returns, to be simplified again; None where that does not fit."""
    making = FieldSurface(volume, settings, budget or Budget(), HOLD, scope=scope)
    yield from making.field_steps()
    if not settings.simplifies_here:
        full = yield from making.full_steps()
        return MadeSurface((yield from making.finished_steps(full, None)), full)
    try:
        full = yield from making.full_steps()
        return MadeSurface((yield from making.simplified_steps(full)), full)
    except (MemoryLimitError, MemoryError):
        give_back()  # the full surface, which went with its steps
    return MadeSurface((yield from making.result_steps()))


def full_steps(volume: Volume, settings: ReconstructionSettings, budget: Budget | None = None) -> Steps[Reconstruction]:
    """Return the full surface: all triangles, before the built-in simplifier, whatever the settings ask of it."""
    making = FieldSurface(volume, settings, budget or Budget(), HOLD, full=True)
    yield from making.field_steps()
    return (yield from making.full_steps())


class _Timed:
    """Pieces whose seconds are counted, and of whose vertices a sample is kept."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.sample = np.empty((0, 3), np.float32)
        self._every, self._seen = 1, 0

    def passed_steps(self, pieces: Pieces, sampled: bool) -> Pieces:
        """Yield the pieces."""
        source = WithResult(pieces)
        start = time.perf_counter()
        for item in source:
            self.seconds += time.perf_counter() - start
            if sampled and isinstance(item, Surface):
                self._take(item.linear)
            yield item
            start = time.perf_counter()
        self.seconds += time.perf_counter() - start
        return source.result

    def _take(self, points: NDArray[np.float32]) -> None:
        self.sample = np.concatenate([self.sample, points[-self._seen % self._every :: self._every]])
        self._seen += len(points)
        while len(self.sample) > MOST_SAMPLED:
            self.sample, self._every = self.sample[::2].copy(), 2 * self._every


class FieldSurface(Finish):
    """The surface of one field, from the values to the report."""

    field: Field

    def __init__(
        self,
        volume: Volume,
        settings: ReconstructionSettings,
        budget: Budget,
        sink: Sink,
        full: bool = False,
        scope: Scope | None = None,
    ) -> None:
        super().__init__(settings, budget, sink, full)
        self.volume, self.scope = volume, scope or scope_of(volume, settings)
        self.choice: AlphaChoice | None = None
        self._held: Held | None = None  # the pieces of the surface, until it is taken
        self._held_seconds = 0.0
        self.removed_components = 0
        self.scope.require_stride()  # before any value is prepared

    def field_steps(self) -> Steps[None]:
        """Prepare the field that the surface is extracted from, and refuse a surface that does not fit."""
        keeps = not self._shows_normals
        preparing = field_steps(self.volume, self.settings, self.budget, with_surface=keeps, region=self.scope.region)
        self.field = yield from self.stages.run(PREPARING, preparing)
        if not self.full:  # the settings say nothing of the full surface
            yield from required_steps(self.volume, self.settings, self.budget, self.sink, self.field)
        self.seconds[PREPARING] = self.stages.seconds[PREPARING]

    def result_steps(self) -> Steps[Reconstruction]:
        """The surface that the settings ask for; simplified as it comes, so that memory follows what is left."""
        if not self.settings.simplifies_here:
            full = yield from self.full_steps()
            return (yield from self.finished_steps(full, None))
        yield from self._choose_steps(holds=False)
        pieces, extracting = self._pieces_steps(joined=False)
        from ..simplification.simplify import simplified_pieces_steps
        from ..simplification.whole import Goal

        goal = Goal(*goals_of(self.settings), LARGEST_COLLAPSED_MM3)
        with self.budget.refusal("simplifying the surface", "choose a region or a larger stride"):
            reducing = simplified_pieces_steps(at_alpha_steps(pieces, self.settings.alpha_number), goal, self.budget)
            start = time.perf_counter()
            reduced = yield from self.stages.run(SIMPLIFYING, reducing)
        self._count(SIMPLIFYING, time.perf_counter() - start, extracting)
        mesh = reduced.simplification.mesh
        full = self._described(Taken(mesh, wrong_side=reduced.info), reduced.full_faces, extracting[0].sample)
        return (yield from self.finished_steps(full, reduced.simplification))

    def full_steps(self) -> Steps[Reconstruction]:
        """The full surface, taken by the sink."""
        yield from self._choose_steps(self.sink.holds)
        pieces, extracting = self._pieces_steps(joined=self.sink.holds)
        start = time.perf_counter()
        taking = self.sink.full_steps(pieces, self.settings.alpha_number)
        with self.budget.refusal("the surface", "use a larger stride or a region"):
            taken = yield from self.stages.run(EXTRACTING, taking)
        self._count("" if self.sink.holds else WRITING, time.perf_counter() - start, extracting)
        faces = len(taken.mesh.faces) if taken.measured is None else taken.measured.faces
        return self._described(taken, faces, extracting[0].sample)

    def _choose_steps(self, holds: bool) -> Steps[None]:
        """Choose alpha from the full surface where the settings ask for that.

        The pieces are kept for what comes next where the surface is held, else one at a time is in memory.
        """
        if self.settings.alpha == AUTO:
            with self.budget.refusal("the surface", "use a larger stride or a region"):
                self.choice = yield from self.stages.run(CHOOSING, self._choice_steps(holds))
            self.settings = replace(self.settings, alpha=self.choice.alpha)
            self.seconds[CHOOSING] = self.stages.seconds[CHOOSING] - self._held_seconds

    def _choice_steps(self, holds: bool) -> Steps[AlphaChoice]:
        from ..mesh.angles.alpha_choice import chosen_alpha_steps, kept_alpha_steps

        if holds:
            extracting = _Timed()
            pieces = self._extracted_steps(self._shows_normals, joined=True)
            self._held = yield from held_steps(extracting.passed_steps(pieces, sampled=False))
            self._held_seconds = extracting.seconds

        def one_pass(normals: bool) -> Pieces:
            return self._extracted_steps(normals, joined=False) if self._held is None else replayed_steps(*self._held)

        def kept_pass(alpha: float) -> Pieces:
            return self._kept_steps(one_pass, False, holds, replace(self.settings, alpha=alpha))

        angle = self.settings.min_angle_deg
        if drops_components(self.settings):
            return (yield from kept_alpha_steps(kept_pass, angle))
        return (yield from chosen_alpha_steps(lambda: one_pass(False), angle))

    @property
    def _shows_normals(self) -> bool:
        return self.settings.normals == "gradient" and self.sink.normals

    def _pieces_steps(self, joined: bool) -> tuple[Pieces, tuple[_Timed, _Timed]]:
        """The pieces of the surface without small components, and who counts their seconds, without and with these.

        They may be large where they are to be `joined`.
        """
        extracting, keeping = _Timed(), _Timed()

        def one_pass(normals: bool) -> Pieces:
            pieces = self._extracted_steps(normals, joined)
            return extracting.passed_steps(pieces, sampled=not extracting.sample.size)

        if not drops_components(self.settings):
            return one_pass(self._shows_normals), (extracting, extracting)
        kept = self._kept_steps(one_pass, self._shows_normals, joined, self.settings)
        return keeping.passed_steps(kept, sampled=False), (extracting, keeping)

    def _extracted_steps(self, normals: bool, joined: bool) -> Pieces:
        """All pieces of the surface; those that are held go."""
        held, self._held = self._held, None
        if held is not None:
            return replayed_steps(*held)
        pieces = surface_pieces_steps(self.field, self.budget, normals, joined)
        return self._fitting_steps(pieces) if joined else pieces

    def _fitting_steps(self, pieces: Pieces) -> Pieces:
        """The pieces, as long as all of them fit together."""
        faces = needed = 0
        source = WithResult(pieces)
        for item in source:
            if isinstance(item, Surface):
                faces += len(item.faces)
                vectors = (item.midpoints, item.linear, item.faces, item.normals)
                needed += sum(array.nbytes for array in vectors if array is not None)
                what = f"a surface of at least {faces} triangles"
                self.budget.require(needed, what, "use a larger stride or a region")
            yield item
        return source.result

    def _kept_steps(
        self, one_pass: Callable[[bool], Pieces], normals: bool, holds: bool, settings: ReconstructionSettings
    ) -> Pieces:
        """The pieces without small components: extracted again for each look, or held where the sink `holds`."""
        if holds:
            held = yield from held_steps(one_pass(normals))
            one_pass = lambda _: replayed_steps(*held)  # noqa: E731
        kept = KeptPieces(one_pass, settings.alpha_number, settings.keep_parts, settings.min_part_mm3, holds)
        wrong_side = yield from kept.pieces_steps(normals)
        self.removed_components = kept.removed
        return wrong_side

    def _count(self, name: str, seconds: float, pieces: tuple[_Timed, _Timed]) -> None:
        """Divide the seconds of a stage between it and the stages that made its pieces."""
        extracting, keeping = pieces
        self.seconds[EXTRACTING] = self._held_seconds + extracting.seconds
        if keeping is not extracting:
            self.seconds[KEEPING] = keeping.seconds - extracting.seconds
        if name:
            self.seconds[name] = max(0.0, seconds - keeping.seconds)

    def _described(self, taken: Taken, full_faces: int, sample: NDArray[np.float32]) -> Reconstruction:
        """Return the reconstruction of a mesh, with its settings, counts and notes."""
        volume, field = self.volume, self.field
        return described(
            volume,
            self.scope,
            self.settings,
            taken,
            notes=volume.notes + field.notes + face_notes(volume.kind, field.threshold, sample),
            slice_steps=field.slice_steps,
            choice=self.choice,
            threshold=field.threshold,
            full_faces=full_faces,
            stages=timed((PREPARING, CHOOSING, EXTRACTING, KEEPING), self.seconds),
            removed_components=self.removed_components,
            self_intersections=0,
        )
