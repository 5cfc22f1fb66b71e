# SPDX-License-Identifier: GPL-3.0-or-later
"""Which label a stored value stands for: the rule against plain Python, and every way to labels against integers."""

import pickle

import numpy as np
import pytest

from ctmc_addon.core import Budget, LabelError, ReconstructionSettings, Volume, finish, reconstruct, reconstruct_labels
from ctmc_addon.core.volume import (
    SliceReader,
    ValuesInMemory,
    WholeNumbers,
    chosen_labels_steps,
    inside_values_steps,
    label_extents_steps,
    not_a_label_steps,
    otsu,
)
from ctmc_addon.core.volume.labels import extents as labels_of_volume

SCALE = 117 / 255  # of 117 as the largest of 8 bits


def organs(dtype=np.uint8):
    values = np.zeros((12, 12, 12), dtype)
    values[1:5, 1:5, 1:5], values[6:11, 1:5, 1:5], values[1:5, 6:11, 6:11] = 1, 6, 117
    return values


def stored(scale):
    """The labels as a file of whole numbers with a scale holds them, and what they are read as."""
    return (np.rint(organs() / scale) * scale).astype(np.float32)


def label_by_the_rule(value, step):
    """The nearest whole number, None where it is too far or two are as near."""
    nearest = round(value)
    allowed = max(abs(value) / 1000, step / 2 if step < 1 else 0)
    return nearest if abs(value - nearest) <= allowed and abs(value - nearest) < 0.5 else None


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("step", [0.0, 0.01, SCALE, 0.99, 1.5, 3.92])
def test_a_value_is_the_label_that_the_rule_says(dtype, step):
    rng = np.random.default_rng(7)
    size = rng.choice([1.0, 10.0, 100.0, 1000.0, 60000.0], 400)
    values = (np.rint(rng.random(400) * size) + rng.normal(0, 0.1, 400) * rng.choice([0, 1e-6, 0.01, 1], 400)).astype(
        dtype
    )
    values[::3] *= -1
    for value in values:
        numbers = WholeNumbers(step, "organs")
        expected = label_by_the_rule(float(value), step)
        if expected is None:
            with pytest.raises(LabelError, match=r"^organs cannot be read as labels: its value .* is not within"):
                numbers.of(np.array([value]))
        else:
            assert numbers.of(np.array([value])).tolist() == [expected]
            assert bool(numbers.notes) == (expected != value)


@pytest.mark.parametrize("scale", [1.0, 0.4, 2 / 3, SCALE, 117 / 32767, 0.999])
def test_any_whole_number_is_found_again_behind_a_scale(scale):
    """Half a step at most lies between what was written and what is read, for any scale below 1 a whole number."""
    labels = np.arange(2000, dtype=np.float64)
    read = (np.rint(labels / scale) * np.float64(np.float32(scale))).astype(np.float32)
    step = 0.0 if scale == 1 else float(np.float32(scale))
    np.testing.assert_array_equal(WholeNumbers(step, "organs").of(read), labels)


def test_whole_values_and_integers_are_the_same_array():
    for values in (organs(), organs(np.float32), np.array([2.0**31, 3e9, -4.0]), organs(np.uint64) + 2**63):
        numbers = WholeNumbers(0.3, "organs")
        assert numbers.of(values) is values
        assert numbers.notes == ()


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ([0, 1, 0.37, 0.9], "its value 0.37 is not within 0.00037 of a whole number"),
        ([600.5, 0.1], "its value 600.5 is not within 0.5 of a whole number"),
        ([1, np.inf], "its value inf is beyond 9007199254740991, the largest label"),
        ([-np.inf, 0.5], "its value 0.5 is not within 0.0005 of a whole number"),
        ([1e300, 1], r"its value 1e\+300 is beyond 9007199254740991, the largest label"),
    ],
)
def test_the_first_value_that_is_no_label_is_named_with_limit_and_remedy(values, sentence):
    with pytest.raises(LabelError, match=f"^organs cannot .*: {sentence}; give a threshold, or save its labels as int"):
        WholeNumbers(0.0, "organs").of(np.array(values, np.float64))


def test_nan_has_no_label_and_a_note_says_so():
    numbers = WholeNumbers(0.0, "organs")
    assert numbers.of(np.array([np.nan, 3, 5.9999995], np.float32)).tolist() == [0, 3, 6]
    assert numbers.notes == (
        "Values that are not whole were read as the nearest label, such as 5.99999952 as 6.",
        "Voxels whose value is NaN were read as having no label.",
    )


@pytest.mark.parametrize("values", [stored(SCALE), np.where(organs() == 6, np.float32(5.9999995), organs())])
@pytest.mark.parametrize("kind", ["gray value", "label"])
@pytest.mark.parametrize("threads", [1, 3])
def test_every_way_to_labels_gives_what_integers_give(values, kind, threads, monkeypatch):
    monkeypatch.setattr(labels_of_volume, "SLAB_VALUES", 300)  # several slabs
    whole = Volume(organs(), np.eye(4), kind=kind)
    volume = Volume(ValuesInMemory(values.astype(np.float32), SCALE), np.eye(4), kind=kind)
    budget = Budget(threads)
    assert finish(label_extents_steps(volume, None, threads)) == finish(label_extents_steps(whole))
    assert finish(chosen_labels_steps(volume, ["all"])) == (1, 6, 117)
    for interfaces in ("separate", "shared"):
        settings = ReconstructionSettings(interfaces=interfaces, close_border=True)
        made, expected = (reconstruct_labels(each, settings, budget=budget) for each in (volume, whole))
        for one, other in zip(made.surfaces, expected.surfaces, strict=True):
            assert one.settings.label == other.settings.label
            np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
            np.testing.assert_array_equal(one.mesh.faces, other.mesh.faces)
            assert sum("were read as the nearest label" in note for note in one.notes) == 1
            assert not any("nearest label" in note for note in other.notes)
    for smoothing in ("none", "gaussian", "constrained"):
        settings = ReconstructionSettings(label=6, smoothing=smoothing)
        one, other = reconstruct(volume, settings, budget), reconstruct(whole, settings, budget)
        np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
        assert {*one.notes} - {*other.notes} == {note for note in one.notes if "nearest label" in note} != set()
    ct = Volume(np.arange(12**3).reshape(12, 12, 12), np.eye(4))
    assert finish(inside_values_steps(ct, volume, 117)) == finish(inside_values_steps(ct, whole, 117))


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_note_and_the_refusal_do_not_depend_on_threads(threads, monkeypatch):
    monkeypatch.setattr(labels_of_volume, "SLAB_VALUES", 144)  # a slab for each slice
    values = np.arange(12**3, dtype=np.float64).reshape(12, 12, 12) % 40
    values *= 1 + np.linspace(-9e-4, 9e-4, 12)[:, None, None]
    volume = Volume(values, np.eye(4))
    finish(label_extents_steps(volume, None, threads))
    assert labels_of_volume.label_notes(volume, ((0, 12), (0, 12), (0, 12))) == (
        "Values that are not whole were read as the nearest label, such as 38.9649 as 39.",
    )
    values = values.copy()
    values[3, 4, 5], values[3, 4, 6], values[9] = 7.25, 8.25, 9.25
    with pytest.raises(LabelError, match=r"its value 7\.25 is"):
        finish(label_extents_steps(Volume(values, np.eye(4)), None, threads))


def test_a_region_without_the_value_that_is_no_label_has_its_labels():
    values = organs(np.float32)
    values[11, 11, 11] = 0.5
    volume = Volume(values, np.eye(4))
    region = ((0, 6), (0, 6), (0, 11))
    assert list(finish(label_extents_steps(volume, region))) == [1, 6]
    with pytest.raises(LabelError, match=r"its value 0\.5 "):
        reconstruct(volume, ReconstructionSettings(label=6))


class CountedSlices(SliceReader):
    """Values in memory that count how often each slice is read."""

    def __init__(self, values):
        self.values, self.shape, self.dtype = values, values.shape, values.dtype
        self.counts = np.zeros(len(values), int)

    def fill(self, out, slices, rows, columns):
        self.counts[slices.start : slices.stop] += 1
        out[...] = self.values[slices.start : slices.stop, rows.start : rows.stop, columns.start : columns.stop]


def test_labels_are_rounded_where_they_are_read_and_no_slice_is_read_for_that_alone():
    reader = CountedSlices(stored(SCALE))
    reader.value_step = SCALE
    volume = Volume(reader, np.eye(4))
    assert volume.as_labels.as_labels is volume.as_labels
    assert not reader.counts.any()
    finish(label_extents_steps(volume))
    assert (reader.counts == 1).all()


def test_integers_are_their_own_labels_and_a_copy_keeps_the_step():
    whole = Volume(organs(), np.eye(4))
    assert whole.as_labels is whole
    volume = Volume(ValuesInMemory(stored(SCALE), SCALE), np.eye(4))
    for copy in (
        pickle.loads(pickle.dumps(volume)),
        finish(volume.in_memory_steps()),
        volume.cropped((0,) * 3, (12,) * 3),
    ):
        np.testing.assert_array_equal(copy.as_labels.values, organs())
    np.testing.assert_array_equal(finish(volume.in_memory_steps((2, 3, 1))).as_labels.values, organs()[:, ::3, ::2])
    np.testing.assert_array_equal(volume.values, stored(SCALE))  # which stay


def test_labels_stored_as_floats_have_the_threshold_of_integers():
    floats = Volume(ValuesInMemory(organs(np.float32), is_whole=True), np.eye(4), kind="label")
    assert reconstruct(floats, ReconstructionSettings()).threshold == otsu(organs()) == 61.5


def test_the_first_value_that_is_no_label_is_found_for_a_message():
    values = organs(np.float32)
    assert finish(not_a_label_steps(Volume(values, np.eye(4)))) == ""
    assert finish(not_a_label_steps(Volume(organs(), np.eye(4)))) == ""
    values[7, 3, 2:] = 0.25, 0.75, *values[7, 3, 4:]
    assert finish(not_a_label_steps(Volume(values, np.eye(4)))) == "0.25"
