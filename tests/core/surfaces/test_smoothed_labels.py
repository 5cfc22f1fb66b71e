# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels through the whole of core, smoothed as constrained: samples, volumes, borders, strides, regions."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import Budget, LabelError, ReconstructionSettings, SettingsError, Volume, reconstruct
from ctmc_addon.core.volume.affine import to_index

THICK = np.diag([0.75, 0.75, 5.0, 1.0])


def ellipsoid(shape: tuple[int, int, int], radii: tuple[float, float, float], shift: float = 0.2) -> np.ndarray:
    z, y, x = ((np.arange(n) - (n - 1) / 2 + shift) / radius for n, radius in zip(shape, radii, strict=True))
    return z[:, None, None] ** 2 + y[:, None] ** 2 + x**2 <= 1


def oblique(spacing: tuple[float, float, float]) -> np.ndarray:
    a, b = 0.3, 0.2
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    affine = np.eye(4)
    affine[:3, :3] = about_z @ about_x @ np.diag(spacing) @ np.diag([-1, 1, 1])  # mirrored, too
    affine[:3, 3] = 12.0, -7.0, 100.0
    return affine


def made(mask: np.ndarray, affine: np.ndarray = THICK, **settings: object):
    values = np.where(mask, 2, 0).astype(np.uint8)
    return reconstruct(Volume(values, affine, kind="label"), ReconstructionSettings(label=2, **settings))


def inside(mesh, affine: np.ndarray, shape: tuple[int, int, int]) -> np.ndarray:
    """Which samples of a grid the triangles enclose: rays along x count the crossings before every sample."""
    corners = to_index(affine, mesh.vertices.astype(np.float64))[mesh.faces]  # (f, 3, 3)
    enclosed = np.zeros(shape, bool)
    # A ten-thousandth aside, so that no ray runs through a vertex, and none passes a sample whose surface is near.
    for z in range(shape[0]):
        for y in range(shape[1]):
            at = np.array([y + 1.13e-4, z + 2.71e-4])
            ends = corners[:, :, 1:] - at  # (f, 3, 2)
            following = np.roll(ends, -1, axis=1)
            turns = ends[..., 0] * following[..., 1] - ends[..., 1] * following[..., 0]  # (f, 3), opposite the corners
            hit = (turns > 0).all(axis=1) | (turns < 0).all(axis=1)
            weights = np.roll(turns[hit], -1, axis=1) / turns[hit].sum(axis=1, keepdims=True)
            crossings = (corners[hit, :, 0] * weights).sum(axis=1)
            enclosed[z, y] = (crossings[:, None] < np.arange(shape[2])).sum(axis=0) % 2 == 1
    return enclosed


@pytest.mark.parametrize("alpha", [0.0, 1.0])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (0.75, 0.75, 5.0)])
def test_every_sample_is_on_its_side_of_the_triangles(spacing, alpha):
    random = np.random.default_rng(5)
    mask = ellipsoid((8, 20, 22), (2.6, 7.0, 8.0))
    mask[1:-1, 1:-1, 1:-1] ^= random.random((6, 18, 20)) < 0.04
    affine = oblique(spacing)
    result = made(mask, affine, alpha=alpha)
    assert result.mesh.closed
    assert result.report()["wrong_side"] == 0
    assert (inside(result.mesh, affine, mask.shape) == mask).all()


@pytest.mark.parametrize("affine", [THICK, oblique((0.75, 0.75, 5.0)), oblique((0.9, 0.9, 2.5)), np.eye(4)])
def test_the_volume_is_that_of_the_samples_wherever_the_grid_lies(affine):
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    radii = tuple(18 / spacing[::-1])
    mask = ellipsoid(tuple(2 * int(radius) + 7 for radius in radii), radii)
    result = made(mask, affine)
    assert result.settings.smoothing_method == "constrained"  # by default
    assert result.mesh.closed
    assert result.mesh.euler == 2
    assert result.mesh.volume == pytest.approx(mask.sum() * np.prod(spacing), rel=5e-3)
    center = affine[:3, :3] @ ((np.array(mask.shape[::-1]) - 1) / 2 - 0.2) + affine[:3, 3]
    off = np.linalg.norm(result.mesh.vertices - center, axis=1) - 18
    assert np.abs(off).mean() < 0.16
    outwards = (result.mesh.vertices - center) / np.linalg.norm(result.mesh.vertices - center, axis=1)[:, None]
    assert (outwards * result.mesh.normals).sum(axis=1).mean() > 0.998


def test_what_the_report_says():
    mask = ellipsoid((13, 60, 60), (3.6, 24, 24))
    report = made(mask).report()
    assert (report["smoothing"], report["slice_steps"], report["wrong_side"]) == ("constrained", 4, 0)
    assert report["voxels_visited"] == 59 * 59 * 12 * 4
    assert any("4 steps" in note for note in report["notes"])
    bare, threshold = (
        reconstruct(Volume(mask.astype(np.uint8), THICK), settings).report()
        for settings in (ReconstructionSettings(label=1, smoothing="none"), ReconstructionSettings(threshold=0.5))
    )
    assert (bare["smoothing"], bare["slice_steps"], bare["wrong_side"]) == ("none", 1, 0)
    assert (threshold["smoothing"], threshold["wrong_side"]) == ("none", None)
    speck = np.zeros((9, 9, 9), bool)
    speck[4, 4, 4] = speck[2:7, 2:7, 1] = True
    assert made(speck, np.eye(4), smoothing_mm=0.5).report()["wrong_side"] > 0
    assert made(speck, np.eye(4)).report()["wrong_side"] == 0


def test_stride_along_z_counts_steps_and_wide_strides_need_none():
    mask = ellipsoid((13, 60, 60), (3.6, 24, 24))
    heights = {}
    for stride, steps in (((2, 2, 1), 0), ((1, 1, 2), 0), ((1, 1, 2), 4), ((1, 1, 1), 7), ((3, 3, 1), 1)):
        result = made(mask, stride=stride, slice_steps=steps)
        assert result.mesh.closed
        assert result.wrong_side == 0
        heights[stride, steps] = (result.slice_steps, result.voxels_visited)
        assert result.mesh.volume == pytest.approx(mask.sum() * 0.75 * 0.75 * 5, rel=0.06)
    assert heights == {
        ((2, 2, 1), 0): (4, 30 * 30 * 48),
        ((1, 1, 2), 0): (1, 59 * 59 * 6),
        ((1, 1, 2), 4): (4, 59 * 59 * 24),
        ((1, 1, 1), 7): (7, 59 * 59 * 84),
        ((3, 3, 1), 1): (1, 20 * 20 * 12),
    }


@pytest.mark.parametrize("close_border", [False, True])
@pytest.mark.parametrize("end", [0, 1])
def test_a_label_cut_by_the_volume_is_open_or_closed_half_a_gap_outside(close_border, end):
    mask = ellipsoid((13, 60, 60), (5.0, 24, 24))
    mask = mask[6:] if end == 0 else mask[:7]
    result = made(mask, close_border=close_border)
    assert result.mesh.closed == close_border
    z = result.mesh.vertices[:, 2]
    outermost = z.min() if end == 0 else z.max()
    outside = 2.5 if close_border else 0.0
    assert outermost == pytest.approx(-outside if end == 0 else 30 + outside, abs=0.01)
    if close_border:
        assert result.mesh.volume == pytest.approx(mask.sum() * 0.75 * 0.75 * 5, rel=5e-3)


def test_a_region_cuts_the_surface_of_the_whole_label():
    mask = ellipsoid((13, 60, 60), (4.6, 24, 24))
    whole = made(mask).mesh.vertices
    part = made(mask, region=(5, 5, 3, 30, 54, 9))
    assert part.wrong_side == 0
    assert not part.mesh.closed
    low, high = part.mesh.vertices.min(axis=0), part.mesh.vertices.max(axis=0)
    assert high == pytest.approx([30 * 0.75, low[1] + high[1] - low[1], 45.0], abs=0.01)
    assert low[2] == pytest.approx(15.0, abs=0.01)
    near = whole[(whole >= low).all(axis=1) & (whole <= high).all(axis=1)]
    nearest = [np.linalg.norm(near - vertex, axis=1).min() for vertex in part.mesh.vertices[::97]]
    assert np.mean(nearest) < 0.08
    closed = made(mask, region=(5, 5, 3, 30, 54, 9), close_border=True).mesh
    assert closed.closed
    box = made(np.ones((5, 8, 8), bool), region=(2, 2, 1, 5, 5, 3), close_border=True).mesh  # nothing to smooth
    assert box.closed


def test_thin_tubes_in_thick_slices_stay_in_one_piece():
    z, y, x = np.indices((12, 30, 40)).astype(float)
    for wide in (2.0, 3.0):
        mask = (y - 14.3) ** 2 + (x - 8.2 - 2.1 * z) ** 2 <= (wide / 2) ** 2 * 2
        mask[[0, -1]] = False
        result = made(mask, np.diag([0.8, 0.8, 1.6, 1.0]))
        bare = made(mask, np.diag([0.8, 0.8, 1.6, 1.0]), smoothing="none")
        assert result.mesh.components == bare.mesh.components
        assert result.mesh.volume == pytest.approx(mask.sum() * 0.8 * 0.8 * 1.6, rel=0.03)


def test_the_same_bytes_for_any_number_of_threads():
    mask = ellipsoid((13, 80, 80), (4.6, 34, 34))
    volume = Volume(mask.astype(np.uint8), THICK)
    settings = ReconstructionSettings(label=1)
    one, three = (reconstruct(volume, settings, Budget(threads=threads)).mesh for threads in (1, 3))
    assert one.vertices.tobytes() == three.vertices.tobytes()
    assert one.faces.tobytes() == three.faces.tobytes()


def test_constrained_is_for_labels():
    with pytest.raises(SettingsError, match="gaussian"):
        ReconstructionSettings(threshold=100, smoothing="constrained")
    with pytest.raises(SettingsError, match="gaussian"):
        reconstruct(Volume(np.eye(4)[None].repeat(3, 0), THICK), ReconstructionSettings(smoothing="constrained"))
    with pytest.raises(LabelError):
        made(np.zeros((4, 5, 6), bool))


@pytest.mark.parametrize("smoothing", ["none", "gaussian", "constrained"])
def test_a_label_that_fills_the_volume_or_region_needs_a_closed_border(smoothing):
    full = np.ones((5, 8, 8), bool)
    with pytest.raises(LabelError, match=r"volume is label 2; use close_border$"):
        made(full, smoothing=smoothing)
    with pytest.raises(LabelError, match="region is label 2; use close_border or a larger region"):
        made(full, smoothing=smoothing, region=(2, 2, 1, 5, 5, 3))
    part = np.pad(full, 30)
    if smoothing != "gaussian":
        with pytest.raises(LabelError, match="region is label 2"):
            made(part, smoothing=smoothing, region=(32, 32, 31, 35, 35, 33))
    assert made(part, smoothing=smoothing, region=(32, 32, 31, 35, 35, 33), close_border=True).mesh.closed


def test_the_volumes_in_a_note_are_left_out_where_a_region_cuts_the_label():
    mask = ellipsoid((13, 60, 60), (3.6, 24, 24))
    voxels = mask.sum() * 0.75 * 0.75 * 5
    for region in (None, (0, 0, 0, 59, 59, 12), (4, 4, 1, 55, 55, 11)):
        assert f"voxels {voxels / 1000:.5g} ml" in made(mask, region=region).notes[0]
        assert f"voxels {voxels / 1000:.5g} ml" in made(mask, region=region, alpha=0.5).notes[0]
    for region in ((0, 0, 0, 59, 30, 12), (0, 0, 6, 59, 59, 12)):
        assert "voxels" not in made(mask, region=region).notes[0]


def test_slices_that_a_wide_stride_leaves_unrefined_are_noted():
    mask = ellipsoid((13, 60, 60), (3.6, 24, 24))
    notes = {stride: made(mask, stride=(1, 1, stride)).notes for stride in (1, 2)}
    assert (len(notes[1]), len(notes[2])) == (1, 2)
    assert "stride of 2" in notes[2][1]
    assert len(made(mask, stride=(1, 1, 2), slice_steps=4).notes) == 1
    assert len(made(mask, np.eye(4), stride=(1, 1, 2)).notes) == 1


@pytest.mark.parametrize(("stride", "steps"), [(14, 8), (12, 4), (7, 4), (6, 2)])
def test_stride_along_z_may_be_wider_than_the_slices(stride, steps):
    mask = ellipsoid((9, 40, 40), (2.6, 14, 14))
    whole = made(mask, stride=(1, 1, stride), slice_steps=steps, close_border=True)
    assert whole.mesh.closed
    every = np.pad(mask, ((0, 0), (30, 30), (30, 30)))  # another box, the same slices
    assert len(made(every, stride=(1, 1, stride), slice_steps=steps).mesh.faces) == len(whole.mesh.faces)
    with pytest.raises(SettingsError, match="from 1 to 8"):
        made(mask, stride=(1, 1, 9), slice_steps=1)


@pytest.mark.once
def test_memory_for_the_closed_ends_and_the_measured_surface_is_asked_for(monkeypatch):
    import tracemalloc

    from ctmc_addon.core import finish
    from ctmc_addon.core.extraction import scan
    from ctmc_addon.core.smoothing.constrained import constrained_bytes, outlined
    from ctmc_addon.core.smoothing.prepare import field_steps

    monkeypatch.setattr(scan, "KEPT_BYTES", 1)  # allocated once and never written to
    box = np.zeros((12, 80, 80), bool)
    box[2:10, 30:50, 30:50] = box[0, 0, 0] = box[-1, -1, -1] = True
    noise = np.random.default_rng(3).random((12, 40, 40)) < 0.3
    for mask in (box, noise):
        volume = Volume(mask.astype(np.uint8), np.diag([0.7, 0.7, 5.0, 1.0]), kind="label")
        settings = ReconstructionSettings(label=1, close_border=True, slice_steps=8)
        tracemalloc.start()
        field = finish(field_steps(volume, settings, Budget(threads=1)))
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert field.slice_steps == 8
        code, near, *_ = outlined(mask, volume.spacing)
        assert 0.4 < peak / constrained_bytes(mask, code, near, 8, True) < 1.05
