# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint the values of a volume on a surface: dose, tracer, perfusion, or the CT itself below the surface."""

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

FINENESS = 2  # Take at least this many samples along a line for each side of a voxel.
DEEPEST_MM = 1000.0
RESERVED = frozenset({*"xyz", "x_mm", "y_mm", "z_mm", "nx", "ny", "nz", "position", "normal", "red", "green", "blue"})
"""Names that tables, PLY files and Blender's meshes already use."""
LONGEST_NAME = 60  # Blender cuts names of attributes with more characters than about this.


@dataclass(frozen=True)
class PaintOptions(Described):
    """Options for painting a volume onto a surface."""

    paint_depth: float = setting(
        0.0,
        "Depth below the surface down to which values are sampled. 0 = only on the surface",
        label="Paint Depth",
        unit="mm",
        low=0.0,
        high=DEEPEST_MM,
    )
    paint_how: str = setting(
        "mean",
        "Which of the values within the paint depth is kept",
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
        Volume on any grid and orientation, in memory or in a file.
    name : str
        Name of the map.
    depth_mm : float
        Depth of samples from the surface inward, against its normal, in steps of at most half the smallest spacing; 0
        samples only the surface.
    how : {"mean", "max", "min"}
        Way to reduce the samples in the volume to one value.

    Raises
    ------
    SettingsError
        If the name is empty, too long or reserved, the depth is outside its limits, or `how` is unknown.
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
        """Sample the volume at the vertices, or along lines from them inward."""
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
        """Read the volume of `NAME=PATH` after checking the name.

        Parameters
        ----------
        text : str
        inputs : Inputs
        options : mapping
            Fields of `PaintOptions` that were given.

        Raises
        ------
        SettingsError
            If the text is not NAME=PATH, or the name cannot be used.
        """
        name, equals, path = (part.strip() for part in text.partition("="))
        if not equals or not name or not path:
            raise SettingsError(f"--{cls.flag} takes {cls.metavar}, not {text!r}; such as --paint dose=RTDOSE.dcm")
        _checked_name(name)
        given = PaintOptions(**options)
        volume = yield from inputs.volume_steps(path)
        return cls(volume, name, given.paint_depth, given.paint_how)


def _checked_name(name: str) -> str:
    """Return the name of a map; raise a `SettingsError` for one that files or Blender cannot use."""
    if not name.strip() or not name.isprintable():
        raise SettingsError(f"a painted volume needs a name of printable letters, not {name!r}; such as dose")
    if name.casefold() in RESERVED:
        raise SettingsError(f"the name {name!r} is reserved for positions, normals and colors; choose another")
    if len(name) > LONGEST_NAME:
        raise SettingsError(f"the name {name!r} has {len(name)} letters; use at most {LONGEST_NAME}")
    return name.strip()
