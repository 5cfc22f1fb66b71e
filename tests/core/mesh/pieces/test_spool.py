# SPDX-License-Identifier: GPL-3.0-or-later
"""A spool gives back the arrays that it was given, from memory or from its file, which goes with it."""

import errno
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.core import OutputError, finish
from ctmc_addon.core.mesh.pieces import spool as spool_module
from ctmc_addon.core.mesh.pieces.spool import Spool, SpooledPieces, temporary_folder
from ctmc_addon.core.mesh.triangle_mesh import Surface, replayed_steps


def arrays(seed):
    random = np.random.default_rng(seed)
    return random.random((seed, 3), np.float32), random.integers(0, 99, (2 * seed, 3), np.int32)


def assert_equal(found, expected):
    assert [array.dtype for array in found] == [array.dtype for array in expected]
    assert all(np.array_equal(*each) for each in zip(found, expected, strict=True))


@pytest.mark.parametrize("most_bytes", [0, 100, 1 << 20])
def test_arrays_come_back_in_any_order_as_often_as_they_are_asked_for(most_bytes, tmp_path):
    with Spool(most_bytes, tmp_path) as spool:
        given = [arrays(seed) for seed in (3, 0, 5, 40)]
        numbers = [spool.put(*each) for each in given]
        for at in (2, 0, 3, 1, 3, 2):
            assert_equal(spool.get(numbers[at]), given[at])
        total = sum(array.nbytes for each in given for array in each)
        assert spool.held_bytes <= most_bytes
        assert spool.held_bytes + spool.file_bytes == total == 48 * 36
        assert_equal(spool.get(numbers[2], last=True), given[2])


def test_the_file_is_opened_when_memory_is_used_up_and_closed_with_the_spool(monkeypatch, tmp_path):
    opened = []
    monkeypatch.setattr(
        spool_module.tempfile, "TemporaryFile", lambda **named: opened.append(TEMPORARY(**named)) or opened[-1]
    )
    with Spool(36 * 3, tmp_path) as spool:
        spool.put(*arrays(3))
        assert not opened
        spool.put(*arrays(1))
        spool.put(*arrays(2))
        assert len(opened) == 1
        assert not opened[0].closed
    assert opened[0].closed
    assert list(tmp_path.iterdir()) == []


TEMPORARY = tempfile.TemporaryFile


class FullDisk:
    """A file that takes a few bytes, fewer than asked, and then no more."""

    def __init__(self, room):
        self.room, self.closed = room, False

    def seek(self, place):
        pass

    def write(self, given):
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        done = min(self.room, len(given), 7)
        self.room -= done
        return done

    def close(self):
        self.closed = True


def test_a_full_disk_is_one_sentence_and_the_file_goes(monkeypatch, tmp_path):
    disk = FullDisk(50)
    monkeypatch.setattr(spool_module.tempfile, "TemporaryFile", lambda **_: disk)
    with (
        pytest.raises(
            OutputError, match=r"no room in .* for the pieces of the surface .* \(No space left.*\); free space"
        ),
        Spool(0, tmp_path) as spool,
    ):
        spool.put(*arrays(3))
    assert disk.closed
    assert disk.room == 0


@pytest.mark.parametrize("most_bytes", [0, 1 << 20])
@pytest.mark.parametrize("normals", [False, True])
def test_pieces_come_back_with_what_their_maker_returned(most_bytes, normals, tmp_path):
    given = []
    for seed in (4, 0, 9):
        points, faces = arrays(seed)
        given.append(Surface(points, points + 1, faces, points - 2 if normals else None))
    with Spool(most_bytes, tmp_path) as spool:
        pieces = SpooledPieces(spool)
        finish(pieces.take_steps(replayed_steps(given, 17)))
        for last in (False, False, True):
            found, result = [], None
            steps = pieces.pieces_steps(last)
            while result is None:
                try:
                    item = next(steps)
                except StopIteration as end:
                    result = end.value
                else:
                    found += [item] if isinstance(item, Surface) else []
            assert result == 17
            for surface, expected in zip(found, given, strict=True):
                assert (surface.normals is None) == (not normals)
                names = ("midpoints", "linear", "faces", *(["normals"] if normals else []))
                assert_equal([getattr(surface, name) for name in names], [getattr(expected, name) for name in names])


def test_the_system_s_folder_on_disk_is_chosen_unless_another_is_named(monkeypatch, tmp_path):
    monkeypatch.delenv("TMPDIR", raising=False)
    monkeypatch.setattr("ctmc_addon.core.mesh.pieces.spool.VAR_TMP", tmp_path)
    assert temporary_folder() == (tmp_path if os.name == "posix" else Path(tempfile.gettempdir()))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert temporary_folder() == Path(tempfile.gettempdir())


def test_no_folder_for_temporary_files_is_a_sentence(monkeypatch):
    def none():
        raise FileNotFoundError(2, "No usable temporary directory")

    monkeypatch.setattr("ctmc_addon.core.mesh.pieces.spool.temporary_folder", none)
    with Spool(0) as spool, pytest.raises(OutputError, match="No usable temporary directory"):
        spool.put(np.zeros(3))
