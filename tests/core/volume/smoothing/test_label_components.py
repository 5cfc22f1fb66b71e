# SPDX-License-Identifier: GPL-3.0-or-later
"""Components of a label: those of a flood fill, on every density."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core.progress import finish
from ctmc_addon.core.volume.smoothing.label_components import label_components_steps


def flooded(mask: np.ndarray) -> list[set[tuple[int, int, int]]]:
    left = {(int(z), int(y), int(x)) for z, y, x in np.argwhere(mask)}
    found = []
    while left:
        front = [left.pop()]
        component = set(front)
        while front:
            z, y, x = front.pop()
            for place in ((z - 1, y, x), (z + 1, y, x), (z, y - 1, x), (z, y + 1, x), (z, y, x - 1), (z, y, x + 1)):
                if place in left:
                    left.remove(place)
                    component.add(place)
                    front.append(place)
        found.append(component)
    return found


@pytest.mark.parametrize("density", [0.05, 0.2, 0.31, 0.5, 0.9])
@pytest.mark.parametrize("shape", [(6, 9, 11), (1, 12, 7), (9, 1, 8), (7, 8, 1)])
def test_components_are_those_of_a_flood_fill(density, shape):
    mask = np.random.default_rng(int(100 * density)).random(shape) < density
    components = finish(label_components_steps(mask))
    expected = flooded(mask)
    z, y, x, number = components.samples(np.ones(len(components.voxels), bool))
    found = [set(zip(z[number == n].tolist(), y[number == n].tolist(), x[number == n].tolist(), strict=True))
             for n in range(len(components.voxels))]  # fmt: skip
    assert sorted(map(sorted, found)) == sorted(map(sorted, expected))
    assert components.voxels.tolist() == sorted(len(component) for component in expected)
    assert [len(component) for component in found] == components.voxels.tolist()
    low, high = components.boxes()
    for component, first, last in zip(found, low, high, strict=True):
        assert np.min(list(component), axis=0).tolist() == first.tolist()
        assert np.max(list(component), axis=0).tolist() == last.tolist()
