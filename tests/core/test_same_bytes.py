# SPDX-License-Identifier: GPL-3.0-or-later
"""Memory, threads and where the values come from change no byte of a surface that is simplified."""

import hashlib
import re
import weakref
from dataclasses import replace

import numpy as np
import pytest
from volumes import in_file

from ctmc_addon.core import Budget, ReconstructionSettings, Volume, finish, reconstruct, result_and_full_steps
from ctmc_addon.core.errors import MemoryLimitError
from ctmc_addon.core.extraction import grid
from ctmc_addon.core.phantom import foam
from ctmc_addon.core.surfaces.extract import FieldSurface


@pytest.fixture(scope="module")
def sponge():
    """A foam of many triangles, whose values are in memory."""
    file = foam(12, 24, 16, 1)
    return Volume(file.slab(0, 12), file.affine)


def digest(result):
    mesh = result.mesh
    normals = b"" if mesh.normals is None else mesh.normals.tobytes()
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes() + normals).hexdigest()


def assert_same_bytes(volume, settings, budget, enough):
    """Two runs give one mesh, and one with too few bytes a sentence."""
    expected, file = reconstruct(volume, settings, budget), in_file(volume)
    digests, sentences = [], []
    for source, memory, slab_bytes in ((volume, None, 1), (file, enough, 1 << 10), (file, 10_000, 1)):
        given = replace(budget, threads=2, bytes=memory, slab_bytes=slab_bytes)
        try:
            digests.append(digest(reconstruct(source, settings, given)))
        except MemoryLimitError as refused:
            assert memory is not None
            sentences.append(str(refused))
    assert set(digests) == {digest(expected)}
    assert len(digests) == 2
    assert all(
        re.fullmatch(r"[a-z][^\n]* needs about \S+ [MG]iB of memory and \S+ [MG]iB are available; [^\n]+", sentence)
        for sentence in sentences
    )
    assert sentences
    return expected


@pytest.mark.once
@pytest.mark.parametrize("whole_faces", [700, 1 << 20])
@pytest.mark.parametrize("goal", [{"reduction": 0.9}, {"target_faces": 801, "keep_parts": 1}])
def test_with_a_number_of_triangles(sponge, monkeypatch, goal, whole_faces):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * 24 * 24)
    settings = ReconstructionSettings(threshold=132.0, close_border=True, **goal)
    enough = (3 if whole_faces == 700 else 64) << 20
    expected = assert_same_bytes(sponge, settings, Budget(threads=1, whole_faces=whole_faces), enough)
    assert expected.full_faces > 8 * 700


@pytest.mark.once
@pytest.mark.parametrize("whole_faces", [800, 1 << 20])
def test_within_a_maximum_error(monkeypatch, whole_faces):
    monkeypatch.setattr(grid, "UNIT_SAMPLES", 2 * 12 * 12)
    z, y, x = np.indices((12, 12, 12)) * (2 * np.pi / 14)
    waves = 100 * (np.sin(x) * np.cos(y) + np.sin(1.03 * y) * np.cos(z) + np.sin(z) * np.cos(0.9 * x))
    volume = Volume(waves.astype(np.int16), np.eye(4))
    settings = ReconstructionSettings(threshold=40.0, close_border=True, max_error_mm=0.5, normals="mesh")
    expected = assert_same_bytes(volume, settings, Budget(threads=1, whole_faces=whole_faces), 64 << 20)
    assert expected.full_faces > 1_600
    assert len(expected.mesh.faces) < 0.5 * expected.full_faces


@pytest.mark.once
def test_a_full_surface_that_does_not_fit_is_gone_before_it_is_simplified_as_it_comes(sponge, monkeypatch):
    settings = ReconstructionSettings(threshold=132.0, reduction=0.9)
    budget = Budget(threads=2, whole_faces=700, slab_bytes=1)
    whole, full = finish(result_and_full_steps(in_file(sponge), settings, budget))
    assert (len(full.mesh.faces), full.surface is not None) == (whole.full_faces, True)
    held = []
    full_surface_steps, result_steps = FieldSurface.full_steps, FieldSurface.result_steps

    def refused_steps(self):
        made = yield from full_surface_steps(self)
        held.append(weakref.ref(made))
        raise MemoryLimitError("the surface does not fit")

    def watched_steps(self):
        assert [one() for one in held] == [None]
        return (yield from result_steps(self))

    monkeypatch.setattr(FieldSurface, "full_steps", refused_steps)
    monkeypatch.setattr(FieldSurface, "result_steps", watched_steps)
    result, nothing = finish(result_and_full_steps(in_file(sponge), settings, budget))
    assert nothing is None
    assert len(held) == 1
    assert (result.notes, digest(result)) == (whole.notes, digest(whole))
