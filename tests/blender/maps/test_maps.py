# SPDX-License-Identifier: GPL-3.0-or-later
"""A map stays with its mesh: values, description, colors, and a material that is the object's own."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from rises import Rise

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.maps import (
    change_map,
    delete_map,
    hide_map,
    read_map,
    recolor_map,
    remove_map,
    show_map,
    shown_map,
    shown_name,
    stored_map,
    stored_maps,
    write_map,
)
from ctmc_addon.blender.maps.colors import COLORS, vertex_colors
from ctmc_addon.blender.maps.stored import MAPS
from ctmc_addon.blender.surface import add_reconstruction, apply_shape_and_modifiers, update_reconstruction
from ctmc_addon.core import MeshError
from ctmc_addon.core.maps.make import mapped_steps
from ctmc_addon.core.maps.ramps import NO_VALUE, RAMPS, colors_of, linear, rgb_of
from ctmc_addon.core.maps.request import MapRequest
from ctmc_addon.core.maps.surface_map import Limits
from ctmc_addon.core.progress import finish


def with_map(result, **request):
    [mapped] = finish(mapped_steps(None, [result], MapRequest((Rise(15.0),), **request), None, None))
    return mapped


@pytest.fixture
def mapped(torus):
    """A torus of 100 mm, 20 mm high: no value below 15 mm."""
    return with_map(torus(alpha=1.0), limits={"rise_mm": Limits(low=16.0)})


@pytest.fixture
def obj(scene, mapped):
    return add_reconstruction(mapped, scene)


def test_a_map_is_read_back_as_it_was_written(obj, mapped):
    [written], found = mapped.maps, read_map(obj.data, "rise_mm")
    np.testing.assert_array_equal(found.values, written.values)
    assert np.isnan(found.values).sum() > 100
    assert found.about() == written.about()
    assert found.statistics == written.statistics
    assert found.statistics.share_below > 0
    assert found.notes == ("measured upward",)
    attribute = obj.data.attributes["rise_mm"]
    assert (attribute.data_type, attribute.domain) == ("FLOAT", "POINT")
    about = json.loads(obj.data[MAPS])["rise_mm"]
    assert (about["unit"], about["ramp"], about["limits"]) == ("mm", "viridis", [16.0, None])


def test_maps_are_listed_replaced_and_removed(obj, mapped):
    [first] = mapped.maps
    write_map(obj.data, replace(first, name="dose", unit="Gy"))
    write_map(obj.data, replace(first, values=first.values + 1))
    assert [each.name for each in stored_maps(obj.data)] == ["dose", "rise_mm"]
    assert np.nanmax(read_map(obj.data, "rise_mm").values) == pytest.approx(np.nanmax(first.values) + 1)
    remove_map(obj.data, "rise_mm")
    assert "rise_mm" not in obj.data.attributes
    assert [each.name for each in stored_maps(obj.data)] == ["dose"]
    remove_map(obj.data, "dose")
    assert MAPS not in obj.data
    assert read_map(obj.data, "dose") is None
    remove_map(obj.data, "position")
    assert "position" in obj.data.attributes


def test_names_of_blender_and_other_vertices_are_refused(obj, mapped):
    [first] = mapped.maps
    with pytest.raises(MeshError, match="an attribute position of its own"):
        write_map(obj.data, replace(first, name="position"))
    if bpy.app.version < (5, 0):  # from then on names may be as long
        with pytest.raises(MeshError, match="give the map a shorter name"):
            write_map(obj.data, replace(first, name="n" * 80))
    with pytest.raises(MeshError, match="5 values and the surface"):
        write_map(obj.data, replace(first, values=first.values[:5]))
    assert [each.name for each in stored_maps(obj.data)] == ["rise_mm"]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"rise_mm": 3}', '{"rise_mm": {"name": "rise_mm"}}', 7])
def test_a_property_that_is_not_ours_is_no_map(obj, text):
    obj.data[MAPS] = text
    assert stored_maps(obj.data) == []


@pytest.mark.parametrize(("field", "value"), [("ramp", "rainbow"), ("range", [1.0, 1.0]), ("vertices", 3)])
def test_a_map_that_cannot_be_shown_is_none(obj, field, value):
    about = json.loads(obj.data[MAPS])
    about["rise_mm"][field] = value
    obj.data[MAPS] = json.dumps(about)
    assert stored_map(obj.data, "rise_mm") is None


def test_the_object_shows_a_map_and_its_own_material_stays_with_the_mesh(obj):
    own, copy = obj.data.materials[0], obj.copy()
    show_map(obj, "rise_mm")
    assert shown_map(obj).name == "rise_mm"
    assert obj.material_slots[0].material != own
    assert obj.data.materials[0] == own
    assert copy.material_slots[0].material == own, "a linked copy keeps its look"
    assert obj.data.color_attributes.active_color_name == COLORS
    group = next(node for node in obj.material_slots[0].material.node_tree.nodes if node.type == "GROUP")
    assert group.node_tree.name == "rise_mm"
    assert [socket.name for socket in group.inputs] == ["Low [mm]", "High [mm]"]
    hide_map(obj)
    assert shown_name(obj) == ""
    assert obj.material_slots[0].material == own
    assert COLORS not in obj.data.color_attributes
    assert [block.name for block in bpy.data.node_groups] == []
    assert len(bpy.data.materials) == 1
    assert stored_map(obj.data, "rise_mm") is not None


def test_another_range_and_ramp_are_shown_at_once(obj):
    show_map(obj, "rise_mm")
    stored = replace(stored_map(obj.data, "rise_mm"), range=(16.0, 18.0), ramp="magma")
    recolor_map(obj, stored)
    assert shown_map(obj) == stored
    group = next(node for node in obj.material_slots[0].material.node_tree.nodes if node.type == "GROUP")
    assert [socket.default_value for socket in group.inputs] == [16.0, 18.0]
    ramp = next(node for node in group.node_tree.nodes if node.type == "VALTORGB").color_ramp
    assert tuple(ramp.elements[-1].color) == pytest.approx(linear(rgb_of("fcfdbf")), abs=1e-5)
    colors = np.empty(4 * len(obj.data.vertices), np.float32)
    obj.data.color_attributes[COLORS].data.foreach_get("color", colors)
    values = read_map(obj.data, "rise_mm").values
    exact = colors_of(values, (16.0, 18.0), "magma") / 255
    np.testing.assert_allclose(colors.reshape(-1, 4), [linear(tuple(color)) for color in exact], atol=0.02)


@pytest.mark.parametrize("ramp", RAMPS)
def test_colors_of_vertices_are_those_of_core(ramp):
    values = np.append(np.linspace(-3.0, 5.0, 500), [np.nan, np.inf, -np.inf]).astype(np.float32)
    exact = [linear(tuple(color)) for color in colors_of(values, (-2.0, 4.0), ramp) / 255]
    found = vertex_colors(values, (-2.0, 4.0), ramp)
    np.testing.assert_allclose(found, exact, atol=0.01)
    assert tuple(found[500]) == pytest.approx(linear(rgb_of(NO_VALUE)), abs=1e-6)


def test_a_copy_of_the_object_shows_the_map_too_until_it_is_deleted(scene, obj):
    show_map(obj, "rise_mm")
    copy = obj.copy()
    assert shown_name(copy) == "rise_mm"
    hide_map(obj)
    assert COLORS in obj.data.color_attributes, "the copy shows them"
    delete_map(obj, "rise_mm")
    assert shown_name(copy) == ""
    assert COLORS not in obj.data.color_attributes
    assert [block.name for block in bpy.data.node_groups] == []


def test_maps_are_saved_with_the_file(obj, tmp_path):
    show_map(obj, "rise_mm")
    name, values = obj.name, read_map(obj.data, "rise_mm").values
    change_map(obj.data, replace(stored_map(obj.data, "rise_mm"), range=(2.0, 9.0)))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    again = bpy.data.objects[name]
    assert shown_map(again).range == (2.0, 9.0)
    np.testing.assert_array_equal(read_map(again.data, "rise_mm").values, values)


def test_another_surface_has_no_map_and_its_own_look(obj, torus):
    own = obj.data.materials[0]
    show_map(obj, "rise_mm")
    update_reconstruction(obj, torus(alpha=1.0, rings=40))
    assert (shown_name(obj), stored_maps(obj.data)) == ("", [])
    assert obj.material_slots[0].material == own


def test_a_new_map_comes_with_an_updated_surface(obj, torus):
    update_reconstruction(obj, with_map(torus(alpha=1.0, rings=40)))
    assert read_map(obj.data, "rise_mm").values.shape == (40 * 24,)


def test_applied_modifiers_leave_no_map_of_another_surface(scene, obj):
    show_map(obj, "rise_mm")
    obj.modifiers.new("Decimate", "DECIMATE").ratio = 0.5
    apply_shape_and_modifiers(obj)
    assert (shown_name(obj), stored_maps(obj.data)) == ("", [])


def test_other_vertices_have_no_map(obj):
    obj.data.vertices.add(1)
    assert stored_maps(obj.data) == []
