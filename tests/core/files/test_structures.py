# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of several structures, read back by parsers of their own: names, colors, units, triangles."""

from __future__ import annotations

import base64
import html
import json
import re
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from ctmc_addon.core import (
    OutputError,
    ReconstructionSettings,
    Structure,
    Volume,
    reconstruct_labels,
    save_structures,
    structures_of,
    write_structures,
)
from ctmc_addon.core.files.structures.packed import packed
from ctmc_addon.core.measures.units import volume_text
from ctmc_addon.core.volume import linear

SUFFIXES = (".obj", ".glb", ".3mf", ".html")
NAMES = {1: "liver", 2: "liver tumor", 3: 'vena <cava> & "x"', 4: "liver"}
COLORS = {3: (1, 2, 250)}
MODEL = {"m": "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"}


def boxes():
    """Four boxes of labels in a volume that is mirrored and moved in the patient."""
    values = np.zeros((14, 16, 30), np.uint8)
    values[2:11, 3:12, 2:12], values[5:8, 6:9, 5:8] = 1, 2
    values[3:10, 4:8, 15:20], values[4:9, 2:6, 24:30] = 3, 4
    affine = np.array([[-0.8, 0, 0, 120.5], [0, 0.8, 0, -33.25], [0, 0, 2.0, 900.125], [0, 0, 0, 1]])
    return Volume(values, affine, kind="label", label_names=NAMES, label_colors=COLORS)


@pytest.fixture(scope="module")
def results():
    return reconstruct_labels(boxes(), ReconstructionSettings()).surfaces


@pytest.fixture
def structures(results):
    return structures_of(results)


def read_glb(path):
    """Name, corners in meters (F, 3, 3), corner normals, material of every node."""
    raw = path.read_bytes()
    assert struct.unpack_from("<4sII", raw) == (b"glTF", 2, len(raw))
    length, kind = struct.unpack_from("<I4s", raw, 12)
    assert kind == b"JSON"
    assert length % 4 == 0
    tree = json.loads(raw[20 : 20 + length])
    assert struct.unpack_from("<I4s", raw, 20 + length) == (len(raw) - 28 - length, b"BIN\0")
    binary = raw[28 + length :]
    assert tree["buffers"] == [{"byteLength": len(binary)}]

    def array(number):
        accessor = tree["accessors"][number]
        view = tree["bufferViews"][accessor["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        dtype = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3}[accessor["type"]]
        rows = np.frombuffer(binary, dtype, accessor["count"] * width, view["byteOffset"]).reshape(-1, width)
        assert rows.nbytes == view["byteLength"]
        if "min" in accessor:
            assert rows.min(axis=0).tolist() == accessor["min"]
            assert rows.max(axis=0).tolist() == accessor["max"]
        return rows

    out = []
    for number in tree["scenes"][tree["scene"]]["nodes"]:
        node = tree["nodes"][number]
        (primitive,) = tree["meshes"][node["mesh"]]["primitives"]
        indices = array(primitive["indices"]).reshape(-1, 3).astype(int)
        points, normals = (array(primitive["attributes"][name]) for name in ("POSITION", "NORMAL"))
        out.append((node["name"], points[indices], normals[indices], tree["materials"][primitive["material"]]))
    return out


def read_obj(path):
    """Name, corners (F, 3, 3) and the material's lines of every object."""
    lines = [line.split() for line in path.read_text("utf-8").splitlines()]
    (library,) = [line[1] for line in lines if line[0] == "mtllib"]
    materials, named = {}, ""
    for line in (path.parent / library).read_text("utf-8").splitlines():
        word, *values = line.split()
        if word == "newmtl":
            (named,) = values
            materials[named] = {}
        elif named:
            materials[named][word] = [float(value) for value in values]
    points, out = [], []
    for word, *values in lines:
        if word == "v":
            points.append([float(value) for value in values])
        elif word == "o":
            out.append([values[0], [], None])
        elif word == "usemtl":
            out[-1][2] = materials[values[0]]
        elif word == "f":
            out[-1][1].append([int(value) - 1 for value in values])
    return [(name, np.array(points)[np.array(faces)], material) for name, faces, material in out]


def read_3mf(path):
    """Unit, and name, type, corners (F, 3, 3) and color of every object that is built."""
    with zipfile.ZipFile(path) as package:
        assert package.testzip() is None
        assert package.namelist() == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
        assert {entry.date_time for entry in package.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        model = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    objects = {found.get("id"): found for found in model.iterfind(".//m:object", MODEL)}
    bases = {group.get("id"): group.findall("m:base", MODEL) for group in model.iterfind(".//m:basematerials", MODEL)}
    out = []
    for item in model.iterfind("m:build/m:item", MODEL):
        found = objects[item.get("objectid")]
        points = np.array([[float(v.get(axis)) for axis in "xyz"] for v in found.iterfind(".//m:vertex", MODEL)])
        faces = [[int(t.get(f"v{n}")) for n in (1, 2, 3)] for t in found.iterfind(".//m:triangle", MODEL)]
        base = bases[found.get("pid")][int(found.get("pindex"))]
        assert base.get("name") == found.get("name")
        out.append((found.get("name"), found.get("type"), points[np.array(faces)], base.get("displaycolor")))
    return model.get("unit"), out


def read_page(path):
    """Facts and corners (F, 3, 3) of every structure, unpacked as viewer.js does it."""
    text = path.read_text("utf-8")
    found = re.findall(
        r'<script type="application/octet-stream" class="structure" data-facts="(.*?)">(.*?)</script>', text
    )
    out = []
    for escaped, content in found:
        facts = json.loads(html.unescape(escaped))
        out.append((facts, unpacked(facts, zlib.decompress(base64.b64decode(content)))))
    return out


def unpacked(facts, content):
    """Corners, one step after the other."""
    count, corners = facts["vertices"], 3 * facts["faces"]
    assert len(content) == 6 * count + facts["planes"] * corners
    points = np.zeros((count, 3))
    for axis in range(3):
        level = 0
        for vertex in range(count):
            code = content[axis * count + vertex] | content[(3 + axis) * count + vertex] << 8
            level = (level + (-((code + 1) >> 1) if code & 1 else code >> 1)) & 65535
            points[vertex, axis] = facts["low"][axis] + facts["step"][axis] * level
    named, numbers = 0, []
    for corner in range(corners):
        code = sum(content[6 * count + plane * corners + corner] << 8 * plane for plane in range(facts["planes"]))
        numbers.append(named - code)
        named += code == 0
    assert named == count
    return points[np.array(numbers).reshape(-1, 3)]


def corners_of(structure):
    return structure.vertices.astype(np.float64)[structure.faces]


def assert_same_triangles(read, expected, tolerance):
    """Corners (F, 3, 3) are the same but for a tolerance, in any order and from any corner on, wound the same way."""
    assert read.shape == expected.shape
    left = np.arange(len(read))
    for corners in expected:
        turns = [np.abs(read[left] - np.roll(corners, turn, axis=0)).max(axis=(1, 2)) for turn in range(3)]
        best = np.min(turns, axis=0)
        assert best.min() <= tolerance
        left = np.delete(left, best.argmin())


def enclosed(corners):
    """Six times the volume by the divergence theorem: positive where triangles point outside."""
    return float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum())


def test_structures_have_names_colors_opacity_and_volume(structures):
    assert [structure.name for structure in structures] == ["liver 1", "liver tumor", NAMES[3], "liver 4"]
    assert [structure.rgb for structure in structures] == [(122, 28, 40), (242, 184, 36), (1, 2, 250), (122, 28, 40)]
    assert [structure.opacity for structure in structures] == [0.6, 1.0, 1.0, 0.6]
    assert structures[3].volume_mm3 is None  # it ends with the volume
    for structure in structures[:3]:
        assert structure.volume_mm3 == pytest.approx(enclosed(corners_of(structure)) / 6)


def test_one_structure_alone_is_opaque(results):
    (alone,) = structures_of(results[:1])
    assert alone.opacity == 1.0


def test_a_glb_has_nodes_in_meters_with_the_head_up_along_y(structures, tmp_path):
    write_structures(tmp_path / "a.glb", structures)
    read = read_glb(tmp_path / "a.glb")
    assert [name for name, *_ in read] == [structure.name for structure in structures]
    for (_, corners, normals, material), structure in zip(read, structures, strict=True):
        expected = corners_of(structure)[..., [0, 2, 1]] * (0.001, 0.001, -0.001)
        assert np.abs(corners - expected).max() < 1e-7
        assert np.abs(np.sqrt((normals.astype(np.float64) ** 2).sum(axis=-1)) - 1).max() < 1e-5
        outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert ((outward[:, None] * normals).sum(axis=-1).mean(axis=-1) > 0).all()
        shading = material["pbrMetallicRoughness"]
        assert shading["baseColorFactor"] == pytest.approx([*linear(structure.rgb), structure.opacity], abs=1e-5)
        assert shading["metallicFactor"] == 0.0
        assert material.get("alphaMode", "OPAQUE") == ("BLEND" if structure.opacity < 1 else "OPAQUE")
    assert all(enclosed(corners.astype(np.float64)) > 0 for _, corners, *_ in read[:3])


def test_an_obj_and_its_mtl_hold_the_same_in_millimeters(structures, tmp_path):
    write_structures(tmp_path / "a.obj", structures)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mtl", "a.obj"]
    read = read_obj(tmp_path / "a.obj")
    assert [name for name, *_ in read] == [structure.name.replace(" ", "_") for structure in structures]
    for (_, corners, material), structure in zip(read, structures, strict=True):
        assert np.abs(corners - corners_of(structure)).max() <= 0.51e-5
        assert material["Kd"] == pytest.approx([level / 255 for level in structure.rgb], abs=1e-4)
        assert material["d"] == [structure.opacity]


def test_a_3mf_holds_the_same_in_millimeters_and_says_what_is_open(structures, tmp_path):
    write_structures(tmp_path / "a.3mf", structures)
    unit, read = read_3mf(tmp_path / "a.3mf")
    assert unit == "millimeter"
    assert [(name, color) for name, _, _, color in read] == [
        ("liver 1", "#7A1C2899"),
        ("liver tumor", "#F2B824FF"),
        (NAMES[3], "#0102FAFF"),
        ("liver 4", "#7A1C2899"),
    ]
    assert [kind for _, kind, *_ in read] == ["model", "model", "model", "surface"]
    for (_, _, corners, _), structure in zip(read, structures, strict=True):
        assert np.abs(corners - corners_of(structure)).max() <= 0.51e-5


def test_a_page_holds_every_mesh_within_half_a_step_and_the_viewer(structures, tmp_path):
    write_structures(tmp_path / "a.html", structures)
    read = read_page(tmp_path / "a.html")
    for (facts, corners), structure in zip(read, structures, strict=True):
        assert facts["name"] == structure.name
        assert facts["color"] == "#{:02x}{:02x}{:02x}".format(*structure.rgb)
        assert facts["opacity"] == structure.opacity
        assert facts["volume"] == (None if structure.volume_mm3 is None else volume_text(structure.volume_mm3))
        assert_same_triangles(corners, corners_of(structure), 0.5001 * max(facts["step"]))
        assert max(facts["step"]) < 0.01
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "<title>a</title>" in text
    assert "The MIT License\n\nCopyright © 2010-2026 three.js authors" in text
    assert "{{" not in text.split("<script>")[0]
    assert text.rstrip().endswith("</html>")


def test_a_page_loads_nothing(structures, tmp_path):
    write_structures(tmp_path / "a.html", structures)
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "default-src 'none'; script-src 'unsafe-inline'" in text
    assert not re.search(r"<(?:link|img|iframe|script)[^>]*\b(?:src|href)=", text)


def test_a_name_cannot_leave_its_place_in_a_page(structures, tmp_path):
    name = '"></script><script>alert(1)</script>{{viewer.js}}'
    bad = Structure(name, structures[0].vertices, structures[0].faces, (1, 2, 3))
    write_structures(tmp_path / "x{{y}}.html", [bad])
    ((facts, _),) = read_page(tmp_path / "x{{y}}.html")
    assert facts["name"] == name
    text = (tmp_path / "x{{y}}.html").read_text("utf-8")
    assert "alert(1)</script>" not in text
    assert text.count('"use strict"') == 1
    assert "<title>x{{y}}</title>" in text


def test_packed_vertices_that_nobody_names_are_left_out_and_flat_meshes_stay_flat():
    vertices = np.array([[9, 9, 9], [0, 0, 5], [1, 0, 5], [0, 1, 5], [1, 1, 5]], np.float32)
    faces = np.array([[4, 2, 1], [1, 3, 4]], np.int32)[:, ::-1].astype(np.int32)
    mesh = packed(vertices, faces)
    facts = {"vertices": mesh.vertices, "faces": mesh.faces, "low": mesh.low, "step": mesh.step, "planes": mesh.planes}
    assert mesh.vertices == 4
    assert_same_triangles(unpacked(facts, zlib.decompress(mesh.content)), vertices[faces].astype(np.float64), 0.005)


def test_a_mesh_of_more_than_65536_vertices_is_packed_with_larger_numbers():
    side = 300
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side), [0.0]), axis=-1).reshape(-1, 3).astype(np.float32)
    across = np.arange((side - 1) * side).reshape(side - 1, side)[:, :-1].ravel()
    faces = np.stack([across, across + 1, across + side], axis=1).astype(np.int32)
    faces[-1] = (0, 1, 70_000)
    mesh = packed(grid, faces)
    assert mesh.planes == 3
    facts = {"vertices": mesh.vertices, "faces": mesh.faces, "low": mesh.low, "step": mesh.step, "planes": mesh.planes}
    read = unpacked(facts, zlib.decompress(mesh.content))
    assert len(read) == len(faces)
    longest = np.ptp(read, axis=1).max(axis=1).argmax()
    assert_same_triangles(read[longest : longest + 1], grid[faces[-1:]].astype(np.float64), 0.5001 * max(mesh.step))
    assert np.abs(np.sort(read[:, :, 1].min(axis=1)) - np.sort(grid[faces][:, :, 1].min(axis=1))).max() < 0.01


@pytest.mark.parametrize("suffix", [".obj", ".3mf"])
def test_lps_turns_x_and_y_and_nothing_inside_out(structures, tmp_path, suffix):
    write_structures(tmp_path / f"a{suffix}", structures, "lps")
    read = read_obj(tmp_path / "a.obj") if suffix == ".obj" else [row[1:] for row in read_3mf(tmp_path / "a.3mf")[1]]
    for row, structure in zip(read, structures, strict=True):
        assert np.abs(row[1] - corners_of(structure) * (-1, -1, 1)).max() <= 0.51e-5
    assert enclosed(read[0][1]) > 0


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_same_structures_give_the_same_bytes(results, tmp_path, suffix):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        save_structures(tmp_path / folder / f"x{suffix}", results)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()
        assert str(tmp_path).encode() not in path.read_bytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_fails_leaves_the_older_files(structures, tmp_path, suffix):
    for name in ("a.mtl", f"a{suffix}"):
        (tmp_path / name).write_bytes(b"older")
    empty = Structure("nothing", np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), (0, 0, 0))
    with pytest.raises(OutputError, match=r"^nothing has no triangles to write to a\."):
        write_structures(tmp_path / f"a{suffix}", [*structures, empty])
    assert {path.read_bytes() for path in tmp_path.iterdir()} == {b"older"}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted({"a.mtl", f"a{suffix}"})


def test_an_mtl_that_cannot_be_replaced_leaves_the_obj_as_it_was(structures, tmp_path):
    (tmp_path / "a.obj").write_bytes(b"older")
    (tmp_path / "a.mtl").mkdir()
    with pytest.raises(OutputError, match=r"a\.mtl"):
        write_structures(tmp_path / "a.obj", structures)
    assert (tmp_path / "a.obj").read_bytes() == b"older"


def test_other_suffixes_are_refused(structures, tmp_path):
    with pytest.raises(OutputError, match=r"a\.stl cannot hold several structures; the formats are \.obj, \.glb"):
        write_structures(tmp_path / "a.stl", structures)
    with pytest.raises(OutputError, match=r"the opacity 1\.5 of x is not from 0 to 1"):
        write_structures(
            tmp_path / "a.glb", [Structure("x", structures[0].vertices, structures[0].faces, (0, 0, 0), 1.5)]
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.once
def test_the_command_line_writes_all_of_them_without_blender(tmp_path):
    np.save(tmp_path / "seg.npy", boxes().values)
    (tmp_path / "seg.ctbl").write_text("1 liver 255 0 55 255\n", "utf-8")
    root = Path(__file__).resolve().parents[3]
    words = ["reconstruct", "seg.npy", "--spacing", "1", "1", "2", "--label", "all", "--quiet", "-o"]
    program = f"""
import sys
sys.path.insert(0, {str(root)!r})
sys.modules['bpy'] = None
from ctmc_addon.cli import main
sys.exit(any(main([*{words}, 'p' + suffix]) for suffix in {SUFFIXES}))
"""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert [name for name, *_ in read_glb(tmp_path / "p.glb")] == ["liver", "label 2", "label 3", "label 4"]
    assert next(color for *_, color in read_3mf(tmp_path / "p.3mf")[1]) == "#FF003799"
    assert [name for name, *_ in read_obj(tmp_path / "p.obj")] == ["liver", "label_2", "label_3", "label_4"]
    assert [facts["name"] for facts, _ in read_page(tmp_path / "p.html")] == ["liver", "label 2", "label 3", "label 4"]
