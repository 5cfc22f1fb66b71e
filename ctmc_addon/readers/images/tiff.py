# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF by tifffile, and by Pillow where a compression asks for a library that is not there."""

from __future__ import annotations

import lzma
import math
import struct
import zlib
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ...core import NO_THREAD, PAUSE, ReadError, Steps
from ...core.volume import SliceReader
from ..optional_imports import needed, reason
from ..result import RawValues, ReadOptions, Series, VolumeSource
from ..stored_slices import RawSlices, TimeSlices
from .decoded import DecodedSlices
from .pillow import DECODE_AS, JPEG_NOISE, PILLOW_ERRORS, Picture, gray
from .tiff_axes import Pages, pages_of_axes, spacing_of_tiff

# What tifffile was seen to raise on damaged tags, beside its own error; around calls of tifffile alone.
TIFF_ERRORS = (OSError, ValueError, EOFError, struct.error, zlib.error, LookupError, TypeError, RuntimeError)
DAMAGE = (*TIFF_ERRORS, ArithmeticError, AssertionError, lzma.LZMAError)
DEFLATE, LZMA = (8, 32946), 34925  # values of Compression
MOST_PADDING = 1 << 16  # bytes behind the pixels of a strip
OF_SEVERAL_FILES = ("mmstack", "ndtiff")
HARMLESS = 1 << 27  # bytes that any machine can unpack


class PageStack(NamedTuple):
    """The pages of a TIFF that make one volume."""

    shape: tuple[int, int, int]  # (slices, rows, columns)
    dtype: np.dtype[Any]  # in the file's byte order
    pages: list[Any]  # tifffile's, one for each slice; empty where the values lie in one piece
    start: int | None  # first byte of values that lie in one piece, all times and channels
    total: int  # pages of it
    layout: Pages
    notes: tuple[str, ...]


class TiffStack(VolumeSource):
    """One TIFF of several pages."""

    format = "TIFF"
    has_geometry = False

    def __init__(self, path: Path, stack: PageStack) -> None:
        slices, rows, columns = stack.shape
        series = Series(1, "", slices, (columns, rows), "", stack.dtype.name, stack.layout.times)
        super().__init__(path, (series,), [path])

    def read_raw_steps(self, options: ReadOptions) -> Steps[RawValues]:
        """Read page by page; values in one piece row by row."""
        yield PAUSE
        tiff = open_tiff(self.path)
        with ExitStack() as on_error:
            on_error.callback(tiff.close)
            stack = page_stack(tiff, self.path)
            spacing, notes = spacing_of_tiff(tiff)
            on_error.pop_all()
        notes = (*stack.notes, *notes)
        slices, layout = stack.shape[0], stack.layout
        first = layout.first(options.time)
        if stack.start is not None:
            tiff.close()
            plain: SliceReader = RawSlices(self.path, stack.start, (stack.total, *stack.shape[1:]), stack.dtype)
            if stack.total != slices:
                plain = TimeSlices(plain, first, slices, layout.step)
            return RawValues(plain, None, notes, spacing=spacing)

        def decode(number: int) -> NDArray[Any]:
            page = stack.pages[first + number * layout.step]
            if page is None:
                raise ReadError(f"page {number + 1} of {self.path.name} is missing; save it again")
            pixels = page_slice(tiff, page, self.path, page.index)
            if pixels.shape != stack.shape[1:]:
                size = f"{pixels.shape}, and the first is {stack.shape[1:]}"
                raise ReadError(f"page {number + 1} of {self.path.name} is {size}; save it again")
            return pixels

        reader = DecodedSlices(decode, stack.shape, stack.dtype.newbyteorder("="))
        finalize(reader, tiff.close)
        return RawValues(reader, None, notes, spacing=spacing)


def opened_stack(path: Path) -> TiffStack | None:
    """The volume in a TIFF of several pages; None where it has one: a single page is a slice of its folder."""
    with open_tiff(path) as tiff:
        return TiffStack(path, page_stack(tiff, path)) if pages_of(tiff) > 1 else None


def page_count(path: Path) -> int:
    """Number of pages of a TIFF."""
    with open_tiff(path) as tiff:
        return pages_of(tiff)


def pages_of(tiff: Any) -> int:
    """Number of pages; ImageJ writes one page header for a large stack."""
    return max(len(tiff.pages), stack_sides(tiff.series[0]))


def open_tiff(path: Path) -> Any:
    """The TIFF, opened by tifffile; a `ReadError` if its pages cannot all be found."""
    tifffile = needed("tifffile", "tifffile", "TIFF")
    tiff: Any = None
    damage = ""
    try:
        tiff = tifffile.TiffFile(path, **alone(tifffile))
        damage = chain_damage(tiff)
        tiff.pages[0], tiff.series[0]  # found when asked for
    except (*DAMAGE, tifffile.TiffFileError) as error:
        if tiff is not None:
            tiff.close()
        raise ReadError(f"{path.name} is not a readable TIFF ({reason(error)}); copy it again") from error
    if damage:
        tiff.close()
        raise ReadError(f"{path.name} is truncated or damaged ({damage}); copy it again")
    return tiff


def alone(tifffile: Any) -> dict[str, bool]:
    """Options that keep tifffile from opening the other files that a TIFF names, wherever they lie."""
    kinds = (kind for kind in OF_SEVERAL_FILES if kind in tifffile.TIFF.FILE_FLAGS)
    return {"_multifile": False, **{f"is_{kind}": False for kind in kinds}}


def chain_damage(tiff: Any) -> str:
    """What is wrong with the chain of pages, which tifffile only logs: it must end with the offset 0."""
    count = len(tiff.pages)
    tiff.filehandle.seek(tiff.pages.next_page_offset)
    following = tiff.filehandle.read(tiff.tiff.offsetsize)
    if len(following) < tiff.tiff.offsetsize or any(following):
        return f"its chain of pages breaks off after {count}"
    stored = sum(int(np.prod(entry["shape"])) for entry in tiff.shaped_metadata or () if "shape" in entry)
    if tiff.is_shaped and stored > sum(series.size for series in tiff.series):
        return f"its {count} pages are fewer than it says"
    return ""


def tiff_picture(path: Path) -> Picture:
    """What the header says of the first page, and how many pages there are."""
    with open_tiff(path) as tiff:
        page = tiff.pages[0]
        dtype = np.dtype("uint8") if page.dtype is None or page.dtype == bool else page.dtype
        if is_palette(page):
            dtype = np.dtype("uint8")
        return Picture(path, page.imagelength, page.imagewidth, dtype.newbyteorder("="), pages_of(tiff), "")


def tiff_slice(path: Path) -> NDArray[Any]:
    """Gray values (rows, columns) of a TIFF of one page."""
    with open_tiff(path) as tiff:
        return page_slice(tiff, tiff.pages[0], path, 0)


def stack_sides(series: Any) -> int:
    """Number of pages of a series."""
    return math.prod(int(side) for axis, side in zip(series.axes, series.shape, strict=True) if axis not in "SYX")


def page_stack(tiff: Any, path: Path) -> PageStack:
    """The first series of pages, or all pages where each is a series of its own."""
    first, every = tiff.series[0], list(tiff.series)
    keyframe = first.keyframe
    size = (int(keyframe.imagelength), int(keyframe.imagewidth))
    is_byte = first.dtype == bool or is_palette(keyframe)
    dtype = np.dtype("uint8") if is_byte else first.dtype.newbyteorder(tiff.byteorder)
    count = stack_sides(first)
    if count == 1 and len(every) > 1:
        if len({(series.shape, str(series.dtype)) for series in every}) > 1:
            text = ", ".join(sorted({" x ".join(map(str, series.shape)) for series in every})[:3])
            raise ReadError(f"{path.name} has pages of different sizes or types ({text}); save pages of one size")
        pages = [page for series in every for page in series.pages]
        return PageStack((len(pages), *size), dtype, pages, None, len(pages), Pages(len(pages), 1, 1, 0), ())
    layout = pages_of_axes(first.axes, first.shape, path)
    shape = (layout.slices, *size)
    notes = (f"{len(every) - 1} further series of pages in the TIFF left out",) if len(every) > 1 else ()
    plain = keyframe.samplesperpixel == 1 and code_of(keyframe.photometric) == 1 and first.dtype != bool
    notes = (*notes, *layout.notes)
    if first.dataoffset is not None and plain:
        return PageStack(shape, dtype, [], int(first.dataoffset), count, layout, notes)
    if code_of(keyframe.imagedepth) > 1:
        raise ReadError(f"{path.name} has several slices in one page (ImageDepth); save it with a page for each slice")
    if len(first.pages) < count:
        raise ReadError(f"{path.name} has {len(first.pages)} of {count} pages; copy it again")
    return PageStack(shape, dtype, [first.pages[number] for number in range(count)], None, count, layout, notes)


def code_of(value: Any) -> int:
    """The number in a tag that holds one; -1 where a damaged file has something else."""
    return int(value) if isinstance(value, int) else -1


def is_palette(page: Any) -> bool:
    """Whether the page's pixels are numbers of colors."""
    return code_of(page.photometric) == 3


def page_slice(tiff: Any, page: Any, path: Path, number: int) -> NDArray[Any]:
    """Gray values (rows, columns) of a page of an open TIFF, number `number` of `path`."""
    keyframe = page.keyframe  # of a series, only the first page knows all of this
    try:
        check_segments(tiff, page, path)
        check_unpacked(tiff, page, path)
        pixels = np.asarray(unpacked(page))
    except (*DAMAGE, ImportError, needed("tifffile", "tifffile", "TIFF").TiffFileError) as error:
        if "imagecodecs" not in str(error) and not isinstance(error, ImportError):  # of Zstandard, before Python 3.14
            raise ReadError(f"{path.name} is truncated or damaged ({reason(error)}); copy it again") from error
        pixels = _by_pillow(path, number, keyframe)
    else:
        if pixels.ndim == 3 and code_of(keyframe.planarconfig) == 2:
            pixels = np.moveaxis(pixels, 0, -1)  # color planes one behind the other
        if code_of(keyframe.photometric) == 0 and pixels.dtype.kind in "bu":  # white is zero
            pixels = ~pixels
        if is_palette(keyframe):  # 16 bits for each color, of which 8 are more than a screen shows
            pixels = np.moveaxis(np.asarray(keyframe.colormap >> 8, np.uint8)[:, pixels], 0, -1)
    if pixels.dtype == bool:
        pixels = pixels.astype(np.uint8) * np.uint8(255)
    return gray(pixels, path.name, JPEG_NOISE if "JPEG" in str(keyframe.compression) else 0)


def unpacked(page: Any) -> NDArray[Any]:
    """The pixels of a page: by tifffile's threads, or by this one where there is no memory for another."""
    try:
        return page.asarray()
    except RuntimeError as error:
        if str(error) != NO_THREAD:
            raise
    return page.asarray(maxworkers=1)


def check_segments(tiff: Any, page: Any, path: Path) -> None:
    """Refuse a page whose strips or tiles lie outside the file, or are missing: tifffile reads them as zeros."""
    size = tiff.filehandle.size
    for start, length in zip(page.dataoffsets, page.databytecounts, strict=True):
        if not length or start + length > size:
            raise ReadError(
                f"{path.name} is truncated: {length} bytes of pixels at byte {start} of {size}; copy it again"
            )
    keyframe = page.keyframe
    if code_of(keyframe.compression) != 1 or keyframe.dtype is None:
        return
    bits = min(code_of(keyframe.bitspersample), 8 * keyframe.dtype.itemsize)  # a pixel of black and white has one
    needed_bytes = keyframe.nbytes * bits // (8 * keyframe.dtype.itemsize)
    if sum(page.databytecounts) < needed_bytes:
        raise ReadError(
            f"{path.name} is truncated: {sum(page.databytecounts)} of {needed_bytes} bytes of pixels; copy it again"
        )


def check_unpacked(tiff: Any, page: Any, path: Path) -> None:
    """Refuse a page that unpacks to far more than its pixels: tifffile unpacks a strip or tile however long it gets."""
    keyframe = page.keyframe
    if keyframe.dtype is None:  # a damaged page, which cannot be decoded
        return
    most = int(np.prod(keyframe.chunks)) * keyframe.dtype.itemsize + MOST_PADDING
    code = code_of(keyframe.compression)
    for start, length in zip(page.dataoffsets, page.databytecounts, strict=True):
        # Deflate makes at most 1032 bytes of one.
        if code not in (*DEFLATE, LZMA) or (code in DEFLATE and 1032 * length <= max(most, HARMLESS)):
            continue
        tiff.filehandle.seek(start)
        content = tiff.filehandle.read(length)
        unpacker: Any = zlib.decompressobj() if code in DEFLATE else lzma.LZMADecompressor()
        if len(unpacker.decompress(content, most + 1)) > most:
            raise ReadError(f"{path.name} unpacks to far more than its size tells of; export it again")


def _by_pillow(path: Path, number: int, keyframe: Any) -> NDArray[Any]:
    pillow = needed("PIL.Image", "Pillow", "TIFF")
    try:
        with pillow.open(path) as image:
            image.seek(number)
            return np.asarray(image.convert(DECODE_AS.get(image.mode, image.mode)))
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        name = getattr(keyframe.compression, "name", str(keyframe.compression))
        raise ReadError(
            f"{path.name} is compressed as {name}, which needs the Python package imagecodecs; "
            "save it uncompressed or with Deflate"
        ) from error
