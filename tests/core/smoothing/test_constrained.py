# SPDX-License-Identifier: GPL-3.0-or-later
"""The smoothest field that agrees with a label: signs, components, volume, borders, threads."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from meshes import boundary_edges

from ctmc_addon.core.errors import LabelError, SettingsError
from ctmc_addon.core.extraction import scan
from ctmc_addon.core.extraction.field_pieces import surface_pieces_steps
from ctmc_addon.core.extraction.marching_cubes import marching_cubes
from ctmc_addon.core.machine.budget import Budget
from ctmc_addon.core.machine.parallel import threads_of
from ctmc_addon.core.mesh.triangle_mesh import Surface, TriangleMesh
from ctmc_addon.core.progress import finish
from ctmc_addon.core.settings import ReconstructionSettings
from ctmc_addon.core.smoothing.bounds import Start, carried
from ctmc_addon.core.smoothing.bricks import FEWEST_ROWS, ROWS_AT_ONCE, near_surface, number_bricks, over_rows, packed
from ctmc_addon.core.smoothing.constrained import (
    THICK as THICK_GRIDS,
    THIN,
    _bits,
    _coarser,
    automatic_refinement,
    constrained_bytes,
    constrained_steps,
    grids_of,
    outlined,
)
from ctmc_addon.core.smoothing.prepare import field_steps
from ctmc_addon.core.smoothing.signed_distance import signed_distance_steps
from ctmc_addon.core.smoothing.smooth_field import SmoothField, refined_affine
from ctmc_addon.core.surfaces.make import reconstruct
from ctmc_addon.core.volume.volume import Volume

THICK = (0.75, 0.75, 5.0)


def smooth(mask: Any, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0), **settings: Any) -> SmoothField:
    return finish(constrained_steps(np.asarray(mask, bool), spacing, **settings))


def surface(field: SmoothField, **settings: Any) -> TriangleMesh:
    return marching_cubes(field.values, 0.0, normals=False, **settings)


def wrong_side(field: SmoothField, mask: Any) -> int:
    return int(((field.values[:: field.slice_steps] >= 0) != mask).sum())


def ball(radius_mm: float, spacing: tuple[float, float, float], margin: int = 3) -> np.ndarray:
    counts = [2 * (int(radius_mm / side) + margin) + 1 for side in spacing[::-1]]
    z, y, x = np.meshgrid(
        *((np.arange(n) - (n - 1) / 2 + 0.2) * s for n, s in zip(counts, spacing[::-1], strict=True)), indexing="ij"
    )
    return x**2 + y**2 + z**2 <= radius_mm**2


def tube(diameter: float, tilt: float) -> np.ndarray:
    z, y, x = np.meshgrid(np.arange(40.0), np.arange(24.0), np.arange(70.0), indexing="ij")
    along = (z - 20.2) * np.cos(tilt) + (x - 35.3) * np.sin(tilt)
    across = -(z - 20.2) * np.sin(tilt) + (x - 35.3) * np.cos(tilt)
    return (np.sqrt(across**2 + (y - 11.6) ** 2) <= diameter / 2) & (np.abs(along) < 15)


@pytest.mark.parametrize("gap", [1.0, 1.6, 2.5, 5.0])
def test_the_slices_are_refined_until_no_side_is_twice_another(gap):
    steps = automatic_refinement((0.75, 0.75, gap))
    assert 0.5 <= gap / steps / 0.75 <= 2
    assert steps == 1 or gap / (steps - 1) / 0.75 > 2
    affine = refined_affine(np.diag([0.75, 0.75, gap, 1.0]), steps)
    assert affine[2, 2] == gap / steps


@pytest.mark.parametrize("density", [0.03, 0.3, 0.5])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.75, 0.75, 1.6), THICK, (0.5, 0.5, 7.5)])
def test_noise_keeps_the_sign_of_every_sample_and_the_surface_closed(density, spacing):
    mask = np.random.default_rng(1).random((9, 21, 27)) < density
    field = smooth(mask, spacing)
    assert wrong_side(field, mask) == 0
    assert np.isfinite(field.values).all()
    assert (np.abs(field.values[:: field.slice_steps]) > 1e-3).all()
    for topology in ("classic", "trilinear"):
        assert surface(field, close_border=True, topology=topology).closed


@pytest.mark.parametrize("radius", [9.0, 20.0])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.75, 0.75, 1.6), (0.9, 0.9, 2.5), THICK])
def test_a_ball_has_the_label_s_volume_and_lies_near_the_true_sphere(radius, spacing):
    mask = ball(radius, spacing)
    field = smooth(mask, spacing)
    mesh = surface(field)
    sides = np.array(spacing) / [1, 1, field.slice_steps]
    expected = mask.sum() * np.prod(spacing)
    assert mesh.closed
    assert mesh.euler == 2
    assert mesh.volume * np.prod(sides) == pytest.approx(expected, rel=5e-3)
    assert field.volume_mm3 == pytest.approx(mesh.volume * np.prod(sides), rel=1e-4)
    middle = (np.array(mask.shape[::-1]) - 1) / 2 * spacing - np.array(spacing) * 0.2
    off = np.linalg.norm(mesh.vertices * sides - middle, axis=1) - radius
    assert np.abs(off).mean() < 0.09 * max(spacing)


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("diameter", [2.0, 3.0, 4.0, 6.0])
def test_a_tube_of_two_to_six_pixels_keeps_its_volume_and_does_not_tear(diameter, tilt):
    mask = tube(diameter, tilt)
    before = marching_cubes(mask, 0.5, normals=False).components
    mesh = surface(smooth(mask))
    assert mesh.components == before == 1
    assert mesh.volume == pytest.approx(mask.sum(), rel=0.03)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 1.0, 3.0), (1.0, 1.0, 5.0)])
def test_no_component_vanishes_and_none_is_joined_to_one_it_does_not_touch(spacing):
    mask = np.zeros((9, 24, 30), bool)
    mask[2, 4, 4] = True  # a single voxel
    mask[4, 4, 4] = True  # another, two slices on
    mask[2, 4, 12] = mask[3, 4, 14] = True  # a pixel apart, in neighboring slices
    mask[2:6, 10:12, 4:6] = True  # a column
    mask[2:6, 10:12, 7:9] = True  # and one a pixel beside it
    mask[4, 16:22, 10:26] = True  # a slice thick
    mask[6, 16:22, 10:26] = True
    mesh = surface(smooth(mask, spacing))
    assert mesh.closed
    assert mesh.components == 8
    assert mesh.euler == 16


def test_a_hollow_keeps_its_cavity():
    mask = ball(10.0, (1.0, 1.0, 1.0)) & ~np.pad(ball(3.0, (1.0, 1.0, 1.0), 0), 10)
    assert surface(smooth(mask)).components == 2


@pytest.mark.parametrize("seed", range(4))
def test_components_of_sparse_labels_in_thick_slices_are_those_of_the_label(seed):
    mask = np.zeros((8, 30, 30), bool)
    random = np.random.default_rng(seed)
    taken = np.zeros_like(mask)
    parts = 0
    for _ in range(60):
        z, y, x = random.integers(1, [6, 25, 25])
        box = (slice(z, z + random.integers(1, 3)), slice(y, y + random.integers(1, 5)), slice(x, x + 3))
        around = tuple(slice(max(0, part.start - 1), part.stop + 1) for part in box)
        if not taken[around].any():
            mask[box] = taken[box] = True
            parts += 1
    field = smooth(mask, THICK)
    assert wrong_side(field, mask) == 0
    assert surface(field, close_border=True).components == parts


def test_end_slices_are_rounded_off_within_the_gap():
    mask = ball(12.0, THICK)
    field = smooth(mask, THICK)
    last = np.flatnonzero(mask.any(axis=(1, 2)))[-1]
    ends = [int((plane >= 0).sum()) for plane in field.values[last * 4 : last * 4 + 5]]
    assert ends[0] > ends[1]
    assert ends[-1] == 0
    assert sorted(ends, reverse=True) == ends


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), THICK])
def test_a_body_cut_by_the_border_stays_open_there_or_is_closed_as_asked(axis, spacing):
    mask = ball(14.0, spacing)
    mask = np.ascontiguousarray(np.take(mask, range(mask.shape[axis] // 2, mask.shape[axis]), axis))
    field = smooth(mask, spacing)
    assert field.values.shape[1:] == mask.shape[1:]
    assert wrong_side(field, mask) == 0
    opened, closed = surface(field), surface(field, close_border=True)
    assert not opened.closed
    assert closed.closed
    assert closed.euler == 2
    assert (opened.vertices[np.unique(boundary_edges(opened)), 2 - axis] == 0).all()
    assert field.volume_mm3 == pytest.approx(field.label_mm3, rel=5e-3)


@pytest.mark.parametrize("gap", [1.0, 1.6, 2.2, 3.5, 5.0])
def test_closed_ends_lie_half_a_slice_gap_outside(gap):
    mask = ball(14.0, (0.75, 0.75, gap))
    mask = mask[len(mask) // 2 - 1 :]
    field = smooth(mask, (0.75, 0.75, gap), close_border=True)
    own = field.values[field.first_slice :: field.slice_steps][: len(mask)]
    assert ((own >= 0) == mask).all()
    mesh = surface(field, close_border=True)
    assert mesh.closed
    assert mesh.euler == 2
    assert (mesh.vertices[:, 2].min() - field.first_slice) / field.slice_steps == pytest.approx(-0.5, abs=2e-3)
    assert mesh.volume / field.slice_steps == pytest.approx(mask.sum(), rel=5e-3)


@pytest.mark.parametrize("shape", [(2, 3, 3), (3, 2, 9), (3, 9, 2), (2, 2, 2), (3, 8, 16), (4, 3, 17)])
def test_tiny_volumes_have_a_field(shape):
    mask = np.zeros(shape, bool)
    mask[1, 1, 1] = True
    for spacing in ((1.0, 1.0, 1.0), THICK):
        assert wrong_side(smooth(mask, spacing), mask) == 0


def test_empty_margins_do_not_change_the_surface():
    mask = ball(7.0, (1.0, 1.0, 1.0), 8)
    wide = np.pad(mask, ((2, 5), (3, 1), (8, 16)))
    inner = smooth(wide).values[2:-5, 3:-1, 8:-16]
    alone = smooth(mask).values
    near = np.abs(alone) < 2
    assert inner[near] == pytest.approx(alone[near], abs=1e-5)


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), THICK])
def test_the_result_does_not_depend_on_the_threads(spacing):
    mask = ball(30.0, spacing)
    one, many = (smooth(mask, spacing, budget=Budget(threads=threads)) for threads in (1, 4))
    assert one.values.tobytes() == many.values.tobytes()
    assert one.constant_mm == many.constant_mm


def test_steps_move_forwards_and_closing_them_leaves_no_thread():
    import threading

    before = threading.active_count()
    fractions = []
    steps = constrained_steps(ball(12.0, THICK), THICK, budget=Budget(threads=3))
    for step in steps:
        fractions.append(step.fraction)
        if step.fraction > 0.6:
            steps.close()
    assert fractions == sorted(fractions)
    assert len(fractions) > 50
    assert threading.active_count() == before


def test_what_cannot_be_smoothed_is_refused():
    with pytest.raises(LabelError, match="no sample"):
        smooth(np.zeros((3, 4, 5), bool))
    with pytest.raises(LabelError, match="every sample"):
        smooth(np.ones((3, 4, 5), bool))
    with pytest.raises(SettingsError, match="slice_steps"):
        smooth(ball(4.0, THICK), THICK, slice_steps=9)


@pytest.mark.parametrize("every", [1, 2])
@pytest.mark.parametrize("columns", [19, 37])
def test_signed_distances_are_those_of_every_pair_of_samples(every, columns):
    random = np.random.default_rng(3)
    mask = np.zeros((6, 13, columns), bool)
    mask[1:4, 3:9, 4:-4] = random.random((3, 6, columns - 8)) < 0.8
    mask[:3, 9:, -3:] = True
    spacing, reach = (0.8, 1.1, 2.0), (8, 7, 4)
    code = packed(mask)
    near, deep = near_surface(code, reach), code != 0
    if every == 2:
        near, deep = _coarser(near), _coarser(deep)
    bricks = number_bricks(near, deep)
    found = finish(signed_distance_steps(code, bricks, spacing, reach, 50.0, None, every))
    at = np.argwhere(np.ones_like(mask)) * spacing[::-1]
    flat = mask.ravel()
    apart = np.sqrt(((at[:, None] - at[None]) ** 2).sum(axis=2))  # (n, n)
    expected = np.where(flat[:, None] != flat[None], apart, np.inf).min(axis=1).reshape(mask.shape)
    signed = np.where(mask, expected, -expected)[:, ::every, ::every]
    z, y, x = bricks.coordinates()
    seen = 0
    for brick, values in enumerate(found[: len(bricks.place)]):
        true = signed[z[brick], y[brick], 8 * x[brick] : 8 * x[brick] + 8]
        close = np.abs(true) < 5
        assert values[: len(true)][close] == pytest.approx(true[close], rel=1e-5)
        seen += int(close.sum())
    assert seen == (np.abs(signed) < 5).sum()


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), THICK])
def test_memory_is_as_predicted(spacing, monkeypatch):
    import tracemalloc

    monkeypatch.setattr(scan, "KEPT_BYTES", 1)  # allocated once and never written to
    mask = ball(40.0, spacing)
    tracemalloc.start()
    smooth(mask, spacing, budget=Budget(threads=1))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    code, near, *_ = outlined(mask, spacing)
    assert 0.4 < peak / constrained_bytes(mask, code, near, automatic_refinement(spacing)) < 1.05


@pytest.mark.parametrize("size", [0, 1, 8, 1003])
def test_bits_are_counted(size):
    code = np.random.default_rng(size).integers(0, 256, size, dtype=np.uint8)
    assert _bits(code) == int(np.unpackbits(code).sum())


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.8, 0.8, 2.5)])
@pytest.mark.parametrize("cut", [False, True])
def test_the_surface_that_was_measured_is_the_one_that_is_extracted(spacing, cut):
    mask = ball(11.0, spacing)
    mask = np.pad(mask[len(mask) // 2 :] if cut else mask, ((0, 2), (2, 3), (5, 1)))
    volume = Volume(mask.astype(np.uint8), np.diag([-spacing[0], -spacing[1], spacing[2], 1.0]), kind="label")
    settings = ReconstructionSettings(label=1)
    fields = [finish(field_steps(volume, settings, with_surface=asked)) for asked in (True, False)]
    assert [field.surface is not None for field in fields] == [not cut, False]
    taken, again = (
        [piece for piece in surface_pieces_steps(field, Budget(1), False) if isinstance(piece, Surface)]
        for field in fields
    )
    assert len(again) == 1
    for name in ("midpoints", "linear", "faces"):
        assert getattr(taken[0], name).tobytes() == getattr(again[0], name).tobytes()


@pytest.mark.parametrize(
    ("settings", "taken"),
    [
        ({}, True),
        ({"alpha": 0.4}, True),
        ({"slice_steps": 3}, True),
        ({"stride": (2, 2, 1)}, False),
        ({"topology": "trilinear"}, False),
        ({"close_border": True}, False),
        ({"region": (6, 6, 4, 24, 26, 14)}, False),
    ],
)
def test_with_any_settings_a_surface_has_the_same_vertices_with_normals_and_without(settings, taken):
    mask = np.pad(ball(8.0, (1.0, 1.0, 1.6)), 2)
    volume = Volume(mask.astype(np.uint8), np.diag([-1.0, -1.0, 1.6, 1.0]), kind="label")
    chosen = [ReconstructionSettings(label=1, normals=normals, **settings) for normals in ("mesh", "gradient")]
    assert (finish(field_steps(volume, chosen[0], with_surface=True)).surface is not None) == taken
    bare, full = (reconstruct(volume, each, Budget(1)).mesh for each in chosen)
    assert bare.vertices.tobytes() == full.vertices.tobytes()
    assert bare.faces.tobytes() == full.faces.tobytes()


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 2.5), THICK])
@pytest.mark.parametrize("seed", [35, 39])
def test_no_speck_stands_between_two_slices(seed, spacing):
    mask = np.random.default_rng(seed).random((8, 16, 18)) < 0.06
    field = smooth(mask, spacing)
    inside = field.values >= 0
    for slice_ in range(len(mask) - 1):
        gap = inside[slice_ * field.slice_steps : (slice_ + 1) * field.slice_steps + 1]
        changes = np.abs(np.diff(gap.astype(np.int8), axis=0)).sum(axis=0)
        assert (changes == (mask[slice_] != mask[slice_ + 1])).all()


@pytest.mark.parametrize("count", [0, 1, FEWEST_ROWS, FEWEST_ROWS + 1, 5 * FEWEST_ROWS, 3 * ROWS_AT_ONCE + 7])
@pytest.mark.parametrize("thread_count", [1, 2, 7])
def test_threads_share_rows_that_each_go_by_once(count, thread_count):
    seen = np.zeros(count, int)
    lengths = []

    def work(part: slice) -> None:
        seen[part] += 1
        lengths.append(part.stop - part.start)

    with threads_of(thread_count) as pool:
        over_rows(pool, work, count)
    assert (seen == 1).all()
    assert max(lengths, default=0) <= ROWS_AT_ONCE
    if count >= 2 * thread_count * FEWEST_ROWS:
        assert thread_count == 1 or len(lengths) >= 2 * thread_count


@pytest.mark.parametrize("every", [(1, 3), (1, 8), (2, 1), (2, 4)])
def test_from_grid_to_grid_a_field_is_carried_by_cubics_within_the_bounds(every):
    shape = np.array([7, 9, 3])
    finer = np.array([(shape[0] - 1) * every[1] + 1, (shape[1] - 1) * every[0] + 1, shape[2] * every[0]])
    before, after = (number_bricks(*np.ones((2, *of), bool)) for of in (shape, finer))

    def cubic(bricks: Any, along_xy: float, along_z: float) -> np.ndarray:
        z, y, x = (at[:, None].astype(float) for at in bricks.coordinates())
        x = (8 * x + np.arange(8)) / along_xy
        return 0.25 * (z / along_z - 3) ** 3 + 0.1 * (y / along_xy - 4) ** 3 - 0.01 * (x - 10) ** 3

    values = np.append(cubic(before, 1, 1), np.zeros((2, 8)), axis=0).astype(np.float32)
    field, low, high = np.repeat(np.float32([[0], [-np.inf], [5]]), len(after) * 8, axis=1).reshape(3, -1, 8)
    carried(before, values, after, Start(field, low, high), every, None)
    expected = np.minimum(cubic(after, *every), 5)
    z, y, x = after.coordinates()
    # Beyond the border samples are repeated, and what lies beside it is not on the cubic.
    inner = (z >= every[1]) & (z <= (shape[0] - 2) * every[1]) | (z % every[1] == 0)
    inner &= (y >= every[0]) & (y <= (shape[1] - 2) * every[0]) | (y % every[0] == 0)
    inner &= (x > 0) & (x < finer[2] - 1)
    np.testing.assert_allclose(field[:-2][inner], expected[inner], atol=1e-4)
    assert inner.sum() > len(inner) / 5
    assert (field[:-2] <= 5).all()


def test_every_grid_follows_from_the_one_before():
    for grids in (THIN, THICK_GRIDS):
        assert (grids[-1].every_xy, grids[-1].between) == (1, True)
        for before, after in pairwise(grids):
            assert before.every_xy in (after.every_xy, 2 * after.every_xy)
            assert before.between <= after.between
    assert [grids_of(steps) for steps in (1, 2, 3, 8)] == [THIN, THIN, THICK_GRIDS, THICK_GRIDS]


def test_a_region_that_is_clear_of_a_label_does_not_change_its_surface():
    random, budget = np.random.default_rng(5), Budget(threads=1)
    for _ in range(30):
        shape = tuple(random.integers(10, 30, 3))
        grid, mask = np.indices(shape).astype(float), np.zeros(shape, bool)
        for _ in range(random.integers(1, 4)):
            center = [random.uniform(3, size - 4) for size in shape]
            radius, scale = random.uniform(2, 8), random.uniform(0.5, 2, 3)
            mask |= sum(((grid[at] - center[at]) * scale[at]) ** 2 for at in range(3)) < radius * radius
        pixel, gap = float(random.choice([0.5, 0.75, 0.9])), float(random.choice([0.5, 0.8, 1.6, 2.5, 5]))
        mask[[0, -1]] = mask[:, [0, -1]] = mask[:, :, [0, -1]] = False
        if not mask.any():
            continue
        label = np.pad(mask, 12).astype(np.uint8)
        volume = Volume(label, np.diag([pixel, pixel, gap, 1.0]), kind="label")
        region = (4, 4, 4, *(size - 5 for size in label.shape[::-1]))
        whole, inside = (
            reconstruct(volume, ReconstructionSettings(label=1, region=box), budget).mesh for box in (None, region)
        )
        np.testing.assert_array_equal(inside.faces, whole.faces)
        np.testing.assert_allclose(inside.vertices, whole.vertices, atol=1e-4 * pixel)
