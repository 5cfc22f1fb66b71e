# SPDX-License-Identifier: GPL-3.0-or-later
"""Find which of our tools is active in the viewport."""

from __future__ import annotations

from typing import Any


def tool_of(context: Any) -> str:
    """Return the name of our active tool; empty for any other."""
    if context.workspace is None or context.mode != "OBJECT":
        return ""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    return tool.idname if tool is not None and tool.idname.startswith("ctmc.") else ""
