# SPDX-License-Identifier: GPL-3.0-or-later
"""OME-Zarr: values and places as zarr and the format's description have them, whole, in part and by levels."""

from __future__ import annotations

import itertools
import json
import sys
import tracemalloc

import numpy as np
import pytest

zarr = pytest.importorskip("zarr")

from zarr_stores import attributes, multiscales, save_by_hand, save_store

from ctmc_addon.core import ReadError, finish
from ctmc_addon.readers import open_volume, read_volume

VERSIONS = ("0.4", "0.5")
SHAPE = (21, 30, 43)
AFFINE = [[-0.7, 0, 0, 30], [0, -0.5, 0, -20], [0, 0, 2, 10], [0, 0, 0, 1]]


def numbers(shape=SHAPE, dtype="i2", low=-1000, high=1000):
    return np.random.default_rng(5).integers(low, high, shape).astype(dtype)


def stored(source, options=None):
    """What reads the values."""
    return finish(source.slabs_steps(**(options or {})))


@pytest.fixture
def decoded(monkeypatch):
    """How often each chunk is decoded: (z, y, x) of the chunk to its count."""
    counts = {}
    values_at = zarr.Array.__getitem__

    def counting(self, index):
        ranges = [range(*part.indices(side)) for part, side in zip(index, self.shape, strict=True)]
        chunks = [{number // side for number in own} for own, side in zip(ranges, self.chunks, strict=True)]
        for chunk in itertools.product(*chunks):
            counts[chunk] = counts.get(chunk, 0) + 1
        return values_at(self, index)

    monkeypatch.setattr(zarr.Array, "__getitem__", counting)
    return counts


@pytest.mark.parametrize("version", VERSIONS)
def test_values_and_affine_are_those_of_the_store(tmp_path, version):
    values = numbers()
    path = save_store(tmp_path / "scan.ome.zarr", values, version, chunks=(8, 16, 16))
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, zarr.open_array(str(path / "0"), mode="r")[...])
    np.testing.assert_array_equal(volume.values, values)
    np.testing.assert_allclose(volume.affine, AFFINE)
    assert (volume.name, volume.kind, volume.values.dtype, volume.orientation) == ("scan", "HU", np.int16, "LPS")
    assert volume.notes == (
        "OME-Zarr has no orientation: taken as axial, columns towards the patient's left, rows towards the back, "
        "slices towards the head; flip x, y or z changes it",
    )
    assert open_volume(path).format == "OME-Zarr"


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_level_is_the_array_of_that_level_at_its_place(tmp_path, version, level):
    values = numbers()
    path = save_store(tmp_path / "scan.ome.zarr", values, version, levels=3, chunks=(8, 16, 16))
    volume = read_volume(path, level=level)
    np.testing.assert_array_equal(volume.values, zarr.open_array(str(path / str(level)), mode="r")[...])
    np.testing.assert_allclose(np.diag(volume.affine)[:3], np.diag(AFFINE)[:3] * np.float64(2**level))
    np.testing.assert_allclose(volume.affine[:3, 3], np.array(AFFINE)[:3, 3])
    sizes = "0 (43 x 30 x 21), 1 (22 x 15 x 11), 2 (11 x 8 x 6)"
    assert volume.notes[0] == f"level {level} was read of the levels of resolution {sizes}"
    assert open_volume(path).levels == ((43, 30, 21), (22, 15, 11), (11, 8, 6))


def test_levels_that_are_not_there_are_refused(tmp_path):
    path = save_store(tmp_path / "scan.ome.zarr", numbers(), levels=2)
    with pytest.raises(ReadError, match=r"^scan.ome.zarr has no level 2; choose from 0 to 1$"):
        read_volume(path, level=2)
    np.save(tmp_path / "ct.npy", numbers())
    with pytest.raises(ReadError, match=r"^ct.npy has no level 1; it has one resolution, so leave the level out$"):
        read_volume(tmp_path / "ct.npy", level=1)
    assert read_volume(tmp_path / "ct.npy", level=0).size == (43, 30, 21)


@pytest.mark.parametrize(
    ("chunks", "options"),
    [((8, 16, 16), {}), ((1, 30, 43), {}), ((21, 7, 9), {}), ((5, 30, 4), {}), ((4, 8, 8), {"shards": (8, 16, 24)})],
)
@pytest.mark.parametrize("stride", [(1, 1, 1), (3, 2, 4), (5, 1, 9)])
def test_a_region_and_a_stride_are_those_of_the_whole(tmp_path, chunks, options, stride):
    values = numbers()
    path = save_store(tmp_path / "scan.ome.zarr", values, chunks=chunks, **options)
    part = read_volume(path, region=(2, 3, 5, 40, 28, 19), stride=stride)
    x, y, z = stride
    np.testing.assert_array_equal(part.values, values[5:20:z, 3:29:y, 2:41:x])
    np.testing.assert_allclose(part.affine[:3, 3], np.array(AFFINE)[:3, 3] + np.array(AFFINE)[:3, :3] @ (2, 3, 5))


@pytest.mark.parametrize("high", [1, 3, 8, 20])
def test_slabs_are_the_values_and_each_chunk_is_decoded_once(tmp_path, decoded, high):
    values = numbers(dtype="u2", low=0, high=5000)
    slabs = stored(open_volume(save_store(tmp_path / "scan.ome.zarr", values, chunks=(8, 16, 16))))
    decoded.clear()
    assert slabs.reader.chunk_slices == 8
    for low in range(0, 21, high):
        np.testing.assert_array_equal(slabs.slab(low, min(21, low + high)), values[low : low + high])
    assert set(decoded) == {(z, y, x) for z in range(3) for y in range(2) for x in range(3)}
    # A slab that stops in the midst of a layer keeps the rest; the layer that it began with is read to its end.
    assert set(decoded.values()) == {1}


def test_any_slabs_in_any_order_are_the_values(tmp_path):
    values = numbers(dtype="u2", low=0, high=5000)
    reader = stored(open_volume(save_store(tmp_path / "scan.ome.zarr", values, chunks=(6, 7, 9)))).reader
    generator = np.random.default_rng(2)
    for _ in range(200):
        ranges = []
        for size in SHAPE:
            low, high = sorted(generator.integers(0, size, 2).tolist())
            ranges.append(range(low, high + 1, int(generator.integers(1, 5))))
        expected = values[tuple(slice(each.start, each.stop, each.step) for each in ranges)]
        np.testing.assert_array_equal(reader.read(*ranges), expected)
        for number, plane in zip(ranges[0], expected, strict=True):  # one by one, as a slab is passed through
            np.testing.assert_array_equal(reader.read(range(number, number + 1), *ranges[1:])[0], plane)


def test_a_region_decodes_its_own_chunks_alone(tmp_path, decoded):
    path = save_by_hand(tmp_path / "scan.ome.zarr", numbers(dtype="u2", low=500, high=5000), (8, 16, 16))
    part = read_volume(path, region=(17, 0, 8, 31, 15, 15))
    assert part.size == (15, 16, 8)
    decoded.pop((0, 0, 0), None)
    assert {chunk for chunk in decoded if chunk[0] == 1} == {(1, 0, 1)}
    for file in (path / "0" / "2").rglob("*"):  # what is broken elsewhere is not seen
        if file.is_file():
            file.write_bytes(b"short")
    assert (read_volume(path, region=(17, 0, 8, 31, 15, 15)).values == part.values).all()
    with pytest.raises(ReadError, match=r"^level 0 of scan.ome.zarr is truncated or damaged \(.*\); copy it again$"):
        read_volume(path)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_region_takes_the_memory_of_one_of_npy_and_some_chunks(tmp_path, version):
    values = numbers((96, 256, 256), "u2", 500, 60000)
    path = save_store(tmp_path / "scan.ome.zarr", values, version, chunks=(16, 64, 64))
    np.save(tmp_path / "scan.npy", values)
    region = (10, 10, 9, 200, 200, 80)

    def peak(file):
        with zarr.config.set({"async.concurrency": 1, "threading.max_workers": 1}):  # no peak that threads decide
            read_volume(file, region=region)  # imports what it needs
            tracemalloc.start()
            read_volume(file, region=region)
            most = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
        return most

    layer = 16 * 256 * 256 * 2
    assert peak(path) < peak(tmp_path / "scan.npy") + 3 * layer < values.nbytes


def test_axes_may_stand_in_any_order(tmp_path):
    values = numbers()
    path = save_store(tmp_path / "scan.ome.zarr", values.transpose(2, 0, 1), axes="xzy", chunks=(16, 8, 16))
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, values)
    np.testing.assert_allclose(volume.affine, AFFINE)
    part = read_volume(path, region=(2, 3, 5, 40, 28, 19), stride=(3, 2, 4))
    np.testing.assert_array_equal(part.values, values[5:20:4, 3:29:2, 2:41:3])


@pytest.mark.parametrize("version", VERSIONS)
def test_times_and_channels_are_chosen(tmp_path, version):
    values = numbers((3, 2, *SHAPE))
    about = {"omero": {"channels": [{"label": "DAPI"}, {"label": "bone\n"}]}}
    path = save_store(tmp_path / "scan.ome.zarr", values, version, "tczyx", chunks=(1, 1, 8, 16, 16), about=about)
    source = open_volume(path)
    assert [(line.times, line.description) for line in source.series] == [(3, "DAPI"), (3, "bone")]
    np.testing.assert_array_equal(read_volume(path, time=3, series=2).values, values[2, 1])
    first = read_volume(path)
    np.testing.assert_array_equal(first.values, values[0, 0])
    assert "2 channels found: channel 1 was read; give its number as the series, 1 to 2" in first.notes
    assert "3 time points found, showing the first" in first.notes
    with pytest.raises(ReadError, match=r"^there is no series '3', because scan.ome.zarr has 2 channels; choose"):
        read_volume(path, series="3")
    with pytest.raises(ReadError, match=r"there is no time 4, because scan.ome.zarr holds 3 times; choose from 1 to 3"):
        read_volume(path, time=4)


def test_one_channel_is_read_without_a_word(tmp_path):
    values = numbers((1, *SHAPE))
    path = save_store(tmp_path / "scan.ome.zarr", values, axes="czyx")
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, values[0])
    assert not any("channel" in note for note in volume.notes)
    with pytest.raises(ReadError, match=r"has no series to choose from"):
        read_volume(path, series="1")


@pytest.mark.parametrize(
    ("unit", "mm", "note"),
    [
        ("micrometer", 1e-3, "the file's positions are in micrometer and were converted to mm"),
        ("meter", 1e3, "the file's positions are in meter and were converted to mm"),
        ("", 1.0, "the file's axes have no unit: taken as mm; give the spacing in mm for another"),
    ],
)
def test_units_become_millimeters(tmp_path, unit, mm, note):
    volume = read_volume(save_store(tmp_path / "scan.ome.zarr", numbers(), unit=unit))
    np.testing.assert_allclose(volume.affine[:3], np.array(AFFINE)[:3] * mm)
    assert note in volume.notes


def test_transformations_of_all_levels_follow_those_of_one(tmp_path):
    path = save_store(tmp_path / "scan.ome.zarr", numbers())
    more = [
        {"type": "scale", "scale": [3, 3, 10]},
        {"type": "identity"},
        {"type": "translation", "translation": [1, 2, 3]},
    ]
    about = multiscales("0.5", coordinateTransformations=more)
    zarr.open_group(str(path)).attrs.update(attributes("0.5", multiscales=[about]))
    expected = [[-7, 0, 0, 300 - 3], [0, -1.5, 0, -60 - 2], [0, 0, 6, 30 + 1], [0, 0, 0, 1]]
    np.testing.assert_allclose(read_volume(path).affine, expected)


def test_a_given_spacing_wins(tmp_path):
    volume = read_volume(save_store(tmp_path / "scan.ome.zarr", numbers()), spacing=(1, 2, 3))
    assert volume.spacing == (1, 2, 3)
    assert any("instead of the file's own 0.7 x 0.5 x 2 mm" in note for note in volume.notes)


@pytest.mark.parametrize("dtype", ["?", "u1", "i1", "<u2", ">u2", ">i2", "<i4", ">i4", "u8", "<f4", ">f4", ">f8"])
@pytest.mark.parametrize("separator", ["/", "."])
def test_a_store_made_by_hand_is_read_in_every_type_and_byte_order(tmp_path, dtype, separator):
    values = numbers(low=0, high=2).astype(dtype) if dtype == "?" else numbers(low=0, high=100).astype(dtype)
    path = save_by_hand(tmp_path / "scan.ome.zarr", values, (8, 16, 16), separator=separator)
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, values)
    np.testing.assert_array_equal(volume.values, zarr.open_array(str(path / "0"), mode="r")[...])
    assert volume.values.dtype == np.dtype(dtype).newbyteorder("=")


def test_chunks_that_are_not_there_have_the_fill_value(tmp_path):
    values = numbers(dtype="u2", low=1, high=9000)
    skipped = {(0, 0, 0), (2, 1, 2)}
    path = save_by_hand(tmp_path / "scan.ome.zarr", values, (8, 16, 16), skip=skipped, fill_value=7)
    expected = values.copy()
    expected[:8, :16, :16] = expected[16:, 16:, 32:] = 7
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.values, expected)
    assert volume.notes[-1] == "2 of 18 chunks are not in the store: they have its fill value 7"


@pytest.mark.parametrize("version", VERSIONS)
def test_labels_have_their_names_and_colors(tmp_path, version):
    path = save_store(tmp_path / "scan.ome.zarr", numbers(), version)
    colors = [{"label-value": 1, "rgba": [200, 10, 20, 255]}, {"label-value": 2, "rgba": [0, 0, 300]}]
    properties = [{"label-value": 1, "name": "left kidney"}, {"label-value": 2, "class": "liver"}, {"name": "?"}]
    about = {"image-label": {"colors": colors, "properties": properties, "source": {"image": "../../"}}}
    labels = zarr.open_group(str(path / "labels"), mode="w", zarr_format=2 if version == "0.4" else 3)
    labels.attrs.update(attributes(version, labels=["organs", "../outside"]))
    values = numbers(dtype="i4", low=0, high=3)
    save_store(path / "labels" / "organs", values, version, about=about)
    volume = read_volume(path / "labels" / "organs")
    np.testing.assert_array_equal(volume.values, values)
    assert (volume.name, volume.kind) == ("organs", "label")
    assert volume.label_names == {1: "left kidney", 2: "liver"}
    assert volume.label_colors == {1: (200, 10, 20)}
    assert open_volume(path).label_groups == ("labels/organs",)
    assert read_volume(path).kind == "HU"
    with pytest.raises(ReadError, match=r"^labels is a Zarr store without an image .*; choose labels/organs$"):
        open_volume(path / "labels")


def test_the_folder_of_bioformats2raw_opens_its_one_image(tmp_path):
    group = zarr.open_group(str(tmp_path / "scan.zarr"), mode="w", zarr_format=2)
    group.attrs.update({"bioformats2raw.layout": 3})
    values = numbers()
    save_store(tmp_path / "scan.zarr" / "0", values, "0.4")
    (tmp_path / "scan.zarr" / "OME").mkdir()
    volume = read_volume(tmp_path / "scan.zarr")
    np.testing.assert_array_equal(volume.values, values)
    assert volume.name == "scan"
    save_store(tmp_path / "scan.zarr" / "1", values, "0.4")
    with pytest.raises(ReadError, match=r"choose scan.zarr/0 or scan.zarr/1$"):
        open_volume(tmp_path / "scan.zarr")


def test_a_file_of_metadata_stands_for_its_folder(tmp_path):
    for version, name in (("0.4", ".zattrs"), ("0.5", "zarr.json")):
        path = save_store(tmp_path / f"{version}.ome.zarr", numbers(), version)
        assert open_volume(path / name).name == version
        assert (path / name) in open_volume(path).files


def test_stores_in_a_folder_are_named_and_not_searched_for_slices(tmp_path):
    for name in ("b.ome.zarr", "a.ome.zarr"):
        save_store(tmp_path / name, numbers(), chunks=(8, 16, 16))
    with pytest.raises(ReadError, match=r"choose 'a.ome.zarr' or 'b.ome.zarr' in it$"):
        open_volume(tmp_path)


def test_without_zarr_a_sentence_says_how_it_comes(tmp_path, monkeypatch):
    path = save_store(tmp_path / "scan.ome.zarr", numbers())
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ReadError) as refused:
        open_volume(path)
    assert str(refused.value) == (
        "reading OME-Zarr needs the Python package zarr, which is missing; install it by `pip install 'zarr>=3'`"
    )


def test_a_store_keeps_its_name_in_a_batch(tmp_path):
    from ctmc_addon.cli.batch.cases import collect
    from ctmc_addon.readers import ReadingOptions

    (tmp_path / "in").mkdir()
    for name in ("b.ome.zarr", "a.ome.zarr"):
        save_store(tmp_path / "in" / name, numbers())
    cases = collect([str(tmp_path / "in"), str(save_store(tmp_path / "c.zarr", numbers()))], {}, ReadingOptions())
    assert [(case.name, case.path.name) for case in cases] == [
        ("a", "a.ome.zarr"),
        ("b", "b.ome.zarr"),
        ("c", "c.zarr"),
    ]


def test_metadata_are_json(tmp_path):
    path = save_store(tmp_path / "scan.ome.zarr", numbers())
    assert json.loads((path / "zarr.json").read_text())["attributes"]["ome"]["version"] == "0.5"


def test_a_scale_below_0_turns_its_axis_and_is_said(tmp_path):
    about = multiscales("0.4", unit="millimeter")
    about["datasets"][0]["coordinateTransformations"] = [{"type": "scale", "scale": [-2.0, 0.5, 0.7]}]
    values = numbers((3, 4, 5))
    path = save_by_hand(tmp_path / "ct.ome.zarr", values, values.shape, attrs={"multiscales": [about]})
    volume = read_volume(path)
    np.testing.assert_array_equal(volume.affine[:3, :3], np.diag([-0.7, -0.5, -2]))
    said = "the file has scales 0.7 x 0.5 x -2: an axis below 0 runs backwards; flip x, y or z changes it"
    assert said in volume.notes
