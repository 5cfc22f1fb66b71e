# SPDX-License-Identifier: GPL-3.0-or-later
"""Backgrounds of the studio: what a camera sees beside the surfaces, and that none is left behind."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.scene.background import BACKGROUNDS, NAME, show_background

SIDE = 33  # Pixels of a picture.


@pytest.fixture
def empty(scene, tmp_path):
    """A scene with a camera alone, rendered with few samples."""
    eye = bpy.data.objects.new("eye", bpy.data.cameras.new("eye"))
    eye.data.type = "ORTHO"
    scene.collection.objects.link(eye)
    scene.camera = eye
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    scene.view_settings.view_transform = "Raw"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(tmp_path / "picture.exr")
    return scene


def picture(scene):
    """The pixels of a render, (rows, columns, RGBA)."""
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:]).reshape(SIDE, SIDE, 4)
    bpy.data.images.remove(image)
    return pixels


@pytest.mark.parametrize("name", list(BACKGROUNDS))
def test_the_camera_sees_the_colors_of_a_background(empty, name):
    show_background(empty, name)
    shown, background = picture(empty), BACKGROUNDS[name]
    if background.transparent:
        assert (shown == 0.0).all()
        return
    assert (shown[..., 3] == 1.0).all()
    corner, middle = shown[0, 0, :3], shown[18, 16, :3]
    assert np.abs(middle - background.middle).max() < 0.01
    if background.middle == background.edge:
        assert np.ptp(shown[..., :3], axis=(0, 1)).max() == 0.0
    else:
        assert np.abs(corner - background.edge).max() < 0.01


def test_a_background_replaces_the_one_before_and_leaves_other_worlds(empty):
    own = bpy.data.worlds.new("mine")
    empty.world = own
    for name in (*BACKGROUNDS, *BACKGROUNDS):
        show_background(empty, name)
    assert sorted(world.name for world in bpy.data.worlds) == [NAME, "mine"]
    show_background(empty, "WHITE")
    assert not empty.render.film_transparent
