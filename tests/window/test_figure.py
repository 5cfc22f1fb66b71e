# SPDX-License-Identifier: GPL-3.0-or-later
"""Esc while a figure is rendered: the job ends, its process too, and nothing is left."""

from __future__ import annotations

from pathlib import Path

import pytest
from window.scenes import IDLE, begin, load

pytestmark = [pytest.mark.window, pytest.mark.once]

CALL = """
view = viewport()
panel = bpy.context.scene.ctmc_figure
panel.figure_width_mm, panel.figure_dpi = 300, 600  # minutes of work
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.figure("INVOKE_DEFAULT", filepath={!r})
"""
STEP = "(ours('ui.jobs').running().step.message if ours('ui.jobs').running() else 'no job')"


def renderers(folder: Path) -> list[str]:
    """The processes whose temporary files go to a folder; its last name is the same inside and outside."""
    return [
        environ.parent.name
        for environ in Path("/proc").glob("[0-9]*/environ")
        if f"/{folder.parent.name}/{folder.name}/.ctmc-".encode() in content(environ)
    ]


def content(file: Path) -> bytes:
    """The bytes of a file; none where it has gone."""
    try:
        return file.read_bytes()
    except OSError:
        return b""


def test_esc_ends_a_figure_while_it_is_rendered_and_leaves_nothing(desk):
    begin(desk, "figure")
    load(desk, f"{desk.inside}/volume-0.nii.gz")
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (4, 4, 1)")
    desk.press("bpy.ops.ctmc.reconstruct()", "reconstruct")
    desk.wait(f"{IDLE} and 'Bone 200 HU' in bpy.data.objects")
    scenes = desk.ask("answer = len(bpy.data.scenes)")
    out = desk.folder / "figures"
    out.mkdir(exist_ok=True)
    desk.ask(CALL.format(f"{desk.inside}/figures/bone.png"))
    desk.wait(f"'%' in {STEP} or {IDLE}")
    desk.look("figure-01-rendered")
    assert desk.ask(f"answer = {STEP}").startswith("Rendering bone.png")
    assert len(renderers(out)) == 1
    view = desk.ask("view = viewport().region; answer = [view.x + view.width // 3, view.y + view.height // 3]")
    desk.move(*view)
    desk.key("Escape")
    desk.wait(IDLE)
    desk.look("figure-02-stopped")
    assert list(out.iterdir()) == []
    assert renderers(out) == []
    assert desk.ask("answer = len(bpy.data.scenes)") == scenes
