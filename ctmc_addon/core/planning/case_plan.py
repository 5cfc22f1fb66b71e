# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory that cases of a batch need, and how many of them run side by side: the only owner of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from typing import NamedTuple

from ..machine.budget import Budget
from ..machine.memory import amount
from ..machine.parallel import processors
from ..settings import ReconstructionSettings
from ..smoothing.methods import smoothing_of

# Of a process that makes cases, before any values are read: Python, NumPy and work arrays, and Blender for thumbnails,
# which draws them in as much again.
PROCESS_BYTES, BLENDER_PROCESS_BYTES = 130 << 20, 420 << 20
# The most that was measured, on 52 million voxels with 5.3 million triangles and a thumbnail (docs/batch.md).
CASE_VOXEL_BYTES = 32
READING_COPIES = 2  # Reading takes the values this many times.
# Ask for this many times the predicted bytes of smoothing: a label of noise took 1.3 times, for its triangles.
ASKED_FACTOR = 1.4
KEPT_BYTES = 256 << 20  # A process that keeps more bytes than this between two cases, beyond its own, is replaced.
CASES_SHARE = 0.85  # All cases may take this share of the available memory.


def case_bytes(voxels: int, value_bytes: int | None = None, thumbnails: bool = True) -> int:
    """Estimate the memory that a case of a batch needs from its headers.

    Parameters
    ----------
    voxels : int
    value_bytes : int, optional
        Bytes of a voxel, if the case asks for more once it knows its label's box: only reading is counted.
    thumbnails : bool
        Whether Blender is loaded.
    """
    process = BLENDER_PROCESS_BYTES if thumbnails else PROCESS_BYTES
    return process + voxels * (CASE_VOXEL_BYTES if value_bytes is None else READING_COPIES * value_bytes)


def asks_for_memory(settings: ReconstructionSettings, several: bool) -> bool:
    """Return whether a case requests memory before it takes it: one or `several` labels, smoothed in their boxes."""
    if several and settings.label is None:
        settings = replace(settings, threshold=None, label=1)
    return settings.label is not None and not smoothing_of(settings).by_slabs


def asked_bytes(has_bytes: int, needed_bytes: int) -> int:
    """Return the bytes that a case asks for: those it has, and those for its next work with a reserve."""
    return has_bytes + int(ASKED_FACTOR * needed_bytes)


def case_process_is_large(resident_bytes: int | None) -> bool:
    """Return whether a process keeps too much memory after a case to make the next one."""
    return resident_bytes is not None and resident_bytes > BLENDER_PROCESS_BYTES + KEPT_BYTES


def cases_bytes(budget: Budget) -> int | None:
    """Return the bytes that all cases of a batch may take in total; None where the system does not say."""
    there = budget.available
    return None if there is None else int(there * CASES_SHARE)


class _AtOnce(NamedTuple):
    """Number of cases that run side by side, and why not more.

    Parameters
    ----------
    jobs : int
    reason : str
        Such as 'as many as there are processors'.
    """

    jobs: int
    reason: str


def cases_at_once(asked: int | None, needs: Sequence[int], budget: Budget) -> _AtOnce:
    """Return how many processes may run at once: as many as asked for or as there are processors, if they fit.

    Only the smallest must fit side by side: the batch lets larger ones wait for others.

    Examples
    --------
    >>> cases_at_once(4, [1 << 30, 2 << 30, 2 << 30], Budget(bytes=6 << 30))
    _AtOnce(jobs=3, reason='as many as there are cases')
    >>> cases_at_once(4, [2 << 30] * 5, Budget(bytes=6 << 30))
    _AtOnce(jobs=2, reason='as memory allows: a case begins with 2.0 GiB, and 5.1 GiB may be used')
    """
    limits = [(processors(), "as many as there are processors"), (max(len(needs), 1), "as many as there are cases")]
    if asked is not None:
        limits[0] = (asked, "as --jobs says")
    limit = cases_bytes(budget)
    if limit is not None and needs:
        fitting = sum(total <= limit for total in accumulate(sorted(needs)))
        least, most = amount(min(needs)), amount(max(needs))
        between = least if least == most else f"{least} to {most}"
        limits.append(
            (max(1, fitting), f"as memory allows: a case begins with {between}, and {amount(limit)} may be used")
        )
    jobs = min(number for number, _ in limits)
    return _AtOnce(jobs, next(reason for number, reason in limits if number == jobs))
