# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF of ImageJ and OME, as tifffile writes them: slices, times, channels and spacing."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import tifffile

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import open_volume, read_volume


def numbers(*shape):
    return np.random.default_rng(0).integers(0, 60000, shape).astype(np.uint16)


def saved(path, values, axes, **options):
    metadata = {"axes": axes, **options.pop("metadata", {})}
    tifffile.imwrite(path, values, metadata=metadata, photometric="minisblack", **options)
    return path


KINDS = {
    "imagej": ("s.tif", {"imagej": True}),
    "ome": ("s.ome.tif", {}),
    "ome packed": ("s.ome.tif", {"compression": "zlib"}),
    "ome tiled": ("s.ome.tif", {"tile": (16, 16)}),
    "ome big": ("s.ome.tif", {"bigtiff": True}),
}


@pytest.mark.parametrize("kind", KINDS)
def test_each_time_of_the_first_channel_is_read(tmp_path, kind):
    name, options = KINDS[kind]
    values = numbers(3, 4, 2, 20, 24)
    path = saved(tmp_path / name, values, "TZCYX", **options)
    assert open_volume(path).series[0].times == 3
    for time in (1, 2, 3):
        volume = read_volume(path, time=time)
        np.testing.assert_array_equal(volume.values, values[time - 1, :, 0])
        assert any("2 channels: the first was read" in note for note in volume.notes)
    part = read_volume(path, time=2, region=(2, 3, 1, 20, 11, 4), stride=(3, 2, 2))
    np.testing.assert_array_equal(part.values, values[1, 1:5:2, 0, 3:12:2, 2:21:3])


@pytest.mark.parametrize(("axes", "order"), [("TZYX", (0, 1)), ("ZTYX", (1, 0))])
def test_time_may_change_faster_than_the_slice(tmp_path, axes, order):
    values = numbers(3, 3, 8, 9)
    path = saved(tmp_path / "s.ome.tif", values, axes)
    expected = np.transpose(values, (*order, 2, 3))
    for time in (1, 2, 3):
        np.testing.assert_array_equal(read_volume(path, time=time).values, expected[time - 1])


@pytest.mark.parametrize("axes", ["TCYX", "CYX"])
def test_channels_without_slices_are_refused(tmp_path, axes):
    path = saved(tmp_path / "s.tif", numbers(*(3, 4, 8, 9)[-len(axes) :]), axes, imagej=True)
    with pytest.raises(CtmcError, match=r"more than one channel or time \(.*C 4 x Y 8 x X 9\)"):
        read_volume(path)


@pytest.mark.parametrize(
    ("unit", "mm"), [("mm", 1), ("um", 1e-3), ("micron", 1e-3), ("\\u00B5m", 1e-3), ("cm", 10), ("inch", 25.4)]
)
def test_imagej_says_its_spacing(tmp_path, unit, mm):
    metadata = {"spacing": 2.5, "unit": unit}
    options = {"imagej": True, "resolution": (4.0, 2.0), "metadata": metadata}
    volume = read_volume(saved(tmp_path / "s.tif", numbers(4, 8, 9), "ZYX", **options))
    assert volume.spacing == pytest.approx((0.25 * mm, 0.5 * mm, 2.5 * mm))
    assert any("no orientation" in note for note in volume.notes)
    assert not any("no spacing" in note for note in volume.notes)
    assert any("converted to mm" in note for note in volume.notes) == (mm != 1)
    given = read_volume(tmp_path / "s.tif", spacing=(1, 2, 3))
    assert given.spacing == (1, 2, 3)
    assert any("instead of the file's own" in note for note in given.notes)


@pytest.mark.parametrize("metadata", [{}, {"unit": "pixel", "spacing": 3}])
def test_a_unit_that_is_no_length_gives_no_spacing(tmp_path, metadata):
    path = saved(tmp_path / "s.tif", numbers(4, 8, 9), "ZYX", imagej=True, resolution=(4.0, 2.0), metadata=metadata)
    volume = read_volume(path)
    assert volume.spacing == (1, 1, 1)
    assert any("1 mm is assumed" in note for note in volume.notes)


@pytest.mark.parametrize(
    ("units", "expected"),
    [
        ({"unit": "um", "zunit": "mm"}, (0.00025, 0.0005, 3.9)),
        ({"unit": "um", "yunit": "cm"}, (0.00025, 5.0, 0.0039)),
        ({"unit": "mm", "yunit": "\\u00B5m", "zunit": "nm"}, (0.25, 0.0005, 3.9e-6)),
    ],
)
def test_each_axis_of_imagej_has_its_own_unit(tmp_path, units, expected):
    options = {"imagej": True, "resolution": (4.0, 2.0), "metadata": {"spacing": 3.9, **units}}
    volume = read_volume(saved(tmp_path / "s.tif", numbers(4, 8, 9), "ZYX", **options))
    assert volume.spacing == pytest.approx(expected)
    assert any("converted to mm" in note for note in volume.notes)


def test_a_length_of_imagej_in_an_unknown_unit_is_taken_as_mm_with_a_note(tmp_path):
    metadata = {"unit": "mm", "zunit": "parsec", "spacing": 2}
    path = saved(tmp_path / "s.tif", numbers(4, 8, 9), "ZYX", imagej=True, resolution=(4.0, 2.0), metadata=metadata)
    volume = read_volume(path)
    assert volume.spacing == (0.25, 0.5, 2.0)
    assert any("'parsec'" in note for note in volume.notes)


def test_single_slices_of_imagej_say_the_size_of_their_pixels(tmp_path):
    options = {"imagej": True, "resolution": (4.0, 2.0), "metadata": {"unit": "mm"}}
    for number, plane in enumerate(numbers(4, 8, 9)):
        saved(tmp_path / f"{number}.tif", plane, "YX", **options)
    volume = read_volume(tmp_path)
    assert volume.spacing == (0.25, 0.5, 0.25)
    assert any("no spacing between slices: that between columns is taken" in note for note in volume.notes)
    saved(tmp_path / "3.tif", numbers(8, 9), "YX", **{**options, "resolution": (5.0, 2.0)})
    other = read_volume(tmp_path)
    assert other.spacing == (1, 1, 1)
    assert any("the slices have different spacings, so none is used" in note for note in other.notes)


def test_ome_says_its_spacing_in_units_of_its_own(tmp_path):
    sizes = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeYUnit": "mm", "PhysicalSizeZ": 300}
    metadata = {**sizes, "PhysicalSizeZUnit": "nm"}
    volume = read_volume(saved(tmp_path / "s.ome.tif", numbers(4, 8, 9), "ZYX", metadata=metadata))
    assert volume.spacing == pytest.approx((0.0005, 0.25, 0.0003))
    assert any("nm and µm" in note for note in volume.notes)


def test_ome_without_a_spacing_of_slices_takes_that_of_columns_and_says_so(tmp_path):
    metadata = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeXUnit": "mm", "PhysicalSizeYUnit": "mm"}
    volume = read_volume(saved(tmp_path / "s.ome.tif", numbers(4, 8, 9), "ZYX", metadata=metadata))
    assert volume.spacing == (0.5, 0.25, 0.5)
    assert any("no spacing between slices" in note for note in volume.notes)


@pytest.mark.parametrize("options", [{}, {"tile": (16, 16)}, {"tile": (16, 32), "compression": "zlib"}])
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("dtype", ["u1", "i2", "u2", "f4"])
def test_big_and_tiled_tiff_keep_their_values(tmp_path, options, order, dtype):
    values = (numbers(4, 20, 40) % 200).astype(dtype)
    tifffile.imwrite(tmp_path / "s.tif", values, photometric="minisblack", bigtiff=True, byteorder=order, **options)
    volume = read_volume(tmp_path / "s.tif")
    np.testing.assert_array_equal(volume.values, values)
    assert volume.values.dtype == np.dtype(dtype)


@pytest.mark.parametrize("name", ["../secret.tif", "other.tif"])
def test_files_that_ome_names_are_not_opened(tmp_path, name):
    secret = tmp_path / "in" / name
    (tmp_path / "in").mkdir()
    tifffile.imwrite(secret, np.full((4, 8, 9), 7, np.uint16), photometric="minisblack")
    text = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="9" SizeY="8" SizeC="1" SizeZ="4" SizeT="1">'
        f'<TiffData IFD="0" PlaneCount="4"><UUID FileName="{name}">urn:uuid:1</UUID></TiffData></Pixels></Image></OME>'
    )
    values = numbers(4, 8, 9)
    path = tmp_path / "in" / "s.ome.tif"
    tifffile.imwrite(path, values, photometric="minisblack", description=text, metadata=None)
    # tifffile by itself follows the name, in some versions.
    np.testing.assert_array_equal(read_volume(path).values, values)


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_pages_of_one_bit_are_read(tmp_path, compression):
    values = numbers(5, 20, 27) > 30000
    tifffile.imwrite(tmp_path / "s.tif", values, photometric="minisblack", compression=compression)
    np.testing.assert_array_equal(read_volume(tmp_path / "s.tif").values, 255 * values)


def test_several_slices_in_one_page_are_refused_in_a_sentence(tmp_path):
    path = saved(tmp_path / "s.tif", numbers(6, 32, 32), "ZYX", volumetric=True, tile=(2, 16, 16))
    with pytest.raises(CtmcError, match=r"several slices in one page \(ImageDepth\); save it with a page for each"):
        read_volume(path)


@pytest.mark.parametrize("host", ["as it is", "existing loggers are off", "all logging is off"])
def test_a_chain_of_pages_that_breaks_off_is_refused_however_the_host_logs(tmp_path, host):
    path = saved(tmp_path / "s.tif", numbers(4, 8, 9), "ZYX", contiguous=False)
    with tifffile.TiffFile(path) as tiff:
        second = tiff.pages[1].offset + 2 + 12 * len(tiff.pages[1].tags)  # The offset of the next page is there.
    content = bytearray(path.read_bytes())
    content[second : second + 4] = (len(content) + 10).to_bytes(4, "little")
    path.write_bytes(content)
    logger = logging.getLogger("tifffile")
    before = logger.level, logger.disabled, logging.root.manager.disable
    try:
        logger.disabled = host == "existing loggers are off"
        logging.disable(logging.CRITICAL if host == "all logging is off" else logging.NOTSET)
        with pytest.raises(CtmcError, match=r"s\.tif is truncated or damaged \(.*; copy it again"):
            read_volume(path)
    finally:
        logger.level, logger.disabled, logging.root.manager.disable = before
