# SPDX-License-Identifier: GPL-3.0-or-later
"""Several labels with shared interfaces, from the volume to each label's own surface."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from ctmc_addon.core import (
    Budget,
    LabelError,
    MadeSurface,
    MeshError,
    ReconstructionSettings,
    SurfaceRequest,
    Volume,
    finish,
    make_surfaces_steps,
    reconstruct,
    reconstruct_labels,
)
from ctmc_addon.core.mesh import surface_distance
from ctmc_addon.core.mesh.labels.label_complex import ComplexMesh
from ctmc_addon.core.surfaces.finish_labels import crossings_steps
from ctmc_addon.core.volume import ValuesInMemory

AFFINE = np.diag([1.0, 1.0, 2.0, 1.0])


def two_halves(island=0):
    """Return a ball of two labels that meet at a wavy wall; label 2 may have an island of so many voxels across."""
    z, y, x = np.indices((16, 34, 36), np.float32)
    ball = (2 * (z - 7.5)) ** 2 + (y - 16.5) ** 2 + (x - 17.5) ** 2 < 12**2
    values = np.where(ball, 1 + (x + 2 * np.sin(y / 4) > 18), 0).astype(np.uint8)
    values[2 : 2 + island, 2 : 2 + island, 2 : 2 + island] = 2
    return values


class Together(NamedTuple):
    """What was made of labels, by label."""

    full: dict
    results: dict
    errors: dict


def made_of(volume, settings, labels, all_needed=True):
    requests = [SurfaceRequest(replace(settings, label=label), needs_full=True) for label in labels]
    outcomes = finish(make_surfaces_steps(volume, requests, Budget(threads=1), all_needed=all_needed))
    together = Together({}, {}, {})
    for label, outcome in zip(labels, outcomes, strict=True):
        if isinstance(outcome, MadeSurface):
            together.results[label], together.full[label] = outcome
        else:
            together.errors[label] = outcome
    return together


def made(values, settings, labels=(1, 2), **more):
    return made_of(Volume(values, AFFINE, kind="label", **more), settings, labels)


def test_neighbors_say_the_same_of_the_triangles_that_they_share():
    together = made(two_halves(), ReconstructionSettings())
    first, second = together.results[1], together.results[2]
    assert [(near.label, near.triangles) for near in first.neighbors] == [(2, int((first.beyond == 2).sum()))]
    assert first.neighbors[0][1:] == second.neighbors[0][1:]
    for label, result in together.results.items():
        assert (result.mesh.closed, result.wrong_side, result.settings.label) == (True, 0, label)
        assert len(result.beyond) == len(result.mesh.faces)
        assert result.report()["neighbors"][0]["label"] == 3 - label


@pytest.mark.parametrize("reduction", [0.0, 0.8])
def test_labels_are_tested_together_and_do_not_cross(reduction):
    together = made(two_halves(), ReconstructionSettings(reduction=reduction))
    assert [result.self_intersections for result in together.results.values()] == [0, 0]


def test_a_pair_that_crosses_counts_for_both_its_labels():
    corners = [(0, 0, 0), (4, 0, 0), (0, 4, 0), (1, 1, -1), (1, 1, 1), (9, 9, 0), (20, 0, 0), (21, 0, 0), (20, 1, 0)]
    sides = np.array([[1, 0], [2, 4], [3, 0]], np.int32)
    mesh = ComplexMesh(np.array(corners, np.float32), np.arange(9, dtype=np.int32).reshape(3, 3), sides)
    assert finish(crossings_steps(mesh)) == {1: 1, 2: 1, 3: 0, 4: 1}


def test_a_small_component_goes_and_its_neighbors_stay():
    settings = ReconstructionSettings(min_part_mm3=40.0)
    plain = made(two_halves(), settings)
    together = made(two_halves(island=2), settings)
    assert (
        reconstruct_labels(Volume(two_halves(island=2), AFFINE, kind="label"), ReconstructionSettings())
        .surfaces[1]
        .mesh.components
        == 2
    )
    for label in (1, 2):
        assert together.results[label].mesh.components == 1
        assert together.results[label].mesh.closed
        assert together.results[label].mesh.volume == pytest.approx(plain.results[label].mesh.volume, rel=0.01)


def test_a_small_component_within_another_label_becomes_that_label():
    values = np.zeros((16, 34, 36), np.uint8)
    values[2:14, 4:30, 4:30] = 1
    values[7:9, 10:13, 10:13] = 2
    values[5:11, 16:26, 16:26] = 2
    together = made(values, ReconstructionSettings(min_part_mm3=100.0, smoothing="none"))
    outer = together.results[1]
    assert together.results[2].mesh.components == 1
    assert outer.mesh.components == 2  # the outside, and the large part of label 2
    assert outer.mesh.closed
    assert int((outer.beyond == 2).sum()) == len(together.results[2].mesh.faces)


def test_a_label_of_which_no_component_is_large_enough_is_refused_or_left_out():
    values = two_halves()
    values[1:3, 1:4, 1:4] = 3
    settings = ReconstructionSettings(min_part_mm3=200.0)
    with pytest.raises(MeshError, match="no component has a volume of 200 mm3 or more"):
        made(values, settings, (1, 2, 3))
    all_labels = reconstruct_labels(Volume(values, AFFINE, kind="label"), settings, None, Budget(threads=1))
    assert [result.settings.label for result in all_labels.surfaces] == [1, 2]
    [sentence] = all_labels.left_out
    assert sentence.startswith("label 3 is left out: no component has a volume of 200 mm3")


@pytest.mark.parametrize("goal", [{"reduction": 0.7}, {"target_faces": 900}])
def test_simplified_together_the_count_is_that_of_all_and_the_wall_stays_one(goal):
    full = made(two_halves(), ReconstructionSettings())
    together = made(two_halves(), ReconstructionSettings(**goal))

    def stored(results):  # a triangle of two labels is one
        shared = results[1].neighbors[0].triangles
        return sum(len(result.mesh.faces) for result in results.values()) - shared

    before = stored(full.results)
    target = goal.get("target_faces") or round(before * 0.3)
    assert target - 1 <= stored(together.results) <= target
    assert together.full[1].mesh.faces.tobytes() == full.results[1].mesh.faces.tobytes()
    for result in together.results.values():
        assert result.mesh.closed
        assert result.surface is None
        assert result.full_faces == len(together.full[result.settings.label].mesh.faces)


def test_alpha_is_chosen_for_all_together():
    settings = ReconstructionSettings(alpha="auto", min_angle_deg=8.0)
    together = made(two_halves(), settings)
    alphas = {result.settings.alpha for result in together.results.values()}
    assert len(alphas) == 1
    [alpha] = alphas
    assert 0 < alpha < 1
    by_hand = made(two_halves(), ReconstructionSettings(alpha=alpha))
    for label in (1, 2):
        assert together.results[label].mesh.vertices.tobytes() == by_hand.results[label].mesh.vertices.tobytes()
        assert together.results[label].alpha_choice.smallest_angle_deg >= 8.0


def test_a_label_in_a_layer_of_its_own_is_made_as_if_alone():
    inner = np.zeros((16, 34, 36), np.uint8)
    inner[6:10, 12:20, 12:22] = 5
    layered = made(two_halves(), ReconstructionSettings(), (1, 2, 5), layers=(ValuesInMemory(inner),))
    alone = reconstruct(Volume(inner, AFFINE, kind="label"), ReconstructionSettings(label=5))
    assert layered.results[5].mesh.vertices.tobytes() == alone.mesh.vertices.tobytes()
    assert layered.results[5].neighbors == ()
    assert layered.results[1].neighbors[0].label == 2


def test_one_label_alone_is_as_ever():
    volume = Volume(two_halves(), AFFINE, kind="label")
    [only] = reconstruct_labels(volume, ReconstructionSettings(), [2], Budget(threads=1)).surfaces
    alone = reconstruct(volume, ReconstructionSettings(label=2))
    assert only.mesh.vertices.tobytes() == alone.mesh.vertices.tobytes()
    assert only.beyond is None


def test_within_a_maximum_error_no_label_moves_farther_and_the_wall_stays_one():
    full = made(two_halves(), ReconstructionSettings())
    together = made(two_halves(), ReconstructionSettings(max_error_mm=0.4))
    for label in (1, 2):
        small, before = together.results[label].mesh, full.results[label].mesh
        assert surface_distance(small, before).largest <= 0.4
        assert surface_distance(before, small).largest <= 0.4
        assert len(small.faces) < 0.5 * len(before.faces)
        assert small.closed
    assert together.results[1].neighbors[0][1:] == together.results[2].neighbors[0][1:]


def test_a_layer_of_which_nothing_is_left_takes_no_other_with_it():
    specks = np.zeros((16, 34, 36), np.uint8)
    specks[6, 12, 12], specks[9, 20, 20] = 3, 4
    lone = np.zeros((16, 34, 36), np.uint8)
    lone[7, 15, 15] = 5
    layers = (ValuesInMemory(specks), ValuesInMemory(lone))
    volume = Volume(two_halves(), AFFINE, kind="label", layers=layers)
    for settings in (
        ReconstructionSettings(min_part_mm3=200.0),
        ReconstructionSettings(smoothing="gaussian", smoothing_mm=3.0),
    ):
        every = reconstruct_labels(volume, settings, None, Budget(threads=1))
        assert [result.settings.label for result in every.surfaces] == [1, 2]
        assert [sentence.partition(" is left out")[0] for sentence in every.left_out] == [
            "label 3",
            "label 4",
            "label 5",
        ]
    with pytest.raises(MeshError, match="no component has a volume of 1e"):
        made(two_halves(), ReconstructionSettings(min_part_mm3=1e9))
    together = made_of(volume, ReconstructionSettings(min_part_mm3=1e9), (1, 2), all_needed=False)
    assert (together.results, sorted(together.errors)) == ({}, [1, 2])


@pytest.mark.parametrize("label", [-4, 2**31 + 5])
def test_a_label_whose_number_an_interface_cannot_keep_is_refused_and_made_without(label):
    values = np.zeros((12, 12, 12), np.int64)
    values[1:5, 1:5, 1:5], values[6:11, 6:11, 6:11] = label, 7
    volume = Volume(values, np.eye(4), kind="label")
    with pytest.raises(LabelError, match=f"^label {label} cannot share .* from 1 to 2147483647; set interfaces to"):
        reconstruct_labels(volume, ReconstructionSettings())
    made = reconstruct_labels(volume, ReconstructionSettings(interfaces="separate")).surfaces
    assert sorted(result.settings.label for result in made) == sorted([label, 7])
