# SPDX-License-Identifier: GPL-3.0-or-later
"""Handle files of operators: paths relative to the .blend, and a dialog for a file to write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from ...core import CtmcError
from ...core.files.file_names import with_suffix
from .. import jobs
from ..translations import translate

RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()
"""Option of a path property: a path that begins with // is meant so. Older Blenders ask for no such word."""


class SaveDialog:
    """An operator that asks for a file and writes it; inherited before `bpy.types.Operator`."""

    suffixes: tuple[str, ...] = ()
    """Accepted suffixes in small letters; a name without one of them gets `ending`."""

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    check_existing: BoolProperty(default=True, options={"HIDDEN"})

    def ending(self) -> str:
        """Return the suffix of a name without one."""
        return self.suffixes[0]

    def suggestion(self, context: bpy.types.Context) -> str:
        """Suggest a name for the file."""
        raise NotImplementedError

    def write(self, context: bpy.types.Context, path: Path) -> None:
        """Write the file."""
        raise NotImplementedError

    def report_of(self, path: Path) -> str:
        """Return the report of a written file."""
        return translate("Wrote {name}").format(name=path.name)

    def warnings(self, context: bpy.types.Context) -> list[str]:
        """Return warnings for readers of the file; none by default."""
        return []

    def invoke(self: Any, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        self.filepath = self.filepath or self.suggestion(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def check(self, _context: bpy.types.Context) -> bool:
        """Complete the name in the dialog, so that the dialog asks before a file is replaced."""
        before, self.filepath = self.filepath, with_suffix(self.filepath, self.ending(), self.suffixes)
        return bool(before != self.filepath)

    def execute(self: Any, context: bpy.types.Context) -> set[str]:
        """Write the file and report it."""
        path = Path(bpy.path.abspath(with_suffix(self.filepath, self.ending(), self.suffixes)))
        try:
            self.write(context, path)
        except CtmcError as error:
            return jobs.refuse(self, context.scene.session_uid, error)
        wrote, warnings = self.report_of(path), self.warnings(context)
        self.report({"WARNING"} if warnings else {"INFO"}, "; ".join([wrote, *warnings]))
        return {"FINISHED"}
