# SPDX-License-Identifier: GPL-3.0-or-later
"""Samples of a surface in their tree: each has a place, and the walls of a few of them are whole."""

import numpy as np
import pytest
from meshes import as_mesh, icosphere, joined

from ctmc_addon.core import Budget, finish
from ctmc_addon.core.mesh.distance.surface_samples import surface_samples_steps
from ctmc_addon.core.solid.printing.walls import walls_steps


@pytest.mark.parametrize(("levels", "longest"), [(2, 100.0), (2, 1.0), (5, 100.0)])
def test_every_sample_has_a_place_of_its_own(levels, longest):
    mesh = icosphere(levels, 10.0)
    samples = finish(surface_samples_steps(mesh, longest))
    assert len(samples.places) == len(samples.areas)
    assert (samples.tree.order[samples.places] == np.arange(len(samples.areas))).all()
    at = samples.tree.positions[:, samples.places[: len(mesh.vertices)]].T + samples.tree.middle
    np.testing.assert_allclose(at, mesh.vertices, atol=1e-5)
    assert samples.areas.sum() == pytest.approx(mesh.area)


def test_all_of_a_shell_of_few_triangles_is_wall():
    outer, inner = icosphere(3, 12.0), icosphere(3, 11.0)
    shell = joined(outer, as_mesh(inner.vertices, inner.faces[:, ::-1]))
    walls = finish(walls_steps(shell, Budget(threads=1), 10.0))
    assert walls.areas.sum() == pytest.approx(shell.area, rel=1e-6)
    assert walls.share_below(1.1) == pytest.approx(1, abs=1e-6)
