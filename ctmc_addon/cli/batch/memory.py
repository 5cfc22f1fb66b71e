# SPDX-License-Identifier: GPL-3.0-or-later
"""How much memory a case will need, predicted from its headers before anything is read."""

from __future__ import annotations

import os
from collections.abc import Sequence

from ... import readers
from ...core import CtmcError, available_bytes
from ..commands.reconstruct import source_of
from .cases import Case

PROCESS_BYTES = 400 << 20  # Python, NumPy and Blender
# The most that was measured, on 52 million voxels with 5.3 million triangles and a thumbnail (docs/batch.md).
VOXEL_BYTES = 32
SHARE = 0.85  # of the memory that is there


def needed_bytes(case: Case) -> int:
    """Memory that a case needs, about; too little for one whose headers are broken, which fails at once."""
    return PROCESS_BYTES + VOXEL_BYTES * voxels_of(case)


def voxels_of(case: Case) -> int:
    """Voxels in the file that will be read, 0 where that is unknown."""
    path = source_of(case.path, case.outputs[0].settings.label)
    try:
        return readers.estimate_voxels(path)
    except (CtmcError, OSError):
        return 0


def memory_limit() -> int | None:
    """What the cases may take together, bytes; None where the system does not say."""
    available = available_bytes()
    return None if available is None else int(available * SHARE)


def jobs_at_once(asked: int | None, needs: Sequence[int], limit: int | None) -> int:
    """Processes at once: as many as asked for or as there are processors, and no more than fit by the largest.

    Examples
    --------
    >>> jobs_at_once(4, [1 << 30, 2 << 30], 5 << 30)
    2
    """
    jobs = min(asked or os.cpu_count() or 1, max(len(needs), 1))
    return jobs if limit is None or not needs else max(1, min(jobs, limit // max(needs)))
