# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the mouse is in a viewport, and the ray under it, in one view and in four."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")
from mathutils import Euler, Matrix, Vector

from ctmc_addon.blender.viewport.eye import region_of
from ctmc_addon.ui.viewport.mouse import Clicks, ray_under, window_under


def view(*degrees):
    """An orthographic view, 2 units wide and high, turned about x, y and z."""
    turned = Euler([value * 3.141592653589793 / 180 for value in degrees]).to_matrix().to_4x4()
    matrix = turned.inverted()
    return SimpleNamespace(
        is_perspective=False,
        view_perspective="ORTHO",
        view_matrix=matrix,
        perspective_matrix=Matrix.Diagonal((1, 1, 0.01, 1)) @ matrix,
    )


def region(kind, x, y, data=None):
    return SimpleNamespace(type=kind, x=x, y=y, width=100, height=100, data=data)


@pytest.fixture
def quad():
    """From above, the front, the right, and from below, as the four regions of quad view."""
    views = [view(0, 0, 0), view(90, 0, 0), view(90, 0, 90), view(180, 0, 0)]
    places = ((0, 0), (0, 100), (100, 0), (100, 100))
    return SimpleNamespace(regions=[region("WINDOW", *place, data) for place, data in zip(places, views, strict=True)])


@pytest.mark.parametrize(
    ("x", "y", "direction", "place"),
    [
        (75, 50, (0, 0, -1), (0.5, 0, None)),
        (75, 175, (0, 1, 0), (0.5, None, 0.5)),
        (175, 50, (-1, 0, 0), (None, 0.5, 0)),
        (150, 175, (0, 0, 1), (0, -0.5, None)),
    ],
)
def test_in_quad_view_the_ray_is_that_of_the_view_under_the_mouse(quad, x, y, direction, place):
    origin, toward = ray_under(quad, SimpleNamespace(mouse_x=x, mouse_y=y))
    assert (toward - Vector(direction)).length < 1e-5
    for found, expected in zip(origin, place, strict=True):
        assert expected is None or found == pytest.approx(expected, abs=1e-5)


def test_a_view_is_framed_in_its_own_region(quad):
    for number in range(4):
        assert region_of(quad, quad.regions[number].data) is quad.regions[number]


def test_on_a_bar_and_outside_there_is_no_view(quad):
    quad.regions.append(region("UI", 150, 0))
    assert window_under(quad, SimpleNamespace(mouse_x=120, mouse_y=50)) is quad.regions[2]
    assert window_under(quad, SimpleNamespace(mouse_x=160, mouse_y=50)) is None
    assert window_under(quad, SimpleNamespace(mouse_x=-5, mouse_y=50)) is None


def test_clicks_have_a_cross_as_pointer_and_a_text_in_the_status_bar_until_they_are_canceled():
    told = []

    class Operator(Clicks):
        def ask(self, context):
            context.workspace.status_text_set("Click")

        def report(self, kind, text):
            told.append(text)

    context = SimpleNamespace(
        area=SimpleNamespace(type="VIEW_3D", as_pointer=lambda: 7),
        window=SimpleNamespace(cursor_modal_set=told.append, cursor_modal_restore=lambda: told.append(None)),
        window_manager=SimpleNamespace(modal_handler_add=told.append),
        workspace=SimpleNamespace(status_text_set=told.append),
    )
    operator = Operator()
    assert operator.invoke(context, None) == {"RUNNING_MODAL"}
    assert (operator.area, told) == (7, ["CROSSHAIR", operator, "Click"])
    operator.cancel(context)
    assert told[3:] == [None, None]
    assert operator.invoke(SimpleNamespace(area=None), None) == {"CANCELLED"}
    assert told[5:] == ["Press this in a 3D viewport"]
