# SPDX-License-Identifier: GPL-3.0-or-later
"""Exploded views: how far structures are moved apart, and how files keep it beside the vertices."""

from __future__ import annotations

import html
import json
import re
import struct

import numpy as np
import pytest

from ctmc_addon.core import (
    ExplodedView,
    OutputError,
    ReconstructionSettings,
    SettingsError,
    Structure,
    Volume,
    reconstruct_labels,
    save_structures,
    shifts_of,
    write_structures,
)

CORNERS = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
QUADS = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
FACES = np.array([triangle for a, b, c, d in QUADS for triangle in ((a, b, c), (a, c, d))], np.int32)
PLACED, IN_PLACE = (".glb", ".html"), (".obj", ".3mf")


def box(center, sides=(2.0, 2.0, 2.0)):
    """The vertices and triangles of a box."""
    return (np.array(center) + CORNERS * np.array(sides) / 2).astype(np.float32), FACES


def structures_at(*centers):
    return [Structure(f"box {at}", *box(center), (200, 60, 60)) for at, center in enumerate(centers)]


def halves_of_a_ball(normal, at_mm=0.0, radius=18.0):
    """Two labels that touch at a plane through a ball, with voxels of 1 mm."""
    x, y, z = (axis - 23.5 for axis in np.meshgrid(*[np.arange(48)] * 3, indexing="ij")[::-1])
    ball, height = x * x + y * y + z * z <= radius**2, x * normal[0] + y * normal[1] + z * normal[2]
    values = np.where(ball, np.where(height > at_mm, 1, 2), 0).astype(np.uint8)
    volume = Volume(values, np.eye(4), kind="label", label_names={1: "ball a", 2: "ball b"})
    return reconstruct_labels(volume, ReconstructionSettings()).surfaces


def nodes_of(path):
    raw = path.read_bytes()
    return json.loads(raw[20 : 20 + struct.unpack_from("<I", raw, 12)[0]])["nodes"]


def binary_of(path):
    raw = path.read_bytes()
    return raw[20 + struct.unpack_from("<I", raw, 12)[0] :]


def slider_of(path):
    found = re.findall(r'class="explode" data-facts="(.*?)"', path.read_text("utf-8"))
    return [json.loads(html.unescape(facts)) for facts in found]


def test_the_farthest_moves_by_the_distance_and_others_in_proportion():
    # The common box is from -11 to 31 along x and from -1 to 5 along z: its middle is (10, 0, 2).
    meshes = [box((-10, 0, 0)), box((0, 0, 4)), box((30, 0, 0))]
    far = np.sqrt(404.0)
    expected = np.array([[-20, 0, -2], [-10, 0, 2], [20, 0, -2]]) * (50.0 / far)
    assert shifts_of(meshes, 50.0) == pytest.approx(expected, abs=1e-5)


def test_every_gap_of_a_row_grows_by_the_same():
    meshes = [box((0, 0, 30 * at)) for at in range(5)]
    before = np.array([vertices[:, 2].mean() for vertices, _ in meshes])
    after = before + shifts_of(meshes, 12.0)[:, 2]
    assert np.diff(after) == pytest.approx([36.0] * 4)


def test_a_center_is_the_mean_of_the_surface_however_it_is_divided():
    vertices, faces = box((0, 0, 0), (4, 2, 2))
    # The first triangle as three around its middle: a mean of vertices or of triangles would move.
    finer = np.concatenate([vertices, vertices[faces[:1]].mean(axis=1)])
    a, b, c = faces[0]
    divided = np.concatenate([faces[1:], np.array([[a, b, 8], [b, c, 8], [c, a, 8]], np.int32)])
    plain, fine = (shifts_of([mesh, box((10, 3, 1))], 7.0) for mesh in ((vertices, faces), (finer, divided)))
    assert fine == pytest.approx(plain, abs=1e-6)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (2 / 3, 1 / 3, -2 / 3)])
@pytest.mark.parametrize("at_mm", [0.0, 6.0])
def test_parts_of_a_cut_separate_along_its_normal(normal, at_mm):
    upper, lower = (result.mesh for result in halves_of_a_ball(normal, at_mm))
    shifts = shifts_of([(upper.vertices, upper.faces), (lower.vertices, lower.faces)], 10.0)
    apart = shifts[0] - shifts[1]
    length = np.sqrt((apart * apart).sum())
    assert (apart * np.array(normal)).sum() / length > np.cos(np.radians(2.0))
    assert np.sqrt((shifts * shifts).sum(axis=1)).max() == pytest.approx(10.0)
    # Equal halves are 20 mm apart; of unequal ones the larger stays nearer to its place.
    assert length == pytest.approx(20.0, rel=0.01) if at_mm == 0.0 else 10.0 < length < 18.0


def test_what_has_the_common_center_stays():
    shifts = shifts_of([box((5, 5, 5)), box((-15, 5, 5)), box((25, 5, 5))], 8.0)
    assert shifts.tolist() == [[0, 0, 0], [-8, 0, 0], [8, 0, 0]]
    assert shifts_of([box((1, 2, 3)), box((1, 2, 3), (9, 9, 9))], 8.0).tolist() == [[0, 0, 0]] * 2
    assert shifts_of([box((1, 2, 3))], 8.0).tolist() == [[0, 0, 0]]
    assert shifts_of([], 8.0).shape == (0, 3)


def test_lines_and_points_have_the_middle_of_their_box():
    flat = np.float32([[8, 0, 0], [10, 0, 0], [12, 0, 0]]), np.int32([[0, 1, 2]])
    mirrored = np.float32([[-8, 0, 0], [-10, 0, 0], [-12, 0, 0]]), np.int32([[0, 1, 2]])
    assert shifts_of([flat, mirrored], 3.0).tolist() == [[3, 0, 0], [-3, 0, 0]]


def test_a_glb_moves_nodes_in_meters_and_keeps_names_and_vertices(tmp_path):
    structures = structures_at((-10, 0, 0), (10, 0, 0), (0, 0, 0), (0, 0, 40), (0, 0, -40))
    write_structures(tmp_path / "a.glb", structures)
    write_structures(tmp_path / "b.glb", structures, explode=20.0)
    plain, apart = nodes_of(tmp_path / "a.glb"), nodes_of(tmp_path / "b.glb")
    assert [node.get("translation") for node in plain] == [None] * 5
    # x to the right, y to the head, z to the back.
    assert [node.get("translation") for node in apart] == [
        [-0.005, 0.0, 0.0],
        [0.005, 0.0, 0.0],
        None,
        [0.0, 0.02, 0.0],
        [0.0, -0.02, 0.0],
    ]
    assert [node["name"] for node in apart] == [node["name"] for node in plain]
    assert binary_of(tmp_path / "a.glb") == binary_of(tmp_path / "b.glb")


def test_a_page_has_a_slider_to_twice_the_distances_and_starts_where_it_is_asked(tmp_path):
    structures = structures_at((-10, 0, 0), (10, 0, 0), (0, 30, 0), (0, -30, 0))
    away = [[-0.333333, 0, 0], [0.333333, 0, 0], [0, 1, 0], [0, -1, 0]]
    for explode, most in ((0.0, 30.0), (12.5, 30.0), (45.0, 45.0)):
        write_structures(tmp_path / "a.html", structures, explode=explode)
        assert slider_of(tmp_path / "a.html") == [{"start": explode, "most": most, "away": away}]


def test_a_page_without_anything_to_move_has_no_slider(tmp_path):
    write_structures(tmp_path / "a.html", structures_at((4, 5, 6)), explode=9.0)
    assert slider_of(tmp_path / "a.html") == []


@pytest.mark.parametrize("suffix", IN_PLACE)
def test_files_of_coordinates_are_refused(tmp_path, suffix):
    with pytest.raises(OutputError, match=rf"a\{suffix} holds the patient's coordinates alone.*write \.glb, \.html or"):
        write_structures(tmp_path / f"a{suffix}", structures_at((0, 0, 0), (9, 0, 0)), explode=5.0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", PLACED)
def test_surfaces_are_saved_apart(tmp_path, suffix):
    results = halves_of_a_ball((0.0, 0.0, 1.0))
    save_structures(tmp_path / f"a{suffix}", results, explode=10.0)
    if suffix == ".glb":
        translations = np.array([node["translation"] for node in nodes_of(tmp_path / "a.glb")])
        assert translations == pytest.approx(np.array([[0, 0.01, 0], [0, -0.01, 0]]), abs=1e-4)
    else:
        assert slider_of(tmp_path / "a.html")[0]["start"] == 10.0


@pytest.mark.parametrize(("mm", "said"), [(-1.0, "from 0 to 1000, not -1"), (1001.0, "not 1001"), (np.nan, "finite")])
def test_other_distances_are_refused_in_a_sentence(mm, said):
    with pytest.raises(SettingsError, match=said):
        ExplodedView(mm)
