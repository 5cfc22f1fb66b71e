# SPDX-License-Identifier: GPL-3.0-or-later
"""Every node tree of ours has its links and values, by what sockets are called, in the Blender at hand.

Blender adds sockets, reorders them and gives them other names; a link to the wrong one is not an error there.
"""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.figure.page.axes import depth_ink, page_ink
from ctmc_addon.blender.figure.rendering.illustration import outline_material
from ctmc_addon.blender.figure.spec import ColorScale, FigureStyle
from ctmc_addon.blender.figure.styles import transparent_material
from ctmc_addon.blender.maps.material import map_material, map_nodes
from ctmc_addon.blender.materials import add_edges, flat_material, surface_material
from ctmc_addon.blender.rulers import wire_material
from ctmc_addon.blender.scene.background import BACKGROUNDS, studio_world
from ctmc_addon.blender.scene.studio import page_world
from ctmc_addon.blender.slices.cut_box import box_nodes
from ctmc_addon.blender.slices.cut_nodes import cut_nodes
from ctmc_addon.blender.slices.material import picture_coordinates, slice_material
from ctmc_addon.blender.sockets import input_of, output_of
from ctmc_addon.blender.surface.light import light_nodes
from ctmc_addon.blender.tissue import tissue_material
from ctmc_addon.blender.volume.appearance import APPEARANCES, volume_material

RED = (0.75, 0.125, 0.0625)
RISE = ColorScale("rise_mm", "rise", "mm", (-1.0, 2.5), "coolwarm")
SQUARE = np.array([[-1, -2, 0], [1, -2, 0], [1, 2, 0], [-1, 2, 0.0]])


def plane():
    obj = bpy.data.objects.new("plane", bpy.data.meshes.new("plane"))
    obj.data.materials.append(slice_material("slice", np.zeros((4, 5)), obj, SQUARE, 100.0, 20.0))
    return obj


def edged():
    material = surface_material("edges", RED)
    add_edges(material, (1.0, 1.0, 0.0), "widths")
    return material


def veil(style):
    return transparent_material(RED, 0.25, 3, FigureStyle(style=style))


def cut():
    obj = plane()
    return cut_nodes("cut", obj, obj, picture_coordinates(SQUARE), 2.0)


def box():
    return box_nodes(bpy.data.objects.new("box", bpy.data.meshes.new("box")))


LIGHT = """
    InputNamedAttribute.Attribute > Compare.A
    AttributeDomainSize.Point Count > Compare.B
    NodeGroupInput.Geometry > AttributeDomainSize.Geometry
    NodeGroupInput.Geometry > SeparateGeometry.Geometry
    Compare.Result > SeparateGeometry.Selection
    NodeGroupInput.Geometry > SampleIndex.Geometry
    InputPosition.Position > SampleIndex.Value
    InputNamedAttribute.Attribute > SampleIndex.Index
    SeparateGeometry.Selection > SetPosition.Geometry
    SampleIndex.Value > SetPosition.Position
    MergeByDistance.Geometry > AttributeDomainSize.Geometry
    AttributeDomainSize.Face Count > Compare.A
    Compare.Result > Switch.Switch
    NodeGroupInput.Geometry > Switch.False
    MergeByDistance.Geometry > Switch.True
    Switch.Output > NodeGroupOutput.Geometry
"""
BY_CAMERA = """
    LightPath.Is Camera Ray > MixShader.Fac
    Background.Background > MixShader.Shader
    Background.Background > MixShader.Shader_001
    MixShader.Shader > OutputWorld.Surface
"""
GRADIENT = """
    TexCoord.Window > SeparateXYZ.Vector
    SeparateXYZ.X > Math.Value
    SeparateXYZ.Y > Math.Value
    Math.Value > Math.Value
    Math.Value > Math.Value_001
    Math.Value > MapRange.Value
    MapRange.Result > MixShader.Fac
    Background.Background > MixShader.Shader
    Background.Background > MixShader.Shader_001
    MixShader.Shader > MixShader.Shader_001
    LightPath.Is Camera Ray > MixShader.Fac
    MixShader.Shader > OutputWorld.Surface
"""
BY_DEPTH = """
    CameraData.View Z Depth > MapRange.Value
    MapRange.Result > MixShader.Fac
    BsdfTransparent.BSDF > MixShader.Shader_001
    MixShader.Shader > OutputMaterial.Surface
"""
SURFACE = "BsdfPrincipled.BSDF > OutputMaterial.Surface"
# Nodes by their type without its first word, sockets by identifier or name.
LINKS = {
    "surface": (lambda: surface_material("surface", RED), SURFACE),
    "ruler": (wire_material, SURFACE),
    "flat": (lambda: flat_material("flat", RED), "Emission.Emission > OutputMaterial.Surface"),
    "edges": (
        edged,
        """
    Attribute.Fac > Wireframe.Size
    Wireframe.Fac > MixShader.Fac
    BsdfPrincipled.BSDF > MixShader.Shader
    BsdfPrincipled.BSDF > MixShader.Shader_001
    MixShader.Shader > OutputMaterial.Surface
""",
    ),
    "tissue": (
        lambda: tissue_material("tissue", RED, "bone", 0.01, 0.25),
        """
    TexCoord.Object > TexNoise.Vector
    TexNoise.Fac > Bump.Height
    Bump.Normal > BsdfPrincipled.Normal
    LayerWeight.Facing > Math.Value
    Value.Value > Math.Value_001
    Value.Value > Math.Value_002
    Geometry.Backfacing > Math.Value_001
    LightPath.Is Shadow Ray > Math.Value_001
    Math.Value > Math.Value
    Math.Value > Math.Value_001
    Math.Value > BsdfPrincipled.Alpha
"""
        + SURFACE,
    ),
    "studio's world": (lambda: studio_world("DARK"), BY_CAMERA),
    "studio's gradient": (lambda: studio_world("GRADIENT"), GRADIENT),
    "figure's world": (page_world, BY_CAMERA),
    "outline": (
        outline_material,
        """
    Geometry.Backfacing > MixShader.Fac
    Emission.Emission > MixShader.Shader
    BsdfTransparent.BSDF > MixShader.Shader_001
    MixShader.Shader > OutputMaterial.Surface
""",
    ),
    "letter": (lambda: depth_ink(RED, None, [1.0, 2.0]), BY_DEPTH + "Emission.Emission > MixShader.Shader"),
    "room of a letter": (lambda: page_ink(None, [1.0, 2.0]), BY_DEPTH + "Holdout.Holdout > MixShader.Shader"),
    "nodes of a map": (
        lambda: map_nodes(RISE),
        """
    Attribute.Fac > Math.Value
    NodeGroupInput.Low [mm] > Math.Value_001
    NodeGroupInput.High [mm] > Math.Value
    Math.Value > Math.Value
    Math.Value > Math.Value_001
    Math.Value > ValToRGB.Fac
    Math.Value > Mix.Factor_Float
    ValToRGB.Color > Mix.B_Color
    Mix.Result_Color > NodeGroupOutput.Color
""",
    ),
    "map": (
        lambda: map_material(RISE),
        """
    Group.Color > Emission.Color
    LayerWeight.Facing > MapRange.Value
    MapRange.Result > Emission.Strength
    Emission.Emission > OutputMaterial.Surface
""",
    ),
    "veil": (
        lambda: veil("paper"),
        """
    LayerWeight.Facing > Math.Value
    LightPath.Transparent Depth > Math.Value
    Geometry.Backfacing > Math.Value_001
    BsdfTransparent.BSDF > MixShader.Shader
    Emission.Emission > MixShader.Shader_001
    Math.Value > Math.Value
    Math.Value > Math.Value_001
    Math.Value > MixShader.Fac
    MapRange.Result > Emission.Strength
    LayerWeight.Facing > MapRange.Value
    MixShader.Shader > OutputMaterial.Surface
""",
    ),
    "glass": (
        lambda: veil("illustration"),
        """
    Geometry.Normal > VectorMath.Vector
    VectorMath.Value > Math.Value
    LayerWeight.Facing > Math.Value
    Math.Value > Math.Value
    Math.Value > Math.Value_001
    Math.Value > Emission.Strength
    Math.Value > MixShader.Fac
    Geometry.Backfacing > Math.Value_001
    LightPath.Transparent Depth > Math.Value
    BsdfTransparent.BSDF > MixShader.Shader
    BsdfTransparent.BSDF > MixShader.Shader_001
    Emission.Emission > MixShader.Shader
    Emission.Emission > MixShader.Shader_001
    MixShader.Shader > MixShader.Shader
    MixShader.Shader > MixShader.Shader_001
    MixShader.Shader > OutputMaterial.Surface
""",
    ),
    "slice": (
        lambda: plane().data.materials[0],
        """
    TexCoord.Object > VectorMath.Vector
    VectorMath.Value > Math.Value
    Math.Value > CombineXYZ.X
    Math.Value > CombineXYZ.Y
    CombineXYZ.Vector > TexImage.Vector
    TexImage.Color > MapRange.Value
    MapRange.Result > Gamma.Color
    Gamma.Color > Emission.Color
    TexImage.Alpha > Math.Value
    Math.Value > MixShader.Fac
    BsdfTransparent.BSDF > MixShader.Shader
    Emission.Emission > MixShader.Shader_001
    MixShader.Shader > OutputMaterial.Surface
""",
    ),
    "volume": (
        lambda: volume_material("volume", APPEARANCES["bone"], 0.01),
        """
    Attribute.Fac > Math.Value
    Value.Value > Math.Value
    Value.Value > Math.Value_001
    Math.Value > Math.Value
    Math.Value > Math.Value_001
    Math.Value > ValToRGB.Fac
    Math.Value > VolumePrincipled.Density
    Math.Value > VolumePrincipled.Emission Strength
    ValToRGB.Color > VolumePrincipled.Color
    ValToRGB.Color > VolumePrincipled.Emission Color
    VolumePrincipled.Volume > OutputMaterial.Volume
""",
    ),
    "cut away": (
        box,
        """
    NodeGroupInput.Geometry > MeshBoolean.Mesh 1
    NodeGroupInput.Geometry > MeshBoolean.Mesh 2
    NodeGroupInput.Geometry > Switch.False
    ObjectInfo.Geometry > MeshBoolean.Mesh 2
    ObjectInfo.Geometry > AttributeDomainSize.Geometry
    AttributeDomainSize.Face Count > Compare.A
    Compare.Result > Switch.Switch
    MeshBoolean.Mesh > Switch.False
    MeshBoolean.Mesh > Switch.True
    Switch.Output > SetMaterialIndex.Geometry
    InputNamedAttribute.Attribute > SetMaterialIndex.Selection
    SetMaterialIndex.Geometry > RemoveAttribute.Geometry
    RemoveAttribute.Geometry > RemoveAttribute.Geometry
    RemoveAttribute.Geometry > Switch.True
    Switch.Output > NodeGroupOutput.Geometry
""",
    ),
}
# The cut has over 100 links; those around nodes to which Blender has added sockets.
CUT = """
    NodeGroupInput.Geometry > CaptureAttribute.Geometry
    FieldOnDomain.Value > CaptureAttribute.Condition
    CaptureAttribute.Geometry > SeparateGeometry.Geometry
    CaptureAttribute.Condition > BooleanMath.Boolean
    SeparateGeometry.Inverted > Triangulate.Mesh
    Triangulate.Mesh > SplitEdges.Mesh
    SplitEdges.Mesh > SeparateGeometry.Geometry
    SeparateGeometry.Selection > SetPosition.Geometry
    CornersOfVertex.Corner Index > OffsetCornerInFace.Corner Index
    OffsetCornerInFace.Corner Index > VertexOfCorner.Corner Index
    VertexOfCorner.Vertex Index > FieldAtIndex.Index
    InputPosition.Position > FieldAtIndex.Value
    InputPosition.Position > TransformPoint.Vector
    InvertMatrix.Matrix > TransformPoint.Transform
    ObjectInfo.Transform > InvertMatrix.Matrix
    FieldAtIndex.Value > Compare.A
    Math.Value > VectorMath.Scale
    VectorMath.Vector > Switch.False
    VectorMath.Vector > Switch.True
    Switch.Output > SetPosition.Position
    BooleanMath.Boolean > SetPosition.Selection
    SetPosition.Geometry > MergeByDistance.Geometry
    MergeByDistance.Geometry > MeshToCurve.Mesh
    MeshToCurve.Curve > FillCurve.Curve
    FillCurve.Mesh > SetPosition.Geometry
    CombineXYZ.Vector > StoreNamedAttribute.Value
    StoreNamedAttribute.Geometry > SetMaterial.Geometry
    SetMaterial.Geometry > JoinGeometry.Geometry
    JoinGeometry.Geometry > MergeByDistance.Geometry
    BooleanMath.Boolean > MergeByDistance.Selection
    MergeByDistance.Geometry > NodeGroupOutput.Geometry
"""


def tree_of(made):
    return made if isinstance(made, bpy.types.NodeTree) else made.node_tree


def kind_of(node):
    """The type of a node without its first word; Blender calls the shader's Geometry node New Geometry."""
    for word in ("ShaderNode", "GeometryNode", "FunctionNode"):
        if node.bl_idname.startswith(word):
            return node.bl_idname.removeprefix(word).replace("NewGeometry", "Geometry")
    return node.bl_idname


def links_of(tree):
    """Each link in the words in which a table may have it: by identifier or by name of either socket."""
    for link in tree.links:
        assert link.is_valid
        ends = [
            {f"{kind_of(node)}.{called}" for called in (socket.identifier, socket.name)}
            for node, socket in ((link.from_node, link.from_socket), (link.to_node, link.to_socket))
        ]
        yield {f"{start} > {end}" for start in ends[0] for end in ends[1]}


def expected(table):
    return {line.strip() for line in table.splitlines() if line.strip()}


def nodes_of(tree, kind):
    return [node for node in tree.nodes if kind_of(node) == kind]


@pytest.mark.usefixtures("scene")
@pytest.mark.parametrize("name", LINKS)
def test_a_tree_has_these_links_and_no_other(name):
    make, table = LINKS[name]
    links, wanted = list(links_of(tree_of(make()))), expected(table)
    assert [ways for ways in links if not ways & wanted] == []
    assert wanted - set().union(*links) == set()


@pytest.mark.usefixtures("scene")
def test_the_cut_has_its_links():
    assert expected(CUT) - set().union(*links_of(cut())) == set()


@pytest.mark.usefixtures("scene")
def test_the_display_light_has_its_links_and_values():
    tree = light_nodes()
    assert expected(LIGHT) - set().union(*links_of(tree)) == set()
    names = [input_of(node, "Name").default_value for node in nodes_of(tree, "InputNamedAttribute")]
    assert names == [".ctmc_light_shown", ".ctmc_light_target"]
    [merge] = nodes_of(tree, "MergeByDistance")
    assert input_of(merge, "Distance").default_value == pytest.approx(1e-5)
    [of_position] = [node for node in nodes_of(tree, "Compare") if node.data_type == "FLOAT"]
    assert input_of(of_position, "B").default_value == 0.5


@pytest.mark.usefixtures("scene")
@pytest.mark.parametrize("name", [*LINKS, "cut"])
def test_no_node_but_a_picture_or_a_bare_shader_is_left_out(name):
    tree = cut() if name == "cut" else tree_of(LINKS[name][0]())
    linked = {node for link in tree.links for node in (link.from_node, link.to_node)}
    assert {kind_of(node) for node in tree.nodes if node not in linked} <= {"TexImage", "BsdfPrincipled", "Emission"}


@pytest.mark.usefixtures("scene")
def test_values_are_in_the_sockets_that_are_meant():
    material = slice_material("slice", np.zeros((4, 5)), plane(), SQUARE, 100.0, 20.0).node_tree
    weights = [tuple(input_of(node, "Vector_001").default_value) for node in nodes_of(material, "VectorMath")]
    assert sorted(weights) == [(0.0, 0.25, 0.0), (0.5, 0.0, 0.0)]
    [gray] = nodes_of(material, "MapRange")
    assert [input_of(gray, end).default_value for end in ("From Min", "From Max", "To Min", "To Max")] == [
        -30,
        70,
        0,
        1,
    ]
    dark = BACKGROUNDS["DARK"]
    levels_of = ((studio_world("DARK"), [dark.ambient, dark.middle[0]]), (page_world(RED, 0.5), [1.0, RED[0]]))
    for world, levels in levels_of:
        [mix] = nodes_of(world.node_tree, "MixShader")
        shaders = [input_of(mix, called).links[0].from_node for called in ("Shader", "Shader_001")]
        reds = [input_of(shader, "Color").default_value[0] for shader in shaders]
        assert reds == pytest.approx(levels)
    [noise] = nodes_of(tissue_material("tissue", RED, "bone", 0.01, 0.25).node_tree, "TexNoise")
    assert input_of(noise, "Scale").default_value == pytest.approx(1 / 0.012)
    [group] = nodes_of(map_material(RISE).node_tree, "Group")
    assert [input_of(group, called).default_value for called in ("Low [mm]", "High [mm]")] == [-1.0, 2.5]
    [share] = [node for node in nodes_of(group.node_tree, "Math") if node.operation == "DIVIDE"]
    assert share.use_clamp
    least, rise = nodes_of(tissue_material("clear", RED, "organ", 0.01, 0.25).node_tree, "Value")
    assert [output_of(node, "Value").default_value for node in (least, rise)] == [0.25, 0.25]


@pytest.mark.usefixtures("scene")
def test_values_of_the_geometry_are_in_the_sockets_that_are_meant():
    tree = cut()
    near = sorted(input_of(node, "Distance").default_value for node in nodes_of(tree, "MergeByDistance"))
    assert near == pytest.approx([1e-6, 2e-6])
    assert [input_of(node, "Offset").default_value for node in nodes_of(tree, "OffsetCornerInFace")] == [1, 2]
    away = box()
    assert all(input_of(node, "Hole Tolerant").default_value for node in nodes_of(away, "MeshBoolean"))
    [index] = nodes_of(away, "SetMaterialIndex")
    assert input_of(index, "Material Index").default_value == 0
    [count] = nodes_of(away, "Compare")
    assert input_of(count, "B").default_value == 0.5


def test_a_socket_that_is_not_there_is_named():
    node = surface_material("surface", RED).node_tree.nodes[0]
    with pytest.raises(KeyError, match="has no socket 'Nothing'"):
        input_of(node, "Nothing")
