# SPDX-License-Identifier: GPL-3.0-or-later
"""A figure shows a map in its colors, with a bar and a square for what has no value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rises import Rise

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.map_colors import scale_of, statistics_text, style_with_map
from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import Cell, ColorScale, FigureStyle, Page, ShownSurface, Turn
from ctmc_addon.blender.figure.turntable import turntable_steps
from ctmc_addon.blender.surface import temporary_surfaces
from ctmc_addon.blender.viewport.shaders import can_draw
from ctmc_addon.core import finish
from ctmc_addon.core.errors import SettingsError
from ctmc_addon.core.maps.make import mapped_steps
from ctmc_addon.core.maps.ramps import NO_VALUE, RAMPS, rgb_of
from ctmc_addon.core.maps.request import MapRequest

ENGINES = ["cycles", pytest.param("eevee", marks=pytest.mark.skipif(not can_draw(), reason="EEVEE needs EGL"))]
PAGE = Page(40.0, 100.0, 60.0)
BARE = {"scale_bar": False, "orientation": False, "caption": "", "elevation": 0.0, "azimuth": 0.0}


def mapped(result, rise=None, **request):
    rise = rise or Rise()
    [result] = finish(mapped_steps(None, [result], MapRequest((rise,), **request), None, None))
    return result


def rendered(result, path, style, page=PAGE, **options):
    with temporary_surfaces([result]) as (scene, [obj]):
        finish(figure_steps([Cell((ShownSurface(obj, **options),))], path, page, style, None, scene))
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"), np.float64) / 255


@pytest.mark.parametrize("engine", ENGINES)
def test_every_point_has_the_color_of_its_value_and_gray_without_one(scene, ball, engine, tmp_path):
    result = mapped(ball(), Rise(8.0), range=(8.0, 16.0), ramp="magma")
    style = style_with_map(FigureStyle(engine=engine, **BARE), [result])
    assert style.colors == ColorScale("rise_mm", "rise", "mm", (8.0, 16.0), "magma", gaps=True)
    picture = rendered(result, tmp_path / "a.png", style)
    height = next(at for at in range(len(picture)) if (picture[at] < 0.9).any())  # The top of the ball.
    middle = picture.shape[1] // 2
    column = picture[height : int(0.7 * len(picture)), middle]
    # Light at the top, dark above the equator, gray below it.
    assert column[3].min() > 0.5
    gray = np.array(rgb_of(NO_VALUE))
    is_gray = (np.ptp(column, axis=1) < 0.03) & (np.abs(column - gray).max(axis=1) < 0.12)
    assert is_gray.sum() > 15
    dark = np.flatnonzero(column.max(axis=1) < 0.4)
    assert len(dark)
    assert dark.max() < np.flatnonzero(is_gray).min() + 1, "the lowest value is next to what has none"


def test_the_bar_has_both_ends_and_the_square_of_no_value(scene, ball, tmp_path):
    result = mapped(ball(), Rise(8.0), ramp="viridis")
    style = style_with_map(FigureStyle(scale_bar=False, orientation=False, caption=""), [result])
    picture = rendered(result, tmp_path / "a.png", style, Page(60.0, 150.0))
    lower = picture[int(0.8 * len(picture)) :]
    for color in (*(RAMPS["viridis"].split()[at] for at in (0, -1)), NO_VALUE):
        assert np.abs(lower - rgb_of(color)).max(axis=2).min() < 0.05


def test_a_surface_without_gaps_has_no_square(scene, ball, tmp_path):
    style = style_with_map(FigureStyle(caption=""), [mapped(ball(), ramp="viridis")])
    assert not style.colors.gaps


def test_a_transparent_surface_keeps_its_look(scene, ball, tmp_path):
    result = mapped(ball(), ramp="viridis")
    style = style_with_map(FigureStyle(**BARE), [result])
    picture = rendered(result, tmp_path / "a.png", style, opacity=0.3)
    inside = picture[len(picture) // 4, picture.shape[1] // 2]
    assert np.ptp(inside) < 0.3, "bone, not violet or yellow"


def test_a_name_that_no_map_has_is_refused_with_those_there(ball):
    with pytest.raises(SettingsError, match="there is no map gap_mm; the maps are rise_mm"):
        style_with_map(FigureStyle(), [mapped(ball())], "gap_mm")
    with pytest.raises(SettingsError, match="there is no map x; the surfaces have none"):
        style_with_map(FigureStyle(), [ball()], "x")


def test_the_scale_says_what_lies_beyond_it(ball):
    [rise] = mapped(ball()).maps
    scale = scale_of([replace(rise, range=(2.0, 9.0))])
    assert [scale.label(share) for share in (0.0, 0.5, 1.0)] == ["≤ 2", "5.5", "≥ 9"]
    assert scale_of([replace(rise, range=(0.0, 20.0))]).label(0.0) == "0"
    small = ColorScale("deviation_mm", "distance", "mm", (0.0, 0.04), "light", above=True)
    assert (small.heading, small.label(1.0)) == ("distance, um", "≥ 40")
    assert ColorScale("dose", "dose", "Gy", (0.0, 0.04), "light").heading == "dose, Gy"
    even = ColorScale("gap_mm", "gap", "mm", (-0.3, 0.3), "coolwarm")
    assert even.label(0.5) == "0"


def test_the_numbers_of_a_map_are_a_sentence(ball):
    [rise] = mapped(ball()).maps
    assert statistics_text(rise).startswith("rise: median 7.969 mm, mean 7.969, 0 to 15.94 (")


def test_no_node_group_or_material_is_left(scene, ball, tmp_path):
    result = mapped(ball())
    rendered(result, tmp_path / "a.png", style_with_map(FigureStyle(caption=""), [result]))
    assert (len(bpy.data.materials), len(bpy.data.node_groups), len(bpy.data.meshes)) == (0, 0, 0)


def test_a_turntable_shows_a_map_and_is_not_resumed_with_another(scene, ball, tmp_path):
    turn, page = Turn(seconds=1.0, fps=3), Page(30.0, 60.0)
    style = FigureStyle(caption="", orientation=False, scale_bar=False)

    def turned(result, **options):
        shown = style_with_map(style, [result])
        with temporary_surfaces([result]) as (own, [obj]):
            cell = Cell((ShownSurface(obj),))
            return finish(turntable_steps(cell, tmp_path / "turn", page, shown, turn, scene=own, **options))

    first = mapped(ball(), range=(0.0, 16.0))
    assert turned(first)[1] == 3
    with Image.open(tmp_path / "turn" / "frame_00001.png") as image:
        picture = np.asarray(image.convert("RGB"), np.float64) / 255
    assert np.abs(picture - rgb_of(RAMPS["viridis"].split()[8])).max(axis=2).min() < 0.1
    assert turned(first, resume=True)[1] == 0
    [rise] = first.maps
    with pytest.raises(Exception, match="another turntable"):
        turned(replace(first, maps=(replace(rise, values=rise.values * 0.5),)), resume=True)
