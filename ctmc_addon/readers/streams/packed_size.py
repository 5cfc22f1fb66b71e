# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the unpacked length of packed bytes before unpacking: the codecs of Zarr and TIFF have no limit."""

from __future__ import annotations

import bz2
import lzma
import math
import zlib
from collections.abc import Callable
from typing import Any

HARMLESS = 1 << 27  # Any machine can unpack this many bytes.
LONGEST_HEAD = 16  # The first bytes of Blosc, LZ4 and Zstandard tell the length.
STREAMS: dict[str, Callable[[], Any]] = {
    "zlib": zlib.decompressobj,
    "gzip": lambda: zlib.decompressobj(zlib.MAX_WBITS | 16),
    "bz2": bz2.BZ2Decompressor,
    "lzma": lzma.LZMADecompressor,
}
MOST_RATIOS = {"zlib": 1032.0, "gzip": 1032.0}  # Deflate unpacks a byte to at most this many.


def bytes_to_look_at(length: int, codec: str, most: int) -> int:
    """Return how many first bytes of `length` bytes `unpacks_beyond` needs; 0 if they cannot unpack to more."""
    if codec in STREAMS:
        return length if length * MOST_RATIOS.get(codec, math.inf) > max(most, HARMLESS) else 0
    return LONGEST_HEAD


def unpacks_beyond(content: bytes, codec: str, most: int) -> bool:
    """Return whether packed bytes unpack to more than `most` bytes, and to more than is harmless.

    Of Zstandard and the others with a length in their first bytes it is this length, which is all that is unpacked.

    Parameters
    ----------
    content : bytes
        Of a chunk or strip: the first ones, as many as `bytes_to_look_at` says.
    codec : str
        Its name, as Zarr's metadata have it.
    most : int
        Bytes that there should be.
    """
    most = max(most, HARMLESS)
    if codec in STREAMS:
        return _streams_beyond(content, STREAMS[codec], most)
    if codec == "blosc":
        return int.from_bytes(content[4:8], "little") > most
    if codec == "lz4":
        return int.from_bytes(content[:4], "little") > most
    return codec == "zstd" and _zstandard_size(content[:LONGEST_HEAD]) > most


def _streams_beyond(content: bytes, start: Callable[[], Any], most: int) -> bool:
    """Return whether one or several consecutive streams unpack to more than `most` bytes; False for damaged ones."""
    done = 0
    while content and done <= most:
        stream = start()
        try:
            done += len(stream.decompress(content, most + 1 - done))
        except (zlib.error, lzma.LZMAError, OSError):
            return False
        content = stream.unused_data
    return done > most


def _zstandard_size(head: bytes) -> int:
    """Return the length in the header of the first Zstandard frame, RFC 8878 3.1.1.1; 0 without one.

    Examples
    --------
    >>> _zstandard_size(bytes.fromhex("28b52ffd a0 00000080 0000"))
    2147483648
    """
    if head[:4] != b"\x28\xb5\x2f\xfd" or len(head) < 5:
        return 0
    descriptor = head[4]
    is_single = bool(descriptor & 0x20)
    length = (1 if is_single else 0, 2, 4, 8)[descriptor >> 6]
    at = 5 + (0 if is_single else 1) + (0, 1, 2, 4)[descriptor & 3]
    size = int.from_bytes(head[at : at + length], "little")
    return size + 256 if length == 2 else size
