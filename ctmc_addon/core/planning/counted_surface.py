# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe a surface that was counted but not made: its size, memory, and whether it fits."""

from __future__ import annotations

from dataclasses import dataclass

from ..settings import ReconstructionSettings


@dataclass(frozen=True)
class CostEstimate:
    """The size of a surface, the memory that it takes, and the seconds of counting it.

    Parameters
    ----------
    settings : ReconstructionSettings
    voxels : int
        Voxels to visit.
    vertices, faces : int
        Exact, before simplification and before components are dropped.
    memory : int
        Peak, bytes.
    left : int
        Triangles after simplification, as far as that can be predicted.
    preparing_seconds, counting_seconds : float
        Seconds that preparing the values and the first passes took.
    available : int or None
        Bytes of memory that can be had.
    remedy : str
        Change that would fit, if this does not.
    sides_mm : (x, y, z) float
        Steps of the samples that it is extracted from.
    """

    settings: ReconstructionSettings
    voxels: int
    vertices: int
    faces: int
    memory: int
    left: int
    preparing_seconds: float = 0.0
    counting_seconds: float = 0.0
    available: int | None = None
    remedy: str = ""
    sides_mm: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def fits(self) -> bool:
        """Whether there is enough memory."""
        return self.available is None or self.memory <= self.available

    @property
    def sentence(self) -> str:
        """Return why the surface cannot be made, and what would fit; empty if it fits."""
        if self.fits or self.available is None:
            return ""
        return (
            f"this would need {self.memory / 2**30:.1f} GiB of memory and {self.available / 2**30:.1f} GiB are "
            f"available; {self.remedy}"
        )
