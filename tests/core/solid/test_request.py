# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests for solids: plain data, and refusals in a sentence."""

from __future__ import annotations

import json

import pytest

from ctmc_addon.core import SettingsError
from ctmc_addon.core.solid import MOST_CUTS, Combination, Combining, Cut, Drain, Pegs, SolidRequest

FULL = SolidRequest(
    thicken=-0.5,
    hollow=2,
    drains=(Drain(4), Drain(3.5, (0, -1, 2))),
    cuts=(Cut((0, 0, 10), (0, 0, 1)), Cut((1, 2, 3), (1, 0, 0))),
    pegs=Pegs(3, 6, 8, 0.15),
    combinations=(
        Combination(Combining.MERGE, "both", ("left", "2")),
        Combination(Combining.SUBTRACT, "rest", ("both", "tumor")),
        Combination(Combining.INTERSECT, "overlap", ("both", "rest")),
    ),
    base=3,
    least_wall=1.2,
    bed=(220, 220, 250),
)


def test_a_request_comes_back_from_its_json():
    plain = json.loads(json.dumps(FULL.to_dict()))
    assert plain == FULL.to_dict()
    assert SolidRequest.from_dict(plain) == FULL
    assert hash(SolidRequest.from_dict(plain)) == hash(FULL)
    assert plain["combinations"][1] == {"how": "subtract", "name": "rest", "of": ["both", "tumor"]}
    assert plain["drains"] == [{"diameter": 4.0}, {"diameter": 3.5, "point": [0.0, -1.0, 2.0]}]
    assert plain["pegs"] == {"count": 3, "diameter": 6.0, "length": 8.0, "clearance": 0.15}


def test_defaults_are_left_out_and_change_no_shape():
    assert SolidRequest().to_dict() == {}
    assert not SolidRequest(bed=(1, 2, 3))
    assert SolidRequest(thicken=-1)
    assert SolidRequest(bed=[1, 2, 3]).to_dict() == {"bed": [1.0, 2.0, 3.0]}


def test_lists_are_kept_as_tuples():
    listed = SolidRequest(cuts=[Cut([0, 0, 1], [0, 1, 0])], drains=[Drain(2, [1, 2, 3])])
    assert listed == SolidRequest(cuts=(Cut((0, 0, 1), (0, 1, 0)),), drains=(Drain(2, (1, 2, 3)),))
    assert isinstance(hash(listed), int)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: SolidRequest(thicken=2000), "thicken must be from -1000 to 1000, not 2000"),
        (lambda: SolidRequest(hollow=-1), "hollow must be from 0 to 1000, not -1"),
        (lambda: SolidRequest(hollow=float("nan")), "hollow must be a finite number, not nan"),
        (lambda: SolidRequest(bed=(200, 0, 200)), "bed must be above 0, not 0"),
        (lambda: SolidRequest(drains=(Drain(3),)), "a drain without a point opens a hollow; give the wall"),
        (lambda: SolidRequest(pegs=Pegs(2)), "pegs join the two sides of a cut; add a cut, or leave out the pegs"),
        (lambda: SolidRequest(cuts=(Cut((0, 0, 0), (0, 0, 1)),) * 9), f"9 cuts are too many; give at most {MOST_CUTS}"),
        (lambda: Drain(0), "the diameter of a drain is above 0 and at most 1000 mm, not 0"),
        (lambda: Drain(1, (0, 0)), "the point of a drain is 0 0; give three numbers, mm"),
        (lambda: Cut((0, 0, float("inf")), (0, 0, 1)), "the point of a cut is 0 0 inf; give three numbers, mm"),
        (lambda: Cut((0, 0, 0), (0, 0, 0)), "the normal of a cut is 0 0 0; give its direction, such as 0 0 1"),
        (lambda: Pegs(65), "65 pegs on a cut are not possible; give 1 to 64"),
        (lambda: Pegs(1, 10, 4), "a peg of 4 mm is shorter than its round end; give it a length of at least 5 mm"),
        (lambda: Pegs(1, clearance=-0.1), "the clearance of a peg is from 0 to 1000 mm, not -0.1; such as 0.2"),
        (lambda: Combination(Combining.MERGE, "a", ("b",)), "merge takes a name and two structures or more"),
        (lambda: SolidRequest.from_dict({"holow": 2}), "a solid has no 'holow'; it has thicken, hollow, drains"),
        (lambda: SolidRequest.from_dict({"drains": [{"point": [0, 0, 0]}]}), "a solid cannot be made of {'point'"),
    ],
)
def test_what_makes_no_solid_is_refused_in_a_sentence(make, sentence):
    with pytest.raises(SettingsError) as caught:
        make()
    assert str(caught.value).startswith(sentence)
