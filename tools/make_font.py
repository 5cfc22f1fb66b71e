# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the font of figures from GNU FreeFont's FreeSans: `python tools/make_font.py FreeSans.otf`.

FreeSans has the shapes of Helvetica, which journals ask for, and the license of this project. Its small l is a bar as
its capital I is, so l gets the hook of t. Outlines that overlap are merged, because a text object leaves holes there;
Latin, Greek, Cyrillic and mathematical signs are kept. Blender takes other scripts from its own fonts. The file is in
Debian's package fonts-freefont-otf. Needs `pip install fonttools brotli skia-pathops`.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from ctmc_addon.blender.figure.letters import CHARACTERS, FILE

NAME = "CTMC Letters"
SMALL_L = 240  # Width with the hook, thousandths of the em.


def main() -> int:
    """Write the font; 0 if all went well."""
    if len(sys.argv) != 2 or not Path(sys.argv[1]).is_file():
        print("make_font: give the path of FreeSans.otf, of Debian's package fonts-freefont-otf", file=sys.stderr)
        return 2
    font = importlib.import_module("fontTools.ttLib").TTFont(sys.argv[1], recalcTimestamp=False)
    subset(font)
    hook_small_l(font)
    importlib.import_module("fontTools.ttLib.removeOverlaps").removeOverlaps(font)
    rename(font)
    font.flavor = "woff2"
    font.save(FILE)
    print(f"{FILE.name}: {FILE.stat().st_size} bytes, {len(font.getGlyphOrder())} glyphs")
    return 0


def subset(font: Any) -> None:
    """Keep our characters, without kerning: Blender places letters by their widths."""
    module = importlib.import_module("fontTools.subset")
    options = module.Options(layout_features=[], hinting=False, notdef_outline=True, name_IDs=["*"])
    options.drop_tables += ["GPOS", "GSUB", "GDEF", "STAT", "MVAR", "HVAR", "avar"]
    subsetter = module.Subsetter(options)
    subsetter.populate(unicodes=map(ord, CHARACTERS))
    subsetter.subset(font)


def hook_small_l(font: Any) -> None:
    """Draw a small l whose stem ends in the hook of t."""
    pen = importlib.import_module("fontTools.pens.t2CharStringPen").T2CharStringPen(SMALL_L, None)
    pen.moveTo((144, 729))
    pen.lineTo((60, 729))
    pen.lineTo((60, 60))
    pen.curveTo((60, 7), (96, -23), (161, -23))
    pen.curveTo((181, -23), (195, -21), (215, -17))
    pen.lineTo((215, 53))
    pen.curveTo((206, 51), (198, 50), (189, 50))
    pen.curveTo((153, 50), (144, 60), (144, 97))
    pen.closePath()
    top = font["CFF "].cff.topDictIndex[0]
    old = top.CharStrings["l"]
    top.CharStrings["l"] = pen.getCharString(private=old.private, globalSubrs=old.globalSubrs)
    font["hmtx"]["l"] = (SMALL_L, 60)


def rename(font: Any) -> None:
    """Give the font a name of its own; the copyright and the license stay."""
    names = font["name"]
    names.names = [name for name in names.names if name.nameID in (0, 5, 13, 14) and name.langID in (0, 0x409)]
    for which, text in ((1, NAME), (2, "Regular"), (3, NAME), (4, NAME), (6, NAME.replace(" ", ""))):
        names.setName(text, which, 3, 1, 0x409)


if __name__ == "__main__":
    sys.exit(main())
