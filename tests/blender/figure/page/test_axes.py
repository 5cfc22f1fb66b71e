# SPDX-License-Identifier: GPL-3.0-or-later
"""The patient's axes on a figure: letters that never touch, arms that show their depth."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.page.axes import ARM, FADE, PIVOT, reach_mm
from ctmc_addon.blender.figure.page.compose import compose_steps
from ctmc_addon.blender.figure.rendering.picture import RenderRequest
from ctmc_addon.blender.figure.spec import Cell, FigureStyle, Page, ShownSurface
from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.core import finish

VIEWS = [(30, 20), (0, 0), (45, 0), (45, 35.3), (90, 0), (0, 90), (-60, -60), (12, 0), (200, 78)]


@pytest.fixture
def figure_of(scene, torus):
    thing = add_reconstruction(torus(rings=16, sides=8), scene)
    made = []

    def build(azimuth, elevation, page=None, **style):
        look = FigureStyle(style="clinical", azimuth=azimuth, elevation=elevation, **style)
        made.append(finish(compose_steps([Cell((ShownSurface(thing),))], page or Page(40.0, 72.0), look)))
        made[-1].scene.view_layers[0].update()
        return made[-1]

    yield build
    for figure in made:
        figure.remove()


def letters_of(figure):
    """The axes' letters by name: (left, bottom, right, top) in mm about the middle, and mm before it."""
    pivot = next(obj for obj in figure.scene.objects if obj.name.startswith(PIVOT))
    eye = np.array(figure.scene.camera.matrix_world.inverted())
    middle = eye @ [*pivot.matrix_world.translation, 1.0]
    out = {}
    for obj in figure.scene.objects:
        if obj.type == "FONT" and obj.parent == pivot:
            corners = np.array([[*corner, 1.0] for corner in obj.bound_box]) @ np.array(obj.matrix_world).T
            seen = ((corners @ eye.T - middle) / figure.unit)[:, :3]
            out[obj.data.body] = (*seen[:, :2].min(axis=0), *seen[:, :2].max(axis=0)), seen[:, 2].mean()
    return out


@pytest.mark.parametrize(("azimuth", "elevation"), VIEWS)
def test_letters_that_are_seen_never_touch_each_other_or_an_arm(figure_of, azimuth, elevation):
    figure = figure_of(azimuth, elevation)
    reach = reach_mm(Page().font_mm)
    letters = letters_of(figure)
    assert set(letters) == set("RLAPSI")
    seen = {name: box for name, (box, before) in letters.items() if before > -FADE[1] * reach}
    assert 3 <= len(seen) <= 5
    for (_, a), (_, b) in itertools.combinations(seen.items(), 2):
        apart = max(a[0] - b[2], b[0] - a[2], a[1] - b[3], b[1] - a[3])
        assert apart > 0.3, "mm between letters"
    for name, (left, bottom, right, top) in seen.items():
        middle = np.array([left + right, bottom + top]) / 2
        away = np.hypot(*middle) / reach
        # Its own arm ends before it; where it points at the reader, the letter stands before the middle.
        assert away > 0.94 or letters[name][1] > 0.25 * reach


def test_letters_stand_in_the_middle_of_their_places(figure_of):
    for (left, bottom, right, top), before in letters_of(figure_of(0, 0)).values():
        if abs(before) < 0.1:
            middle = np.abs([left + right, bottom + top]) / 2
            assert min(middle) < 0.17  # what is left and right of L in its advance differs
            assert max(middle) == pytest.approx(reach_mm(Page().font_mm), abs=0.17)


def test_the_nearer_arm_is_darker_and_far_letters_are_gone(figure_of, tmp_path):
    page = Page(30.0, 300.0, height_mm=30.0)
    figure = figure_of(50, 30, page, scale_bar=False, samples=8)
    path = tmp_path / "a.png"
    path.touch()
    RenderRequest(str(path), path.name, page.dpi, figure.paper).make(figure.scene)
    with Image.open(path) as image:
        picture = np.asarray(image.convert("L"), np.float64) / 255
    pivot = next(obj for obj in figure.scene.objects if obj.name.startswith(PIVOT))
    eye, reach = figure.scene.camera.matrix_world.inverted(), reach_mm(page.font_mm)

    def shade(direction, share, size):
        x, y, _ = eye @ (pivot.matrix_world @ bpy_vector(direction, share * reach * figure.unit))
        column = round((x / figure.unit + 15.0) * page.pixels_per_mm)
        row = round((15.0 - y / figure.unit) * page.pixels_per_mm)
        return picture[row - size : row + size + 1, column - size : column + size + 1].min()

    # The front and the left are towards the reader, the back and the right away.
    for near, far in (((0, 1, 0), (0, -1, 0)), ((-1, 0, 0), (1, 0, 0))):
        assert shade(near, 0.8 * ARM, 1) < 0.4 < 0.55 < shade(far, 0.8 * ARM, 1)
        assert shade(near, 1.0, 8) < 0.3
        assert shade(far, 1.0, 8) > 0.9


def bpy_vector(direction, length):
    from mathutils import Vector

    return Vector(direction) * length
