# SPDX-License-Identifier: GPL-3.0-or-later
"""Distances, angles, slices and cut surfaces in figures."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.page.compose import compose_steps
from ctmc_addon.blender.figure.page.ruler_marks import WIDTH_MM, arc, value_position
from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, FigureStyle, Page, RulerMark, ShownSurface
from ctmc_addon.blender.slices import add_slice, cut_at_slice
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.volume import slice_at

SCALE = 0.01
FRONT = FigureStyle(style="clinical", azimuth=0.0, elevation=0.0, orientation=False, scale_bar=False)


@pytest.fixture
def volume():
    """HU fall from 300 by the distance from the middle; 200 at 10 mm."""
    affine = np.eye(4)
    affine[:3, 3] = -15
    return Volume((300 - 10 * distance_mm((31, 31, 31))).astype(np.int16), affine, name="ball", kind="HU")


@pytest.fixture
def surface(scene, volume):
    return add_reconstruction(reconstruct(volume, ReconstructionSettings(threshold=200)), scene, SCALE)


def picture_of(cell, path, page=Page(30.0, 100.0), style=FRONT):  # noqa: B008  (frozen)
    finish(figure_steps([cell], path, page, style))
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.float64) / 255


def test_a_distance_is_drawn_at_its_places_with_its_value(scene, surface):
    mark = RulerMark(((-0.1, 0.0, 0.0), (0.1, 0.0, 0.0)), "20.0 mm")
    figure = finish(compose_steps([Cell((ShownSurface(surface),), rulers=(mark,))], Page(60.0, 72.0), FRONT))
    figure.scene.view_layers[0].update()
    eye = figure.scene.camera.matrix_world.inverted()
    drawn = [obj for obj in figure.scene.objects if obj.name.startswith("CTMC Ruler")]
    letters = [obj for obj in drawn if obj.type == "FONT"]
    assert [obj.data.body for obj in letters] == ["20.0 mm"] * 2  # with its border
    line = drawn[1]
    corners = np.array([eye @ (line.matrix_world @ vertex.co) for vertex in line.data.vertices])
    assert np.ptp(corners[:, 0]) == pytest.approx(0.2 + WIDTH_MM * figure.unit, rel=1e-3)
    assert np.ptp(corners[:, 1]) == pytest.approx(WIDTH_MM * figure.unit, rel=1e-3)
    box = [eye @ (letters[1].matrix_world @ corner_of(corner)) for corner in letters[1].bound_box]
    assert min(corner[1] for corner in box) > corners[:, 1].max(), "the value does not stand on the line"
    nearest = max((eye @ (surface.matrix_world @ vertex.co))[2] for vertex in surface.data.vertices)
    assert corners[:, 2].min() > nearest, "and both stand before the surface"
    figure.remove()


def corner_of(corner):
    from mathutils import Vector

    return Vector(corner)


def test_an_angle_is_drawn_as_an_arc_the_shorter_way_round():
    drawn = arc(np.array([[10.0, 0.0], [0.0, 0.0], [0.0, 10.0]]))
    assert np.allclose(np.hypot(*drawn.T), 3.5)
    assert drawn.min() > -1e-9
    x, y = value_position(np.array([[30.0, 20.0], [20.0, 20.0], [20.0, 30.0]]), 6.0, 2.0, (60.0, 60.0))
    assert x < 17.5
    assert y + 2.0 < 19.0, "the box of the letters is clear of both sides"


def test_a_value_stays_on_the_page_and_off_its_line():
    upright = np.array([[3.0, 10.0], [3.0, 40.0]])
    x, _ = value_position(upright, 10.0, 2.0, (60.0, 60.0))
    assert x == pytest.approx(3.0 + 5.0 + 1.2)
    x, _ = value_position(np.add(upright, (30.0, 0.0)), 10.0, 2.0, (60.0, 60.0))
    assert abs(x - 33.0) == pytest.approx(5.0 + 1.2)


def test_a_ruler_is_seen_on_any_ground(surface, tmp_path):
    bare = picture_of(Cell((ShownSurface(surface),)), tmp_path / "a.png")
    mark = RulerMark(((-0.05, 0.0, 0.0), (0.05, 0.0, 0.0)), "10.0 mm")
    ruled = picture_of(Cell((ShownSurface(surface),), rulers=(mark,)), tmp_path / "b.png")
    changed = np.abs(ruled - bare).max(axis=2) > 0.15
    assert 0.005 < changed.mean() < 0.2
    assert ruled[changed].min() < 0.35
    assert ruled[changed].max() > 0.98


def test_a_slice_is_seen_with_its_gray_values_and_nothing_of_it_is_left(scene, volume, surface, tmp_path):
    plane = add_slice(scene, volume, slice_at(volume, "coronal", 0.5), "coronal", 400, 100, SCALE)
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "materials", "meshes", "images")}
    picture = picture_of(Cell((ShownSurface(surface),), slices=(plane,)), tmp_path / "a.png", Page(40.0, 100.0))
    assert {name: len(getattr(bpy.data, name)) for name in before} == before
    rows, columns, _ = picture.shape
    corner = picture[rows // 2, round(0.08 * columns)]
    # 14 mm from the middle are 160 HU, of a window from -100 to 300.
    assert np.ptp(corner) < 0.01
    assert corner[0] == pytest.approx(260 / 400, abs=0.02)


def test_the_cap_of_a_cut_surface_shows_the_ct(scene, volume, surface, tmp_path):
    plane = add_slice(scene, volume, slice_at(volume, "coronal", 0.5), "coronal", 200, 200, SCALE)
    cut_at_slice(scene, [surface], plane)
    for slices in ((), (plane,)):
        cell = Cell((ShownSurface(surface, color=(0.8, 0.1, 0.1)),), slices=slices)
        picture = picture_of(cell, tmp_path / "a.png", Page(40.0, 100.0))
        rows, columns, _ = picture.shape
        middle = picture[rows // 2 - 4 : rows // 2 + 4, columns // 2 - 4 : columns // 2 + 4]
        assert np.ptp(middle.mean(axis=(0, 1))) < 0.02, "gray, not red"
        assert middle.mean() > 0.95, "300 HU are white"
