# SPDX-License-Identifier: GPL-3.0-or-later
"""The values of another volume on a surface: dose, tracer, perfusion, or the CT itself below it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..described import Described, setting
from ..errors import SettingsError
from ..mesh.face_normals import vertex_normals_steps
from ..progress import Stages, Steps
from ..volume.sampling import KEPT, Line, sampled_steps
from ..volume.volume import Volume
from .quantity import Inputs, MappedSurface, MapValues, Quantity

FINENESS = 2  # Samples along a line for each side of a voxel, at least.
DEEPEST_MM = 1000.0
RESERVED = frozenset({*"xyz", "x_mm", "y_mm", "z_mm", "nx", "ny", "nz", "position", "normal", "red", "green", "blue"})
"""Names that tables, PLY files and Blender's meshes have already."""
LONGEST_NAME = 60  # Letters; Blender cuts longer names of attributes.


@dataclass(frozen=True)
class PaintOptions(Described):
    """How a volume is painted onto a surface."""

    paint_depth: float = setting(
        0.0,
        "How far painting looks from the surface inward; 0 takes the values on the surface itself",
        label="Paint Depth",
        unit="mm",
        low=0.0,
        high=DEEPEST_MM,
    )
    paint_how: str = setting(
        "mean",
        "Which of the values found within the paint depth is kept",
        label="Keep",
        type=str,
        choices=KEPT,
        choice_labels={"mean": "Mean", "max": "Maximum", "min": "Minimum"},
    )


@dataclass(frozen=True)
class Painted(Quantity):
    """The values of a volume at the vertices, by trilinear interpolation; NaN beyond its outermost samples.

    Parameters
    ----------
    volume : Volume
        On any grid and orientation, in memory or in a file.
    name : str
        Name of the map.
    depth_mm : float
        If above 0, samples from the surface inward, against its normal, in steps of at most half the smallest spacing.
    how : {"mean", "max", "min"}
        What is kept of the samples that lie in the volume.

    Raises
    ------
    SettingsError
        If the name is empty, too long or reserved, or the depth or what is kept is outside its limits.
    """

    flag: ClassVar[str] = "paint"
    metavar: ClassVar[str] = "NAME=PATH"
    text: ClassVar[str] = "Paint the values of another volume, such as a dose or a PET, under a name"
    label: ClassVar[str] = "Painted Volume"
    options: ClassVar[type[Described] | None] = PaintOptions

    volume: Volume
    name: str = ""
    depth_mm: float = 0.0
    how: str = "mean"

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", _checked_name(self.name))
        checked = PaintOptions(self.depth_mm, self.how)
        object.__setattr__(self, "depth_mm", checked.paint_depth)

    @property
    def unit(self) -> str:
        """Unit of the volume's values: HU, Gy, g/ml, or none."""
        return self.volume.kind.unit

    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Sample the volume at the vertices, or from them inward."""
        stages = Stages({"Finding normals": 1, "Painting": 4})
        mesh, line = surface.mesh, None
        if self.depth_mm > 0:
            normals = mesh.normals
            if normals is None:
                finding = vertex_normals_steps(mesh.vertices, mesh.faces)
                normals = yield from stages.run("Finding normals", finding)
            steps = max(1, math.ceil(FINENESS * self.depth_mm / min(self.volume.spacing)))
            line = Line(normals, self.depth_mm, steps, self.how)
        sampling = sampled_steps(self.volume, mesh.vertices, line, surface.budget)
        return MapValues((yield from stages.run("Painting", sampling)), notes=tuple(self.volume.notes))

    @classmethod
    def from_text_steps(cls, text: str, inputs: Inputs, options: Mapping[str, Any]) -> Steps[Quantity]:
        """Read the volume of `NAME=PATH`; the name is checked before anything is read.

        Parameters
        ----------
        text : str
        inputs : Inputs
        options : mapping
            Given fields of `PaintOptions`.

        Raises
        ------
        SettingsError
            If the text is not NAME=PATH, or the name cannot be used.
        """
        name, equals, path = (part.strip() for part in text.partition("="))
        if not equals or not name or not path:
            raise SettingsError(f"--{cls.flag} takes {cls.metavar}, not {text!r}; such as --paint dose=RTDOSE.dcm")
        _checked_name(name)
        chosen = PaintOptions(**options)
        volume = yield from inputs.volume_steps(path)
        return cls(volume, name, chosen.paint_depth, chosen.paint_how)


def _checked_name(name: str) -> str:
    """Return the name of a map; raise a `SettingsError` for one that files and Blender cannot have."""
    if not name.strip() or not name.isprintable():
        raise SettingsError(f"a painted volume needs a name of printable letters, not {name!r}; such as dose")
    if name.casefold() in RESERVED:
        raise SettingsError(f"the name {name!r} is reserved for positions, normals and colors; choose another")
    if len(name) > LONGEST_NAME:
        raise SettingsError(f"the name {name!r} has {len(name)} letters; use at most {LONGEST_NAME}")
    return name.strip()
