# SPDX-License-Identifier: GPL-3.0-or-later
"""Render by mouse: one click sets up and renders; a click on a light selects the surface behind it."""

from __future__ import annotations

import pytest
from window.scenes import IDLE, begin, load

pytestmark = pytest.mark.window

BALL = """
import numpy as np
z, y, x = np.mgrid[:24, :24, :24]
values = np.full(x.shape, -1000, np.int16)
values[(x - 12) ** 2 + (y - 12) ** 2 + (z - 12) ** 2 < 10**2] = 100
np.save("{folder}/ball.npy", values)
"""
SURFACES = "[obj.name for obj in bpy.data.objects if obj.type == 'MESH']"
RENDERED = "any(image.type == 'RENDER_RESULT' and image.has_data for image in bpy.data.images)"
# Look along a light at the surface: name of the surface, and where the light is on the screen.
THROUGH_LIGHT = """
view = viewport()
light = bpy.data.objects["CTMC Key"]
obj = next(obj for obj in bpy.data.objects if obj.type == "MESH")
for one in bpy.data.objects:
    one.select_set(False)
eye = view.space.region_3d
eye.view_perspective = "ORTHO"
eye.view_location, eye.view_rotation = light.matrix_world.translation, light.matrix_world.to_quaternion()
eye.view_distance = 4.0 * max(obj.dimensions)
eye.update()
answer = [obj.name, on_screen(light.matrix_world.translation)]
"""
SELECTED = "answer = [obj.name for obj in bpy.context.selected_objects]"


@pytest.fixture(scope="module", autouse=True)
def ball(desk):
    """A surface of a ball in a viewport without a slice, and small pictures."""
    begin(desk)
    desk.ask(BALL.format(folder=desk.inside))
    load(desk, f"{desk.inside}/ball.npy", spacing=(1.0, 1.0, 1.0))
    desk.ask("s = bpy.context.scene.ctmc; s.use_threshold = True; s.threshold = 0; s.preview = False")
    desk.ask("bpy.context.scene.ctmc_view.show_slice = False")
    desk.ask("bpy.ops.ctmc.reconstruct()")
    desk.wait(f"{IDLE} and len({SURFACES}) == 1")
    desk.ask("r = bpy.context.scene.render; r.resolution_x, r.resolution_y = 160, 120")
    desk.ask("bpy.context.preferences.view.render_display_type = 'NONE'")


def test_one_click_sets_up_and_renders_with_cycles_where_the_processor_draws(desk):
    desk.ask("bpy.context.scene.ctmc_figure.engine = 'eevee'")
    desk.press("bpy.ops.ctmc.render()", "render")
    desk.wait(f"{RENDERED} and not bpy.app.is_job_running('RENDER')")
    desk.look("render-01-done")
    scene = "bpy.context.scene"
    state = f"answer = [{scene}.camera.name, {scene}.render.engine, {scene}.ctmc_figure.engine]"
    assert desk.ask(state) == ["CTMC Studio Camera", "CYCLES", "cycles"]


@pytest.mark.parametrize(("selectable", "selected"), [(True, "CTMC Key"), (False, None)])
def test_a_click_on_a_light_selects_the_surface_behind_it(desk, selectable, selected):
    desk.ask("bpy.ops.ctmc.setup_studio()")
    if selectable:  # As lights of Blender are: the click is on the light.
        desk.ask("bpy.data.objects['CTMC Key'].hide_select = False")
    name, light = desk.ask(THROUGH_LIGHT)
    desk.look(f"render-02-through-the-light-{selectable}")
    desk.click(*(round(value) for value in light))
    assert desk.ask(SELECTED) == [selected or name]
