import os

import numpy as np
import pytest
from PIL import Image

from ctmc_addon.cli.batch.files import (
    UNFINISHED,
    failed_record,
    fingerprint_of,
    put_record,
    put_text,
    read_record,
    remove_output,
    stands_for,
    without_folders,
)
from ctmc_addon.core.errors import OutputError
from ctmc_addon.readers import open_volume


@pytest.fixture
def task(tmp_path):
    output = {"name": "a", "settings": {"label": 2, "stride": [1, 1, 1]}}
    return {
        "case": "a", "input": str(tmp_path / "in" / "a.nii"), "folder": str(tmp_path), "outputs": [output],
        "reading": {"spacing": None, "flip": "", "series": None, "strict": False}, "format": ".stl", "space": "ras",
    }  # fmt: skip


def finished(task):
    record = failed_record(task, task["outputs"][0], "", 1.0, "abc")
    return record | {"status": "done", "error": None, "file_bytes": {"a.stl": 3}}


def test_a_fingerprint_follows_content_and_not_time_or_place(tmp_path):
    (tmp_path / "x").mkdir()
    values = np.zeros((2, 30, 40), np.uint8)
    for name in ("a.npy", "x/b.npy"):
        np.save(tmp_path / name, values)
    first = fingerprint_of(tmp_path / "a.npy")
    os.utime(tmp_path / "a.npy", (1, 1))
    assert fingerprint_of(tmp_path / "a.npy") == first == fingerprint_of(tmp_path / "x" / "b.npy")
    values[1, 15, 0] = 1
    np.save(tmp_path / "a.npy", values)
    assert fingerprint_of(tmp_path / "a.npy") != first


def test_the_fingerprint_of_slices_knows_their_order(tmp_path):
    for number in (1, 2):
        Image.new("L", (3, 4), number).save(tmp_path / f"{number}.png")
    first = fingerprint_of(tmp_path)
    assert fingerprint_of(tmp_path / "1.png") == first  # a lone slice stands for its folder
    (tmp_path / "1.png").rename(tmp_path / "3.png")
    assert fingerprint_of(tmp_path) != first


def test_a_detached_header_brings_its_data_along(tmp_path):
    (tmp_path / "a.nhdr").write_text(
        "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\ndata file: a.raw\n\n"
    )
    (tmp_path / "a.raw").write_bytes(bytes(8))
    (tmp_path / "b.raw").write_bytes(bytes(8))
    assert [file.name for file in open_volume(tmp_path / "a.nhdr").files] == ["a.nhdr", "a.raw"]


def test_a_json_stands_for_its_output_only_with_the_same_settings_version_and_files(task, tmp_path):
    [output] = task["outputs"]
    (tmp_path / "a.stl").write_bytes(b"abc")
    assert stands_for(finished(task), task, output)
    for changed in ({"settings": {"label": 1}}, {"version": "0.0.0"}, {"space": "lps"}, {"status": "failed"}):
        assert not stands_for(finished(task) | changed, task, output)
    assert not stands_for(finished(task), task | {"reading": {"flip": "x"}}, output)
    (tmp_path / "a.stl").write_bytes(b"ab")
    assert not stands_for(finished(task), task, output)
    (tmp_path / "a.stl").unlink()
    assert not stands_for(finished(task), task, output)


def test_half_a_json_is_no_record(tmp_path):
    assert read_record(tmp_path, "a") is None
    for text in ('{"case": "a", ', "[]", ""):
        (tmp_path / "a.json").write_text(text)
        assert read_record(tmp_path, "a") is None


def test_an_old_output_goes_with_its_json_first(tmp_path, monkeypatch):
    gone = []
    monkeypatch.setattr(type(tmp_path), "unlink", lambda path, missing_ok=False: gone.append(path.name))
    remove_output(tmp_path, "a", ".stl")
    assert gone == ["a.json", "a.stl", "a.png"]


def test_a_full_disk_leaves_the_old_summary(tmp_path, monkeypatch):
    put_text(tmp_path / "summary.json", "old")

    def full(self, content):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(type(tmp_path), "write_bytes", full)
    with pytest.raises(OutputError, match="the disk is full"):
        put_record(tmp_path, "summary", {"new": np.pi})
    assert (tmp_path / "summary.json").read_text() == "old"
    assert list((tmp_path / UNFINISHED).iterdir()) == []


@pytest.mark.parametrize(
    ("sentence", "short"),
    [
        ("{input} is truncated", "a.nii is truncated"),
        ("{folder}/in/b c.nii is empty", "in/b c.nii is empty"),
        ("see /usr/lib/x.so and C:\\Users\\x\\y.nii", "see x.so and y.nii"),
        ("two\n  lines", "two lines"),
        ("error:/usr/lib/x.so, see https://host/a/b.html", "error:x.so, see https://host/a/b.html"),
        ("2 / 3 mm or 2/3 of ../a/b", "2 / 3 mm or 2/3 of ../a/b"),
    ],
)
def test_sentences_lose_their_folders(task, sentence, short):
    text = sentence.format(input=task["input"], folder=task["folder"])
    folder = os.path.basename(task["folder"])  # noqa: PTH119
    assert without_folders(text, task).removeprefix(f"{folder}/") == short
    assert task["folder"] not in without_folders(text, task)
