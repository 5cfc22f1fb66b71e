# SPDX-License-Identifier: GPL-3.0-or-later
"""What several window tests ask of Blender and do before they begin."""

from __future__ import annotations

from window.desk import Desk

IDLE = "ours('ui.jobs').running() is None"
QUIET = "ours('ui.viewport.surface.live').live.changed is None"
LOADED = "ours('ui.state.ct.volumes').current(bpy.context.scene) is not None"
PRESSES = 20  # of Enter: Blender loses them while it reads a folder of many files
# Where the corners of the CT's box are on the screen: lowest and highest x and y, and those of what is free to see.
SEEN = """
view = viewport()
volume = ours("ui.state.ct.volumes").current(bpy.context.scene)
corners = [on_screen(corner * 0.01) for corner in ours("core.volume").volume_box(volume)]
xs, ys = zip(*corners)
top = view.window.height - view.region.y - view.region.height
bars = {bar.type: bar.width for bar in view.area.regions}
left, right = view.region.x + bars["TOOLS"], view.region.x + view.region.width - bars["UI"]
answer = [min(xs), max(xs), min(ys), max(ys), left, right, top, top + view.region.height]
"""


def begin(desk: Desk, *folds: str, empty: bool = True) -> None:
    """Open the tab with these folds open, on an empty scene unless told, whatever tests have left."""
    desk.first_scene()
    desk.ask(f"open_fold(*{folds!r})")
    if empty:
        desk.wait("not any(map(bpy.app.is_job_running, ('RENDER_PREVIEW', 'SHADER_COMPILATION')))")
        for blocks in ("objects", "meshes", "materials"):
            desk.ask(f"bpy.data.batch_remove(list(bpy.data.{blocks}))")
    desk.ask("viewport().space.show_region_ui = True")
    desk.wait("viewport().sidebar.width > 100")
    desk.wait("bring_tab('CTMC')")


def load(desk: Desk, path: str, **options: object) -> None:
    """Load a CT as its button does, in this window, and wait until all has followed."""
    words = "".join(f", {name}={value!r}" for name, value in options.items())
    desk.ask(f"""
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.load("INVOKE_DEFAULT", filepath={path!r}{words})
""")
    desk.wait(f"{IDLE} and {LOADED}")
    desk.wait(QUIET)


def is_framed(desk: Desk) -> bool:
    """Whether the whole CT is to be seen, beside the sidebars, and takes at least a third of the height or width."""
    low_x, high_x, low_y, high_y, left, right, top, bottom = desk.ask(SEEN)
    inside = left <= low_x and high_x <= right and top <= low_y and high_y <= bottom
    large = max((high_x - low_x) / (right - left), (high_y - low_y) / (bottom - top)) > 0.34
    return bool(inside and large)


def choose_file(desk: Desk, path: str) -> None:
    """Type a path into the file browser that has opened in the window, and press Enter over its files."""
    regions = desk.wait("browser()")
    left, top, width, height = regions["UI"]
    desk.click(left + width // 2, top + height // 2)
    desk.key("ctrl+a")
    desk.write(path)
    desk.key("Return")
    left, top, width, height = regions["WINDOW"]
    desk.move(left + width // 2, top + height // 2)
    for _ in range(PRESSES):
        desk.key("Return")
        if desk.ask("answer = browser() is None"):
            break
