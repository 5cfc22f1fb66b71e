# SPDX-License-Identifier: GPL-3.0-or-later
"""Describe figures: page, style, cells, a sheet's comparison, a turntable's turn.

No Blender here: the flags of the command line and the properties of the sidebar are made from this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ...core import Described, ExplodedView as ExplodedView, SettingsError, setting
from ..colors import GRAY, INK, RED, YELLOW, Color
from .color_scale import ColorScale as ColorScale
from .comparison import Comparison as Comparison

MM_PER_INCH = 25.4
POINT_MM = MM_PER_INCH / 72
PIXELS = 80_000_000  # Limit of Cycles' memory on a usual machine.
COLUMN_MM = 85.0  # A column of most journals.
FEW_STRUCTURES = 14  # Up to this many are named beside a picture; a page with more is two columns wide.
AZIMUTH, ELEVATION = 30.0, 20.0  # Camera position, degrees.

WHITE: Color = (1.0, 1.0, 1.0)
NIGHT: Color = (0.010, 0.011, 0.014)  # Color of a dark page.
CHALK: Color = (0.82, 0.82, 0.82)  # Color of letters on a dark page.

Box = tuple[float, float, float, float]  # Left, bottom, right and top, mm from the page's lower left corner.

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
    """A render engine: Blender's name for it, its name in the panel, and its purpose."""

    identifier: str
    label: str
    text: str


ENGINES = {
    "cycles": Engine("CYCLES", "Cycles", "on the processor, which works on any machine"),
    "eevee": Engine("BLENDER_EEVEE", "EEVEE", "needs a graphics card, else slow"),
    "workbench": Engine("BLENDER_WORKBENCH", "Workbench", "the viewport's solid look, quickly; shows no map"),
}


@dataclass(frozen=True)
class _SurfaceStyle:
    """The color of faces (None is the surface's own) and of triangle edges (None draws none)."""

    text: str
    face: Color | None
    edge: Color | None


STYLES = {
    "illustration": _SurfaceStyle("soft light, shaded recesses, outlines, names beside the structures", None, None),
    "paper": _SurfaceStyle("red faces, yellow triangle edges, like Su and Ma", RED, YELLOW),
    "clinical": _SurfaceStyle("every surface smooth in its own color", None, None),
    "print": _SurfaceStyle("gray faces, dark triangle edges, for black and white", GRAY, INK),
}


@dataclass(frozen=True)
class Page(Described):
    """Width and resolution of a figure; its height follows from what is on it unless it is given.

    Raises
    ------
    SettingsError
        If a value lies outside its limits.
    """

    width_mm: float | None = setting(
        None,
        "Width as printed. A column of most journals is 85 mm, two are 170",
        label="Width",
        unit="mm",
        low=20.0,
        high=400.0,
        start=COLUMN_MM,
        without=f"one column, two for more than {FEW_STRUCTURES} structures",
    )
    dpi: float = setting(
        300.0,
        "Pixels per inch. Larger = sharper, and slower to render",
        label="Resolution",
        unit="dpi",
        low=36.0,
        high=600.0,
    )
    height_mm: float | None = setting(
        None,
        "Height as printed",
        label="Height",
        unit="mm",
        low=20.0,
        high=400.0,
        start=60.0,
        without="as high as the surface needs",
    )
    transparent: bool = setting(
        False, "No background instead of a white one; videos always have one", label="Transparent", type=bool
    )
    dark: bool = setting(False, "A dark page with light letters instead of a white one", label="Dark Page", type=bool)
    font_pt: float = setting(8.0, "Size of the letters", label="Letters", unit="pt", low=4.0, high=24.0)

    @property
    def paper(self) -> Color:
        """Return the color of the page."""
        return NIGHT if self.dark else WHITE

    @property
    def pen(self) -> Color:
        """Return the color of letters and lines."""
        return CHALK if self.dark else INK

    @property
    def font_mm(self) -> float:
        """Return the size of the letters, mm."""
        return self.font_pt * POINT_MM

    @property
    def pixels_per_mm(self) -> float:
        """Return how many pixels a millimeter has."""
        return self.dpi / MM_PER_INCH

    @property
    def printed_width_mm(self) -> float:
        """Return the width; by default that of a column."""
        return self.width_mm or COLUMN_MM

    def wide(self, structures: int) -> Page:
        """Return the page with a width: its own, else a journal's column, or two for a long legend.

        Examples
        --------
        >>> Page().wide(3).width_mm, Page().wide(61).width_mm, Page(40.0).wide(61).width_mm
        (85.0, 170.0, 40.0)
        """
        if self.width_mm is not None:
            return self
        return replace(self, width_mm=COLUMN_MM if structures <= FEW_STRUCTURES else 2 * COLUMN_MM)

    def pixels(self, height_mm: float, even: bool = False) -> tuple[int, int]:
        """Return width and height in pixels; videos need even ones.

        Raises
        ------
        SettingsError
            If the picture is too large to render on a usual machine.
        """
        step = 2 if even else 1
        sides_mm = (self.printed_width_mm, height_mm)
        width, height = (max(step, step * round(side * self.pixels_per_mm / step)) for side in sides_mm)
        if width * height > PIXELS:
            raise SettingsError(
                f"{width} x {height} pixels are more than {PIXELS // 10**6} million; choose a smaller width or dpi"
            )
        return width, height


# Where each kind starts from: a column of a journal, two columns, a video.
PAGES = {"figure": Page(), "sheet": Page(170.0), "turntable": Page(120.0, 150.0, font_pt=12.0)}


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
    shift : (x, y, z) float
        Where it is shown in an exploded view, Blender units from its place.
    """

    obj: Any
    name: str = ""
    color: Color | None = None
    opacity: float = 1.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class RulerMark:
    """A distance between two positions, or an angle at the second of three, world space, with its text."""

    points: tuple[tuple[float, float, float], ...]
    text: str


@dataclass(frozen=True)
class Cell:
    """Objects that a cell shows, and the lines of its caption.

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
class FigureStyle(Described):
    """Camera and text of a figure.

    Parameters
    ----------
    colors : ColorScale or None
        Colors of a map on the surfaces, instead of the style's.
    samples : int or None
        Samples of Cycles, without denoising; None takes as many as the noise needs.

    Raises
    ------
    SettingsError
        If a value lies outside its limits: above 90 degrees of elevation the camera would stand head down.
    """

    style: str = setting(
        "illustration",
        "How surfaces look. Several at once keep their own colors; print makes all of them gray",
        label="Style",
        choices=tuple(STYLES),
        choice_texts={name: style.text for name, style in STYLES.items()},
        type=str,
    )
    engine: str = setting(
        "cycles",
        "Render engine",
        label="Engine",
        note="EEVEE and Workbench need EGL on Linux",
        choices=tuple(ENGINES),
        choice_labels={name: engine.label for name, engine in ENGINES.items()},
        choice_texts={name: engine.text for name, engine in ENGINES.items()},
        type=str,
    )
    azimuth: float = setting(
        AZIMUTH,
        "Where the camera stands: 0 = in front of the patient, 90 = at the left, 180 = behind",
        label="Azimuth",
        unit="degrees",
    )
    elevation: float = setting(
        ELEVATION,
        "How high the camera stands: 90 = above the head, -90 = below the feet",
        label="Elevation",
        unit="degrees",
        low=-90.0,
        high=90.0,
    )
    edges: bool | None = setting(
        None, "Draw the edges of the triangles", label="Edges", type=bool, start=True, without="as in the style"
    )
    scale_bar: bool = setting(True, "Draw a scale bar of round length in mm", label="Scale Bar", type=bool)
    orientation: bool = setting(
        True,
        "Draw the patient's axes: R and L, A and P (front and back), S and I (head and feet)",
        label="Orientation",
        type=bool,
    )
    caption: str | None = setting(
        None,
        "Caption under the figure",
        label="Caption",
        note="'' for none",
        type=str,
        start="Bone",
        without="what it shows",
    )
    columns: int | None = setting(
        None, "Cells side by side in a sheet", label="Columns", low=1, type=int, start=2, without="as many as fit"
    )
    colors: ColorScale | None = None
    samples: int | None = None

    @property
    def edge(self) -> Color | None:
        """Return the color of triangle edges; None for no edges."""
        own = STYLES[self.style].edge
        if self.edges is False or (self.edges is None and own is None):
            return None
        return own or INK


@dataclass(frozen=True)
class Transparency(Described):
    """Opacity of a surface that hides a tumor from the camera."""

    hiding_opacity: float = setting(
        0.3,
        "Opacity of structures that hide a tumor from the camera; without a tumor, of the one that hides all others. "
        "Smaller = clearer",
        label="Opacity",
        low=0.02,
        high=1.0,
    )


@dataclass(frozen=True)
class DistanceMapSettings(Described):
    """Switch for colors by distance, and the end of the color scale."""

    deviation: bool = setting(
        False, "Color every surface by its distance to full resolution, with a color bar", label="Distances", type=bool
    )
    limit_mm: float | None = setting(
        None,
        "Distance at the end of the color bar",
        label="Bar End",
        unit="mm",
        low=0.0,
        low_open=True,
        high=1000.0,
        start=1.0,
        without="the distance within which 99 % of the points are",
    )


@dataclass(frozen=True)
class Turn(Described):
    """Length and number of turns of a turntable's loop.

    Raises
    ------
    SettingsError
        If a value lies outside its limits, or the frames are too few or too many for the turns.
    """

    seconds: float = setting(
        6.0,
        "Length of the loop. Larger = slower motion, and longer to render",
        label="Length",
        unit="s",
        low=0.0,
        low_open=True,
        high=3600.0,
    )
    fps: int = setting(
        24,
        "Frames per second. Larger = smoother, and slower to render",
        label="Frame Rate",
        unit="fps",
        low=1,
        high=120,
        type=int,
    )
    revolutions: int = setting(
        1, "Full turns in the loop. Negative = the other way round", label="Revolutions", low=-100, high=100, type=int
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.revolutions == 0:
            raise SettingsError("revolutions must be from 1 to 100, or negative, not 0")
        if self.frames < 2 * abs(self.revolutions) + 1:
            raise SettingsError(
                f"{self.seconds:g} s at {self.fps} frames per second are too few frames for "
                f"{abs(self.revolutions)} revolutions; use at least 3 frames per revolution"
            )

    @property
    def frames(self) -> int:
        """Return how many pictures the loop has."""
        return round(self.seconds * self.fps)

    def degrees(self, frame: int) -> float:
        """Return how far the surface has turned in a frame, the first of which is 0."""
        return 360.0 * self.revolutions * frame / self.frames


FIGURE_SETTINGS = (Page, FigureStyle, Transparency, ExplodedView, DistanceMapSettings, Comparison, Turn)
"""All that describes itself here: the table `[figure]` of a settings file."""
