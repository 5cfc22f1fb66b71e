# SPDX-License-Identifier: GPL-3.0-or-later
"""The first two passes: which samples are inside, and which voxels a surface passes through, slab by slab.

Slabs are cut so that each is about as much work; the order of vertices and triangles does not hang on it (order.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError, ThresholdError
from ..machine.parallel import map_steps
from ..progress import Stages, Steps
from .active_voxels import Slab, find_active
from .classify import inside_bits
from .gradients import Sampler
from .grid import WORD, Grid
from .trilinear.decider import trilinear_tables
from .trilinear.interior_vertices import with_trilinear_topology

SLAB_SAMPLES = 1 << 22  # Compare this many samples at a time: enough to outweigh the cost of a call.
SLAB_WORDS = 1 << 20  # A slab has this many words of 64 samples, for little memory.
# The surface crosses this many words of a slab: lists of their voxels stay in the processor's cache.
SLAB_MIXED = 1 << 14
SLAB_CROSSED = 1 << 15  # Noise crosses this many edges along x of a slab, in words that are each crossed many times.
# All threads share this many slabs or more; one thread is as quick with fewer, as its calls never wait.
THREADED_SLABS = 8
DECIDED_SLABS = 8  # Decide the ambiguous voxels of this many slabs at once, if every thread has as many.
MIXED_ROWS = 16  # Look at one row in this many to estimate both.
BIT_COUNT = np.array([number.bit_count() for number in range(256)], np.uint8)
KEPT_BYTES = (1 << 25) - (1 << 16)  # The largest value that has an effect; see _keep_freed_pages.
TOPOLOGIES = ("classic", "trilinear")
COMPARING, FINDING = "Comparing with the threshold", "Finding active voxels"
SCAN_STAGES = {COMPARING: 3.0, FINDING: 2.0}


def scan_steps(
    stages: Stages, grid: Grid, threshold: float, threads: int, topology: str
) -> Steps[tuple[list[Slab], Slab | None]]:
    """Find the active voxels of all slabs, and separately those where the grid continues above."""
    if topology not in TOPOLOGIES:
        raise SettingsError(f"topology is one of {', '.join(TOPOLOGIES)}, not {topology!r}")
    if not math.isfinite(threshold):
        raise ThresholdError(f"threshold {threshold} is not a number; give a gray value of the volume")
    _keep_freed_pages()
    layers, rows, pitch = grid.z.count, grid.y.count + 1, grid.words * WORD
    bits = np.zeros((layers + 1, rows, grid.words), np.uint64)

    def compare(layer_range: tuple[int, int]) -> None:
        inside_bits(grid, threshold, *layer_range, bits)

    ranges = _even_ranges(np.full(layers, rows * pitch / SLAB_SAMPLES))
    yield from stages.run(COMPARING, map_steps(compare, ranges, threads, ""))
    sampler = Sampler(grid.values, grid.first_slice, grid.slices)
    if topology == "trilinear":
        trilinear_tables()  # made once, not by every thread

    def find(layer_ranges: Sequence[tuple[int, int]]) -> list[Slab]:
        slabs = [find_active(grid, bits, *layer_range) for layer_range in layer_ranges]
        slabs = with_trilinear_topology(slabs, grid, sampler, threshold) if topology == "trilinear" else slabs
        for slab in slabs:
            slab.segments  # noqa: B018  (kept by the slab: each thread counts its own)
        return slabs

    work = _surface_work(bits[: grid.layers, ::MIXED_ROWS]) * MIXED_ROWS
    ranges = _even_ranges(np.maximum(work, bits[0].size / SLAB_WORDS))
    threads = slab_threads(len(ranges), threads)
    at_once = max(1, min(DECIDED_SLABS, len(ranges) // (2 * threads))) if topology == "trilinear" else 1
    groups = [ranges[first : first + at_once] for first in range(0, len(ranges), at_once)]
    slab_groups = yield from stages.run(FINDING, map_steps(find, groups, threads, ""))
    slabs = [slab for group in slab_groups for slab in group]
    return slabs, find_active(grid, bits, grid.layers, grid.z.count) if grid.continues else None


def slab_threads(slabs: int, threads: int) -> int:
    """Return how many of these threads share the slabs: all or one."""
    return threads if slabs >= THREADED_SLABS else 1


def _surface_work(bits: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Return the work of the surface in every layer of some rows; a slab has 1."""
    mixed = np.count_nonzero(bits + np.uint64(1) > 1, axis=(1, 2))  # neither no sample of a word inside nor all
    changes = (bits ^ bits >> np.uint64(1)) & np.uint64(2 ** (WORD - 1) - 1)
    crossed = BIT_COUNT.take(changes.view(np.uint8)).sum(axis=(1, 2))
    work: NDArray[np.float64] = np.maximum(mixed / SLAB_MIXED, crossed / SLAB_CROSSED)
    return work


@cache
def _keep_freed_pages() -> None:
    """Free a large array, once in a process, so that the arrays of slabs and surfaces are allocated faster.

    The GNU C library gives freed memory back to the system, page by page to be fetched again, unless a larger piece
    of up to 32 MiB was freed before. This is one; nothing is written to it.
    """
    with suppress(MemoryError):  # where so little is left that there is nothing to keep
        np.empty(KEPT_BYTES, np.uint8)


def _even_ranges(work: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Ranges (low, high) of layers with about equal shares of the work, near 1; an even number, where not just one."""
    done = np.cumsum(work)
    if done[-1] <= 0.25:  # not worth a second thread
        return [(0, len(work))]
    count = 2 * math.ceil(done[-1] / 2)
    number = np.floor((done - work / 2) * (count / done[-1]))
    firsts = [0, *(np.flatnonzero(np.diff(number)) + 1), len(work)]
    return [(int(low), int(high)) for low, high in pairwise(firsts)]
