# SPDX-License-Identifier: GPL-3.0-or-later
"""Several labels as one complex: walls that neighbors share, volumes kept, and a lone label's surface of today."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from complexes import single_fans

from ctmc_addon.core import Budget, LabelError, MemoryLimitError, MeshError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.mesh.labels.label_complex import borders_of
from ctmc_addon.core.mesh.measures import component_volumes_steps
from ctmc_addon.core.mesh.topology import component_numbers_steps
from ctmc_addon.core.progress import finish
from ctmc_addon.core.surfaces.interfaces import complex_steps
from ctmc_addon.core.volume import chosen_labels_steps

REAL = Path(__file__).resolve().parents[5] / "shared" / "data" / "ts_nifti"
AFFINE = np.array([[-0.8, 0.1, 0, 3], [0, 0.8, 0.1, -5], [0.1, 0, 2.5, 7], [0, 0, 0, 1]])
SPACING = (1.0, 1.0, 3.0)


def kidney(affine=None):
    """A ball of label 2 cut by a wavy wall from label 7, a third that touches both, and one that touches nothing."""
    z, y, x = np.indices((14, 40, 40), np.float32)
    values = np.zeros(z.shape, np.int16)
    ball = (3 * (z - 6)) ** 2 + (y - 18) ** 2 + (x - 18) ** 2 < 15**2
    behind_wall = x - 18 < 3 * np.sin(y / 4)
    values[ball] = np.where(behind_wall, 7, 2)[ball]
    values[((3 * (z - 9)) ** 2 + (y - 18) ** 2 + (x - 18) ** 2 < 8**2) & ball] = 40
    values[(3 * (z - 6)) ** 2 + (y - 35) ** 2 + (x - 35) ** 2 < 4**2] = 3
    return Volume(values, np.diag([*SPACING, 1.0]) if affine is None else affine, kind="label")


def made(volume, labels=None, budget=None, **settings):
    """Return the complex of some labels, or of all that have a surface."""
    chosen = labels or finish(chosen_labels_steps(volume, ["all"]))
    return finish(complex_steps(volume, ReconstructionSettings(**settings), chosen, budget, labels is not None))


def is_closed(mesh):
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]).astype(np.int64)
    forward, back = sides[:, 0] * len(mesh.vertices) + sides[:, 1], sides[:, 1] * len(mesh.vertices) + sides[:, 0]
    return len(np.unique(forward)) == len(forward) and bool(np.isin(back, forward).all())


def triangles(mesh, turned=False):
    """Every triangle as 9 numbers, from its lowest corner on, sorted."""
    corners = mesh.vertices[mesh.faces[:, ::-1] if turned else mesh.faces]  # (f, 3, 3)
    order = np.lexsort(mesh.vertices.T)
    rank = np.empty(len(order), np.intp)
    rank[order] = np.arange(len(order))
    first = rank[mesh.faces[:, ::-1] if turned else mesh.faces].argmin(axis=1)
    rows = np.take_along_axis(corners, ((first[:, None] + np.arange(3)) % 3)[..., None], axis=1).reshape(-1, 9)
    return rows[np.lexsort(rows.T)]


EVERY_WAY = [
    {},
    {"close_border": True},
    {"smoothing": "none"},
    {"smoothing": "gaussian", "smoothing_mm": 1.5},
    {"stride": (2, 2, 1), "close_border": True},
    {"stride": (2, 3, 2), "slice_steps": 2, "close_border": True},
    {"region": (3, 4, 2, 30, 33, 11), "region_unit": "voxel", "close_border": True},
]


@pytest.mark.parametrize("settings", EVERY_WAY, ids=str)
def test_every_label_is_closed_and_no_edge_has_more_than_two_of_its_triangles(settings):
    result = made(kidney(), **settings)
    for alpha in (0.0, 0.6, 1.0):
        mesh = result.surface.at(alpha)
        for label in result.labels:
            own = mesh.of_label(label)
            assert is_closed(own)
            assert own.volume > 0
    assert result.labels == ((2, 3, 7, 40) if "region" not in settings else (2, 7, 40))


def test_no_label_touches_itself_in_a_vertex():
    values = np.random.default_rng(7).integers(0, 4, (5, 6, 6))
    mesh = made(Volume(values, np.eye(4), kind="label"), smoothing="none", close_border=True).surface.at(1.0)
    borders = borders_of(mesh.faces, mesh.sides)
    for label in mesh.labels:
        own, (faces, _, used) = mesh.of_label(label), borders[label]
        assert is_closed(own)
        assert single_fans(own.faces)
        assert np.array_equal(own.faces, faces)
        assert np.array_equal(own.vertices, mesh.vertices[used])
        assert len(used) == len(np.unique(used))


def test_an_open_border_opens_labels_there_alone():
    values = np.ones((6, 8, 9), np.uint8)
    values[:, :, 5:] = 2
    values[:3, 4:] = 0
    result = made(Volume(values, np.diag([1, 1, 2.0, 1]), kind="label"))
    mesh = result.surface.at(1.0)
    assert {(each.behind, each.front) for each in result.surface.at(1.0).interfaces} == {(1, 0), (2, 0), (2, 1)}
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    assert (low >= 0).all()
    assert (high <= [8, 7, 10]).all()
    for label in (1, 2):
        own = mesh.of_label(label)
        sides = np.sort(np.concatenate([own.faces[:, [0, 1]], own.faces[:, [1, 2]], own.faces[:, [2, 0]]]), axis=1)
        pairs, count = np.unique(sides, axis=0, return_counts=True)
        assert count.max() == 2
        middle = own.vertices[pairs[count == 1]].mean(axis=1)  # of the open edges
        on_border = np.isclose(middle, 0, atol=1e-5) | np.isclose(middle, [8, 7, 10], atol=1e-5)
        assert on_border.any(axis=1).all()


def test_neighbors_have_the_same_triangles_at_their_wall_turned():
    result = made(kidney())
    mesh = result.surface.at(0.8)
    for first, second in ((2, 7), (2, 40), (7, 40)):
        between = [
            triangles(replace(mesh, faces=mesh.faces[kept], sides=mesh.sides[kept]).of_label(label), turned)
            for label, turned in ((first, False), (second, True))
            for kept in [np.isin(mesh.sides, (first, second)).all(axis=1)]
        ]
        assert len(between[0]) > 50
        assert np.array_equal(*between)
    pairs = {(each.behind, each.front): each for each in result.surface.at(1.0).interfaces}
    assert pairs[7, 2].triangles == (np.sort(mesh.sides, axis=1) == (2, 7)).all(axis=1).sum()
    assert sum(each.triangles for each in result.surface.at(1.0).interfaces) == len(mesh.faces)


@pytest.mark.parametrize("settings", [each for each in EVERY_WAY if "region" not in each], ids=str)
def test_a_label_that_touches_nothing_has_the_surface_that_it_has_alone(settings):
    volume = kidney(AFFINE)
    together = made(volume, **settings).surface
    alone = reconstruct(volume, ReconstructionSettings(label=3, **settings)).surface
    own, beyond = together.of_label(3)
    assert (beyond == 0).all()
    assert np.array_equal(triangles(own.at(0.0)), triangles(alone.at(0.0)))
    if settings.get("smoothing") == "gaussian":  # which reaches from one label to the other
        order = [np.lexsort(surface.midpoints.T) for surface in (own, alone)]
        assert np.allclose(own.linear[order[0]], alone.linear[order[1]], atol=1e-3)
        return
    assert np.array_equal(triangles(own.at(1.0)), triangles(alone.at(1.0)))
    assert np.array_equal(triangles(own.at(0.3)), triangles(alone.at(0.3)))


@pytest.mark.parametrize("label", [2, 7])
def test_one_label_asked_for_alone_has_the_surface_of_today(label):
    volume = kidney(AFFINE)
    result = made(volume, [label])
    alone = reconstruct(volume, ReconstructionSettings(label=label))
    assert np.array_equal(triangles(result.surface.of_label(label)[0].at(1.0)), triangles(alone.surface.at(1.0)))
    assert (result.wrong_side[label], result.notes[label]) == (alone.wrong_side, alone.notes)
    assert (result.thresholds[label], result.scope.slice_steps) == (alone.threshold, alone.slice_steps)


def test_labels_that_touch_keep_their_volumes():
    result = made(kidney())
    voxel = np.prod(SPACING)
    counts = {label: (kidney().values == label).sum() * voxel for label in result.labels}
    for label in (2, 7, 40):
        assert result.label_mm3[label] == pytest.approx(counts[label])
        assert result.volumes_mm3[label] == pytest.approx(counts[label], rel=5e-4)
        assert result.surface.of_label(label)[0].at(1.0).volume == pytest.approx(counts[label], rel=5e-4)
        assert result.constants_mm[label] != 0
    assert result.constants_mm[3] == 0
    assert result.volumes_mm3[3] == pytest.approx(counts[3], rel=1e-3)


def test_islands_in_another_label_keep_their_volumes():
    z, y, x = np.indices((20, 36, 36)) - np.array([9.5, 17.5, 17.5])[:, None, None, None]
    values = np.where((3 * z) ** 2 + y**2 + x**2 < 16**2, 2, 0)
    islands = [
        (10, 18, 18),
        (slice(9, 11), 18, 10),
        (9, 10, slice(18, 22)),
        (slice(8, 11), slice(24, 27), slice(17, 19)),
    ]
    for island in islands:
        values[island] = 1
    result = made(Volume(values.astype(np.uint8), np.diag([*SPACING, 1.0]), kind="label"))
    mesh = result.surface.of_label(1)[0].at(1.0)
    component = finish(component_numbers_steps(mesh.faces, len(mesh.vertices)))
    volumes = finish(component_volumes_steps(mesh.vertices, mesh.faces, component))
    counts = np.array([1, 2, 4, 18]) * np.prod(SPACING)
    np.testing.assert_allclose(np.sort(volumes), counts, rtol=0.05)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), SPACING, (0.8, 0.8, 5.0)])
@pytest.mark.parametrize("at", [(4, 8, 8), (0, 8, 8), (4, 8, 15), (4, 2, 2)], ids=["inside", "end", "edge", "alone"])
def test_a_label_of_one_voxel_keeps_its_volume(spacing, at):
    values = np.zeros((9, 17, 17), np.uint8)
    values[:, 5:12, 5:16] = 2
    values[at] = 1
    result = made(Volume(values, np.diag([*spacing, 1.0]), kind="label"), close_border=True)
    assert result.volumes_mm3[1] == pytest.approx(np.prod(spacing), rel=0.1)
    assert result.volumes_mm3[2] == pytest.approx(np.count_nonzero(values == 2) * np.prod(spacing), rel=1e-3)


def test_an_island_at_the_end_of_the_volume_keeps_its_volume():
    values = np.zeros((9, 24, 17), np.uint8)
    values[:, 3:21, 3:14] = 2
    values[0, 8:10, 8], values[2:6, 14:19, 5:12] = 1, 1
    result = made(Volume(values, np.diag([*SPACING, 1.0]), kind="label"), close_border=True)
    mesh = result.surface.of_label(1)[0].at(1.0)
    component = finish(component_numbers_steps(mesh.faces, len(mesh.vertices)))
    volumes = finish(component_volumes_steps(mesh.vertices, mesh.faces, component))
    np.testing.assert_allclose(np.sort(volumes), np.array([2, 140]) * np.prod(SPACING), rtol=0.2)


def test_no_sample_is_on_the_wrong_side():
    volume = kidney()
    result = made(volume)
    assert result.wrong_side == {2: 0, 3: 0, 7: 0, 40: 0}
    assert sum(made(volume, smoothing="gaussian", smoothing_mm=2.0).wrong_side.values()) > 100


def test_labels_that_are_not_smoothed_meet_at_midpoints():
    result = made(kidney(), smoothing="none")
    assert np.array_equal(result.surface.midpoints, result.surface.linear)
    assert set(result.wrong_side.values()) == {0}
    in_voxels = 2 * result.surface.linear / SPACING
    on_edges = (np.abs(in_voxels - np.round(in_voxels)) < 1e-5).all(axis=1)
    assert 0.8 < on_edges.mean() < 1  # the others are points inside faces and voxels of three labels


def test_a_mirrored_affine_turns_the_triangles():
    mirrored = np.diag([-1.0, 1.0, 3.0, 1.0])
    first, second = (made(kidney(affine)) for affine in (None, mirrored))
    assert np.array_equal(first.surface.faces, second.surface.faces[:, ::-1])
    assert np.array_equal(first.surface.sides, second.surface.sides)
    assert np.array_equal(first.surface.linear * [-1, 1, 1], second.surface.linear)
    assert all(second.surface.of_label(label)[0].at(1.0).volume > 0 for label in second.labels)


@pytest.mark.parametrize("settings", [{}, {"smoothing": "gaussian", "smoothing_mm": 1.5, "stride": (2, 1, 1)}], ids=str)
def test_threads_change_no_byte(settings):
    first, *others = (made(kidney(AFFINE), None, Budget(threads=threads), **settings) for threads in (1, 2, 3))
    for other in others:
        for name in ("midpoints", "linear", "faces", "sides"):
            assert getattr(first.surface, name).tobytes() == getattr(other.surface, name).tobytes()
        assert first.constants_mm == other.constants_mm


def test_the_order_in_which_labels_are_asked_for_changes_nothing():
    volume = kidney()
    first, second = made(volume, [2, 7]), made(volume, [7, 2])
    assert first.labels == second.labels == (2, 7)
    assert first.surface.linear.tobytes() == second.surface.linear.tobytes()


def test_a_label_that_is_not_there_or_is_lost_under_a_stride_is_refused_or_left_out():
    volume = kidney()
    with pytest.raises(LabelError, match=r"label 5 is empty here; the labels are 2, 3, 7, 40"):
        made(volume, [2, 5])
    values = volume.values.copy()
    values[1, 37, 3] = 90
    volume = Volume(values, volume.affine, kind="label")
    with pytest.raises(MeshError, match="label 90; use a smaller stride"):
        made(volume, [90, 2], smoothing="none", stride=(4, 4, 4))
    result = made(volume, smoothing="none", stride=(4, 4, 4))
    assert 90 not in result.labels
    assert list(result.errors)[-1] == 90


def test_too_little_memory_is_said_in_a_sentence():
    with pytest.raises(MemoryLimitError, match="memory"):
        made(kidney(), None, Budget(threads=1, bytes=10_000))


@pytest.mark.once
@pytest.mark.skipif(not REAL.is_dir(), reason="needs the real CT ts_nifti")
def test_sixteen_organs_of_a_patient_share_their_walls():
    from ctmc_addon.readers import read_volume

    volume = read_volume(REAL / "example_seg_fast_force_split.nii.gz")
    labels = [1, 2, 3, 4, 5, 6, 7, 18, 19, 25, 26, 27, 28, 29, 30, 31]
    result = made(volume, labels, close_border=True)
    mesh = result.surface.at(1.0)
    assert result.labels == tuple(labels)
    assert set(result.wrong_side.values()) == {0}
    assert all(is_closed(mesh.of_label(label)) for label in labels)
    voxel = np.prod(volume.spacing)
    large = [label for label in labels if result.label_mm3[label] > 1000 * voxel]
    assert len(large) > 8
    assert max(abs(result.volumes_mm3[label] / result.label_mm3[label] - 1) for label in large) < 5e-3


def cut_ball(gap, along_slices):
    """A ball of 24 mm cut by a wavy wall, and how far a point is from the wall to first order, mm."""
    pixel = 0.9
    z, y, x = np.meshgrid(*(np.arange(-27, 27, side) + 0.3 for side in (gap, pixel, pixel)), indexing="ij")

    def height(u, v):
        return 3 * np.sin(u / 9 + 0.4) * np.cos(v / 11 + 0.2) + 0.15 * u

    def distance(x, y, z):
        u, v, w = (x, y, z) if along_slices else (y, z, x)
        step = 1e-3
        slope_u, slope_v = ((height(u + a, v + b) - height(u, v)) / step for a, b in ((step, 0), (0, step)))
        return (w - height(u, v)) / np.sqrt(1 + slope_u**2 + slope_v**2)

    ball = x * x + y * y + z * z < 24**2
    values = np.where(ball, np.where(distance(x, y, z) > 0, 2, 1), 0).astype(np.uint8)
    affine = np.diag([pixel, pixel, gap, 1.0])
    affine[:3, 3] = [x.min(), y.min(), z.min()]
    return Volume(values, affine, kind="label"), distance


# Mean distances of vtkSurfaceNets3D 9.7 on the same: 0.92, 0.23, 0.18 and 0.089 mm.
@pytest.mark.parametrize(
    ("gap", "along_slices", "most"), [(5, True, 0.55), (5, False, 0.1), (2, True, 0.15), (2, False, 0.06)]
)
def test_a_wall_is_where_it_was_sampled(gap, along_slices, most):
    volume, distance = cut_ball(gap, along_slices)
    result = made(volume)
    mesh = result.surface.at(1.0)
    corners = mesh.vertices[mesh.faces[(mesh.sides == (2, 1)).all(axis=1)]].astype(np.float64)
    off = distance(*corners.mean(axis=1).T)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    assert np.average(np.abs(off), weights=area) < most
    if gap == 2:
        assert abs(np.average(off, weights=area)) < 0.015
    assert result.wrong_side == {1: 0, 2: 0}
    for label in (1, 2):
        assert result.volumes_mm3[label] == pytest.approx(result.label_mm3[label], rel=1e-3)


def test_no_background_comes_between_two_labels_on_thick_slices():
    volume, _ = cut_ball(5, along_slices=True)
    mesh = made(volume).surface.at(1.0)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    deep = np.linalg.norm(middle, axis=1) < 20  # mm, four below the ball's surface
    assert deep.sum() > 1000
    assert (mesh.sides[deep] == (2, 1)).all()


def test_the_wall_of_two_small_labels_is_smoothed_whichever_has_the_larger_number():
    """A ball of 1,100 voxels in slices of 2.5 mm, cut by a plane: neither half is an island in the other."""
    spacing = np.array([0.8, 0.8, 2.5])
    center = np.array([10.9, 10.9, 12.6])
    point = np.indices((11, 27, 27)).transpose(1, 2, 3, 0)[..., ::-1] * spacing - center
    normal = np.array([1.0, 0.3, 0.4]) / np.sqrt(1.25)
    for below, above in ((1, 2), (2, 1)):
        halves = np.where(point @ normal > 0, above, below)
        values = np.where((point**2).sum(axis=-1) < 7.5**2, halves, 0).astype(np.uint8)
        mesh = made(Volume(values, np.diag([*spacing, 1.0]), kind="label")).surface.at(1.0)
        wall = np.unique(mesh.faces[(mesh.sides > 0).all(axis=1)])
        assert np.abs((mesh.vertices[wall] - center) @ normal).mean() < 0.08
