# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance to another surface as a map: names, refusals, closed forms, and a patient's organs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from meshes import as_mesh, icosphere, sheet
from oracles.solids import winding_numbers

from ctmc_addon.core import (
    AbsentLabelError,
    Budget,
    LabelError,
    MeshError,
    ReconstructionSettings,
    TriangleMesh,
    Volume,
    finish,
    reconstruct,
)
from ctmc_addon.core.maps import DistanceTo, MappedSurface
from ctmc_addon.core.progress import PAUSE
from ctmc_addon.readers import read_volume


def labels(size=24):
    """A block (1, 'liver'), a smaller one two voxels to its right (2, 'portal vein'), and an unused name."""
    values = np.zeros((size, size, size), np.uint8)
    values[4:18, 4:18, 4:10] = 1
    values[8:14, 8:14, 14:18] = 2
    return Volume(values, np.diag([0.5, 0.5, 1.0, 1.0]), kind="label", label_names={1: "liver", 2: "portal vein"})


def mapped(mesh, volume=None, settings=None, threads=1):
    def surface_steps(asked):
        yield PAUSE
        return reconstruct(volume, asked).mesh

    settings = settings or ReconstructionSettings()
    return MappedSurface(mesh, settings, volume or labels(), Budget(threads=threads), surface_steps)


def values_of(quantity, surface):
    return finish(quantity.values_steps(surface))


def balls(spacing, radii, centers):
    """Surfaces of balls, each sampled as an analytic field on one grid."""
    low, high = np.array([-14.0, -14, -14]), np.array([42.0, 14, 14])
    x, y, z = (np.arange(a, b, spacing) for a, b in zip(low, high, strict=True))
    affine = np.diag([spacing, spacing, spacing, 1.0])
    affine[:3, 3] = low
    grid = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1])
    for radius, center in zip(radii, centers, strict=True):
        away = np.sqrt(((grid - np.array(center)[:, None, None, None]) ** 2).sum(axis=0))
        volume = Volume((radius - away).astype(np.float32), affine)
        yield reconstruct(volume, ReconstructionSettings(threshold=0.0, alpha=1.0)).mesh


@pytest.mark.parametrize("gap", [0.4, 2.0, 5.3])
def test_two_balls_have_their_gap(gap):
    radii = (12.0, 10.0)
    centers = ((0.13, -0.21, 0.3), (22.13 + gap, -0.21, 0.3))
    first, second = balls(0.5, radii, centers)
    found = values_of(DistanceTo(second, "other ball"), mapped(first))
    here, there = (np.array(point) for point in found.nearest)
    assert np.linalg.norm(here - there) == pytest.approx(gap, abs=0.01)
    exact = np.linalg.norm(first.vertices - np.array(centers[1]), axis=1) - radii[1]
    np.testing.assert_allclose(found.values, exact, atol=0.01)
    assert found.values.dtype == np.float32
    assert found.notes == ()


def test_inside_another_surface_distances_are_negative():
    outer, inner = icosphere(4, 10.0), icosphere(3, 4.0, (1.0, 0, 0))
    found = values_of(DistanceTo(outer), mapped(inner))
    exact = np.linalg.norm(inner.vertices, axis=1) - 10.0
    np.testing.assert_allclose(found.values, exact, atol=0.05)
    assert np.linalg.norm(np.subtract(*found.nearest)) == pytest.approx(5.0, abs=0.05)
    assert (values_of(DistanceTo(inner), mapped(outer)).values > 0).all()


def test_signs_are_those_of_the_winding_number_where_surfaces_cross():
    first, second = icosphere(4, 5.0), icosphere(3, 4.0, (5.0, 0.2, 0.1))
    found = values_of(DistanceTo(second), mapped(first, threads=2))
    assert np.array_equal(found.values < 0, winding_numbers(first.vertices.astype(float), second) > 0.5)
    assert found.nearest[0] == found.nearest[1]


def test_an_open_surface_gives_distances_without_sign_and_says_so():
    ball = icosphere(2, 1.0, (2, 2, 0))
    found = values_of(DistanceTo(sheet(5, 5), "cut plane"), mapped(ball))
    assert found.values.min() >= 0
    assert found.notes == ("cut plane is not closed, so distances to it have no sign",)


def test_a_label_of_the_same_volume_is_made_without_simplification():
    volume = labels()
    settings = ReconstructionSettings(label=1, smoothing="none", reduction=0.5)
    mesh = reconstruct(volume, settings).mesh
    asked = []

    def surface_steps(other):
        yield PAUSE
        asked.append(other)
        return reconstruct(volume, other).mesh

    surface = MappedSurface(mesh, settings, volume, Budget(), surface_steps)
    by_name, by_number = values_of(DistanceTo("Portal_Vein"), surface), values_of(DistanceTo(2), surface)
    assert np.array_equal(by_name.values, by_number.values)
    assert asked == [ReconstructionSettings(label=2, smoothing="none")] * 2
    # The last voxel of one is 9, the first of the other 14; surfaces lie between samples, 0.5 mm apart.
    assert np.linalg.norm(np.subtract(*by_name.nearest)) == pytest.approx(4 * 0.5, abs=1e-6)


@pytest.mark.parametrize(
    ("target", "name", "expected"),
    [
        ("portal vein", "", "distance_portal_vein_mm"),
        (3, "", "distance_3_mm"),
        ("a/b: (c)", "", "distance_a_b_c_mm"),
        ("vein", "Left  Vein-2", "distance_Left_Vein_2_mm"),
        ("***", "", "distance_surface_mm"),
        (icosphere(0), "", "distance_surface_mm"),
    ],
)
def test_the_map_is_named_after_the_target(target, name, expected):
    assert DistanceTo(target, name).name == expected


def test_unknown_names_and_nothing_are_refused_and_a_surface_has_no_distance_to_itself():
    settings = ReconstructionSettings(label=1)
    surface = mapped(icosphere(1), labels(), settings)
    with pytest.raises(AbsentLabelError, match="no label is called 'spleen'; there are liver, portal vein"):
        values_of(DistanceTo("spleen"), surface)
    none = values_of(DistanceTo("liver"), surface)
    assert np.isnan(none.values).all()
    assert none.notes == ("liver has no distance to itself",)
    with pytest.raises(AbsentLabelError, match="label 7 is empty"):
        values_of(DistanceTo(7), surface)
    empty = TriangleMesh(np.zeros((3, 3), np.float32), np.empty((0, 3), np.int32))
    with pytest.raises(MeshError, match="screw has no triangles"):
        values_of(DistanceTo(empty, "screw"), surface)


class Files:
    """Inputs whose only file is a ball."""

    def __init__(self, volume):
        self.volume, self.asked = volume, []

    def surface_steps(self, path):
        yield PAUSE
        self.asked.append(path)
        return icosphere(1)


@pytest.mark.parametrize(
    ("text", "name", "path"),
    [
        ("portal vein", "distance_portal_vein_mm", None),
        ("2", "distance_2_mm", None),
        ("plans/Screw 4.stl", "distance_Screw_4_mm", "plans/Screw 4.stl"),
        ("tumor.nii.gz", "distance_tumor_mm", "tumor.nii.gz"),
    ],
)
def test_a_flag_means_a_structure_first_and_then_a_file(text, name, path):
    files = Files(labels())
    quantity = finish(DistanceTo.from_text_steps(text, files, {}))
    assert quantity.name == name
    assert files.asked == ([path] if path else [])


def test_a_flag_that_names_neither_is_refused():
    with pytest.raises(AbsentLabelError, match="there are liver, portal vein"):
        finish(DistanceTo.from_text_steps("spleen", Files(labels()), {}))


def test_shared_labels_of_one_name_must_be_told_apart():
    volume = Volume(labels().values, np.eye(4), kind="label", label_names={1: "lesion", 2: "lesion"})
    with pytest.raises(LabelError, match="'lesion' means 2 labels, 1, 2; give the number of one"):
        finish(DistanceTo.from_text_steps("lesion", Files(volume), {}))


def test_any_number_of_threads_gives_the_same_bytes():
    first, second = icosphere(5, 5.0), icosphere(5, 4.0, (6.0, 3, 1))
    one, three = (values_of(DistanceTo(second), mapped(first, threads=threads)) for threads in (1, 3))
    assert one.values.tobytes() == three.values.tobytes()
    assert one.nearest == three.nearest


@pytest.mark.once
def test_a_patient_s_organs_are_as_far_apart_as_every_vertex_says(real):
    scipy = pytest.importorskip("scipy.spatial")
    volume = replace(read_volume(real("ts_nifti") / "example_seg_fast_force_split.nii.gz"), kind="label")
    present, counts = np.unique(volume.values, return_counts=True)
    first, second = (int(label) for label in present[1:][np.argsort(-counts[1:], kind="stable")][:2])
    meshes = [reconstruct(volume, ReconstructionSettings(label=label)).mesh for label in (first, second)]
    surface = mapped(meshes[0], volume, ReconstructionSettings(label=first))
    found = values_of(DistanceTo(second), surface)
    nearest, _ = scipy.cKDTree(meshes[1].vertices).query(meshes[0].vertices)
    edge = max(np.linalg.norm(np.diff(mesh.vertices[mesh.faces], axis=1), axis=2).max() for mesh in meshes)
    assert (np.abs(found.values) <= nearest + 1e-4).all()
    assert (np.abs(found.values) >= nearest - edge).all()
    assert np.linalg.norm(np.subtract(*found.nearest)) <= np.abs(found.values).min() + 1e-4


def test_steps_can_be_closed_anywhere():
    first, second = icosphere(4, 5.0), icosphere(4, 4.0, (6.0, 3, 1))
    fractions = [step.fraction for step in DistanceTo(second).values_steps(mapped(first))]
    assert fractions == sorted(fractions)
    for stop in range(1, len(fractions), 17):
        steps = DistanceTo(second).values_steps(mapped(first))
        for _ in range(stop):
            next(steps)
        steps.close()


def test_a_mesh_with_one_triangle_is_a_target():
    flat = as_mesh([[0, 0, 0], [4, 0, 0], [0, 4, 0]], [[0, 1, 2]])
    found = values_of(DistanceTo(flat), mapped(icosphere(3, 1.0, (1, 1, 3))))
    assert found.values.min() == pytest.approx(2.0, abs=0.02)
