# SPDX-License-Identifier: GPL-3.0-or-later
"""What is proposed where a surface does not fit was counted, and fits."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import (
    MemoryLimitError,
    ReconstructionSettings,
    fitting,
    label_surfaces,
    reconstruct,
    reconstruct_labels,
)
from ctmc_addon.core.phantom import foam
from ctmc_addon.core.pipeline import reconstruct_steps
from ctmc_addon.core.progress import finish
from ctmc_addon.core.streaming import counted_steps, widest_slices
from ctmc_addon.core.streaming.parts import WORK_BYTES
from ctmc_addon.core.volume import SlabVolume, Volume

SETTINGS = ReconstructionSettings(threshold=132.0)


@pytest.fixture(scope="module")
def file():
    return foam(40, 60, 20, 1)


@pytest.mark.parametrize("more", [{}, {"stride": (2, 3, 1)}, {"close_border": True}, {"topology": "trilinear"}])
def test_triangles_are_counted_exactly(file, more):
    settings = replace(SETTINGS, **more)
    volume = Volume(file.slab(0, 40), file.affine)
    faces = len(reconstruct(volume, settings).mesh.faces)
    assert finish(counted_steps(volume, settings)).faces == faces
    assert finish(counted_steps(file, settings)) == finish(counted_steps(volume, settings))


def test_what_does_not_fit_is_refused_with_settings_that_do(file, monkeypatch):
    monkeypatch.setattr(fitting, "SLABS_BYTES", 0)
    faces = finish(counted_steps(file, SETTINGS)).faces
    limit = faces * fitting.FACE_BYTES // 6

    def made(settings):
        making = reconstruct_steps(file, settings, 1, limit)
        return finish(fitting.advised_steps(making, file, settings, threads=1, memory_limit=limit))

    with pytest.raises(MemoryLimitError, match=rf"surface of {faces} triangles needs about .* are available") as said:
        made(SETTINGS)
    stride = tuple(map(int, re.search(r"stride (\d+) (\d+) (\d+) ", str(said.value)).groups()))
    assert max(stride) > 1
    smaller = made(replace(SETTINGS, stride=stride))
    assert len(smaller.mesh.faces) * fitting.FACE_BYTES <= limit


def test_triangles_that_are_proposed_leave_room_to_write_them():
    described = fitting.Fitting(40_000_000, SETTINGS, written_bytes=600)
    most = described.most_triangles(2 << 30)
    assert most > 1_000_000
    assert replace(described, settings=replace(SETTINGS, target_faces=most)).needed <= 2 << 30
    assert described.needed > 20 << 30
    assert described.most_triangles(100 << 20) == 0


@pytest.fixture(scope="module")
def labels():
    z, y, x = np.ogrid[:24, :30, :30]
    ball = (z - 12) ** 2 + (y - 15) ** 2 + (x - 15) ** 2
    return SlabVolume.of(Volume(np.digitize(ball, [25, 100]).astype(np.uint8), np.eye(4), kind="label"))


def test_a_label_whose_smoothing_does_not_fit_is_told_one_that_does(labels, monkeypatch):
    monkeypatch.setattr(fitting, "SLABS_BYTES", 0)
    settings = ReconstructionSettings(label=1)
    limit = 2 * fitting.Fitting(finish(counted_steps(labels, settings)).faces, settings).needed

    def made(settings, limit):
        making = reconstruct_steps(labels, settings, 1, limit)
        return finish(fitting.advised_steps(making, labels, settings, threads=1, memory_limit=limit))

    with pytest.raises(
        MemoryLimitError, match=r"smoothing label 1 as constrained needs more than the .*; smoothing gaussian would fit"
    ):
        made(settings, limit)
    assert made(replace(settings, smoothing="gaussian"), limit).measures.closed
    with pytest.raises(MemoryLimitError, match="; smoothing gaussian with stride 2 2 2 would fit"):
        made(settings, limit // 5)
    smaller = replace(settings, smoothing="gaussian", stride=(2, 2, 2))
    assert len(made(smaller, limit // 5).mesh.faces) * fitting.FACE_BYTES <= limit // 5


def test_of_several_labels_the_one_that_does_not_fit_is_named_before_others_are_made(labels, monkeypatch):
    tried = []

    def watched_steps(*given, **named):
        tried.append(given)
        return reconstruct_steps(*given, **named)

    monkeypatch.setattr(label_surfaces, "reconstruct_steps", watched_steps)
    with pytest.raises(MemoryLimitError, match=r"^label 2: smoothing label 2 as constrained needs more than the"):
        reconstruct_labels(labels, ReconstructionSettings(), [1, 2], 2, 100_000)
    assert len(tried) == 1


def test_where_even_a_slab_does_not_fit_a_region_is_named_that_does(labels):
    def failing_steps():
        yield from ()
        raise MemoryError

    def refused(volume, monkeypatch):
        monkeypatch.setattr(fitting, "counted_steps", lambda *_: failing_steps())
        with pytest.raises(MemoryLimitError) as said:
            finish(fitting.advised_steps(failing_steps(), volume, SETTINGS, memory_limit=WORK_BYTES + 8 * 20 * 20))
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
        finish(fitting.advised_steps(failing_steps(), file, SETTINGS))
