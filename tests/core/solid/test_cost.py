# SPDX-License-Identifier: GPL-3.0-or-later
"""The predicted cost of solids: triangles and memory against those of parts that were made. Balls of gray values."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.core import (
    CALIBRATION,
    Budget,
    FieldCache,
    MemoryLimitError,
    ReconstructionSettings,
    Stage,
    Volume,
    cost_estimate_steps,
    finish,
)
from ctmc_addon.core.solid import Cut, Drain, Pegs, SolidRequest, solid_cost, solid_parts
from ctmc_addon.core.solid.cost import RATIOS, SOLID
from ctmc_addon.core.solid.structure import MAKING

GRAY = ReconstructionSettings(threshold=0.0)
SIZE = 40
BALL = Volume((15.3 - distance_mm((SIZE,) * 3)).astype(np.float32), np.eye(4), name="ball")
MIDDLE = (19.5, 19.5, 19.5)


@pytest.fixture(scope="module")
def estimate():
    return finish(cost_estimate_steps(FieldCache(BALL), GRAY))


@pytest.fixture(autouse=True)
def _learned(monkeypatch):
    monkeypatch.setattr(CALIBRATION, "learned", {})


def as_label(estimate):
    """A ball has the inner surface that labels have."""
    return replace(estimate, settings=ReconstructionSettings(label=1))


@pytest.mark.parametrize(
    "solid",
    [
        SolidRequest(thicken=1.0),
        SolidRequest(hollow=2.0),
        SolidRequest(cuts=(Cut(MIDDLE, (1, 2, 3)),)),
        SolidRequest(cuts=(Cut(MIDDLE, (0, 0, 1)),), pegs=Pegs(2, 4, 5)),
        SolidRequest(thicken=1.0, hollow=2.0, drains=(Drain(4),)),
    ],
    ids=["thicken", "hollow", "cut", "pegs", "drains"],
)
def test_triangles_and_memory_are_near_those_of_the_parts(estimate, solid):
    predicted = solid_cost([as_label(estimate)], solid, SIZE * SIZE * SIZE)
    tracemalloc.start()
    parts = solid_parts(BALL, GRAY, solid, budget=Budget(threads=1))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    made = sum(part.full_faces for part in parts)
    assert made / 1.6 < predicted.faces < made * 1.6
    assert peak < predicted.memory < 2 * peak + RATIOS.started_bytes


def test_seconds_are_those_of_the_last_solid_in_proportion(estimate):
    cost = solid_cost([estimate], SolidRequest(hollow=2.0), SIZE * SIZE * SIZE)
    part = solid_parts(BALL, GRAY, SolidRequest(hollow=2.0))[0]
    part = replace(part, stages=(Stage(MAKING, 6.0), Stage("Measuring for print", 3.0)))
    cost.learn([part])
    assert cost.seconds == pytest.approx(9.0)
    assert cost.stage_seconds[MAKING] == pytest.approx(6.0)
    cost.learn([part, part])  # A group of two structures is made once, and each is measured.
    assert cost.stage_seconds[MAKING] == pytest.approx(6.0)
    assert cost.seconds == pytest.approx(12.0)
    assert set(CALIBRATION.learned) == {(SOLID, MAKING), (SOLID, "Measuring for print")}
    finer = solid_cost(
        [estimate], SolidRequest(hollow=2.0, cuts=(Cut(MIDDLE, (0, 0, 1)),), pegs=Pegs(1, 2, 3)), 1 << 16
    )
    assert finer.seconds > 1.5 * cost.seconds


def test_labels_that_share_walls_are_on_one_lattice(estimate):
    label = as_label(estimate)
    shared = replace(label, settings=ReconstructionSettings(label=1, interfaces="shared"))
    apart = replace(label, settings=ReconstructionSettings(label=1, interfaces="separate"))
    together = solid_cost([shared] * 4, SolidRequest(thicken=1.0), label.voxels)
    alone = solid_cost([apart] * 4, SolidRequest(thicken=1.0), label.voxels)
    assert alone.faces < together.faces < 3 * alone.faces
    assert together.memory - RATIOS.started_bytes > 4 * (alone.memory - RATIOS.started_bytes)


def test_parts_that_do_not_fit_are_refused_with_a_wider_stride(estimate):
    cost = solid_cost([estimate], SolidRequest(hollow=2.0), SIZE * SIZE * SIZE)
    assert cost.refusal(cost.memory) == ""
    assert cost.refusal(None) == ""
    assert cost.refusal(cost.memory - 1).startswith("the parts of this solid would need 0.1 GiB of memory")
    with pytest.raises(MemoryLimitError, match="the parts of a solid need"):
        solid_parts(BALL, GRAY, SolidRequest(hollow=2.0), budget=Budget(bytes=RATIOS.started_bytes, work_bytes=1 << 20))
