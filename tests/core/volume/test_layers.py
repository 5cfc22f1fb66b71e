# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that overlap, in layers of a volume: each is found, measured and reconstructed as if it were alone."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from volumes import label_mask

from ctmc_addon.core import Budget, CtmcError, ReconstructionSettings, Volume, finish, reconstruct, reconstruct_labels
from ctmc_addon.core.volume import ValuesInMemory, label_extents_steps, volume_statistics_steps

SETTINGS = ReconstructionSettings()


def body_and_liver():
    """A body, a kidney beside a liver in it, and the liver in a layer of its own."""
    first, second = np.zeros((2, 20, 22, 24), np.uint8)
    first[2:18, 2:20, 2:22] = 1
    first[0, 0, :5] = 9
    second[5:12, 5:12, 5:12] = 2
    names = {1: "body", 2: "liver", 9: "table"}
    return Volume(
        first, np.diag([1.0, 1.0, 2.0, 1.0]), kind="label", label_names=names, layers=(ValuesInMemory(second),)
    )


def test_every_label_is_found_whole_in_a_part_and_at_a_stride():
    volume = body_and_liver()
    extents = finish(label_extents_steps(volume))
    assert {label: extent.voxels for label, extent in extents.items()} == {1: 16 * 18 * 20, 2: 7**3, 9: 5}
    assert extents[2].box == ((5, 12), (5, 12), (5, 12))
    part = volume.part(((4, 14), (4, 14), (4, 9)))
    assert label_mask(part, 2).sum() == 7 * 7 * 4
    assert label_mask(part, 1).all()
    coarse = finish(volume.in_memory_steps((2, 2, 1)))
    assert (label_mask(coarse, 2) == label_mask(volume, 2)[:, ::2, ::2]).all()
    again = pickle.loads(pickle.dumps(part))
    assert (label_mask(again, 2) == label_mask(part, 2)).all()
    assert finish(volume_statistics_steps(volume)).labels == ((1, 5760), (2, 343), (9, 5))


@pytest.mark.parametrize("smoothing", ["none", "constrained", "gaussian"])
def test_a_label_in_a_layer_has_the_surface_that_it_has_alone(smoothing):
    volume = body_and_liver()
    settings = ReconstructionSettings(smoothing=smoothing, label=2)
    whole, alone = reconstruct(volume, settings), reconstruct(volume.each_layer[1], settings)
    assert whole.mesh.vertices.tobytes() == alone.mesh.vertices.tobytes()
    assert whole.mesh.faces.tobytes() == alone.mesh.faces.tobytes()
    assert whole.label_name == "liver"


def test_all_labels_are_made_from_all_layers():
    made = reconstruct_labels(body_and_liver(), SETTINGS, [1, 2], Budget(threads=2)).surfaces
    assert [result.label_name for result in made] == ["body", "liver"]
    for result, voxels in zip(made, (5760, 343), strict=True):
        assert result.mesh.closed
        assert result.mesh.volume == pytest.approx(2 * voxels, rel=0.001)


def test_a_label_that_no_layer_has_is_refused_with_those_of_all():
    with pytest.raises(CtmcError, match="label 3 is empty here; the labels are 1, 2, 9"):
        reconstruct(body_and_liver(), ReconstructionSettings(label=3))


def test_another_overlapping_label_is_another_volume():
    volume = body_and_liver()
    alone = volume.each_layer[0]
    prints = [finish(volume_statistics_steps(one)).fingerprint for one in (volume, alone)]
    assert prints[0] != prints[1]
