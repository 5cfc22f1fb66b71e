# SPDX-License-Identifier: GPL-3.0-or-later
"""A surface that is looked at several times is extracted once, and how much of it stays in memory decides nothing."""

import sys
from dataclasses import replace

import pytest
from volumes import AFFINE, in_file, waves

from ctmc_addon.core import (
    Budget,
    ReconstructionSettings,
    Step,
    Volume,
    Write,
    finish,
    plan_steps,
    reconstruct,
    reconstruct_steps,
)
from ctmc_addon.core.mesh.pieces import spool as spool_module
from ctmc_addon.core.mesh.pieces.spool import FACE_BYTES, VERTEX_BYTES

EXTRACT = sys.modules[reconstruct_steps.__module__]
VOLUME = Volume(waves((20, 18, 24)), AFFINE)
SETTINGS = ReconstructionSettings(threshold=0.0)
LOOKS = [{"alpha": "auto"}, {"keep_parts": 2}, {"alpha": "auto", "min_part_mm3": 20.0}]
FEW = Budget(slab_bytes=4096, spool_share=0.0)


@pytest.fixture
def extracted(monkeypatch):
    """Return a list that grows with every extraction."""
    calls = []
    pieces_steps = EXTRACT.surface_pieces_steps

    def noted(*given, **named):
        calls.append(given)
        return pieces_steps(*given, **named)

    monkeypatch.setattr(EXTRACT, "surface_pieces_steps", noted)
    return calls


@pytest.fixture
def files(monkeypatch):
    """Return a list of the files without a name that were opened."""
    opened = []
    temporary = spool_module.tempfile.TemporaryFile

    def noted(**named):
        opened.append(temporary(**named))
        return opened[-1]

    monkeypatch.setattr(spool_module.tempfile, "TemporaryFile", noted)
    return opened


@pytest.mark.parametrize("looks", LOOKS)
@pytest.mark.parametrize("more", [{}, {"reduction": 0.5}, {"normals": "mesh"}])
def test_one_extraction_serves_all_looks_from_memory_and_from_a_file(looks, more, extracted, files, tmp_path):
    settings, written, opened = replace(SETTINGS, **looks, **more), [], []
    for share in (0.5, 0.0):
        path = tmp_path / f"{share}.ply"
        budget = replace(FEW, spool_share=share)
        finish(reconstruct_steps(in_file(VOLUME), settings, budget, Write(path)))
        written.append(path.read_bytes())
        opened.append(len(files))
    assert len(extracted) == 2
    assert opened[1] - opened[0] == opened[0] + 1  # a PLY that is written in pieces has files of its own
    assert written[0] == written[1]
    assert all(file.closed for file in files)
    held = tmp_path / "held.ply"
    reconstruct(VOLUME, settings).mesh.save(held)
    assert held.read_bytes() == written[0]


def test_a_surface_that_is_looked_at_once_opens_no_file(files, tmp_path):
    finish(reconstruct_steps(in_file(VOLUME), SETTINGS, FEW, Write(tmp_path / "a.stl")))
    assert files == []


@pytest.mark.parametrize("looks", LOOKS)
def test_closing_the_steps_closes_the_file(looks, files, tmp_path):
    def started():
        return reconstruct_steps(in_file(VOLUME), replace(SETTINGS, **looks), FEW, Write(tmp_path / "a.stl"))

    count = sum(isinstance(item, Step) for item in started())
    files.clear()
    for taken in range(1, count, max(1, count // 7)):
        steps = started()
        for _ in range(taken):
            next(steps)
        steps.close()
        assert all(file.closed for file in files)
    assert files
    assert [path.name for path in tmp_path.iterdir()] == ["a.stl"]


def test_the_plan_counts_the_pieces_that_stay_in_memory(tmp_path):
    budget = Budget(bytes=1 << 30, work_bytes=1000, spool_share=0.25)
    sink = Write(tmp_path / "a.stl")

    def needed(share, **looks):
        return finish(plan_steps(VOLUME, replace(SETTINGS, **looks), replace(budget, spool_share=share), sink)).needed

    counts = finish(plan_steps(VOLUME, SETTINGS)).counts
    spooled = counts.vertices * VERTEX_BYTES + counts.faces * FACE_BYTES
    once = needed(0.25)
    assert needed(0.25, keep_parts=1) == needed(0.25, alpha="auto") == once + spooled
    assert needed(2.0**-20, keep_parts=1) == once + 1024
