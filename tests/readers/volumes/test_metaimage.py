# SPDX-License-Identifier: GPL-3.0-or-later
"""MetaImage files made here; the affine is what SimpleITK 2.5.7 says of the same header, its x and y turned to RAS."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from ctmc_addon.core import ReadError
from ctmc_addon.readers import open_volume, read_volume

SHAPE = (4, 5, 6)  # (slices, rows, columns)
OBLIQUE = (
    "TransformMatrix = 0.95533648912560598 0.29552020666133955 0 -0.28232123669751763 0.91266780745483911 "
    "0.29552020666133955 0.087332192545160836 -0.28232123669751763 0.95533648912560598\n"
    "Offset = -10 20 30\nElementSpacing = 0.5 0.7 2\n"
)
# GetDirection() times GetSpacing(), and GetOrigin()
SIMPLEITK = np.array(
    [
        [-0.47766824456280299, 0.19762486568826233, -0.17466438509032167, 10.0],
        [-0.14776010333066978, -0.63886746521838733, 0.56464247339503526, -20.0],
        [0.0, 0.20686414466293767, 1.910672978251212, 30.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
METS = {"i1": "CHAR", "u1": "UCHAR", "i2": "SHORT", "u2": "USHORT", "i4": "INT", "u4": "UINT", "f4": "FLOAT"}
METS |= {"f8": "DOUBLE", "i8": "LONG_LONG", "u8": "ULONG_LONG"}


def numbers(code="i2", shape=SHAPE):
    return np.random.default_rng(0).integers(0, 100, shape).astype(code)


def header(values, data="LOCAL", extra=OBLIQUE, **fields):
    """The text of a header for `values` (..., rows, columns)."""
    code = values.dtype.str[1:]
    lines = {"ObjectType": "Image", "NDims": values.ndim, "DimSize": " ".join(map(str, values.shape[::-1]))}
    lines["BinaryDataByteOrderMSB"] = values.dtype.byteorder == ">"
    lines |= {"ElementType": f"MET_{METS[code]}", **fields}
    return "".join(f"{key} = {value}\n" for key, value in lines.items()) + extra + f"ElementDataFile = {data}\n"


def local(path, values, packed=False, **fields):
    """One `.mha` of `values`."""
    content = zlib.compress(values.tobytes()) if packed else values.tobytes()
    path.write_bytes(header(values, CompressedData=packed, **fields).encode() + content)
    return path


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("code", METS)
@pytest.mark.parametrize("packed", [False, True])
def test_values_of_every_type_are_those_written(tmp_path, code, order, packed):
    values = numbers(order + code)
    volume = read_volume(local(tmp_path / "ct.mha", values, packed))
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == np.dtype(code)
    assert volume.notes == ()


def test_the_place_is_simpleitks(tmp_path):
    volume = read_volume(local(tmp_path / "ct.mha", numbers()))
    np.testing.assert_allclose(volume.affine, SIMPLEITK, atol=1e-12)
    assert volume.name == "ct"


def test_a_file_without_spacing_and_direction_has_no_geometry(tmp_path):
    (tmp_path / "ct.mha").write_bytes(header(numbers(), extra="").encode() + numbers().tobytes())
    assert any("1 mm is assumed" in note for note in read_volume(tmp_path / "ct.mha").notes)


def test_element_size_stands_for_a_missing_spacing_and_micrometers_are_converted(tmp_path):
    (tmp_path / "ct.mha").write_bytes(
        header(numbers(), extra="ElementSize = 10 20 30\nDistanceUnits = um\n").encode() + numbers().tobytes()
    )
    volume = read_volume(tmp_path / "ct.mha")
    np.testing.assert_allclose(volume.spacing, (0.01, 0.02, 0.03))
    assert any("um" in note for note in volume.notes)


@pytest.mark.parametrize("packed", [False, True])
def test_each_time_of_four_dimensions_is_read(tmp_path, packed):
    values = numbers("i2", (3, *SHAPE))
    matrix = "TransformMatrix = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\nElementSpacing = 1 2 3 0.5\nOffset = 1 2 3 0\n"
    content = zlib.compress(values.tobytes()) if packed else values.tobytes()
    path = tmp_path / "ct.mha"
    path.write_bytes(header(values, extra=matrix, CompressedData=packed).encode() + content)
    assert open_volume(path).series[0].times == 3
    for time in (1, 2, 3):
        volume = read_volume(path, time=time)
        np.testing.assert_array_equal(volume.values, values[time - 1])
        np.testing.assert_array_equal(volume.affine, [[-1, 0, 0, -1], [0, -2, 0, -2], [0, 0, 3, 3], [0, 0, 0, 1]])


def detached(folder, data, values, **fields):
    """An `.mhd` with this data file, beside one file of all values and one for each slice."""
    folder.mkdir(exist_ok=True)
    (folder / "all.raw").write_bytes(values.tobytes())
    (folder / "all.zraw").write_bytes(zlib.compress(values.tobytes()))
    (folder / "behind.raw").write_bytes(bytes(77) + values.tobytes())
    for number, plane in enumerate(values.reshape(-1, *SHAPE[1:])):
        (folder / f"s{number}.raw").write_bytes(plane.tobytes())
    (folder / "ct.mhd").write_text(header(values, data, **fields))
    return folder / "ct.mhd"


@pytest.mark.parametrize(
    ("data", "fields"),
    [
        ("all.raw", {}),
        ("all.zraw", {"CompressedData": True, "CompressedDataSize": 5}),
        ("behind.raw", {"HeaderSize": 77}),
        ("behind.raw", {"HeaderSize": -1}),
        ("s%d.raw 0 3 1", {}),
        ("LIST\ns0.raw\ns1.raw\ns2.raw\ns3.raw", {}),
        ("LIST 2\ns0.raw\r\ns1.raw\ns2.raw\ns3.raw\n", {}),
    ],
)
def test_values_in_other_files_are_read(tmp_path, data, fields):
    np.testing.assert_array_equal(read_volume(detached(tmp_path / "in", data, numbers(), **fields)).values, numbers())


def test_a_list_of_slices_holds_several_times(tmp_path):
    values = numbers("u2", (2, *SHAPE))
    matrix = "ElementSpacing = 1 1 1 1\n"
    path = detached(tmp_path / "in", "LIST\n" + "".join(f"s{n}.raw\n" for n in range(8)), values, extra=matrix)
    for time in (1, 2):
        np.testing.assert_array_equal(read_volume(path, time=time).values, values[time - 1])


def test_numbers_in_words_are_read(tmp_path):
    words = " ".join(map(str, numbers().ravel()))
    (tmp_path / "ct.mha").write_text(header(numbers(), BinaryData=False) + words)
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.mha").values, numbers())


@pytest.mark.parametrize("data", ["../all.raw", "/etc/passwd", "\\\\host\\x.raw", "C:\\x.raw", "LIST\n../a\nb\nc\nd"])
def test_files_outside_the_headers_folder_are_not_opened(tmp_path, data):
    with pytest.raises(ReadError, match=r"ct\.mhd names the data file .*folder"):
        read_volume(detached(tmp_path / "in", data, numbers()))


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"NDims": 2}, "2 dimensions"),
        ({"NDims": "3.5"}, "NDims"),
        ({"DimSize": "6 5 0"}, "sizes"),
        ({"DimSize": "6 5 -4"}, "sizes"),
        ({"DimSize": "6 5 1e9"}, "DimSize"),
        ({"DimSize": "999999999999 999999999999 999999999999"}, "memory"),
        ({"DimSize": "6 5 4 1 1", "NDims": 5}, "5 dimensions"),
        ({"DimSize": "6 20 1"}, "one slice"),
        ({"ElementType": "MET_FLOAT_ARRAY"}, "type 'MET_FLOAT_ARRAY'"),
        ({"ElementNumberOfChannels": 3}, "3 numbers a voxel"),
        ({"HeaderSize": -7}, "HeaderSize of -7"),
        ({"HeaderSize": 10**11}, "truncated"),
        ({"ElementSpacing": "1 nan 1"}, "ElementSpacing"),
        ({"ElementSpacing": "1 1"}, "ElementSpacing"),
        ({"Offset": "1 2 x"}, "Offset"),
        ({"CompressedData": True}, "truncated or damaged"),
    ],
)
def test_headers_that_make_no_volume_are_refused(tmp_path, fields, sentence):
    path = local(tmp_path / "ct.mha", numbers())
    text = header(numbers(), extra="", **fields).replace("= LOCAL", "= LOCAL")
    path.write_bytes(text.encode() + numbers().tobytes())
    with pytest.raises(Exception, match=sentence) as caught:
        read_volume(path)
    assert "\n" not in str(caught.value)


def test_a_file_cut_off_and_one_with_a_changed_bit_are_refused(tmp_path):
    path = local(tmp_path / "ct.mha", numbers())
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ReadError, match="truncated"):
        read_volume(path)
    packed = bytearray(local(tmp_path / "packed.mha", numbers(), True).read_bytes())
    for at in (-1, -40, -len(packed) // 4):
        changed = bytearray(packed)
        changed[at] ^= 1
        (tmp_path / "packed.mha").write_bytes(changed)
        with pytest.raises(ReadError, match="truncated or damaged"):
            read_volume(tmp_path / "packed.mha")


def test_zlib_that_unpacks_to_far_more_than_its_values_is_refused(tmp_path):
    content = header(numbers(), CompressedData=True).encode() + zlib.compress(numbers().tobytes() + bytes(1 << 27))
    (tmp_path / "bomb.mha").write_bytes(content)
    with pytest.raises(ReadError, match="far more"):
        read_volume(tmp_path / "bomb.mha")
