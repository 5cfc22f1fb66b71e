# SPDX-License-Identifier: GPL-3.0-or-later
"""A 3MF of parts keeps the rules of the core specification 1.3 that a printer's software relies on."""

from __future__ import annotations

import zipfile
from collections import Counter
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from meshes import icosphere, joined

from ctmc_addon.core import ReconstructionSettings, Structure, Volume, reconstruct, structures_of, write_structures
from ctmc_addon.core.maps import SurfaceMap, statistics_of, vertex_areas

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
MATERIAL = "{http://schemas.microsoft.com/3dmanufacturing/material/2015/02}"
COLORS = {"hip a": (200, 10, 20), "hip b": (20, 30, 240), 'pin <1> & "x"': (0, 128, 0)}


def halves():
    """A ball cut at z = 0 and closed on both sides, as the parts of a cut are, and a hollow ball beside them."""
    z, y, x = np.ogrid[-9:10, -9:10, -9:10]
    radius = np.sqrt(x * x + y * y + z * z)
    parts = []
    for name, side in (("hip a", z - 0.4), ("hip b", 0.4 - z)):
        depth = np.minimum(6.3 - radius, side).astype(np.float32)
        affine = np.diag([0.9, 0.9, 1.4, 1.0])
        affine[:3, 3] = -80.5, 12.25, -300.0
        result = reconstruct(Volume(depth, affine), ReconstructionSettings(threshold=0.0))
        [structure] = structures_of([result], [name])
        parts.append(replace(structure, rgb=COLORS[name]))
    inner = icosphere(2, 3.0)
    hollow = joined(icosphere(2, 5.0), replace(inner, faces=inner.faces[:, ::-1].copy()))
    name = 'pin <1> & "x"'
    return [*parts, Structure(name, hollow.vertices, hollow.faces, COLORS[name], volume_mm3=hollow.volume)]


def with_map(structure):
    values = structure.vertices[:, 2].copy()
    statistics = statistics_of(values, vertex_areas(structure))
    height = SurfaceMap("height_mm", "mm", values, (float(values.min()), float(values.max())), "viridis", statistics)
    return replace(structure, maps=(height,), shown="height_mm")


@pytest.fixture(params=["plain", "with a map"])
def parts(request):
    first, *others = halves()
    return [first if request.param == "plain" else with_map(first), *others]


@pytest.fixture
def model(parts, tmp_path):
    write_structures(tmp_path / "a.3mf", parts)
    with zipfile.ZipFile(tmp_path / "a.3mf") as package:
        relations = ElementTree.fromstring(package.read("_rels/.rels"))
        [target] = [each.get("Target") for each in relations]
        return ElementTree.fromstring(package.read(target.removeprefix("/")))


def triangles_of(found):
    points = [[float(each.get(axis)) for axis in "xyz"] for each in found.iter(f"{CORE}vertex")]
    faces = [[int(each.get(f"v{n}")) for n in (1, 2, 3)] for each in found.iter(f"{CORE}triangle")]
    return np.array(points), np.array(faces)


def test_each_part_is_an_object_with_its_name_and_color_and_is_built_once_in_millimeters(model, parts):
    assert model.tag == f"{CORE}model"
    assert model.get("unit") == "millimeter"
    objects = model.findall(f"{CORE}resources/{CORE}object")
    assert [each.get("name") for each in objects] == [part.name for part in parts]
    assert {each.get("type") for each in objects} == {"model"}
    [group] = model.findall(f"{CORE}resources/{CORE}basematerials")
    bases = [(each.get("name"), each.get("displaycolor")) for each in group]
    shown = [bases[int(each.get("pindex"))] for each in objects]
    assert {each.get("pid") for each in objects} == {group.get("id")}
    assert shown == [(name, "#{:02X}{:02X}{:02X}FF".format(*color)) for name, color in COLORS.items()]
    [build] = model.findall(f"{CORE}build")
    assert [each.get("objectid") for each in build] == [each.get("id") for each in objects]
    for found, part in zip(objects, parts, strict=True):
        points, faces = triangles_of(found)
        assert np.abs(points[faces] - part.vertices[part.faces]).max() <= 0.51e-5


def test_numbers_of_resources_are_unique_and_defined_before_they_are_named(model):
    numbers = []
    for resource in model.find(f"{CORE}resources"):
        named = {each.get("pid") for each in resource.iter() if each.get("pid") is not None}
        assert named <= set(numbers)
        numbers.append(resource.get("id"))
    assert len(set(numbers)) == len(numbers)
    assert all(0 < int(number) < 1 << 31 for number in numbers)
    names = [each.get("name") for each in model.iter(f"{CORE}object")]
    assert len(set(names)) == len(names)


def test_colors_of_triangles_are_those_of_their_group(model, parts):
    groups = {each.get("id"): len(each) for each in model.iter(f"{MATERIAL}colorgroup")}
    assert len(groups) == any(part.shown for part in parts)
    colored = [each for each in model.iter(f"{CORE}triangle") if each.get("p1") is not None]
    assert len(colored) == sum(len(part.faces) for part in parts if part.shown)
    for triangle in colored:
        assert all(0 <= int(triangle.get(f"p{n}")) < groups[triangle.get("pid")] for n in (1, 2, 3))


def test_every_object_is_manifold_oriented_outward_and_has_no_flat_index(model, parts):
    for found, part in zip(model.iter(f"{CORE}object"), parts, strict=True):
        points, faces = triangles_of(found)
        assert len(points) >= 3
        assert len(faces) >= 4
        assert faces.min() == 0
        assert faces.max() == len(points) - 1
        assert (faces != np.roll(faces, 1, axis=1)).all()
        edges = Counter(tuple(edge) for pair in ((0, 1), (1, 2), (2, 0)) for edge in faces[:, pair].tolist())
        assert set(edges.values()) == {1}
        assert all(edges[end, start] == 1 for start, end in edges)
        a, b, c = points[faces].transpose(1, 0, 2)
        volume = (a * np.cross(b, c)).sum() / 6
        assert volume == pytest.approx(part.volume_mm3, rel=1e-4)
        assert volume > 0
