# SPDX-License-Identifier: GPL-3.0-or-later
"""Islands of a label keep their volume: a constant for each component, beside the one of the whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from meshes import component_of_face, non_manifold_edges

from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.machine.budget import Budget
from ctmc_addon.core.mesh.measures import component_volumes_steps
from ctmc_addon.core.mesh.topology import component_numbers_steps
from ctmc_addon.core.progress import finish
from ctmc_addon.core.smoothing.constrained import constrained_steps
from ctmc_addon.core.smoothing.label_components import label_components_steps
from ctmc_addon.core.smoothing.smooth_field import SmoothField

CT = Path(__file__).resolve().parents[5] / "shared" / "data"
EVEN, THICK = (1.0, 1.0, 1.0), (0.75, 0.75, 5.0)
SPACINGS = [EVEN, (0.75, 0.75, 1.6), THICK]


def smooth(mask: np.ndarray, spacing: tuple[float, float, float], **settings: object) -> SmoothField:
    return finish(constrained_steps(mask, spacing, **settings))


def blob(voxels: int, random: np.random.Generator) -> np.ndarray:
    """Samples (n, 3) that hang together by faces, grown at random."""
    grown = [(0, 0, 0)]
    while len(grown) < voxels:
        place = list(grown[random.integers(len(grown))])
        place[random.integers(3)] += random.choice([-1, 1])
        if tuple(place) not in grown:
            grown.append(tuple(place))
    return np.array(grown) - np.min(grown, axis=0)


def with_islands(body: np.ndarray, sizes: list[int], random: np.random.Generator) -> np.ndarray:
    """The body with islands that touch neither it nor one another by a face; in the outermost samples is none."""
    mask, parts = body.copy(), 0
    while parts < len(sizes):
        island = blob(sizes[parts], random)
        room = np.array(mask.shape) - island.max(axis=0) - 2
        if (room < 1).any():
            continue
        island += random.integers(1, room + 1)
        steps = np.concatenate([island, *(island + way for way in (*np.eye(3, dtype=int), *-np.eye(3, dtype=int)))])
        if not mask[tuple(steps.T)].any():
            mask[tuple(island.T)] = True
            parts += 1
    return mask


def shares(mask: np.ndarray, spacing: tuple[float, float, float], field: SmoothField) -> tuple[np.ndarray, np.ndarray]:
    """Voxels of every component of the label, and what its surface encloses of their volume."""
    components = finish(label_components_steps(mask))
    of_sample = np.full(mask.shape, -1)
    z, y, x, component = components.samples(np.ones(len(components.voxels), bool))
    of_sample[z, y, x] = component
    mesh = marching_cubes(field.values, 0.0, normals=False)
    number = finish(component_numbers_steps(mesh.faces, len(mesh.vertices)))
    sides = np.array(spacing) / [1, 1, field.slice_steps]
    volumes = finish(component_volumes_steps(mesh.vertices.astype(float) * sides, mesh.faces, number))
    at = mesh.vertices[mesh.faces[:, 0]]
    ends = np.stack([np.floor(at), np.ceil(at)]).astype(int)  # (2, F, 3); one of them is inside
    inside = field.values[ends[..., 2], ends[..., 1], ends[..., 0]] >= 0
    assert (inside.sum(axis=0) == 1).all()
    layer, row, column = ends[inside.argmax(axis=0), np.arange(len(at))][:, ::-1].T
    below, above = (
        of_sample[level, row, column] for level in (layer // field.slice_steps, -(-layer // field.slice_steps))
    )
    label = np.maximum(below, above)
    enclosed = np.zeros(len(components.voxels))
    pairs = np.unique(np.stack([number, label], axis=1), axis=0)
    assert len(pairs) == len(volumes)  # no surface is of two components
    np.add.at(enclosed, pairs[:, 1], volumes[pairs[:, 0]])
    return components.voxels, enclosed / (components.voxels * np.prod(spacing))


def assert_kept(mask: np.ndarray, spacing: tuple[float, float, float]) -> SmoothField:
    field = smooth(mask, spacing)
    assert ((field.values[:: field.slice_steps] >= 0) == mask).all()
    assert (np.abs(field.values[:: field.slice_steps]) >= 0.0199 * min(spacing)).all()
    mesh = marching_cubes(field.values, 0.0, normals=False)
    assert mesh.closed
    assert len(non_manifold_edges(mesh)) == 0
    assert field.volume_mm3 == pytest.approx(field.label_mm3, rel=2e-4)
    voxels, share = shares(mask, spacing, field)
    assert np.abs(share[voxels < 5] - 1).max(initial=0) < 0.5
    assert np.abs(share[voxels >= 5] - 1).max(initial=0) < 0.25
    return field


def ball(shape: tuple[int, int, int], radius_mm: float, spacing: tuple[float, float, float]) -> np.ndarray:
    z, y, x = ((np.arange(n) - (n - 1) / 2 + 0.2) * side for n, side in zip(shape, spacing[::-1], strict=True))
    return z[:, None, None] ** 2 + y[:, None] ** 2 + x**2 <= radius_mm**2


SIZES = [1, 1, 2, 2, 3, 4, 4, 5, 6, 8, 12, 17, 25, 40, 60, 81, 100]


@pytest.mark.parametrize("spacing", SPACINGS)
def test_islands_beside_a_body_keep_their_volume(spacing):
    shape = (20, 64, 64) if spacing == THICK else (44, 60, 60)
    radius = 14.0 if spacing == THICK else 12.0
    body = ball(shape, radius, spacing)
    mask = with_islands(body, SIZES, np.random.default_rng(2))
    field = assert_kept(mask, spacing)
    assert (shares(mask, spacing, field)[1] > 0.9).all()


@pytest.mark.parametrize("spacing", SPACINGS)
def test_islands_without_a_body_keep_their_volume(spacing):
    empty = np.zeros((18, 48, 48), bool)
    assert_kept(with_islands(empty, SIZES, np.random.default_rng(3)), spacing)


@pytest.mark.parametrize("spacing", [EVEN, THICK])
def test_one_constant_alone_loses_a_voxel_beside_a_body(spacing, monkeypatch):
    from ctmc_addon.core.smoothing.kept_volume import islands

    mask = with_islands(ball((15, 40, 40), 11.0, spacing), [1, 1, 1], np.random.default_rng(4))
    kept = shares(mask, spacing, smooth(mask, spacing))[1][:3]
    monkeypatch.setattr(islands, "LARGEST_ISLAND", 0)
    lost = shares(mask, spacing, smooth(mask, spacing))[1][:3]
    assert (np.abs(kept - 1) < 0.1).all()
    assert (lost < 0.05).all()


def test_the_body_beside_a_hundred_islands_no_longer_makes_up_for_them(monkeypatch):
    from ctmc_addon.core.smoothing.kept_volume import islands

    random = np.random.default_rng(5)
    body = ball((40, 64, 64), 14.0, EVEN)
    near = np.zeros_like(body)
    near[4:-4, 14:-14, 14:-14] = True
    mask = with_islands(body | near, [1 + number % 30 for number in range(100)], random) & ~(near & ~body)
    field = assert_kept(mask, EVEN)
    monkeypatch.setattr(islands, "LARGEST_ISLAND", 0)
    shared = smooth(mask, EVEN)
    moved = np.abs(field.values - shared.values)[near]
    assert moved.max() <= abs(field.constant_mm - shared.constant_mm) + 1e-6
    kept, larger = (shares(mask, EVEN, each)[1][-1] for each in (field, shared))  # of the body
    assert abs(kept - 1) < 0.002 < 0.01 < larger - 1


def test_islands_that_meet_at_corners_and_edges_are_components_of_their_own():
    mask = np.zeros((9, 16, 20), bool)
    mask[4, 4, 4] = True
    mask[4, 5:9, 5:9] = True  # by an edge
    mask[5, 9, 9] = True  # by a corner
    components = finish(label_components_steps(mask))
    assert components.voxels.tolist() == [1, 1, 16]
    assert_kept(mask, EVEN)


def test_an_island_at_the_border_keeps_the_volume_of_its_samples():
    mask = np.zeros((8, 20, 20), bool)
    mask[3:5, 8:12, 8:12] = True
    mask[0, 3, 3] = mask[4, 0, 16] = mask[7, 15, 15] = True
    for spacing in (EVEN, THICK):
        field = smooth(mask, spacing)
        mesh = marching_cubes(field.values, 0.0, normals=False, close_border=True)
        assert mesh.closed
        assert mesh.components == 4
        # Of 35 voxels: in thick slices the volume jumps by 0.1 % where a step between two slices changes sides.
        assert field.volume_mm3 == pytest.approx(field.label_mm3, rel=2e-4 if spacing == EVEN else 3e-4)
        number = component_of_face(mesh)
        steps = field.slice_steps
        volumes = np.sort(finish(component_volumes_steps(mesh.vertices.astype(float), mesh.faces, number))) / steps
        ends = (steps + 1) / 2 / steps  # of a voxel in the first or the last slice, cut half a refined slice outside
        assert volumes[:3] == pytest.approx(sorted([ends, ends, 1.0]), rel=0.1)


@pytest.mark.parametrize("steps", [2, 3, 4, 7])
def test_an_island_at_a_closed_border_keeps_its_volume_up_to_half_a_gap_outside(steps):
    mask = np.zeros((8, 20, 24), bool)
    mask[3:6, 10:16, 12:20] = True
    mask[0, 3, 3] = mask[7, 15:17, 4:6] = mask[6:, 3:5, 15:18] = True
    field = smooth(mask, THICK, slice_steps=steps, close_border=True)
    mesh = marching_cubes(field.values, 0.0, normals=False, close_border=True)
    number = component_of_face(mesh)
    volumes = finish(component_volumes_steps(mesh.vertices.astype(float), mesh.faces, number)) / steps
    assert np.sort(volumes) == pytest.approx([1, 4, 12, 144], rel=0.1)


def test_islands_do_not_depend_on_the_threads():
    mask = np.random.default_rng(6).random((9, 24, 40)) < 0.08
    for spacing in (EVEN, THICK):
        one, many = (smooth(mask, spacing, budget=Budget(threads=threads)) for threads in (1, 4))
        assert one.values.tobytes() == many.values.tobytes()


@pytest.mark.parametrize("density", [0.06, 0.25])
def test_in_noise_the_sum_and_most_islands_are_kept(density):
    mask = np.zeros((12, 28, 28), bool)
    mask[2:-2, 2:-2, 2:-2] = np.random.default_rng(7).random((8, 24, 24)) < density
    field = smooth(mask, EVEN)
    voxels, share = shares(mask, EVEN, field)
    assert field.volume_mm3 == pytest.approx(field.label_mm3, rel=2e-4)
    assert (np.abs(share - 1) < np.where(voxels < 5, 0.5, 0.25)).all()


@pytest.mark.parametrize("name", ["example_seg_dicom", "example_seg_fast_force_split"])
def test_real_labels_with_islands_keep_all_of_them(name):
    path = CT / "ts_nifti" / f"{name}.nii.gz"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.load(path)
    spacing = tuple(float(side) for side in image.header.get_zooms()[:3])
    liver = np.asarray(image.dataobj).T == 5
    window = tuple(
        slice(max(0, found[0] - 3), found[-1] + 4)
        for axis in range(3)
        for found in [np.flatnonzero(liver.any(axis=tuple({0, 1, 2} - {axis})))]
    )
    liver = np.pad(liver[window], 2)
    mask = with_islands(liver, SIZES * 2, np.random.default_rng(8))
    assert_kept(mask, spacing)
