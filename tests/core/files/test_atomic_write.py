# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that appear whole or not at all, alone and together."""

import errno
import os
import stat
from pathlib import Path

import pytest

from ctmc_addon.core import OutputError
from ctmc_addon.core.files.atomic_write import require_writable, whole_file, whole_files, write_json
from ctmc_addon.core.files.temporary_names import temporary_name


def everything_in(folder: Path) -> dict[str, str]:
    return {path.name: "folder" if path.is_dir() else path.read_text() for path in sorted(folder.iterdir())}


def test_a_file_appears_whole(tmp_path):
    with whole_file(tmp_path / "a.txt") as beside:
        beside.write_text("new")
        assert not (tmp_path / "a.txt").exists()
    assert everything_in(tmp_path) == {"a.txt": "new"}


def write_half(path: Path) -> None:
    with whole_file(path) as beside:
        beside.write_text("half")
        raise ZeroDivisionError


def write_both(folder: Path) -> None:
    with whole_files([folder / "a.txt", folder / "b.txt"]) as places:
        for place in places.values():
            place.write_text("new")


def test_an_error_leaves_the_older_file(tmp_path):
    (tmp_path / "a.txt").write_text("older")
    with pytest.raises(ZeroDivisionError):
        write_half(tmp_path / "a.txt")
    assert everything_in(tmp_path) == {"a.txt": "older"}


def test_a_missing_folder_is_refused(tmp_path):
    with pytest.raises(OutputError, match=r"b\.txt"), whole_file(tmp_path / "a" / "b.txt"):
        pass


@pytest.mark.parametrize(
    ("suffixes", "needed"),
    [((".csv",), "the suffix .csv"), ((".stl", ".ply"), "one of the suffixes .stl, .ply; it chooses the format")],
)
def test_a_name_without_a_known_suffix_is_told_which_it_needs(tmp_path, suffixes, needed):
    with pytest.raises(OutputError) as error:
        require_writable(tmp_path / "a.txt", suffixes)
    assert str(error.value) == f"a.txt needs {needed}"


@pytest.mark.parametrize("prefix", [".ctmc-", ".ctmc-run-"])
def test_a_full_disk_is_said_without_the_folders_of_what_is_not_complete(tmp_path, prefix):
    hidden = tmp_path / temporary_name(prefix) / "case"
    hidden.mkdir(parents=True)
    with pytest.raises(OutputError) as error, whole_file(hidden / "bone.stl"):
        raise OSError(errno.ENOSPC, "")
    assert str(error.value).startswith(f"{tmp_path / 'case' / 'bone.stl'} cannot be written: the disk is full")


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("older", [{}, {"a.txt": "older a"}, {"a.txt": "older a", "b.txt": "older b"}])
def test_when_one_file_cannot_be_moved_none_is(tmp_path, monkeypatch, links, older):
    for name, text in older.items():
        (tmp_path / name).write_text(text)
    plain = Path.replace

    def replace(self, target):
        if self.name == Path(target).name == "b.txt":
            raise PermissionError(13, "denied")
        return plain(self, target)

    def link(*_names):
        raise OSError("no links here")

    monkeypatch.setattr(Path, "replace", replace)
    if not links:
        monkeypatch.setattr(os, "link", link)
    with pytest.raises(OutputError, match=r"b\.txt"):
        write_both(tmp_path)
    assert everything_in(tmp_path) == older


def test_a_folder_in_the_place_of_the_second_file_leaves_the_first(tmp_path):
    (tmp_path / "a.txt").write_text("older")
    (tmp_path / "b.txt").mkdir()
    with pytest.raises(OutputError, match=r"b\.txt"):
        write_both(tmp_path)
    assert everything_in(tmp_path) == {"a.txt": "older", "b.txt": "folder"}


def test_bytes_reach_the_disk_before_the_name_does(tmp_path, monkeypatch):
    done, fsync, replace = [], os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda handle: done.append("sync") or fsync(handle))
    monkeypatch.setattr(Path, "replace", lambda self, target: done.append("move") or replace(self, target))
    write_json(tmp_path / "a.json", {"b": 1})
    with whole_files([tmp_path / "c.txt"]) as places:
        places[tmp_path / "c.txt"].write_text("c")
    folders = [] if os.name == "nt" else ["sync"]
    assert done == ["sync", "move", *folders] * 2


@pytest.mark.parametrize("error", [KeyboardInterrupt, MemoryError])
def test_when_the_second_move_is_interrupted_the_first_is_taken_back(tmp_path, monkeypatch, error):
    (tmp_path / "a.txt").write_text("older a")
    plain = Path.replace

    def replace(self, target):
        if self.name == Path(target).name == "b.txt":
            raise error
        return plain(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(error):
        write_both(tmp_path)
    assert everything_in(tmp_path) == {"a.txt": "older a"}


def write_one_alone(path: Path) -> None:
    with whole_file(path) as beside:
        beside.unlink()  # as Blender does, which writes a file of its own
        beside.write_text("new")


def write_one_of_many(path: Path) -> None:
    with whole_files([path]) as places:
        places[path].write_text("new")


@pytest.mark.parametrize("write", [write_one_alone, write_one_of_many])
@pytest.mark.skipif(os.name == "nt", reason="Windows keeps no modes, and links only for administrators")
def test_links_and_permissions_stay(tmp_path, write):
    real, link = tmp_path / "elsewhere" / "real.txt", tmp_path / "a.txt"
    real.parent.mkdir()
    real.write_text("older")
    real.chmod(0o600)
    link.symlink_to(real)
    write(link)
    assert link.is_symlink()
    assert everything_in(real.parent) == {"real.txt": "new"}
    assert stat.S_IMODE(real.stat().st_mode) == 0o600
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "elsewhere"]


def test_what_a_killed_process_left_goes_and_what_others_write_stays(tmp_path, name_of_an_ended_process):
    (tmp_path / name_of_an_ended_process()).mkdir()
    (tmp_path / f"{name_of_an_ended_process()}.stl").write_text("half")
    kept = [".ctmc-0123456789ab.stl", ".ctmc-run-00000000-1-0123456789ab", temporary_name()]
    for name in kept:
        (tmp_path / name).write_text("half")
    require_writable(tmp_path / "a.stl")
    assert sorted(everything_in(tmp_path)) == sorted(kept)
