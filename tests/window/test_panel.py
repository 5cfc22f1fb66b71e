# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel by mouse: nothing jumps, the goal comes first, region, components, labels, maps."""

from __future__ import annotations

import pytest
from window.scenes import IDLE, QUIET, begin, choose_file, load

pytestmark = pytest.mark.window

MAKE = "bpy.ops.ctmc.reconstruct()"
REGION = 0.18  # of the sidebar's width, where the tick in its heading is
SHADING = "answer = [viewport().space.shading.type, viewport().space.shading.color_type]"
ADD_DEVIATION = """
view = viewport()
with bpy.context.temp_override(window=view.window, area=view.area, region=view.region):
    bpy.ops.ctmc.map_add("INVOKE_DEFAULT", quantity="deviation")
"""
RED_HERE = """
import importlib
preview = ours("ui.viewport.surface.preview")
window, view = viewport().window, viewport()
with bpy.context.temp_override(window=window, area=view.area, region=view.region):
    answer = preview.state.shown is not None and not preview.is_made(bpy.context)
"""


@pytest.fixture(scope="module")
def ct(desk):
    begin(desk, "region", "maps")
    load(desk, f"{desk.inside}/volume-0.nii.gz")
    desk.ask("s = bpy.context.scene.ctmc; s.threshold = 200; s.stride = (4, 4, 1)")
    desk.wait(QUIET)
    return f"{desk.inside}/volume-0.nii.gz"


def test_the_button_stays_at_its_place_while_costs_are_counted_and_a_surface_is_made(desk, ct):
    _, before = desk.find(MAKE)
    desk.ask("ours('ui.state.session').of(bpy.context.scene).cost = None; redraw()")
    assert desk.under(desk.find(MAKE)[0], before) == MAKE
    desk.look("panel-01-counting")
    desk.press(MAKE, "reconstruct")
    desk.wait(f"{IDLE} and len(bpy.data.meshes) == 1")
    desk.wait(QUIET)
    desk.look("panel-02-made")
    assert desk.find(MAKE)[1] == before


def test_the_preview_is_not_drawn_over_the_surface_it_would_make(desk, ct):
    desk.ask("bpy.context.scene.ctmc.alpha = 0.5; bpy.context.scene.ctmc.stride = (3, 3, 1)")
    desk.wait(QUIET)
    assert not desk.ask(RED_HERE)
    desk.ask("bpy.context.scene.ctmc.threshold = 300")
    desk.wait(QUIET)
    assert desk.ask(RED_HERE)
    desk.ask("bpy.context.scene.ctmc.threshold = 200")
    desk.wait(QUIET)


def test_ticking_the_region_begins_with_the_whole_volume_and_what_was_set_stays(desk, ct):
    desk.press("ctmc.use_region", "fit_region", REGION)
    desk.look("panel-03-region")
    assert desk.ask("answer = list(bpy.context.scene.ctmc.region)") == [0, 0, 0, 511, 511, 28]
    desk.ask("s = bpy.context.scene.ctmc; s.region = (100, 100, 2, 400, 400, 20); s.use_region = False")
    desk.press("ctmc.use_region", "fit_region", REGION)
    assert desk.ask("answer = list(bpy.context.scene.ctmc.region)") == [100, 100, 2, 400, 400, 20]
    desk.ask("bpy.context.scene.ctmc.use_region = False")


@pytest.mark.once
def test_close_border_stands_in_results_and_closes(desk, ct):
    desk.press("bpy.ops.ctmc.close_border()", "close_border")
    desk.wait(f"{IDLE} and bpy.context.scene.ctmc.close_border")
    desk.look("panel-04-closed")
    measured = "ours('ui.state.results.measurements').of(bpy.data.objects['Bone 200 HU']).measures.closed"
    assert desk.ask(f"answer = {measured}")


def test_a_map_is_seen_with_a_legend_and_has_a_way_back(desk, ct):
    assert desk.ask(SHADING) == ["SOLID", "MATERIAL"]
    desk.ask("s = bpy.context.scene.ctmc; s.goal = 'reduction'; s.ratio = 0.1")
    desk.press("bpy.ops.ctmc.simplify()", "simplify", 0.2)
    desk.wait(IDLE)
    desk.ask(ADD_DEVIATION)
    desk.wait(f"{IDLE} and viewport().space.shading.color_type == 'VERTEX'")
    picture = desk.look("panel-05-deviation")
    # The head of the color bar is dark violet: beside it nothing in the viewport is.
    x, y = desk.ask("view = viewport(); answer = [view.region.x, view.window.height - view.region.y]")
    scale = desk.ask("answer = bpy.context.preferences.system.ui_scale")
    red, green, blue = picture.getpixel((round(x + 78 * scale), round(y - 188 * scale)))
    assert 40 < red < 110
    assert green < 60
    assert 90 < blue < 160
    desk.show("RESULTS")
    desk.look("panel-05-map")
    desk.press('bpy.ops.ctmc.map_show(map_name="deviation_mm")', "map_show")
    assert desk.ask(SHADING) == ["SOLID", "MATERIAL"]
    desk.look("panel-06-back")


@pytest.mark.once
def test_a_label_volume_after_a_ct_goes_to_labels_and_a_name_typed_in_the_list_travels(desk, ct):
    desk.ask(f"""
import gzip
import struct
data = bytearray(gzip.decompress(open("{ct}", "rb").read()))
start, (columns, rows, slices) = int(struct.unpack_from("<f", data, 108)[0]), struct.unpack_from("<3h", data, 42)
import numpy as np
values = np.zeros((slices, rows, columns), np.int16)
values[5:15, 100:200, 100:200], values[5:15, 300:400, 300:400] = 1, 2
struct.pack_into("<2h", data, 70, 4, 16)
open("{desk.inside}/segmentation-9.nii", "wb").write(bytes(data[:start]) + values.tobytes())
""")
    load(desk, f"{desk.inside}/segmentation-9.nii")
    desk.look("panel-07-labels")
    chosen = desk.ask("s = bpy.context.scene.ctmc; answer = [s.use_label, s.to_settings().threshold, s.label]")
    assert chosen == [True, None, 1]
    desk.ask("for o in bpy.data.objects: o.select_set(False)")
    desk.press(MAKE, "reconstruct")
    desk.wait(f"{IDLE} and 'Label 1' in bpy.data.objects")
    desk.find("ctmc.label_index", 0.5)
    desk.hand("click", "--repeat", "2", "--delay", "50", "1")
    desk.key("ctrl+a")
    desk.write("Liver")
    desk.key("Return")
    before = desk.ask("answer = list(bpy.context.scene.ctmc.labels[0].color)")
    desk.find("ctmc.labels[0].color", 0.27)
    desk.ask("bpy.context.window_manager.clipboard = '[0.9, 0.2, 0.7, 1.0]'")
    desk.key("ctrl+v")
    desk.look("panel-08-named")
    name, of_list, of_material = desk.ask("""
o, item = bpy.data.objects["Liver"], bpy.context.scene.ctmc.labels[0]
answer = [o.data.materials[0].name, list(item.color), list(o.data.materials[0].diffuse_color)[:3]]
""")
    assert name == "Liver"
    assert of_list != pytest.approx(before, abs=0.1)
    assert of_material == pytest.approx(of_list, abs=1e-3)
    desk.press("bpy.ops.ctmc.export()", "export", 0.3)
    desk.wait("browser()")
    choose_file(desk, f"{desk.inside}/")
    desk.wait("browser() is None")
    assert (desk.folder / "Liver.stl").stat().st_size > 84


def test_the_goal_stands_before_the_method(desk, ct):
    assert desk.find("ctmc.goal")[1] < desk.find("ctmc.ratio")[1] < desk.find("ctmc.method")[1]


def test_the_console_is_silent(desk, ct):
    log = desk.printed()
    for word in ("Traceback", "missing the 'files'", "Error:", "rna_uiItem"):
        assert word not in log
