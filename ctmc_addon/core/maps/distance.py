# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure the signed distance of a surface to a second one: positive outside of that one, negative inside."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..errors import LabelError, MeshError
from ..files.file_names import printable
from ..mesh.distance.nearest_pair import nearest_pair_steps
from ..mesh.distance.signed_distance import SignedSurface
from ..mesh.distance.surface_distance import STAGES
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps
from ..volume.labels.extents import chosen_labels_steps
from ..volume.volume import Volume
from .quantity import Inputs, MappedSurface, MapValues, Quantity

SECOND_SUFFIXES = (".nii", ".ome", ".vol")  # Before .gz, .zarr, .info.


@dataclass(frozen=True, init=False)
class DistanceTo(Quantity):
    """Signed distance of every vertex to a second surface, and the nearest two points.

    Parameters
    ----------
    target : str, int or TriangleMesh
        Name or number of a label in the same volume, or a surface in RAS+ mm.
    name : str
        Name of the target in the name of the map; by default that of the label.

    Examples
    --------
    >>> DistanceTo("portal vein").name, DistanceTo(2).name
    ('distance_portal_vein_mm', 'distance_2_mm')
    """

    target: str | int | TriangleMesh
    target_name: str

    flag: ClassVar[str] = "distance-to"
    metavar: ClassVar[str] = "NAME|PATH"
    text: ClassVar[str] = (
        "Signed distance to another structure, by its name or number, or to the surface of an STL, PLY or label "
        "volume: positive outside it, negative inside"
    )
    label: ClassVar[str] = "Distance to"

    def __init__(self, target: str | int | TriangleMesh, name: str = "") -> None:
        own = "surface" if isinstance(target, TriangleMesh) else str(target)
        object.__setattr__(self, "target", target)
        object.__setattr__(self, "target_name", printable(name or own))

    @property
    def name(self) -> str:
        """The name of the map."""
        words = re.sub(r"[_\W]+", "_", self.target_name).strip("_")
        return f"distance_{words or 'surface'}_mm"

    @property
    def needs_full(self) -> bool:
        """Whether the map needs full surfaces, because a target that shares walls with the surface is made again."""
        return not isinstance(self.target, TriangleMesh)

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Make the target and measure the distances to it."""
        if (yield from self._is_own_steps(surface)):
            nothing = np.full(len(surface.mesh.vertices), np.nan, np.float32)
            return MapValues(nothing, notes=(f"{self.target_name} has no distance to itself",))
        stages = Stages({"Making the other surface": 3, **STAGES, "Finding the nearest points": 1})
        making, preparing, measuring, finding = stages.shares
        mesh, signed = surface.mesh, SignedSurface()
        target = yield from stages.run(making, self._target_steps(surface))
        yield from stages.run(preparing, signed.prepare_steps(target))
        measured = signed.distances_steps(mesh.vertices, surface.budget.threads)
        distances, nearest = yield from stages.run(measuring, measured)
        pair = yield from stages.run(finding, nearest_pair_steps(mesh, signed, distances, nearest))
        notes = () if signed.closed else (f"{self.target_name} is not closed, so distances to it have no sign",)
        return MapValues(distances.astype(np.float32), pair, notes)

    def _is_own_steps(self, surface: MappedSurface) -> Steps[bool]:
        """Return whether the target is the structure of the surface itself."""
        if isinstance(self.target, TriangleMesh):
            return False
        return (yield from _label_steps(surface.volume, self.target)) == surface.settings.label

    def _target_steps(self, surface: MappedSurface) -> Steps[TriangleMesh]:
        """Return the surface of the target, which has triangles."""
        target = self.target
        if not isinstance(target, TriangleMesh):
            value = yield from _label_steps(surface.volume, target)
            full = surface.settings.without("simplification")
            settings = replace(full, threshold=None, upper=None, label=value)
            target = yield from surface.surface_steps(settings)
        if not len(target.faces):
            raise MeshError(f"{self.target_name} has no triangles to measure a distance to; choose another structure")
        return target

    @classmethod
    def from_text_steps(cls, text: str, inputs: Inputs, options: Mapping[str, Any]) -> Steps[Quantity]:
        """Return the distance to the structure that `text` names in the volume, else to the surface in that file."""
        choice = int(text) if text.isdecimal() else text
        try:
            yield from _label_steps(inputs.volume, choice)
        except LabelError:
            path = Path(text)
            if not (path.suffix or len(path.parts) > 1 or path.exists()):
                raise
            target = yield from inputs.surface_steps(text)
            stem = path.stem
            return cls(target, Path(stem).stem if stem.lower().endswith(SECOND_SUFFIXES) else stem)
        return cls(choice)


def _label_steps(volume: Volume, choice: str | int) -> Steps[int]:
    """Return the label with a name or number."""
    values = yield from chosen_labels_steps(volume, [choice])
    if len(values) != 1:
        raise LabelError(
            f"{choice!r} means {len(values)} labels, {', '.join(map(str, values[:8]))}; give the number of one"
        )
    return values[0]
