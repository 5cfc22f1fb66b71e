# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits that decide whether a component has changed.

A volume that differs by 25 % or more has changed: NELSON (van Klaveren et al. 2009, doi:10.1056/NEJMoa0906085) and the
British Thoracic Society (Callister et al. 2015, doi:10.1136/thoraxjnl-2015-207168). RECIST 1.1 (Eisenhauer et al. 2009,
doi:10.1016/j.ejca.2008.10.026) requires 20 % more or 30 % less diameter, which for a ball is 73 % more or 66 % less
volume. A difference of a few voxels is drawing noise and not a change, whatever its share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from ..described import Described, setting
from .components import Component

IN_VIEW = 0.5  # A component is in a volume's field of view if the volume holds this share of its samples.


class ChangeStatus(StrEnum):
    """How a component has changed."""

    NEW = "new"
    GONE = "gone"
    GROWN = "grown"
    SHRUNK = "shrunk"
    STABLE = "stable"
    MERGED = "merged"
    SPLIT = "split"
    OUTSIDE = "outside"
    """Without a match, and not in the field of view of the other volume, so the change is unknown."""


@dataclass(frozen=True)
class ChangeLimits(Described):
    """Limits of a change.

    Examples
    --------
    >>> print(ChangeLimits(percent=73).sentence)
    Grown or shrunk: by 73 % of the volume or more, and by more than 8 voxels. Matched: an overlap of at least 5 % of \
the smaller component.
    """

    percent: float = setting(
        25.0,
        "Smallest change of the volume that counts as grown or shrunk. Larger = more components are stable",
        label="Change",
        unit="%",
        low=0.0,
        flag="change-percent",
    )
    voxels: int = setting(
        8,
        "A component that differs by no more than this many voxels, of the coarser grid, is stable",
        label="Voxels",
        unit="voxels",
        low=0,
        type=int,
        flag="change-voxels",
    )
    overlap_percent: float = setting(
        5.0,
        "Smallest overlap by which two components are matched, as a share of the smaller. Larger = fewer are merged "
        "or split by chance; 0 = any",
        label="Overlap",
        unit="%",
        low=0.0,
        high=100.0,
        flag="overlap-percent",
    )

    @property
    def sentence(self) -> str:
        """The limits as a sentence."""
        overlap = f"an overlap of at least {self.overlap_percent:g} % of the smaller component"
        return (
            f"Grown or shrunk: by {self.percent:g} % of the volume or more, and by more than {self.voxels} voxels. "
            f"Matched: {overlap if self.overlap_percent else 'any overlap'}."
        )

    def status(
        self, before: Sequence[Component], after: Sequence[Component], voxel_mm3: float, in_view: bool
    ) -> ChangeStatus:
        """Return the status of matched components.

        Parameters
        ----------
        before, after : sequence of Component
            One of the two may be empty.
        voxel_mm3 : float
            Volume of a voxel of the coarser grid.
        in_view : bool
            Whether components without a match are in the field of view of the other volume.
        """
        if not (before and after):
            return ChangeStatus.OUTSIDE if not in_view else ChangeStatus.NEW if after else ChangeStatus.GONE
        if len(before) > 1 or len(after) > 1:
            return ChangeStatus.SPLIT if len(after) > len(before) else ChangeStatus.MERGED
        [first], [last] = before, after
        change = last.volume_mm3 - first.volume_mm3
        if abs(change) * 100 < self.percent * first.volume_mm3 or abs(change) <= self.voxels * voxel_mm3:
            return ChangeStatus.STABLE
        return ChangeStatus.GROWN if change > 0 else ChangeStatus.SHRUNK
