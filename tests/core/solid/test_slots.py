# SPDX-License-Identifier: GPL-3.0-or-later
"""Many structures that touch: they share walls after a cut, and need few fields. Boxes in voxels of 1 mm."""

from itertools import pairwise

import numpy as np
import pytest
from solids import assert_parts

from ctmc_addon.core import Budget, MemoryLimitError, ReconstructionSettings, SettingsError, Volume, reconstruct_labels
from ctmc_addon.core.solid import Cut, SolidRequest, solid_parts
from ctmc_addon.core.solid.body import Body
from ctmc_addon.core.solid.slots import StructureSlots
from ctmc_addon.core.solid.structure import SolidStructure, lattice_of

SETTINGS = ReconstructionSettings(label=1)
COUNT = 6
SIDE = 8
LENGTHWISE = Cut((8, 8.3, 8), (0, 1, 0.2))


def row():
    """Boxes of 8 mm in a row along x, each touching the next."""
    values = np.zeros((16, 16, COUNT * SIDE + 8), np.uint8)
    for number in range(COUNT):
        values[4:12, 4:12, 4 + SIDE * number : 4 + SIDE * (number + 1)] = number + 1
    return Volume(values, np.eye(4), name="row", kind="label")


def square():
    """Four boxes of 8 mm that meet at an edge."""
    values = np.zeros((16, 24, 24), np.uint8)
    values[4:12, 4:12, 4:12], values[4:12, 4:12, 12:20] = 1, 2
    values[4:12, 12:20, 4:12], values[4:12, 12:20, 12:20] = 3, 4
    return Volume(values, np.eye(4), name="square", kind="label")


def vertices_of(mesh):
    return set(map(tuple, mesh.vertices))


def slots_of(volume, budget=None):
    """All labels on one lattice."""
    made = reconstruct_labels(volume, SETTINGS).surfaces
    lattice = lattice_of([SolidStructure("", result, volume) for result in made], SolidRequest())
    budget = budget or Budget()
    bodies = [Body(result.mesh, lattice.around(result.mesh.vertices, 0.0), budget, lattice) for result in made]
    return StructureSlots(bodies, lattice, 0.0, budget)


@pytest.mark.parametrize("solid", [{}, {"hollow": 2.0}, {"base": 1.0}], ids=["cut", "hollow", "base"])
def test_all_structures_that_touch_share_walls_after_a_cut(solid):
    labels = range(1, 4 if "base" in solid else COUNT + 1)
    parts = solid_parts(row(), SETTINGS, SolidRequest(cuts=(LENGTHWISE,), **solid), labels)
    assert [part.label_name for part in parts] == [f"label {n} {side}" for n in labels for side in "ab"]
    assert [part.settings.label for part in parts] == [n for n in labels for _ in "ab"]
    assert_parts([part.mesh for part in parts], crossings="base" not in solid)
    for one, other in pairwise(parts[::2]):
        assert len(vertices_of(one.mesh) & vertices_of(other.mesh)) > 20
    for number, part in enumerate(parts):
        middle = part.mesh.vertices[:, 0].mean()
        assert abs(middle - (3.5 + SIDE * (number // 2 + 0.5))) < 1, "parts are of their own structure"
        assert not part.notes or "structures touch" not in part.notes[0]
    if not solid:
        plain = reconstruct_labels(row(), SETTINGS, labels).surfaces
        both = [a.mesh.volume + b.mesh.volume for a, b in zip(parts[::2], parts[1::2], strict=True)]
        assert both == pytest.approx([result.mesh.volume for result in plain], rel=3e-3)


def test_structures_that_are_far_from_each_other_share_a_slot():
    group = slots_of(row())
    assert group.count <= 3
    for slot in range(group.count):
        own = [at for at, other in enumerate(group.slots) if other == slot]
        assert all(second - first > 1 for first, second in pairwise(own)), "neighbors have different ones"
    assert slots_of(square()).count == 4, "all of them meet"


def test_more_fields_than_one_extraction_has_are_refused_with_the_number_that_fits():
    group = slots_of(square())
    group.require_fields(16)
    with pytest.raises(SettingsError) as caught:
        group.require_fields(17)
    remedy = "choose at most 3 of them at once, or set interfaces to separate"
    assert str(caught.value) == f"4 structures touch and need 21 fields, more than 20; {remedy}"


def test_fields_that_do_not_fit_are_refused_with_the_number_that_fits():
    """Each slot takes 4 bytes for a sample of the lattice."""
    group = slots_of(square())
    with pytest.raises(MemoryLimitError, match="the fields of 4 structures that touch") as caught:
        slots_of(square(), Budget(bytes=1 << 20)).require_memory()
    assert str(caught.value).endswith("choose a region")
    needed = group.needed_bytes
    with pytest.raises(MemoryLimitError, match="choose at most 3 at once, or a region"):
        StructureSlots(
            group.bodies, group.lattice, 0.0, Budget(bytes=needed - 4 * group.lattice.samples)
        ).require_memory()
