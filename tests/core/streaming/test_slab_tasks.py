# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface whose slabs are extracted by workers has the bytes of one machine, whatever the workers get."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ctmc_addon.core import CtmcError, ReconstructionSettings, Volume, finish, reconstruct, reconstruct_steps
from ctmc_addon.core.errors import ReadError, SettingsError
from ctmc_addon.core.extraction import scan
from ctmc_addon.core.simplification.streaming import reduce_pieces
from ctmc_addon.core.streaming import choice, parts, slab_result_steps
from ctmc_addon.core.volume import SlabVolume

AFFINE = np.array([[-0.7, 0.1, 0, 5], [0, 0.8, 0.2, -9], [0.1, 0, 1.5, 30], [0, 0, 0, 1]], float)


class OtherWorkers:
    """Workers with a volume of their own, to whom tasks are sent and who send results."""

    def __init__(self, volume, count):
        self.volume, self.count, self.layers = volume, count, []

    def results(self, tasks):
        for task in tasks:
            self.layers.append(task.layers)
            yield None
            steps = slab_result_steps(SlabVolume.of(self.volume), pickle.loads(pickle.dumps(task)))
            yield pickle.loads(pickle.dumps(finish(steps)))


@pytest.fixture(autouse=True)
def many_slabs(monkeypatch):
    monkeypatch.setattr(scan, "SLAB_MIXED", 24)


def waves(shape=(23, 21, 70), dtype=np.int16):
    z, y, x = np.indices(shape)
    noise = np.random.default_rng(3).normal(0, 60, shape)
    return (400 * np.sin(x / 5) * np.sin(y / 4) * np.cos(z / 3) + noise).astype(dtype)


def facts(result):
    arrays = (result.surface.midpoints, result.surface.linear, result.mesh.faces, result.mesh.normals)
    return *(None if array is None else array.tobytes() for array in arrays), result.notes, result.wrong_side


@pytest.mark.parametrize("slab_bytes", [1, 1 << 14, 1 << 25])
@pytest.mark.parametrize("count", [1, 3, 40])
@pytest.mark.parametrize(
    "settings",
    [
        {"threshold": 50},
        {},
        {"threshold": 50, "topology": "trilinear", "normals": "gradient"},
        {"threshold": 50, "stride": (2, 1, 3), "close_border": True, "normals": "gradient"},
        {"threshold": 20, "smoothing_mm": 1.2, "region": (3, 2, 4, 60, 18, 20)},
        {"label": 1, "smoothing_mm": 1.0, "close_border": True},
    ],
)
def test_the_bytes_are_those_of_one_machine(settings, count, slab_bytes, monkeypatch):
    monkeypatch.setattr(parts, "SLAB_BYTES", slab_bytes)
    values = (waves() > 100).astype(np.uint8) if "label" in settings else waves()
    volume = Volume(values, AFFINE, kind="label" if "label" in settings else "HU")
    settings = ReconstructionSettings(**settings)
    workers = OtherWorkers(volume, count)
    result = finish(reconstruct_steps(SlabVolume.of(volume), settings, workers=workers))
    assert facts(result) == facts(reconstruct(volume, settings))
    assert (len(workers.layers) > 1) == (slab_bytes < 1 << 25)
    ends = [end for _, end in workers.layers]
    assert [start for start, _ in workers.layers] == [0, *ends[:-1]]  # every layer once


@pytest.mark.once
@pytest.mark.parametrize("extra", [{}, {"keep_parts": 3}])
def test_a_surface_that_is_simplified_as_it_comes_is_that_of_one_machine(monkeypatch, extra):
    monkeypatch.setattr(parts, "SLAB_BYTES", 1 << 14)
    monkeypatch.setattr(choice, "SMALL_BYTES", 0)
    monkeypatch.setattr(choice, "SHARE", 0.0)
    monkeypatch.setattr(reduce_pieces, "BATCH_FACES", 3000)
    volume = Volume(waves(), AFFINE)
    settings = ReconstructionSettings(threshold=50, reduction=0.8, **extra)
    here = finish(reconstruct_steps(SlabVolume.of(volume), settings))
    there = finish(reconstruct_steps(SlabVolume.of(volume), settings, workers=OtherWorkers(volume, 3)))
    assert here.full_faces > 3 * 3000
    assert len(there.mesh.faces) in (round(here.full_faces * 0.2), round(here.full_faces * 0.2) - 1)
    assert there.mesh.vertices.tobytes() == here.mesh.vertices.tobytes()
    assert there.mesh.faces.tobytes() == here.mesh.faces.tobytes()


def test_what_fails_on_one_machine_fails_with_the_same_sentence():
    values = waves(dtype=np.float32)
    values[11, 10, 30] = np.nan
    volume = Volume(values, AFFINE, kind="HU")
    for settings in (ReconstructionSettings(threshold=50), ReconstructionSettings(threshold=9000, nan_as=0)):
        sentences = []
        for work in (
            lambda s=settings: reconstruct(volume, s),
            lambda s=settings: finish(reconstruct_steps(SlabVolume.of(volume), s, workers=OtherWorkers(volume, 2))),
        ):
            with pytest.raises(CtmcError) as refusal:
                work()
            sentences.append(str(refusal.value))
        assert sentences[0] == sentences[1]


def test_a_worker_that_sees_another_file_says_so():
    volume = Volume(waves(), AFFINE)
    other = OtherWorkers(replace(volume, values=volume.values[:-1]), 2)
    with pytest.raises(ReadError, match="same files"):
        finish(reconstruct_steps(SlabVolume.of(volume), ReconstructionSettings(threshold=50), workers=other))


def test_constrained_smoothing_is_refused():
    volume = Volume((waves() > 100).astype(np.uint8), AFFINE, kind="label")
    settings = ReconstructionSettings(label=1, smoothing="constrained")
    with pytest.raises(SettingsError, match="constrained"):
        finish(reconstruct_steps(SlabVolume.of(volume), settings, workers=OtherWorkers(volume, 2)))
