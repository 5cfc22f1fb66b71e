# SPDX-License-Identifier: GPL-3.0-or-later
"""The part Solid of the page Surface: its lists, what Reconstruct says of it, and the objects of its parts."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np
import pytest
from ui.drawing import drawn, meshes_in
from ui.places import cursor_at, own_center

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.colors import part_color
from ctmc_addon.blender.surface import own_mesh, read_provenance
from ctmc_addon.core import MadeSurface, SettingsError, TriangleMesh, make_surfaces_steps
from ctmc_addon.core.solid import MOST_CUTS, Combination, Combining, Cut, Drain, MadeParts, Pegs, SolidRequest
from ctmc_addon.ui.operators.results.results import command_text
from ctmc_addon.ui.operators.surface import solid as operators
from ctmc_addon.ui.panels.surface.page import CTMC_PT_surface
from ctmc_addon.ui.panels.surface.solid import draw_solid, draw_solid_line
from ctmc_addon.ui.properties.surface.solid import _offered as offered
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.surface import solids
from ctmc_addon.ui.viewport.surface.solid import outline_of

UP = (0.0, 0.0, 1.0)


def active():
    return bpy.context.view_layer.objects.active


def parts_steps(volume, requests, solid, budget=None, *, labels=None, maps=None, all_needed=False):
    """Parts of each surface, 5 mm apart per cut, as many as the cuts make."""
    made = yield from make_surfaces_steps(volume, requests, budget, labels=labels, all_needed=True)
    letters = "abcdefghi"[: len(solid.cuts) + 1] if solid.cuts else [""]
    parts = []
    for surface in made:
        assert isinstance(surface, MadeSurface)
        result, mesh = surface.result, surface.result.mesh
        name = result.label_name or "ball"
        for number, letter in enumerate(letters):
            moved = TriangleMesh(mesh.vertices - np.float32(5 * number) * np.array(UP, np.float32), mesh.faces)
            title = f"{name} {letter}".strip()
            parts.append(replace(result, mesh=moved, surface=None, label_name=title, part_number=number))
    return MadeParts(parts, [])


@pytest.fixture
def solid(loaded, monkeypatch):
    """The solid of the scene with the ball; its parts are stubs."""
    monkeypatch.setattr(operators, "solid_parts_steps", parts_steps)
    bpy.context.window_manager.ctmc_page = "SURFACE"
    return loaded.ctmc_solid


@pytest.mark.usefixtures("loaded")
def test_a_fresh_scene_makes_no_solid_and_says_nothing_of_it(scene):
    assert scene.ctmc_solid.to_request() == SolidRequest()
    assert drawn(draw_solid_line).texts == []


def test_settings_go_to_core_as_typed(solid):
    solid.thicken, solid.hollow, solid.base, solid.least_wall = -0.3, 1.7, 2.0, 0.9
    solid.use_bed, solid.bed = True, (220, 200.5, 180)
    cursor_at(1, -2, 3)
    bpy.ops.ctmc.drain_add()
    bpy.ops.ctmc.drain_add(auto=True)
    solid.drains[0].diameter = 3.3
    bpy.ops.ctmc.cut_add(direction="Y")
    solid.use_pegs, solid.peg_count, solid.peg_diameter, solid.peg_length, solid.clearance = True, 3, 4.0, 6.0, 0.15
    assert solid.to_request() == SolidRequest(
        thicken=-0.3,
        hollow=1.7,
        base=2.0,
        least_wall=0.9,
        bed=(220.0, 200.5, 180.0),
        drains=(Drain(3.3, (1.0, -2.0, 3.0)), Drain(4.0)),
        cuts=(Cut((1.0, -2.0, 3.0), (0.0, 1.0, 0.0)),),
        pegs=Pegs(3, 4.0, 6.0, 0.15),
    )


def test_defaults_are_those_of_core(solid):
    assert (solid.peg_diameter, solid.peg_length) == (Pegs.diameter, Pegs.length)
    assert solid.clearance == pytest.approx(Pegs.clearance)
    assert not solid.to_request()


def test_a_cut_moves_along_its_normal_and_is_flipped(solid):
    cursor_at(1, 2, 3)
    bpy.ops.ctmc.cut_add(direction="Z")
    [cut] = solid.cuts
    assert cut.position == pytest.approx(3.0)
    cut.position = -4.5
    assert tuple(cut.point) == pytest.approx((1, 2, -4.5), abs=1e-5)
    bpy.ops.ctmc.cut_flip(index=0)
    assert tuple(cut.normal) == (0.0, 0.0, -1.0)
    assert cut.position == pytest.approx(4.5)
    cut.normal = (0, 0, 0)
    assert cut.position == 0.0
    cut.position = 7.0
    assert tuple(cut.point) == pytest.approx((1, 2, -4.5), abs=1e-5)
    with pytest.raises(SettingsError, match="the normal of a cut is 0 0 0"):
        solid.to_request()


def test_lines_are_removed_one_by_one_and_all_by_one_press(solid):
    for direction in "XYZ":
        bpy.ops.ctmc.cut_add(direction=direction)
    bpy.ops.ctmc.solid_remove(kind="cuts", index=1)
    assert [tuple(cut.normal) for cut in solid.cuts] == [(1, 0, 0), (0, 0, 1)]
    assert bpy.ops.ctmc.solid_remove(kind="cuts", index=2) == {"CANCELLED"}
    assert bpy.ops.ctmc.cut_flip(index=2) == {"CANCELLED"}
    bpy.ops.ctmc.drain_add()
    bpy.ops.ctmc.combination_add(how="merge")
    solid.hollow, solid.use_pegs, solid.peg_count = 2.0, True, 5
    bpy.ops.ctmc.solid_reset()
    assert solid.to_request() == SolidRequest()
    assert (solid.peg_count, solid.use_pegs) == (2, False)


def test_no_more_cuts_than_core_takes(solid):
    for _ in range(MOST_CUTS):
        bpy.ops.ctmc.cut_add()
    assert not bpy.ops.ctmc.cut_add.poll()
    assert len(solid.to_request().cuts) == MOST_CUTS == 6


def test_reconstruct_says_what_the_solid_does_to_the_next_surfaces(solid):
    solid.hollow = 2.0
    bpy.ops.ctmc.cut_add()
    page = drawn(CTMC_PT_surface)
    assert "Makes a solid: hollow 2 mm, 1 cut" in " ".join(page.texts)
    assert "ctmc.reconstruct Reconstruct Solid" in page.buttons
    assert "ctmc.solid_reset" in page.buttons
    solid.use_pegs, solid.thicken = True, -1.0
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.drain_add()
    assert operators.solid_text(solid.to_request()) == (
        "Makes a solid: thicken -1 mm, hollow 2 mm, 1 drain, 2 cuts, 2 pegs"
    )
    bpy.ops.ctmc.solid_reset()
    assert "ctmc.reconstruct Reconstruct Surface" in drawn(CTMC_PT_surface).buttons


def test_settings_that_contradict_are_said_above_and_refused(solid):
    bpy.ops.ctmc.drain_add(auto=True)
    page = drawn(CTMC_PT_surface)
    assert "An automatic drain opens a hollow" in " ".join(page.texts)
    assert "Makes a solid" in page.texts
    with pytest.raises(RuntimeError, match="An automatic drain opens a hollow"):
        bpy.ops.ctmc.reconstruct()


def test_blenders_decimate_is_refused(solid, loaded):
    solid.hollow, loaded.ctmc.simplifier, loaded.ctmc.reduction = 1.0, "decimate", 0.5
    with pytest.raises(RuntimeError, match="Decimate would move the cuts of a solid; choose Built-In"):
        bpy.ops.ctmc.reconstruct()


def test_the_command_has_the_solid(solid, loaded):
    solid.hollow = 1.5
    bpy.ops.ctmc.cut_add(direction="X")
    words = shlex.split(command_text(loaded))
    assert words[words.index("--hollow") + 1] == "1.5"
    assert words[words.index("--cut") + 1 :][:6] == ["0", "0", "0", "1", "0", "0"]
    assert words[words.index("-o") + 1] == "ball.3mf", "which holds several parts"


def test_everything_is_drawn(solid):
    bpy.ops.ctmc.drain_add()
    bpy.ops.ctmc.drain_add(auto=True)
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.combination_add()
    solid.use_pegs = True
    layout = drawn(draw_solid)
    groups = (solid, solid.drains[0], solid.cuts[0], solid.combinations[0], solid.combinations[0].of[0])
    names = {name for group in groups for name in set(group.bl_rna.properties.keys())} - {"rna_type", "name"}
    lists = {"drains", "cuts", "combinations", "of"}
    assert names - lists - set(layout.shown) == {"auto", "point"}
    assert "Lowest and Highest" in layout.texts


def test_parts_are_objects_with_material_provenance_and_measures(solid, loaded):
    bpy.ops.ctmc.cut_add()
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    first, second = meshes_in(loaded)
    assert (first.name, second.name) == ("ball a", "ball b")
    assert set(bpy.context.selected_objects) == {first, second}
    assert first.users_collection == second.users_collection
    for obj in (first, second):
        assert read_provenance(obj).fingerprint == loaded.ctmc.volume_fingerprint
        assert read_provenance(obj).part == obj.name
        assert obj.data.materials[0] is not None
        assert obj["ctmc_measurement"]
    assert first.data.materials[0] != second.data.materials[0]
    low = [own_mesh(obj).vertices[:, 2].min() for obj in (first, second)]
    assert low[0] - low[1] == pytest.approx(5.0, abs=1e-4)


def test_parts_are_updated_by_name_and_other_surfaces_are_left_alone(solid, loaded):
    bpy.ops.ctmc.reconstruct()
    whole = active()
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.reconstruct()
    parts = set(bpy.context.selected_objects)
    assert whole not in parts
    assert len(parts) == 2
    before = {obj.name: len(obj.data.polygons) for obj in (whole, *parts)}
    assert "ctmc.reconstruct Update Solid" in drawn(CTMC_PT_surface).buttons
    loaded.ctmc.threshold = 120.0
    bpy.ops.ctmc.reconstruct()
    assert set(meshes_in(loaded)) == {whole, *parts}
    assert len(whole.data.polygons) == before[whole.name]
    assert all(len(obj.data.polygons) < before[obj.name] for obj in parts)
    bpy.ops.ctmc.solid_reset()
    assert "ctmc.reconstruct Reconstruct Surface" in drawn(CTMC_PT_surface).buttons
    bpy.ops.ctmc.reconstruct()
    assert len(meshes_in(loaded)) == 4, "no part becomes the whole"


def test_a_part_is_simplified_from_itself_and_not_from_the_whole(solid, loaded):
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.reconstruct()
    part = bpy.data.objects["ball b"]
    low, full = own_mesh(part).vertices[:, 2].min(), len(part.data.polygons)
    bpy.ops.ctmc.solid_reset()
    bpy.ops.ctmc.reconstruct()  # The whole is now the full surface of the last run.
    bpy.context.view_layer.objects.active = part
    part.select_set(True)
    loaded.ctmc.reduction = 0.5
    for share in (0.5, 0.75):
        loaded.ctmc.reduction = share
        assert bpy.ops.ctmc.simplify() == {"FINISHED"}
        assert len(part.data.polygons) == pytest.approx((1 - share) * full, abs=2)
        assert own_mesh(part).vertices[:, 2].min() == pytest.approx(low, abs=0.5)
        assert (part.name, read_provenance(part).part) == ("ball b", "ball b")


def test_a_part_is_not_made_alone(solid, loaded):
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.reconstruct()
    with pytest.raises(RuntimeError, match="is a part of a solid and cannot be made alone"):
        bpy.ops.ctmc.close_border()


def test_undo_takes_the_parts_back(solid, loaded):
    bpy.ops.ctmc.cut_add()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ed.undo_push(message="after")
    assert len(meshes_in(bpy.context.scene)) == 2
    bpy.ops.ed.undo()
    assert meshes_in(bpy.context.scene) == []
    assert len(bpy.context.scene.ctmc_solid.cuts) == 1


def test_a_closed_job_leaves_no_part(solid, loaded):
    bpy.ops.ctmc.cut_add()
    plan = bpy.types.CTMC_OT_reconstruct.plan
    steps = plan(type("Operator", (), {"new": False})(), bpy.context)
    next(steps)
    steps.close()
    assert meshes_in(loaded) == []


def test_parts_survive_a_saved_file_and_export(solid, loaded, tmp_path):
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.export(filepath=str(tmp_path / "a.glb"))
    assert (tmp_path / "a.glb").stat().st_size > 1000
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert read_provenance(bpy.data.objects["ball b"]).part == "ball b"
    assert len(bpy.context.scene.ctmc_solid.cuts) == 1


@pytest.fixture
def labels(scene, tmp_path, monkeypatch):
    """Two cubes of 6 mm, labels 1 and 2; the first is ticked."""
    monkeypatch.setattr(operators, "solid_parts_steps", parts_steps)
    values = np.zeros((16, 16, 32), np.uint8)
    values[5:11, 5:11, 5:11], values[5:11, 5:11, 15:21] = 1, 2
    np.save(tmp_path / "labels.npy", values)
    bpy.ops.ctmc.load(filepath=str(tmp_path / "labels.npy"), spacing=(1, 1, 1))
    scene.ctmc.use_label, scene.ctmc.label = True, 1
    scene.ctmc.labels[0].name = "left hip"
    return scene


def test_structures_are_combined_by_name_or_number(labels):
    solid = labels.ctmc_solid
    bpy.ops.ctmc.combination_add(how="subtract")
    [combination] = solid.combinations
    with pytest.raises(SettingsError, match="a combination takes two structures or more"):
        solid.to_request()
    combination.of[0].structure, combination.of[1].structure = "left hip", "2"
    assert [operand.structure for operand in combination.of] == ["left hip", "2", ""], "room for another"
    assert solid.to_request().combinations == (Combination(Combining.SUBTRACT, "left hip+2", ("left hip", "2")),)
    combination.title = "both"
    assert solid.to_request().combinations[0].name == "both"
    runs = solids.runs_of(labels, solids.solid_of(labels))
    assert [run.label for run in runs] == [1, 2], "the second is not ticked, but named"
    words = shlex.split(command_text(labels))
    assert words[words.index("--subtract") + 1] == "both=1,2"
    assert "--label" not in words, "those of the combination"
    labels.ctmc.use_label = False
    with pytest.raises(SettingsError, match="a threshold has no structures to combine"):
        solids.runs_of(labels, solids.solid_of(labels))


def test_parts_of_labels_have_color_and_name_of_their_structure(labels):
    labels.ctmc.labels[1].chosen = True
    labels.ctmc.labels[1].color = (0.1, 0.9, 0.2)
    bpy.ops.ctmc.cut_add()
    bpy.ops.ctmc.reconstruct()
    names = [obj.name for obj in meshes_in(labels)]
    assert names[:2] == ["left hip a", "left hip b"]
    assert len(names) == 4
    colors = [obj.data.materials[0].diffuse_color[:3] for obj in meshes_in(labels)[2:]]
    assert colors[0] == pytest.approx((0.1, 0.9, 0.2))
    assert colors[1] == pytest.approx(part_color((0.1, 0.9, 0.2), 1))
    labels.ctmc.labels[1].color = (0.5, 0.1, 0.1)
    colors = [obj.data.materials[0].diffuse_color[:3] for obj in meshes_in(labels)[2:]]
    assert colors == [pytest.approx((0.5, 0.1, 0.1)), pytest.approx(part_color((0.5, 0.1, 0.1), 1))], "both follow"
    labels.ctmc.labels[0].name = "hip"
    assert meshes_in(labels)[0].name == "left hip a", "a part keeps the name that it is found by"


def test_a_combination_of_structures_that_the_list_lacks_is_refused(labels):
    for item in labels.ctmc.labels:
        item.chosen = False
    bpy.ops.ctmc.combination_add(how="merge")
    [combination] = labels.ctmc_solid.combinations
    combination.of[0].structure, combination.of[1].structure = "8", "9"
    with pytest.raises(SettingsError, match="no structure is ticked; tick one in the list"):
        solids.runs_of(labels, solids.solid_of(labels))


def test_a_combination_offers_what_earlier_ones_make(labels):
    solid = labels.ctmc_solid
    bpy.ops.ctmc.combination_add(how="merge")
    bpy.ops.ctmc.combination_add(how="subtract")
    first, second = solid.combinations
    assert "both" not in offered(second.of[0], None, "")
    first.title, first.of[0].structure, first.of[1].structure = "both", "left hip", "2"
    assert "both" in offered(second.of[0], None, "")
    assert "both" not in offered(first.of[0], None, "")
    second.title, second.of[0].structure, second.of[1].structure = "rest", "both", "2"
    assert solids.solid_of(labels).combinations[1].of == ("both", "2")


def test_structures_that_cannot_be_made_are_reported_beside_those_that_are(labels, monkeypatch):
    def some_steps(volume, requests, solid, budget=None, *, labels=None, maps=None, all_needed=False):
        assert not all_needed
        parts, _ = yield from parts_steps(volume, requests[:1], solid, budget, labels=labels)
        return MadeParts(parts, [f"label {number} is left out: {number} mm are too thin." for number in range(2, 7)])

    monkeypatch.setattr(operators, "solid_parts_steps", some_steps)
    labels.ctmc.labels[1].chosen = True
    labels.ctmc_solid.hollow = 2.0
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    assert [obj.name for obj in meshes_in(labels)] == ["left hip"]
    message = session.of(labels).message
    assert message.startswith("label 2 is left out: 2 mm are too thin. label 3 is left out: ")
    assert message.endswith("4 mm are too thin. 2 more are left out")


def test_the_outline_covers_the_structures_box(labels):
    cursor_at(0, 0, 8)
    bpy.ops.ctmc.cut_add(direction="Z")
    [plane] = outline_of(labels).planes
    assert np.ptp(plane, axis=0) == pytest.approx((7, 7, 0), abs=1e-4)
    assert plane[:, 2] == pytest.approx([8] * 4, abs=1e-4)
    labels.ctmc.labels[1].chosen = True
    [plane] = outline_of(labels).planes
    assert np.ptp(plane, axis=0) == pytest.approx((17, 7, 0), abs=1e-4)


def test_the_outline_leaves_out_what_makes_no_sense_yet(labels):
    solid = labels.ctmc_solid
    for direction in "XZ":
        bpy.ops.ctmc.cut_add(direction=direction)
    bpy.ops.ctmc.combination_add()  # of no structure
    solid.cuts[0].normal = (0, 0, 0)
    solid.use_pegs, solid.peg_length, solid.peg_diameter = True, 1.0, 5.0
    outline = outline_of(labels)
    assert (len(outline.planes), outline.pegs) == (1, [])


def test_core_makes_the_parts_of_a_hollow_ball(loaded):
    """The wall is the space between balls of 6 and of 4 mm; each half has half of it."""
    cursor_at(*own_center(loaded))
    bpy.ops.ctmc.cut_add(direction="Z")
    loaded.ctmc_solid.hollow = 2.0
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    halves = meshes_in(loaded)
    assert [obj.name for obj in halves] == ["ball a", "ball b"]
    volumes_mm3 = [own_mesh(obj).measures.volume for obj in halves]
    assert volumes_mm3 == pytest.approx([2 * np.pi / 3 * (6.0**3 - 4.0**3)] * 2, rel=0.05)
    heights = [own_mesh(obj).vertices[:, 2] for obj in halves]
    assert heights[0].min() == pytest.approx(heights[1].max(), abs=1e-3)
