# SPDX-License-Identifier: GPL-3.0-or-later
"""Read frames of segmentations without pydicom: uncompressed, deflated, and masks of one bit in RLE.

DICOM PS3.5 8.1.1 (bits), A.4.13 (frames deflated each by itself), annex G (RLE).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...optional_imports import needed, reason
from ..header import ImageFile, pydicom_errors
from ..pixels.stored import RLE
from .elements import Damaged
from .label_file import inflated, opened

DEFLATED_FRAMES = "1.2.840.10008.1.2.8.1"
RLE_HEADER = 64  # These bytes hold the number of segments and the start of each.


def plain_frames(image: ImageFile) -> Iterator[NDArray[Any]] | None:
    """Yield the stored frames (rows, columns) in the file's order; None where pydicom has to decode them."""
    pixels = image.pixels
    if pixels.syntax == DEFLATED_FRAMES:
        return _read_frames(image, _deflated_frames)
    if pixels.syntax == RLE and pixels.options["bits_allocated"] == 1:
        return _read_frames(image, _rle_frames)
    return None if pixels.compressed else _read_frames(image, _native_frames)


def _read_frames(
    image: ImageFile, read: Callable[[IO[bytes], ImageFile], Iterator[NDArray[Any]]]
) -> Iterator[NDArray[Any]]:
    with opened(image.path) as (elements, _):
        elements.file.seek(image.pixels.start)
        yield from read(elements.file, image)


def _native_frames(file: IO[bytes], image: ImageFile) -> Iterator[NDArray[Any]]:
    """Yield uncompressed frames; those of one bit follow each other without a gap, the lowest bit first."""
    bits, size = image.pixels.options["bits_allocated"], image.rows * image.columns
    left = b""  # the byte in which the frame before ended
    for number in range(image.pixels.options["number_of_frames"]):
        start, stop = number * size * bits, (number + 1) * size * bits
        count = (stop + 7) // 8 - start // 8 - len(left)
        piece = left + file.read(count)
        left = piece[-1:] if stop % 8 else b""
        yield values_of(piece, bits, start % 8, image)


def _deflated_frames(file: IO[bytes], image: ImageFile) -> Iterator[NDArray[Any]]:
    """Yield frames that are deflated each by itself."""
    bits = image.pixels.options["bits_allocated"]
    needed_bytes = (image.rows * image.columns * bits + 7) // 8
    for packed in _encapsulated(file, image):
        yield values_of(inflated(packed, needed_bytes), bits, 0, image)


def _rle_frames(file: IO[bytes], image: ImageFile) -> Iterator[NDArray[Any]]:
    """Yield masks of one bit in RLE: a byte for each pixel, as in the standard, or for 8, as some write it."""
    size = image.rows * image.columns
    for packed in _encapsulated(file, image):
        piece = _unpacked_rle(packed, size)
        if len(piece) < size and len(piece) not in _packed_sizes(size):
            raise Damaged(f"{len(piece)} bytes of a frame of {image.columns} x {image.rows} pixels")
        yield values_of(piece, 8 if len(piece) >= size else 1, 0, image)


def _packed_sizes(size: int) -> tuple[int, int]:
    """Return the bytes of a frame of `size` pixels of one bit, without and with the byte that makes them even."""
    count = (size + 7) // 8
    return count, count + count % 2


def _unpacked_rle(packed: bytes, most: int) -> bytes:
    r"""Return the bytes of a frame that is one segment of runs; no more than `most` of them.

    Examples
    --------
    >>> _unpacked_rle(bytes([1, 0, 0, 0, 64]) + bytes(59) + bytes([254, 7, 1, 8, 9, 128]), 10)
    b'\x07\x07\x07\x08\t'
    """
    segments, start = (int.from_bytes(packed[at : at + 4], "little") for at in (0, 4))
    if (segments, start) != (1, RLE_HEADER):
        raise Damaged(f"a frame of one bit in {segments} segments, the first at byte {start}")
    out, at = bytearray(), start
    while at + 1 < len(packed) and len(out) < most:
        control = packed[at]
        if control < 128:  # as many bytes and one more follow as they are
            out += packed[at + 1 : at + 2 + control]
            at += 2 + control
        elif control > 128:  # the next byte, so many times
            out += packed[at + 1 : at + 2] * (257 - control)
            at += 2
        else:
            at += 1
    return bytes(out[:most])


def _encapsulated(file: IO[bytes], image: ImageFile) -> Iterator[bytes]:
    """Yield the compressed frames as stored."""
    count = image.pixels.options["number_of_frames"]
    frames = needed("pydicom.encaps", "pydicom", "DICOM").generate_frames(file, number_of_frames=count)
    for number in range(count):
        try:
            frame = next(frames, None)
        except pydicom_errors() as error:
            raise Damaged(reason(error)) from error
        if frame is None:
            raise Damaged(f"{number} of {count} frames")
        yield frame


def values_of(piece: bytes, bits: int, first_bit: int, image: ImageFile) -> NDArray[Any]:
    """Unpack the pixels of one frame.

    Parameters
    ----------
    piece : bytes
        Bytes in which the frame lies.
    bits : int
        Bits of a pixel: 1, 8 or 16.
    first_bit : int
        Where in the first byte the frame begins.
    image : ImageFile
        It knows rows and columns.

    Returns
    -------
    (rows, columns) uint8 or uint16
    """
    size = image.rows * image.columns
    if len(piece) * 8 < first_bit + size * bits:
        raise Damaged(f"{len(piece)} bytes of a frame of {image.columns} x {image.rows} pixels")
    if bits == 1:
        values = np.unpackbits(np.frombuffer(piece, np.uint8), bitorder="little")[first_bit : first_bit + size]
    else:
        values = np.frombuffer(piece, f"<u{bits // 8}", size)
    return values.reshape(image.rows, image.columns)
