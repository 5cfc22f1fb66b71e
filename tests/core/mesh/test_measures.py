"""Measures taken in steps are those the mesh gives at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import marching_cubes
from ctmc_addon.core.mesh import measures
from ctmc_addon.core.progress import finish


@pytest.fixture(params=[1 << 18, 50])
def block(request, monkeypatch):
    """Faces at once: all of them, and few."""
    monkeypatch.setattr(measures, "FACES_AT_ONCE", request.param)
    monkeypatch.setattr(measures._blocks, "__defaults__", (request.param,))


@pytest.mark.parametrize("close", [True, False])
def test_measures_in_steps_are_the_meshs_own(block, close):
    values = np.random.default_rng(3).integers(0, 100, (9, 10, 11)).astype(np.uint8)
    mesh = marching_cubes(values, 60.5, close_border=close)
    found = finish(measures.measures_steps(mesh))
    assert found.area == pytest.approx(mesh.area)
    assert found.closed == mesh.closed == close
    assert (found.faces, found.euler, found.parts) == (len(mesh.faces), mesh.euler, mesh.parts)
    if close:
        assert found.volume == pytest.approx(mesh.volume)


def test_a_mesh_with_one_triangle_turned_over_is_not_closed(block):
    mesh = marching_cubes(np.pad(np.ones((2, 2, 2), np.uint8), 2), 0.5)
    faces = mesh.faces.copy()
    faces[0] = faces[0, ::-1]
    assert finish(measures.measures_steps(mesh)).closed
    assert not finish(measures.measures_steps(replace(mesh, faces=faces))).closed
