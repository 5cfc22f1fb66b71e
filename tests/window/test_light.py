# SPDX-License-Identifier: GPL-3.0-or-later
"""Display Light in a window: a large surface is drawn with a share of its triangles, and rendered with all."""

from __future__ import annotations

import pytest
from window.scenes import IDLE, begin, load

pytestmark = [pytest.mark.window, pytest.mark.once]

# A ball of 100 HU in air, looked at from the patient's front.
BALL = """
import numpy as np
z, y, x = np.mgrid[:48, :48, :48] - 23.5
np.save("{folder}/ball.npy", (100 * np.clip(18.0 - np.sqrt(x**2 + y**2 + z**2), -1, 1)).astype(np.int16))
"""
LIMITS = "light = ours('blender.surface.light'); answer = [light.ABOVE, light.GOAL]; light.ABOVE, light.GOAL = {}, {}"
VIEW = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.view(side="A")
bpy.context.scene.ctmc_view.show_slice = False
"""
# Triangles of the mesh, of what is drawn, of a render; the modifiers.
COUNTS = """
bpy.context.view_layer.update()
(obj,) = [obj for obj in bpy.data.objects if obj.type == "MESH" and "ctmc" in obj]
drawn = len(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)
counts = []

class Engine(bpy.types.RenderEngine):
    bl_idname, bl_label = "CTMC_TEST", "Test"

    def render(self, depsgraph):
        surfaces = [each.object for each in depsgraph.object_instances if "ctmc" in each.object]
        counts.extend(len(each.data.polygons) for each in surfaces if each.type == "MESH")

bpy.utils.register_class(Engine)
scene = bpy.context.scene
engine, scene.render.engine = scene.render.engine, "CTMC_TEST"
if scene.camera is None:
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
bpy.ops.render.render()
scene.render.engine = engine
bpy.utils.unregister_class(Engine)
answer = [len(obj.data.polygons), drawn, sum(counts), [modifier.name for modifier in obj.modifiers]]
"""


@pytest.fixture
def small_limits(desk):
    """Limits that a ball exceeds; other tests have the same Blender, so they are set back."""
    before = desk.ask(LIMITS.format(5000, 2000))
    yield
    desk.ask(LIMITS.format(*before))


@pytest.mark.usefixtures("small_limits")
def test_a_large_surface_is_drawn_light_rendered_in_full_and_cut_like_any_other(desk):
    begin(desk, "cuts")
    desk.ask("bpy.context.preferences.view.smooth_view = 0")
    desk.ask(BALL.format(folder=desk.inside))
    load(desk, f"{desk.inside}/ball.npy", spacing=(1.0, 1.0, 1.0))
    desk.ask("s = bpy.context.scene.ctmc; s.use_threshold = True; s.threshold = 0; s.preview = False")
    desk.ask("bpy.ops.ctmc.reconstruct()")
    desk.wait(IDLE)
    desk.ask(VIEW)
    desk.show("RESULTS")
    faces, drawn, rendered, modifiers = desk.ask(COUNTS)
    assert faces == rendered > 5000
    assert 1000 < drawn < 3000
    assert modifiers == ["CTMC Light"]
    desk.look("light-01-light")
    desk.ask("bpy.context.scene.ctmc.display = 'FULL'")
    assert desk.ask(COUNTS)[1:3] == [faces, faces]
    desk.look("light-02-full")
    desk.ask("bpy.context.scene.ctmc.display = 'LIGHT'")
    desk.press("bpy.ops.ctmc.cut_away()", "cut_away", 0.2)
    cut = desk.ask(COUNTS)
    assert cut[3] == ["CTMC Light", "CTMC Cut Away"]
    assert 0.3 * drawn < cut[1] < 0.9 * drawn
    assert 0.4 * faces < cut[2] < 0.6 * faces
    desk.look("light-03-cut")
