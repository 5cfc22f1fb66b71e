# SPDX-License-Identifier: GPL-3.0-or-later
"""What a packed chunk of Zarr unpacks to, known before it is: its codecs unpack it however long it gets."""

from __future__ import annotations

import bz2
import lzma
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

HARMLESS = 1 << 27  # bytes that any machine can unpack
STREAMS: dict[str, tuple[Callable[[], Any], float]] = {  # and how many bytes are made of one at most
    "zlib": (zlib.decompressobj, 1032.0),
    "gzip": (lambda: zlib.decompressobj(zlib.MAX_WBITS | 16), 1032.0),
    "bz2": (bz2.BZ2Decompressor, float("inf")),
    "lzma": (lzma.LZMADecompressor, float("inf")),
}


def unpacks_beyond(path: Path, codec: str, most: int) -> bool:
    """Return whether a file unpacks to more than `most` bytes, and to more than is harmless; False where there is none.

    Of Zstandard and the others with a length in their first bytes it is this length, which is all that is unpacked.

    Parameters
    ----------
    path : Path
        Of a chunk.
    codec : str
        Its name in the array's metadata.
    most : int
        Bytes that the chunk should have.
    """
    if not path.is_file():
        return False
    most = max(most, HARMLESS)
    with path.open("rb") as file:
        head = file.read(16)
        if codec in STREAMS:
            start, ratio = STREAMS[codec]
            return ratio * file.seek(0, 2) > most and streams_beyond(path, start, most)
    if codec == "blosc":
        return int.from_bytes(head[4:8], "little") > most
    if codec == "lz4":
        return int.from_bytes(head[:4], "little") > most
    return codec == "zstd" and zstandard_size(head) > most


def streams_beyond(path: Path, start: Callable[[], Any], most: int) -> bool:
    """Whether one stream, or several one behind the other, unpack to more than `most` bytes; damage is left to zarr."""
    content, done = path.read_bytes(), 0
    while content and done <= most:
        stream = start()
        try:
            done += len(stream.decompress(content, most + 1 - done))
        except (zlib.error, lzma.LZMAError, OSError):
            return False
        content = stream.unused_data
    return done > most


def zstandard_size(head: bytes) -> int:
    """Return the length that the first frame of Zstandard tells of, RFC 8878 3.1.1.1; 0 where it tells none.

    Examples
    --------
    >>> zstandard_size(bytes.fromhex("28b52ffd a0 00000080 0000"))
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
