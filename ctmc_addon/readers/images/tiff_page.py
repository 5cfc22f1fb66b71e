# SPDX-License-Identifier: GPL-3.0-or-later
"""Read one page of a TIFF with tifffile; whatever tifffile raises or logs meanwhile becomes a `ReadError`.

Pillow's libtiff reads whole pages that tifffile leaves to imagecodecs: LZW, samples of 2, 4 and 12 bits and Predictor 3
where that package is missing, and JPEG and CCITT Group 4 always, so that no value depends on it.
"""

from __future__ import annotations

import io
import logging
import lzma
import math
import re
import struct
import sys
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from threading import get_ident
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ..optional_imports import needed, reason
from ..streams.packed_size import HARMLESS, bytes_to_look_at, unpacks_beyond

# tifffile was seen to raise these on damaged files, beside its own error. They are caught around its calls alone.
DAMAGE = (
    *(OSError, ValueError, EOFError, LookupError, TypeError, RuntimeError, AttributeError, ArithmeticError),
    *(AssertionError, struct.error, zlib.error, lzma.LZMAError),
)
PILLOW_ERRORS = (*DAMAGE, SyntaxError)  # Pillow raises these, beside its bomb error.
REQUIRED = {256: "ImageWidth", 257: "ImageLength", 259: "Compression", 262: "PhotometricInterpretation"}
ORIENTATION, COLOR_MAP = 274, 320  # Codes of tags.
SINGLE_TAGS = {*REQUIRED, 266, 277, 278, 284, 317, 322, 323, 32997}  # Each of them has one value.
LAYOUT_TAGS = {*SINGLE_TAGS, 258, 273, 279, 324, 325, 339}
# What is wrong with any other tag does not matter: TIFF 6.0 has readers pass over fields they do not know.
READ_TAGS = {*LAYOUT_TAGS, 254, 255, 270, 282, 283, 320, 338, 50838, 50839}
WHOLE_TYPES = (1, 3, 4, 16)  # BYTE, SHORT, LONG and LONG8; libtiff passes over layout tags of other types.
HEADER = 8  # No pixels are in these bytes at the start; tifffile takes the offset 0 for a strip of zeros.
TILE_STEP = 16  # The sides of tiles are multiples of it.
MOST_SHADE = (1 << 16) - 1  # A color of a palette has 16 bits.
WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE, MASK, YCBCR = 0, 1, 2, 3, 4, 6  # Values of PhotometricInterpretation.
KINDS = {1: "u", 2: "i", 3: "f", 4: "u"}  # Values of SampleFormat; 4 is "undefined", as libtiff has it.
SIZES = {"u": (8, 16, 32, 64), "i": (8, 16, 32, 64), "f": (32, 64)}
UNCOMPRESSED, GROUP_4, JPEG = 1, 4, 7  # Values of Compression.
WITHOUT_END = (2, 3)  # Nobody could tell where pixels of CCITT run lengths and of Group 3 end.
STREAMS = {8: "zlib", 32946: "zlib", 50013: "zlib", 34925: "lzma", 50000: "zstd"}
BY_PILLOW = (GROUP_4, JPEG)  # Pillow unpacks these, because imagecodecs may round JPEG differently.
EXACT_MODES = {  # Pillow's types whose values are those stored, by the bits of a sample.
    1: ("1", "P"), 2: ("L", "P"), 4: ("L", "P"), 8: ("L", "P", "LA", "RGB", "RGBA"), 12: ("I;16",),
    16: ("I;16", "I;16B", "I"), 32: ("I", "F"),
}  # fmt: skip
NATIVE = "<" if sys.byteorder == "little" else ">"
NO_PREDICTOR, DIFFERENCES, OF_FLOATS = 1, 2, 3  # Values of Predictor.
END_OF_GROUP_4, END_OF_JPEG = "000000000001" * 2, b"\xff\xd9"


class PageLayout(NamedTuple):
    """The layout of the stored pixels of a page."""

    shape: tuple[int, int]  # (rows, columns)
    samples: int  # Number of samples of a pixel.
    separate: bool  # True if each sample has its own plane.
    bits: int  # Bits of a sample.
    dtype: np.dtype[Any]  # Type of the values, in the machine's byte order.
    compression: int
    predictor: int
    photometric: int
    colors: NDArray[np.uint8] | None  # (3, 2 ** bits), the palette's.

    @property
    def kind(self) -> str:
        """Return the numbers of a pixel, for a sentence."""
        kind = f"{self.samples} samples of {self.bits} bits" if self.samples > 1 else f"{self.bits} bits"
        palette = " and a palette" if self.colors is not None else ""
        return f"{kind} ({self.dtype}){palette}"

    @property
    def depth(self) -> str:
        """Return the properties that all pages of a stack share, for a sentence."""
        packed = "" if self.compression == UNCOMPRESSED else f" in Compression {self.compression}"
        return f"{self.shape[1]} x {self.shape[0]} pixels of {self.kind}{packed}"


class _Complaints(logging.Handler):
    """Collect the messages that tifffile logs in this thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.thread, self.lines = get_ident(), list[str]()

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the sentence, unless it is of a tag that is not read, without the object that it begins with."""
        text = record.getMessage()
        tag = re.search(r"TiffTag (\d+) @", text)
        if record.thread == self.thread and (tag is None or int(tag[1]) in READ_TAGS):
            self.lines.append(re.sub(r"^<.*?> (?=\S)", "", text))


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what tifffile raises or logs while it reads a file into a `ReadError`."""
    tifffile = needed("tifffile", "tifffile", "TIFF")
    complaints, logger = _Complaints(), logging.getLogger("tifffile")
    logger.disabled = False  # The host's configuration of logging may have switched it off.
    logger.setLevel(min(logger.level, logging.WARNING))
    logger.addHandler(complaints)
    try:
        yield
    except (*DAMAGE, tifffile.TiffFileError) as error:
        raise damaged(path, reason(error)) from error
    finally:
        logger.removeHandler(complaints)
    if complaints.lines:
        raise damaged(path, reason(ValueError(complaints.lines[0])))


def damaged(path: Path, what: str) -> ReadError:
    """Return the error for a file that contradicts itself."""
    return ReadError(f"{path.name} is truncated or damaged ({what}); copy it again")


def own_page(page: Any) -> Any:
    """Return a page with tags of its own: tifffile takes the first page's for those of later ones."""
    return page if page.offset <= 0 else page.aspage()


def page_layout(page: Any, path: Path) -> PageLayout:
    """Return the layout of a page as its tags describe it.

    Parameters
    ----------
    page : tifffile.TiffPage or tifffile.TiffFrame
        Of `own_page`.
    path : Path
        For errors.

    Raises
    ------
    ReadError
        Where a tag is missing, damaged, or says what is not read.
    """
    with reading(path):
        key = page.keyframe
        missing = [name for code, name in REQUIRED.items() if code not in key.tags]
        numbers = [key.imagelength, key.imagewidth, key.samplesperpixel, key.bitspersample, key.imagedepth]
        numbers += [key.compression, key.predictor, key.photometric, key.planarconfig, key.sampleformat]
        # libtiff reads zeros where such a tag is wrong, without a word.
        layout_tags = [tag for tag in key.tags if tag.code in LAYOUT_TAGS]
        wrong = [tag.name for tag in layout_tags if int(tag.dtype) not in WHOLE_TYPES]
        wrong += [tag.name for tag in key.tags if tag.code in SINGLE_TAGS and not _is_small_number(tag)]
        # Of a tag that is there twice, a page of tifffile takes the first and a frame the last.
        wrong += [name for name, times in Counter(tag.name for tag in layout_tags).items() if times > 1]
        whole = all(isinstance(number, int) for number in numbers)
        palette = key.tags.valueof(COLOR_MAP, ())
        segments = math.prod(page.chunked)
        places = list(zip(page.dataoffsets, page.databytecounts, strict=True))
        tile = (key.tilewidth, key.tilelength) if key.is_tiled else (TILE_STEP, TILE_STEP)
        row_bytes = -(-key.imagewidth * key.samplesperpixel * key.bitspersample // 8)
        is_short = key.compression == UNCOMPRESSED and sum(page.databytecounts) < key.imagelength * row_bytes
    if missing or wrong or not whole:
        what = f"its tag {missing[0]} is missing" if missing else "its samples differ in their bits or kind"
        raise damaged(path, f"its tag {wrong[0]} has a wrong type, count or size" if wrong else what)
    rows, columns, samples, bits, depth, compression, predictor, photometric, planes, sample_format = map(int, numbers)
    if depth != 1:
        raise ReadError(f"{path.name} has several slices in one page (ImageDepth); save it with a page for each slice")
    if min(rows, columns, samples, bits) < 1 or planes not in (1, 2):
        raise damaged(path, f"a page of {columns} x {rows} pixels with {samples} samples of {bits} bits")
    dtype = _dtype(path, bits, sample_format)
    colors = _colors(path, palette, bits) if photometric == PALETTE else None
    if tile[0] % TILE_STEP or tile[1] % TILE_STEP:
        raise damaged(path, f"tiles of {tile[0]} x {tile[1]} pixels, which are not multiples of {TILE_STEP}")
    if is_short:
        raise ReadError(f"{path.name} is truncated: it has fewer bytes than {columns} x {rows} pixels; copy it again")
    _check_segments(places, segments, page.parent.filehandle.size, path)
    separate = planes == 2 and samples > 1
    return PageLayout((rows, columns), samples, separate, bits, dtype, compression, predictor, photometric, colors)


def _is_small_number(tag: Any) -> bool:
    """Return whether a tag of a page has one value that a whole number of 32 bits holds."""
    return bool(tag.count == 1 and 0 <= int(tag.value) < 1 << 32)


def page_pixels(
    tiff: Any, page: Any, layout: PageLayout, path: Path, lock: AbstractContextManager[Any]
) -> NDArray[Any]:
    """Return the stored samples of a page, unpacked.

    Parameters
    ----------
    tiff : tifffile.TiffFile
    page : tifffile.TiffPage or tifffile.TiffFrame
        Of `own_page`.
    layout : PageLayout
    path : Path
    lock : RLock
        Held while the file is read; other pages may be unpacked meanwhile.

    Returns
    -------
    (rows, columns) or (rows, columns, samples) of `layout.dtype`
        JPEG in YCbCr comes as RGB.

    Raises
    ------
    ReadError
        Where the page is damaged, or stored in a way that is not read.
    """
    name = getattr(page.keyframe.compression, "name", str(layout.compression))
    if layout.compression in WITHOUT_END:
        raise ReadError(
            f"{path.name} is compressed as {name}, which is not read, because its pixels have no end mark; "
            "save it uncompressed or with Deflate"
        )
    how = "" if layout.compression == UNCOMPRESSED else f" compressed as {name}"
    plain = layout.compression == UNCOMPRESSED or layout.bits != 8 * layout.dtype.itemsize
    if layout.predictor not in (NO_PREDICTOR, DIFFERENCES, OF_FLOATS) or (plain and layout.predictor != NO_PREDICTOR):
        raise ReadError(
            f"{path.name} has pixels of {layout.bits} bits{how} with Predictor {layout.predictor}, which are not read; "
            "save it without a predictor"
        )
    _check_ends(page, layout, path, lock)
    pixels = None
    if layout.compression not in BY_PILLOW:
        try:
            pixels = np.asarray(page.asarray(maxworkers=1, lock=lock))
        except (*DAMAGE, ImportError, needed("tifffile", "tifffile", "TIFF").TiffFileError) as error:
            # ImportError is that of Zstandard, before Python 3.14; KeyError is that of Predictor 3.
            if "imagecodecs" not in str(error) and not isinstance(error, ImportError | KeyError):
                raise damaged(path, reason(error)) from error
    if pixels is None:
        pixels = _by_pillow(tiff, page, layout, path)
    if pixels is None:
        verb = "are not read" if layout.compression in BY_PILLOW else "need the Python package imagecodecs"
        raise ReadError(
            f"{path.name} has pixels of {layout.kind}{how}, which {verb}; save it as 8 or 16 bit gray, uncompressed or "
            "with Deflate"
        )
    if pixels.ndim == 3 and layout.separate:
        pixels = np.moveaxis(pixels, 0, -1)
    if pixels.shape[:2] != layout.shape:
        raise damaged(path, f"a page of {pixels.shape} {pixels.dtype}")
    return pixels.astype(layout.dtype, copy=False)


def _dtype(path: Path, bits: int, sample_format: int) -> np.dtype[Any]:
    """Return the type that holds a sample; unsigned whole numbers may have any number of bits up to 16."""
    kind = KINDS.get(sample_format, "")
    if kind == "u" and bits <= 16:
        return np.dtype("uint8" if bits <= 8 else "uint16")
    if not kind or bits not in SIZES[kind]:
        names = {"u": "whole numbers", "i": "whole numbers with a sign", "f": "floating point numbers"}
        what = names.get(kind, f"numbers of SampleFormat {sample_format}")
        raise ReadError(f"{path.name} has {what} of {bits} bits, which are not read; save it as 8, 16 or 32 bit gray")
    return np.dtype(f"{kind}{bits // 8}")


def _colors(path: Path, palette: Any, bits: int) -> NDArray[np.uint8]:
    """Return the colors of a palette as 8 bits; some writers store 8 bits instead of 16."""
    values = np.ravel(palette)
    if bits > 16 or len(values) != 3 << bits or values.dtype.kind not in "iu":
        raise damaged(path, f"its palette has {len(values)} numbers, and {bits} bits need {3 << min(bits, 64)}")
    if values.max() > MOST_SHADE:
        raise damaged(path, f"its palette has the color {values.max()}, above {MOST_SHADE}")
    colors = values.astype(np.uint16).reshape(3, -1)
    return (colors >> 8 if colors.max() > 255 else colors).astype(np.uint8)


def _check_segments(places: list[tuple[int, int]], count: int, size: int, path: Path) -> None:
    """Refuse a page whose strips or tiles lie outside the file, or are missing: tifffile reads them as zeros."""
    if len(places) != count:
        raise damaged(path, f"a page has {len(places)} of {count} strips or tiles")
    for start, length in places:
        if not length or start < HEADER or start + length > size:
            raise ReadError(
                f"{path.name} is truncated: {length} bytes of pixels at byte {start} of {size}; copy it again"
            )


def _check_ends(page: Any, layout: PageLayout, path: Path, lock: AbstractContextManager[Any]) -> None:
    """Refuse strips that unpack to far more than the page, and those without an end that libtiff would make up."""
    codec = STREAMS.get(layout.compression, "")
    most = HARMLESS + math.prod(layout.shape) * layout.samples * layout.dtype.itemsize
    file = page.parent.filehandle
    for start, length in zip(page.dataoffsets, page.databytecounts, strict=True):
        count = bytes_to_look_at(length, codec, most) if codec else length * (layout.compression in BY_PILLOW)
        if not count:
            continue
        with lock:
            file.seek(start)
            content = bytes(file.read(count))
        if codec and unpacks_beyond(content, codec, most):
            raise ReadError(f"{path.name} unpacks to far more bytes than its size allows; export it again")
        bits = "".join(f"{byte:08b}" for byte in content[-8:]).rstrip("0")
        if (layout.compression == GROUP_4 and not bits.endswith(END_OF_GROUP_4)) or (
            layout.compression == JPEG and not content.rstrip(b"\0").endswith(END_OF_JPEG)
        ):
            raise damaged(path, "the end of a compressed strip is missing")


class _FromPage(io.RawIOBase):
    """A TIFF whose header leads to one of its pages, so that this is the first one that Pillow finds."""

    def __init__(self, file: IO[bytes], header: bytes) -> None:
        self.file, self.header = file, header

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self.file.fileno()

    def tell(self) -> int:
        return self.file.tell()

    def seek(self, offset: int, whence: int = 0) -> int:
        return self.file.seek(offset, whence)

    def readinto(self, target: Any) -> int:
        at = self.file.tell()
        count = self.file.readinto(target)  # type: ignore[attr-defined]
        head = self.header[at : at + count]
        memoryview(target).cast("B")[: len(head)] = head
        return int(count)


def _by_pillow(tiff: Any, page: Any, layout: PageLayout, path: Path) -> NDArray[Any] | None:
    """Read the stored samples of a page with Pillow; None if it cannot or would change them."""
    extra = [int(sample) for sample in page.keyframe.extrasamples or ()]
    turned = page.keyframe.tags.valueof(ORIENTATION, 1) != 1
    if page.offset <= 0 or turned or 1 in extra or (layout.samples > 1 and layout.bits != 8):
        return None  # Pillow turns pictures by their orientation, and divides colors by their opacity.
    order = tiff.byteorder
    number = struct.pack(
        f"{order}HHHQ" if tiff.is_bigtiff else f"{order}HI",
        *((43, 8, 0, page.offset) if tiff.is_bigtiff else (42, page.offset)),
    )
    pillow = needed("PIL.Image", "Pillow", "compressed TIFF")
    try:
        with path.open("rb") as file:
            whole = _FromPage(file, (b"II" if order == "<" else b"MM") + number)
            try:
                image = pillow.open(whole, formats=("TIFF",))
            except PILLOW_ERRORS:
                return None
            with image:
                # Pillow turns the bytes of such numbers round that libtiff has already turned.
                swapped = image.mode in ("I", "F") and order != NATIVE
                exact = image.mode in EXACT_MODES.get(layout.bits, ()) and not swapped
                if not exact or len(image.getbands()) != layout.samples:
                    return None
                mode, pixels = image.mode, np.asarray(image)
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise damaged(path, f"compressed pixels: {reason(error)}") from error
    if layout.bits in (2, 4) and mode == "L":  # Pillow spreads them over 8 bits.
        pixels = pixels // np.uint8(255 // ((1 << layout.bits) - 1))
    if layout.photometric == WHITE_IS_ZERO and mode in ("1", "L"):  # Pillow has turned them round.
        pixels = (1 << layout.bits) - 1 - pixels.astype(np.int16)
    return np.moveaxis(pixels, -1, 0) if layout.separate else pixels
