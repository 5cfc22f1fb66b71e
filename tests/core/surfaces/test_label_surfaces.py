# SPDX-License-Identifier: GPL-3.0-or-later
"""Several labels at once: the bytes of each alone, in the order asked for, whatever the threads and the memory."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from volumes import in_file

from ctmc_addon.core import (
    NO_THREAD,
    Budget,
    LabelError,
    ReconstructionSettings,
    SettingsError,
    Volume,
    reconstruct,
    reconstruct_labels,
    reconstruct_labels_steps,
)
from ctmc_addon.core.errors import MemoryLimitError
from ctmc_addon.core.simplification.whole import Goal
from ctmc_addon.core.volume.labels import extents as labels_of_volume

AFFINE = np.array([[-0.8, 0.1, 0, 3], [0, 0.8, 0.1, -5], [0.1, 0, 2.5, 7], [0, 0, 0, 1]])

SIDE_BY_SIDE = Budget(threads=3, small_label=1 << 30)


def separate(**more):
    """Settings that make each label by itself."""
    return ReconstructionSettings(interfaces="separate", **more)


def organs():
    """Eight balls of different sizes that touch and cut each other, one at the border, one of a single voxel."""
    z, y, x = np.indices((24, 40, 44), np.float32)
    values = np.zeros(z.shape, np.int16)
    rng = np.random.default_rng(3)
    for label, radius in zip((3, 1, 9, 200, 4, 77, 12), (11, 3, 5, 2, 7, 4, 6), strict=True):
        cz, cy, cx = rng.uniform(3, 21), rng.uniform(8, 32), rng.uniform(8, 36)
        values[(2 * (z - cz)) ** 2 + (y - cy) ** 2 + (x - cx) ** 2 < radius**2] = label
    values[:5, :4, :6] = 50
    values[20, 38, 42] = 60
    names, colors = {3: "liver", 9: "spleen"}, {3: (200, 30, 10)}
    return Volume(values, AFFINE, kind="label", label_names=names, label_colors=colors)


def same(first, second):
    meshes = [(result.mesh.vertices, result.mesh.faces, result.mesh.normals) for result in (first, second)]
    assert all(np.array_equal(a, b) for a, b in zip(*meshes, strict=True))
    assert replace(first, mesh=None, surface=None, stages=()).__dict__ == {
        **second.__dict__,
        "mesh": None,
        "surface": None,
        "stages": (),
    }


@pytest.mark.once
@pytest.mark.parametrize(
    "settings",
    [
        separate(),
        separate(smoothing="none", stride=(2, 3, 2)),
        separate(smoothing_mm=1.5, close_border=True),
        separate(reduction=0.5, region=(2, 3, 1, 40, 38, 20)),
    ],
    ids=["constrained", "none", "gaussian", "region"],
)
def test_every_label_has_the_bytes_it_has_alone(settings):
    volume = organs()
    results = {threads: reconstruct_labels(volume, settings, None, Budget(threads=threads)) for threads in (1, 2, 5)}
    labels = [result.settings.label for result in results[1].surfaces]
    assert labels == sorted(labels)
    assert len(labels) >= 7
    for threads in results:
        assert results[threads].left_out == results[1].left_out
        assert [result.settings.label for result in results[threads].surfaces] == labels
        for result in results[threads].surfaces:
            same(result, reconstruct(organs(), replace(settings, label=result.settings.label), Budget(threads=1)))


def test_values_that_are_fetched_give_the_same_bytes():
    fetched = reconstruct_labels(in_file(organs()), separate(), None, Budget(threads=3))
    for first, second in zip(fetched.surfaces, reconstruct_labels(organs(), separate()).surfaces, strict=True):
        same(first, second)


def test_what_does_not_fit_beside_other_labels_is_made_whole_alone():
    boxes = np.kron([[1, 2], [3, 4]], np.pad(np.ones((8, 8)), 2))
    values = np.pad(np.broadcast_to(boxes, (8, 24, 24)), ((2, 2), (0, 0), (0, 0))).astype(np.uint8)
    volume, settings = Volume(values, AFFINE, kind="label"), separate(reduction=0.9, smoothing="none")
    whole = reconstruct_labels(volume, settings).surfaces
    budget = Budget(threads=2, bytes=Goal(reduction=0.5).bytes_at_once(whole[0].full_faces) + 1)
    with pytest.raises(MemoryLimitError):
        reconstruct(volume, replace(settings, label=1), budget.shared_by(2))
    for first, second in zip(reconstruct_labels(volume, settings, None, budget).surfaces, whole, strict=True):
        same(first, second)


def test_labels_come_in_the_order_asked_for_with_their_names_and_colors():
    surfaces, left_out = reconstruct_labels(organs(), separate(label=5), [9, 3, 12])
    assert left_out == []
    assert [(one.settings.label, one.label_name, one.label_color) for one in surfaces] == [
        (9, "spleen", None),
        (3, "liver", (200, 30, 10)),
        (12, "", None),
    ]
    assert [one.report()["label_name"] for one in surfaces] == ["spleen", "liver", ""]


def test_the_values_are_searched_once_for_all_labels(monkeypatch):
    seen = []
    scan = labels_of_volume.slab_extents
    monkeypatch.setattr(labels_of_volume, "slab_extents", lambda slab: seen.append(slab.size) or scan(slab))
    volume = organs()
    reconstruct_labels(volume, separate())
    assert sum(seen) == volume.values.size


def test_a_label_that_is_not_there_is_one_sentence():
    with pytest.raises(LabelError, match="label 5 is empty here; the labels are 1, 3, "):
        reconstruct_labels(organs(), separate(), [3, 5])
    with pytest.raises(LabelError, match="all voxels are 0"):
        reconstruct_labels(Volume(np.zeros((3, 4, 5)), np.eye(4)), separate())
    with pytest.raises(SettingsError, match="region"):
        reconstruct_labels(organs(), separate(region=(90, 0, 0, 99, 9, 9)))


def test_of_all_labels_those_without_a_surface_are_left_out_and_said():
    settings = separate(smoothing="none", stride=(4, 4, 4))
    everything = reconstruct_labels(organs(), settings)
    assert everything.left_out
    assert all("is left out: " in sentence for sentence in everything.left_out)
    with pytest.raises(LabelError, match="no label of volume has a surface; label 1"):
        reconstruct_labels(Volume(np.ones((4, 4, 4), np.uint8), np.eye(4)), separate())


@pytest.mark.once
def test_what_does_not_fit_beside_others_is_made_alone():
    volume = organs()
    alone = {}
    for result in reconstruct_labels(volume, separate(), None, Budget(threads=1)).surfaces:
        alone[result.settings.label] = result
    low, high = 10_000, 1 << 28
    while high - low > 4096:  # the least memory with which every label can be made alone
        limit = (low + high) // 2
        try:
            for label in alone:
                reconstruct(volume, separate(label=label), Budget(threads=1, bytes=limit))
            high = limit
        except MemoryLimitError:
            low = limit
    surfaces, _ = reconstruct_labels(volume, separate(), None, Budget(threads=4, bytes=high))
    for result in surfaces:
        same(result, alone[result.settings.label])
    with pytest.raises(MemoryLimitError):
        reconstruct_labels(volume, separate(), None, Budget(threads=4, bytes=low))


def test_closing_the_steps_ends_every_thread():
    before = threading.active_count()
    steps = reconstruct_labels_steps(organs(), separate(), None, SIDE_BY_SIDE)
    assert any(threading.active_count() > before for _ in steps)
    steps.close()
    assert threading.active_count() == before


def test_the_fraction_rises_to_one():
    fractions = [step.fraction for step in reconstruct_labels_steps(organs(), separate(), None, Budget(threads=2))]
    assert fractions == sorted(fractions)
    assert 0.9 < fractions[-1] <= 1


@pytest.mark.once
@pytest.mark.parametrize("room", [0, 1, 2])
def test_where_the_system_gives_no_thread_labels_are_made_one_after_the_other(monkeypatch, room):
    settings = separate(smoothing="none", reduction=0.5)
    expected = reconstruct_labels(organs(), settings, None, Budget(threads=1))
    left = [None] * room
    start = threading.Thread.start

    def refused(thread):
        if not left:
            raise RuntimeError(NO_THREAD)
        left.pop()
        start(thread)

    before = threading.active_count()
    monkeypatch.setattr(threading.Thread, "start", refused)
    found = reconstruct_labels(organs(), settings, None, SIDE_BY_SIDE)
    assert (left, threading.active_count()) == ([], before)
    assert found.left_out == expected.left_out
    for first, second in zip(found.surfaces, expected.surfaces, strict=True):
        same(first, second)
