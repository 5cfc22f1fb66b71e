# SPDX-License-Identifier: GPL-3.0-or-later
"""The letters of figures, from the Inter that Blender brings: `python tools/make_font.py`.

Blender's Inter is a variable font, whose outlines overlap; a text object leaves holes where they do. This one is its
regular weight with the overlaps merged, without what Blender does not use, and with Latin, Greek, Cyrillic and
mathematical signs alone. Blender takes other scripts from its own fonts. Needs
`pip install fonttools brotli skia-pathops`.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Any

from ctmc_addon.blender.figure.letters import CHARACTERS, FILE

NAME = "CTMC Letters"


def main() -> int:
    """Write the font; 0 if all went well."""
    source = blenders_inter()
    font = importlib.import_module("fontTools.ttLib").TTFont(source, recalcTimestamp=False)
    font = regular(font)
    subset(font)
    rename(font)
    font.flavor = "woff2"
    font.save(FILE)
    print(f"{FILE.name}: {FILE.stat().st_size} bytes, {len(font.getGlyphOrder())} glyphs, from {source}")
    return 0


def blenders_inter() -> Path:
    """The file in the installed bpy wheel, found without starting Blender."""
    spec = importlib.util.find_spec("bpy")
    folders = (spec.submodule_search_locations if spec else None) or [str(Path(sys.argv[-1]))]
    return next(Path(folders[0]).rglob("Inter.woff2"))


def regular(font: Any) -> Any:
    """The regular weight at text size, overlaps merged."""
    instancer = importlib.import_module("fontTools.varLib.instancer")
    place = {"wght": 400, "opsz": 14}
    return instancer.instantiateVariableFont(font, place, overlap=instancer.OverlapMode.REMOVE)


def subset(font: Any) -> None:
    """Keep our characters; Blender places letters by their widths alone."""
    module = importlib.import_module("fontTools.subset")
    options = module.Options(layout_features=[], hinting=False, notdef_outline=True, name_IDs=["*"])
    options.drop_tables += ["GPOS", "GSUB", "GDEF", "STAT", "MVAR", "HVAR", "avar"]
    subsetter = module.Subsetter(options)
    subsetter.populate(unicodes=map(ord, CHARACTERS))
    subsetter.subset(font)


def rename(font: Any) -> None:
    """Another name than Inter, which is a trademark; the copyright and the license stay."""
    names = font["name"]
    names.names = [name for name in names.names if name.nameID in (0, 5, 13, 14)]
    for which, text in ((1, NAME), (2, "Regular"), (3, NAME), (4, NAME), (6, NAME.replace(" ", ""))):
        names.setName(text, which, 3, 1, 0x409)


if __name__ == "__main__":
    sys.exit(main())
