# SPDX-License-Identifier: GPL-3.0-or-later
"""A quantity that a map can show; each is a class of its own module and a line of `core/maps/quantities.py`."""

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
    """What a quantity gives.

    Parameters
    ----------
    values : (V,) float32
        On the vertices of the surface; NaN where there is no value.
    nearest : (point, point), optional
        The nearest two points of the surface and of another, RAS+ mm.
    notes : tuple of str
        What was assumed or left out, in sentences.
    """

    values: Floats
    nearest: tuple[Point, Point] | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MappedSurface:
    """A finished surface that quantities are worked out on.

    Parameters
    ----------
    mesh : TriangleMesh
        RAS+ mm, as it is written and shown.
    settings : ReconstructionSettings
        Settings that it was made with.
    volume : Volume
        Volume that it was made from.
    budget : Budget
    surface_steps : callable
        Makes another surface of the same volume, by its settings, as steps.
    """

    mesh: TriangleMesh
    settings: ReconstructionSettings
    volume: Volume
    budget: Budget
    surface_steps: Callable[[ReconstructionSettings], Steps[TriangleMesh]]


class Inputs(Protocol):
    """Files that the text of a flag may name; front ends open them."""

    @property
    def volume(self) -> Volume:
        """The volume that surfaces are made from."""

    def volume_steps(self, path: str) -> Steps[Volume]:
        """Read a volume."""

    def surface_steps(self, path: str) -> Steps[TriangleMesh]:
        """Read the surface of an STL or PLY, or make that of a label volume; RAS+ mm."""


class Quantity(ABC):
    """A quantity on the vertices of a surface; subclasses are frozen dataclasses.

    Attributes
    ----------
    flag : str
        The flag without dashes, and the column of a manifest: 'thickness'.
    metavar : str
        The placeholder of the flag's value; empty for a flag without one.
    text, label : str
        Explanation and name for a person.
    ramp : str
        The color ramp, unless another is chosen.
    options : type, optional
        A `Described` dataclass whose fields become flags; all quantities of this flag share them.
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
        """Whether it asks for full surfaces."""
        return False

    @abstractmethod
    def values_steps(self, surface: MappedSurface) -> Steps[MapValues]:
        """Work the values out."""

    @classmethod
    def from_text_steps(cls, text: str, inputs: Inputs, options: Mapping[str, Any]) -> Steps[Quantity]:
        """Return the quantity that a flag's value asks for; `text` is empty for a flag without one.

        Parameters
        ----------
        text : str
        inputs : Inputs
        options : mapping
            Given fields of `cls.options`.
        """
        yield PAUSE
        return cls(**options)
