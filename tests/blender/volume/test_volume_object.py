# SPDX-License-Identifier: GPL-3.0-or-later
"""Volume objects: their place, their values and their materials, beside surfaces of the same CT."""

import numpy as np
import pytest
from shapes import distance_mm

bpy = pytest.importorskip("bpy")

from mathutils import Vector

from ctmc_addon.blender.surface import add_reconstruction
from ctmc_addon.blender.units import set_units, shows_mm
from ctmc_addon.blender.volume import APPEARANCES, add_volume, adjust, of_ct, vdb_steps, vdb_writer
from ctmc_addon.core import ReconstructionSettings, Volume, finish, reconstruct

needs_openvdb = pytest.mark.skipif(vdb_writer() is None, reason="this Blender has no OpenVDB module")
SCALE = 0.01


@pytest.fixture
def scene():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return bpy.context.scene


def ball(affine):
    """Values fall from 60 by the distance in voxels from (11.3, 10.7, 12.2)."""
    values = 60 - 4 * distance_mm((24, 22, 23), (11.3, 10.7, 12.2)).astype(np.float32)
    return Volume(values, affine, name="ball", kind="HU")


def oblique():
    """Mirrored, turned, sheared and far from the origin, as a patient's coordinates are."""
    affine = np.array([[-0.7, 0.1, 0.2, 312.5], [0.1, 0.8, -0.3, -207.25], [0.05, 0.2, 2.0, 715.125], [0, 0, 0, 1.0]])
    return affine


def meshed(volume_object, threshold):
    """World positions (n, 3) of Blender's own surface of a Volume object."""
    obj = bpy.data.objects.new("mesh", bpy.data.meshes.new("mesh"))
    bpy.context.scene.collection.objects.link(obj)
    modifier = obj.modifiers.new("mesh", "VOLUME_TO_MESH")
    modifier.object, modifier.threshold, modifier.grid_name = volume_object, threshold, "HU"
    modifier.resolution_mode = "GRID"
    mesh = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", positions)
    return positions.reshape(-1, 3).astype(float)


@needs_openvdb
@pytest.mark.parametrize("affine", [np.diag([0.7, 0.7, 2.0, 1.0]), oblique()])
def test_a_volume_object_stands_where_the_patient_has_it(scene, tmp_path, affine):
    volume = ball(affine)
    finish(vdb_steps(volume, tmp_path / "ball.vdb", SCALE))
    obj = add_volume(scene, volume, tmp_path / "ball.vdb", SCALE, APPEARANCES["bone"])
    bpy.context.view_layer.update()
    assert obj.data.grids.load()
    assert [grid.name for grid in obj.data.grids] == ["HU"]
    grid = np.array(obj.matrix_world) @ np.array(obj.data.grids[0].matrix_object)
    grid[:3] /= SCALE
    corners = np.array([(x, y, z, 1) for x in (0, 22) for y in (0, 21) for z in (0, 23)], float)
    shift = [-0.5, -0.5, -0.5, 0] if bpy.app.version < (5, 0) else [0, 0, 0, 0]  # they show it half a voxel off
    assert np.abs(corners @ grid[:3].T - (corners + shift) @ affine[:3].T).max() < 1e-3  # mm


def rendered_by_cycles(scene, path, quick):
    """Opacity of every pixel.

    `quick` chooses even steps through the volume; what 5.0 does by default takes seconds to prepare.
    """
    render, scene.cycles.use_denoising = scene.render, False
    render.engine, render.film_transparent, render.filepath = "CYCLES", True, str(path)
    if bpy.app.version >= (5, 0):  # older ones have even steps alone
        scene.cycles.volume_biased = quick
    bpy.ops.render.render(write_still=True)
    pixels = np.array(bpy.data.images.load(str(path)).pixels[:])
    return pixels.reshape(render.resolution_y, render.resolution_x, 4)[..., 3]


@needs_openvdb
@pytest.mark.parametrize(("toward", "quick"), [((0, 0, 1), False), ((0, -1, 0), True)])
def test_cycles_shows_a_ball_where_it_is(scene, tmp_path, toward, quick):
    affine = np.diag([4.0, 4.0, 4.0, 1.0])
    volume = Volume((100 - 20 * distance_mm((16, 16, 16))).astype(np.float32), affine, name="ball", kind="HU")
    finish(vdb_steps(volume, tmp_path / "ball.vdb", SCALE))
    obj = add_volume(scene, volume, tmp_path / "ball.vdb", SCALE, APPEARANCES["bone"])
    numbers = {node.label: node.outputs[0] for node in obj.data.materials[0].node_tree.nodes if node.type == "VALUE"}
    for label, value in (("Threshold", 0.0), ("Width", 1.0), ("Density", 1e4)):
        numbers[label].default_value = value
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    direction, middle = Vector(toward), Vector([7.5 * 4.0 * SCALE] * 3)
    scene.camera, camera.location = camera, middle + 3 * direction
    camera.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    camera.data.type, camera.data.ortho_scale = "ORTHO", 0.64  # 1 mm a pixel
    scene.cycles.samples, scene.render.resolution_x, scene.render.resolution_y = 8, 64, 64
    alpha = rendered_by_cycles(scene, tmp_path / "ball.png", quick)
    rows, columns = np.indices(alpha.shape) - 31.5
    off = [float((axis * alpha).sum() / alpha.sum()) for axis in (columns, rows)]
    assert off == pytest.approx([0, 0], abs=0.2)  # mm; half a voxel is 2
    assert np.sqrt(alpha.sum() / np.pi) == pytest.approx(20, abs=0.5)


@needs_openvdb
def test_blenders_surface_of_the_volume_lies_on_ours(scene, tmp_path):
    volume = ball(np.diag([0.7, 0.7, 0.7, 1.0]))
    finish(vdb_steps(volume, tmp_path / "ball.vdb", SCALE))
    theirs = meshed(add_volume(scene, volume, tmp_path / "ball.vdb", SCALE, APPEARANCES["bone"]), 28.0) / SCALE
    ours = reconstruct(volume, ReconstructionSettings(threshold=28.0)).mesh.vertices
    # Blender's meshes adapt to flat parts: ends are compared, not vertices. The radius is 5.6 mm.
    for end in (np.min, np.max):
        assert np.abs(end(theirs, axis=0) - end(ours, axis=0)).max() < 0.03
    center = 0.7 * np.array([11.3, 10.7, 12.2])
    assert np.abs((theirs.min(axis=0) + theirs.max(axis=0)) / 2 - center).max() < 0.01


@needs_openvdb
def test_the_file_holds_the_values_bit_for_bit(tmp_path):
    volume = ball(np.eye(4))
    finish(vdb_steps(volume, tmp_path / "ball.vdb", SCALE))
    grid = vdb_writer().read(str(tmp_path / "ball.vdb"), "HU")
    values = np.zeros(volume.size, np.float32)
    grid.copyToArray(values)
    np.testing.assert_array_equal(values.transpose(2, 1, 0), volume.values)
    del grid


@needs_openvdb
def test_a_file_that_is_given_up_leaves_nothing(tmp_path):
    steps = vdb_steps(ball(np.eye(4)), tmp_path / "ball.vdb", SCALE)
    next(steps)
    steps.close()
    assert list(tmp_path.iterdir()) == []


@needs_openvdb
def test_threshold_and_window_reach_the_material_of_the_cts_volumes_alone(scene, tmp_path):
    volume = ball(np.eye(4))
    finish(vdb_steps(volume, tmp_path / "ball.vdb", SCALE))
    ours, other = (
        add_volume(scene, volume, tmp_path / "ball.vdb", SCALE, APPEARANCES["bone"], name) for name in ("ours", "other")
    )
    assert list(of_ct(scene, "ours")) == [ours]
    assert not list(of_ct(scene, ""))
    adjust(ours.data.materials[0], threshold=77.0, level=5.0)

    def numbers(obj):
        nodes = obj.data.materials[0].node_tree.nodes
        return {node.label: node.outputs[0].default_value for node in nodes if node.type == "VALUE"}

    assert numbers(ours) == {"Threshold": 77, "Width": 150, "Window": 500, "Level": 5, "Density": 200}
    assert numbers(other)["Threshold"] == APPEARANCES["bone"].threshold


@needs_openvdb
def test_cycles_renders_what_lies_above_the_threshold_and_nothing_below(scene, tmp_path):
    volume = ball(np.diag([4.0, 4.0, 4.0, 1.0]))
    finish(vdb_steps(volume, tmp_path / "ball.vdb", SCALE))
    obj = add_volume(scene, volume, tmp_path / "ball.vdb", SCALE, APPEARANCES["bone"])
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.location = camera, (obj.location.x, obj.location.y, obj.location.z + 3)
    scene.cycles.samples, scene.render.resolution_x, scene.render.resolution_y = 4, 48, 48
    covered = {}
    for threshold in (30.0, 500.0):
        adjust(obj.data.materials[0], threshold=threshold)
        obj.data.materials[0].node_tree.nodes  # noqa: B018  (a change is known when it is read again)
        covered[threshold] = float(rendered_by_cycles(scene, tmp_path / f"{threshold}.png", quick=True).mean())
    assert covered[30.0] > 0.01
    assert covered[500.0] == 0


@pytest.mark.parametrize("scale", [0.01, 1.0])
def test_blenders_numbers_are_the_patients_millimeters(scene, scale):
    volume = ball(np.diag([0.7, 0.7, 2.0, 1.0]))
    obj = add_reconstruction(reconstruct(volume, ReconstructionSettings(threshold=28.0)), scene, scale)
    bpy.context.view_layer.update()
    before = obj.matrix_world.copy()
    assert not shows_mm(scene, scale)
    set_units(scene, scale)
    assert shows_mm(scene, scale)
    assert obj.matrix_world == before
    millimeters = np.array(obj.dimensions) * scene.unit_settings.scale_length * 1000
    assert millimeters == pytest.approx([2 * 8 * 0.7, 2 * 8 * 0.7, 2 * 8 * 2.0], rel=0.02)
    shown = bpy.utils.units.to_string("METRIC", "LENGTH", 11.2e-3, precision=4)
    assert shown.endswith("mm") or shown.endswith("cm")
