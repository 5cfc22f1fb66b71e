# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface whose slabs are extracted by workers has the bytes of one machine, whatever the workers get."""

from dataclasses import replace

import numpy as np
import pytest
from other_workers import OtherWorkers
from volumes import AFFINE, FileReader, in_file, of_result, waves

from ctmc_addon.core import Budget, CtmcError, ReconstructionSettings, Volume, reconstruct
from ctmc_addon.core.errors import ReadError, SettingsError
from ctmc_addon.core.extraction import field_pieces, grid, scan

SLICE = 2 * 21 * 70  # bytes


@pytest.fixture(autouse=True)
def many_slabs(monkeypatch):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * 21 * 70)
    monkeypatch.setattr(scan, "SLAB_MIXED", 24)


@pytest.mark.parametrize(("count", "slab_bytes"), [(1, 1), (3, 1 << 14), (3, 1 << 25), (40, 1)])
@pytest.mark.parametrize(
    "settings",
    [
        {"threshold": 50},
        {},
        {"threshold": 50, "alpha": "auto"},
        {"threshold": 50, "upper": 200.0},
        {"threshold": 50, "upper": 200.0, "stride": (1, 2, 2), "topology": "trilinear"},
        {"threshold": 50, "topology": "trilinear", "normals": "gradient"},
        {"threshold": 50, "stride": (2, 1, 3), "close_border": True, "normals": "gradient"},
        {"threshold": 50, "stride": (1, 1, 4), "normals": "mesh", "keep_parts": 2},
        {"threshold": 20, "smoothing_mm": 1.2, "region": (3, 2, 4, 60, 18, 20)},
        {"label": 1, "smoothing_mm": 1.0, "close_border": True},
        {"label": 1, "smoothing": "none", "stride": (1, 1, 3)},
    ],
)
def test_the_bytes_are_those_of_one_machine(settings, count, slab_bytes):
    values = (waves() > 100).astype(np.uint8) if "label" in settings else waves()
    volume = Volume(values, AFFINE, kind="label" if "label" in settings else "HU")
    settings = ReconstructionSettings(**settings)
    workers = OtherWorkers(volume, count)
    result = reconstruct(in_file(volume), settings, Budget(workers=workers, slab_bytes=slab_bytes))
    assert of_result(result) == of_result(reconstruct(volume, settings))
    assert (len(workers.layers) > 1) == (slab_bytes < 1 << 25)
    ends = [end for _, end in workers.layers]
    assert [start for start, _ in workers.layers] == [0, *ends[:-1]]  # every layer once


def test_an_upper_limit_is_not_dropped_on_the_way():
    volume = Volume(waves(), AFFINE, kind="HU")
    budget = Budget(workers=OtherWorkers(volume, 3), slab_bytes=1)
    with_upper, without = (
        reconstruct(in_file(volume), ReconstructionSettings(threshold=50, upper=upper, close_border=True), budget).mesh
        for upper in (200.0, None)
    )
    assert with_upper.volume < 0.8 * without.volume


@pytest.mark.once
@pytest.mark.parametrize("extra", [{"keep_parts": 3}, {"keep_parts": 3, "alpha": "auto"}])
def test_a_surface_that_is_simplified_as_it_comes_is_that_of_one_machine(extra):
    volume = Volume(waves((12, 21, 50)), AFFINE)
    settings = ReconstructionSettings(threshold=50, reduction=0.8, **extra)
    budget = Budget(slab_bytes=1 << 13, whole_faces=1500)
    here = reconstruct(in_file(volume), settings, budget)
    there = reconstruct(in_file(volume), settings, replace(budget, workers=OtherWorkers(volume, 3)))
    assert here.full_faces > 3 * 1500
    target = round(here.full_faces * 0.2)
    assert target - 3 <= len(there.mesh.faces) <= target
    assert of_result(there) == of_result(here)


def test_what_fails_on_one_machine_fails_with_the_same_sentence():
    values = waves(dtype=np.float32)
    values[11, 10, 30] = np.nan
    volume = Volume(values, AFFINE, kind="HU")
    for settings in (ReconstructionSettings(threshold=50), ReconstructionSettings(threshold=9000, nan_as=0)):
        sentences = []
        workers = OtherWorkers(volume, 2)
        for budget in (Budget(), Budget(workers=workers, slab_bytes=1)):
            with pytest.raises(CtmcError) as refusal:
                reconstruct(in_file(volume), settings, budget)
            sentences.append(str(refusal.value))
        assert sentences[0] == sentences[1]
        assert workers.closed == 1


def test_a_worker_that_sees_another_file_says_so():
    volume = Volume(waves(), AFFINE)
    settings = ReconstructionSettings(threshold=50)
    other = OtherWorkers(replace(volume, reader=FileReader(volume.values[:-1])), 2)
    with pytest.raises(ReadError, match=r"as \(22, 21, 70\) int16 and not as \(23, 21, 70\) int16; .* same files"):
        reconstruct(in_file(volume), settings, Budget(workers=other))


def test_a_worker_of_another_version_says_so(monkeypatch):
    volume = Volume(waves(), AFFINE)

    class Newer(OtherWorkers):
        def results(self, tasks):
            return super().results([replace(task, version="0.0.1") for task in tasks])

    with pytest.raises(ReadError, match=r"a worker has ctmc .* and not 0\.0\.1; install the same version everywhere"):
        reconstruct(in_file(volume), ReconstructionSettings(threshold=50), Budget(workers=Newer(volume, 2)))


def test_tasks_are_whole_slabs_of_few_layers_so_that_all_workers_are_busy():
    volume = Volume(waves(), AFFINE)
    workers = OtherWorkers(volume, 1)
    reconstruct(in_file(volume), ReconstructionSettings(threshold=50), Budget(workers=workers, slab_bytes=1))
    assert len(workers.layers) >= field_pieces.TASKS_PER_WORKER
    assert all(start % 2 == 0 and stop - start <= 2 * field_pieces.TASK_SLABS for start, stop in workers.layers)


def test_constrained_smoothing_is_refused_before_any_value_is_read():
    volume = in_file(Volume((waves() > 100).astype(np.uint8), AFFINE, kind="label"))
    settings = ReconstructionSettings(label=1, smoothing="constrained")
    with pytest.raises(
        SettingsError, match=r"^a label smoothed as constrained cannot be extracted by several machines; "
    ):
        reconstruct(volume, settings, Budget(workers=OtherWorkers(volume, 2)))
    assert volume.reader.slices == []
