# SPDX-License-Identifier: GPL-3.0-or-later
import os

import numpy as np
import pytest
from PIL import Image

from ctmc_addon.cli.batch import files
from ctmc_addon.cli.batch.files import (
    failed_record,
    input_key,
    is_same_input,
    key_or_empty,
    put_output,
    read_record,
    stands_for,
    without_folders,
)
from ctmc_addon.core.errors import OutputError
from ctmc_addon.readers import files_below, open_volume


@pytest.fixture
def task(tmp_path):
    output = {"name": "a", "settings": {"label": 2, "stride": [1, 1, 1]}, "labels": [], "beside": []}
    return {
        "case": "a", "input": str(tmp_path / "in" / "a.nii"), "folder": str(tmp_path), "outputs": [output],
        "reading": {"spacing": None, "flip": "", "series": None, "strict": False}, "format": ".stl", "space": "ras",
        "run": "1",
    }  # fmt: skip


def finished(task):
    record = failed_record(task, task["outputs"][0], "", 1.0)
    return record | {"status": "done", "error": None, "file_bytes": {"a.stl": 3}}


def key_of(path, verify=True):
    return input_key(open_volume(path), verify)


def test_an_input_is_known_by_name_size_and_time_or_by_its_content(tmp_path):
    file = tmp_path / "a.npy"
    values = np.zeros((2, 30, 40), np.uint8)
    np.save(file, values)
    os.utime(file, ns=(1, 1))
    first = key_of(file)
    assert key_of(file, verify=False) == {"fingerprint": first["fingerprint"]}
    os.utime(file, ns=(1, 2))
    assert not is_same_input(first, key_or_empty(file, False))
    assert is_same_input(first, key_or_empty(file, True))
    values[1, 15, 0] = 1
    np.save(file, values)
    os.utime(file, ns=(1, 1))
    assert is_same_input(first, key_or_empty(file, False))
    assert not is_same_input(first, key_or_empty(file, True))
    file.unlink()
    assert not is_same_input(first, key_or_empty(file, False))


def test_the_key_of_slices_knows_their_order(tmp_path):
    for number in (1, 2):
        Image.new("L", (3, 4), number).save(tmp_path / f"{number}.png")
    first = key_of(tmp_path)
    assert key_of(tmp_path / "1.png") == first  # a lone slice stands for its folder
    (tmp_path / "1.png").rename(tmp_path / "3.png")
    second = key_of(tmp_path)
    assert second["fingerprint"] != first["fingerprint"]
    assert second["content_hash"] != first["content_hash"]


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


def test_new_files_come_after_the_older_json_has_gone_and_before_the_new_one(tmp_path, monkeypatch):
    (tmp_path / "run").mkdir()
    for name in ("a.stl", "a.json", "run/a.stl", "run/a.png"):
        (tmp_path / name).write_text(name)

    def full(path, record):
        assert not (tmp_path / "a.json").exists()
        raise OutputError("the disk is full")

    monkeypatch.setattr("ctmc_addon.cli.batch.files.write_json", full)
    with pytest.raises(OutputError, match="disk is full"):
        put_output(tmp_path, "a", tmp_path / "run", [tmp_path / "run" / "a.stl"], tmp_path / "run" / "a.png", {})
    assert (tmp_path / "a.stl").read_text() == "run/a.stl"
    assert (tmp_path / "thumbnails" / "a.png").read_text() == "run/a.png"


@pytest.mark.parametrize("others", [[], ["a/own.txt"]])
def test_older_surfaces_of_several_labels_go_with_their_folder_where_nothing_else_is_in_it(tmp_path, others):
    for name in ("run/a.stl", "a/left.stl", "a/right.stl", *others):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    (tmp_path / "a.json").write_text('{"files": ["a/left.stl", "a/right.stl"]}')
    put_output(tmp_path, "a", tmp_path / "run", [tmp_path / "run" / "a.stl"], None, {})
    left = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")}
    assert left == {"run", "a.stl", "a.json", *others, *(["a"] if others else [])}


def test_a_folder_of_slices_is_looked_through_once_for_each_case(task, tmp_path, monkeypatch):
    looked = []
    monkeypatch.setattr(files, "files_below", lambda folder: looked.append(folder) or files_below(folder))
    for name in ("x/MUSTER_1.dcm", "MUSTER_1.dcm", "MUSTER_1.dcm.bak", "MUSTER_10.dcm", "a"):
        (tmp_path / "scan" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "scan" / name).touch()
    slices = task | {"input": str(tmp_path / "scan")}
    for _ in range(3):
        said = without_folders("MUSTER_1.dcm, MUSTER_10.dcm and MUSTER_1.dcm.bak, and a MUSTER_1.dcm-x", slices)
        assert said == "file 2 of 5, file 4 of 5 and file 3 of 5, and a MUSTER_1.dcm-x"
    assert len(looked) == 1
    (tmp_path / "scan" / "MUSTER_2.dcm").touch()
    assert without_folders("MUSTER_2.dcm", slices | {"case": "b"}) == "file 4 of 6"
    assert len(looked) == 2


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
