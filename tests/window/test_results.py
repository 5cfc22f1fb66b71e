# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panel says of a surface is true of it: after undo, after saving and opening; components; a failed load."""

from __future__ import annotations

import nibabel
import numpy as np
import pytest
from window.scenes import IDLE, LOADED, begin, choose_file, load

pytestmark = [pytest.mark.window, pytest.mark.once]

BALLS = {(20, 20, 20): 12.0, (6, 6, 6): 4.0, (34, 6, 6): 0.5, (34, 34, 6): 0.5, (6, 34, 6): 0.5}  # radii, mm
MAKE, LOAD = "bpy.ops.ctmc.reconstruct()", "bpy.ops.ctmc.load()"
# What Results says, and what Blender itself finds: triangles, components, ml.
RESULTS = """
import bmesh
obj, results = bpy.context.view_layer.objects.active, ours("ui.panels.results.page")
measured = ours("ui.state.results.measurements").of(obj)
assert measured is not None, "not measured"
facts = dict(results.facts_of(ours("blender.surface").read_provenance(obj), measured, "HU"))
mesh, components = bmesh.new(), 0
mesh.from_object(obj, bpy.context.evaluated_depsgraph_get())
left = set(mesh.verts)
while left:
    front, components = [left.pop()], components + 1
    while front:
        near = {vertex for edge in front.pop().link_edges for vertex in edge.verts} & left
        left -= near
        front += near
answer = [facts, results.components_text(measured.measures), len(mesh.faces), components, mesh.calc_volume() * 1000]
mesh.free()
"""
ESTIMATE = "ours('ui.state.session').of(bpy.context.scene).cost"
AGREES = f"{ESTIMATE} is not None and {ESTIMATE}.settings == tuple(bpy.context.scene.ctmc.all_settings())"
KEPT = "(lambda s: [s.keep_parts, s.min_part_mm3])(bpy.context.scene.ctmc)"
VIEW = "view = viewport().region; answer = [view.x + view.width // 3, view.y + view.height // 3]"


def results(desk):
    """What Results says, checked against the mesh."""
    facts, text, faces, components, milliliters = desk.ask(RESULTS)
    assert facts["Triangles"].split(" ")[0].replace(",", "") == str(faces)
    assert text.startswith("1 component" if components == 1 else f"{components} components")
    assert float(facts["Volume"].removesuffix(" ml")) == pytest.approx(milliliters, rel=1e-3)
    return facts, text


def over_view(desk):
    """Bring the mouse over the viewport, where keys are the viewport's."""
    desk.move(*desk.ask(VIEW))


@pytest.fixture(scope="module")
def balls(desk):
    """A surface of two balls and three specks."""
    at = np.stack(np.mgrid[:40, :40, :40], axis=-1)
    values = np.full((40, 40, 40), -1000, np.int16)
    for middle, radius in BALLS.items():
        values[np.linalg.norm(at - middle, axis=-1) <= radius] = 400
    nibabel.Nifti1Image(values, np.eye(4)).to_filename(desk.folder / "balls.nii")
    begin(desk, "components")
    load(desk, f"{desk.inside}/balls.nii")
    desk.ask("bpy.context.scene.ctmc.threshold = 200")
    desk.press(MAKE, "reconstruct")
    desk.wait(f"{IDLE} and len(bpy.data.meshes) == 1")
    return results(desk)


@pytest.mark.parametrize(
    ("name", "at", "left", "kept"),
    [("remove_small", 0.75, "2 components", [0, 6]), ("keep_largest", 0.25, "1 component", [1, 0])],
)
def test_a_button_beside_the_components_removes_some_in_one_step(desk, balls, name, at, left, kept):
    facts, text = balls
    assert text == "5 components"
    desk.press(f"bpy.ops.ctmc.{name}()", name, at)
    desk.wait(f"{IDLE} and {KEPT} == {kept}")
    desk.look(f"results-01-{name}")
    after, said = results(desk)
    assert said == left
    assert after["Triangles"] != facts["Triangles"]
    desk.wait(AGREES)
    over_view(desk)
    desk.key("ctrl+z")
    assert results(desk) == balls
    assert desk.ask(f"answer = {KEPT}") == [0, 0]
    desk.wait(AGREES)


def test_no_number_stands_beside_all(desk, balls):
    desk.find("ctmc.keep_largest", 0.3)
    x, y = desk.find("ctmc.close_border")
    assert "ctmc.keep_parts" not in desk.ask(f"answer = rows({x}, {[*range(y - 100, y, 8)]})")
    desk.look("results-02-all")
    desk.find("ctmc.keep_largest", 0.3)
    desk.click()
    assert desk.ask(f"answer = {KEPT}")[0] == 1
    assert desk.find("ctmc.keep_parts", 0.8)
    desk.find("ctmc.keep_largest", 0.3)
    desk.click()
    assert desk.ask(f"answer = {KEPT}")[0] == 0


def test_a_saved_file_says_the_same_when_it_is_opened_and_the_estimate_when_its_ct_is(desk, balls):
    desk.wait(AGREES)  # counted again after what was undone
    estimate = desk.ask(f"answer = [{ESTIMATE}.voxels, {ESTIMATE}.faces]")
    over_view(desk)
    desk.key("ctrl+shift+s")
    choose_file(desk, f"{desk.inside}/")
    desk.wait("bpy.data.filepath and browser() is None")
    saved = desk.ask("answer = bpy.data.filepath")
    desk.first_scene()  # the CT leaves the memory
    desk.ask(f"bpy.ops.wm.open_mainfile(filepath={saved!r})")
    desk.wait("bring_tab('CTMC')")
    desk.look("results-03-opened")
    assert results(desk) == balls
    desk.press("bpy.ops.ctmc.load(again=True)", "load")
    desk.wait(f"{IDLE} and {LOADED}")
    desk.wait(AGREES)
    assert desk.ask(f"answer = [{ESTIMATE}.voxels, {ESTIMATE}.faces]") == estimate
    assert estimate[1] == int(balls[0]["Triangles"].replace(",", ""))
    assert results(desk) == balls


@pytest.mark.parametrize(("language", "words"), [("en_US", "broken.nii"), ("de_DE", "broken.nii")])
def test_what_was_wrong_with_a_load_stands_below_its_button(desk, balls, language, words):
    desk.ask(f"bpy.context.preferences.view.language = '{language}'")
    (desk.folder / "broken.nii").write_bytes(b"neither header nor values" * 40)
    message = "ours('ui.state.session').of(bpy.context.scene).load_message"
    desk.ask("ours('ui.state.session').of(bpy.context.scene).load_message = ''; redraw()")
    _, below = desk.find("ctmc.volume_name")
    x, y = desk.find(LOAD, 0.3)
    before = desk.look(f"results-04-{language}-before")
    desk.click()
    choose_file(desk, f"{desk.inside}/broken.nii")
    said = desk.wait(f"browser() is None and {message}")
    desk.move(200, 400)  # away from Blender's own message, which goes then
    desk.key("Escape")
    after = desk.look(f"results-05-{language}-refused")
    assert words in said
    assert desk.find(LOAD, 0.3) == (x, y)
    lines = (desk.find("ctmc.volume_name")[1] - below) / 20
    assert 1 < lines < 8
    box = (x - 100, y + 16, x + 100, y + 60)
    assert before.crop(box).tobytes() != after.crop(box).tobytes()
    assert desk.ask(f"answer = {LOADED}"), "the CT that was there stays"
