# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces of several labels go to their files one by one, with the bytes they have together."""

import weakref

import numpy as np
import pytest

from ctmc_addon.cli import label_writer
from ctmc_addon.cli.piece_writer import NOT_HELD
from ctmc_addon.core import MemoryLimitError, ReconstructionSettings, Volume, finish, reconstruct
from ctmc_addon.core.volume import SlabVolume


@pytest.fixture
def volume():
    boxes = np.kron([[1, 2], [3, 4]], np.pad(np.ones((8, 8)), 2))
    values = np.pad(np.broadcast_to(boxes, (8, 24, 24)), ((2, 2), (0, 0), (0, 0))).astype(np.uint8)
    return Volume(values, np.diag([0.8, 0.8, 2.0, 1.0]), kind="label")


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
@pytest.mark.parametrize("limit", [None, 1000])
def test_a_file_has_the_bytes_of_the_surface_whether_it_fits_or_not(volume, tmp_path, suffix, limit):
    settings = ReconstructionSettings(label=3, smoothing="gaussian", min_part_mm3=1.0)
    expected = reconstruct(volume, settings)
    expected.mesh.save(tmp_path / f"expected{suffix}")
    with label_writer.label_writer(tmp_path, suffix, "ras") as writer:
        made = finish(writer.make_steps(SlabVolume.of(volume), settings, 1, limit, False))
        assert writer.path_of(settings).read_bytes() == (tmp_path / f"expected{suffix}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 1
    assert len(made.mesh.faces) == 0
    assert made.measures.faces == made.full_faces == len(expected.mesh.faces)
    assert made.measures.enclosed_volume == pytest.approx(expected.measures.enclosed_volume)
    assert (NOT_HELD in made.notes) == (limit is not None)


def test_beside_others_what_does_not_fit_is_refused_to_be_made_alone(volume, tmp_path):
    with label_writer.label_writer(tmp_path, ".stl", "ras") as writer, pytest.raises(MemoryLimitError):
        finish(writer.make_steps(volume, ReconstructionSettings(label=3, smoothing="none"), 1, 1000, True))


def test_one_surface_is_gone_before_the_next_is_made(ctmc, volume, tmp_path, monkeypatch):
    np.save(tmp_path / "labels.npy", volume.values)
    made, reconstruct_steps = [], label_writer.reconstruct_steps

    def watched_steps(*given, **named):
        assert [one for one in made if one() is not None] == []
        result = yield from reconstruct_steps(*given, **named)
        made.append(weakref.ref(result.mesh))
        return result

    monkeypatch.setattr(label_writer, "reconstruct_steps", watched_steps)
    done = ctmc("reconstruct", tmp_path / "labels.npy", "--label", "all", "--threads", "1", "-o", f"{tmp_path}/out/")
    assert done.code == 0, done.errors
    assert len(made) == 4
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [f"label {label}.stl" for label in range(1, 5)]
