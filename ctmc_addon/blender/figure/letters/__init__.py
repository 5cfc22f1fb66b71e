# SPDX-License-Identifier: GPL-3.0-or-later
"""Write the letters of figures in a font in which 1, I and l differ, the same in every Blender.

`ctmc-letters.woff2` is made by tools/make_font.py from GNU FreeFont's FreeSans (COPYING.txt), in which a text object
leaves no holes. Characters that it lacks are taken from Blender's own font, which has other fonts behind it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("ctmc-letters.woff2")
CAP = 0.729  # Height of a capital letter, as a share of the em.
EM = 1.2660  # Blender's size of letters over the em, because Blender measures from the lowest to the highest outline.
CHARACTERS = frozenset(
    chr(code)
    for codes in (
        range(0x20, 0x7F),  # ASCII
        range(0xA0, 0x180),  # Latin-1 and Latin Extended-A
        range(0x386, 0x3CF),  # Greek
        range(0x400, 0x460),  # Cyrillic
        range(0x2010, 0x2027),  # Dashes, quotation marks, dots.
        (0x202F, 0x2032, 0x2033, 0x20AC, 0x2122, 0x2190, 0x2191, 0x2192, 0x2193),
        (0x2206, 0x2211, 0x2212, 0x221A, 0x221E, 0x2248, 0x2260, 0x2264, 0x2265),
    )
    for code in codes
)


def text_curve(body: str, size: float) -> Any:
    """Return a text of this size as a curve; the font is stored in the file."""
    import bpy

    curve: Any = bpy.data.curves.new("CTMC Text", "FONT")
    blenders = curve.font
    curve.font, curve.font_bold = font(), blenders
    curve.body, curve.size = body, EM * size
    for character, settings in zip(body, curve.body_format, strict=True):
        settings.use_bold = character not in CHARACTERS
    return curve


def font() -> Any:
    """Return the font as a packed data-block, so that a .blend names no folder of this machine."""
    import bpy

    for block in bpy.data.fonts:
        if block.packed_file and Path(block.filepath).name == FILE.name:
            return block
    block = bpy.data.fonts.load(str(FILE))
    block.user_clear()  # Blender counts the loading itself
    block.pack()
    block.filepath = f"//{FILE.name}"
    return block
