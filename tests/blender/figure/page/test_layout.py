# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures on a page: their size in millimeters, what is written on them, and what is left of them in the file."""

from __future__ import annotations

import struct

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.page.annotations import round_length
from ctmc_addon.blender.figure.page.compose import compose_steps
from ctmc_addon.blender.figure.rendering import picture
from ctmc_addon.blender.figure.rendering.picture import opened_png
from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, FigureStyle, Page, ShownSurface
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.blender.viewport import shaders
from ctmc_addon.core import finish
from ctmc_addon.core.errors import OutputError, SettingsError

SMALL = Page(60.0, 72.0)
BLOCKS = ("scenes", "objects", "meshes", "materials", "worlds", "cameras", "lights", "curves", "fonts", "collections")


@pytest.fixture
def thing(scene, torus):
    return add_reconstruction(torus(rings=16, sides=8), scene)


def pixels(path):
    """(rows, columns, channels) float, 0 to 1."""
    with Image.open(path) as image:
        return np.asarray(image, np.float64) / 255


def counts():
    return {name: len(getattr(bpy.data, name)) for name in BLOCKS}


def render(things, path, page=SMALL, blend=None, lines=(), **style):
    cells = [Cell((ShownSurface(one),), lines) for one in things]
    return finish(figure_steps(cells, path, page, FigureStyle(**{"style": "paper", **style}), blend))


@pytest.mark.once
def test_a_long_legend_takes_the_width_of_the_page(thing):
    """Sixty names of 12 letters: a column of them, as there is room for beside scale bar and axes, is 210 mm high."""
    shown = tuple(ShownSurface(thing, name=f"structure {at}") for at in range(60))
    figures = [
        finish(compose_steps([Cell(those)], Page(85.0, 72.0), FigureStyle(style="clinical")))
        for those in (shown, shown[:5])
    ]
    layout, few = [figure.layout for figure in figures]
    for figure in figures:
        figure.remove()
    assert layout.legend_columns >= 3
    assert 0 < layout.legend_above_mm < layout.footer_mm < 90
    assert (few.legend_columns, few.legend_above_mm) == (1, 0)


@pytest.mark.parametrize("count", [15, *(pytest.param(count, marks=pytest.mark.once) for count in (61, 117))])
def test_many_structures_have_two_columns_wide_of_which_the_picture_takes_half(thing, count):
    shown = tuple(ShownSurface(thing, name=f"structure {at}") for at in range(count))
    figure = finish(compose_steps([Cell(shown)], Page(dpi=72.0), FigureStyle(caption="A caption.")))
    layout, width = figure.layout, figure.size[0]
    figure.remove()
    assert width == round(170.0 / 25.4 * 72.0)
    left, bottom, right, top = layout.pictures[0]
    assert (right - left) * (top - bottom) >= 0.5 * 170.0 * layout.height_mm
    assert layout.height_mm <= 231.0


def test_up_to_fourteen_structures_have_one_column(thing):
    shown = tuple(ShownSurface(thing, name=f"structure {at}") for at in range(14))
    figure = finish(compose_steps([Cell(shown)], Page(dpi=72.0), FigureStyle()))
    width = figure.size[0]
    figure.remove()
    assert width == round(85.0 / 25.4 * 72.0)


@pytest.mark.parametrize(
    ("width_mm", "dpi"), [(40.0, 72.0), (25.4, 300.0), pytest.param(20.0, 600.0, marks=pytest.mark.once)]
)
def test_a_png_has_the_asked_size_in_millimeters(thing, tmp_path, width_mm, dpi):
    page = Page(width_mm, dpi, height_mm=20.0)
    size = render([thing], tmp_path / "a.png", page, orientation=False, engine="cycles")
    assert size == (round(width_mm / 25.4 * dpi), round(20 / 25.4 * dpi))
    raw = (tmp_path / "a.png").read_bytes()
    at = raw.index(b"pHYs")
    across, down, unit = struct.unpack(">IIB", raw[at + 4 : at + 13])
    assert unit == 1
    assert across == down == round(dpi / 0.0254)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == size
        assert image.info["dpi"][0] == pytest.approx(dpi, abs=0.02)
        image.load()  # checks the sums of all chunks


def test_the_scale_bar_is_as_long_as_it_says(thing, tmp_path):
    page = Page(40.0, 203.2)
    figure = finish(compose_steps([Cell((ShownSurface(thing),))], page, FigureStyle()))
    text = next(one.data.body for one in figure.scene.objects if one.type == "FONT" and "mm" in one.data.body)
    bar = next(one for one in figure.scene.objects if one.name.startswith("CTMC Bar"))
    units, pixels_per_unit = bar.dimensions.x, max(figure.size) / figure.scene.camera.data.ortho_scale
    figure.remove()
    length_mm = float(text.split()[0])
    assert units == pytest.approx(length_mm * 0.01, rel=1e-5)  # 1 mm = 0.01 units
    render([thing], tmp_path / "a.png", page)
    # Of half-covered pixels the light is half, which sRGB does not write as half.
    darkness = 1 - (pixels(tmp_path / "a.png").mean(axis=2) ** 2.2)[-28:, :120]
    rows = darkness.sum(axis=1) / darkness.max()
    assert rows.max() == pytest.approx(length_mm * 0.01 * pixels_per_unit, abs=0.6)


def test_a_scaled_object_gets_a_true_scale_bar(thing):
    lengths = []
    for scale in (1.0, 3.0):
        thing.scale = (scale,) * 3
        bpy.context.view_layer.update()
        figure = finish(compose_steps([Cell((ShownSurface(thing),))], SMALL, FigureStyle()))
        bar = next(one for one in figure.scene.objects if one.name.startswith("CTMC Bar"))
        body = next(one.data.body for one in figure.scene.objects if one.type == "FONT" and "mm" in one.data.body)
        lengths.append((body, bar.dimensions.x / scale))
        figure.remove()
    assert lengths[0][0] == lengths[1][0]
    assert lengths[0][1] == pytest.approx(lengths[1][1], rel=1e-5)


@pytest.mark.parametrize("count", [1, 2, 4, 6])
def test_no_letter_leaves_the_page_or_touches_a_picture(thing, count):
    page = Page(40.0 + 45.0 * min(count, 3), 72.0)
    lines = ("(a) stride 2 × 2 px", "12,345 triangles, 0.31 s", "error 0.042 mm, at most 0.51 mm")
    look = FigureStyle(
        caption="A caption that is long enough to be broken into several lines, or else nothing is tested here."
    )
    figure = finish(compose_steps([Cell((ShownSurface(thing),), lines)] * count, page, look))
    layout = figure.layout
    eye = np.array(figure.scene.camera.matrix_world.inverted())
    figure.scene.view_layers[0].update()
    boxes, axes = [], []
    for one in figure.scene.objects:
        if one.type == "FONT":
            corners = np.array([[*(one.matrix_world @ bpy_vector(corner)), 1.0] for corner in one.bound_box]) @ eye.T
            on_page = corners[:, :2] / figure.unit + [page.width_mm / 2, layout.height_mm / 2]
            axes.append(one.data.body in "RLAPSI")
            boxes.append((*on_page.min(axis=0), *on_page.max(axis=0)))
    pictures = layout.pictures
    figure.remove()
    assert len(boxes) == 3 * count + 1 + len(layout.caption) + 6
    assert len(layout.caption) >= 1
    for left, bottom, right, top in boxes:
        assert 0 < left < right < page.width_mm
        assert 0 < bottom < top < layout.height_mm
        for x0, y0, x1, y1 in pictures:
            assert right < x0 or left > x1 or top < y0 or bottom > y1
    written = [box for box, axis in zip(boxes, axes, strict=True) if not axis]  # test_axes.py has the others
    for at, (left, bottom, right, top) in enumerate(written):
        for x0, y0, x1, y1 in written[at + 1 :]:
            assert right < x0 or left > x1 or top < y0 or bottom > y1, "letters overlap"


def test_captions_that_are_too_wide_for_their_cell_are_broken(thing):
    figure = finish(
        compose_steps(
            [Cell((ShownSurface(thing),), ("(a) stride of 2 px = 1.49 mm, 50 % simplified",))] * 3,
            Page(90.0, 72.0),
            FigureStyle(),
        )
    )
    texts = figure.layout.texts
    figure.remove()
    assert texts == (("(a) stride of 2 px =", "1.49 mm, 50 %", "simplified"),) * 3


def test_a_tall_sheet_ends_with_the_page(thing):
    thing.rotation_euler = (np.pi / 2, 0.0, 0.0)
    bpy.context.view_layer.update()
    figure = finish(compose_steps([Cell((ShownSurface(thing),))] * 9, Page(170.0, 72.0), FigureStyle(columns=2)))
    height = figure.layout.height_mm
    figure.remove()
    assert height == pytest.approx(230.0)


def bpy_vector(corner):
    from mathutils import Vector

    return Vector(corner)


def test_every_cell_is_seen_by_the_same_camera(scene, torus, tmp_path):
    things = [add_reconstruction(torus(rings=16, sides=8), scene) for _ in range(4)]
    page = Page(101.6, 50.0)
    render(things, tmp_path / "a.png", page, style="clinical", orientation=False, scale_bar=False)
    figure = finish(
        compose_steps(
            [Cell((ShownSurface(one),)) for one in things], page, FigureStyle(orientation=False, scale_bar=False)
        )
    )
    middles = [figure.layout.center(which) for which in range(4)]
    height = figure.layout.height_mm
    figure.remove()
    shown = (pixels(tmp_path / "a.png") < 0.97).any(axis=2)
    masks = []
    for x, y in middles:
        column, row = round(x * page.pixels_per_mm), round((height - y) * page.pixels_per_mm)
        masks.append(shown[row - 25 : row + 25, column - 40 : column + 40])
    for mask in masks[1:]:
        assert mask.sum() == pytest.approx(masks[0].sum(), rel=0.02)
        assert (mask ^ masks[0]).mean() < 0.03


@pytest.mark.parametrize("elevation", [20.0, pytest.param(-60.0, marks=pytest.mark.once)])
def test_no_cell_shades_another(scene, ball, tmp_path, elevation):
    things = [add_reconstruction(ball(), scene) for _ in range(4)]
    alone = {"style": "print", "edges": False, "orientation": False, "scale_bar": False, "elevation": elevation}
    render(things, tmp_path / "a.png", columns=2, **alone)
    shown = pixels(tmp_path / "a.png").mean(axis=2)
    rows, columns = shown.shape[0] // 2, shown.shape[1] // 2
    light = [shown[y : y + rows, x : x + columns].mean() for y in (0, rows) for x in (0, columns)]
    assert light == pytest.approx([np.mean(light)] * 4, rel=3e-3)


def test_a_figure_leaves_nothing_behind_and_changes_nothing(thing, scene, tmp_path):
    scene.render.engine, scene.render.filepath = "BLENDER_WORKBENCH", "//mine"
    before = counts()
    material = thing.data.materials[0]
    render([thing, thing], tmp_path / "a.png", blend=tmp_path / "a.blend", lines=("(a) x",), caption="c")
    assert counts() == before
    assert (scene.render.engine, scene.render.filepath, scene.camera) == ("BLENDER_WORKBENCH", "//mine", None)
    assert thing.data.materials[0] == material
    assert thing.users_scene == (scene,)


def test_a_cancelled_or_failed_figure_leaves_nothing(thing, tmp_path):
    before = counts()
    steps = figure_steps([Cell((ShownSurface(thing),))], tmp_path / "a.png", SMALL, blend=tmp_path / "a.blend")
    next(steps), next(steps)
    steps.close()
    with pytest.raises(SettingsError, match="do not fit"):
        render([thing] * 6, tmp_path / "a.png", lines=("(a) a caption as wide as this",), columns=6)
    assert counts() == before
    assert not list(tmp_path.iterdir())


def test_the_blend_holds_the_figure_and_nothing_else(thing, tmp_path):
    bpy.data.texts.new("private")
    render([thing], tmp_path / "a.png", blend=tmp_path / "a.blend")
    first = pixels(tmp_path / "a.png")
    with bpy.data.libraries.load(str(tmp_path / "a.blend")) as (there, here):
        assert (len(there.scenes), len(there.texts)) == (1, 0)
        here.scenes = there.scenes
    scene = here.scenes[0]
    assert scene.render.filepath == "//"
    scene.render.filepath = str(tmp_path / "again.png")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    again = pixels(tmp_path / "again.png")
    assert again.shape == first.shape
    assert abs(again - first).max() <= 2 / 255
    render([thing], tmp_path / "a.png", blend=tmp_path / "a.blend")  # its own is replaced


def test_somebody_elses_blend_is_not_replaced(thing, tmp_path):
    from ctmc_addon.blender.export import export

    export(thing, tmp_path / "a.blend")
    kept = (tmp_path / "a.blend").read_bytes()
    with pytest.raises(OutputError, match="is not a figure"):
        render([thing], tmp_path / "a.png", blend=tmp_path / "a.blend")
    assert (tmp_path / "a.blend").read_bytes() == kept
    assert not (tmp_path / "a.png").exists()


def test_styles_differ_as_they_say(thing, tmp_path):
    share = {}
    for style in ("paper", "clinical", "print"):
        render([thing], tmp_path / f"{style}.png", Page(40.0, 100.0), style=style, orientation=False, scale_bar=False)
        red, green, blue = np.moveaxis(pixels(tmp_path / f"{style}.png"), 2, 0)
        yellow = (red > 0.8) & (green > 0.6) & (blue < 0.4)
        share[style] = (yellow.mean(), np.abs(red - blue).max())
    assert share["paper"][0] > 0.01
    assert share["clinical"][0] == 0
    assert share["print"][1] < 0.02  # gray throughout


def test_a_transparent_background_is_transparent(thing, tmp_path):
    render([thing], tmp_path / "a.png", Page(40.0, 72.0, transparent=True))
    picture = pixels(tmp_path / "a.png")
    assert picture.shape[2] == 4
    assert picture[0, 0, 3] == 0
    assert picture[..., 3].max() == 1
    assert 0.2 < (picture[..., 3] == 0).mean() < 0.95


def test_a_solid_surface_hides_what_a_clear_one_shows(scene, torus, ball, tmp_path):
    outer = add_reconstruction(ball(), scene)
    inner = add_reconstruction(ball(), scene)
    inner.scale = (0.4,) * 3
    bpy.context.view_layer.update()
    found = []
    for opacity in (1.0, 0.3):
        cell = Cell(
            (ShownSurface(outer, "outer", (0.1, 0.1, 0.8), opacity), ShownSurface(inner, "inner", (0.8, 0.02, 0.02)))
        )
        finish(figure_steps([cell], tmp_path / "a.png", Page(40.0, 72.0), FigureStyle(style="clinical")))
        red, green, blue = np.moveaxis(pixels(tmp_path / "a.png"), 2, 0)
        # The legend's swatch is always there.
        found.append(int(((red > 0.5) & (red > 1.4 * blue) & (red > 1.4 * green))[: red.shape[0] // 2 + 5].sum()))
    assert found[0] == 0
    assert found[1] > 100


def test_axes_follow_a_turned_patient(thing):
    directions = []
    for angle in (0.0, np.pi / 2):
        thing.rotation_euler = (0.0, 0.0, angle)
        bpy.context.view_layer.update()
        figure = finish(compose_steps([Cell((ShownSurface(thing),))], SMALL, FigureStyle()))
        figure.scene.view_layers[0].update()
        letters = {one.data.body: one.matrix_world.translation for one in figure.scene.objects if one.type == "FONT"}
        directions.append(np.array(letters["R"] - letters["L"]))
        figure.remove()
    assert abs(directions[0][1]) < 1e-5 < directions[0][0]
    assert abs(directions[1][0]) < 1e-5 < directions[1][1]


def test_engines_without_a_display_are_refused_before_blender_aborts(thing, tmp_path, monkeypatch):
    monkeypatch.setattr(shaders, "find_library", lambda name: None)
    monkeypatch.setattr("sys.platform", "linux")
    for engine in ("eevee", "workbench"):
        with pytest.raises(OutputError, match=f"{engine} needs EGL"):
            render([thing], tmp_path / "a.png", engine=engine)


@pytest.mark.parametrize("engine", ["workbench", "eevee"])
def test_other_engines_draw_edges_too(thing, tmp_path, engine):
    if not shaders.can_draw():
        pytest.skip("there is no EGL to draw with")
    render([thing], tmp_path / "a.png", Page(40.0, 72.0), engine=engine)
    red, green, blue = np.moveaxis(pixels(tmp_path / "a.png"), 2, 0)
    assert ((red > 0.3) & (green < 0.35 * red + 0.1) & (blue < 0.3)).mean() > 0.03
    assert ((red > 0.4) & (green > 0.6 * red) & (blue < 0.35)).mean() > 0.003
    assert pixels(tmp_path / "a.png")[0, 0].min() > 0.99


def test_the_background_is_white_to_the_last_pixel(thing, tmp_path):
    render([thing], tmp_path / "a.png", Page(40.0, 72.0), orientation=False, scale_bar=False)
    assert (pixels(tmp_path / "a.png")[:3] == 1).all()


@pytest.mark.parametrize("transparent", [pytest.param(False, marks=pytest.mark.once), True])
def test_a_picture_in_tiles_is_the_picture(thing, tmp_path, monkeypatch, transparent):
    page = Page(40.0, 72.0, transparent=transparent)
    render([thing], tmp_path / "whole.png", page)
    monkeypatch.setattr(picture, "TILE_PIXELS", 1500)
    assert len(picture.tiles_of(page.pixels(40.0))) > 4
    render([thing], tmp_path / "tiles.png", page)
    assert abs(pixels(tmp_path / "whole.png") - pixels(tmp_path / "tiles.png")).max() <= 1 / 255
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("transparent", [pytest.param(False, marks=pytest.mark.once), True])
def test_a_process_of_its_own_renders_the_same_picture(thing, tmp_path, transparent):
    page, before = Page(40.0, 72.0, transparent=transparent), counts()
    render([thing], tmp_path / "here.png", page)
    steps = figure_steps(
        [Cell((ShownSurface(thing),))], tmp_path / "there.png", page, FigureStyle("paper"), own_process=True
    )
    finish(steps)
    assert (tmp_path / "here.png").read_bytes() == (tmp_path / "there.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here.png", "there.png"]
    assert counts() == before


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"width_mm": 5}, "width_mm must be from 20 to 400, not 5"),
        ({"dpi": 601}, "dpi must be from 36 to 600, not 601"),
        ({"height_mm": 4000}, "height_mm must be from 20 to 400, not 4000"),
        ({"font_pt": 1}, "font_pt must be from 4 to 24, not 1"),
    ],
)
def test_a_page_has_limits(values, said):
    with pytest.raises(SettingsError, match=said):
        Page(**values)


def test_more_pixels_than_a_machine_holds_are_refused():
    with pytest.raises(SettingsError, match="more than 80 million"):
        Page(400.0, 600.0).pixels(400.0)


def test_a_cut_png_is_refused(thing, tmp_path):
    render([thing], tmp_path / "a.png")
    (tmp_path / "a.png").write_bytes((tmp_path / "a.png").read_bytes()[:-500])
    with pytest.raises(OutputError, match="incomplete"), opened_png(tmp_path / "a.png", "a.png"):
        pass


def test_scale_bars_have_round_lengths():
    assert [round_length(most) for most in (1.0, 4.99, 5.0, 34.0, 0.07)] == [1.0, 2.0, 5.0, 20.0, 0.05]
