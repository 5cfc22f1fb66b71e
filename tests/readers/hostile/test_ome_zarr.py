# SPDX-License-Identifier: GPL-3.0-or-later
"""Stores that are broken or made to do harm: one sentence each, before memory is taken or anything runs."""

from __future__ import annotations

import gzip
import json
import os
import pickle
import zlib

import numpy as np
import pytest

pytest.importorskip("zarr")

from zarr_stores import multiscales, save_by_hand, save_store

from ctmc_addon.core import Budget, CtmcError, MemoryLimitError, finish
from ctmc_addon.readers import open_volume, read_volume

VALUES = np.random.default_rng(1).integers(500, 9000, (9, 10, 11)).astype("u2")
CHUNKS = (4, 5, 6)


@pytest.fixture
def store(tmp_path):
    return save_by_hand(tmp_path / "scan.ome.zarr", VALUES, CHUNKS)


def change(path, **fields):
    about = json.loads(path.read_text())
    about.update(fields)
    path.write_text(json.dumps(about))


def refusal(path, **options):
    with pytest.raises(CtmcError) as refused:
        read_volume(path, **options)
    sentence = str(refused.value)
    assert "\n" not in sentence
    assert len(sentence) < 400
    return sentence


class Harm:
    """What runs when it is unpickled."""

    def __reduce__(self):
        return (os.mkdir, ("harm",))


@pytest.mark.parametrize(
    "fields",
    [
        {"filters": [{"id": "pickle"}]},
        {"filters": {"id": "pickle"}},
        {"compressor": {"id": "pickle"}},
        {"compressor": {"id": "zlib", "name": "pickle"}},
        {"compressor": {"id": "blosc", "inner": [{"id": "pickle"}]}},
    ],
)
def test_nothing_is_unpickled(store, monkeypatch, fields):
    monkeypatch.chdir(store.parent)
    for file in (store / "0").rglob("*"):
        if file.is_file() and not file.name.startswith("."):
            file.write_bytes(pickle.dumps(Harm()))
    change(store / "0" / ".zarray", **fields)
    assert refusal(store) == (
        "level 0 of scan.ome.zarr is packed by the codec 'pickle', which is not read; save it with Blosc or Zstandard"
    )
    assert not (store.parent / "harm").exists()


def test_codecs_of_version_3_are_looked_at_within_shards(tmp_path):
    store = save_store(tmp_path / "scan.ome.zarr", VALUES, chunks=(3, 5, 6), shards=(9, 10, 12))
    about = json.loads((store / "0" / "zarr.json").read_text())
    about["codecs"][0]["configuration"]["codecs"].append({"name": "numcodecs.pickle"})
    (store / "0" / "zarr.json").write_text(json.dumps(about))
    assert "is packed by the codec 'numcodecs.pickle', which is not read" in refusal(store)


@pytest.mark.parametrize(
    ("dtype", "words"),
    [
        ("<f2", "holds values of type float16; convert them to int16 or float32"),
        ("<c8", "has metadata that zarr does not read"),
        ("|O", "has metadata that zarr does not read"),
        ("|S9", "has metadata that zarr does not read"),
        ([["a", "<i2"], ["b", "<i2"]], "export it again as int16 or float32"),
        (7, "export it again as int16 or float32"),
    ],
)
def test_types_that_are_no_gray_values_are_refused(store, dtype, words):
    change(store / "0" / ".zarray", dtype=dtype)
    assert words in refusal(store)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"shape": [9, 10]}, "has metadata that zarr does not read"),
        ({"shape": [9, 10, -1]}, "has metadata that zarr does not read"),
        ({"shape": [9, 10, 2.5]}, "has metadata that zarr does not read"),
        ({"shape": [9, 10, True]}, "at least 2 samples along every axis"),
        ({"shape": "9"}, "has metadata that zarr does not read"),
        ({"shape": [9, 10, 1 << 70]}, "has the shape (9, 10, 1180591620717411303424)"),
        ({"chunks": [0, 5, 6]}, "and chunks of (0, 5, 6), which is not a volume"),
        ({"chunks": None}, "has metadata that zarr does not read"),
        ({"zarr_format": 4}, "has metadata that zarr does not read"),
        ({"order": "Q"}, "has metadata that zarr does not read"),
        ({"compressor": {"id": "blosc", "cname": 7}}, "unpacks to far more bytes than its size allows"),
        ({"compressor": {"id": "zlib", "level": "x"}}, "is truncated or damaged"),
        ({"fill_value": "words"}, "has metadata that zarr does not read"),
    ],
)
def test_metadata_of_an_array_that_are_none_are_refused(store, fields, words):
    change(store / "0" / ".zarray", **fields)
    assert words in refusal(store)


def test_sizes_that_do_not_fit_are_refused_before_anything_is_read(store):
    change(store / "0" / ".zarray", shape=[1 << 20, 1 << 20, 1 << 20])
    with pytest.raises(MemoryLimitError, match=r"^reading scan.ome.zarr \(1048576 x 1048576 x 1048576\) needs about"):
        read_volume(store)
    looking = "looking at level 0 of scan.ome.zarr (1048576 x 1048576 x 1) needs about 2048.0 GiB of memory"
    assert refusal(store, region=(0, 0, 0, 3, 3, 3)).startswith(looking)


def test_chunks_that_do_not_fit_are_refused_before_they_are_read(store):
    change(store / "0" / ".zarray", chunks=[1 << 20, 1 << 20, 1 << 20])
    assert refusal(store).startswith(
        "reading one chunk of level 0 of scan.ome.zarr (1048576 x 1048576 x 1048576) needs about"
    )
    small = save_by_hand(store.parent / "small.ome.zarr", VALUES, CHUNKS)
    with pytest.raises(MemoryLimitError, match=r"reading one chunk of level 0 of small.ome.zarr"):
        finish(open_volume(small).read_steps(budget=Budget(bytes=200)))


@pytest.mark.parametrize(
    ("about", "words"),
    [
        ({}, "is a Zarr store without an image of OME-Zarr (multiscales)"),
        ({"multiscales": []}, "is a Zarr store without an image of OME-Zarr (multiscales)"),
        ({"multiscales": [7]}, "has 0 axes and 0 resolutions"),
        (
            {"multiscales": [multiscales("0.4") | {"version": "0.3"}]},
            "is OME-Zarr 0.3, and 0.4 and 0.5 are read; write",
        ),
        (
            {"multiscales": [{"axes": ["z", "y", "x"], "datasets": [{"path": "0"}]}]},
            "scan.ome.zarr is OME-Zarr 0.3, and 0.4 and 0.5 are read; write it again as one of them, which ome-zarr-py "
            "and bioformats2raw from 0.5 on do",
        ),
        ({"multiscales": [{"datasets": [{"path": "0"}]}]}, "is OME-Zarr 0.2 or older, and 0.4 and 0.5 are read"),
        ({"multiscales": [multiscales("0.4") | {"version": "0.6"}]}, "is OME-Zarr 0.6, and 0.4 and 0.5 are read"),
        ({"multiscales": [multiscales("0.4", axes="yx")]}, "has 3 axes, and its metadata name 2"),
        ({"multiscales": [multiscales("0.4", axes="tyx")]}, "has only one slice (axes t y x)"),
        ({"multiscales": [multiscales("0.4") | {"axes": "zyx"}]}, "has 0 axes and 1 resolutions"),
        ({"multiscales": [multiscales("0.4") | {"datasets": [{"path": "../0"}]}]}, "but '../0'"),
        ({"multiscales": [multiscales("0.4") | {"datasets": [{"path": "/etc"}]}]}, "but '/etc'"),
        ({"multiscales": [multiscales("0.4") | {"datasets": [{"path": 0}]}]}, "but '0'"),
        ({"multiscales": [multiscales("0.4", levels=2)]}, "level 1 of scan.ome.zarr is missing"),
        ({"plate": {}}, "is a plate of many images"),
    ],
)
def test_metadata_of_an_image_that_are_none_are_refused(store, about, words):
    (store / ".zattrs").write_text(json.dumps(about))
    assert words in refusal(store)


@pytest.mark.parametrize(
    "transform",
    [
        {"type": "scale", "scale": [1, 2]},
        {"type": "scale", "scale": [1, 2, "3"]},
        {"type": "scale", "scale": [1, 2, float("nan")]},
        {"type": "scale", "scale": [1, 2, float("inf")]},
        {"type": "scale", "scale": [1, 2, 1 << 900]},
        {"type": "scale", "path": "0"},
        {"type": "affine", "affine": [1, 2, 3]},
        {"type": []},
        "scale",
    ],
)
def test_transformations_that_are_none_are_refused(store, transform):
    about = multiscales("0.4")
    about["datasets"][0]["coordinateTransformations"] = [transform]
    (store / ".zattrs").write_text(json.dumps({"multiscales": [about]}))
    assert refusal(store).startswith("level 0 of scan.ome.zarr has the transformation ")


def test_a_scale_of_nothing_is_refused(store):
    about = multiscales("0.4")
    about["datasets"][0]["coordinateTransformations"] = [{"type": "scale", "scale": [0, 1, 1]}]
    (store / ".zattrs").write_text(json.dumps({"multiscales": [about]}))
    assert "has a spacing of 1 x 1 x 0 mm, and it must be from 1e-06 to 10000 mm" in refusal(store)


def test_an_image_without_a_scale_has_a_millimeter(store):
    about = multiscales("0.4")
    about["datasets"][0]["coordinateTransformations"] = []
    (store / ".zattrs").write_text(json.dumps({"multiscales": [about]}))
    volume = read_volume(store)
    assert volume.spacing == (1, 1, 1)
    assert "OME-Zarr has no spacing: 1 mm is assumed along x, y and z; give the spacing in mm" in volume.notes


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff\xfe", b"[" * 100_000, b'{"shape": ' + b"9" * 9000 + b"}"])
@pytest.mark.parametrize("name", [".zattrs", "0/.zarray"])
def test_metadata_that_are_not_json_are_refused(store, name, content):
    (store / name).write_bytes(content)
    assert "is not readable metadata of Zarr; export or copy it again" in refusal(store)


def test_a_store_without_chunks_is_refused(tmp_path):
    skip = {(z, y, x) for z in range(3) for y in range(2) for x in range(2)}
    store = save_by_hand(tmp_path / "scan.ome.zarr", VALUES, CHUNKS, skip=skip)
    assert refusal(store) == "level 0 of scan.ome.zarr has none of its 12 chunks; copy the whole store again"


@pytest.mark.parametrize("content", [b"", b"short", bytes(4 * 5 * 6 * 2 + 1), bytes(4 * 5 * 6 * 2 - 1)])
def test_a_chunk_of_the_wrong_length_is_refused(store, content):
    (store / "0" / "1" / "0" / "1").write_bytes(content)
    assert "level 0 of scan.ome.zarr is truncated or damaged" in refusal(store)


@pytest.mark.parametrize("codec", ["zlib", "gzip", "bz2", "lzma", "zstd", "lz4", "blosc"])
def test_a_chunk_of_noise_is_refused_in_every_codec(tmp_path, codec):
    store = save_by_hand(tmp_path / "scan.ome.zarr", VALUES, CHUNKS, compressor={"id": codec})
    sentence = "chunk 0/0/0 of level 0 of scan.ome.zarr unpacks to far more bytes than its size allows; export it again"
    if codec in ("lz4", "blosc"):  # whose first bytes are a length
        assert refusal(store) == sentence
    else:
        assert "level 0 of scan.ome.zarr is truncated or damaged" in refusal(store)


@pytest.mark.parametrize(("codec", "packed"), [("zlib", zlib.compress), ("gzip", gzip.compress)])
def test_a_chunk_that_unpacks_without_end_is_refused_before_it_is_unpacked(tmp_path, codec, packed):
    store = save_by_hand(tmp_path / "scan.ome.zarr", VALUES, CHUNKS, compressor={"id": codec})
    bomb = packed(bytes(130 << 20))
    for file in (store / "0").rglob("*"):
        if file.is_file() and not file.name.startswith("."):
            file.write_bytes(bomb)
    assert refusal(store).endswith("unpacks to far more bytes than its size allows; export it again")


def test_a_level_that_is_a_link_out_of_the_store_is_refused(store, tmp_path):
    (store / "0").rename(tmp_path / "elsewhere")
    (store / "0").symlink_to(tmp_path / "elsewhere", target_is_directory=True)
    assert refusal(store) == "level 0 of scan.ome.zarr is a link out of its folder; copy the array into the store"


def test_a_level_that_is_a_file_or_an_array_alone_is_refused(store, tmp_path):
    assert refusal(store / "0").startswith("0 is one array of a Zarr store")
    (tmp_path / "packed.zarr").write_bytes(b"PK\x03\x04")
    assert refusal(tmp_path / "packed.zarr") == (
        "packed.zarr is a file, and an OME-Zarr is a folder; unpack it, and choose the folder"
    )
