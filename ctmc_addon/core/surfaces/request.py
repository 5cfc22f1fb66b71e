# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests for surfaces, and their scope: what is decided before any value is read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..extraction.grid import check_stride
from ..measures.reconstruction import Reconstruction
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink
from ..smoothing.methods import refinement_of
from ..volume.region import region_box
from ..volume.volume import Box, Volume


@dataclass(frozen=True, eq=False)
class SurfaceRequest:
    """A surface to make.

    Parameters
    ----------
    settings : ReconstructionSettings
    sink : Sink
        Sink that receives the surface; by default it is held.
    needs_full : bool
        Whether to return the full surface too, to be simplified again.
    full : Reconstruction, optional
        A full surface of other settings to start from, so that nothing is extracted.
    written_bytes : int
        Bytes that Blender needs to write a triangle of a held surface.
    """

    settings: ReconstructionSettings
    sink: Sink = HOLD
    needs_full: bool = False
    full: Reconstruction | None = None
    written_bytes: int = 0


class MadeSurface(NamedTuple):
    """A surface, and all its triangles before the built-in simplifier.

    Parameters
    ----------
    result : Reconstruction
        The surface that the settings ask for.
    full : Reconstruction or None
        None if not requested, or if it does not fit in memory.
    """

    result: Reconstruction
    full: Reconstruction | None = None


def share_walls(all_settings: Sequence[ReconstructionSettings]) -> bool:
    """Return whether surfaces share walls and are therefore made as one complex."""
    return len(all_settings) > 1 and all(
        settings.label is not None and settings.interfaces == "shared" for settings in all_settings
    )


@dataclass(frozen=True)
class Scope:
    """Region and stride of a surface that is extracted.

    Parameters
    ----------
    region : Box
        Samples of the volume.
    stride : (x, y, z) int
    slice_steps : int
        Steps from slice to slice.
    """

    region: Box
    stride: tuple[int, int, int]
    slice_steps: int

    def require_stride(self) -> None:
        """Raise `SettingsError` if the stride does not fit into the region."""
        first, last = self.region[2][0] * self.slice_steps, (self.region[2][1] - 1) * self.slice_steps
        check_stride(self.stride, (*self.region[:2], (first, last + 1)))

    def voxels_visited(self, slice_steps: int) -> int:
        """Return the cells of the strided grid, skipped or not, at the slice steps of the finished field.

        Examples
        --------
        >>> Scope(((0, 5), (0, 5), (0, 3)), (2, 2, 2), 1).voxels_visited(2)
        8
        """
        gaps = [stop - 1 - start for start, stop in self.region]
        gaps[2] *= slice_steps
        return math.prod(-(-gap // side) for gap, side in zip(gaps, self.stride, strict=True))


def scope_of(volume: Volume, settings: ReconstructionSettings) -> Scope:
    """Return the scope of a surface.

    Raises
    ------
    SettingsError
        If the region does not lie in the volume.
    """
    return Scope(region_box(volume, settings), settings.stride, refinement_of(volume.spacing, settings))


def scope_of_labels(volume: Volume, settings: ReconstructionSettings) -> Scope:
    """Return the scope of labels that touch; ignores the label of `settings`."""
    return scope_of(volume, replace(settings, threshold=None, label=1))
