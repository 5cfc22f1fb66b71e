# SPDX-License-Identifier: GPL-3.0-or-later
"""What is proposed where a surface does not fit was counted, and fits."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import (
    Budget,
    FieldCache,
    MemoryLimitError,
    ReconstructionSettings,
    Volume,
    Write,
    advised_steps,
    cost_estimate_steps,
    finish,
    plan_steps,
    reconstruct,
    reconstruct_labels,
    reconstruct_steps,
)
from ctmc_addon.core.extraction.field_pieces import WORK_BYTES
from ctmc_addon.core.extraction.marching_cubes import Counts
from ctmc_addon.core.phantom import foam
from ctmc_addon.core.planning import plan
from ctmc_addon.core.planning.plan import FACE_BYTES, Plan, widest_slices
from ctmc_addon.core.simplification.batches import in_batches
from ctmc_addon.core.simplification.batches.memory import held_batches, seam_vertices
from ctmc_addon.core.simplification.policy import POLICY
from ctmc_addon.core.surfaces import make

SETTINGS = ReconstructionSettings(threshold=132.0)
SEPARATE = ReconstructionSettings(interfaces="separate")


@pytest.fixture(scope="module")
def file():
    return foam(40, 60, 20, 1)


@pytest.mark.parametrize("more", [{}, {"stride": (2, 3, 1)}, {"close_border": True}, {"topology": "trilinear"}])
def test_triangles_are_counted_exactly(file, more):
    settings = replace(SETTINGS, **more)
    volume = Volume(file.slab(0, 40), file.affine)
    faces = len(reconstruct(volume, settings).mesh.faces)
    counts = finish(plan_steps(volume, settings)).counts
    assert counts.faces == faces
    assert finish(plan_steps(file, settings, Budget(slab_bytes=1))).counts == counts


def made(volume, settings, budget):
    making = reconstruct_steps(volume, settings, budget)
    return finish(advised_steps(making, volume, settings, budget))


def proposed_stride(sentence):
    return tuple(map(int, re.search(r"stride (\d+) (\d+) (\d+) ", sentence).groups()))


@pytest.mark.parametrize("held", [False, True])
def test_what_does_not_fit_is_refused_with_settings_that_do(file, held):
    volume = Volume(file.slab(0, 40), file.affine) if held else file
    faces = finish(plan_steps(volume, SETTINGS)).counts.faces
    budget = Budget(threads=1, bytes=faces * FACE_BYTES // 6, work_bytes=0)
    with pytest.raises(MemoryLimitError, match=rf"surface of {faces} triangles needs about .* are available") as said:
        made(volume, SETTINGS, budget)
    stride = proposed_stride(str(said.value))
    assert max(stride) > 1
    smaller = made(volume, replace(SETTINGS, stride=stride), budget)
    assert len(smaller.mesh.faces) * FACE_BYTES <= budget.bytes


@pytest.mark.parametrize("more", [{}, {"close_border": True}, {"smoothing_mm": 0.02}, {"stride": (1, 2, 1)}])
@pytest.mark.parametrize("share", [6, 12, 20])
def test_estimate_and_refusal_name_the_same_settings(file, share, more):
    settings = replace(SETTINGS, **more)
    faces = finish(plan_steps(file, settings)).counts.faces
    budget = Budget(threads=1, bytes=faces * FACE_BYTES // share, work_bytes=0)
    estimate = finish(cost_estimate_steps(FieldCache(file, budget), settings))
    with pytest.raises(MemoryLimitError) as said:
        made(file, settings, budget)
    assert str(said.value).endswith(f"; {estimate.remedy}")
    assert "would fit" in estimate.remedy
    wider = replace(settings, stride=proposed_stride(estimate.remedy))
    assert finish(cost_estimate_steps(FieldCache(file, budget), wider)).fits
    assert max(wider.stride) > max(settings.stride)


def planned(faces, settings=SETTINGS, budget=None, **more):
    return Plan(Counts(10 * faces, faces, faces // 2, faces), settings, budget or Budget(), **more)


def test_triangles_that_are_proposed_leave_room_to_write_them():
    described = planned(40_000_000, written_bytes=600)
    most = described.most_triangles(2 << 30)
    assert most > 1_000_000
    assert replace(described, settings=replace(SETTINGS, target_faces=most)).needed <= 2 << 30
    assert described.needed > 20 << 30
    assert described.most_triangles(100 << 20) == 0


def test_what_is_written_as_it_comes_takes_no_memory_for_triangles(tmp_path):
    budget = Budget()
    written = planned(40_000_000, sink=Write(tmp_path / "a.stl"))
    assert written.needed == budget.work_bytes
    assert planned(40_000_000, value_bytes=500).needed == budget.work_bytes + 500 + 40_000_000 * FACE_BYTES
    assert not planned(40_000_000).simplifies
    less = planned(40_000_000, replace(SETTINGS, reduction=0.9))
    assert (less.simplifies, less.left) == (True, 4_000_000)
    assert budget.work_bytes + 4_000_000 * FACE_BYTES < less.needed < 2 << 30


@pytest.fixture(scope="module")
def labels():
    z, y, x = np.ogrid[:24, :30, :30]
    ball = (z - 12) ** 2 + (y - 15) ** 2 + (x - 15) ** 2
    return Volume(np.digitize(ball, [25, 100]).astype(np.uint8), np.eye(4), kind="label")


def test_a_label_whose_smoothing_does_not_fit_is_told_one_that_does(labels):
    settings, budget = ReconstructionSettings(label=1), Budget(threads=1, work_bytes=0)
    limit = 2 * FACE_BYTES * finish(plan_steps(labels, replace(settings, smoothing="gaussian"))).counts.faces
    most = replace(budget, bytes=limit)
    least = replace(budget, bytes=limit // 5)

    with pytest.raises(
        MemoryLimitError, match=r"smoothing label 1 as constrained needs more than the .*; smoothing gaussian would fit"
    ):
        made(labels, settings, most)
    assert made(labels, replace(settings, smoothing="gaussian"), most).measures.closed
    with pytest.raises(MemoryLimitError, match="; smoothing gaussian with stride 2 2 2 would fit"):
        made(labels, settings, least)
    smaller = replace(settings, smoothing="gaussian", stride=(2, 2, 2))
    assert len(made(labels, smaller, least).mesh.faces) * FACE_BYTES <= limit // 5


def test_of_several_labels_the_one_that_does_not_fit_is_named_before_others_are_made(labels, monkeypatch):
    tried = []

    def watched_steps(*given, **named):
        tried.append(given)
        return reconstruct_steps(*given, **named)

    monkeypatch.setattr(make, "reconstruct_steps", watched_steps)
    with pytest.raises(MemoryLimitError, match=r"^label 2: smoothing label 2 as constrained needs more than the"):
        reconstruct_labels(labels, SEPARATE, [1, 2], Budget(threads=2, bytes=100_000, work_bytes=0))
    assert len(tried) == 1


def test_where_even_a_slab_does_not_fit_a_region_is_named_that_does(labels):
    def failing_steps():
        yield from ()
        raise MemoryError

    def refused(volume, monkeypatch):
        monkeypatch.setattr(plan, "plan_steps", lambda *_: failing_steps())
        budget = Budget(bytes=WORK_BYTES + 8 * 20 * 20)
        with pytest.raises(MemoryLimitError) as said:
            finish(advised_steps(failing_steps(), volume, SETTINGS, budget))
        return str(said.value)

    with pytest.MonkeyPatch.context() as monkeypatch:
        sentence = refused(labels, monkeypatch)
    assert sentence.endswith("choose a region of at most 20 x 20 voxels across")
    gaussian = replace(SETTINGS, smoothing="gaussian", smoothing_mm=1.0)
    assert widest_slices(labels, gaussian, WORK_BYTES + 20 * 20 * (8 * 4 + 4 * (2 * 4 + 1))) == 20


def test_another_error_stays_what_it_is(file):
    def failing_steps():
        yield from ()
        raise RuntimeError("other")

    with pytest.raises(RuntimeError, match=r"^other$"):
        finish(advised_steps(failing_steps(), file, SETTINGS))


def refused_before_work(volume, settings, budget, monkeypatch):
    """Return the refusal of a surface of which no piece was extracted."""

    def never(*_):
        raise AssertionError("work has begun")

    with monkeypatch.context() as patched:
        patched.setattr(sys.modules[reconstruct_steps.__module__], "surface_pieces_steps", never)
        with pytest.raises(MemoryLimitError) as said:
            made(volume, settings, budget)
    return str(said.value)


def test_some_slabs_of_a_large_volume_tell_what_does_not_fit(monkeypatch):
    large, settings = foam(96, 512, 128, 1), replace(SETTINGS, reduction=0.9)
    budget = Budget(threads=1, work_bytes=0, whole_faces=4000, counted_slabs=3)
    exact = finish(plan_steps(large, settings, budget))
    some = finish(plan_steps(large, settings, budget, most_slabs=3))
    assert (exact.counts.exact, some.counts.exact) == (True, False)
    assert some.counts.voxels == exact.counts.voxels
    assert some.counts.faces == pytest.approx(exact.counts.faces, rel=0.15)
    assert finish(plan_steps(large, settings, budget, most_slabs=6)) == exact
    budget = replace(budget, bytes=exact.needed // 3)
    sentence = refused_before_work(large, settings, budget, monkeypatch)
    assert sentence.startswith(f"a surface of about {some.counts.faces} triangles needs about ")
    better = replace(settings, stride=proposed_stride(sentence))
    assert finish(plan_steps(large, better, budget)).needed <= budget.bytes


@pytest.mark.parametrize("more", [{}, {"reduction": 0.5}, {"reduction": 0.9}, {"close_border": True}])
@pytest.mark.parametrize("share", [3, 12])
def test_a_surface_that_does_not_fit_is_refused_before_work_with_settings_that_do(file, more, share, monkeypatch):
    settings = replace(SETTINGS, **more)
    budget = Budget(threads=1, work_bytes=0)
    budget = replace(budget, bytes=finish(plan_steps(file, settings, budget)).needed // share)
    sentence = refused_before_work(file, settings, budget, monkeypatch)
    advised = [replace(settings, stride=proposed_stride(sentence))]
    if target := re.search(r"triangles (\d+) would", sentence):
        advised.append(replace(settings, reduction=None, target_faces=int(target[1])))
    for better in advised:
        assert finish(plan_steps(file, better, budget)).needed <= budget.bytes
        assert len(made(file, better, budget).mesh.faces)


def test_a_surface_in_batches_needs_what_its_largest_pass_does():
    budget = Budget(work_bytes=100 << 20, whole_faces=1 << 20)
    full = 60_000_000

    def needed(left):
        return planned(full, replace(SETTINGS, target_faces=left), budget).needed

    batch, region = 380 << 18, 380 << 20  # bytes for a quarter of a million triangles, and for a million
    assert needed(1000) == (100 << 20) + 36 * 1200 + batch  # the batches
    assert needed(2_000_000) == 2 * 36 * 2_400_000 + region  # the last pass, with all that is left twice
    assert needed(40_000_000) == 40_000_000 * FACE_BYTES  # what is measured at the end


@pytest.mark.once
def test_thin_batches_need_the_triangles_along_their_seams_too(monkeypatch):
    z, y, x = np.ogrid[:64, :192, :192]
    waves = np.cos(z * (np.pi / 12)) + np.cos(y * (np.pi / 12)) + np.cos(x * (np.pi / 12))
    volume = Volume((127.5 + 42.5 * waves).astype(np.uint8), np.eye(4))
    settings = ReconstructionSettings(threshold=150, reduction=0.95)
    budget = Budget(threads=1, work_bytes=0, whole_faces=1 << 16)
    held = []
    regions = in_batches.regions

    def noted(surface, most, axis):
        held.append(surface.face_count)
        return regions(surface, most, axis)

    monkeypatch.setattr(in_batches, "regions", noted)
    counts = finish(plan_steps(volume, settings, budget)).counts
    result = reconstruct(volume, settings, budget)
    assert (result.full_faces, counts.layers) == (counts.faces, 63)
    share = POLICY.spare * 0.05
    border = POLICY.seam_faces * seam_vertices(counts.vertices, counts.layers)
    predicted = held_batches(counts.faces, share, 1 << 14, counts.layers, border, 1 << 15)
    assert held[0] > 2 * share * counts.faces  # what would be held without seams
    assert 0.8 * held[0] < predicted.held < 2 * held[0]

    with_seams = finish(plan_steps(volume, settings, budget)).needed
    monkeypatch.undo()
    sentence = refused_before_work(volume, settings, replace(budget, bytes=with_seams - 1), monkeypatch)
    assert re.fullmatch(r"stride \d+ \d+ \d+ would fit", sentence.partition("; ")[2])  # fewer triangles would not


def test_simplification_of_a_surface_with_room_for_it_is_not_refused(file):
    settings = replace(SETTINGS, reduction=0.9)
    budget = Budget(threads=1, work_bytes=0)
    budget = replace(budget, bytes=finish(plan_steps(file, settings, budget)).needed)
    assert len(made(file, settings, budget).mesh.faces) in (6692, 6693)  # edges take two triangles with them
