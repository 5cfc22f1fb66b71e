# SPDX-License-Identifier: GPL-3.0-or-later
"""The style illustration: translucency by looking, names beside the structures, outlines, a dark page."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.page.callouts import spread
from ctmc_addon.blender.figure.page.compose import WALL_GAP_MM, compose_steps
from ctmc_addon.blender.figure.rendering import picture as pictures
from ctmc_addon.blender.figure.rendering.illustration import OUTLINE_MM, outline_shell
from ctmc_addon.blender.figure.rendering.picture import RenderRequest
from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.rendering.samples import can_denoise
from ctmc_addon.blender.figure.shown import shown_surfaces
from ctmc_addon.blender.figure.spec import WHITE, Cell, FigureStyle, Page, ShownSurface
from ctmc_addon.blender.surface import add_reconstruction, mesh_data as meshes
from ctmc_addon.blender.surface.evaluate import evaluated_copy
from ctmc_addon.core import ReconstructionSettings, Volume, finish, reconstruct_labels


@pytest.fixture
def nested(scene, ball):
    """A tumor in a liver, and a bone behind them as seen from the front."""
    objects = [add_reconstruction(ball(), scene, structure=name) for name in ("liver", "tumor", "bone")]
    objects[1].scale = (0.4,) * 3
    objects[2].location[1] -= 0.3
    bpy.context.view_layer.update()
    return objects


def test_what_hides_a_tumor_is_translucent_from_where_the_camera_stands(nested, scene):
    def opacities(azimuth, **rest):
        style = FigureStyle(azimuth=azimuth, elevation=0.0)
        return [shown.opacity for shown in shown_surfaces(nested, scene, style, **rest)]

    assert opacities(0.0) == [0.3, 1.0, 1.0]
    assert opacities(180.0) == [0.3, 1.0, 0.3], "from behind the bone hides it too"
    assert opacities(180.0, opacities=[0.8, None, 1.0]) == [0.8, 1.0, 1.0], "a given opacity is kept"
    assert opacities(0.0, names=["a", "b", "c"]) == [0.3, 1.0, 1.0], "without a tumor what hides all others"
    assert opacities(90.0, names=["a", "b", "c"]) == [1.0, 1.0, 1.0], "the bone stands beside it"


def signed(mesh):
    """Of each triangle the volume of its tetrahedron with the middle of the ball: positive where it looks out."""
    return np.linalg.det(meshes.read_positions(mesh)[meshes.read_triangles(mesh)].astype(float))


def test_an_outline_lies_one_line_around_its_surface_and_is_seen_from_within(scene, ball):
    obj = add_reconstruction(ball(), scene)
    shell = outline_shell(obj, 0.01)
    surface, around = meshes.read_positions(obj.data), meshes.read_positions(shell)
    assert np.linalg.norm(around - surface, axis=1) == pytest.approx(0.01, rel=0.01)
    assert (np.linalg.norm(around, axis=1) > np.linalg.norm(surface, axis=1)).all(), "outside"
    turned = [np.sort(meshes.read_triangles(mesh), axis=1) for mesh in (shell, obj.data)]
    assert (turned[0] == turned[1]).all()
    assert (np.sign(signed(shell)) == -np.sign(signed(obj.data))).mean() > 0.95, "but slivers"
    assert 0.1 < OUTLINE_MM < 0.25, "a hairline in print is 0.09 mm"


def test_names_stand_beside_the_picture_with_a_line_to_each_and_none_below(nested, scene):
    surfaces = shown_surfaces(nested, scene, FigureStyle(), ["liver", "tumor_left", "bone"])
    figure = finish(compose_steps([Cell(surfaces)], Page(120.0), FigureStyle(orientation=False)))
    try:
        assert figure.layout.has_name_columns
        left, _, right, _ = figure.layout.pictures[0]
        texts = [obj for obj in figure.scene.objects if obj.type == "FONT" and obj.data.body != "20 mm"]
        names = {obj.data.body: obj.location.x / figure.unit + 60.0 for obj in texts if " mm" not in obj.data.body}
        assert set(names) == {"liver", "tumor left", "bone"}
        assert all(x < left or x > right for x in names.values())
        assert sum(obj.name.startswith("CTMC Dot") for obj in figure.scene.objects) == 6
    finally:
        figure.remove()
    figure = finish(compose_steps([Cell(surfaces)], Page(40.0), FigureStyle(orientation=False)))
    assert not figure.layout.has_name_columns, "a narrow page keeps its picture, and the names go below"
    figure.remove()


def test_names_keep_their_order_and_their_distance():
    wished = np.sort(np.random.default_rng(4).uniform(0.0, 30.0, 9))
    heights = spread(wished, 3.0, 0.0, 40.0)
    assert (np.diff(heights) >= 3.0 - 1e-9).all()
    assert heights[0] >= 0.0
    assert heights[-1] <= 40.0
    assert np.diff(spread(wished, 3.0, 0.0, 8.0)) == pytest.approx(1.0)


def test_a_dark_page_is_dark_to_the_last_pixel_and_a_white_one_white(scene, ball, tmp_path):
    thing = ShownSurface(add_reconstruction(ball(), scene), color=(0.5, 0.1, 0.1))
    page_level = {}
    for dark in (False, True):
        style = FigureStyle(orientation=False, scale_bar=False)
        finish(figure_steps([Cell((thing,))], tmp_path / "a.png", Page(20.0, 90.0, dark=dark), style))
        with Image.open(tmp_path / "a.png") as image:
            picture = np.asarray(image)
        assert (picture[:3] == picture[0, 0]).all()
        page_level[dark] = picture[0, 0].max()
        assert picture[picture.shape[0] // 2, picture.shape[1] // 2, 0] > 100
    assert page_level[False] == 255
    assert page_level[True] < 40


def test_illustrations_are_sampled_until_the_noise_is_low_and_denoised_where_the_build_can(scene, ball):
    thing = ShownSurface(add_reconstruction(ball(), scene))
    found = {}
    for style in ("illustration", "clinical"):
        figure = finish(compose_steps([Cell((thing,))], Page(30.0), FigureStyle(style)))
        cycles = figure.scene.cycles
        found[style] = cycles.use_denoising, cycles.use_adaptive_sampling
        figure.remove()
    assert found == {"illustration": (can_denoise(), True), "clinical": (False, False)}


@pytest.mark.once
@pytest.mark.skipif(not can_denoise(), reason="this Blender has no denoiser")
def test_what_is_even_has_16_samples(scene, ball, tmp_path):
    thing = ShownSurface(add_reconstruction(ball(), scene), name="")
    style = FigureStyle("illustration", scale_bar=False, orientation=False)
    figure = finish(compose_steps([Cell((thing,))], Page(30.0, 200.0), style))
    cycles = figure.scene.cycles
    cycles.use_denoising, cycles.sampling_pattern = False, "TABULATED_SOBOL"

    def rendered(name):
        (tmp_path / name).touch()
        RenderRequest(str(tmp_path / name), name, 200.0, WHITE).make(figure.scene)
        with Image.open(tmp_path / name) as image:
            return np.asarray(image).astype(int)

    try:
        chosen = rendered("chosen.png")
        cycles.use_adaptive_sampling, most = False, cycles.samples
        of_most = rendered("most.png")
        cycles.samples = 16
        of_16 = rendered("16.png")
    finally:
        figure.remove()
    noisy = (of_16 != of_most).any(axis=2)
    kept, went_on = ((chosen == other).all(axis=2)[noisy] for other in (of_16, of_most))
    assert most == 32
    assert (kept ^ went_on).all()
    assert kept.mean() > 0.2
    assert went_on.mean() > 0.1


@pytest.mark.parametrize("mirrored", [pytest.param(False, marks=pytest.mark.once), True])
def test_of_an_outline_the_renderer_gets_what_the_camera_sees(scene, ball, tmp_path, mirrored):
    obj = add_reconstruction(ball(), scene)
    obj.scale.x *= -1 if mirrored else 1
    bpy.context.view_layer.update()
    thing = ShownSurface(obj, name="", color=(0.8, 0.8, 0.8))
    style = FigureStyle("illustration", scale_bar=False, orientation=False)
    figure = finish(compose_steps([Cell((thing,))], Page(20.0, 300.0), style))
    figure.scene.cycles.use_denoising = figure.scene.cycles.use_adaptive_sampling = False

    def rendered(name):
        (tmp_path / name).touch()
        RenderRequest(str(tmp_path / name), name, 300.0, WHITE).make(figure.scene)
        with Image.open(tmp_path / name) as image:
            return image.convert("L")

    try:
        shell = figure.outlines[0][0]
        whole, before = len(shell.data.polygons), rendered("whole.png")
        figure.trim_outlines()
        after = rendered("trimmed.png")
        assert 0.4 * whole < len(shell.data.polygons) < 0.6 * whole
    finally:
        figure.remove()
    assert (np.asarray(before) < 60).sum() > 100, "an outline"
    coarse = [np.asarray(picture.reduce(8)).astype(int) for picture in (before, after)]
    assert np.abs(coarse[0] - coarse[1]).max() < 10, "but the noise of single pixels"


@pytest.mark.once
@pytest.mark.skipif(not can_denoise(), reason="this Blender has no denoiser")
def test_letters_below_the_picture_are_not_denoised(scene, ball, tmp_path, monkeypatch):
    monkeypatch.setattr(pictures, "WRITTEN_PIXELS", 1000)
    tiles = []

    def render_to(scene, path):
        cycles, render = scene.cycles, scene.render
        rows = [round(edge * render.resolution_y - 0.25) for edge in (render.border_min_y, render.border_max_y)]
        tiles.append((*rows, cycles.use_denoising, cycles.use_adaptive_sampling, cycles.samples))
        rendered(scene, path)

    rendered = pictures.render_to
    monkeypatch.setattr(pictures, "render_to", render_to)
    thing = ShownSurface(add_reconstruction(ball(), scene), name="")
    figure = finish(compose_steps([Cell((thing,))], Page(40.0, 300.0), FigureStyle()))
    try:
        written, height = figure.written_rows, figure.size[1]
        assert 40 < written == int(figure.layout.pictures[0][1] / 25.4 * 300)
        path = tmp_path / "a.png"
        path.touch()
        RenderRequest(str(path), path.name, 300.0, WHITE, written).make(figure.scene)
        assert tiles == [(0, written + 24, False, False, 16), (written - 24, height, True, True, 32)]
        assert figure.scene.cycles.use_denoising, "a turntable goes on with the scene"
    finally:
        figure.remove()
    with Image.open(path) as image:
        levels = np.asarray(image)
    assert (levels[-written:].min(axis=2) < 60).sum() > 300, "scale bar, its length and the axes"
    assert (levels[-written + 2 : -written + 8] == 255).all()


def test_walls_that_two_labels_share_are_parted_by_less_than_is_seen(scene):
    values = np.zeros((8, 8, 16), np.uint8)
    values[2:6, 2:6, 2:8], values[2:6, 2:6, 8:14] = 1, 2
    volume = Volume(values, np.eye(4), kind="label", label_names={1: "left", 2: "right"})
    results = reconstruct_labels(volume, ReconstructionSettings()).surfaces
    objects = [add_reconstruction(result, scene) for result in results]
    figure = finish(
        compose_steps([Cell(tuple(ShownSurface(obj) for obj in objects))], Page(40.0), FigureStyle("clinical"))
    )
    try:
        walls = []
        for copy, obj in zip(figure.copies[0], objects, strict=True):
            moved = np.linalg.norm(
                meshes.read_positions(copy.data) - meshes.read_positions(evaluated_copy(obj)[0]), axis=1
            )
            walls.append(float(moved.max()))
            assert 0 < (moved > 1e-6).mean() < 0.6, "only the wall"
        assert walls == pytest.approx([WALL_GAP_MM * 0.01] * 2, rel=0.02)
    finally:
        figure.remove()
