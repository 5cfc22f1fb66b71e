# SPDX-License-Identifier: GPL-3.0-or-later
"""TIFF written byte by byte: what tifffile and Pillow cannot write, and what nobody should."""

from __future__ import annotations

import io
import lzma
import struct
import zlib

import numpy as np
from PIL import Image

NONE, GROUP_4, LZW, JPEG, DEFLATE, PACKBITS, LZMA, ZSTD = 1, 4, 5, 7, 8, 32773, 34925, 50000
LETTERS = {1: "B", 2: "B", 3: "H", 4: "I", 6: "b", 7: "B", 8: "h", 11: "f", 12: "d", 16: "Q"}


def tiff(pages, order="<", big=False):
    """A file of pages, each a dict of tag to (type, values), and a list of the bytes of its strips or tiles."""
    letter, room = ("Q", 8) if big else ("I", 4)
    head = struct.pack(order + "HHHQ", 43, 8, 0, 0) if big else struct.pack(order + "HI", 42, 0)
    out = bytearray((b"II" if order == "<" else b"MM") + head)
    link = len(out) - room
    for tags, segments in pages:
        offsets = []
        for segment in segments:
            offsets.append(len(out))
            out += segment + bytes(len(segment) % 2)
        tiled = 322 in tags
        places = {324 if tiled else 273: (4, offsets), 325 if tiled else 279: (4, list(map(len, segments)))}
        entries = []
        for code, (kind, values) in sorted((places | tags).items()):
            content = struct.pack(f"{order}{len(values)}{LETTERS[kind]}", *values)
            if len(content) > room:
                at = len(out)
                out += content + bytes(len(content) % 2)
                content = struct.pack(order + letter, at)
            entries.append(struct.pack(f"{order}HH{letter}", code, kind, len(values)) + content.ljust(room, b"\0"))
        out[link : link + room] = struct.pack(order + letter, len(out))
        out += struct.pack(order + ("Q" if big else "H"), len(entries)) + b"".join(entries)
        link = len(out)
        out += bytes(room)
    return bytes(out)


def packed(values, bits, order="<"):
    """Rows of whole numbers of so many bits, the highest bit first, each row filled up to a byte; (rows, samples)."""
    if bits in (8, 16, 32, 64):
        return np.asarray(values).astype(f"{order}u{bits // 8}").tobytes()
    places = np.arange(bits - 1, -1, -1)
    rows = (np.asarray(values)[..., None] >> places & 1).astype(np.uint8).reshape(len(values), -1)
    return np.packbits(rows, axis=1).tobytes()


def compressed(content, compression, row_bytes):
    """The bytes of one strip."""
    if compression == LZW:
        rows = np.frombuffer(content, np.uint8).reshape(-1, row_bytes)
        return strip_by_pillow(Image.fromarray(rows), "tiff_lzw")
    if compression == PACKBITS:  # runs of one byte, and the others as they are
        pieces = [content[at : at + 100] for at in range(0, len(content), 100)]
        return b"".join(
            bytes([257 - len(piece), piece[0]])
            if len(set(piece)) == 1 and len(piece) > 1
            else bytes([len(piece) - 1]) + piece
            for piece in pieces
        )
    if compression == DEFLATE:
        return zlib.compress(content)
    return lzma.compress(content) if compression == LZMA else content


def strip_by_pillow(image, compression):
    """The one strip of a picture, as Pillow's libtiff compresses it."""
    stream = io.BytesIO()
    image.save(stream, "TIFF", compression=compression, strip_size=1 << 30)
    with Image.open(stream) as written:
        (start,), (length,) = written.tag_v2[273], written.tag_v2[279]
    return stream.getvalue()[start : start + length]


def gray_page(values, bits, compression=NONE, rows_per_strip=None, differences=False, order="<", **more):
    """A page of whole numbers (rows, columns) of any number of bits; `more` are further tags, as t266=(3, [2])."""
    values = np.asarray(values, np.int64)
    rows, columns = values.shape
    high = rows_per_strip or rows
    if differences:
        values = np.diff(values, axis=1, prepend=0) % (1 << bits)
    row_bytes = (columns * bits + 7) // 8
    strips = [
        compressed(packed(values[at : at + high], bits, order), compression, row_bytes) for at in range(0, rows, high)
    ]
    tags = {256: (4, [columns]), 257: (4, [rows]), 258: (3, [bits]), 259: (3, [compression]), 262: (3, [1])}
    tags |= {277: (3, [1]), 278: (4, [high])} | ({317: (3, [2])} if differences else {})
    return tags | {int(key[1:]): value for key, value in more.items()}, strips
