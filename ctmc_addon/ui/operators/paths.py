"""Files that operators ask for: paths relative to the .blend, and names with their suffix."""

from __future__ import annotations

from pathlib import Path

import bpy

RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()
"""Option of a path property: a path that begins with // is meant so. Older Blenders ask for no such word."""


def with_suffix(filepath: str, suffix: str) -> str:
    """The path with `suffix` if its file has a name and no suffix."""
    name = Path(filepath).name if not filepath.endswith(("/", "\\")) else ""
    return filepath + suffix if name and not Path(name).suffix else filepath
