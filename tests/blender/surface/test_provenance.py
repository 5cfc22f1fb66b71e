# SPDX-License-Identifier: GPL-3.0-or-later
"""How an object was made: complete, or None."""

from __future__ import annotations

import json

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.surface import add_reconstruction, read_provenance, require_provenance, set_alpha
from ctmc_addon.core.errors import MeshError


@pytest.fixture
def obj(scene, torus):
    return add_reconstruction(torus(alpha=0.3, stride=(2, 2, 1)), scene, fingerprint="12ab")


def test_an_object_knows_how_it_was_made(obj, torus):
    made = read_provenance(obj)
    assert made.settings == torus(alpha=0.3, stride=(2, 2, 1)).settings
    assert (made.voxels_visited, made.full_faces) == (2**40, 2304)
    assert (made.notes, made.spacing_mm, made.fingerprint) == (("spacing assumed",), (0.7, 0.7, 2.5), "12ab")
    assert made.placement.origin == tuple(obj.location)
    assert json.loads(obj["ctmc"]["settings"])["stride"] == [2, 2, 1]  # readable without this extension


def test_it_survives_a_saved_file(obj, tmp_path):
    made = read_provenance(obj)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    assert read_provenance(bpy.data.objects["torus"]) == made


def test_alpha_is_noted(obj):
    assert set_alpha(obj, 0.6)
    assert not set_alpha(obj, 0.6)
    assert read_provenance(obj).settings.alpha == 0.6
    assert read_provenance(obj).fingerprint == "12ab"


@pytest.mark.parametrize("other", [1, 2.5, "text", [1, 2], {}, {"scale": 0.01}, {"settings": 3, "report": 4}])
def test_another_add_ons_property_is_not_a_surface(scene, other):
    stranger = bpy.data.objects.new("stranger", bpy.data.meshes.new("stranger"))
    stranger["ctmc"] = other
    assert read_provenance(stranger) is None
    with pytest.raises(MeshError):
        require_provenance(stranger)


@pytest.mark.parametrize("missing", ["scale", "origin", "settings", "report"])
def test_an_incomplete_property_is_not_a_surface(obj, missing):
    del obj["ctmc"][missing]
    assert read_provenance(obj) is None


@pytest.mark.parametrize(("part", "missing"), [("report", "full_faces"), ("report", "notes"), ("settings", None)])
def test_an_incomplete_text_is_not_a_surface(obj, part, missing):
    text = json.loads(obj["ctmc"][part])
    if missing is None:
        text = {"no such setting": 1}
    else:
        del text[missing]
    obj["ctmc"][part] = json.dumps(text)
    assert read_provenance(obj) is None


def test_a_property_of_an_older_version_has_no_fingerprint(obj):
    del obj["ctmc"]["fingerprint"]
    assert read_provenance(obj).fingerprint == ""


def test_what_is_not_a_mesh_is_not_a_surface(scene):
    empty = bpy.data.objects.new("empty", None)
    empty["ctmc"] = {"scale": 0.01}
    assert read_provenance(empty) is None
    assert read_provenance(None) is None


BAD_REPORTS = [
    {"faces": float("inf")},
    {"faces": -3},
    {"faces": 10**400},
    {"faces": "12"},
    {"vertices": 1.5},
    {"full_faces": True},
    {"voxels_visited": None},
    {"spacing_mm": [float("nan")] * 3},
    {"spacing_mm": [1.0, 0.0, 1.0]},
    {"threshold": float("nan")},
    {"threshold": "100"},
    {"notes": 5},
    {"notes": "text"},
]


@pytest.mark.parametrize("bad", BAD_REPORTS)
def test_numbers_that_cannot_be_are_not_a_surface(obj, bad):
    report = json.loads(obj["ctmc"]["report"])
    obj["ctmc"]["report"] = json.dumps(report | bad)
    assert read_provenance(obj) is None


@pytest.mark.parametrize(
    "bad",
    [
        {"origin": [float("nan")] * 3},
        {"origin": [0.0, float("inf"), 0.0]},
        {"scale": float("nan")},
        {"scale": float("inf")},
        {"scale": -0.01},
        {"scale": "0.01"},
        {"report": "[" * 100_000},
        {"report": '{"faces": ' + "[" * 100_000},
        {"report": "[]"},
        {"report": "null"},
        {"settings": "[1]"},
        {"settings": "{" * 100_000},
        {"settings": '{"stride": ' + '{"a": 1}' + "}"},
    ],
)
def test_parts_that_cannot_be_are_not_a_surface(obj, bad):
    obj["ctmc"] = obj["ctmc"].to_dict() | bad
    assert read_provenance(obj) is None
