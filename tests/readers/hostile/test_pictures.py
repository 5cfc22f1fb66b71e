# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures and TIFF made to hurt, or that would be read as something else: each is one sentence, or a right volume."""

from __future__ import annotations

import struct
import time
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image
from refusals import refused

from ctmc_addon.core import Budget, ReadError
from ctmc_addon.readers import read_volume
from ctmc_addon.readers.images import tiff
from ctmc_addon.readers.images.tiff_page import page_layout

VALUES = np.random.default_rng(0).integers(0, 250, (4, 20, 24)).astype(np.int16)  # (slices, rows, columns)


def pngs(folder, numbers=range(4)):
    """Numbered slices."""
    folder.mkdir(exist_ok=True)
    for number in numbers:
        Image.fromarray(VALUES[number % 4].astype(np.uint8)).save(folder / f"s{number}.png")
    return folder


def test_a_png_with_a_wrong_check_sum_is_refused(tmp_path):
    content = bytearray((pngs(tmp_path) / "s2.png").read_bytes())
    at = content.index(b"IDAT")
    length = int.from_bytes(content[at - 4 : at], "big")
    pixels = bytearray(zlib.decompress(content[at + 4 : at + 4 + length]))
    pixels[30] ^= 4
    changed = zlib.compress(bytes(pixels), 0)
    broken = content[: at - 4] + struct.pack(">I", len(changed)) + b"IDAT" + changed + content[at + 4 + length :]
    (tmp_path / "s2.png").write_bytes(broken)
    refused(tmp_path, "s2.png")


@pytest.mark.parametrize("numbers", [(0, 1, 3, 4), (0, 1, 2, 5), (10, 20, 40, 50, 60)])
def test_a_gap_between_numbered_slices_is_refused(tmp_path, numbers):
    refused(pngs(tmp_path, numbers), "missing")


@pytest.mark.parametrize("numbers", [(0, 2, 4, 6), (3, 4), (120503, 120507, 120611, 130000), (1, 5)])
def test_slices_numbered_evenly_or_by_a_clock_are_read(tmp_path, numbers):
    assert len(read_volume(pngs(tmp_path, numbers)).values) == len(numbers)


def test_a_chosen_slice_decides_the_format(tmp_path):
    for number in range(2):
        tifffile.imwrite(pngs(tmp_path) / f"t{number}.tif", VALUES[number].astype(np.uint8) // 2)
    volume = read_volume(tmp_path / "t0.tif")
    np.testing.assert_array_equal(volume.values, VALUES[:2] // 2)
    assert any("4 PNG beside the 2 TIFF" in note for note in volume.notes)


@pytest.mark.parametrize("end", ["png", "jpg", "tif", "bmp"])
def test_an_image_without_its_suffix_is_refused(tmp_path, end):
    Image.fromarray(VALUES[0].astype(np.uint8)).save(tmp_path / f"a.{end}")
    (tmp_path / f"a.{end}").rename(tmp_path / "slice")
    refused(tmp_path / "slice", "slice")
    refused(tmp_path, tmp_path.name)


def test_a_tiff_stack_without_its_suffix_is_read(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", VALUES, photometric="minisblack")
    (tmp_path / "a.tif").rename(tmp_path / "stack")
    np.testing.assert_array_equal(read_volume(tmp_path / "stack").values, VALUES)


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_a_wrong_image_suffix_is_forgiven_or_refused(tmp_path, kind):
    for number, plane in enumerate(VALUES.astype(np.uint8)):
        Image.fromarray(plane).save(tmp_path / f"{number}.{'tif' if kind == 'PNG' else 'png'}", kind)
    if kind == "TIFF":
        np.testing.assert_array_equal(read_volume(tmp_path).values, VALUES)
    else:
        refused(tmp_path, "0.tif")


@pytest.mark.parametrize("kind", ["EPS", "GIF", "WebP"])
def test_another_picture_under_a_png_name_is_not_opened(tmp_path, kind):
    """Pillow hands EPS to Ghostscript."""
    for number, plane in enumerate(VALUES.astype(np.uint8)):
        Image.fromarray(plane).save(tmp_path / f"{number}.png", kind)
    refused(tmp_path, "0.png holds no PNG, JPEG, JPEG 2000 or BMP; save it as 8 or 16 bit gray PNG")


def test_a_picture_that_cannot_be_opened_has_its_reason(tmp_path):
    """imageio says of each that an unknown error occurred."""
    pngs(tmp_path)
    content = bytearray((tmp_path / "s0.png").read_bytes())
    content[16:24] = struct.pack(">II", 100_000, 100_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    (tmp_path / "s0.png").write_bytes(content)
    refused(tmp_path, "s0.png", "10000000000 pixels", "exceeds limit of")
    (tmp_path / "s0.png").write_bytes(content[:20])
    assert "plugin" not in refused(tmp_path, "s0.png")


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize(("code", "value"), [(274, 0), (274, 9)])
def test_a_tag_that_is_not_read_may_have_a_wrong_value(tmp_path, code, value, compression):
    """Some cameras write an Orientation of 0."""
    path = tmp_path / "ct.tif"
    tags = [(code, "H", 1, value, False)]
    tifffile.imwrite(path, VALUES, photometric="minisblack", compression=compression, extratags=tags)
    np.testing.assert_array_equal(read_volume(path).values, VALUES)


def test_a_tag_of_an_unknown_type_is_passed_over(tmp_path):
    """TIFF 6.0, section 2: readers skip fields of an unexpected type."""
    path = tmp_path / "ct.tif"
    tags = [(65000, "H", 1, 7, False)]
    tifffile.imwrite(path, VALUES, photometric="minisblack", compression="zlib", extratags=tags)
    content = path.read_bytes()
    assert content.count(struct.pack("<HH", 65000, 3)) >= 1
    path.write_bytes(content.replace(struct.pack("<HH", 65000, 3), struct.pack("<HH", 65000, 129)))
    np.testing.assert_array_equal(read_volume(path).values, VALUES)


def ifd_ends(content):
    """Where the offset to the next page stands, for every page of a little-endian TIFF."""
    at, ends = 4, []
    while (page := int.from_bytes(content[at : at + 4], "little")) != 0:
        at = page + 2 + 12 * int.from_bytes(content[page : page + 2], "little")
        ends.append(at)
    return ends


@pytest.mark.parametrize("next_page", [1 << 30, 8, 0])
def test_a_broken_chain_of_tiff_pages_is_refused(tmp_path, next_page):
    path = tmp_path / "ct.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack", compression="zlib")
    content = bytearray(path.read_bytes())
    at = ifd_ends(content)[1]
    content[at : at + 4] = struct.pack("<I", next_page)
    path.write_bytes(content)
    refused(path, "ct.tif")


@pytest.mark.parametrize("damage", ["chain", "strip beyond the end", "empty strip"])
def test_a_damaged_tiff_slice_is_refused_in_a_folder_as_it_is_alone(tmp_path, damage):
    for number, plane in enumerate(VALUES.astype(np.uint8)):
        tifffile.imwrite(
            tmp_path / f"{number}.tif", plane, photometric="minisblack", rowsperstrip=5, compression="zlib"
        )
    path = tmp_path / "2.tif"
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        tags = tiff.pages[0].tags
        place = {"strip beyond the end": tags["StripOffsets"], "empty strip": tags["StripByteCounts"]}.get(damage)
    if place is None:
        at = ifd_ends(content)[0]
        content[at : at + 4] = struct.pack("<I", 1 << 30)
    else:
        item = place.valuebytecount // place.count
        value = (1 << 15) - 1 if damage == "strip beyond the end" else 0
        content[place.valueoffset + item : place.valueoffset + 2 * item] = value.to_bytes(item, "little")
    path.write_bytes(content)
    refused(tmp_path, "2.tif")
    for other in (0, 1, 3):
        (tmp_path / f"{other}.tif").unlink()
    refused(path, "2.tif")


def test_threads_read_the_tags_of_pages_one_after_the_other(tmp_path, monkeypatch):
    """tifffile seeks for a long tag when it is asked for, and another thread would take its place in the file."""
    inside, most = [], []

    def watched(page, path):
        inside.append(page)
        most.append(len(inside))
        time.sleep(0.02)
        layout = page_layout(page, path)
        inside.remove(page)
        return layout

    path = tmp_path / "ct.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack", compression="zlib")
    monkeypatch.setattr(tiff, "page_layout", watched)
    np.testing.assert_array_equal(read_volume(path, budget=Budget(threads=4)).values, VALUES)
    assert max(most) == 1


@pytest.mark.parametrize("pages", [1, 4])
def test_a_palette_tiff_gives_its_grays_and_no_colors(tmp_path, pages):
    ramp = np.arange(256, dtype=np.uint16)[::-1] * 257
    for colors, readable in ((np.stack([ramp] * 3), True), (np.stack([ramp, ramp, ramp[::-1]]), False)):
        path = tmp_path / "0.tif"
        for number in range(4 // pages):
            values = VALUES.astype(np.uint8)[number : number + pages] if pages > 1 else VALUES.astype(np.uint8)[number]
            path = tmp_path / f"{number}.tif"
            tifffile.imwrite(path, values, photometric="palette", colormap=colors, compression="zlib")
        if readable:
            np.testing.assert_array_equal(read_volume(tmp_path).values, 255 - VALUES)
        else:
            refused(tmp_path, "colored")


@pytest.mark.parametrize(("kind", "count"), [(3, 2), (2, 1), (7, 3)])
def test_a_tiff_tag_of_another_type_is_no_traceback(tmp_path, kind, count):
    path = tmp_path / "ct.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack")
    content = bytearray(path.read_bytes())
    with tifffile.TiffFile(path) as tiff:
        at = tiff.pages[0].tags["PhotometricInterpretation"].offset
    content[at + 2 : at + 12] = struct.pack("<HIHH", kind, count, 1, 1)
    path.write_bytes(content)
    try:
        values = read_volume(path).values
    except ReadError:
        return
    np.testing.assert_array_equal(values, VALUES)
