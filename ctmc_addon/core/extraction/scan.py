# SPDX-License-Identifier: GPL-3.0-or-later
"""The first two passes: which samples are inside, and which voxels a surface passes through, slab by slab.

The vertices of a slab are numbered along x first, then y, then z, so their order depends on where the slabs are cut:
at layers that depend on the values alone, not on threads or memory. Work is estimated layer by layer for that.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError, ThresholdError
from ..parallel import map_steps
from ..progress import Stages, Steps
from .active_voxels import Slab, find_active
from .classify import inside_bits
from .gradients import Sampler
from .grid import WORD, Grid
from .interior_vertices import with_trilinear_topology
from .trilinear_decider import trilinear_tables

SLAB_SAMPLES = 1 << 22  # samples compared at a time: enough to outweigh the cost of a call
SLAB_WORDS = 1 << 20  # words of 64 samples in a slab, for little memory
SLAB_MIXED = 1 << 13  # and those that a surface crosses: the lists of so many voxels stay in the processor's cache
MIXED_ROWS = 16  # of which one is looked at to estimate them
KEPT_BYTES = 1 << 23  # more than most arrays of a slab; see _keep_freed_pages
TOPOLOGIES = ("classic", "trilinear")
COMPARING, FINDING = "Comparing with the threshold", "Finding active voxels"
SCAN_STAGES = {COMPARING: 3.0, FINDING: 2.0}


def scan_steps(
    stages: Stages, grid: Grid, threshold: float, threads: int, topology: str
) -> Steps[tuple[list[Slab], NDArray[np.intp]]]:
    """The active voxels of all slabs, and for `slab_ranges` how many words of every layer a surface crosses."""
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

    def find(layer_range: tuple[int, int]) -> Slab:
        slab = find_active(grid, bits, *layer_range)
        return with_trilinear_topology(slab, grid, sampler, threshold) if topology == "trilinear" else slab

    mixed = mixed_words(bits[: grid.layers, ::MIXED_ROWS])
    ranges = slab_ranges(mixed, bits[0].size)
    return (yield from stages.run(FINDING, map_steps(find, ranges, threads, ""))), mixed


def _keep_freed_pages() -> None:
    """Free a large array, so that the arrays of slabs are allocated faster.

    The GNU C library gives freed memory back to the system, page by page to be fetched again, unless a larger piece
    was freed before. This is one; nothing is written to it.
    """
    np.empty(KEPT_BYTES, np.uint8)


def mixed_words(bits: NDArray[np.uint64]) -> NDArray[np.intp]:
    """How many words of every layer have samples both inside and outside, from those of one row in `MIXED_ROWS`."""
    mixed = np.count_nonzero(bits + np.uint64(1) > 1, axis=(1, 2)) * MIXED_ROWS  # neither no sample nor all
    return np.asarray(mixed, np.intp)


def slab_ranges(mixed: NDArray[np.intp], layer_words: int) -> list[tuple[int, int]]:
    """Ranges of sample layers of about equal work each, from the `mixed_words` and all words of a layer."""
    return _even_ranges(np.maximum(mixed / SLAB_MIXED, layer_words / SLAB_WORDS))


def _even_ranges(work: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Ranges (low, high) of layers with about equal shares of the work, near 1; an even number, where not just one."""
    done = np.cumsum(work)
    count = 2 * math.ceil(done[-1] / 2) if done[-1] > 0.25 else 1  # less is not worth a second thread
    number = np.floor((done - work / 2) * (count / done[-1]))
    firsts = [0, *(np.flatnonzero(np.diff(number)) + 1), len(work)]
    return [(int(low), int(high)) for low, high in pairwise(firsts)]
