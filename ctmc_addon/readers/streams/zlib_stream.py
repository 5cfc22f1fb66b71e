# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a zlib stream as a file, unpacked piece by piece, which the standard library cannot."""

from __future__ import annotations

import io
import zlib
from typing import IO, Any

PIECE = 1 << 16  # Packed bytes read at once.


class ZlibFile(io.RawIOBase):
    """A file of the unpacked content of `stream` from its position on; the header tells zlib from gzip.

    Raises
    ------
    zlib.error, EOFError
        While reading, of damage and of a stream that ends before its check sum.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self.stream = stream
        self.decoder = zlib.decompressobj(zlib.MAX_WBITS | 32)

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, target: Any) -> int:
        """Read into `target`, and return the number of bytes read, 0 at the end."""
        view = memoryview(target).cast("B")
        done = 0
        while done < len(view) and not self.decoder.eof:
            packed = self.decoder.unconsumed_tail or self.stream.read(PIECE)
            if not packed:
                raise EOFError("the compressed values end too early")
            plain = self.decoder.decompress(packed, len(view) - done)
            view[done : done + len(plain)] = plain
            done += len(plain)
        return done
