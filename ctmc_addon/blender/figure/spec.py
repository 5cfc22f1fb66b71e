# SPDX-License-Identifier: GPL-3.0-or-later
"""What a figure is: page, style, cells, a sheet's comparison, a turntable's turn; names, choices and limits of each.

No Blender here: the flags of the command line and the properties of the sidebar are made from this.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...core import ReconstructionSettings, SettingsError
from ...reporting.captions import smoothing_phrase, stride_phrase
from ..colors import GRAY, INK, RED, YELLOW, Color

MM_PER_INCH = 25.4
POINT_MM = MM_PER_INCH / 72
WIDTHS_MM = (20.0, 400.0)
DPIS = (36.0, 600.0)
FONTS_PT = (4.0, 24.0)
PIXELS = 80_000_000  # what Cycles can hold on a usual machine
AZIMUTH, ELEVATION = 30.0, 20.0  # of the camera, degrees
ELEVATIONS = (-90.0, 90.0)
OPACITY, OPACITIES = 0.3, (0.02, 1.0)  # of a transparent surface
MOST_CELLS = 26  # of a sheet: there is a letter for each
SECONDS, FPS, REVOLUTIONS = 3600.0, (1, 120), 100  # of a turntable: at most, from and to, at most

Box = tuple[float, float, float, float]  # left, bottom, right, top, mm from the page's lower left corner

# Container and codec, Blender's names, for every suffix of a video.
VIDEO_FORMATS = {
    ".mp4": ("MPEG4", "H264"),
    ".mkv": ("MKV", "H264"),
    ".mov": ("QUICKTIME", "H264"),
    ".webm": ("WEBM", "WEBM"),
    ".avi": ("AVI", "MPEG4"),
    ".ogv": ("OGG", "THEORA"),
}


@dataclass(frozen=True)
class Engine:
    """A render engine: Blender's name for it, its name in the panel, and what it is good for."""

    identifier: str
    label: str
    text: str


ENGINES = {
    "cycles": Engine("CYCLES", "Cycles", "On the processor, which works on any machine"),
    "eevee": Engine("BLENDER_EEVEE", "EEVEE", "Needs a graphics card, or time"),
    "workbench": Engine(
        "BLENDER_WORKBENCH", "Workbench", "The viewport's solid look, quickly; shows no map of distances"
    ),
}


@dataclass(frozen=True)
class SurfaceStyle:
    """The color of faces (None is the surface's own) and of triangle edges (None draws none)."""

    text: str
    face: Color | None
    edge: Color | None


STYLES = {
    "paper": SurfaceStyle("red faces, yellow triangle edges", RED, YELLOW),
    "clinical": SurfaceStyle("every surface smooth in its own color", None, None),
    "print": SurfaceStyle("gray faces, dark triangle edges, for black and white", GRAY, INK),
}


def require_within(what: str, value: float, limits: tuple[float, float], unit: str = "") -> None:
    """Raise `SettingsError` for a value outside its limits."""
    low, high = limits
    if not low <= value <= high:
        raise SettingsError(f"{what} must be from {low:g} to {high:g} {unit}".rstrip() + f", not {value:g}")


@dataclass(frozen=True)
class Page:
    """Width and resolution of a figure; its height follows from what is on it unless it is given.

    Parameters
    ----------
    width_mm : float
        As printed: one column of most journals is 85, two are 170.
    dpi : float
        Pixels to the inch, at most 600.
    height_mm : float or None
    transparent : bool
        No background instead of a white one.
    font_pt : float
        Size of the letters, points.

    Raises
    ------
    SettingsError
        If a value lies outside its limits.
    """

    width_mm: float = 85.0
    dpi: float = 300.0
    height_mm: float | None = None
    transparent: bool = False
    font_pt: float = 8.0

    def __post_init__(self) -> None:
        require_within("a figure's width", self.width_mm, WIDTHS_MM, "mm")
        if self.height_mm is not None:
            require_within("a figure's height", self.height_mm, WIDTHS_MM, "mm")
        require_within("a figure's resolution", self.dpi, DPIS, "dpi")
        require_within("the size of a figure's letters", self.font_pt, FONTS_PT, "points")

    @property
    def font_mm(self) -> float:
        """Size of the letters, mm."""
        return self.font_pt * POINT_MM

    @property
    def pixels_per_mm(self) -> float:
        """Pixels to the millimeter."""
        return self.dpi / MM_PER_INCH

    def pixels(self, height_mm: float, even: bool = False) -> tuple[int, int]:
        """Width and height in pixels; videos need even ones.

        Raises
        ------
        SettingsError
            If that is more than a machine can be expected to render.
        """
        step = 2 if even else 1
        width, height = (
            max(step, step * round(side * self.pixels_per_mm / step)) for side in (self.width_mm, height_mm)
        )
        if width * height > PIXELS:
            raise SettingsError(
                f"{width} x {height} pixels are more than {PIXELS // 10**6} million; choose a smaller width or dpi"
            )
        return width, height


# Where each kind starts from: a column of a journal, two columns, a video.
PAGES = {"figure": Page(), "sheet": Page(170.0), "turntable": Page(120.0, 150.0, font_pt=12.0)}


@dataclass(frozen=True)
class ColorScale:
    """Distances from 0 to `limit_mm` and their colors; `beyond` says that some are larger."""

    limit_mm: float
    beyond: bool = False
    title: str = "distance, mm"


@dataclass(frozen=True)
class ShownSurface:
    """A surface in a figure.

    Parameters
    ----------
    obj : bpy.types.Object
        A mesh object; its evaluated state is shown.
    name : str
        In the legend; empty for none.
    color : (red, green, blue) or None
        Linear; None takes the style's, else that of the object's material.
    opacity : float
        Below 1 it is transparent.
    """

    obj: Any
    name: str = ""
    color: Color | None = None
    opacity: float = 1.0


@dataclass(frozen=True)
class RulerMark:
    """A distance between two places, or an angle at the second of three: world space, and what is written at it."""

    places: tuple[tuple[float, float, float], ...]
    text: str


@dataclass(frozen=True)
class Cell:
    """What is shown together, and the lines of caption under it.

    Parameters
    ----------
    slices : tuple of bpy.types.Object
        Made by `add_slice`; shown as they are.
    rulers : tuple of RulerMark
        Drawn before everything else, as what they measure may lie inside.
    """

    surfaces: tuple[ShownSurface, ...]
    lines: tuple[str, ...] = ()
    slices: tuple[Any, ...] = ()
    rulers: tuple[RulerMark, ...] = ()


@dataclass(frozen=True)
class FigureStyle:
    """How a figure is seen and what is written on it.

    Parameters
    ----------
    style : {"paper", "clinical", "print"}
    engine : {"cycles", "eevee", "workbench"}
    azimuth, elevation : float
        Where the camera stands, degrees: from the patient's front towards the left, and up.
    edges : bool or None
        Triangle edges; None leaves that to the style.
    scale_bar, orientation : bool
    caption : str
        Under the whole.
    columns : int or None
        Cells side by side.
    distances : ColorScale or None
        Colors for the distances that the surfaces carry, in place of the style's.
    samples : int or None
        Of Cycles; None takes what the resolution needs.

    Raises
    ------
    SettingsError
        If the camera would stand head down.
    """

    style: str = "paper"
    engine: str = "cycles"
    azimuth: float = AZIMUTH
    elevation: float = ELEVATION
    edges: bool | None = None
    scale_bar: bool = True
    orientation: bool = True
    caption: str = ""
    columns: int | None = None
    distances: ColorScale | None = None
    samples: int | None = None

    def __post_init__(self) -> None:
        require_within("the camera's elevation", self.elevation, ELEVATIONS, "degrees")

    @property
    def edge(self) -> Color | None:
        """The color of triangle edges, None for no edges."""
        own = STYLES[self.style].edge
        if self.edges is False or (self.edges is None and own is None):
            return None
        return own or INK


@dataclass(frozen=True)
class Turn:
    """How long a turntable turns and how far.

    Parameters
    ----------
    seconds : float
        Of the whole loop.
    fps : int
        Frames a second.
    revolutions : int
        Whole turns in the loop; negative ones turn the other way.

    Raises
    ------
    SettingsError
        If a value lies outside its limits.
    """

    seconds: float = 6.0
    fps: int = 24
    revolutions: int = 1

    def __post_init__(self) -> None:
        require_within("a turntable's frames a second", self.fps, FPS)
        if self.revolutions == 0 or abs(self.revolutions) > REVOLUTIONS:
            raise SettingsError(f"revolutions must be from 1 to {REVOLUTIONS}, or negative, not {self.revolutions}")
        if not 0 < self.seconds <= SECONDS or self.frames < 2 * abs(self.revolutions) + 1:
            raise SettingsError(
                f"{self.seconds:g} s at {self.fps} frames a second are too few or too many frames for "
                f"{abs(self.revolutions)} revolutions; take up to {SECONDS:g} s and at least 3 frames a revolution"
            )

    @property
    def frames(self) -> int:
        """Pictures in the loop."""
        return round(self.seconds * self.fps)

    def degrees(self, frame: int) -> float:
        """How far the surface has turned in frame 0, 1, ..."""
        return 360.0 * self.revolutions * frame / self.frames


@dataclass(frozen=True)
class Comparison:
    """What a sheet compares: one of these, or two of them crossed, the first down and the second across.

    Parameters
    ----------
    strides : sequence of (x, y)
        Voxel sides, px.
    alphas : sequence of float
    levels : sequence of float
        Share of the triangles to remove, per cent.
    smoothings : sequence of {"none", "gaussian", "constrained"}

    Raises
    ------
    SettingsError
        If none or more than two are given, or they make too many cells.
    """

    strides: Sequence[tuple[int, int]] = ()
    alphas: Sequence[float] = ()
    levels: Sequence[float] = ()
    smoothings: Sequence[str] = ()

    def __post_init__(self) -> None:
        many = self.counts
        if not 1 <= len(many) <= 2:
            raise SettingsError(
                "a sheet compares strides, alphas, levels or smoothings, or two of them crossed; give one or two"
            )
        count = many[0] * many[-1] if len(many) == 2 else many[0]
        if count > MOST_CELLS:
            raise SettingsError(f"{count} cells are more than there are letters; compare at most {MOST_CELLS}")
        for level in self.levels:
            if not 0 <= level <= 99:
                raise SettingsError(f"a level must be from 0 to 99 per cent of the triangles to remove, not {level:g}")

    @property
    def counts(self) -> list[int]:
        """How many values are compared along each axis."""
        return [len(axis) for axis in (self.smoothings, self.strides, self.alphas, self.levels) if axis]

    @property
    def columns(self) -> int | None:
        """Cells side by side where two are crossed, else None."""
        return self.counts[1] if len(self.counts) == 2 else None

    def variants(
        self, settings: ReconstructionSettings, spacing_mm: Sequence[float] = ()
    ) -> list[tuple[str, ReconstructionSettings]]:
        """The title and the settings of every cell; strides in mm too where the spacing is given."""
        axes: list[list[tuple[str, dict[str, Any]]]] = []
        if self.smoothings:
            axes.append([])
            for name in self.smoothings:
                change: dict[str, Any] = {
                    "smoothing": name,
                    "smoothing_mm": settings.smoothing_mm if name == "gaussian" else None,
                }
                axes[0].append((smoothing_phrase(replace(settings, **change)) or "not smoothed", change))
        if self.strides:
            z = settings.stride[2]
            axes.append([(stride_phrase((x, y), spacing_mm[:2]), {"stride": (x, y, z)}) for x, y in self.strides])
        if self.alphas:
            axes.append([(f"alpha {alpha:g}", {"alpha": alpha}) for alpha in self.alphas])
        if self.levels:
            free = {"target_faces": None, "max_error_mm": None, "simplifier": "builtin"}
            axes.append(
                [
                    (
                        f"{level:g} % simplified" if level else "not simplified",
                        {**free, "reduction": level / 100 or None},
                    )
                    for level in self.levels
                ]
            )
        out = []
        for choice in itertools.product(*axes):
            changes: dict[str, Any] = {}
            for _, change in choice:
                changes |= change
            out.append((", ".join(title for title, _ in choice), replace(settings, **changes)))
        return out
