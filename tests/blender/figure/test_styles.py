# SPDX-License-Identifier: GPL-3.0-or-later
"""How surfaces look: no white spots, soft shadows, edges by the size of their triangles, clean transparency."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, FigureStyle, Page, ShownSurface
from ctmc_addon.blender.figure.styles import SHARES, edge_widths, mean_edges
from ctmc_addon.blender.surface import add_reconstruction, mesh_data as meshes
from ctmc_addon.core import finish

BARE = {"scale_bar": False, "orientation": False}


def picture_of(surfaces, path, page, **style):
    """(rows, columns, 4) float, 0 to 1, without a background."""
    finish(figure_steps([Cell(tuple(surfaces))], path, page, FigureStyle(**BARE, **style)))
    with Image.open(path) as image:
        return np.asarray(image.convert("RGBA"), np.float64) / 255


def test_a_white_surface_has_no_white_spots(scene, ball, tmp_path):
    page = Page(30.0, 100.0, transparent=True)
    white = ShownSurface(add_reconstruction(ball(), scene), color=(0.9, 0.9, 0.9))
    for azimuth in (30, 200):
        picture = picture_of([white], tmp_path / "a.png", page, style="clinical", azimuth=azimuth)
        shown = picture[picture[..., 3] == 1][:, :3]
        assert len(shown) > 2000
        assert (shown == 1.0).any(axis=1).mean() == 0.0
        assert shown.max() > 0.85, "and is not dull"
        assert shown.min() > 0.3, "what the sun does not reach keeps its form"


def test_the_edge_of_a_shadow_is_soft(scene, ball, tmp_path):
    ground, caster = (add_reconstruction(ball(), scene) for _ in range(2))
    caster.scale = (0.3,) * 3
    from ctmc_addon.blender.scene.studio import SUNS, sun_axes

    caster.location = (sun_axes(SUNS["CTMC Light"], 30, 20)[:, 2] * 0.16).tolist()
    bpy.context.view_layer.update()
    surfaces = [ShownSurface(obj, color=(0.7, 0.7, 0.7)) for obj in (ground, caster)]
    page = Page(40.0, 150.0, transparent=True)
    picture = picture_of(surfaces, tmp_path / "a.png", page, style="clinical", samples=64)
    rows, columns = picture.shape[:2]
    about = np.s_[int(0.32 * rows) : int(0.47 * rows), int(0.4 * columns) : int(0.78 * columns)]
    light = picture[..., 0][about]
    assert (picture[..., 3][about] == 1).all()
    assert np.ptp(light) > 0.15, "there is a shadow"
    assert np.abs(np.diff(light, axis=1)).max() < 0.35 * np.ptp(light)


def test_dense_triangles_keep_their_red_and_coarse_ones_their_yellow(scene, torus, tmp_path):
    found = {}
    for rings in (240, 20):
        thing = ShownSurface(add_reconstruction(torus(rings=rings, sides=rings // 2), scene))
        picture = picture_of([thing], tmp_path / "a.png", Page(25.0, 200.0, transparent=True), style="paper")
        red, green, _ = np.moveaxis(picture[picture[..., 3] == 1][:, :3], 1, 0)
        found[rings] = green.mean() / red.mean(), (green > 0.7 * red).mean()
    assert found[240][0] < 0.5
    assert found[20][0] < 0.6
    assert found[20][1] > 0.05


def test_lines_are_as_wide_as_their_triangle_allows(scene, torus):
    thing = add_reconstruction(torus(rings=16, sides=8), scene)
    fine, coarse = edge_widths(thing, 100.0, 1e-6), edge_widths(thing, 1e-3, 1e-6)
    assert fine.shape == (len(thing.data.polygons),)
    assert np.ptp(fine) > 0
    assert np.allclose(coarse, 0.12e-3)
    assert (fine < SHARES[1] * 1.0).all()


def test_edges_shorter_than_three_pixels_on_the_page_are_not_drawn(scene, torus):
    thing = add_reconstruction(torus(rings=16, sides=8), scene)
    edges = mean_edges(meshes.read_positions(thing.data), meshes.read_triangles(thing.data))
    pixel = float(np.median(edges)) / 3.0
    drawn = edge_widths(thing, 0.01, pixel) > 0
    assert (drawn == (edges >= 3.0 * pixel)).all()
    assert 0.2 < drawn.mean() < 0.8
    assert not edge_widths(thing, 0.01, float(edges.max()) / 2.9).any()


def test_many_transparent_layers_are_neither_black_nor_noise(scene, ball, tmp_path):
    surfaces = []
    for at in range(12):
        obj = add_reconstruction(ball(stride=(2, 2, 2)), scene)
        obj.scale = (1.0 - 0.04 * at,) * 3
        surfaces.append(ShownSurface(obj, color=(0.1, 0.4, 0.8), opacity=0.1))
    bpy.context.view_layer.update()
    picture = picture_of(surfaces, tmp_path / "a.png", Page(30.0, 80.0), style="clinical", samples=4)
    rows, columns = picture.shape[:2]
    assert picture[..., :3].min() > 0.05, "a ray that passes 24 surfaces comes to an end"
    again = picture_of(surfaces, tmp_path / "b.png", Page(30.0, 80.0), style="clinical", samples=9)
    middle = np.s_[rows // 2 - 10 : rows // 2 + 10, columns // 2 - 10 : columns // 2 + 10, :3]
    assert np.abs(picture[middle] - again[middle]).max() < 0.03, "no chance is in it"


def test_only_the_first_of_the_walls_behind_each_other_is_seen(scene, torus, tmp_path):
    # Seen from its edge a torus has two walls before the hole and two behind it.
    thing = ShownSurface(add_reconstruction(torus(), scene), color=(0.0, 0.2, 0.8), opacity=0.3)
    page = Page(30.0, 100.0)
    picture = picture_of([thing], tmp_path / "a.png", page, style="clinical", azimuth=0, elevation=0)
    rows, columns = picture.shape[:2]
    middle = picture[rows // 2, columns // 2, 0]
    one_layer = (0.7 + 0.3 * 0.0) ** (1 / 2.2)
    assert middle == pytest.approx(one_layer, abs=0.02)
