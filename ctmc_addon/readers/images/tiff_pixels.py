# SPDX-License-Identifier: GPL-3.0-or-later
"""The pixels of one page of a TIFF, strip by strip or tile by tile: TIFF 6.0 and its supplements.

tifffile unpacks what it can by itself and hands the rest to imagecodecs where that is installed, each in its own way.
So that values do not depend on it, what is common is unpacked here: no compression, Deflate, LZMA, PackBits, LZW, CCITT
Group 4 and JPEG, samples of 1 to 16 bits, both predictors. Pillow's libtiff turns one strip of LZW or Group 4 into
bytes and does nothing more; bits, signs and predictors are not left to it.
"""

from __future__ import annotations

import io
import lzma
import struct
import zlib
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ..optional_imports import needed, reason
from .pillow import PILLOW_ERRORS
from .tiff_tags import JPEG, UNCOMPRESSED, YCBCR, PageLayout, damaged

LZW, PACKBITS, LZMA, GROUP_4, DEFLATE = 5, 32773, 34925, 4, (8, 32946)  # values of Compression
UNPACKED_HERE = (UNCOMPRESSED, LZW, PACKBITS, LZMA, GROUP_4, *DEFLATE, JPEG)
NO_PREDICTOR, DIFFERENCES, OF_FLOATS = 1, 2, 3  # values of Predictor
MOST_PADDING = 1 << 16  # bytes behind the pixels of a strip
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
END_OF_GROUP_4 = "000000000001" * 2
JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"


def page_pixels(tiff: Any, layout: PageLayout, path: Path, lock: Lock) -> NDArray[Any]:
    """Samples of a page as they are stored, unpacked.

    Parameters
    ----------
    tiff : tifffile.TiffFile
    layout : PageLayout
        Of a compression in `UNPACKED_HERE`.
    lock : Lock
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
    rows, columns = layout.shape
    (down, across), samples = layout.grid, layout.contiguous_samples
    pixels = np.empty((layout.planes, rows, columns, samples), layout.dtype)
    for number, (start, length) in enumerate(zip(layout.offsets, layout.byte_counts, strict=True)):
        with lock:
            tiff.filehandle.seek(start)
            content = bytes(tiff.filehandle.read(length))
        plane, y, x = np.unravel_index(number, (layout.planes, down, across))
        chunk = _chunk(content, layout, layout.rows_of(int(y)), path)
        target = pixels[plane, y * layout.chunk[0] :, x * layout.chunk[1] :][: layout.chunk[0], : layout.chunk[1]]
        target[...] = chunk[: target.shape[0], : target.shape[1]]
    if layout.separate:
        return np.moveaxis(pixels[..., 0], 0, -1)
    return pixels[0, ..., 0] if layout.samples == 1 else pixels[0]


def _chunk(content: bytes, layout: PageLayout, rows: int, path: Path) -> NDArray[Any]:
    """Samples (rows, columns, samples) of a strip or tile."""
    if layout.compression == JPEG:
        return _of_jpeg(content, layout, rows, path)
    shape = (rows, layout.chunk[1], layout.contiguous_samples)
    if layout.reversed_bits:
        content = content.translate(REVERSED)
    unpacked = _unpacked(content, layout, rows, path)
    if layout.predictor == OF_FLOATS:
        return _floats(unpacked, layout, shape, path)
    samples = _samples(unpacked, layout, rows).reshape(shape)
    if layout.predictor == DIFFERENCES:
        whole = samples.view(f"u{samples.dtype.itemsize}") if samples.dtype.kind != "u" else samples
        sums = np.cumsum(whole, axis=1, dtype=whole.dtype)  # round the type's end, as they were made
        if layout.bits < 8 * layout.dtype.itemsize:
            sums &= (1 << layout.bits) - 1
        return sums.view(layout.dtype)
    if layout.predictor != NO_PREDICTOR:
        raise ReadError(f"{path.name} has pixels of Predictor {layout.predictor}, which is not read; save it without")
    return samples


def _unpacked(content: bytes, layout: PageLayout, rows: int, path: Path) -> bytes:
    """The bytes of a strip or tile, rows one behind the other, each filled up to a whole byte."""
    size = rows * layout.row_bytes
    if layout.compression in (*DEFLATE, LZMA):
        unpacked = _of_stream(content, layout, size, path)
    elif layout.compression == PACKBITS:
        unpacked = _of_packbits(content)
    elif layout.compression in (LZW, GROUP_4):
        unpacked = _by_libtiff(content, layout, rows, path)
    else:
        unpacked = content
    if len(unpacked) < size:
        raise ReadError(f"{path.name} is truncated: {len(unpacked)} of {size} bytes of pixels; copy it again")
    full = layout.chunk[0] * layout.row_bytes  # some writers fill the last strip up
    packed_exactly = layout.compression != UNCOMPRESSED or layout.tiled
    if len(unpacked) >= 2 * full or (packed_exactly and len(unpacked) not in (size, size + 1, full)):
        raise damaged(path, f"a strip has {len(unpacked)} bytes of pixels, and {full} are needed")
    return unpacked[:size]


def _of_stream(content: bytes, layout: PageLayout, size: int, path: Path) -> bytes:
    """Deflate or LZMA, up to its check sum; never much more than the pixels, however much it would unpack to."""
    unpacker: Any = lzma.LZMADecompressor() if layout.compression == LZMA else zlib.decompressobj()
    try:
        unpacked = bytes(unpacker.decompress(content, size + MOST_PADDING))
        if len(unpacked) >= size + MOST_PADDING and not unpacker.eof:
            raise ReadError(f"{path.name} unpacks to far more than its size tells of; export it again")
    except (zlib.error, lzma.LZMAError) as error:
        raise damaged(path, reason(error)) from error
    if not unpacker.eof:
        raise damaged(path, "the end of a compressed strip is missing")
    return unpacked


def _of_packbits(content: bytes) -> bytes:
    """Unpack PackBits (TIFF 6.0, section 9)."""
    pieces, at = [], 0
    while at < len(content):
        head = content[at]
        if head < 128:
            piece = content[at + 1 : at + 2 + head]
            at += 2 + head
        elif head > 128:
            piece = content[at + 1 : at + 2] * (257 - head)
            at += 2
        else:
            piece = b""
            at += 1
        pieces.append(piece)
    return b"".join(pieces)


def _by_libtiff(content: bytes, layout: PageLayout, rows: int, path: Path) -> bytes:
    """LZW or CCITT Group 4 by libtiff in Pillow, as a TIFF of one strip of bytes, or of bits."""
    bits, columns = 8, layout.row_bytes
    if layout.compression == GROUP_4:
        if layout.bits * layout.contiguous_samples != 1:
            raise damaged(path, f"CCITT Group 4 with pixels of {layout.bits * layout.contiguous_samples} bits")
        bits, columns = 1, layout.chunk[1]
        if not "".join(f"{byte:08b}" for byte in content[-8:]).rstrip("0").endswith(END_OF_GROUP_4):
            raise damaged(path, "the end of a compressed strip is missing")
    entries = {256: columns, 257: rows, 258: bits, 259: layout.compression, 262: 1, 273: 8, 277: 1}
    entries |= {278: rows, 279: len(content)}
    padded = content + bytes(len(content) % 2)
    file = struct.pack("<2sHI", b"II", 42, 8 + len(padded)) + padded + struct.pack("<H", len(entries))
    file += b"".join(struct.pack("<HHII", code, 4, 1, value) for code, value in entries.items()) + bytes(4)
    pillow = needed("PIL.Image", "Pillow", "compressed TIFF")
    try:
        with pillow.open(io.BytesIO(file)) as image:
            pixels = np.asarray(image)
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise damaged(path, f"a compressed strip: {reason(error)}") from error
    return (np.packbits(pixels, axis=1) if bits == 1 else pixels).tobytes()


def _of_jpeg(content: bytes, layout: PageLayout, rows: int, path: Path) -> NDArray[Any]:
    """One JPEG of a strip or tile, with the page's tables: TIFF Technical Note 2."""
    samples = layout.contiguous_samples
    if layout.bits != 8 or layout.dtype != np.uint8 or samples not in (1, 3):
        raise ReadError(
            f"{path.name} is compressed as JPEG with {samples} samples of {layout.bits} bits, which are not read; "
            "save it uncompressed or with Deflate"
        )
    tables = layout.jpeg_tables.removeprefix(JPEG_START).removesuffix(JPEG_END)
    if not content.startswith(JPEG_START) or not content.rstrip(b"\0").endswith(JPEG_END):
        raise damaged(path, "the end of a JPEG strip is missing")
    # The photometric interpretation says what the samples are; Pillow asks a segment of Adobe's.
    adobe = b"\xff\xee\x00\x0eAdobe\x00\x64\x00\x00\x00\x00" + bytes([layout.photometric == YCBCR])
    pillow = needed("PIL.Image", "Pillow", "compressed TIFF")
    try:
        with pillow.open(io.BytesIO(JPEG_START + tables + adobe * (samples == 3) + content[2:])) as image:
            mode, pixels = image.mode, np.asarray(image)
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise damaged(path, f"a JPEG strip: {reason(error)}") from error
    whole = pixels.reshape(*pixels.shape[:2], -1)
    if mode not in ("L", "RGB") or whole.shape[2] != samples or whole.shape[1] != layout.chunk[1]:
        raise damaged(path, f"a JPEG strip of {whole.shape[1]} x {whole.shape[0]} pixels of Pillow's type '{mode}'")
    if not rows <= whole.shape[0] <= layout.chunk[0]:
        raise damaged(path, f"a JPEG strip of {whole.shape[0]} rows, and {rows} are needed")
    return whole


def _samples(unpacked: bytes, layout: PageLayout, rows: int) -> NDArray[Any]:
    """Samples of rows of bytes: (rows, samples in a row)."""
    count = layout.chunk[1] * layout.contiguous_samples
    if layout.bits == 8 * layout.dtype.itemsize:
        stored = np.frombuffer(unpacked, layout.dtype.newbyteorder(layout.order))
        return stored.astype(layout.dtype, copy=False).reshape(rows, count)
    packed = np.frombuffer(unpacked, np.uint8).reshape(rows, -1)
    bits = np.unpackbits(packed, axis=1)[:, : count * layout.bits].reshape(rows, count, layout.bits)
    values = np.zeros((rows, count), layout.dtype)
    for number in range(layout.bits):  # the highest bit comes first
        values = values << 1 | bits[..., number]
    return values.astype(layout.dtype, copy=False)


def _floats(unpacked: bytes, layout: PageLayout, shape: tuple[int, int, int], path: Path) -> NDArray[Any]:
    """Floating point numbers of Predictor 3: differences of bytes, the highest bytes of a row first."""
    rows, columns, samples = shape
    if layout.dtype.kind != "f":
        raise damaged(path, f"Predictor 3 of {layout.dtype}")
    differences = np.frombuffer(unpacked, np.uint8).reshape(rows, -1, samples)
    sums = np.cumsum(differences, axis=1, dtype=np.uint8).reshape(rows, layout.dtype.itemsize, columns * samples)
    highest_first = np.ascontiguousarray(np.moveaxis(sums, 1, -1)).view(layout.dtype.newbyteorder(">"))
    return highest_first.astype(layout.dtype).reshape(shape)
