# SPDX-License-Identifier: GPL-3.0-or-later
"""Pixels of TIFF of every depth and compression, as they were written, whether or not imagecodecs is installed."""

from __future__ import annotations

import importlib.util
import io
import struct
import zlib

import numpy as np
import pytest
import tifffile
from hand_made_tiff import DEFLATE, GROUP_4, JPEG, LZMA, LZW, NONE, PACKBITS, gray_page, packed, strip_by_pillow, tiff
from PIL import Image

from ctmc_addon.core import CtmcError, ReadError
from ctmc_addon.readers import read_volume

SHAPE = (3, 11, 13)
HAS_IMAGECODECS = importlib.util.find_spec("imagecodecs") is not None


def numbers(bits, shape=SHAPE):
    return np.random.default_rng(bits).integers(0, 1 << min(bits, 62), shape)


def saved(folder, pages, **options):
    (folder / "s.tif").write_bytes(tiff(pages, **options))
    return folder / "s.tif"


def read_without_imagecodecs(bits, compression, order):
    """Whether tifffile by itself, or Pillow, reads whole numbers of so many bits."""
    if compression == LZW and bits in (32, 64):
        return (bits, order) == (32, "<")
    return bits in (1, 2, 4, 8, 16, 32, 64) or (bits, order) == (12, "<")


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("compression", [NONE, DEFLATE, LZW, PACKBITS, LZMA])
@pytest.mark.parametrize("bits", [1, 2, 3, 4, 6, 8, 10, 12, 14, 16, 32, 64])
def test_whole_numbers_are_those_stored_or_imagecodecs_is_named(tmp_path, bits, compression, order):
    values = numbers(bits)
    path = saved(tmp_path, [gray_page(plane, bits, compression, 4, order=order) for plane in values], order=order)
    if not read_without_imagecodecs(bits, compression, order) and not HAS_IMAGECODECS:
        with pytest.raises(ReadError, match=rf"pixels of {bits} bits .* need the Python package imagecodecs; save it"):
            read_volume(path)
        return
    read = read_volume(path).values
    np.testing.assert_array_equal(read, values * (255 if bits == 1 else 1))
    assert read.dtype == np.dtype("uint8" if bits <= 8 else "uint16" if bits <= 16 else f"uint{bits}")


@pytest.mark.parametrize("compression", [DEFLATE, LZW])
@pytest.mark.parametrize("bits", [8, 16, 32])
def test_differences_between_columns_are_added_up(tmp_path, bits, compression):
    values = numbers(bits)
    pages = [gray_page(plane, bits, compression, 4, differences=True) for plane in values]
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, values)


@pytest.mark.parametrize(("bits", "compression"), [(4, LZW), (12, DEFLATE), (12, LZW), (8, NONE)])
def test_differences_that_readers_add_up_in_two_ways_are_refused(tmp_path, bits, compression):
    pages = [gray_page(plane, bits, compression, differences=True) for plane in numbers(bits)]
    with pytest.raises(ReadError, match=rf"of {bits} bits.* with Predictor 2, which are not read; save it without"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize("compression", [NONE, LZW, PACKBITS])
@pytest.mark.parametrize("bits", [2, 4])
def test_labels_0_1_2_stay_0_1_2(tmp_path, bits, compression):
    values = np.arange(3 * 4 * 5).reshape(3, 4, 5) % 3
    pages = [gray_page(plane, bits, compression) for plane in values]
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, values)


@pytest.mark.parametrize("bits", [2, 4])
def test_a_png_of_labels_keeps_them_too(tmp_path, bits):
    values = np.arange(3 * 4 * 5).reshape(3, 4, 5) % 3
    for number, plane in enumerate(values):
        rows = np.frombuffer(packed(plane, bits), np.uint8).reshape(4, -1)
        png = chunk(b"IHDR", struct.pack(">IIBBBBB", 5, 4, bits, 0, 0, 0, 0))
        png += chunk(b"IDAT", zlib.compress(np.pad(rows, ((0, 0), (1, 0))).tobytes())) + chunk(b"IEND", b"")
        (tmp_path / f"{number}.png").write_bytes(b"\x89PNG\r\n\x1a\n" + png)
    np.testing.assert_array_equal(read_volume(tmp_path).values, values)


def test_a_palette_png_without_its_palette_is_refused(tmp_path):
    for number in range(2):
        png = chunk(b"IHDR", struct.pack(">IIBBBBB", 5, 4, 8, 3, 0, 0, 0))
        png += chunk(b"IDAT", zlib.compress(bytes(24))) + chunk(b"IEND", b"")
        (tmp_path / f"{number}.png").write_bytes(b"\x89PNG\r\n\x1a\n" + png)
    with pytest.raises(ReadError, match=r"0\.png is a palette picture without its palette; copy or export it again"):
        read_volume(tmp_path)


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def float_page(plane):
    """Predictor 3 as Adobe's technical note 3 has it: bytes of a row by rank, then their differences."""
    rows, columns = plane.shape
    size = plane.dtype.itemsize
    ranked = np.moveaxis(plane.astype(plane.dtype.newbyteorder(">")).view(np.uint8).reshape(rows, columns, size), 2, 1)
    content = np.diff(ranked.reshape(rows, -1), axis=1, prepend=np.uint8(0)).tobytes()
    tags, _ = gray_page(np.zeros_like(plane, int), 8 * size, t317=(3, [3]), t339=(3, [3]))
    return tags | {259: (3, [DEFLATE])}, [zlib.compress(content)]


def test_floating_point_differences_are_added_up(tmp_path):
    values = np.random.default_rng(0).normal(0, 900, SHAPE).astype(np.float32)
    path = saved(tmp_path, [float_page(plane) for plane in values])
    np.testing.assert_array_equal(read_volume(path).values, values)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("dtype", ["i1", "i2", "i4", "f4"])
def test_signed_and_floating_point_numbers_of_lzw_are_those_stored_or_imagecodecs_is_named(tmp_path, dtype, order):
    values = np.random.default_rng(0).normal(0, 40, SHAPE).astype(dtype)
    size, kind = values.dtype.itemsize, 3 if dtype == "f4" else 2
    bytes_of = [plane.astype(values.dtype.newbyteorder(order)).view(np.uint8).reshape(11, -1) for plane in values]
    pages = []
    for plane in bytes_of:
        tags, _ = gray_page(np.zeros(SHAPE[1:]), 8 * size, t339=(3, [kind]))
        pages.append((tags | {259: (3, [LZW])}, gray_page(plane, 8, LZW)[1]))
    path = saved(tmp_path, pages, order=order)
    try:
        np.testing.assert_array_equal(read_volume(path).values, values)
    except ReadError as error:
        assert "need the Python package imagecodecs" in str(error)  # noqa: PT017
        assert order == ">"
        assert size > 1


@pytest.mark.parametrize(("bits", "compression"), [(1, NONE), (4, LZW), (8, PACKBITS), (16, DEFLATE)])
def test_the_lowest_bit_may_come_first(tmp_path, bits, compression):
    values = numbers(bits)
    turned = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
    pages = [gray_page(plane, bits, compression, t266=(3, [2])) for plane in values]
    pages = [(tags, [strip.translate(turned) for strip in strips]) for tags, strips in pages]
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, values * (255 if bits == 1 else 1))


@pytest.mark.parametrize("bits", [1, 4, 8, 16])
def test_white_may_be_zero(tmp_path, bits):
    values = numbers(bits)
    pages = [gray_page((1 << bits) - 1 - plane, bits, t262=(3, [0])) for plane in values]
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, values * (255 if bits == 1 else 1))


@pytest.mark.parametrize("scale", [1, 257])
@pytest.mark.parametrize("bits", [1, 2, 4, 8])
def test_palettes_of_gray_of_any_bits_and_of_8_or_16_bits_a_color_are_read(tmp_path, bits, scale):
    values = numbers(bits)
    shades = np.linspace(30, 250, 1 << bits).astype(int)
    colors = (3, [int(shade) * scale for shade in np.tile(shades, 3)])
    pages = [gray_page(plane, bits, t262=(3, [3]), t320=colors) for plane in values]
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, shades[values])


@pytest.mark.parametrize("count", [0, 5, 47, 49])
def test_a_palette_without_all_its_colors_is_refused(tmp_path, count):
    more = {"t320": (3, list(range(count)))} if count else {}
    pages = [gray_page(plane, 4, t262=(3, [3]), **more) for plane in numbers(4)]
    with pytest.raises(ReadError, match=rf"(its palette has {count} numbers|count={count}).*copy it again"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize(("kind", "shade"), [(4, 1 << 20), (16, (1 << 64) - 1)])
def test_a_palette_of_more_than_16_bits_a_color_is_refused(tmp_path, kind, shade):
    pages = [gray_page(plane, 1, t262=(3, [3]), t320=(kind, [0, shade] * 3)) for plane in numbers(1)]
    with pytest.raises(ReadError, match=rf"its palette has the color {shade}, above 65535\); copy it again"):
        read_volume(saved(tmp_path, pages, big=True))


@pytest.mark.parametrize("compression", [LZW, DEFLATE])
def test_tiles_are_laid_side_by_side(tmp_path, compression):
    values = numbers(16, (2, 40, 50))
    pages = []
    for plane in values:
        padded = np.pad(plane, ((0, 8), (0, 14)))
        tiles = [padded[y : y + 16, x : x + 32] for y in (0, 16, 32) for x in (0, 32)]
        made = [gray_page(tile, 16, compression, differences=True) for tile in tiles]
        tags = made[0][0] | {256: (4, [50]), 257: (4, [40]), 322: (4, [32]), 323: (4, [16])}
        del tags[278]
        pages.append((tags, [strips[0] for _, strips in made]))
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, values)


@pytest.mark.parametrize("compression", [NONE, DEFLATE, LZW])
def test_tiles_that_are_narrower_than_their_pixels_are_refused(tmp_path, compression):
    pages = []
    for plane in numbers(8, (2, 16, 30)):
        strips = [gray_page(np.pad(plane, ((0, 0), (0, 2)))[:, at : at + 16], 8, compression)[1][0] for at in (0, 16)]
        tags, _ = gray_page(plane, 8, compression, t322=(4, [15]), t323=(4, [16]))
        pages.append((tags, strips))
    with pytest.raises(ReadError, match=r"tiles of 15 x 16 pixels, which are not multiples of 16\); copy it again"):
        read_volume(saved(tmp_path, pages))


def test_a_strip_at_the_start_of_the_file_is_not_read_as_pixels(tmp_path):
    content = bytearray(tiff([gray_page(plane, 8, PACKBITS) for plane in numbers(8)]))
    at = list(tag_places(content))[1][273]
    content[at + 8 : at + 12] = bytes(4)
    (tmp_path / "s.tif").write_bytes(content)
    with pytest.raises(ReadError, match=r"is truncated: \d+ bytes of pixels at byte 0 of \d+; copy it again"):
        read_volume(tmp_path / "s.tif")


def test_a_page_far_larger_than_the_first_is_refused_before_room_is_made_for_it(tmp_path):
    path = tmp_path / "s.tif"
    tifffile.imwrite(path, numbers(8).astype(np.uint8), photometric="minisblack", compression="zlib")
    content = bytearray(path.read_bytes())
    places = list(tag_places(content))[1]
    for code in (257, 278):
        content[places[code] + 2 : places[code] + 12] = struct.pack("<HII", 4, 1, 0x7FFFFFFF)
    path.write_bytes(content)
    with pytest.raises(
        ReadError, match=r"page 2 of s.tif has 13 x 2147483647 pixels of 8 bits \(uint8\).*, and the first 13 x 11"
    ):
        read_volume(path)


def test_a_page_of_other_bits_than_the_first_is_refused(tmp_path):
    path = tmp_path / "s.ome.tif"
    tifffile.imwrite(path, numbers(15).astype(np.uint16), photometric="minisblack", metadata={"axes": "ZYX"})
    content = bytearray(path.read_bytes())
    at = next(iter(tag_places(content)))[258]
    content[at + 8] = 15
    path.write_bytes(content)
    with pytest.raises(ReadError, match=r"pixels of 15 bits"):
        read_volume(path)


@pytest.mark.parametrize("samples", [5, 60000])
def test_more_samples_than_a_color_has_are_refused(tmp_path, samples):
    pages = [gray_page(plane, 8, PACKBITS, t277=(3, [samples])) for plane in numbers(8)]
    with pytest.raises(CtmcError, match=rf"has {samples} samples for each pixel, and a slice has one; save it as gray"):
        read_volume(saved(tmp_path, pages))


def group_4_pages(mask):
    pages = [gray_page(plane, 1) for plane in mask.astype(int)]
    strips = [strip_by_pillow(Image.fromarray(plane), "group4") for plane in mask]
    return [(tags | {259: (3, [GROUP_4])}, [strip]) for (tags, _), strip in zip(pages, strips, strict=True)]


def test_ccitt_group_4_is_read_and_refused_where_its_end_is_missing(tmp_path):
    mask = numbers(1, (2, 20, 33)) == 1
    pages = group_4_pages(mask)
    np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, 255 * mask)
    pages[1] = (pages[1][0], [pages[1][1][0][:-4]])
    with pytest.raises(ReadError, match=r"the end of a compressed strip is missing\); copy it again"):
        read_volume(saved(tmp_path, pages))


def jpeg_pages(values, mode="L"):
    pages = []
    for plane in values:
        stream = io.BytesIO()
        Image.fromarray(plane).convert(mode).save(stream, "JPEG", quality=95)
        tags, _ = gray_page(plane, 8, t277=(3, [len(mode)]), t262=(3, [1 if mode == "L" else 6]))
        tags |= {258: (3, [8] * len(mode)), 259: (3, [JPEG])}
        pages.append((tags, [stream.getvalue()]))
    return pages


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_jpeg_is_what_pillow_makes_of_its_strips(tmp_path, mode):
    values = np.tile(np.arange(0, 160, 10, dtype=np.uint8), (2, 16, 1))
    pages = jpeg_pages(values, mode)
    read = read_volume(saved(tmp_path, pages)).values
    assert np.abs(read.astype(int) - values).max() <= 8
    with Image.open(io.BytesIO(pages[0][1][0])) as image:
        np.testing.assert_array_equal(read[0], np.asarray(image).reshape(16, 16, -1)[..., 0])


@pytest.mark.parametrize("missing", [1, 8, 60])
def test_a_jpeg_strip_cut_off_is_refused(tmp_path, missing):
    pages = jpeg_pages(np.tile(np.arange(0, 160, 10, dtype=np.uint8), (2, 16, 1)))
    pages[1] = (pages[1][0], [pages[1][1][0][:-missing]])
    with pytest.raises(ReadError, match=r"the end of a compressed strip is missing\); copy it again"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize("compression", [NONE, DEFLATE, LZW, PACKBITS, LZMA])
def test_a_strip_cut_off_is_refused(tmp_path, compression):
    pages = [gray_page(plane, 12, compression) for plane in numbers(12)]
    pages[1] = (pages[1][0], [pages[1][1][0][:-8]])
    with pytest.raises(ReadError, match=r"s\.tif is truncated"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize("compression", [NONE, DEFLATE, LZW])
@pytest.mark.parametrize("page", [0, 1])
def test_a_tag_of_a_wrong_type_is_refused_and_never_read_as_something_else(tmp_path, page, compression):
    content = tiff([gray_page(plane, 16, compression, 4, differences=compression != NONE) for plane in numbers(16)])
    places = dict(list(tag_places(content))[page])
    assert len(places) == 10 - (compression == NONE)
    for at in places.values():
        for kind in (0, 2, 5, 6, 8, 11, 12, 13, 255):
            changed = bytearray(content)
            changed[at + 2] = kind
            (tmp_path / "s.tif").write_bytes(changed)
            with pytest.raises(CtmcError):
                read_volume(tmp_path / "s.tif")


@pytest.mark.parametrize(("code", "value"), [(258, 13), (259, 8), (262, 0), (317, 1)])
def test_a_page_in_the_middle_that_is_stored_in_another_way_is_not_left_out(tmp_path, code, value):
    content = bytearray(tiff([gray_page(plane, 16, LZW, differences=True) for plane in numbers(16)]))
    at = list(tag_places(content))[1][code]
    content[at + 8 : at + 10] = struct.pack("<H", value)
    (tmp_path / "s.tif").write_bytes(content)
    with pytest.raises(ReadError, match=r"page 2 of s.tif is stored differently|is truncated or damaged"):
        read_volume(tmp_path / "s.tif")


def test_a_page_whose_compression_is_not_that_of_the_others_is_refused(tmp_path):
    """Deflate unpacked as PackBits gives enough bytes, and wrong ones."""
    pages = [gray_page(plane, 8, DEFLATE) for plane in numbers(8)]
    pages[1] = gray_page(numbers(8)[1], 8, PACKBITS)
    with pytest.raises(ReadError, match=r"in Compression|stored differently|different sizes"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize("compression", [NONE, DEFLATE, LZW])
@pytest.mark.parametrize("code", [256, 259, 278, 317])
def test_several_values_of_a_tag_that_has_one_are_refused(tmp_path, code, compression):
    """libtiff reads a page of several RowsPerStrip, or of far too many, as zeros."""
    for values in ((3, [11, 11, 11]), (16, [1 << 40])):
        pages = [gray_page(plane, 8, compression) for plane in numbers(8)]
        pages[1][0][code] = values
        with pytest.raises(ReadError, match=r"is truncated or damaged|has pixels of 8 bits"):
            read_volume(saved(tmp_path, pages, big=True))


def tag_places(content):
    """Of each page of a classic little-endian TIFF, where the entry of each tag is."""
    (at,) = struct.unpack("<I", content[4:8])
    while at:
        (count,) = struct.unpack("<H", content[at : at + 2])
        starts = [at + 2 + 12 * number for number in range(count)]
        yield {struct.unpack("<H", content[start : start + 2])[0]: start for start in starts}
        (at,) = struct.unpack("<I", content[at + 2 + 12 * count :][:4])


@pytest.mark.parametrize(
    ("bits", "sample_format", "text"),
    [
        (24, 1, "whole numbers of 24 bits"),
        (20, 1, "whole numbers of 20 bits"),
        (12, 2, "whole numbers with a sign of 12 bits"),
        (16, 3, "floating point numbers of 16 bits"),
        (24, 3, "floating point numbers of 24 bits"),
        (64, 6, "numbers of SampleFormat 6 of 64 bits"),
    ],
)
def test_what_is_not_read_is_refused_for_what_it_is(tmp_path, bits, sample_format, text):
    pages = [gray_page(plane, bits, t339=(3, [sample_format])) for plane in numbers(8)]
    with pytest.raises(ReadError, match=rf"s.tif has {text}, which are not read; save it as 8, 16 or 32 bit gray"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.skipif(HAS_IMAGECODECS, reason="imagecodecs is installed, which reads it")
def test_a_compression_that_nothing_here_reads_is_named(tmp_path):
    pages = [gray_page(plane, 16) for plane in numbers(16)]
    for tags, _ in pages:
        tags[259] = (3, [34712])
    with pytest.raises(ReadError, match=r"16 bits .* compressed as JPEG.*2000, which need the Python package imagec"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize("compression", [2, 3])
def test_fax_compression_without_an_end_is_refused_with_or_without_imagecodecs(tmp_path, compression):
    pages = [gray_page(plane, 16) for plane in numbers(16)]
    for tags, _ in pages:
        tags[259] = (3, [compression])
    with pytest.raises(ReadError, match=r"which is not read, because its pixels have no end mark; save it un"):
        read_volume(saved(tmp_path, pages))


def test_a_page_is_read_as_its_own_tags_say_and_not_as_the_first_ones_do(tmp_path):
    values = numbers(8)
    pages = [gray_page(plane, 8, DEFLATE) for plane in values]
    turned = bytes(int(f"{byte:08b}"[::-1], 2) for byte in zlib.compress(values[1].astype(np.uint8).tobytes()))
    pages[1] = (pages[1][0] | {266: (3, [2])}, [turned])
    try:
        np.testing.assert_array_equal(read_volume(saved(tmp_path, pages)).values, values)
    except ReadError as error:
        assert "stored differently" in str(error)  # noqa: PT017


@pytest.mark.parametrize("kind", [5, 8])
def test_colors_of_another_kind_are_refused(tmp_path, kind):
    pages = [gray_page(plane, 8, t262=(3, [kind])) for plane in numbers(8)]
    with pytest.raises(ReadError, match=rf"has colors of PhotometricInterpretation {kind}; save it as gray"):
        read_volume(saved(tmp_path, pages))


@pytest.mark.parametrize("page", [0, 2])
def test_a_page_that_says_twice_where_its_pixels_are_is_refused(tmp_path, page):
    pages = [gray_page(values, 16, **{f"t{305 + number}": (3, [1])}) for number, values in enumerate(numbers(16))]
    content = tiff(pages)
    own, twice = (struct.pack("<HHI", code, 3, 1) for code in (305 + page, 273))
    assert content.count(own) == 1
    (tmp_path / "s.tif").write_bytes(content.replace(own, twice))
    with pytest.raises(ReadError, match="its tag StripOffsets has a wrong type, count or size"):
        read_volume(tmp_path / "s.tif")
