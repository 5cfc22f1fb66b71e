# SPDX-License-Identifier: GPL-3.0-or-later
"""Opacity is the material's: the same number in nodes, viewport, exported files and figures."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.export import export_together
from ctmc_addon.blender.materials import principled, surface_material
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.blender.tissue import (
    FINISHES,
    NODES,
    chosen_opacity,
    set_material_opacity,
    set_opacity,
    tissue_material,
)


def alpha_of(material, facing):
    """What the nodes make of "Facing", for a camera ray that meets the front; checks how they are linked."""
    nodes = {node.name: node for node in material.node_tree.nodes}
    assert principled(material).inputs["Alpha"].links[0].from_node == nodes[f"{NODES} Alpha"]
    least, rise = (nodes[f"{NODES} {part}"].outputs[0].default_value for part in ("Least", "Rise"))
    return least + rise * facing**2


def test_the_rim_is_denser_than_the_middle_and_opaque_is_without_nodes(scene):
    material = tissue_material("liver", (0.2, 0.01, 0.02), "organ", 0.01, 0.35)
    assert alpha_of(material, 0.0) == pytest.approx(0.35)
    assert alpha_of(material, 1.0) == pytest.approx(0.70)
    assert material.surface_render_method == "BLENDED"
    assert material.use_backface_culling
    count = len(material.node_tree.nodes)
    set_material_opacity(material, 0.6)
    assert (alpha_of(material, 0.0), alpha_of(material, 1.0)) == pytest.approx((0.6, 1.0))
    assert len(material.node_tree.nodes) == count
    set_material_opacity(material, 1.0)
    assert len(material.node_tree.nodes) == 2
    assert principled(material).inputs["Alpha"].default_value == 1.0
    assert (material.surface_render_method, material.use_backface_culling) == ("DITHERED", False)


def test_bone_is_rough_and_vessels_shine_and_scattering_is_in_millimeters(scene):
    shaders = {kind: principled(tissue_material(kind, (0.5, 0.5, 0.5), kind, 0.01)).inputs for kind in FINISHES}
    rough = {kind: sockets["Roughness"].default_value for kind, sockets in shaders.items()}
    assert rough["vessel"] < rough["organ"] < rough["bone"]
    assert shaders["organ"]["Subsurface Scale"].default_value == pytest.approx(0.01)
    assert shaders["organ"]["Subsurface Weight"].default_value == pytest.approx(0.35)
    assert shaders["bone"]["Normal"].is_linked


def test_a_material_without_our_shader_gets_the_alpha_of_its_color(scene):
    material = surface_material("x", (1, 1, 1))
    material.node_tree.nodes.clear()
    set_material_opacity(material, 0.25)
    assert material.diffuse_color[3] == 0.25


def test_opacity_goes_into_a_glb_and_comes_back(scene, torus, tmp_path):
    label = [replace(torus(name=name), settings=replace(torus().settings, threshold=None, label=at), label_name=name)
             for at, name in enumerate(("liver", "bone"), 1)]  # fmt: skip
    objects = [add_reconstruction(label[0], scene, opacity=0.35), add_reconstruction(label[1], scene)]
    assert [chosen_opacity(obj) for obj in objects] == [0.35, None]
    path = tmp_path / "both.glb"
    for shares in ((0.35, 1.0), (0.6, 0.15)):
        if shares[0] != 0.35:
            for obj, share in zip(objects, shares, strict=True):
                set_opacity(obj, share)
        export_together(objects, path, scene=scene)
        raw = path.read_bytes()
        tree = json.loads(raw[20 : 20 + struct.unpack_from("<I", raw, 12)[0]])
        factors = [material["pbrMetallicRoughness"]["baseColorFactor"][3] for material in tree["materials"]]
        assert factors == pytest.approx(shares)
    bpy.ops.import_scene.gltf(filepath=str(path))
    back = [material for material in bpy.data.materials if material.name in ("liver.001", "bone.001")]
    assert sorted(principled(material).inputs["Alpha"].default_value for material in back) == pytest.approx([0.15, 0.6])
