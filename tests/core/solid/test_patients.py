# SPDX-License-Identifier: GPL-3.0-or-later
"""Solids of real patients: what an STL file of every part tells, counted from the file alone."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings
from ctmc_addon.core.files.mesh_files import write_mesh
from ctmc_addon.core.mesh.intersections import self_intersections
from ctmc_addon.core.solid import Cut, HalfSpace, Pegs, SolidRequest, solid_parts
from ctmc_addon.readers import read_volume

pytestmark = pytest.mark.once

ORGANS = {  # Label, wall, and stride.
    "liver": (5, 2.0, (3, 3, 3)),
    "vertebra": (29, 2.0, (1, 1, 1)),
    "hip": (77, 2.0, (3, 3, 3)),
    "kidney": (2, 2.0, (1, 1, 1)),
    "portal vein": (64, 1.5, (1, 1, 1)),
}
SPINE = (200, 280, 4, 300, 400, 22)  # Columns, rows, slices of bone.
PEGS = Pegs(2, 5.0, 5.0, 0.2)
FLAT_MM = 0.06  # Where triangles cross, a plane is moved by up to a 40th of a step, and steps are 2 mm at most.
REDUCTIONS = pytest.mark.parametrize("reduction", [None, 0.9], ids=["full", "90 %"])


@pytest.fixture
def labels(real):
    volume = read_volume(real("ts_nifti") / "example_seg_fast_force_split.nii.gz")
    return replace(volume, kind="label")


@pytest.fixture
def written(tmp_path):
    """Write each part as STL; return the corners of its triangles, (f, 3, 3), as the file has them."""

    def write(parts):
        found = []
        for number, part in enumerate(parts):
            path = tmp_path / f"{number}.stl"
            write_mesh(path, part.mesh.vertices, part.mesh.faces)
            facets = np.fromfile(
                path, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]), offset=84
            )
            found.append(facets["corners"])
        return found

    return write


def through_middle(volume, chosen, normal):
    """The plane through the middle of the box around some labels."""
    at = np.argwhere(np.isin(volume.values, chosen))[:, ::-1]
    middle = (at.min(axis=0) + at.max(axis=0)) / 2
    return Cut(tuple((volume.affine @ [*middle, 1.0])[:3]), normal)


def welded(corners):
    vertices, numbers = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, numbers.reshape(-1, 3).astype(np.int32)


def volume_of(corners):
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def areas_of(corners):
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def assert_sound(corners):
    """Every edge has two triangles that run along it in opposite directions, and no two triangles meet elsewhere."""
    vertices, faces = welded(corners)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    assert (edges[:, 0] != edges[:, 1]).all()
    there, back = (edges @ (len(vertices), 1), edges @ (1, len(vertices)))
    assert len(np.unique(there)) == len(there)  # Two triangles along an edge at most.
    np.testing.assert_array_equal(np.sort(there), np.sort(back))  # And two at least.
    assert volume_of(corners) > 0
    assert (areas_of(corners) > 0).all()
    assert len(self_intersections(vertices, faces)) == 0


@REDUCTIONS
@pytest.mark.parametrize("organ", ORGANS)
def test_a_hollow_organ_cut_in_the_middle_is_two_sound_parts(labels, written, organ, reduction):
    label, wall, stride = ORGANS[organ]
    cut = through_middle(labels, [label], (0.3, 0.2, 1.0))
    settings = ReconstructionSettings(stride=stride, reduction=reduction)
    parts = written(solid_parts(labels, settings, SolidRequest(hollow=wall, cuts=(cut,)), [label]))
    assert len(parts) == 2
    plane = HalfSpace(cut.point, cut.normal)
    for corners, side in zip(parts, (1, -1), strict=True):
        assert_sound(corners)
        assert (side * plane.at(corners.reshape(-1, 3).T.astype(float))).min() > -FLAT_MM


@REDUCTIONS
@pytest.mark.parametrize("organ", ["vertebra", "kidney", "portal vein"])
def test_two_pegs_fill_their_holes_but_for_the_clearance(labels, written, organ, reduction):
    label, _, stride = ORGANS[organ]
    cut = through_middle(labels, [label], (0.05, 1.0, 0.1) if organ == "vertebra" else (0.1, 0.05, 1.0))
    settings = ReconstructionSettings(stride=stride, reduction=reduction)
    parts = solid_parts(labels, settings, SolidRequest(cuts=(cut,), pegs=PEGS), [label])
    assert not any("pegs fit" in note for part in parts for note in part.notes)
    parts = written(parts)
    for corners in parts:
        assert_sound(corners)
    if reduction:
        return
    filled = SolidRequest(cuts=(cut,), pegs=replace(PEGS, clearance=0.0))  # On the same lattice.
    whole = sum(map(volume_of, written(solid_parts(labels, settings, filled, [label]))))
    radius, hole = PEGS.diameter / 2, PEGS.diameter / 2 + PEGS.clearance
    reach = PEGS.length - radius
    gap = sum(math.pi * sign * r * r * (reach + 2 / 3 * r) for sign, r in ((1, hole), (-1, radius)))
    assert whole - sum(map(volume_of, parts)) == pytest.approx(2 * gap, rel=0.25)


@REDUCTIONS
def test_bone_at_200_hu_hollow_and_cut_is_sound(real, written, reduction):
    volume = read_volume(real("lidc0314_abdomen30"))
    columns, rows, slices = ((low + high) / 2 for low, high in zip(SPINE[:3], SPINE[3:], strict=True))
    cut = Cut(tuple((volume.affine @ [columns, rows, slices, 1.0])[:3]), (0.1, 0.2, 1.0))
    settings = ReconstructionSettings(threshold=200, region=SPINE, reduction=reduction)
    parts = written(solid_parts(volume, settings, SolidRequest(hollow=2.0, cuts=(cut,))))
    assert len(parts) == 2
    assert sum(map(len, parts)) > (3_000 if reduction else 30_000)
    for corners in parts:
        assert_sound(corners)


@REDUCTIONS
def test_vertebrae_that_touch_share_their_wall_and_their_sections_after_a_cut(labels, written, reduction):
    both = [29, 30]
    cut = through_middle(labels, both, (1.0, 0.1, 0.05))
    settings = ReconstructionSettings(reduction=reduction)
    made = solid_parts(labels, settings, SolidRequest(cuts=(cut,)), both)
    assert [part.label_name[-4:] for part in made] == ["L3 a", "L3 b", "L2 a", "L2 b"]
    parts = written(made)
    for corners in parts:
        assert_sound(corners)
    shared = common_areas(parts)
    assert set(shared) == {(0, 1), (2, 3), (0, 2), (1, 3)}
    if not reduction:
        uncut = common_areas(written(solid_parts(labels, settings, SolidRequest(), both)))
        assert shared[0, 2] + shared[1, 3] == pytest.approx(uncut[0, 1], rel=0.01)


def common_areas(parts):
    """Areas of the triangles that two parts both have, with opposite sides, by the numbers of the parts."""
    vertices, faces = welded(np.concatenate(parts))
    owner = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    areas = areas_of(vertices[faces])
    first = faces.argmin(axis=1)[:, None]
    turned = np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1)  # The lowest corner first.
    same = {}
    for number, (low, second, third) in enumerate(turned.tolist()):
        same.setdefault((low, min(second, third), max(second, third)), []).append((second < third, number))
    found = {}
    for sides in same.values():
        assert len(sides) <= 2
        if len(sides) == 2:
            assert sides[0][0] != sides[1][0]
            pair = tuple(owner[[number for _, number in sides]].tolist())
            found[pair] = found.get(pair, 0.0) + areas[sides[0][1]]
    return found


@pytest.mark.parametrize("organ", ["vertebra", "hip", "liver"])
@pytest.mark.parametrize("normal", [None, (0.3, 0.2, 1.0)], ids=["whole", "cut"])
def test_a_part_stands_on_its_foot_or_a_note_says_by_how_much_it_does_not(labels, written, organ, normal):
    label, _, _ = ORGANS[organ]
    cuts = () if normal is None else (through_middle(labels, [label], normal),)
    parts = solid_parts(labels, ReconstructionSettings(), SolidRequest(cuts=cuts, base=4.0), [label])
    falling = []
    for part, corners in zip(parts, written(parts), strict=True):
        assert_sound(corners)
        beside = center_beside_rest(corners.astype(np.float64))
        told = [re.search(r"lies ([\d.]+) mm outside its foot", note) for note in part.notes]
        numbers = [float(found[1]) for found in told if found]
        assert len(numbers) == (beside > 0)
        assert not numbers or numbers[0] == pytest.approx(beside, rel=0.01, abs=0.2)
        falling += numbers
    assert len(falling) == len(cuts)  # The part above leans over the slanted cut, the other stands.


def center_beside_rest(corners):
    """How far the center of mass lies beside the hull of what is lowest, from 720 sides; below 0 within."""
    a, b, c = corners.transpose(1, 0, 2)
    sixfold = (a * np.cross(b, c)).sum(axis=1)
    center = (sixfold[:, None] * (a + b + c)).sum(axis=0) / (4 * sixfold.sum())
    rest = corners.reshape(-1, 3)
    rest = rest[rest[:, 2] < rest[:, 2].min() + 0.1]
    angles = np.linspace(0, 2 * np.pi, 720)
    ways = np.stack([np.cos(angles), np.sin(angles)])
    return (center[:2] @ ways - (rest[:, :2] @ ways).max(axis=0)).max()
