# SPDX-License-Identifier: GPL-3.0-or-later
import numpy as np

from ctmc_addon.core.mesh.vectors import cross, dot


def test_products_of_columns_are_those_of_numpy():
    u, v = np.random.default_rng(1).normal(size=(2, 3, 50))
    np.testing.assert_allclose(cross(u, v).T, np.cross(u.T, v.T), atol=1e-15)
    np.testing.assert_allclose(dot(u, v), (u * v).sum(axis=0), atol=1e-15)
