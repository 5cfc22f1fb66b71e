# SPDX-License-Identifier: GPL-3.0-or-later
"""Several structures at once: boxes in voxels of 1 mm. One that cannot be made does not stop the others."""

import numpy as np
import pytest
from solids import assert_parts

from ctmc_addon.core import MeshError, ReconstructionSettings, SettingsError, SurfaceRequest, Volume, finish
from ctmc_addon.core.solid import Combination, Cut, Pegs, SolidRequest, solid_parts, solid_parts_steps

LABELS = ReconstructionSettings(label=1)
NAMES = {1: "box", 2: "plate", 3: "block"}
UP = Cut((10, 10, 8), (0, 0, 1))


def boxes():
    """A box of 12 mm with a plate of 2 mm on it, and a block of 10 mm beside."""
    values = np.zeros((20, 16, 36), np.uint8)
    values[2:14, 2:14, 2:14], values[14:16, 2:14, 2:14], values[3:13, 3:13, 20:30] = 1, 2, 3
    return Volume(values, np.eye(4), name="boxes", kind="label", label_names=NAMES)


def several(labels=(1, 2, 3), volume=None, **solid):
    """The parts' meshes by name, and what is left out."""
    requests = [SurfaceRequest(ReconstructionSettings(label=label)) for label in labels]
    parts, left_out = finish(solid_parts_steps(volume or boxes(), requests, SolidRequest(**solid)))
    assert_parts([part.mesh for part in parts])
    return {part.label_name: part.mesh for part in parts}, left_out


def test_a_structure_too_thin_for_a_hollow_is_left_out_with_its_reason():
    parts, left_out = several(hollow=2.0)
    assert list(parts) == ["box", "block"]
    assert [mesh.components for mesh in parts.values()] == [2, 2]
    [sentence] = left_out
    assert sentence.startswith("label 2 (plate) is left out: a wall of 2 mm leaves no hollow in plate, which is ")
    assert sentence.endswith(".")
    alone = solid_parts(boxes(), LABELS, SolidRequest(hollow=2.0), [1])[0].mesh
    assert parts["box"].volume == pytest.approx(alone.volume, rel=0.02)


def test_the_first_error_is_raised_where_all_are_needed_or_there_is_one():
    with pytest.raises(SettingsError, match="leaves no hollow in plate"):
        solid_parts(boxes(), LABELS, SolidRequest(hollow=2.0), [1, 2, 3])
    with pytest.raises(SettingsError, match=r"^a wall of 2 mm leaves no hollow in plate"):
        several((2,), hollow=2.0)


def test_nothing_made_at_all_is_an_error_with_the_first_reason():
    with pytest.raises(MeshError, match=r"^no structure of boxes can be made; label 1 \(box\) is left out: a wall of "):
        several(hollow=8.0)


@pytest.mark.parametrize(
    ("solid", "made", "left", "reason"),
    [
        ({"thicken": -1.5}, ["box", "block"], "plate", "nothing is left of plate; move the surface inward"),
        ({"thicken": -1.5, "hollow": 1.0}, ["box", "block"], "plate", "nothing is left of plate after --thicken"),
        ({"cuts": [UP], "pegs": Pegs(1, 4, 3)}, ["box a", "box b", "plate"], "block", "no peg of 4 mm and 3 mm length"),
    ],
)
def test_other_operations_leave_out_what_they_cannot_make(solid, made, left, reason):
    parts, left_out = several(**solid)
    assert list(parts) == made
    [sentence] = left_out
    assert f"({left}) is left out: {reason}" in sentence


def test_labels_without_a_voxel_are_left_out_as_plain_ones_are():
    parts, left_out = several((1, 3, 9), cuts=[UP])
    assert list(parts) == ["box a", "box b", "block a", "block b"]
    [sentence] = left_out
    assert sentence.startswith("label 9 is left out: ")


def test_a_combination_of_a_structure_that_is_left_out_is_left_out_too():
    combinations = [Combination("merge", "both", ("box", "plate")), Combination("merge", "rest", ("block", "both"))]
    with pytest.raises(MeshError, match="no structure of boxes can be made"):
        several(hollow=2.0, combinations=combinations)
    parts, left_out = several(hollow=2.0, combinations=combinations[:1])
    assert list(parts) == ["block"]
    assert left_out[0].startswith("label 2 (plate) is left out: ")
    assert left_out[1] == "both is left out: it needs plate, which is left out."


@pytest.mark.parametrize(
    ("combinations", "sentence"),
    [
        (
            [("subtract", "rest", ("both", "block")), ("merge", "both", ("box", "plate"))],
            "--subtract rest needs both, which --merge both makes later; give --merge both first",
        ),
        (
            [("merge", "both", ("box", "plate")), ("subtract", "rest", ("block", "1"))],
            "--subtract rest needs 1, which --merge both has taken; combine block, both",
        ),
        ([("merge", "both", ("box", "lid"))], "--merge both needs lid; the structures are box, plate, block"),
    ],
)
def test_combinations_that_name_no_structure_say_what_would_help(combinations, sentence):
    asked = [Combination(*each) for each in combinations]
    with pytest.raises(SettingsError) as caught:
        several(combinations=asked)
    assert str(caught.value) == sentence


def test_a_combination_may_use_the_name_of_an_earlier_one():
    asked = [Combination("merge", "both", ("box", "plate")), Combination("subtract", "rest", ("both", "2", "block"))]
    with pytest.raises(SettingsError, match="has taken"):
        several(combinations=asked)
    parts, left_out = several(combinations=[asked[0], Combination("subtract", "rest", ("both", "block"))])
    assert list(parts) == ["rest"]
    assert not left_out
    whole = several((1, 2), combinations=asked[:1])[0]["both"]
    assert parts["rest"].volume == pytest.approx(whole.volume, rel=1e-3)


def test_thickened_walls_of_a_structure_without_pegs_do_not_stop_the_others():
    cut = Cut((8, 8, 15), (0, 0, 1))  # Through the plate alone.
    parts, left_out = several((1, 2), cuts=(cut,), pegs=Pegs(2, 5.0, 5.0), least_wall=6.0)
    assert list(parts) == ["box"]
    assert "no peg of 5 mm" in left_out[0]


def test_one_of_two_that_touch_is_cut_without_pegs_with_a_note():
    cut = Cut((8, 8, 8), (1, 0, 0))
    requests = [SurfaceRequest(ReconstructionSettings(label=label)) for label in (1, 2)]
    parts, left_out = finish(solid_parts_steps(boxes(), requests, SolidRequest(cuts=(cut,), pegs=Pegs(2, 4.0, 4.0))))
    assert_parts([part.mesh for part in parts])
    assert left_out == []
    notes = {part.label_name: [note for note in part.notes if "no peg" in note] for part in parts}
    assert notes["box a"] == notes["box b"] == []
    assert len(notes["plate a"]) == len(notes["plate b"]) == 1
    assert notes["plate a"][0].startswith("no peg of 4 mm and 4 mm length fits on the cut at 8 8 8")
