# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.export import export
from ctmc_addon.blender.import_mesh import read_mesh
from ctmc_addon.blender.rotation import can_draw, levels_in, show_only, simplified_steps
from ctmc_addon.blender.rotation.timing import (
    RenderDrawing,
    frame_turning,
    frames_of,
    rotation_steps,
    rotation_test_steps,
)
from ctmc_addon.blender.scene.studio import prepare_scene
from ctmc_addon.blender.surface.objects import add_reconstruction
from ctmc_addon.core import finish
from ctmc_addon.core.errors import MeshError, ReadError

KINDS = ("images", "objects", "meshes", "scenes", "materials", "cameras", "lights", "worlds", "collections")
needs_egl = pytest.mark.skipif(not can_draw(), reason="no EGL: the package libegl1 is not installed")


def counts():
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


class Noted:
    """A drawing that notes what it is asked."""

    def __init__(self, levels):
        self.levels, self.shown, self.drawn = levels, [], []

    def show(self, level):
        self.shown.append(level.percent)

    def draw(self, level):
        self.drawn.append((level.percent, round(np.degrees(level.obj.rotation_euler.z), 3)))


@pytest.fixture
def simplified(torus):
    return finish(simplified_steps(torus(alpha=1.0).mesh, [0, 50, 90]))


def test_every_level_has_the_triangles_it_promises(simplified):
    full = len(simplified[0][1].faces)
    assert [percent for percent, _ in simplified] == [0, 50, 90]
    assert [len(mesh.faces) for _, mesh in simplified] == pytest.approx([full, full / 2, full / 10], abs=2)


def test_levels_are_static_meshes_without_modifier_or_key_and_vanish_after_the_block(scene, simplified):
    before = counts()
    with levels_in(scene, simplified) as levels:
        for level, (_, mesh) in zip(levels, simplified, strict=True):
            assert level.obj.data.shape_keys is None
            assert len(level.obj.modifiers) == 0
            assert len(level.obj.data.polygons) == len(mesh.faces)
        assert len({tuple(level.obj.location) for level in levels}) == 1
    assert counts() == before


def test_a_turn_is_18_frames_from_20_to_360_degrees_after_one_that_is_not_timed(scene, simplified):
    with levels_in(scene, simplified) as levels:
        drawing = Noted(levels)
        seconds = finish(rotation_steps(levels, drawing, rounds=2))
    assert [len(times) for times in seconds] == [2, 2, 2]
    assert drawing.shown == [0, 50, 90, 0, 50, 90]  # the levels in turn
    turn = [0, *range(20, 361, 20)]
    assert drawing.drawn == [(percent, angle) for percent in drawing.shown for angle in turn]


@pytest.mark.parametrize(("step", "frames"), [(20, 18), (60, 6), (7, 51), (1, 360), (0.1, 3600), (180, 2)])
def test_frames_fill_the_circle_and_no_more(step, frames):
    assert frames_of(step) == frames


def test_only_drawing_is_on_the_clock(scene, simplified, monkeypatch):
    from ctmc_addon.blender.rotation import timing as turntable

    clock = [0.0]

    def between(step):
        clock[0] += 50  # what a driver does between frames

    class Slow(Noted):
        def show(self, level):
            clock[0] += 1000

        def draw(self, level):
            clock[0] += 1.0 if level.percent == 0 else 0.25

    monkeypatch.setattr(turntable.time, "perf_counter", lambda: clock[0])
    with levels_in(scene, simplified[:2]) as levels:
        steps = rotation_steps(levels, Slow(levels), rounds=3)
        assert finish(steps, between) == [[18.0] * 3, [4.5] * 3]


def test_a_cancelled_test_leaves_nothing_behind(scene, simplified):
    before = counts()
    steps = rotation_test_steps(simplified, "CYCLES", rounds=1, step_degrees=180, size=(16, 16))
    next(steps)
    steps.close()
    assert counts() == before


def test_the_camera_sees_the_whole_surface_however_it_is_turned(scene, simplified):
    from bpy_extras.object_utils import world_to_camera_view

    with levels_in(scene, simplified[:1]) as (level,):
        prepare_scene(scene, [level.obj], (160, 120))
        frame_turning(scene, level, (160, 120))
        for angle in np.radians(range(0, 360, 20)):
            level.obj.rotation_euler.z = angle
            scene.view_layers[0].update()
            corners = [level.obj.matrix_world @ vertex.co for vertex in list(level.obj.data.vertices)[::7]]
            seen = np.array([world_to_camera_view(scene, scene.camera, corner) for corner in corners])
            assert seen[:, :2].min() > 0
            assert seen[:, :2].max() < 1
            assert seen[:, 2].min() > 0


@needs_egl
def test_both_ways_of_drawing_draw_the_same_outline(scene, simplified, tmp_path):
    image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    from ctmc_addon.blender.rotation.offscreen import TriangleDrawing

    size = (160, 120)
    with levels_in(scene, simplified) as levels:
        level = levels[1]
        prepare_scene(scene, [level.obj], size)
        frame_turning(scene, level, size)
        level.obj.rotation_euler.z = 0.9
        whole = RenderDrawing(scene, levels, "BLENDER_WORKBENCH")
        scene.render.film_transparent = True
        scene.render.image_settings.color_mode = "RGBA"
        scene.render.filepath = str(tmp_path / "whole.png")
        whole.show(level)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        with image.open(tmp_path / "whole.png") as picture:
            outline = np.asarray(picture)[..., 3] > 127
        with TriangleDrawing(scene, levels, size) as alone:
            alone.draw(level)
            pixels = alone.pixels()[::-1]
        drawn = (pixels[..., :3] < 250).any(axis=-1)
    assert 0.05 < drawn.mean() < 0.6
    assert (drawn != outline).mean() < 0.01


@needs_egl
def test_the_test_without_a_window_times_every_level_both_ways_and_cleans_up(scene, simplified):
    before = counts()
    found = finish(rotation_test_steps(simplified, "BLENDER_WORKBENCH", rounds=2, step_degrees=90, size=(64, 48)))
    assert [(one.percent, one.faces) for one in found] == [(percent, len(mesh.faces)) for percent, mesh in simplified]
    for one in found:
        assert len(one.rounds) == len(one.draw_rounds) == 2
        assert min(one.rounds + one.draw_rounds) > 0
    assert counts() == before


def test_show_only_hides_the_others_everywhere(scene, simplified):
    with levels_in(scene, simplified) as levels:
        show_only(levels, levels[1])
        assert [level.obj.hide_render for level in levels] == [True, False, True]
        assert [level.obj.hide_viewport for level in levels] == [True, False, True]


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj", ".glb", ".blend"])
def test_a_mesh_that_was_exported_comes_back_in_its_own_unit(scene, torus, tmp_path, suffix):
    result = torus(alpha=1.0)
    thing = add_reconstruction(result, scene)
    export(thing, tmp_path / f"torus{suffix}", scene=scene)
    before = counts()
    mesh = read_mesh(tmp_path / f"torus{suffix}")
    assert counts() == before
    assert mesh.closed or suffix == ".glb"
    assert len(mesh.faces) == len(result.mesh.faces)
    unit = {".glb": 1e-3, ".blend": 1e-2}.get(suffix, 1.0)  # meters; Blender's units; mm
    extent, expected = np.ptp(mesh.vertices, axis=0), np.ptp(result.mesh.vertices, axis=0)
    np.testing.assert_allclose(extent, expected * unit, rtol=1e-3)
    assert mesh.volume > 0


def test_files_without_a_surface_are_refused(scene, tmp_path):
    (tmp_path / "point.obj").write_text("v 0 0 0\n")
    with pytest.raises((MeshError, ReadError), match=r"point\.obj"):
        read_mesh(tmp_path / "point.obj")
    with pytest.raises(ReadError, match="no file"):
        read_mesh(tmp_path / "none.ply")
