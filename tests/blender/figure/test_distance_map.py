# SPDX-License-Identifier: GPL-3.0-or-later
"""Sheets and maps of distances: what is compared, measured and colored."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.distance_map import DISTANCE_RAMP, color_scale, distance_map_steps
from ctmc_addon.blender.figure.page.sheet import deviation_figure_steps, sheet_steps
from ctmc_addon.blender.figure.spec import Comparison, FigureStyle, Page
from ctmc_addon.blender.maps.colors import vertex_colors
from ctmc_addon.blender.maps.material import RIM
from ctmc_addon.core import ReconstructionSettings, TriangleMesh, Volume, finish, length_text, one_way_text
from ctmc_addon.core.errors import OutputError, SettingsError
from ctmc_addon.core.maps.ramps import linear, stops_of
from ctmc_addon.core.mesh import ReferenceSurface, SurfaceDistance

SETTINGS = ReconstructionSettings(threshold=60.0)


@pytest.fixture(scope="module")
def volume():
    """A ball of 8 mm in voxels of 1 mm."""
    return Volume((100 - 5 * distance_mm((24, 24, 24))).astype(np.float32), np.eye(4), name="ball")


def sheet(volume, path, settings=SETTINGS, page=None, style=None, **rest):
    comparison = Comparison(**{name: rest.pop(name) for name in ("strides", "alphas", "levels") if name in rest})
    page = page or Page(150.0, 40.0)
    return finish(sheet_steps(volume, settings, comparison, path, page, style or FigureStyle(), **rest))


def test_a_sheet_says_what_each_cell_is_and_how_far_off(scene, volume, tmp_path):
    _, cells = sheet(volume, tmp_path / "a.png", strides=[(1, 1), (2, 2), (3, 3)])
    assert [one.letter for one in cells] == ["a", "b", "c"]
    assert [one.title for one in cells] == [f"stride {side} px = {side} mm" for side in (1, 2, 3)]
    faces = [len(one.result.mesh.faces) for one in cells]
    assert faces[0] > faces[1] > faces[2]
    assert cells[0].distance == SurfaceDistance()
    assert 0 < cells[1].distance.mean < cells[2].distance.mean < cells[2].distance.largest < 2.0
    assert all(one.seconds > 0 for one in cells)
    assert cells[1].lines[0].replace("\N{NO-BREAK SPACE}", " ") == "(b) stride 2 px = 2 mm"
    assert cells[1].lines[1].startswith(f"{faces[1]:,} triangles, ")
    mean = length_text(cells[1].distance.mean, 3).replace(" ", "\N{NO-BREAK SPACE}")
    assert cells[1].lines[2] == f"error {mean} on average"
    one_way = one_way_text(cells[1].distance.from_full).replace(" ", "\N{NO-BREAK SPACE}")
    assert cells[1].lines[4] == f"from the full surface at most {one_way}"
    assert len(bpy.data.scenes) == 1
    assert not bpy.data.objects


def test_crossed_settings_go_down_and_across(volume):
    comparison = Comparison(strides=[(1, 1), (2, 1)], levels=[0, 50, 90])
    assert comparison.columns == 3
    variants = comparison.variants(SETTINGS)
    assert [one.stride[0] for _, one in variants] == [1, 1, 1, 2, 2, 2]
    assert [one.reduction for _, one in variants] == [None, 0.5, 0.9] * 2
    assert variants[5][0] == "stride 2 × 1 px, 90 % simplified"
    assert Comparison(alphas=[0, 1]).columns is None


def test_the_alphas_are_measured_against_the_linear_surface(scene, volume, tmp_path):
    _, cells = sheet(volume, tmp_path / "a.png", alphas=[0.0, 0.5, 1.0])
    assert cells[2].distance.mean == 0
    assert cells[0].distance.mean == pytest.approx(2 * cells[1].distance.mean, rel=0.1)
    assert cells[0].distance.mean > 0.02


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give one or two"),
        ({"strides": [(1, 1)], "alphas": [0.0], "levels": [0.0]}, "give one or two"),
        ({"levels": [100.0]}, "levels must be from 0 to 99, not 100"),
        ({"levels": list(range(27))}, "at most 26"),
    ],
)
def test_what_cannot_be_compared_is_refused(given, said):
    with pytest.raises(SettingsError, match=said):
        Comparison(**given)


def test_alpha_on_a_bare_label_is_refused(scene, tmp_path):
    label = Volume((np.indices((8, 8, 8)).sum(axis=0) < 9).astype(np.uint8), np.eye(4))
    with pytest.raises(SettingsError, match="a label that is not smoothed"):
        sheet(label, tmp_path / "a.png", ReconstructionSettings(label=1, smoothing="none"), alphas=[0.0, 1.0])


def test_the_inside_of_a_large_triangle_is_measured_too(ball):
    mesh = ball().mesh
    reference = ReferenceSurface(mesh)
    octahedron = np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32) * 8
    a, b, c = 0, 1, 2
    faces = [(a, b, c), (b, 3, c), (3, 4, c), (4, a, c), (b, a, 5), (3, b, 5), (4, 3, 5), (a, 4, 5)]
    coarse = TriangleMesh(octahedron, np.array(faces, np.int32))
    measured = finish(distance_map_steps(coarse, reference))
    # Its corners lie on the ball, the middles of its faces 8 - 8 / sqrt(3) mm below.
    assert measured.distances_mm[:6].max() < 0.05
    assert measured.distances_mm.max() == pytest.approx(8 - 8 / np.sqrt(3), abs=0.15)


def test_the_color_bar_ends_where_nearly_all_is_within(ball):
    measured = finish(distance_map_steps(ball(stride=(3, 3, 3)).mesh, ReferenceSurface(ball().mesh)))
    scale = color_scale([measured])
    low, high = scale.range
    assert low == 0
    assert np.percentile(measured.distances_mm, 99) <= high <= 1.3 * np.percentile(measured.distances_mm, 99)
    assert scale.above == (measured.distances_mm.max() > high)
    assert color_scale([measured], 0.01).above
    assert (scale.below, scale.gaps) == (False, False)


def test_colors_of_distances_are_those_of_the_bar(scene, volume, tmp_path):
    result = sheet(volume, tmp_path / "s.png", strides=[(3, 3)])[1][0].result
    path = tmp_path / "a.png"
    finish(deviation_figure_steps(volume, result, path, Page(60.0, 80.0), FigureStyle()))
    with Image.open(path) as image:
        picture = np.asarray(image, np.float64) / 255
    lower = picture[int(0.6 * len(picture)) :]
    for color in (stops_of(DISTANCE_RAMP)[0], stops_of(DISTANCE_RAMP)[-1]):
        assert np.abs(lower - color).max(axis=2).min() < 0.08, "the bar has both ends"


def lightness(linear_rgb):
    """CIE L* of (..., 3) linear RGB."""
    light = linear_rgb @ [0.2126, 0.7152, 0.0722]
    return np.where(light > 0.008856, 116 * np.cbrt(light) - 16, 903.3 * light)


def test_no_distance_is_light_and_equal_steps_look_equal():
    values = np.linspace(0.0, 1.0, len(stops_of(DISTANCE_RAMP))).astype(np.float32)
    shown = lightness(vertex_colors(values, (0.0, 1.0), DISTANCE_RAMP)[:, :3].astype(np.float64))
    steps = -np.diff(shown)
    assert shown[0] > 95
    assert shown[-1] < 25
    assert steps.min() > 0.75 * steps.mean()
    assert steps.max() < 1.3 * steps.mean()


def test_what_is_right_is_light_on_every_side(scene, volume, tmp_path):
    result = sheet(volume, tmp_path / "s.png", strides=[(1, 1)])[1][0].result
    page, bare = Page(40.0, 80.0, transparent=True), FigureStyle(scale_bar=False, orientation=False, caption="")
    finish(deviation_figure_steps(volume, result, tmp_path / "a.png", page, bare, limit_mm=1.0))
    with Image.open(tmp_path / "a.png") as image:
        picture = np.asarray(image, np.float64)[: image.height // 2] / 255
    inside = picture[picture[..., 3] == 1][:, :3] ** 2.2
    assert len(inside) > 300
    assert lightness(inside).min() > 0.9 * lightness(RIM * np.array(linear(stops_of(DISTANCE_RAMP)[0])[:3]))
    assert np.ptp(lightness(inside)) > 5, "the form is seen"


def test_the_same_surface_has_no_distance(scene, volume, tmp_path):
    _, cells = sheet(volume, tmp_path / "a.png", strides=[(1, 1)], deviation=True)
    assert cells[0].distance.largest == 0


def test_a_map_is_refused_where_it_cannot_be_drawn(scene, volume, tmp_path):
    with pytest.raises(OutputError, match="workbench shows no map"):
        sheet(volume, tmp_path / "a.png", strides=[(1, 1)], deviation=True, style=FigureStyle(engine="workbench"))
    with pytest.raises(SettingsError, match="must end between"):
        sheet(volume, tmp_path / "a.png", strides=[(1, 1)], deviation=True, limit_mm=0.0)
    decimating = ReconstructionSettings(threshold=60.0, simplifier="decimate", reduction=0.5)
    with pytest.raises(SettingsError, match="leave out --simplifier decimate"):
        sheet(volume, tmp_path / "a.png", decimating, strides=[(1, 1)])
    assert not list(tmp_path.iterdir())
    assert len(bpy.data.scenes) == 1
