# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes to a whole file: bits, bytes, cuts, copied pieces, and numbers set to what no file should say."""

from __future__ import annotations

import gzip
import random
import re
import struct
import zlib

HEADER = 1200  # bytes in which most numbers stand that say how the rest is read
WORDS = [
    b"0",
    b"-1",
    b"1",
    b"nan",
    b"inf",
    b"-5",
    b"1e308",
    b"65536",
    b"2147483647",
    b"4294967296",
    b"9" * 13,
    b"9" * 400,
]
WORDS += [
    b"1.5",
    b"../../etc/passwd",
    b"%s%n%d",
    b"x%900000000d",
    b"",
    b"LIST",
    b"(1,0",
    b"none",
    b"true",
    b"gzip",
    b"raw",
]
NUMBERS = [0, 1, 2, 3, 7, 16, 127, 128, 255, 256, 0x7FFF, 0x8000, 0xFFFF, 1 << 24, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]
NUMBERS += [1 << 40, 0x7FFFFFFFFFFFFFFF, 0xFFFFFFFFFFFFFFFF]
FLOATS = [float("nan"), float("inf"), -1.0, 0.0, 1e300, 1e-300, 1e38, -0.0]


def place(chance: random.Random, content: bytearray) -> int:
    """A byte, more often one of the header."""
    return chance.randrange(min(len(content), HEADER) if chance.random() < 0.75 else len(content))


def flip_bits(chance: random.Random, content: bytearray) -> None:
    """Turn a few bits over."""
    for _ in range(chance.choice((1, 1, 2, 8))):
        content[place(chance, content)] ^= 1 << chance.randrange(8)


def set_bytes(chance: random.Random, content: bytearray) -> None:
    """Put random bytes over some."""
    at = place(chance, content)
    piece = bytes(chance.randrange(256) for _ in range(chance.choice((1, 2, 4, 16))))
    content[at : at + len(piece)] = piece


def cut(chance: random.Random, content: bytearray) -> None:
    """Leave the end out."""
    del content[chance.randrange(len(content)) :]


def copy_piece(chance: random.Random, content: bytearray) -> None:
    """Put a piece of the file somewhere else, over what is there or between it."""
    start = place(chance, content)
    piece = content[start : start + chance.choice((1, 4, 20, 300))]
    at = place(chance, content)
    content[at : at + (len(piece) if chance.random() < 0.5 else 0)] = piece


def leave_out(chance: random.Random, content: bytearray) -> None:
    """Leave a piece out in the middle."""
    at = place(chance, content)
    del content[at : at + chance.choice((1, 2, 4, 50))]


def set_number(chance: random.Random, content: bytearray) -> None:
    """Put a number that is too large, too small or none where one may stand."""
    at = place(chance, content) & ~chance.choice((0, 1, 3))
    size = chance.choice((1, 2, 4, 8))
    if size >= 4 and chance.random() < 0.3:
        piece = struct.pack(chance.choice("<>") + ("f" if size == 4 else "d"), min(chance.choice(FLOATS), 3e38))
    else:
        order = chance.choice(("little", "big"))
        piece = (chance.choice(NUMBERS) & ((1 << 8 * size) - 1)).to_bytes(size, order)
    content[at : at + size] = piece


def set_word(chance: random.Random, content: bytearray) -> None:
    """Put another word in the place of a number or a word in letters."""
    found = list(re.finditer(rb"-?[0-9][0-9.e+-]*|[a-z%]{3,}", bytes(content[: 4 * HEADER])))
    if found:
        match = chance.choice(found)
        content[match.start() : match.end()] = chance.choice(WORDS)


CHANGES = (flip_bits, flip_bits, set_bytes, cut, copy_piece, leave_out, set_number, set_number, set_word)


def mutated(chance: random.Random, content: bytes) -> bytes:
    """The content changed in one to four places; inside its packing as often as outside, check sums mended as often."""
    inside = content[:2] == b"\x1f\x8b" and chance.random() < 0.6
    changed = bytearray(gzip.decompress(content) if inside else content)
    for _ in range(chance.choice((1, 1, 2, 4))):
        if changed:
            chance.choice(CHANGES)(chance, changed)
    if inside:
        return gzip.compress(bytes(changed), 1, mtime=0)
    if content.startswith(b"\x89PNG") and chance.random() < 0.6:
        return with_check_sums(bytes(changed))
    return bytes(changed)


def with_check_sums(content: bytes) -> bytes:
    """A PNG with the check sums that its chunks should have."""
    made, at = bytearray(content), 8
    while at + 12 <= len(made):
        length = int.from_bytes(made[at : at + 4], "big")
        end = at + 8 + length
        if end + 4 > len(made):
            break
        made[end : end + 4] = zlib.crc32(made[at + 4 : end]).to_bytes(4, "big")
        at = end + 4
    return bytes(made)
