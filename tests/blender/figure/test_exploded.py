# SPDX-License-Identifier: GPL-3.0-or-later
"""Exploded figures: what moves, by how much, and that nothing of the file does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.exploded import moved_apart
from ctmc_addon.blender.figure.page.compose import compose_steps
from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.shared_walls import world_positions
from ctmc_addon.blender.figure.shown import shown_surfaces
from ctmc_addon.blender.figure.spec import Cell, FigureStyle, Page, Turn
from ctmc_addon.blender.figure.turntable import turntable_steps
from ctmc_addon.blender.slices import add_slice, cut_at_slice
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import OutputError, ReconstructionSettings, Volume, finish, reconstruct, reconstruct_labels
from ctmc_addon.core.volume import slice_at

SCALE = 0.01
FRONT = FigureStyle(style="clinical", azimuth=0.0, elevation=0.0, orientation=False, caption="")


@pytest.fixture
def halves(scene):
    """A block of 20 x 20 x 20 mm that two labels share: 1 on the patient's left, 2 on the right."""
    values = np.zeros((24, 24, 24), np.uint8)
    values[2:22, 2:22, 2:12], values[2:22, 2:22, 12:22] = 1, 2
    affine = np.eye(4)
    affine[:3, 3] = (100.0, -50.0, 300.0)
    volume = Volume(values, affine, kind="label")
    results = reconstruct_labels(volume, ReconstructionSettings(smoothing="none")).surfaces
    return [add_reconstruction(result, scene, SCALE) for result in results]


def places(objects):
    bpy.context.view_layer.update()
    return [tuple(value for row in obj.matrix_world for value in row) for obj in objects]


def boxes_of(figure):
    """Lowest and highest x of each copy, mm."""
    figure.scene.view_layers[0].update()
    return [
        (points[:, 0].min() / SCALE, points[:, 0].max() / SCALE) for points in map(world_positions, figure.copies[0])
    ]


def test_copies_are_moved_and_objects_are_not(halves, scene):
    before = places(halves)
    shown = shown_surfaces(halves, scene, FRONT, explode=15.0)
    assert [surface.shift for surface in shown] == [pytest.approx((sign * 0.15, 0, 0), abs=1e-6) for sign in (-1, 1)]
    whole, apart = (
        finish(compose_steps([Cell(shown_surfaces(halves, scene, FRONT, explode=mm))], Page(), FRONT, scene))
        for mm in (0.0, 15.0)
    )
    assert boxes_of(whole) == [pytest.approx(ends, abs=0.05) for ends in ((101.5, 111.5), (111.5, 121.5))]
    assert boxes_of(apart) == [pytest.approx(ends, abs=0.05) for ends in ((86.5, 96.5), (126.5, 136.5))]
    assert places(halves) == before


def test_one_surface_stays(halves, scene):
    assert shown_surfaces(halves[:1], scene, FRONT, explode=15.0)[0].shift == (0.0, 0.0, 0.0)


def test_the_scale_of_the_page_holds_for_the_gap(halves, scene, tmp_path):
    page = Page(60.0, 100.0)
    cell = Cell(shown_surfaces(halves, scene, FRONT, explode=15.0))
    figure = finish(compose_steps([cell], page, FRONT, scene))
    pixel_mm = figure.unit / page.pixels_per_mm / SCALE
    finish(figure_steps([cell], tmp_path / "a.png", page, FRONT, scene=scene))
    with Image.open(tmp_path / "a.png") as image:
        picture = np.asarray(image.convert("RGB"), np.float64) / 255
    colored = np.ptp(picture, axis=2) > 0.2
    columns = np.flatnonzero(colored.any(axis=0))
    gap = np.diff(columns).max() - 1
    assert gap * pixel_mm == pytest.approx(30.0, abs=2 * pixel_mm)
    assert (columns[-1] - columns[0] + 1) * pixel_mm == pytest.approx(50.0, abs=2 * pixel_mm)


def test_a_wall_that_two_labels_share_is_seen_on_both_sides(halves, scene):
    # Beside each other, a transparent surface loses the wall that lies on an opaque one; apart it keeps it.
    def faces(mm):
        shown = shown_surfaces(halves, scene, FRONT, opacities=[0.5, 1.0], explode=mm)
        figure = finish(compose_steps([Cell(shown)], Page(), FRONT, scene))
        return len(figure.copies[0][0].data.polygons)

    assert faces(15.0) == len(halves[0].data.polygons)
    assert faces(0.0) < len(halves[0].data.polygons)


def test_objects_of_a_blend_are_moved_by_their_delta_locations(halves, scene):
    before, locations = places(halves), [tuple(obj.location) for obj in halves]
    with moved_apart(halves, scene, 15.0):
        for obj, x in zip(halves, (-0.15, 0.15), strict=True):
            assert tuple(obj.delta_location) == pytest.approx((x, 0.0, 0.0), abs=1e-6)
        assert [tuple(obj.location) for obj in halves] == locations
    assert places(halves) == before


def test_a_users_own_delta_location_is_kept(halves, scene):
    for obj in halves:
        obj.delta_location = (0.0, 0.0, 0.5)
    with moved_apart(halves, scene, 15.0):
        assert tuple(halves[0].delta_location) == pytest.approx((-0.15, 0.0, 0.5), abs=1e-6)
    assert [tuple(obj.delta_location) for obj in halves] == [(0.0, 0.0, 0.5)] * 2


def test_the_cap_of_a_cut_surface_keeps_its_picture(scene, tmp_path):
    """Two balls, 300 HU in their middles and 200 HU at their surfaces, cut through the middles."""
    x, y, z = np.meshgrid(np.arange(81) - 40, np.arange(31) - 15, np.arange(31) - 15, indexing="ij")
    near = np.minimum(np.abs(x - 20), np.abs(x + 20))
    values = (300 - 10 * np.sqrt(near * near + y * y + z * z)).transpose(2, 1, 0).astype(np.int16)
    affine = np.eye(4)
    affine[:3, 3] = (-40, -15, -15)
    volume = Volume(values, affine, name="balls", kind="HU")
    objects = []
    for region in ((0, 0, 0, 40, 30, 30), (41, 0, 0, 80, 30, 30)):
        result = reconstruct(volume, ReconstructionSettings(threshold=200, region=region))
        objects.append(add_reconstruction(result, scene, SCALE))
    plane = add_slice(scene, volume, slice_at(volume, "coronal", 0.5), "coronal", 150, 225, SCALE)
    cut_at_slice(scene, objects, plane)
    page, style = Page(80.0, 100.0), replace(FRONT, scale_bar=False)
    cell = Cell(shown_surfaces(objects, scene, style, explode=30.0))
    figure = finish(compose_steps([cell], page, style, scene))
    assert [sum(ends) / 2 for ends in boxes_of(figure)] == [pytest.approx(x, abs=0.5) for x in (-50, 50)]
    mm = SCALE * page.pixels_per_mm / figure.unit
    finish(figure_steps([cell], tmp_path / "a.png", page, style, scene=scene))
    with Image.open(tmp_path / "a.png") as image:
        picture = np.asarray(image.convert("L"), np.float64) / 255
    rows, columns = picture.shape

    def seen(x, z):
        row, column = round(rows / 2 - z * mm), round(columns / 2 + x * mm)
        return picture[row - 1 : row + 2, column - 1 : column + 2].mean()

    for middle in (-50, 50):
        assert seen(middle, 0) > 0.95, "300 HU are white"
        rim = [seen(middle + x, z) for x, z in ((-8, 0), (8, 0), (0, -8), (0, 8))]
        assert rim == pytest.approx([rim[0]] * 4, abs=0.06), "220 HU all round"
        assert rim[0] == pytest.approx(70 / 150, abs=0.08)


def test_frames_of_another_view_are_not_continued(halves, scene, tmp_path):
    page, turn = Page(30.0, 40.0, 30.0), Turn(seconds=1.0, fps=3)

    def turntable(mm):
        cell = Cell(shown_surfaces(halves, scene, FRONT, explode=mm))
        return finish(turntable_steps(cell, tmp_path / "t", page, FRONT, turn, scene=scene, resume=True))

    assert turntable(10.0)[1] == 3
    assert turntable(10.0)[1] == 0
    with pytest.raises(OutputError, match="another turntable"):
        turntable(20.0)
