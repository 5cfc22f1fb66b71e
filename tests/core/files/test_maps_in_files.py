# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps in every file of surfaces, read back by parsers of their own: values, colors, units, and no value."""

from __future__ import annotations

import base64
import csv
import html
import json
import os
import re
import struct
import zipfile
import zlib
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from meshes import icosphere

from ctmc_addon.core import OutputError, Structure, TriangleMesh, write_structures
from ctmc_addon.core.files import mesh_files
from ctmc_addon.core.files.map_table import write_map_table
from ctmc_addon.core.files.structures.packed import LEVELS, packed_values
from ctmc_addon.core.files.structures.structure import as_structures
from ctmc_addon.core.maps.ramps import RAMPS, colors_of
from ctmc_addon.core.maps.surface_map import NO_LIMITS, Limits, SurfaceMap, statistics_of, vertex_areas

MODEL = {
    "c": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02",
    "m": "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
}
GRAY = [160, 160, 160]
LOWEST = float(np.finfo(np.float32).min)


def map_of(mesh, name, values, range_=(0.0, 10.0), ramp="viridis", unit="mm", limits=NO_LIMITS):
    values = np.asarray(values, np.float32)
    return SurfaceMap(name, unit, values, range_, ramp, statistics_of(values, vertex_areas(mesh), limits), limits)


@pytest.fixture
def ball():
    """A ball whose thickness is its height from -1 to 11, without a value on the left; and its dose."""
    mesh = icosphere(3, 20.0, (5.0, -7.0, 100.0))
    thickness = (mesh.vertices[:, 2] - 100) * 0.3 + 5
    thickness[mesh.vertices[:, 0] < 0] = np.nan
    maps = (
        map_of(mesh, "thickness_mm", thickness, limits=Limits(low=2.0)),
        map_of(mesh, "dose to liver", mesh.vertices[:, 1] / 3, (-9.0, 5.0), "magma", "Gy"),
    )
    return Structure("liver", mesh.vertices, mesh.faces, (122, 28, 40), 0.6, mesh.normals, 3e4, maps, "thickness_mm")


def read_ply(path):
    """Properties of the vertices, and the triangles."""
    head, raw = path.read_bytes().split(b"end_header\n", 1)
    lines = [line.split() for line in head.decode("utf-8").splitlines()]
    counts = {words[1]: int(words[2]) for words in lines if words[0] == "element"}
    names = [words[2] for words in lines if words[:2] == ["property", "float"]]
    dtype = np.dtype([(name, "<f4") for name in names])
    vertices = np.frombuffer(raw, dtype, counts["vertex"])
    faces = np.frombuffer(raw, mesh_files.PLY_FACE, counts["face"], vertices.nbytes)
    assert len(raw) == vertices.nbytes + faces.nbytes
    return vertices, faces["vertices"]


@pytest.mark.parametrize("space", ["ras", "lps"])
def test_a_ply_has_a_float_property_for_each_map_after_the_normals(ball, tmp_path, space, monkeypatch):
    monkeypatch.setattr(mesh_files, "ROWS_AT_ONCE", 100)
    mesh = TriangleMesh(ball.vertices, ball.faces, ball.normals)
    mesh.save(tmp_path / "a.ply", space, ball.maps)
    vertices, faces = read_ply(tmp_path / "a.ply")
    assert vertices.dtype.names == ("x", "y", "z", "nx", "ny", "nz", "thickness_mm", "dose_to_liver")
    assert np.array_equal(faces, ball.faces)
    assert np.array_equal(vertices["x"], ball.vertices[:, 0] * (1 if space == "ras" else -1))
    for name, each in zip(("thickness_mm", "dose_to_liver"), ball.maps, strict=True):
        assert np.array_equal(vertices[name], each.values, equal_nan=True)
    assert np.isnan(vertices["thickness_mm"]).sum() == (ball.vertices[:, 0] < 0).sum() > 0


def test_an_stl_holds_no_map_and_a_map_called_x_gets_another_name(ball, tmp_path):
    mesh = TriangleMesh(ball.vertices, ball.faces, ball.normals)
    mesh.save(tmp_path / "a.stl")
    mesh.save(tmp_path / "b.stl", maps=ball.maps)
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "b.stl").read_bytes()
    mesh.save(tmp_path / "a.ply", maps=[replace(ball.maps[0], name="x"), replace(ball.maps[0], name="")])
    assert read_ply(tmp_path / "a.ply")[0].dtype.names[6:] == ("x_2", "map")


def read_glb(path):
    """The tree, and a function that returns the rows of an accessor."""
    raw = path.read_bytes()
    (length,) = struct.unpack_from("<I", raw, 12)
    tree, binary = json.loads(raw[20 : 20 + length]), raw[28 + length :]

    def rows(number):
        accessor = tree["accessors"][number]
        view = tree["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        dtype = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= len(binary) == tree["buffers"][0]["byteLength"]
        out = np.frombuffer(binary, dtype, accessor["count"] * width, view["byteOffset"]).reshape(-1, width)
        assert out.nbytes == view["byteLength"]
        return out

    return tree, rows


def test_a_glb_has_linear_colors_of_the_map_shown_and_every_map_as_an_attribute(ball, tmp_path):
    plain = replace(ball, name="tumor", maps=(), shown="thickness_mm", opacity=1.0)
    write_structures(tmp_path / "a.glb", [ball, plain])
    tree, rows = read_glb(tmp_path / "a.glb")
    colored, uncolored = tree["meshes"]
    attributes = colored["primitives"][0]["attributes"]
    assert list(attributes) == ["POSITION", "NORMAL", "COLOR_0", "_THICKNESS_MM", "_DOSE_TO_LIVER"]
    shares = ball.maps[0].colors / 255.0
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    assert np.abs(rows(attributes["COLOR_0"]) - linear).max() < 1e-5
    for name, each in zip(("_THICKNESS_MM", "_DOSE_TO_LIVER"), ball.maps, strict=True):
        read = rows(attributes[name])[:, 0]
        # glTF 2.0, 3.6.2: NaN and infinite values are not allowed in an accessor.
        assert np.isfinite(read).all()
        assert np.array_equal(
            np.where(read == np.float32(LOWEST), np.float32("nan"), read), each.values, equal_nan=True
        )
    about = colored["extras"]
    assert about["shown"] == "thickness_mm"
    assert [(each["name"], each["unit"], each["range"], each["ramp"]) for each in about["maps"]] == [
        ("thickness_mm", "mm", [0.0, 10.0], "viridis"),
        ("dose to liver", "Gy", [-9.0, 5.0], "magma"),
    ]
    assert [(each["attribute"], each["no_value"]) for each in about["maps"]] == [
        ("_THICKNESS_MM", LOWEST),
        ("_DOSE_TO_LIVER", LOWEST),
    ]
    assert about["maps"][0]["limits"] == [2.0, None]
    # White lets the colors of the vertices through; a structure without the map keeps its own.
    first, second = (material["pbrMetallicRoughness"]["baseColorFactor"] for material in tree["materials"])
    assert first == [1.0, 1.0, 1.0, 0.6]
    assert second[:3] != [1.0, 1.0, 1.0]
    assert list(uncolored["primitives"][0]["attributes"]) == ["POSITION", "NORMAL"]
    assert "extras" not in uncolored
    assert (
        np.abs(rows(uncolored["primitives"][0]["attributes"]["POSITION"])[:, 0] * 1e3 - ball.vertices[:, 0]).max()
        < 1e-4
    )
    used = [number for mesh in tree["meshes"] for number in mesh["primitives"][0]["attributes"].values()]
    used += [mesh["primitives"][0]["indices"] for mesh in tree["meshes"]]
    assert sorted(used) == list(range(len(tree["accessors"])))


def test_a_glb_of_plain_color_still_has_every_map(ball, tmp_path):
    write_structures(tmp_path / "a.glb", [replace(ball, shown="")])
    tree, _ = read_glb(tmp_path / "a.glb")
    assert list(tree["meshes"][0]["primitives"][0]["attributes"])[2:] == ["_THICKNESS_MM", "_DOSE_TO_LIVER"]
    assert tree["meshes"][0]["extras"]["shown"] == ""
    assert tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][:3] != [1.0, 1.0, 1.0]


@pytest.mark.parametrize("space", ["ras", "lps"])
def test_an_obj_has_srgb_after_the_coordinates_where_a_map_is_shown(ball, tmp_path, space):
    write_structures(tmp_path / "a.obj", [ball, replace(ball, name="tumor", shown="")], space)
    lines = [line.split() for line in (tmp_path / "a.obj").read_text("utf-8").splitlines()]
    rows = [[float(word) for word in words[1:]] for words in lines if words[0] == "v"]
    count = len(ball.vertices)
    colored, plain = np.array(rows[:count]), np.array(rows[count:])
    assert (colored.shape, plain.shape) == ((count, 6), (count, 3))
    assert np.abs(colored[:, 3:] * 255 - ball.maps[0].colors).max() < 0.02
    assert np.abs(colored[:, :3] - ball.vertices * ([1, 1, 1] if space == "ras" else [-1, -1, 1])).max() < 1e-5
    assert re.findall(r"Kd (.*)", (tmp_path / "a.mtl").read_text("utf-8")) == [
        "1.0000 1.0000 1.0000",
        "0.4784 0.1098 0.1569",
    ]


def test_a_3mf_has_the_colors_of_the_map_shown_at_every_corner(ball, tmp_path):
    other = replace(ball, name="tumor", opacity=1.0)
    write_structures(tmp_path / "a.3mf", [ball, replace(ball, name="plain", shown=""), other, replace(ball, name="as")])
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        model = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    groups = {
        group.get("id"): [color.get("color") for color in group]
        for group in model.iterfind("c:resources/m:colorgroup", MODEL)
    }
    # A group for each opacity; numbers of resources are all different.
    assert [len(group) for group in groups.values()] == [257, 257]
    numbers = [found.get("id") for found in model.find("c:resources", MODEL)]
    assert len(set(numbers)) == len(numbers)
    exact = ball.maps[0].colors
    for found, opacity in zip(model.iterfind(".//c:object", MODEL), ("99", None, "FF", "99"), strict=True):
        triangles = list(found.iterfind(".//c:triangle", MODEL))
        assert len(triangles) == len(ball.faces)
        if opacity is None:
            assert all(triangle.get("pid") is None for triangle in triangles)
            continue
        assert len({triangle.get("pid") for triangle in triangles}) == 1
        colors = groups[triangles[0].get("pid")]
        written = np.array([[int(t.get(f"p{corner}")) for corner in (1, 2, 3)] for t in triangles])
        codes = np.array([[int(code[at : at + 2], 16) for at in (1, 3, 5)] for code in colors])
        # A step is 1/255 of the range: half of it changes a color by little.
        assert np.abs(codes[written].astype(int) - exact[ball.faces]).max() <= 3
        unknown = np.isnan(ball.maps[0].values)[ball.faces]
        assert (codes[written[unknown]] == GRAY).all()
        assert np.array_equal(written == 256, unknown)
        assert {code[7:] for code in colors} == {opacity}


def read_page(path):
    """Facts and content of every structure and map."""
    found = re.findall(r'class="(structure|map)" data-facts="(.*?)">(.*?)</script>', path.read_text("utf-8"))
    return [
        (kind, json.loads(html.unescape(facts)), zlib.decompress(base64.b64decode(text))) for kind, facts, text in found
    ]


def unpacked_values(facts, content):
    """Values, one step after the other, as maps of a page are read."""
    count = len(content) // 2
    level, out = 0, []
    for at in range(count):
        code = content[at] | content[count + at] << 8
        level = (level + (-((code + 1) >> 1) if code & 1 else code >> 1)) & 65535
        out.append(np.nan if level == LEVELS else facts["low"] + facts["step"] * level)
    return np.array(out)


def test_a_page_has_every_map_within_half_a_step_in_the_order_of_its_vertices(ball, tmp_path):
    # The height tells which vertex a value belongs to.
    heights = map_of(TriangleMesh(ball.vertices, ball.faces), "height_mm", ball.vertices[:, 2])
    write_structures(tmp_path / "a.html", [replace(ball, maps=(), shown=""), replace(ball, maps=(*ball.maps, heights))])
    kinds, facts, contents = zip(*read_page(tmp_path / "a.html"), strict=True)
    assert kinds == ("structure", "structure", "map", "map", "map")
    assert "shown" not in facts[0]
    assert facts[1]["shown"] == "thickness_mm"
    assert [(each["structure"], each["name"], each["unit"]) for each in facts[2:]] == [
        (1, "thickness_mm", "mm"),
        (1, "dose to liver", "Gy"),
        (1, "height_mm", "mm"),
    ]
    assert facts[2]["colors"] == RAMPS["viridis"].split()
    assert (facts[2]["range"], facts[2]["none"]) == ([0.0, 10.0], "a0a0a0")
    thickness, dose, height = (unpacked_values(*pair) for pair in zip(facts[2:], contents[2:], strict=True))
    for read, each in ((thickness, ball.maps[0]), (dose, ball.maps[1]), (height, heights)):
        span = np.nanmax(each.values) - np.nanmin(each.values)
        assert len(read) == len(each.values)
        assert np.abs(np.sort(read) - np.sort(each.values))[: np.isfinite(read).sum()].max() <= 0.51 * span / 65534
    known = np.isfinite(thickness)
    assert np.abs(thickness - ((height - 100) * 0.3 + 5))[known].max() < 1e-3
    # So do positions of the structure, whose third axis is decoded alike.
    count = facts[1]["vertices"]
    content = contents[1]
    planes = content[2 * count : 3 * count] + content[5 * count : 6 * count]
    up = unpacked_values({"low": facts[1]["low"][2], "step": facts[1]["step"][2]}, planes)
    assert np.abs(up - height).max() < facts[1]["step"][2]


def test_packed_values_of_a_constant_or_of_none_are_kept():
    for values, expected in (
        ([7.5, 7.5], [7.5, 7.5]),
        ([np.nan, np.nan], [np.nan, np.nan]),
        ([np.inf, 2], [np.nan, 2]),
    ):
        mesh = packed_values(np.array(values, np.float32))
        read = unpacked_values(mesh._asdict(), zlib.decompress(mesh.content))
        assert np.array_equal(read, expected, equal_nan=True)


def test_structures_share_the_range_and_ramp_of_a_map_of_one_name(ball):
    wide = replace(ball.maps[0], range=(-3.0, 4.0), ramp="magma")
    other = replace(ball, name="tumor", maps=(wide, replace(ball.maps[1], name="other")))
    first, second = as_structures([ball, other], "a.glb")
    assert [(each.name, each.range, each.ramp) for each in first.maps] == [
        ("thickness_mm", (-3.0, 10.0), "viridis"),
        ("dose to liver", (-9.0, 5.0), "magma"),
    ]
    assert [(each.name, each.range, each.ramp) for each in second.maps] == [
        ("thickness_mm", (-3.0, 10.0), "viridis"),
        ("other", (-9.0, 5.0), "magma"),
    ]
    assert np.array_equal(first.maps[0].colors, colors_of(ball.maps[0].values, (-3.0, 10.0), "viridis"))
    assert as_structures([ball], "a.glb")[0].maps[0] is ball.maps[0]


def read_table(path):
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    return head, rows


@pytest.mark.parametrize(("space", "turn"), [("ras", [1, 1, 1]), ("lps", [-1, -1, 1])])
def test_a_table_gives_every_float_back_and_leaves_no_value_empty(ball, tmp_path, space, turn, monkeypatch):
    monkeypatch.setattr(mesh_files, "ROWS_AT_ONCE", 100)
    write_map_table(tmp_path / "a.csv", [ball], space)
    head, rows = read_table(tmp_path / "a.csv")
    assert head == ["x_mm", "y_mm", "z_mm", "thickness_mm", "dose to liver"]
    read = np.array([[float(cell or "nan") for cell in row] for row in rows], np.float32)
    expected = np.column_stack([ball.vertices * np.array(turn, np.float32), *(each.values for each in ball.maps)])
    assert np.array_equal(read, expected, equal_nan=True)
    assert [row[3] for row in rows].count("") == np.isnan(ball.maps[0].values).sum() > 0
    assert b"nan" not in (tmp_path / "a.csv").read_bytes()


def test_a_table_of_several_structures_names_them_and_has_every_map(ball, tmp_path):
    tumor = replace(ball, name='a ",nan" b', maps=(ball.maps[1], replace(ball.maps[0], name="x_mm")))
    write_map_table(tmp_path / "a.csv", [ball, tumor])
    head, rows = read_table(tmp_path / "a.csv")
    assert head == ["structure", "x_mm", "y_mm", "z_mm", "thickness_mm", "dose to liver", "x_mm_2"]
    count = len(ball.vertices)
    assert [row[0] for row in rows] == ["liver"] * count + ['a ",nan" b'] * count
    assert {row[6] for row in rows[:count]} == {""}
    assert {row[4] for row in rows[count:]} == {""}
    values = np.array([float(row[6] or "nan") for row in rows[count:]], np.float32)
    assert np.array_equal(values, ball.maps[0].values, equal_nan=True)


def test_a_table_that_fails_leaves_the_older_file(ball, tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_bytes(b"older")
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(OutputError, match="the disk is full"):
        write_map_table(tmp_path / "a.csv", [ball])
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("a.csv", b"older")]


def test_a_map_of_another_surface_and_two_of_one_name_are_refused(ball, tmp_path):
    short = replace(ball.maps[0], values=ball.maps[0].values[:-1])
    message = r"the map thickness_mm has 641 values, and {} has 642 vertices; work the map out on this surface"
    with pytest.raises(OutputError, match=message.format("liver")):
        write_structures(tmp_path / "a.glb", [replace(ball, maps=(short,))])
    with pytest.raises(OutputError, match=message.format("the surface")):
        TriangleMesh(ball.vertices, ball.faces).save(tmp_path / "a.ply", maps=[short])
    with pytest.raises(OutputError, match="liver has two maps called thickness_mm; give one of them another name"):
        write_map_table(tmp_path / "a.csv", [replace(ball, maps=(ball.maps[0], ball.maps[0]))])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".3mf", ".html"])
def test_the_same_maps_give_the_same_bytes(ball, tmp_path, suffix):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        write_structures(tmp_path / folder / f"x{suffix}", [ball, ball])
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
