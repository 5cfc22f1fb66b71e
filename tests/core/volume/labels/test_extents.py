# SPDX-License-Identifier: GPL-3.0-or-later
"""The boxes of all labels against the obvious search, and labels chosen by name."""

import numpy as np
import pytest

from ctmc_addon.core import LabelError, ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.volume import chosen_labels_steps, label_extents_steps
from ctmc_addon.core.volume.labels import extents as labels_of_volume


def obvious_extents(values, box):
    """The same by looking for every label in the whole array."""
    (x, x1), (y, y1), (z, z1) = box
    inside = values[z:z1, y:y1, x:x1]
    out = {}
    for label in np.unique(inside[np.isfinite(inside)]).tolist():
        if label and label == int(label):
            places = np.nonzero(inside == label)
            lows = [int(axis.min()) + first for axis, first in zip(places, (z, y, x), strict=True)]
            highs = [int(axis.max()) + 1 + first for axis, first in zip(places, (z, y, x), strict=True)]
            out[int(label)] = (len(places[0]), tuple(zip(lows, highs, strict=True))[::-1])
    return out


@pytest.mark.parametrize("dtype", ["bool", "u1", "i2", "u2", "i4", "i8", "u8", "f4", "f8"])
@pytest.mark.parametrize("threads", [1, 3])
def test_every_label_has_the_box_and_the_voxels_that_a_plain_search_finds(dtype, threads, monkeypatch):
    monkeypatch.setattr(labels_of_volume, "SLAB_VALUES", 300)  # several slabs
    rng = np.random.default_rng(5)
    values = (rng.random((11, 9, 13)) < 0.2) * rng.integers(0, 60 if dtype != "bool" else 2, (11, 9, 13))
    values = values.astype(dtype)
    if values.dtype.kind == "i":
        values[4, 5, 6:] = -3
    if values.dtype.kind == "f":
        values[2, 3, 4:7] = np.nan, -1.0, 7.0
    volume = Volume(values, np.eye(4), kind="label")
    for box in (((0, 13), (0, 9), (0, 11)), ((2, 7), (1, 9), (3, 8))):
        found = finish(label_extents_steps(volume, box, threads))
        assert found == obvious_extents(values, box)
        assert list(found) == sorted(found)


def test_values_in_another_byte_order_or_layout_have_the_same_boxes():
    values = np.random.default_rng(1).integers(0, 4, (6, 7, 8))
    expected = finish(label_extents_steps(Volume(values, np.eye(4))))
    for other in (values.astype(">i2"), np.asfortranarray(values), values[::-1][::-1]):
        assert finish(label_extents_steps(Volume(other, np.eye(4)))) == expected


NAMES = {1: "Kidney_left", 2: "kidney right", 3: "Spleen", 4: "lesion", 7: "lesion"}


def named_volume():
    values = np.zeros((4, 5, 6), np.uint8)
    values[1, 2, [0, 2, 4]] = 3, 1, 7
    return Volume(values, np.eye(4), kind="label", label_names=NAMES, name="abdomen")


@pytest.mark.parametrize(
    ("choices", "labels"),
    [
        (["SPLEEN"], (3,)),
        (["kidney left", 9, "Kidney_Right"], (1, 9, 2)),
        (["lesion"], (4, 7)),
        (["all"], (1, 3, 7)),
        ([7, "all", "spleen"], (7, 1, 3)),
    ],
)
def test_labels_are_chosen_by_number_by_name_or_all_at_once(choices, labels):
    assert finish(chosen_labels_steps(named_volume(), choices)) == labels


def test_an_unknown_name_is_answered_with_those_close_to_it():
    with pytest.raises(LabelError, match=r"'splen'; similar names are Spleen"):
        finish(chosen_labels_steps(named_volume(), ["splen"]))
    with pytest.raises(LabelError, match=r"'kidney'; similar names are .*Kidney_left"):
        finish(chosen_labels_steps(named_volume(), ["kidney"]))
    with pytest.raises(LabelError, match=r"'aorta'; there are Kidney_left, kidney right, Spleen, lesion$"):
        finish(chosen_labels_steps(named_volume(), ["aorta"]))
    with pytest.raises(LabelError, match="have no names"):
        finish(chosen_labels_steps(Volume(named_volume().values, np.eye(4)), ["aorta"]))


def test_a_label_of_hounsfield_units_is_refused():
    values = np.random.default_rng(0).integers(-1000, 1000, (6, 6, 6)).astype(np.int16)
    volume = Volume(values, np.eye(4), kind="HU", name="ct")
    with pytest.raises(LabelError, match="ct holds HU, which are densities and not labels"):
        reconstruct(volume, ReconstructionSettings(label=99))
    with pytest.raises(LabelError, match="HU"):
        finish(chosen_labels_steps(volume, ["all"]))
