# SPDX-License-Identifier: GPL-3.0-or-later
"""Drawing without a window: strokes, clicks and edits, what undo and the file keep of them."""

from __future__ import annotations

from dataclasses import replace
from types import MethodType, SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
from mathutils import Vector
from ui.strokes import mask, middle, stroke

from ctmc_addon.blender.volume import vdb_writer
from ctmc_addon.core import finish
from ctmc_addon.core.volume import label_extents_steps, volume_box
from ctmc_addon.readers import read_volume
from ctmc_addon.ui import operators
from ctmc_addon.ui.operators.draw.stroke import CTMC_OT_draw_stroke
from ctmc_addon.ui.state.ct import scans, stored_paths, volumes
from ctmc_addon.ui.state.draw import drawings, masks
from ctmc_addon.ui.state.results import measurements, surfaces
from ctmc_addon.ui.state.surface import structures
from ctmc_addon.ui.viewport.ct.slice_hits import SliceHit, brush_along
from ctmc_addon.ui.viewport.draw import drawn
from ctmc_addon.ui.viewport.draw.draw_tools import BrushOfSlices


def packed():
    return {entry.number: entry.content for entry in drawings.active(bpy.context.scene).slices if entry.content}


def test_a_stroke_makes_a_structure_and_erasing_it_leaves_nothing(drawing):
    drawing.radius_mm, drawing.ball = 4.0, True
    assert stroke(middle()) == {"FINISHED"}
    volume = volumes.current(bpy.context.scene)
    exact = 4 / 3 * np.pi * 4.0**3 / np.prod(volume.spacing)
    assert 0.7 * exact < mask().sum() < 1.3 * exact
    assert [line.name for line in bpy.context.scene.ctmc.labels] == ["Structure"]
    assert stroke(middle(), erase=True) == {"FINISHED"}
    assert not mask().any()
    assert packed() == {}


def test_a_disc_is_drawn_in_one_slice_and_the_range_holds_it(drawing):
    drawing.radius_mm = 30.0
    stroke(middle())
    assert (mask().any(axis=(1, 2))).sum() == 1
    stroke(middle(), erase=True)
    drawing.use_range, drawing.low, drawing.high = True, 100.0, 1000.0
    stroke(middle())
    values = volumes.current(bpy.context.scene).values
    drawn = np.flatnonzero(mask().any(axis=(1, 2)))
    assert (mask()[drawn[0]] == (values[drawn[0]] >= 100)).all()


def test_undo_and_redo_take_one_stroke_and_bring_it_again(drawing):
    drawing.radius_mm = 3.0
    states = [np.zeros_like(volumes.current(bpy.context.scene).values, bool)]
    for shift in (0.0, 4.0, 8.0):
        x, y, z = middle()
        stroke((x + shift - 4, y, z))
        bpy.ops.ed.undo_push(message="Stroke")
        states.append(mask().copy())
    for state in states[2:0:-1]:
        bpy.ops.ed.undo()
        assert (mask() == state).all()
    for state in states[2:]:
        bpy.ops.ed.redo()
        assert (mask() == state).all()


def test_what_was_drawn_is_there_when_the_file_is_opened_again(drawing, tmp_path):
    drawing.radius_mm = 5.0
    stroke(middle())
    before = mask().copy()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert (mask() == before).all()
    assert before.any()


def test_a_click_grows_to_the_border_and_keeps_strokes(drawing):
    drawing.use_range, drawing.low, drawing.high = True, 100.0, 1000.0  # values fall evenly; their border is the range
    assert bpy.ops.ctmc.draw_grow(point_mm=middle()) == {"FINISHED"}
    inside = volumes.current(bpy.context.scene).values >= 100
    first = mask().copy()
    assert 2 * (first & inside).sum() / (first.sum() + inside.sum()) > 0.75
    drawing.use_range, drawing.radius_mm, drawing.ball = False, 1.0, True
    corner = tuple(volume_box(volumes.current(bpy.context.scene))[0].tolist())
    stroke(corner)
    extra = mask() & ~first
    x, y, z = middle()
    bpy.ops.ctmc.draw_grow(point_mm=(x, y, z + 2))
    assert (mask() & extra).sum() == extra.sum() > 0
    assert [click.inside for click in drawings.active(bpy.context.scene).clicks] == [True, True]


def test_in_a_range_a_click_adds_what_hangs_together_and_alt_takes_it(drawing):
    drawing.method, drawing.low, drawing.high = "connected", 100.0, 10_000.0
    bpy.ops.ctmc.draw_grow(point_mm=middle())
    assert (mask() == (volumes.current(bpy.context.scene).values >= 100)).all()
    bpy.ops.ctmc.draw_grow(point_mm=middle(), surroundings=True)
    assert not mask().any()


def test_a_refused_click_leaves_the_scene_as_it_was(drawing):
    with pytest.raises(RuntimeError, match="outside the volume"):
        bpy.ops.ctmc.draw_grow(point_mm=(999, 0, 0))
    with pytest.raises(RuntimeError, match="Click in the structure first"):
        bpy.ops.ctmc.draw_grow(point_mm=middle(), surroundings=True)
    assert len(drawing.structures) == 0


def test_edits_of_a_whole_structure(drawing):
    drawing.radius_mm, drawing.ball = 4.0, True
    x, y, z = middle()
    stroke((x - 7, y, z))
    stroke((x + 5, y, z))
    drawing.radius_mm = 1.3
    stroke((x + 5, y, z), erase=True)
    holed = int(mask().sum())
    bpy.ops.ctmc.draw_holes()
    filled = int(mask().sum())
    assert filled > holed
    bpy.ops.ctmc.draw_islands(largest=True)
    assert mask().sum() * 2 == filled
    drawing.margin_mm = 2.0
    before = mask().copy()
    bpy.ops.ctmc.draw_margin()
    assert mask().sum() > 1.5 * before.sum()
    assert (mask() & before).sum() == before.sum()
    drawing.margin_mm = -1.0
    bpy.ops.ctmc.draw_margin()
    bpy.ops.ctmc.draw_add()
    stroke((x - 7, y, z), (x + 5, y, z))
    bpy.context.scene.ctmc.label_index = 0
    drawing.other, drawing.combination = "Structure 2", "minus"
    before = mask().copy()
    bpy.ops.ctmc.draw_combine()
    assert 0 < mask().sum() < before.sum()


def test_slices_between_drawn_ones_are_filled(drawing):
    drawing.radius_mm = 4.0
    x, y, z = middle()
    for shift in (-6, 6):
        stroke((x, y, z + shift))
    bpy.context.scene.ctmc_view.plane = "coronal"  # it decides nothing: the strokes lie in axial slices
    bpy.ops.ctmc.draw_between()
    drawn = np.flatnonzero(mask().any(axis=(1, 2)))
    assert (np.diff(drawn) == 1).all()
    assert len(drawn) == 7


def test_removing_a_structure_and_undo_brings_it_back(drawing):
    stroke(middle())
    before = mask().copy()
    bpy.ops.ed.undo_push(message="Stroke")
    bpy.ops.ctmc.remove_structure()
    bpy.ops.ed.undo_push(message="Remove")
    assert drawings.active(bpy.context.scene) is None
    bpy.ops.ed.undo()
    assert (mask() == before).all()


def test_reconstruct_makes_what_was_drawn_under_its_name(drawing):
    scene = bpy.context.scene
    scene.ctmc.preview = False
    drawing.radius_mm, drawing.ball = 5.0, True
    stroke(middle())
    bpy.ops.ctmc.draw_add()
    x, y, z = middle()
    drawing.radius_mm = 3.0
    stroke((x + 6, y, z))  # overlaps the first
    scene.ctmc.labels[0].name = "kidney"
    scene.ctmc.interfaces = "separate"
    assert scene.ctmc.use_label
    assert bpy.ops.ctmc.reconstruct() == {"FINISHED"}
    for item, name in zip(drawings.structures(scene), ("kidney", "Structure 2"), strict=True):
        (obj,) = surfaces.of_structure(scene, drawings.line_of(scene, item))
        assert obj.name.endswith(name)
        drawn = masks.of(scene, item).mask.sum() * np.prod(volumes.current(scene).spacing)
        assert measurements.of(obj).measures.volume == pytest.approx(drawn, rel=0.05)


def test_a_surface_stands_for_the_drawing_that_it_was_made_of_alone(drawing, tmp_path):
    def is_made():
        return drawn.is_made(bpy.context.scene, drawings.active(bpy.context.scene))

    drawing.radius_mm, drawing.ball = 5.0, True
    stroke(middle())
    assert not is_made()
    bpy.ops.ctmc.reconstruct()
    assert is_made()
    bpy.context.scene.ctmc.reduction = 0.5
    bpy.ops.ctmc.simplify()
    assert is_made()
    bpy.ops.ed.undo_push(message="Simplified")
    x, y, z = middle()
    stroke((x + 4, y, z))
    bpy.ops.ed.undo_push(message="Stroke")
    assert not is_made()
    bpy.ops.ed.undo()
    assert is_made()
    bpy.ops.ed.redo()
    bpy.ops.ctmc.simplify()  # from the full surface, which is not of this drawing
    assert not is_made()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert not is_made()
    bpy.ops.ctmc.simplify()  # the full surface is not in memory, so it is extracted from this drawing
    assert is_made()


def test_what_is_known_of_the_labels_follows_the_drawing(drawing):
    scene = bpy.context.scene
    bpy.ops.ctmc.draw_add()
    drawing.ball = True
    assert finish(label_extents_steps(structures.label_volume(scene))) == {}
    for radius_mm in (3.0, 6.0):
        drawing.radius_mm = radius_mm
        stroke(middle())
        extents = finish(label_extents_steps(structures.label_volume(scene)))
        assert [extent.voxels for extent in extents.values()] == [mask().sum()]


def test_a_preview_without_memory_is_tried_once(drawing, monkeypatch):
    def without_memory(*_args):
        raise MemoryError

    scene = bpy.context.scene
    stroke(middle())
    monkeypatch.setattr(drawn, "surface_of", without_memory)
    drawn.tick()
    assert not drawn.is_behind(scene, drawings.active(scene))
    stroke(middle(), erase=True)
    assert drawn.is_behind(scene, drawings.active(scene))


def test_no_command_is_said_to_make_what_was_drawn(drawing):
    stroke(middle())
    with pytest.raises(RuntimeError, match="No command makes Structure, because it was drawn; save the"):
        bpy.ops.ctmc.copy_command()


def test_slices_and_volumes_are_called_as_the_panel_says(loaded, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    loaded.ctmc.volume_name = "case 7"
    before = set(bpy.data.objects)
    bpy.ops.ctmc.add_slice()
    if vdb_writer() is not None:
        bpy.ops.ctmc.add_volume()
        assert [file.name for file in tmp_path.glob("*.vdb")] == ["case 7.vdb"]
    for obj in set(bpy.data.objects) - before:
        assert {name.startswith("case 7") for name in (obj.name, obj.data.name, obj.data.materials[0].name)} == {True}


def test_with_nothing_chosen_a_label_without_a_name_is_not_combined(drawing):
    bpy.context.scene.ctmc.add_labels([(1, "", (1.0, 1.0, 1.0))])
    stroke(middle())
    with pytest.raises(RuntimeError, match="Choose another structure"):
        bpy.ops.ctmc.draw_combine()


def test_a_stroke_without_memory_leaves_nothing_and_lets_others_begin(drawing, monkeypatch):
    def without_memory(*_args):
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr(operators.draw.stroke, "brush", without_memory)
        with pytest.raises(RuntimeError, match="memory"):
            stroke(middle())
        assert len(bpy.context.scene.ctmc.labels) == 0
        drawn = SimpleNamespace(report=lambda *_: None)
        for name in ("start", "dab", "follow", "give_up", "cancel"):
            setattr(drawn, name, MethodType(getattr(CTMC_OT_draw_stroke, name), drawn))
        drawn.erase, drawn.hit = False, SliceHit(middle(), np.eye(4, 3))
        drawn.start(bpy.context.scene)
        masks.begin_stroke(drawn)
        drawn.area = 0
        monkeypatch.setattr(operators.draw.stroke, "viewport_at", lambda *_: object())
        monkeypatch.setattr(operators.draw.stroke, "brush_under", lambda *_: drawn.hit)
        moved = SimpleNamespace(type="MOUSEMOVE", value="NOTHING")
        assert CTMC_OT_draw_stroke.modal(drawn, bpy.context, moved) == {"CANCELLED"}
    assert not masks.stroke_under_way()
    assert len(bpy.context.scene.ctmc.labels) == 0


def test_the_circle_of_a_brush_is_gone_with_the_extension():
    BrushOfSlices.draw_cursor(SimpleNamespace(scene=object()), None, (0, 0))  # Blender still calls it


def test_the_volume_of_a_drawing_in_slices_of_a_tilted_gantry(drawing, monkeypatch):
    scene = bpy.context.scene
    stroke(middle())
    ct = volumes.loaded(scene)
    affine = ct.volume.affine.copy()
    affine[1, 2] = affine[2, 2]  # by 45 degrees
    tilted = replace(ct, volume=replace(ct.volume, affine=affine))
    monkeypatch.setitem(volumes._loaded, ct.statistics.fingerprint, tilted)
    assert masks.mm3_of(scene, drawings.active(scene)) == pytest.approx(mask().sum() * 1 * 1 * 2)


def test_a_new_structure_is_not_that_of_a_surface_whose_line_was_removed(drawing):
    scene = bpy.context.scene
    drawing.radius_mm, drawing.ball = 4.0, True
    stroke(middle())
    scene.ctmc.labels[0].name = "tumor"
    bpy.ops.ctmc.reconstruct()
    bpy.ops.ctmc.remove_structure()
    bpy.ops.ctmc.draw_add()
    (line,) = scene.ctmc.labels
    line.name = "kidney"
    assert surfaces.of_structure(scene, line) == []
    assert "tumor" in scene.objects
    assert "kidney" not in scene.objects


def test_a_copied_scene_has_a_drawing_of_its_own(drawing):
    first = bpy.context.scene
    drawing.radius_mm, drawing.ball = 3.0, True
    stroke(middle())
    before = mask().sum()
    bpy.ops.scene.new(type="FULL_COPY")
    second = bpy.context.scene
    second.ctmc_draw.radius_mm = 6.0
    stroke(middle())
    assert mask().sum() > before
    for scene, voxels in ((first, before), (second, mask().sum())):
        assert (structures.label_volume(scene).values > 0).sum() == voxels


def test_another_ct_and_back_keeps_what_was_drawn(drawing, ball_file, tmp_path):
    drawing.radius_mm = 5.0
    stroke(middle())
    bpy.context.scene.ctmc.labels[0].name = "tumor"
    bpy.ops.ctmc.add_threshold()
    bpy.context.scene.ctmc.volume_name = "case 1"
    bpy.context.scene.ctmc.label_index = 0
    lines = [(line.name, line.kind, line.threshold, line.chosen) for line in bpy.context.scene.ctmc.labels]
    before = mask().copy()
    np.save(tmp_path / "other.npy", np.arange(24**3, dtype=np.int16).reshape(24, 24, 24))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "other.npy"), spacing=(1, 1, 2))
    assert not any(drawings.structures(bpy.context.scene))
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    stored = bpy.context.scene.ctmc
    assert [(line.name, line.kind, line.threshold, line.chosen) for line in stored.labels] == lines
    assert stored.volume_name == "case 1"
    assert [scan.volume_fingerprint == stored.volume_fingerprint for scan in bpy.context.scene.ctmc_scans] == [False]
    assert (mask() == before).all()


def test_drawings_of_two_cts_of_one_name_lie_apart_under_the_name_of_the_panel(drawing, tmp_path):
    scene = bpy.context.scene
    stroke(middle())
    masks = [mask().copy()]
    scene.ctmc.volume_name = "case 7"
    (tmp_path / "second").mkdir()
    np.save(tmp_path / "second" / "ball.npy", np.arange(24**3, dtype=np.int16).reshape(24, 24, 24))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "second" / "ball.npy"), spacing=(1, 1, 2))
    stroke(middle())
    masks.append(mask().copy())
    scene.ctmc.volume_name = "case 7"
    second, first = (ct.volume_fingerprint for ct in stored_paths.states_in(scene))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    for fingerprint, before in zip((first, second), masks, strict=True):
        file = tmp_path / f"case Scene case 7 {fingerprint[:4]} drawn.seg.nrrd"
        assert (read_volume(file).values == before).all()
    assert len(list(tmp_path.glob("*drawn.seg.nrrd"))) == 2


def test_undo_keeps_what_was_drawn_on_another_ct(drawing, tmp_path):
    scene = bpy.context.scene
    stroke(middle())
    item, before = drawings.active(scene), mask().copy()
    first, key = item.fingerprint, item.key
    np.save(tmp_path / "other.npy", np.arange(24**3, dtype=np.int16).reshape(24, 24, 24))
    bpy.ops.ctmc.load(filepath=str(tmp_path / "other.npy"), spacing=(1, 1, 2))
    bpy.ops.ed.undo_push(message="Loaded")
    stroke(middle())
    bpy.ops.ed.undo_push(message="Stroke")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert [one.key for one in scene.ctmc_draw.structures] == [key]
    assert scans.activate(scene, first)
    assert (mask() == before).all()


def test_the_brush_meets_a_surface_before_the_slices_where_it_draws_on_those(drawing):
    scene = bpy.context.scene
    scene.ctmc.threshold, scene.ctmc.preview = 100.0, False
    bpy.ops.ctmc.reconstruct()
    bpy.context.view_layer.update()
    x, y, z = middle()
    ray = Vector((x, y, z + 200)) * 0.01, Vector((0.0, 0.0, -1.0))
    scene.ctmc_view.show_slice, scene.ctmc_view.plane, scene.ctmc_view.position = True, "axial", 0.5
    space, view = SimpleNamespace(overlay=SimpleNamespace(show_overlays=True)), SimpleNamespace(use_clip_planes=False)

    def met():
        return brush_along(scene, space, view, ray)

    on_slice = met()
    assert not on_slice.on_surface
    drawing.on_surfaces = True
    on_surface = met()
    assert on_surface.on_surface
    inside = np.flatnonzero(volumes.current(scene).values[:, 12, 12] >= 100)  # along the ray
    top = (volumes.current(scene).affine @ (12, 12, inside.max(), 1))[2]
    assert top <= on_surface.point_mm[2] < top + volumes.current(scene).spacing[2]
    assert abs(on_surface.normal[2]) == pytest.approx(1)
    scene.ctmc_view.position = 1.0  # the slice lies before the surface
    assert not met().on_surface
    scene.ctmc_view.position = 0.5
    view.use_clip_planes = True
    assert met().point_mm == on_slice.point_mm


def test_a_saved_drawing_lies_beside_the_blend_for_other_programs(drawing, tmp_path):
    scene = bpy.context.scene
    drawing.radius_mm, drawing.ball = 4.0, True
    stroke(middle())
    scene.ctmc.labels[0].name = "tumor"
    theirs = tmp_path / "case.seg.nrrd"
    theirs.write_bytes(b"not ours")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "case.blend"))
    (file,) = tmp_path.glob("*drawn.seg.nrrd")
    labels = read_volume(file)
    assert (labels.values == mask()).all()
    assert labels.label_names == {1: "tumor"}
    assert np.allclose(labels.affine, volumes.current(scene).affine)
    assert theirs.read_bytes() == b"not ours"
    stroke(middle(), erase=True)
    written = file.stat().st_mtime_ns
    bpy.ops.wm.save_mainfile()
    assert file.stat().st_mtime_ns == written  # an empty drawing leaves the last one
