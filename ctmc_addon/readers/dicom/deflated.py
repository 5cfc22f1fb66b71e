# SPDX-License-Identifier: GPL-3.0-or-later
"""Guard against deflated DICOM files (PS3.5 A.5) that are small but unpack to more than memory holds."""

from __future__ import annotations

import zlib
from typing import IO

DEFLATED = "1.2.840.10008.1.2.1.99"
MOST_UNPACKED = 1 << 26  # A file may always unpack to this many bytes.
MOST_UNPACKED_RATIO = 50  # A larger file may unpack to this multiple of its size.
UNPACKED_PIECE = 1 << 20


def unpacks_without_end(file: IO[bytes]) -> bool:
    """Return whether a deflated file unpacks to more than any image, which pydicom would do at once.

    `file` is left at its start.
    """
    head = file.read(1024)
    unpacked, most = 0, 0
    if DEFLATED.encode() in head:
        most = max(MOST_UNPACKED, MOST_UNPACKED_RATIO * file.seek(0, 2))
        # (0002,0000) is the length of the group that is never deflated (PS3.10 7.1).
        file.seek(144 + int.from_bytes(head[140:144], "little"))
        inflate = zlib.decompressobj(-zlib.MAX_WBITS)
        piece = file.read(UNPACKED_PIECE)
        while piece and unpacked <= most:
            unpacked += len(inflate.decompress(piece, UNPACKED_PIECE))
            piece = inflate.unconsumed_tail or file.read(UNPACKED_PIECE)
    file.seek(0)
    return unpacked > most
