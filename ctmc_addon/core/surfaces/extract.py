# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the surface of one field: of a threshold, or of a label by itself.

Volume -> field, some slices at a time -> pieces, in RAS+ mm -> without small components -> sink, or simplified
"""

from __future__ import annotations

import time
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import MemoryLimitError
from ..extraction.field_pieces import surface_pieces_steps
from ..machine.budget import Budget
from ..machine.memory import give_back
from ..measures.reconstruction import Reconstruction
from ..mesh.faces_shown import face_notes
from ..mesh.pieces.kept_pieces import KeptPieces
from ..mesh.pieces.spool import Spool, SpooledPieces
from ..mesh.triangle_mesh import Pieces, Surface, at_alpha_steps
from ..planning.plan import required_steps
from ..progress import Steps, WithResult
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink, Taken
from ..smoothing.prepare import field_steps
from ..volume.field import ScalarField
from ..volume.volume import Volume
from .finish import (
    CHOOSING,
    EXTRACTING,
    KEEPING,
    PREPARING,
    SIMPLIFYING,
    WRITING,
    Finish,
    described,
    goal_of,
    limits_of,
    weights_of,
)
from .request import MadeSurface, Scope, scope_of

T = TypeVar("T")

MOST_SAMPLED = 1 << 19  # Vertices in the sample that shows whether a face was reconstructed.


def reconstruct_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    budget: Budget | None = None,
    sink: Sink = HOLD,
    scope: Scope | None = None,
) -> Steps[Reconstruction]:
    """Make a surface from a volume, as steps; closing the generator cancels.

    Parameters
    ----------
    sink : Sink
        Sink that receives the surface; by default it is held. The result lacks data that went into a file.
    scope : Scope, optional
        Scope of volume and settings, if it is already known.
    """
    making = FieldSurface(volume, settings, budget or Budget(), sink, scope=scope)
    yield from making.field_steps()
    return (yield from making.result_steps())


def result_and_full_steps(
    volume: Volume, settings: ReconstructionSettings, budget: Budget | None = None, scope: Scope | None = None
) -> Steps[MadeSurface]:
    """Return the result and the full surface, to be simplified again; None if that does not fit in memory."""
    making = FieldSurface(volume, settings, budget or Budget(), HOLD, scope=scope)
    yield from making.field_steps()
    try:
        full = yield from making.full_steps()
        return MadeSurface((yield from making.simplified_steps(full)), full)
    except (MemoryLimitError, MemoryError):
        if not settings.simplifies_here:
            raise
        give_back()  # The full surface was released with its steps.
        making.stages.seconds = {PREPARING: making.stages.seconds[PREPARING]}  # Seconds are those of one attempt.
    return MadeSurface((yield from making.result_steps()))


def full_steps(volume: Volume, settings: ReconstructionSettings, budget: Budget | None = None) -> Steps[Reconstruction]:
    """Return the full surface, with all triangles, even if the settings ask for simplification."""
    making = FieldSurface(volume, settings, budget or Budget(), HOLD, full=True)
    yield from making.field_steps()
    return (yield from making.full_steps())


class _Timed:
    """Time the production of pieces and keep a sample of their vertices."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.sample = np.empty((0, 3), np.float32)
        self._every, self._seen = 1, 0

    def passed_steps(self, pieces: Pieces) -> Pieces:
        """Yield the pieces."""
        source = WithResult(pieces)
        start = time.perf_counter()
        for item in source:
            self.seconds += time.perf_counter() - start
            if isinstance(item, Surface):
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
    """Make the surface of one field, from the values to the report."""

    field: ScalarField

    def __init__(
        self,
        volume: Volume,
        settings: ReconstructionSettings,
        budget: Budget,
        sink: Sink,
        full: bool = False,
        scope: Scope | None = None,
    ) -> None:
        super().__init__(settings, budget, sink, weights_of(settings, sink, full))
        self.volume, self.scope, self.full = volume, scope or scope_of(volume, settings), full
        self._extracting = _Timed()
        self.removed_components = 0
        self.scope.require_stride()  # Refuse a stride before any value is prepared.

    def field_steps(self) -> Steps[None]:
        """Prepare the field that the surface is extracted from, and refuse a surface that does not fit."""
        keeps = not self._shows_normals
        preparing = field_steps(self.volume, self.settings, self.budget, with_surface=keeps, region=self.scope.region)
        self.field = yield from self.stages.run(PREPARING, preparing)
        if not self.full:  # The plan is for what the settings ask, which may be simplified.
            yield from required_steps(self.volume, self.settings, self.budget, self.sink, self.field)

    def result_steps(self) -> Steps[Reconstruction]:
        """Make the surface that the settings ask for; simplify as it comes, so that only the rest takes memory."""
        if not self.settings.simplifies_here:
            return (yield from self.finished_steps((yield from self.full_steps())))
        from ..simplification.simplify import simplified_pieces_steps
        from ..simplification.whole import Goal

        with self._spool(joined=False) as spool:
            pieces = yield from self._pieces_steps(spool, joined=False)
            with self.budget.refusal("simplifying the surface", "choose a region or a larger stride"):
                pieces_at_alpha = at_alpha_steps(pieces, self.settings.alpha_number)
                reducing = simplified_pieces_steps(pieces_at_alpha, Goal(**goal_of(self.settings)), self.budget)
                reduced = yield from self._taking_steps(SIMPLIFYING, SIMPLIFYING, reducing)
        simplification = reduced.simplification
        full = self._described(Taken(simplification.mesh, wrong_side=reduced.info), reduced.full_faces)
        return (yield from self.finished_steps(self.simplified(full, simplification)))

    def full_steps(self) -> Steps[Reconstruction]:
        """Make the full surface, and hand it to the sink."""
        holds = self.sink.holds
        with self._spool(joined=holds) as spool:
            pieces = yield from self._pieces_steps(spool, joined=holds)
            taking = self.sink.full_steps(pieces, self.settings.alpha_number)
            last = next((name for name in (KEEPING, CHOOSING) if name in self.stages.seconds), EXTRACTING)
            name = last if holds else WRITING
            with self.budget.refusal("the surface", "use a larger stride or a region"):
                taken = yield from self._taking_steps(name, EXTRACTING if last == EXTRACTING else name, taking)
        faces = len(taken.mesh.faces) if taken.measured is None else taken.measured.faces
        return self._described(taken, faces)

    def _taking_steps(self, name: str, shown: str, steps: Steps[T]) -> Steps[T]:
        """Run the stage `name`, which reads the pieces, under the title `shown`; extraction keeps its own seconds."""
        were_extracted = self._extracting.seconds > 0
        result = yield from self.stages.run(shown, steps)
        if name != EXTRACTING and not were_extracted:
            seconds, extracting = self.stages.seconds, self._extracting.seconds
            seconds[name], seconds[EXTRACTING] = max(0.0, seconds[shown] - extracting), extracting
        return result

    def _spool(self, joined: bool) -> Spool:
        """Return the store of pieces that are read several times: in memory if they are there anyway."""
        return Spool() if joined else Spool(self.budget.spool_bytes, self.sink.folder)

    def _pieces_steps(self, spool: Spool, joined: bool) -> Steps[Pieces]:
        """Return the pieces of the surface without small components, and choose alpha if the settings ask for that.

        They may be large where they are to be `joined`.
        """
        settings = self.settings
        extracted = self._extracted_steps(joined)
        if not settings.looks_again:
            return extracted
        pieces = SpooledPieces(spool)
        kept = KeptPieces(pieces.pieces_steps, limits_of(settings), spool)
        with self.budget.refusal("the surface", "use a larger stride or a region"):
            yield from self.stages.run(EXTRACTING, pieces.take_steps(extracted))
            passes = partial(kept.pieces_steps, last=False)
            yield from self.choose_alpha_steps(passes, pieces_vary=settings.drops_components)
            if settings.drops_components:
                yield from self.stages.run(KEEPING, kept.decision_steps(self.settings.alpha_number))
        return self._kept_steps(kept)

    def _kept_steps(self, kept: KeptPieces) -> Pieces:
        wrong_side = yield from kept.pieces_steps(self.settings.alpha_number)
        self.removed_components = kept.removed
        return wrong_side

    @property
    def _shows_normals(self) -> bool:
        return self.settings.normals == "gradient" and self.sink.normals

    def _extracted_steps(self, joined: bool) -> Pieces:
        """Yield all pieces of the surface, timed."""
        self._extracting = _Timed()
        pieces = surface_pieces_steps(self.field, self.budget, self._shows_normals, joined)
        return self._extracting.passed_steps(self._fitting_steps(pieces) if joined else pieces)

    def _fitting_steps(self, pieces: Pieces) -> Pieces:
        """Yield the pieces as long as all of them fit in memory."""
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

    def _described(self, taken: Taken, full_faces: int) -> Reconstruction:
        """Describe the full surface, with notes of volume and field."""
        volume, field = self.volume, self.field
        return described(
            volume,
            self.scope,
            self.settings,
            taken,
            notes=volume.notes + field.notes + face_notes(volume.kind, field.threshold, self._extracting.sample),
            slice_steps=field.slice_steps,
            choice=self.choice,
            threshold=field.threshold,
            full_faces=full_faces,
            stages=self.ran,
            removed_components=self.removed_components,
            self_intersections=0,
        )
