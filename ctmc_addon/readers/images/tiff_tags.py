# SPDX-License-Identifier: GPL-3.0-or-later
"""How one page of a TIFF stores its pixels, read from its own tags: TIFF 6.0 and its supplements.

tifffile passes over a damaged tag and takes its default, and takes the first page's tags for those of later pages.
Values would then come out wrong without a word, so each page that is read is asked itself, and a damaged tag refused.
"""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError

WIDTH, LENGTH, BITS, COMPRESSION, PHOTOMETRIC, FILL_ORDER = 256, 257, 258, 259, 262, 266
STRIP_OFFSETS, SAMPLES, ROWS_PER_STRIP, STRIP_BYTES, PLANAR, PREDICTOR = 273, 277, 278, 279, 284, 317
COLOR_MAP, TILE_WIDTH, TILE_LENGTH, TILE_OFFSETS, TILE_BYTES = 320, 322, 323, 324, 325
SAMPLE_FORMAT, JPEG_TABLES, IMAGE_DEPTH = 339, 347, 32997
NAMES = {
    WIDTH: "ImageWidth",
    LENGTH: "ImageLength",
    BITS: "BitsPerSample",
    COMPRESSION: "Compression",
    PHOTOMETRIC: "PhotometricInterpretation",
    FILL_ORDER: "FillOrder",
    STRIP_OFFSETS: "StripOffsets",
    SAMPLES: "SamplesPerPixel",
    ROWS_PER_STRIP: "RowsPerStrip",
    STRIP_BYTES: "StripByteCounts",
    PLANAR: "PlanarConfiguration",
    PREDICTOR: "Predictor",
    COLOR_MAP: "ColorMap",
    TILE_WIDTH: "TileWidth",
    TILE_LENGTH: "TileLength",
    TILE_OFFSETS: "TileOffsets",
    TILE_BYTES: "TileByteCounts",
    SAMPLE_FORMAT: "SampleFormat",
    JPEG_TABLES: "JPEGTables",
    IMAGE_DEPTH: "ImageDepth",
}
# Letters of struct for the types of whole numbers without a sign: BYTE, SHORT, LONG, UNDEFINED and LONG8.
LETTERS = {1: "B", 3: "H", 4: "I", 7: "B", 16: "Q"}
BYTE, UNDEFINED = 1, 7
TILE_STEP = 16  # of which a tile's sides are multiples
HEADER = 8  # bytes at the start of the file, where no pixels are; tifffile takes the offset 0 for a strip of zeros
MOST_TAGS = 4096
MOST_SHADE = (1 << 16) - 1  # of a palette's color
MOST_VALUES = 1 << 24  # of one tag
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, MASK, YCBCR = 0, 1, 2, 3, 4, 6
WHOLE, FORMATS = 1, {1: "u", 2: "i", 3: "f", 4: "u"}  # values of SampleFormat; 4 is "undefined", as libtiff has it
SIZES = {"u": (8, 16, 32, 64), "i": (8, 16, 32, 64), "f": (32, 64)}
UNCOMPRESSED, JPEG = 1, 7  # values of Compression


class PageLayout(NamedTuple):
    """Where the pixels of a page lie, and as what."""

    shape: tuple[int, int]  # (rows, columns)
    samples: int  # of a pixel
    separate: bool  # whether each sample has a plane of its own
    bits: int  # of a sample
    dtype: np.dtype[Any]  # of the values, in the machine's byte order
    order: Literal["<", ">"]  # of the file's bytes
    compression: int
    predictor: int
    photometric: int
    reversed_bits: bool  # whether a byte's first pixel is in its lowest bit
    tiled: bool
    chunk: tuple[int, int]  # (rows, columns) of a strip or tile
    offsets: tuple[int, ...]
    byte_counts: tuple[int, ...]
    colors: NDArray[np.uint8] | None  # (3, 2 ** bits), of a palette
    jpeg_tables: bytes

    @property
    def how_stored(self) -> tuple[Any, ...]:
        """Return all but where the pixels are, their colors and tables."""
        return self[: self._fields.index("offsets")]

    @property
    def depth(self) -> str:
        """Return the properties that all pages of a stack share, for a sentence."""
        kind = f"{self.samples} samples of {self.bits} bits" if self.samples > 1 else f"{self.bits} bits"
        palette = " and a palette" if self.colors is not None else ""
        return f"{self.shape[1]} x {self.shape[0]} pixels of {kind} ({self.dtype}){palette}"

    @property
    def planes(self) -> int:
        """Samples that lie one behind the other."""
        return self.samples if self.separate else 1

    @property
    def contiguous_samples(self) -> int:
        """Samples of a pixel that lie side by side."""
        return 1 if self.separate else self.samples

    @property
    def grid(self) -> tuple[int, int]:
        """Strips or tiles of a plane, down and across."""
        down, across = (-(-side // part) for side, part in zip(self.shape, self.chunk, strict=True))
        return down, across

    def rows_of(self, down: int) -> int:
        """Rows in a strip or tile of row `down` of the grid: the last strip ends with the page, tiles are filled up."""
        return self.chunk[0] if self.tiled else min(self.chunk[0], self.shape[0] - down * self.chunk[0])

    @property
    def row_bytes(self) -> int:
        """Bytes of a row of a strip or tile, unpacked."""
        return (self.chunk[1] * self.contiguous_samples * self.bits + 7) // 8


def page_layout(tiff: Any, page: Any, path: Path) -> PageLayout:
    """Return the layout of a page as its tags describe it.

    Parameters
    ----------
    tiff : tifffile.TiffFile
    page : tifffile.TiffPage or tifffile.TiffFrame
        Of a page without tags of its own, those of its keyframe hold.

    Raises
    ------
    ReadError
        Where a tag is missing, damaged, or says what is not read.
    """
    virtual = page.offset <= 0
    tags = _tags(tiff, page.keyframe.offset if virtual else page.offset, path)
    numbers = {code: values for code, values in tags.items() if code != JPEG_TABLES}

    def one(code: int, default: int | None = None) -> int:
        values = numbers.get(code, () if default is None else (default,))
        if len(values) != 1:
            raise damaged(path, f"its tag {NAMES[code]} has {len(values)} values, and 1 is needed")
        return values[0]

    def same(code: int, default: int | None = None) -> int:
        """Return the value of every sample; some writers list more than there are."""
        values = set(numbers.get(code, () if default is None else (default,))[:samples])
        if len(values) != 1:
            raise damaged(path, f"its tag {NAMES[code]} has {len(values)} different values, and 1 is needed")
        return values.pop()

    rows, columns, samples = one(LENGTH), one(WIDTH), one(SAMPLES, 1)
    if one(IMAGE_DEPTH, 1) != 1:
        raise ReadError(f"{path.name} has several slices in one page (ImageDepth); save it with a page for each slice")
    bits, compression, photometric = same(BITS, 1), one(COMPRESSION), one(PHOTOMETRIC)
    tiled = TILE_WIDTH in numbers or TILE_OFFSETS in numbers
    chunk = (one(TILE_LENGTH), one(TILE_WIDTH)) if tiled else (min(one(ROWS_PER_STRIP, rows), rows), columns)
    offsets = numbers.get(TILE_OFFSETS if tiled else STRIP_OFFSETS, ())
    byte_counts = numbers.get(TILE_BYTES if tiled else STRIP_BYTES, ())
    if virtual:
        offsets, byte_counts = tuple(page.dataoffsets), tuple(page.databytecounts)
    if min(rows, columns, samples, bits, *chunk) < 1:
        raise damaged(path, f"a page of {columns} x {rows} pixels with {samples} samples of {bits} bits")
    if tiled and (chunk[0] % TILE_STEP or chunk[1] % TILE_STEP):
        raise damaged(path, f"tiles of {chunk[1]} x {chunk[0]} pixels, which are no multiples of {TILE_STEP}")
    layout = PageLayout(
        (rows, columns),
        samples,
        _choice(path, one(PLANAR, 1), PLANAR, 2) == 2 and samples > 1,
        bits,
        _dtype(path, bits, same(SAMPLE_FORMAT, WHOLE)),
        tiff.byteorder,
        compression,
        one(PREDICTOR, 1),
        photometric,
        _choice(path, one(FILL_ORDER, 1), FILL_ORDER, 2) == 2,
        tiled,
        chunk,
        offsets,
        byte_counts,
        _colors(path, numbers, bits) if photometric == PALETTE else None,
        bytes(tags.get(JPEG_TABLES, ())),
    )
    _check_segments(tiff, layout, path)
    return layout


def check_tags(tiff: Any, page: Any, path: Path) -> None:
    """Refuse a page, even one that is not read, whose tags are damaged: it might belong to those that are."""
    if page.offset > 0:
        _tags(tiff, page.offset, path)


def damaged(path: Path, what: str) -> ReadError:
    """Return the error for a page that cannot be what it says."""
    return ReadError(f"{path.name} is truncated or damaged ({what}); copy it again")


def _choice(path: Path, value: int, code: int, most: int) -> int:
    if not 1 <= value <= most:
        raise damaged(path, f"its tag {NAMES[code]} is {value}")
    return value


def _dtype(path: Path, bits: int, sample_format: int) -> np.dtype[Any]:
    """The type that holds a sample; whole numbers without a sign may have any number of bits up to 16."""
    kind = FORMATS.get(sample_format, "")
    if kind == "u" and bits <= 16:
        return np.dtype("uint8" if bits <= 8 else "uint16")
    if not kind or bits not in SIZES[kind]:
        names = {"u": "whole numbers", "i": "whole numbers with a sign", "f": "floating point numbers"}
        what = names.get(kind, f"numbers of SampleFormat {sample_format}")
        raise ReadError(f"{path.name} has {what} of {bits} bits, which are not read; save it as 8, 16 or 32 bit gray")
    return np.dtype(f"{kind}{bits // 8}")


def _colors(path: Path, numbers: dict[int, tuple[int, ...]], bits: int) -> NDArray[np.uint8]:
    """The colors of a palette, as 8 bits; some writers store so many in place of 16."""
    values = numbers.get(COLOR_MAP, ())
    if bits > 16 or len(values) != 3 << bits:
        raise damaged(path, f"its palette has {len(values)} numbers, and {bits} bits need {3 << min(bits, 64)}")
    if max(values) > MOST_SHADE:
        raise damaged(path, f"its palette has the color {max(values)}, above {MOST_SHADE}")
    colors = np.array(values).reshape(3, -1)
    return (colors >> 8 if colors.max() > 255 else colors).astype(np.uint8)


def _check_segments(tiff: Any, layout: PageLayout, path: Path) -> None:
    """Refuse a page whose strips or tiles lie outside the file, or are missing: tifffile reads them as zeros."""
    size = tiff.filehandle.size
    count = math.prod(layout.grid) * layout.planes
    for lengths in (layout.offsets, layout.byte_counts):
        if len(lengths) != count:
            raise damaged(path, f"a page has {len(lengths)} of {count} strips or tiles")
    for start, length in zip(layout.offsets, layout.byte_counts, strict=True):
        if not length or start < HEADER or start + length > size:
            raise ReadError(
                f"{path.name} is truncated: {length} bytes of pixels at byte {start} of {size}; copy it again"
            )


def _tags(tiff: Any, offset: int, path: Path) -> dict[int, tuple[int, ...]]:
    """The tags of the page at a byte of the file that say how pixels are stored; refuses those that are damaged."""
    order, file = tiff.byteorder, tiff.filehandle
    # Of BigTIFF, numbers and offsets have 8 bytes: the entry's count, and the value or where it lies.
    count_letter, letter, value_bytes = ("Q", "Q", 8) if tiff.is_bigtiff else ("H", "I", 4)
    entry = struct.Struct(f"{order}HH{letter}{value_bytes}s")

    def read(at: int, length: int) -> bytes:
        if at + length > file.size:
            raise damaged(path, f"{length} bytes of tags at byte {at} of {file.size}")
        file.seek(at)
        return bytes(file.read(length))

    head = struct.Struct(order + count_letter)
    (count,) = head.unpack(read(offset, head.size))
    if count > MOST_TAGS:
        raise damaged(path, f"a page with {count} tags")
    tags: dict[int, tuple[int, ...]] = {}
    for code, kind, length, value in entry.iter_unpack(read(offset + head.size, count * entry.size)):
        if code not in NAMES:
            continue
        fitting = kind in (BYTE, UNDEFINED) if code == JPEG_TABLES else kind in LETTERS and kind != UNDEFINED
        if not fitting or code in tags or length > MOST_VALUES:
            what = "comes twice" if code in tags else f"is {length} values of type {kind}"
            raise damaged(path, f"its tag {NAMES[code]} {what}")
        numbers = struct.Struct(f"{order}{length}{LETTERS[kind]}")
        if numbers.size > value_bytes:
            value = read(struct.unpack(order + letter, value)[0], numbers.size)
        tags[code] = numbers.unpack(value[: numbers.size])
    return tags
