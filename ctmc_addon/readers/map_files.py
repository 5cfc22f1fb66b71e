# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the files that a map names: a volume to paint, a surface to measure distances to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..core import (
    Budget,
    LabelError,
    MadeSurface,
    ReconstructionSettings,
    Steps,
    SurfaceRequest,
    TriangleMesh,
    Volume,
    make_surfaces_steps,
)
from ..core.volume import ValueKind, label_extents_steps, region_box
from .options import ReadingOptions
from .result import VolumeSource
from .surface_files import SURFACE_SUFFIXES, read_surface_steps


@dataclass(frozen=True)
class MapFiles:
    """The files that quantities name, as `core.maps.Inputs`.

    Parameters
    ----------
    volume : Volume
        The volume that surfaces are made from.
    budget : Budget
    open_steps : callable
        `open_volume_steps`.
    """

    volume: Volume
    budget: Budget
    open_steps: Callable[[Path], Steps[VolumeSource]]

    def volume_steps(self, path: str) -> Steps[Volume]:
        """Read a volume."""
        source = yield from self.open_steps(Path(path))
        return (yield from source.read_steps(ReadingOptions(), budget=self.budget))

    def surface_steps(self, path: str) -> Steps[TriangleMesh]:
        """Read the surface of an STL or PLY, or make that of a label volume; RAS+ mm.

        Raises
        ------
        LabelError
            For gray values, or several labels.
        """
        if Path(path).suffix.lower() in SURFACE_SUFFIXES:
            return (yield from read_surface_steps(Path(path)))
        volume = yield from self.volume_steps(path)
        if volume.kind != ValueKind.LABEL:
            raise LabelError(f"{Path(path).name} holds {volume.kind}; give a label volume, an STL or a PLY")
        labels = yield from label_extents_steps(volume, region_box(volume, ReconstructionSettings()))
        if len(labels) != 1:
            raise LabelError(
                f"{Path(path).name} has {len(labels)} labels; make the STL of one with ctmc reconstruct and give that"
            )
        request = SurfaceRequest(ReconstructionSettings(label=next(iter(labels))))
        [surface] = yield from make_surfaces_steps(volume, [request], self.budget, all_needed=True)
        assert isinstance(surface, MadeSurface), "an error is raised"
        return surface.result.mesh
