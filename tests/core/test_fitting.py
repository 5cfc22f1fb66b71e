# SPDX-License-Identifier: GPL-3.0-or-later
"""What is proposed where a surface does not fit was counted, and fits."""

import re
from dataclasses import replace

import pytest

from ctmc_addon.core import MemoryLimitError, ReconstructionSettings, fitting, reconstruct
from ctmc_addon.core.phantom import foam
from ctmc_addon.core.pipeline import reconstruct_steps
from ctmc_addon.core.progress import finish
from ctmc_addon.core.streaming import counted_faces_steps
from ctmc_addon.core.volume import Volume

SETTINGS = ReconstructionSettings(threshold=132.0)


@pytest.fixture(scope="module")
def file():
    return foam(40, 60, 20, 1)


@pytest.mark.parametrize("more", [{}, {"stride": (2, 3, 1)}, {"close_border": True}, {"topology": "trilinear"}])
def test_triangles_are_counted_exactly(file, more):
    settings = replace(SETTINGS, **more)
    volume = Volume(file.slab(0, 40), file.affine)
    faces = len(reconstruct(volume, settings).mesh.faces)
    assert finish(counted_faces_steps(volume, settings)) == faces
    assert finish(counted_faces_steps(file, settings)) == faces


def test_what_does_not_fit_is_refused_with_settings_that_do(file, monkeypatch):
    monkeypatch.setattr(fitting, "SLABS_BYTES", 0)
    faces = finish(counted_faces_steps(file, SETTINGS))
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


def test_another_error_stays_what_it_is(file):
    def failing_steps():
        yield from ()
        raise RuntimeError("other")

    with pytest.raises(RuntimeError, match=r"^other$"):
        finish(fitting.advised_steps(failing_steps(), file, SETTINGS))
