# SPDX-License-Identifier: GPL-3.0-or-later
"""A large surface is shown in the viewport with a share of its triangles; everything else takes all of them."""

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import bmesh
from mathutils import Matrix, Vector

from ctmc_addon.blender.export import export
from ctmc_addon.blender.rulers import full_hit, hit
from ctmc_addon.blender.scene.studio import corners_of
from ctmc_addon.blender.slices import add_cut_box, cut_away
from ctmc_addon.blender.surface import (
    add_reconstruction,
    apply_shape_and_modifiers,
    as_shown,
    component_at,
    light,
    mesh_data as meshes,
    own_surface,
    separated,
    set_alpha,
    shown_faces,
    surface_mesh_steps,
    update_reconstruction,
)
from ctmc_addon.blender.surface.evaluate import evaluated_copy, evaluated_object
from ctmc_addon.core import MeshError, Surface, Volume, finish
from ctmc_addon.core.volume import region_corners

GOAL = 400


@pytest.fixture(autouse=True)
def small_limits(monkeypatch):
    monkeypatch.setattr(light, "ABOVE", 1000)
    monkeypatch.setattr(light, "GOAL", GOAL)


def added(scene, result, **options):
    mesh = finish(surface_mesh_steps(result, light=True))
    return add_reconstruction(result, scene, mesh=mesh, **options)


def viewport_mesh(obj):
    """The mesh that the viewport draws."""
    bpy.context.view_layer.update()
    return obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data


def off_full_mm(obj):
    """The largest distance from a vertex that the viewport shows to the nearest one of the full surface, mm."""
    with evaluated_object(obj) as (full, _):
        points = meshes.read_positions(full.data)
    shown = meshes.read_positions(viewport_mesh(obj))
    return 100 * max(float(np.sqrt(((points - point) ** 2).sum(axis=1).min())) for point in shown)


@pytest.fixture
def surface(scene, torus):
    """A torus of 2,304 triangles, shown light."""
    return added(scene, torus())


def test_the_viewport_shows_a_share_of_the_triangles_and_the_mesh_keeps_all(surface):
    mesh = viewport_mesh(surface)
    assert len(surface.data.polygons) == 2304
    assert 0.6 * GOAL < len(mesh.polygons) < 1.4 * GOAL
    assert len(mesh.polygons) == shown_faces(surface)
    assert len(mesh.vertices) < len(mesh.polygons)  # Triangles beside each other share their corners.
    assert [material.name for material in mesh.materials] == [surface.data.materials[0].name]
    assert off_full_mm(surface) < 1e-4


def test_a_small_surface_and_one_that_is_not_asked_to_be_light_are_shown_in_full(scene, torus):
    for obj in (added(scene, torus(rings=20)), add_reconstruction(torus(), scene)):
        assert len(obj.modifiers) == 0
        assert shown_faces(obj) is None
        assert len(viewport_mesh(obj).polygons) == len(obj.data.polygons)


def test_a_live_decimate_is_not_shown_light(scene, torus):
    obj = added(scene, torus(simplifier="decimate", reduction=0.5))
    assert [modifier.type for modifier in obj.modifiers] == ["DECIMATE"]


def test_what_is_shown_follows_alpha_and_applied_transforms(surface):
    before = meshes.read_positions(viewport_mesh(surface))
    set_alpha(surface, 1.0)
    assert np.abs(meshes.read_positions(viewport_mesh(surface)) - before).max() > 1e-4
    assert off_full_mm(surface) < 1e-4
    matrix = Matrix.Rotation(0.5, 4, "X") @ Matrix.Translation((1, 2, 3))
    surface.data.transform(matrix, shape_keys=True)
    assert off_full_mm(surface) < 1e-4
    assert shown_faces(surface) is not None


def test_renders_evaluate_every_triangle(surface):
    counts = []

    class Engine(bpy.types.RenderEngine):
        bl_idname, bl_label = "CTMC_TEST", "Test"

        def render(self, depsgraph):
            counts.extend(
                (depsgraph.mode, len(each.object.data.polygons))
                for each in depsgraph.object_instances
                if each.object.type == "MESH"
            )

    bpy.utils.register_class(Engine)
    scene = bpy.context.scene
    try:
        scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        scene.render.engine, scene.render.resolution_x, scene.render.resolution_y = "CTMC_TEST", 8, 8
        bpy.ops.render.render()
    finally:
        bpy.utils.unregister_class(Engine)
    assert counts == [("RENDER", 2304)]
    assert len(viewport_mesh(surface).polygons) == shown_faces(surface)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".glb", ".obj", ".3mf"])
def test_a_file_has_the_same_bytes_as_without_light(scene, torus, tmp_path, suffix):
    contents = []
    for at, obj in enumerate((added(scene, torus()), add_reconstruction(torus(), scene))):
        obj.name = obj.data.materials[0].name = "torus"
        (tmp_path / str(at)).mkdir()
        export(obj, tmp_path / str(at) / f"torus{suffix}")
        contents.append((tmp_path / str(at) / f"torus{suffix}").read_bytes())
        obj.name = "other"
    assert contents[0] == contents[1]


def test_everything_that_reads_a_surface_takes_all_triangles_and_leaves_the_display(surface, scene, torus):
    mesh = as_shown(surface).mesh
    assert len(mesh.faces) == 2304
    assert mesh.volume == pytest.approx(torus().mesh.volume)
    assert len(corners_of(surface, scene)) == 1152
    assert len(evaluated_copy(surface)[0].polygons) == 2304
    assert len(own_surface(surface).mesh.faces) == 2304
    with pytest.raises(ZeroDivisionError), evaluated_object(surface):
        raise ZeroDivisionError
    assert surface.modifiers[0].show_viewport
    assert len(viewport_mesh(surface).polygons) == shown_faces(surface)


def test_the_monitor_icon_switches_between_both(surface):
    modifier = surface.modifiers[0]
    modifier.show_viewport = False
    assert shown_faces(surface) is None
    assert len(viewport_mesh(surface).polygons) == 2304
    assert len(as_shown(surface).mesh.faces) == 2304
    assert not modifier.show_viewport


def test_an_update_renews_it_and_one_with_few_triangles_removes_it(surface, torus):
    surface.modifiers.new("Mine", "TRIANGULATE")
    before = shown_faces(surface)
    update_reconstruction(surface, torus(rings=60))
    assert shown_faces(surface) != before
    assert [modifier.name for modifier in surface.modifiers] == [light.LIGHT, "Mine"]
    surface.modifiers[0].show_viewport = False
    update_reconstruction(surface, torus(rings=48))
    assert not surface.modifiers[0].show_viewport  # Full was chosen.
    update_reconstruction(surface, torus(rings=20))
    assert [modifier.name for modifier in surface.modifiers] == ["Mine"]
    assert light.COUNTS not in surface.data


def test_it_is_the_first_modifier_and_cuts_come_after_it(surface, scene):
    box = add_cut_box(scene, region_corners(Volume(np.zeros((2, 2, 2)), np.eye(4)), (0, 0, 0, 1, 1, 1), "mm"))
    box.location, box.scale = surface.location, (1000.0, 1000.0, 1000.0)
    cut_away([surface], box)
    assert [modifier.name for modifier in surface.modifiers] == [light.LIGHT, "CTMC Cut Away"]


def test_an_edited_mesh_is_shown_in_full(surface):
    surface.shape_key_clear()
    geometry = bmesh.new()
    geometry.from_mesh(surface.data)
    geometry.verts.ensure_lookup_table()
    bmesh.ops.delete(geometry, geom=[geometry.verts[0]], context="VERTS")
    geometry.to_mesh(surface.data)
    geometry.free()
    assert len(viewport_mesh(surface).polygons) == len(surface.data.polygons) == 2298
    assert shown_faces(surface) is None


def test_a_separated_component_and_the_remaining_one_are_renewed(scene, torus):
    one, other = torus(), torus(center_mm=np.array([500.0, -318.0, 987.0]))
    ends = [np.concatenate([getattr(each.surface, end) for each in (one, other)]) for end in ("midpoints", "linear")]
    faces = np.concatenate([one.surface.faces, other.surface.faces + len(one.surface.midpoints)])
    both = Surface(*ends, faces, np.concatenate([one.surface.normals, other.surface.normals]))
    obj = added(scene, replace(one, mesh=both.at(0.5), surface=both, full_faces=len(faces)))
    result = own_surface(obj)
    chosen = component_at(result, one.mesh.vertices[5].astype(float))
    new = separated(obj, result, chosen)
    for each in (obj, new):
        assert len(each.data.polygons) == 2304
        assert 0.6 * GOAL < len(viewport_mesh(each).polygons) == shown_faces(each) < 1.4 * GOAL
        assert off_full_mm(each) < 1e-4
    assert len(bpy.data.node_groups) == 1


def test_apply_shape_and_modifiers_keeps_every_triangle_and_the_display(surface):
    apply_shape_and_modifiers(surface)
    assert len(surface.data.polygons) == 2304
    assert len(viewport_mesh(surface).polygons) == shown_faces(surface)
    surface.modifiers.new("Half", "DECIMATE").ratio = 0.5
    apply_shape_and_modifiers(surface)
    assert 1100 < len(surface.data.polygons) < 1200
    assert len(viewport_mesh(surface).polygons) == shown_faces(surface)
    surface.modifiers.new("Half", "DECIMATE").ratio = 0.5
    apply_shape_and_modifiers(surface)
    assert 500 < len(surface.data.polygons) < 600
    assert len(surface.modifiers) == 0
    assert not {light.SHOWN, light.TARGET} & set(surface.data.attributes.keys())


def test_a_click_on_what_is_shown_lies_on_the_full_surface(surface, scene, torus):
    origin = Vector(surface.location) + Vector((0.31, 0.02, 2.0))
    depsgraph = bpy.context.evaluated_depsgraph_get()
    obj, shown = hit(scene, depsgraph, origin, Vector((0, 0, -1)))
    assert obj == surface
    obj, point = full_hit(scene, depsgraph, origin, Vector((0, 0, -1)))
    surface.modifiers[0].show_viewport = False
    _, full = hit(scene, bpy.context.evaluated_depsgraph_get(), origin, Vector((0, 0, -1)))
    assert obj == surface
    assert (point - full).length < 1e-6 < 1e-4 < (shown - full).length


def test_in_edit_mode_a_surface_is_refused_and_shown_in_full(surface):
    bpy.context.view_layer.objects.active = surface
    bpy.ops.object.mode_set(mode="EDIT")
    assert not surface.modifiers[0].show_in_editmode
    with pytest.raises(MeshError, match="is in Edit Mode"):
        as_shown(surface)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(viewport_mesh(surface).polygons) == shown_faces(surface)


def test_deleting_the_surface_leaves_nothing(surface):
    mesh = surface.data
    bpy.data.objects.remove(surface)
    bpy.data.meshes.remove(mesh)
    bpy.data.orphans_purge(do_recursive=True)
    assert (len(bpy.data.objects), len(bpy.data.meshes), len(bpy.data.node_groups)) == (0, 0, 0)
