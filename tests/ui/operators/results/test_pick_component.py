# SPDX-License-Identifier: GPL-3.0-or-later
"""Components by click: what is clicked is removed, kept or separated, with its cavities; alpha stays live."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.surface import evaluated_triangles, own_surface, read_provenance
from ctmc_addon.ui.state.results import measurements, surfaces

SHELL_MM, BALL_MM = (-8.0, -18.0, -10.0), (-38.0, -10.0, -8.0)  # places on the two components


def values():
    """A ball with a cavity, in which a smaller ball floats, and a ball beside it; 100 and above is inside."""
    z, y, x = np.indices((20, 20, 50), np.float32)

    def ball(center, radius):
        return radius - np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2)

    shell = np.minimum(ball((10, 10, 10), 8.3), -ball((10, 10, 10), 5.2))
    return (100 + 50 * np.maximum(np.maximum(shell, ball((10, 10, 10), 2.3)), ball((38, 10, 10), 6.2))).astype(np.int16)


@pytest.fixture
def surface(scene, tmp_path):
    np.save(tmp_path / "balls.npy", values())
    bpy.ops.ctmc.load(filepath=str(tmp_path / "balls.npy"), spacing=(1, 1, 1))
    scene.ctmc.use_threshold, scene.ctmc.threshold = True, 100.0
    bpy.ops.ctmc.reconstruct()
    return bpy.context.object


def on(obj, x_from, x_to):
    """A place on the outside of what lies between two columns, RAS+ mm."""
    mesh = own_surface(obj).mesh
    columns = np.abs(mesh.vertices[:, 0])
    near = mesh.vertices[(columns >= x_from) & (columns <= x_to)]
    return near[np.abs(near[:, 1] - near[:, 1].mean()).argmax()].tolist()


def shape(obj):
    measures = evaluated_triangles(obj).measures
    return measures.components, round(measures.volume)


def test_the_clicked_component_goes_with_its_cavities_and_comes_as_an_object_of_its_own(scene, surface):
    components, volume = shape(surface)
    assert components == 4  # the shell's two walls, what floats in it, the ball
    assert bpy.ops.ctmc.pick_component(action="SEPARATE", point_mm=on(surface, 2, 18)) == {"FINISHED"}
    (other,) = (obj for obj in scene.objects if surfaces.is_surface(obj) and obj != surface)
    assert shape(surface)[0] == 2
    assert shape(other)[0] == 2
    assert shape(surface)[1] + shape(other)[1] == pytest.approx(volume, abs=2)
    assert other.data.materials[0] != surface.data.materials[0]
    bpy.ops.ctmc.pick_component(action="REMOVE", point_mm=on(surface, 30, 46))
    assert shape(surface) == (1, pytest.approx(4.19 * 2.3**3, rel=0.2))
    assert measurements.of(surface).measures.components == 1
    assert bpy.ops.ctmc.pick_component.poll()
    with pytest.raises(RuntimeError, match="nothing would be left"):
        bpy.ops.ctmc.pick_component(action="REMOVE", point_mm=on(surface, 2, 18))
    assert shape(surface)[0] == 1


def test_a_kept_component_has_the_bytes_it_had_and_alpha_moves_it(scene, surface):
    before = own_surface(surface)
    scene.ctmc.alpha = 0.25
    bpy.ops.ctmc.pick_component(action="KEEP", point_mm=on(surface, 30, 46))
    after = own_surface(surface)
    assert after.settings.alpha == 0.25
    kept = np.abs(before.surface.linear[:, 0]) > 25
    np.testing.assert_array_equal(after.surface.linear, before.surface.linear[kept])
    np.testing.assert_array_equal(after.surface.midpoints, before.surface.midpoints[kept])
    scene.ctmc.alpha = 0.5
    bpy.context.view_layer.update()
    assert shape(surface)[0] == 1
    assert "Components were picked by hand." in read_provenance(surface).notes
    assert surfaces.full_of(surface, scene).full_faces == len(surface.data.polygons)


def test_a_simplified_surface_is_picked_too(scene, surface):
    scene.ctmc.reduction = 0.5
    scene.ctmc.goal = "reduction"
    bpy.ops.ctmc.simplify()
    faces = len(surface.data.polygons)
    bpy.ops.ctmc.pick_component(action="KEEP", point_mm=on(surface, 30, 46))
    assert 0 < len(surface.data.polygons) < faces
    assert shape(surface)[0] == 1
    assert surfaces.full_of(surface, scene) is None
