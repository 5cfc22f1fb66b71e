# SPDX-License-Identifier: GPL-3.0-or-later
"""Which opacity a structure gets: its own name or number before its anatomy, that before 'all', else the table's."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.core import AbsentLabelError, ReconstructionSettings, Volume, opacities_of, require_opacities
from ctmc_addon.core.surfaces.labels import reconstruct_labels

NAMES = {1: "liver", 2: "kidney_left", 3: "kidney_right"}


@pytest.fixture(scope="module")
def results():
    values = np.zeros((8, 8, 30), np.uint8)
    for label in NAMES:
        values[2:6, 2:6, 8 * label - 5 : 8 * label] = label
    volume = Volume(values, np.eye(4), kind="label", label_names=NAMES)
    return reconstruct_labels(volume, ReconstructionSettings()).surfaces


@pytest.mark.parametrize(
    ("chosen", "expected"),
    [
        ((), (0.6, None, None)),
        ((("Leber", 0.35),), (0.35, None, None)),
        ((("liver", 1.0),), (1.0, None, None)),
        ((("kidney", 0.2), (3, 0.9)), (0.6, 0.2, 0.9)),
        (((2, 0.5), ("all", 0.1)), (0.1, 0.5, 0.1)),
        ((("kidney left", 0.3), ("kidney left", 0.4)), (0.6, 0.4, None)),
    ],
)
def test_the_nearest_name_counts(results, chosen, expected):
    assert opacities_of(results, chosen) == expected


def test_a_surface_alone_is_opaque_unless_it_is_chosen(results):
    assert opacities_of(results[:1]) == (None,)
    assert opacities_of(results[:1], [("liver", 0.35)]) == (0.35,)


def test_a_name_that_nothing_answers_to_is_refused():
    require_opacities([("Niere", 0.5), ("all", 1.0), (9, 0.1)], NAMES.items())
    with pytest.raises(AbsentLabelError, match=r"--opacity names 'spleen', .*; there are liver, kidney_left"):
        require_opacities([("spleen", 0.5)], NAMES.items())
    with pytest.raises(AbsentLabelError, match=r"have no names: give a number"):
        require_opacities([("spleen", 0.5)], [])
