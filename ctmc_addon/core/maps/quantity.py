# SPDX-License-Identifier: GPL-3.0-or-later
"""The base class of quantities; each quantity is a class in its own module and a line in `quantities.py`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

from ..arrays import Floats
from ..described import Described
from ..machine.budget import Budget
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import PAUSE, Steps
from ..settings import ReconstructionSettings
from ..volume.volume import Volume
from .surface_map import Point


class MapValues(NamedTuple):
    """Values of a quantity on a surface.

    Parameters
    ----------
    values : (V,) float32
        Values on the vertices of the surface; NaN for no value.
    nearest : (point, point), optional
        Nearest two points of the surface and of its target, RAS+ mm.
    notes : tuple of str
        Sentences about what was assumed or left out.
    """

    values: Floats
    nearest: tuple[Point, Point] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MappedSurface:
    """A finished surface on which quantities are calculated.

    Parameters
    ----------
    mesh : TriangleMesh
        The mesh that is written and shown, RAS+ mm.
    settings : ReconstructionSettings
        Settings that it was made with.
    volume : Volume
        Volume that it was made from.
    budget : Budget
    surface_steps : callable
        Makes a surface of the same volume from settings, in steps.
    """

    mesh: TriangleMesh
    settings: ReconstructionSettings
    volume: Volume
    budget: Budget
    surface_steps: Callable[[ReconstructionSettings], Steps[TriangleMesh]]


class Inputs(Protocol):
    """Files that the value of a flag may name; front ends open them."""

    @property
    def volume(self) -> Volume:
        """The volume from which surfaces are made."""

    def volume_steps(self, path: str) -> Steps[Volume]:
        """Read a volume."""

    def surface_steps(self, path: str) -> Steps[TriangleMesh]:
        """Return the surface of an STL or PLY file or of a label volume, RAS+ mm."""


class Quantity(ABC):
    """A quantity on the vertices of a surface; subclasses are frozen dataclasses.

    Attributes
    ----------
    flag : str
        The flag without dashes, and the column of a manifest: 'thickness'.
    metavar : str
        The placeholder of the flag's value; empty for a flag without a value.
    text, label : str
        Explanation and name for users.
    ramp : str
        The default color ramp.
    options : type, optional
        A `Described` dataclass whose fields become flags, shared by all quantities of this flag.
    """

    flag: ClassVar[str]
    metavar: ClassVar[str] = ""
    text: ClassVar[str]
    label: ClassVar[str]
    ramp: ClassVar[str] = "viridis"
    options: ClassVar[type[Described] | None] = None

    @property
    @abstractmethod
    def name(self) -> str:
        """The name of the map, with its unit: 'thickness_mm'."""

    @property
    def unit(self) -> str:
        """The unit of the values."""
        return "mm"

    @property
    def needs_full(self) -> bool:
        """Whether the map needs full surfaces."""
        return False

    @abstractmethod
    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Calculate the values."""

    @classmethod
    def from_text_steps(cls, text: str, inputs: Inputs, options: Mapping[str, Any]) -> Steps[Quantity]:
        """Return the quantity for the value of a flag; `text` is empty for a flag without a value.

        Parameters
        ----------
        text : str
        inputs : Inputs
        options : mapping
            Fields of `cls.options` that were given.
        """
        yield PAUSE
        return cls(**options)
