"""The paper a figure is printed on: millimetres, pixels, and the PNG that knows its size.

Page space: millimetres from the page's lower left corner, x to the right and y up. A figure's camera is orthographic,
so a millimetre of the page is everywhere the same number of Blender units.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from ...core import OutputError, SettingsError

MM_PER_INCH = 25.4
WIDTHS_MM = (20.0, 400.0)
DPIS = (36.0, 600.0)
FONTS_PT = (4.0, 24.0)
PIXELS = 80_000_000  # what Cycles can hold on a usual machine
POINT_MM = MM_PER_INCH / 72

# What a picture needs; the rest is text, times and names.
PNG_CHUNKS = (b"IHDR", b"PLTE", b"tRNS", b"gAMA", b"cHRM", b"sRGB", b"pHYs", b"IDAT", b"IEND")

Box = tuple[float, float, float, float]  # left, bottom, right, top


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
        sides = [("width", self.width_mm), *([("height", self.height_mm)] if self.height_mm is not None else [])]
        for name, side in sides:
            if not WIDTHS_MM[0] <= side <= WIDTHS_MM[1]:
                raise SettingsError(f"a figure's {name} must be from {limits(WIDTHS_MM)} mm, not {side:g}")
        if not DPIS[0] <= self.dpi <= DPIS[1]:
            raise SettingsError(f"a figure's resolution must be from {limits(DPIS)} dpi, not {self.dpi:g}")
        if not FONTS_PT[0] <= self.font_pt <= FONTS_PT[1]:
            raise SettingsError(f"a figure's letters must be from {limits(FONTS_PT)} points, not {self.font_pt:g}")

    @property
    def font_mm(self) -> float:
        """Size of the letters, mm."""
        return self.font_pt * POINT_MM

    @property
    def pixels_per_mm(self) -> float:
        """Pixels to the millimetre."""
        return self.dpi / MM_PER_INCH

    def pixels(self, height_mm: float, even: bool = False) -> tuple[int, int]:
        """Width and height in pixels; films need even ones.

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


# Where each kind starts from: a column of a journal, two columns, a film.
PAGES = {"figure": Page(), "sheet": Page(170.0), "turntable": Page(120.0, 150.0, font_pt=12.0)}


def limits(pair: tuple[float, float]) -> str:
    """'20 to 400'."""
    return f"{pair[0]:g} to {pair[1]:g}"


def finished_png(png: bytes, name: str, dpi: float | None = None) -> bytes:
    """The PNG without texts and times, which would name the machine and differ from run to run.

    Parameters
    ----------
    dpi : float or None
        Noted as pixels to the metre (PNG specification, 11.3.5.3); None keeps what is there.

    Raises
    ------
    OutputError
        If it ends before its last chunk (PNG specification, 5.3).
    """
    kept, at = [png[:8]], 8
    while at + 12 <= len(png):
        length, kind = struct.unpack(">I4s", png[at : at + 8])
        if at + 12 + length > len(png):
            break
        if kind in PNG_CHUNKS and (kind != b"pHYs" or dpi is None):
            kept.append(png[at : at + 12 + length])
        if kind == b"IHDR" and dpi is not None:
            kept.append(size_chunk(dpi))
        at += 12 + length
        if kind == b"IEND":
            return b"".join(kept)
    raise OutputError(f"{name} came out incomplete and was removed; free some space or choose another disk")


def size_chunk(dpi: float) -> bytes:
    """A PNG's pHYs chunk."""
    per_metre = round(dpi / MM_PER_INCH * 1000)
    body = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    return struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
