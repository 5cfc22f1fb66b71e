# SPDX-License-Identifier: GPL-3.0-or-later
"""Surfaces go to their files one by one, with the bytes that they have together."""

import weakref

import numpy as np
import pytest

from ctmc_addon.cli.surface_writer import surface_writer
from ctmc_addon.core import Budget, OutputError, ReconstructionSettings, Volume, finish, reconstruct, reconstruct_steps
from ctmc_addon.core.sinks import write


@pytest.fixture
def volume():
    boxes = np.kron([[1, 2], [3, 4]], np.pad(np.ones((8, 8)), 2))
    values = np.pad(np.broadcast_to(boxes, (8, 24, 24)), ((2, 2), (0, 0), (0, 0))).astype(np.uint8)
    return Volume(values, np.diag([0.8, 0.8, 2.0, 1.0]), kind="label")


@pytest.mark.parametrize("suffix", [".stl", ".ply"])
@pytest.mark.parametrize("more", [{}, {"reduction": 0.5}])
def test_a_file_has_the_bytes_of_the_surface_and_the_result_its_measures(volume, tmp_path, suffix, more):
    settings = ReconstructionSettings(label=3, smoothing="gaussian", min_part_mm3=1.0, **more)
    expected = reconstruct(volume, settings)
    expected.mesh.save(tmp_path / f"expected{suffix}")
    with surface_writer(tmp_path, suffix, "ras") as writer:
        made = finish(reconstruct_steps(volume, settings, Budget(threads=1, slab_bytes=1), writer.sink_of(3)))
        assert writer.path_of(3).read_bytes() == (tmp_path / f"expected{suffix}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 1
    assert len(made.mesh.faces) == 0
    assert made.measures == expected.measures
    assert made.full_faces == expected.full_faces


def test_one_surface_is_gone_before_the_next_is_made(ctmc, volume, tmp_path, monkeypatch):
    np.save(tmp_path / "labels.npy", volume.values)
    seen, write_pieces_steps = [], write.write_pieces_steps

    def watched_steps(path, pieces, space):
        assert [one for one in seen if one() is not None] == []

        def watched():
            for item in pieces:
                if hasattr(item, "faces"):
                    seen.append(weakref.ref(item))
                yield item
                del item

        return (yield from write_pieces_steps(path, watched(), space))

    monkeypatch.setattr(write, "write_pieces_steps", watched_steps)
    words = ("--label", "all", "--interfaces", "separate", "--threads", "1", "-o", f"{tmp_path}/out/")
    done = ctmc("reconstruct", tmp_path / "labels.npy", *words)
    assert done.code == 0, done.errors
    assert len(seen) == 4
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [f"label {label}.stl" for label in range(1, 5)]


def test_a_folder_that_went_away_is_named_without_the_hidden_one(tmp_path):
    with pytest.raises(OutputError, match="gone") as refusal, surface_writer(tmp_path / "gone", ".stl", "ras"):
        pass
    assert ".ctmc" not in str(refusal.value)
