# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a surface does not fit in memory: what it needs, and settings that were checked to fit.

Triangles are counted by extraction's own first passes, a slab of values at a time, so that what is proposed is counted
and not guessed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

from .errors import CtmcError, MemoryLimitError
from .memory import NO_THREAD, amount, available_bytes, give_back
from .progress import Stages, Steps
from .settings import ReconstructionSettings
from .simplification.simplify import memory_needed
from .simplification.streaming.reduce_pieces import Goal
from .streaming import counted_steps, widest_slices
from .volume.slabs import SlabVolume
from .volume.volume import Volume

T = TypeVar("T")

HELD_BYTES = 50  # of a triangle of the full surface while it is extracted and simplified (tracemalloc)
FACE_BYTES = 128  # of one that stays: 36, and 92 to measure it; a mesh in Blender takes less, after that
BOUNDED_REDUCTION = 0.9  # share of the triangles that a maximum error is taken to remove
SLABS_BYTES = 128 << 20  # of the slabs at work
MOST_STRIDE = 16
LOOKING = "Looking for what fits"
ROUNDED = 0.9  # of the triangles that would fit are proposed


@dataclass(frozen=True)
class Fitting:
    """What a surface takes in memory.

    Parameters
    ----------
    faces : int
        Triangles, before simplification.
    settings : ReconstructionSettings
    written_bytes : int
        Of a triangle while files are written, beside those of the surface.
    in_pieces : bool
        Whether it is written as it is extracted.
    """

    faces: int
    settings: ReconstructionSettings
    written_bytes: int = 0
    in_pieces: bool = False

    @property
    def simplifies(self) -> bool:
        """Whether the built-in simplifier has a goal, so that the full surface need not be there as a whole."""
        return self.settings.simplifies and self.settings.simplifier == "builtin"

    @property
    def left(self) -> int:
        """Triangles after simplification, as far as that can be predicted."""
        if not self.simplifies:
            return self.faces
        return min(self.faces, self._goal.target(self.faces) or round(self.faces * (1.0 - BOUNDED_REDUCTION)))

    @property
    def held(self) -> int:
        """Bytes, about, where the full surface is held."""
        if not self.simplifies:
            return self.faces * (FACE_BYTES + self.written_bytes)
        at_once = memory_needed(self.faces, self.settings.max_error_mm)
        return self.faces * HELD_BYTES + max(at_once, self.left * (FACE_BYTES + self.written_bytes))

    @property
    def streamed(self) -> int:
        """Bytes, about, where it is simplified as it is extracted."""
        at_once = memory_needed(min(self.faces, self._goal.sizes[1]), self.settings.max_error_mm)
        return max(at_once, self.left * self.written_bytes) + self.left * FACE_BYTES

    @property
    def needed(self) -> int:
        """The least bytes, about, of a volume that is not in memory."""
        if self.simplifies:
            return SLABS_BYTES + self.streamed
        return SLABS_BYTES + (0 if self.in_pieces else self.held)

    @property
    def _goal(self) -> Goal:
        return Goal(self.settings.reduction, self.settings.target_faces, self.settings.max_error_mm)

    def most_triangles(self, there: int) -> int:
        """How many triangles simplification may leave in so many bytes; 0 where it does not fit."""
        goal = Goal(target_faces=1)
        room = there - SLABS_BYTES - memory_needed(min(self.faces, goal.sizes[1]), None)
        return max(0, int(ROUNDED * room / (FACE_BYTES + self.written_bytes)))


def advised_steps(
    making: Steps[T],
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    written_bytes: int = 0,
    threads: int | None = None,
    memory_limit: int | None = None,
    in_pieces: bool = False,
) -> Steps[T]:
    """The steps of `making`; a lack of memory becomes a `MemoryLimitError` with settings that were checked to fit.

    Parameters
    ----------
    making : steps
        Make the surface of the volume with the settings.
    written_bytes : int
        Of a triangle while files are written.
    in_pieces : bool
        Whether the surface is written as it is extracted.
    """
    there = available_bytes() if memory_limit is None else memory_limit
    stages = Stages({"Reconstructing": 9, LOOKING: 1})
    try:
        return (yield from stages.run("Reconstructing", making))
    except (MemoryLimitError, MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not isinstance(error, CtmcError) and str(error) != NO_THREAD:
            raise
        if there is None:
            raise
        refused = error.with_traceback(None)  # what was made until then goes, and what its cause still holds
        refused.__cause__ = refused.__context__ = None
    give_back()
    looking = refusal_steps(volume, settings, there, written_bytes, threads, in_pieces)
    try:
        sentence = yield from stages.run(LOOKING, looking)
    except (MemoryLimitError, MemoryError):  # even a slab at a time
        sentence = slab_refusal(volume, settings, there)
    except CtmcError:
        sentence = ""
    if not sentence:
        raise refused
    raise MemoryLimitError(sentence) from refused


def refusal_steps(
    volume: Volume | SlabVolume,
    settings: ReconstructionSettings,
    there: int,
    written_bytes: int = 0,
    threads: int | None = None,
    in_pieces: bool = False,
) -> Steps[str]:
    """Why a surface was refused, and settings that fit, all counted; empty where none is known."""
    what = smoothing = ""
    if settings.smoothing_method == "constrained":  # which is not done a slab at a time
        what, smoothing = f"smoothing label {settings.label} as constrained", "smoothing gaussian"
        settings = replace(settings, smoothing="gaussian")
    stages = Stages({"Counting triangles": 1, LOOKING: 1})
    counting = counted_steps(volume, settings, threads, there)
    counts = yield from stages.run("Counting triangles", counting)
    fitting = Fitting(counts.faces, settings, written_bytes, in_pieces)
    fits = fitting.needed <= there  # as far as is known: it was refused
    if smoothing and fits:
        return _refused(what, there, f"{smoothing} would fit")
    room = SLABS_BYTES + (fitting.needed - SLABS_BYTES) // 2 if fits else there
    proposals = yield from stages.run(LOOKING, proposals_steps(volume, fitting, room, threads))
    if fits and not proposals:
        return ""
    together = f"{smoothing} with " if smoothing else ""
    advice = f"{together}{' or '.join(proposals)} would fit" if proposals else "choose a smaller region"
    what = what or f"a surface of {fitting.faces} triangles"
    if fits or smoothing:
        return _refused(what, there, advice)
    return f"{what} needs about {amount(fitting.needed)} of memory and {amount(there)} are available; {advice}"


def _refused(what: str, there: int, advice: str) -> str:
    """The sentence where nobody knows how much is needed."""
    return f"{what} needs more than the {amount(there)} of memory that are available; {advice}"


def proposals_steps(volume: Volume | SlabVolume, fitting: Fitting, room: int, threads: int | None) -> Steps[list[str]]:
    """Changes of the settings each of which fits into so many bytes."""
    wider = yield from _stride_steps(volume, fitting, room, threads)
    proposals = [] if wider is None else [wider]
    most, settings = fitting.most_triangles(room), fitting.settings
    if most >= 1000 and settings.simplifier != "decimate" and not settings.max_error_mm:
        proposals.append(f"target_faces {min(most, fitting.faces - 1) // 1000 * 1000}")
    return proposals


def slab_refusal(volume: Volume | SlabVolume, settings: ReconstructionSettings, there: int) -> str:
    """Why values cannot even be fetched slab by slab, and a region that can."""
    x, y, _ = volume.size
    side = widest_slices(volume, settings, there)
    advice = f"choose a region of at most {side} x {side} voxels across" if side < max(x, y) else "choose a region"
    return _refused("a slab of this volume", there, advice if side > 1 else "give it more memory")


def _stride_steps(volume: Volume | SlabVolume, fitting: Fitting, there: int, threads: int | None) -> Steps[str | None]:
    """The smallest wider stride that fits."""
    if there <= SLABS_BYTES or (fitting.in_pieces and not fitting.simplifies):  # triangles are not what it takes
        return None
    for stride in _wider(volume, fitting, there):
        settings = replace(fitting.settings, stride=stride)
        try:
            counts = yield from counted_steps(volume, settings, threads, there)
        except MemoryLimitError:  # a slab is thicker at a wider stride
            return None
        if replace(fitting, faces=counts.faces, settings=settings).needed <= there:
            return "stride " + " ".join(map(str, stride))
    return None


def _wider(volume: Volume | SlabVolume, fitting: Fitting, there: int) -> Iterator[tuple[int, int, int]]:
    """Strides along x, y and z, from the first that may fit: triangles fall with the square of the stride."""
    room = max(1, there - SLABS_BYTES)
    first = max(1, math.floor(math.sqrt(max(0, fitting.needed - SLABS_BYTES) / room)))
    for more in range(first, MOST_STRIDE):
        x, y, z = (min(side + more, size - 1) for side, size in zip(fitting.settings.stride, volume.size, strict=True))
        yield x, y, z
