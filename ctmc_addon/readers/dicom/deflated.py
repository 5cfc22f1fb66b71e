# SPDX-License-Identifier: GPL-3.0-or-later
"""DICOM files that are deflated as a whole (PS3.5 A.5): small ones may unpack to more than any memory holds."""

from __future__ import annotations

import zlib
from typing import IO

DEFLATED = "1.2.840.10008.1.2.1.99"
MOST_UNPACKED = 1 << 26  # bytes of a small deflated file, and how many times its size a larger one may have
MOST_UNPACKED_RATIO = 50
UNPACKED_PIECE = 1 << 20


def unpacks_without_end(file: IO[bytes]) -> bool:
    """Whether a deflated file unpacks to more than any image: pydicom does it at once; leaves `file` at its start."""
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
