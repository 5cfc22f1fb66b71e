# SPDX-License-Identifier: GPL-3.0-or-later
"""OME-TIFF of several files: order and spacing are those of the OME-XML, whatever the files are called."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import tifffile

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import is_volume_file, open_volume, read_volume, volume_name

SCHEMA = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
SIZES = 'PhysicalSizeX="2.5" PhysicalSizeY="2" PhysicalSizeZ="0.004" PhysicalSizeZUnit="mm"'
SPACING = pytest.approx((0.0025, 0.002, 0.004))


def data(file, page=0, count=1, **first):
    """A TiffData element; `z`, `c` and `t` are where it begins."""
    starts = " ".join(f'First{axis.upper()}="{at}"' for axis, at in first.items())
    about = "" if count is None else f'IFD="{page}" PlaneCount="{count}"'
    return f'<TiffData {starts} {about}><UUID FileName="{file}">urn:uuid:{file}</UUID></TiffData>'


def image(elements, z=8, c=1, t=1, order="XYZCT", samples=1):
    return (
        f'<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="{order}" Type="uint16" SizeX="6" SizeY="5" '
        f'SizeZ="{z}" SizeC="{c}" SizeT="{t}" BigEndian="false" {SIZES}>'
        f'<Channel ID="Channel:0:0" SamplesPerPixel="{samples}"/>{"".join(elements)}</Pixels></Image>'
    )


def ome(*images):
    return f'<?xml version="1.0" encoding="UTF-8"?><OME xmlns="{SCHEMA}">{"".join(images)}</OME>'


def save(path, planes, text):
    planes = np.asarray(planes, np.uint16).reshape(-1, 1, 1) * np.ones((1, 5, 6), np.uint16)
    with tifffile.TiffWriter(path) as writer:
        for number, plane in enumerate(planes):
            about = text.encode() if number == 0 else None
            writer.write(plane, description=about, metadata=None, photometric="minisblack", contiguous=False)


@pytest.fixture
def mirrored(tmp_path):
    """Slice 0 lies in f7, slice 7 in f0."""
    text = ome(image([data(f"f{7 - z}.ome.tif", z=z) for z in range(8)]))
    (tmp_path / "ct").mkdir()
    for z in range(8):
        save(tmp_path / "ct" / f"f{7 - z}.ome.tif", [z], text)
    return tmp_path / "ct"


def seen(volume):
    return volume.values[:, 0, 0].tolist()


def notes_with(volume, words):
    return [note for note in volume.notes if words in note]


@pytest.mark.parametrize("name", ["", "f0.ome.tif", "f5.ome.tif"])
def test_order_and_spacing_are_those_of_the_xml(mirrored, name):
    volume = read_volume(mirrored / name)
    np.testing.assert_array_equal(volume.values, tifffile.imread(mirrored / "f0.ome.tif"))
    assert (seen(volume), volume.spacing, volume.name) == (list(range(8)), SPACING, "ct")
    assert notes_with(volume, "µm and were converted to mm")
    assert len(notes_with(volume, f"{name} belongs to an OME-TIFF of several files, which was read")) == bool(name)
    assert not notes_with(volume, "no spacing")
    part = read_volume(mirrored / name, region=(1, 0, 2, 5, 4, 7), stride=(2, 2, 3))
    assert seen(part) == [2, 5]


def test_a_tiff_that_does_not_belong_to_it_is_left_out_and_named(mirrored):
    for name in ("a.tif", "f9.ome.tif"):
        tifffile.imwrite(mirrored / name, np.zeros((5, 6), np.uint16))
    volume = read_volume(mirrored)
    assert seen(volume) == list(range(8))
    assert notes_with(volume, "2 pictures left out, not among the files of the OME-TIFF: a.tif, f9.ome.tif")


def test_a_larger_stack_beside_it_is_read_by_its_names_and_one_of_like_size_is_refused(mirrored):
    for number in range(20):
        tifffile.imwrite(mirrored / f"s{number}.tif", np.full((5, 6), number, np.uint16))
    volume = read_volume(mirrored)
    assert (seen(volume), volume.spacing) == (list(range(20)), (1, 1, 1))
    assert notes_with(volume, "8 pictures left out, not named like the 20 slices s0.tif to s19.tif")
    assert seen(read_volume(mirrored / "f3.ome.tif")) == list(range(8))
    for number in range(7, 20):
        (mirrored / f"s{number}.tif").unlink()
    words = r"has 2 stacks of pictures: f0.ome.tif to f7.ome.tif \(8\), s0.tif to s6.tif \(7\); choose a slice"
    with pytest.raises(CtmcError, match=words):
        read_volume(mirrored)


def test_missing_files_are_named(mirrored):
    for number in (1, 2, 4, 6):
        (mirrored / f"f{number}.ome.tif").unlink()
    for path in (mirrored, mirrored / "f3.ome.tif"):
        with pytest.raises(CtmcError) as error:
            read_volume(path)
        assert str(error.value).endswith(
            ".ome.tif belongs to an OME-TIFF of 8 files, of which f6.ome.tif, f4.ome.tif, f2.ome.tif and 1 more are "
            "not in its folder; copy all of them there under their own names"
        )


@pytest.mark.parametrize("name", ["../f1.ome.tif", "/tmp/f1.ome.tif", "..", ""])
def test_no_file_outside_the_folder_is_opened(tmp_path, name):
    (tmp_path / "ct").mkdir()
    text = ome(image([data("f0.ome.tif", z=0), data(name, z=1)], z=2))
    save(tmp_path / "ct" / "f0.ome.tif", [0], text)
    save(tmp_path / "f1.ome.tif", [1], text)
    with pytest.raises(CtmcError, match=r"OME-TIFF of 2 files, of which .* is not in its folder"):
        read_volume(tmp_path / "ct" / "f0.ome.tif")


@pytest.mark.parametrize("order", ["XYZCT", "XYZTC", "XYCTZ", "XYCZT", "XYTCZ", "XYTZC"])
def test_each_time_of_the_first_channel_is_read_whatever_the_order(tmp_path, order):
    places = list(itertools.product(range(4), range(2), range(3)))
    text = ome(image([data(f"{z}{c}{t}.ome.tif", z=z, c=c, t=t) for z, c, t in places], 4, 2, 3, order))
    for z, c, t in places:
        save(tmp_path / f"{z}{c}{t}.ome.tif", [100 * z + 10 * c + t], text)
    assert open_volume(tmp_path).series[0].times == 3
    with tifffile.TiffFile(tmp_path / "000.ome.tif") as tiff:
        axes, values = tiff.series[0].axes, tiff.series[0].asarray()
    expected = np.moveaxis(values, [axes.index(axis) for axis in "TZC"], range(3))[:, :, 0]
    for time in (1, 2, 3):
        volume = read_volume(tmp_path, time=time)
        assert seen(volume) == [100 * z + time - 1 for z in range(4)]
        np.testing.assert_array_equal(volume.values, expected[time - 1])
        assert notes_with(volume, "2 channels: the first was read")


def test_a_file_for_each_time_opens_the_whole_from_each(tmp_path):
    text = ome(image([data(f"t{1 - t}.ome.tif", count=4, t=t) for t in range(2)], z=4, t=2))
    for t in range(2):
        save(tmp_path / f"t{1 - t}.ome.tif", [10 * t + z for z in range(4)], text)
    for path in (tmp_path, tmp_path / "t0.ome.tif", tmp_path / "t1.ome.tif"):
        assert [seen(read_volume(path, time=time)) for time in (1, 2)] == [[0, 1, 2, 3], [10, 11, 12, 13]]
    assert not is_volume_file(tmp_path / "t0.ome.tif")
    assert volume_name(tmp_path / "t0.ome.tif") == tmp_path.name == read_volume(tmp_path / "t0.ome.tif").name


@pytest.mark.parametrize("count", [4, None])
def test_pages_of_a_file_follow_one_another(tmp_path, count):
    text = ome(image([data("b.ome.tif", count=count, z=0), data("a.ome.tif", count=count, z=4)]))
    save(tmp_path / "b.ome.tif", range(4), text)
    save(tmp_path / "a.ome.tif", range(4, 8), text)
    assert seen(read_volume(tmp_path)) == list(range(8))


def test_a_file_of_several_pages_without_its_others_is_read_by_itself(tmp_path):
    text = ome(image([data(f"t{t}.ome.tif", count=4, t=t) for t in range(2)], z=4, t=2))
    save(tmp_path / "t0.ome.tif", range(4), text)
    assert seen(read_volume(tmp_path / "t0.ome.tif", time=1)) == [0, 1, 2, 3]


def binary_only(name):
    return ome(f'<BinaryOnly MetadataFile="{name}" UUID="urn:uuid:2"/>')


@pytest.mark.parametrize("companion", ["ct.companion.ome", "meta.ome.tif"])
def test_xml_in_a_file_of_its_own_is_read(tmp_path, companion):
    text = ome(image([data(f"f{7 - z}.ome.tif", z=z) for z in range(8)]))
    for z in range(8):
        save(tmp_path / f"f{7 - z}.ome.tif", [z], binary_only(companion))
    if companion.endswith(".tif"):
        save(tmp_path / companion, [99], text)
    else:
        (tmp_path / companion).write_text(text, encoding="utf-8")
    for path in (tmp_path, tmp_path / "f2.ome.tif"):
        volume = read_volume(path)
        assert (seen(volume), volume.spacing) == (list(range(8)), SPACING)


def test_xml_in_a_file_that_is_missing_is_named(tmp_path):
    for number in range(4):
        save(tmp_path / f"f{number}.ome.tif", [number], binary_only("ct.companion.ome"))
    volume = read_volume(tmp_path)
    assert (seen(volume), volume.spacing) == ([0, 1, 2, 3], (1, 1, 1))
    assert notes_with(volume, "spacing and order of the TIFF are in ct.companion.ome, which was not read")
    save(tmp_path / "pages.ome.tif", range(4), binary_only("ct.companion.ome"))
    assert notes_with(read_volume(tmp_path / "pages.ome.tif"), "are in ct.companion.ome, which was not read")


def test_two_of_like_size_are_refused_and_a_file_opens_its_own(tmp_path):
    names = {letter: [f"{letter}{z}.ome.tif" for z in range(4)] for letter in "ab"}
    parts = [image([data(name, z=z) for z, name in enumerate(names[letter])], z=4) for letter in "ab"]
    for letter in "ab":
        for z, name in enumerate(names[letter]):
            save(tmp_path / name, [10 * (letter == "b") + z], ome(*parts))
    words = (
        r"has 2 stacks of pictures: a0.ome.tif to a3.ome.tif \(4\), b0.ome.tif to b3.ome.tif \(4\); "
        r"choose a slice of the one to read, or give each a folder of its own"
    )
    with pytest.raises(CtmcError, match=words):
        read_volume(tmp_path)
    volume = read_volume(tmp_path / "b2.ome.tif")
    assert seen(volume) == [10, 11, 12, 13]
    assert notes_with(volume, "1 further image in the OME-XML left out")
    assert notes_with(volume, "4 pictures left out")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('FirstZ="3"', 'FirstZ="three"', r"is damaged \(FirstZ 'three'\); export it again"),
        ('FirstZ="3"', 'FirstZ="-3"', r"is damaged \(FirstZ '-3'\)"),
        ('SizeZ="8"', 'SizeZ="0"', r"is damaged \(SizeZ '0'\)"),
        ('SizeZ="8"', 'SizeZ="99999999"', r"is damaged \(99999999 planes\)"),
        ("XYZCT", "XYQCT", r"is damaged \(DimensionOrder 'XYQCT'\)"),
        ('FirstZ="3"', 'FirstZ="2"', r"names no file for slice 4 of 8; export it again"),
        ('IFD="0" PlaneCount="1"><UUID FileName="f4', 'IFD="3" PlaneCount="1"><UUID FileName="f4', r"f4.ome.tif has 1"),
    ],
)
def test_damaged_xml_is_one_sentence(mirrored, old, new, words):
    text = ome(image([data(f"f{7 - z}.ome.tif", z=z) for z in range(8)]))
    assert old in text
    for z in range(8):
        save(mirrored / f"f{7 - z}.ome.tif", [z], text.replace(old, new))
    with pytest.raises(CtmcError, match=words):
        read_volume(mirrored)


def test_xml_with_entities_is_refused(mirrored):
    text = ome(image([data(f"f{7 - z}.ome.tif", z=z) for z in range(8)]))
    entities = '<!DOCTYPE OME [<!ENTITY a "f7.ome.tif">]>'
    for z in range(8):
        save(mirrored / f"f{7 - z}.ome.tif", [z], text.replace("?>", "?>" + entities, 1))
    with pytest.raises(
        CtmcError, match=r"the OME-XML of f0.ome.tif is damaged \(it defines entities\); export it again"
    ):
        read_volume(mirrored)


def test_slices_that_are_complete_by_themselves_are_in_the_order_of_their_names(tmp_path):
    for z in range(4):
        save(tmp_path / f"f{z}.ome.tif", [z], ome(image([data(f"f{z}.ome.tif")], z=1)))
    volume = read_volume(tmp_path)
    assert (seen(volume), volume.spacing) == ([0, 1, 2, 3], SPACING)


def test_files_of_different_sizes_are_refused(mirrored):
    text = ome(image([data(f"f{7 - z}.ome.tif", z=z) for z in range(8)]))
    tifffile.imwrite(mirrored / "f2.ome.tif", np.zeros((4, 4), np.uint16), description=text.encode(), metadata=None)
    with pytest.raises(CtmcError, match=r"f2.ome.tif is 4 x 4 pixels and most are 6 x 5 pixels"):
        read_volume(mirrored)
