# SPDX-License-Identifier: GPL-3.0-or-later
"""The shading of the evaluated surface against the gradient, which is radial on a ball."""

from __future__ import annotations

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.surface import (
    add_reconstruction,
    apply_shape_and_modifiers,
    mesh_data as meshes,
    refresh_normals,
)
from ctmc_addon.blender.surface.evaluate import evaluated_object
from ctmc_addon.core import MeshError, finish


def evaluated(thing):
    """Corner normals of the evaluated mesh, (corners, 3), and the vertex of each corner."""
    with evaluated_object(thing) as (seen, _):
        return meshes.corner_normals(seen.data), meshes.read_triangles(seen.data).ravel()


def degrees(one, two):
    """Angles between unit vectors, (n, 3) each."""
    sine = np.sqrt((np.cross(one, two).astype(np.float64) ** 2).sum(axis=1))
    return np.degrees(np.arctan2(sine, (one * two).sum(axis=1)))


def off_gradient(thing, result):
    """Degrees between every corner's normal and the gradient at its vertex."""
    seen, vertex = evaluated(thing)
    return degrees(seen, result.surface.normals[vertex])


def off_radius(thing):
    """Degrees between every corner's normal and the ball's radius there."""
    seen, vertex = evaluated(thing)
    with evaluated_object(thing) as (shown, _):
        corners = meshes.read_positions(shown.data)[vertex] + np.array(thing.location)
    return degrees(seen, corners / np.sqrt((corners**2).sum(axis=1))[:, None])


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_normals_are_the_gradients_at_the_set_alpha(scene, ball, alpha):
    result = ball(alpha=alpha)
    assert off_gradient(add_reconstruction(result, scene), result).max() < 0.5


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_normals_are_the_gradients_once_a_moved_alpha_has_come_to_rest(scene, ball, alpha):
    result = ball(alpha=0.25)
    thing = add_reconstruction(result, scene)
    thing.data.shape_keys.key_blocks["alpha"].value = alpha
    refresh_normals(thing)
    assert off_gradient(thing, result).max() < 0.5


@pytest.mark.skipif(not meshes.FREE_NORMALS, reason="before Blender 4.5 normals wait until alpha has come to rest")
@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_free_normals_need_no_rest(scene, ball, alpha):
    result = ball(alpha=0.25)
    thing = add_reconstruction(result, scene)
    thing.data.shape_keys.key_blocks["alpha"].value = alpha
    assert off_gradient(thing, result).max() < 0.5


def test_the_gradient_of_a_ball_is_its_radius(scene, ball):
    assert off_radius(add_reconstruction(ball(alpha=1.0), scene)).max() < 1.0


@pytest.mark.parametrize("alpha", [0.0, 0.5, 1.0])
def test_normals_under_decimate_are_the_gradients_or_blenders_own(scene, ball, alpha):
    thing = add_reconstruction(ball(alpha=alpha, simplifier="decimate", reduction=0.5), scene)
    # Blender's own normals on the stairs of alpha 0 are up to 40 degrees off; a wrong encoding 79 and more.
    mean, most = (2.0, 6.0) if meshes.FREE_NORMALS else (14.0, 45.0)
    assert off_radius(thing).mean() < mean
    assert off_radius(thing).max() < most


@pytest.mark.parametrize("decimated", [False, True])
def test_a_final_mesh_keeps_its_shading(scene, ball, decimated):
    extra = {"simplifier": "decimate", "reduction": 0.5} if decimated else {}
    thing = add_reconstruction(ball(alpha=0.5, **extra), scene)
    before = off_radius(thing)
    apply_shape_and_modifiers(thing)
    assert abs(off_radius(thing).mean() - before.mean()) < 0.5
    assert off_radius(thing).max() < before.max() + 2.0


def test_normals_of_the_mesh_are_left_to_blender(scene, ball):
    thing = add_reconstruction(ball(alpha=1.0, normals="mesh"), scene)
    assert not thing.data.has_custom_normals
    assert off_radius(thing).max() < 6.0


def test_a_mesh_that_is_left_half_made_is_gone_again_and_one_that_undo_took_is_said():
    positions, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32)
    edges = finish(meshes.edges_steps(faces, 3))
    before = set(bpy.data.meshes)
    making = meshes.new_mesh_steps("half", positions, faces, edges)
    next(making)
    (half,) = set(bpy.data.meshes) - before
    assert (len(half.edges), len(half.polygons), half.validate()) == (3, 0, False)
    making.close()
    assert set(bpy.data.meshes) == before
    making = meshes.new_mesh_steps("taken", positions, faces, edges)
    next(making)
    bpy.data.meshes.remove(bpy.data.meshes["taken"])
    with pytest.raises(MeshError, match="make it again"):
        next(making)
