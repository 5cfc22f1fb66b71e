# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")


from ctmc_addon.blender.surface.decimate import decimated
from ctmc_addon.core.mesh import surface_distance


@pytest.mark.usefixtures("scene")
def test_decimate_meets_the_number_near_the_surface_and_leaves_nothing_behind(torus):
    mesh = torus(rings=96, sides=48).mesh
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "scenes")}
    small, seconds = decimated(mesh, len(mesh.faces) // 2)
    assert abs(len(small.faces) - len(mesh.faces) // 2) <= 2
    assert small.closed
    assert seconds > 0
    assert surface_distance(small, mesh).mean < 0.1
    np.testing.assert_allclose(small.vertices.mean(axis=0), mesh.vertices.mean(axis=0), atol=0.5)
    assert {name: len(getattr(bpy.data, name)) for name in before} == before
