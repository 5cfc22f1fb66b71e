# SPDX-License-Identifier: GPL-3.0-or-later
"""Components of a label: those of a flood fill, on every density."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core.progress import finish
from ctmc_addon.core.smoothing.label_components import label_components_steps


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


def places(components):
    """The samples of every component, sorted, with its label."""
    z, y, x, number = components.samples(np.ones(len(components.voxels), bool))
    found = [
        (
            int(label),
            sorted(zip(z[number == n].tolist(), y[number == n].tolist(), x[number == n].tolist(), strict=True)),
        )
        for n, label in enumerate(components.label)
    ]
    return sorted(found)


@pytest.mark.parametrize("labels", [2, 5])
def test_the_components_of_all_labels_are_those_of_each(labels):
    values = np.random.default_rng(labels).integers(0, labels + 1, (7, 11, 13)).astype(np.uint8)
    together = finish(label_components_steps(values))
    alone = []
    for label in range(1, labels + 1):
        components = finish(label_components_steps(values == label))
        assert components.label.all()
        alone += [(label, samples) for _, samples in places(components)]
    assert places(together) == sorted(alone)
    assert (np.diff(together.voxels) >= 0).all()


def test_some_components_keep_their_samples_where_they_are_moved():
    values = np.random.default_rng(3).integers(0, 4, (6, 9, 10)).astype(np.uint8)
    components = finish(label_components_steps(values))
    selected = (components.label == 2) & (components.voxels < 5)
    some = components.select(selected).moved(2, -1, 3)
    z, y, x, _ = components.samples(selected)
    assert [each.tolist() for each in some.samples(np.ones(len(some.voxels), bool))[:3]] == [
        (z + 2).tolist(), (y - 1).tolist(), (x + 3).tolist()
    ]  # fmt: skip
    assert some.voxels.tolist() == components.voxels[selected].tolist()
    low, high = components.boxes()
    assert np.array_equal(some.boxes(), [low[selected] + (2, -1, 3), high[selected] + (2, -1, 3)])
