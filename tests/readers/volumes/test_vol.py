# SPDX-License-Identifier: GPL-3.0-or-later
"""A text beside flat values: `.vgi` of Volume Graphics and `.vol.info` of PyHST."""

import numpy as np
import pytest

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume

VALUES = np.random.default_rng(0).integers(0, 3000, (4, 5, 6)).astype(np.uint16)
VGI = """{volume1}
[representation]
size = 6 5 4
datatype = unsigned integer
bitsperelement = 16
[file1]
RegionOfInterestStart = 0 0 0
RegionOfInterestEnd = 5 4 3
FileFormat = raw
Size = 6 5 4
Name = ct.vol
Datatype = unsigned integer
datarange = 0 -1
BitsPerElement = 16
{volumeprimitive1}
[geometry]
resolution = 0.05 0.05 0.1
unit = mm
[volume]
volume = volume1
"""
INFO = """! PyHST_SLAVE VOLUME INFO FILE
NUM_X =  6
NUM_Y =  5
NUM_Z =  4
voxelSize =  2.5
BYTEORDER = LOWBYTEFIRST
ValMin =  0.0
ValMax =  1.0
"""


def pair(folder, text, name, values=VALUES):
    (folder / name).write_text(text)
    (folder / "ct.vol").write_bytes(values.tobytes())


@pytest.mark.parametrize("opened", ["ct.vgi", "ct.vol"])
def test_either_file_of_volume_graphics_opens_the_pair(tmp_path, opened):
    pair(tmp_path, VGI, "ct.vgi")
    volume = read_volume(tmp_path / opened)
    np.testing.assert_array_equal(volume.values, VALUES)
    assert (volume.values.dtype, volume.name) == (np.uint16, "ct")
    np.testing.assert_allclose(volume.spacing, (0.05, 0.05, 0.1))


@pytest.mark.parametrize("opened", ["ct.vol.info", "ct.vol"])
def test_either_file_of_pyhst_opens_the_pair(tmp_path, opened):
    pair(tmp_path, INFO, "ct.vol.info", VALUES.astype(np.float32))
    volume = read_volume(tmp_path / opened)
    np.testing.assert_array_equal(volume.values, VALUES)
    assert (volume.values.dtype, volume.name) == (np.float32, "ct")
    np.testing.assert_allclose(volume.spacing, (0.0025, 0.0025, 0.0025))
    assert sum("as PyHST writes" in note for note in volume.notes) == 2


def test_type_and_order_of_pyhst_are_read(tmp_path):
    text = INFO.replace("LOWBYTEFIRST", "HIGHBYTEFIRST") + "DATA_TYPE = uint16\n"
    pair(tmp_path, text, "ct.vol.info", VALUES.astype(">u2"))
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.vol").values, VALUES)


@pytest.mark.parametrize(
    ("kind", "bits", "dtype"), [("unsigned integer", 8, "u1"), ("signed integer", 16, "i2"), ("float", 32, "f4")]
)
def test_types_of_volume_graphics(tmp_path, kind, bits, dtype):
    values = (VALUES % 100).astype(dtype)
    text = VGI.replace("Datatype = unsigned integer", f"Datatype = {kind}")
    pair(tmp_path, text.replace("BitsPerElement = 16", f"BitsPerElement = {bits}"), "ct.vgi", values)
    volume = read_volume(tmp_path / "ct.vgi")
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == np.dtype(dtype)


def test_other_units_and_a_header_before_the_values(tmp_path):
    text = VGI.replace("unit = mm", "unit = \u00b5m").replace("Name = ct.vol", "Name = ct.vol\nSkipHeader = 8")
    (tmp_path / "ct.vgi").write_text(text, encoding="utf-8")
    (tmp_path / "ct.vol").write_bytes(bytes(8) + VALUES.tobytes())
    volume = read_volume(tmp_path / "ct.vgi")
    np.testing.assert_array_equal(volume.values, VALUES)
    np.testing.assert_allclose(volume.spacing, (5e-5, 5e-5, 1e-4))


def test_a_folder_offers_the_text_alone(tmp_path):
    pair(tmp_path, VGI, "ct.vgi")
    with pytest.raises(CtmcError, match=r"choose 'ct\.vgi' in it$"):
        open_volume(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("[file1]", "[other]", "has 0 files of values"),
        ("[geometry]", "[file2]", "has 2 files of values"),
        ("FileFormat = raw", "FileFormat = tiff", "values as 'tiff'; export them as raw"),
        ("BitsPerElement = 16", "BitsPerElement = 12", "'unsigned integer' of 12 bits"),
        ("\nSize = 6 5 4", "\nSize = 6 5", "sizes \\(6, 5\\)"),
        ("\nSize = 6 5 4", "\nSize = 6 5 1", "only one slice"),
        ("Name = ct.vol", "Name = ../other.vol", "own folder"),
        ("Name = ct.vol", "Name = other.vol", "other.vol, which is missing"),
        ("Name = ct.vol", "Name = ct.vol\nSkipHeader = -1", "SkipHeader of -1"),
        ("Name = ct.vol", "Name = ct.vol\nMirror = 0 0 1", "mirrored"),
        ("bitsperelement = 16", "bitsperelement = 16\nmirror = 1 0 0 0", "mirrored"),
        ("Name = ct.vol", "Name = ct.vgi", "not a file of values"),
        ("Name = ct.vol", "Name =", "not a file of values"),
        ("resolution = 0.05 0.05 0.1", "resolution = 0.05", "'0.05' as resolution, not 3 numbers"),
    ],
)
def test_a_wrong_vgi_is_refused_by_name(tmp_path, old, new, sentence):
    pair(tmp_path, VGI.replace(old, new), "ct.vgi")
    with pytest.raises(CtmcError, match=rf"ct\.vgi .*{sentence}"):
        read_volume(tmp_path / "ct.vgi")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("NUM_X =  6", "NUM_X =  six", "'six' as NUM_X"),
        ("NUM_Y =  5\n", "", "'' as NUM_Y"),
        ("LOWBYTEFIRST", "MIDDLE", "in the order 'MIDDLE'"),
        ("BYTEORDER", "DATA_TYPE = PACKED_BINARY\nBYTEORDER", "of type 'packed_binary'"),
        ("voxelSize =  2.5", "voxelSize =  x", "'x' as voxelSize"),
    ],
)
def test_a_wrong_info_is_refused_by_name(tmp_path, old, new, sentence):
    pair(tmp_path, INFO.replace(old, new), "ct.vol.info", VALUES.astype(np.float32))
    with pytest.raises(CtmcError, match=rf"ct\.vol\.info has .*{sentence}"):
        read_volume(tmp_path / "ct.vol")


@pytest.mark.parametrize("name", ["C:/CT_Data/scans/ct.vol", "D:\\scans\\ct.vol", '"ct.vol"', "sub/ct.vol"])
def test_values_are_found_beside_their_text_whatever_folder_it_names(tmp_path, name):
    pair(tmp_path, VGI.replace("Name = ct.vol", f"Name = {name}"), "ct.vgi")
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.vgi").values, VALUES)


def test_the_file_that_a_text_names_comes_before_one_of_its_name_beside_it(tmp_path):
    pair(tmp_path, VGI.replace("Name = ct.vol", "Name = sub/ct.vol"), "ct.vgi", VALUES + 1)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "ct.vol").write_bytes(VALUES.tobytes())
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.vgi").values, VALUES)


def test_a_text_without_a_unit_is_taken_as_mm_with_a_note(tmp_path):
    pair(tmp_path, VGI.replace("unit = mm\n", "").replace("mirror", "mirror = 0 0 0 0"), "ct.vgi")
    volume = read_volume(tmp_path / "ct.vgi")
    np.testing.assert_allclose(volume.spacing, (0.05, 0.05, 0.1))
    assert any("no unit" in note for note in volume.notes)


def test_the_case_of_names_does_not_matter(tmp_path):
    pair(tmp_path, VGI, "CT.VGI")
    np.testing.assert_array_equal(read_volume(tmp_path / "ct.vol").values, VALUES)


def test_values_without_a_text_ask_for_it(tmp_path):
    (tmp_path / "ct.vol").write_bytes(bytes(100))
    with pytest.raises(CtmcError, match=r"values only; put ct\.vgi or ct\.vol\.info, which describes them, beside it"):
        read_volume(tmp_path / "ct.vol")


def test_a_text_without_its_values_is_refused(tmp_path):
    (tmp_path / "ct.vol.info").write_text(INFO)
    with pytest.raises(CtmcError, match=r"ct\.vol, which is missing"):
        read_volume(tmp_path / "ct.vol.info")
