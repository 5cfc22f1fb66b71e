# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes to a whole file: bits, bytes, cuts, copied pieces, extreme numbers, and single fields of TIFF and DICOM."""

from __future__ import annotations

import gzip
import random
import re
import struct
import zlib
from typing import Any

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


TIFF_CODES = [254, 256, 257, 258, 259, 262, 266, 270, 273, 277, 278, 279, 282, 284, 296, 305, 317, 320, 322, 323, 324]
TIFF_CODES += [325, 338, 339, 347, 530, 32997, 50838, 50839]
TIFF_VALUES = [0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 24, 32, 64, 32773, 32946, 34925, 50000, 65535]
VRS = [b"US", b"SS", b"UL", b"SL", b"OB", b"OW", b"DS", b"IS", b"FD", b"FL", b"UN", b"SQ", b"LO", b"CS", b"UI", b"AT"]
DICOM_NUMBERS = [
    b"0 ",
    b"1 ",
    b"-1",
    b"2 ",
    b"1.5 ",
    b"1e308 ",
    b"nan ",
    b"inf ",
    b"",
    b"1\\2 ",
    b"x ",
    b"-1024 ",
    b"0.5 ",
]


def tiff_entries(content: bytearray) -> tuple[str, bool, list[int]]:
    """Byte order, whether it is BigTIFF, and where the entries of all pages are."""
    order = "<" if content[:2] == b"II" else ">"
    big = content[2:4] in (b"+\0", b"\0+")
    number, count, entry = ("Q", "Q", 20) if big else ("I", "H", 12)
    entries: list[int] = []
    try:
        (at,) = struct.unpack_from(order + number, content, 8 if big else 4)
        while at and len(entries) < 400:
            (tags,) = struct.unpack_from(order + count, content, at)
            first = at + struct.calcsize(count if big else "H")
            entries += range(first, first + min(tags, 60) * entry, entry)
            (at,) = struct.unpack_from(order + number, content, first + tags * entry)
    except (struct.error, OverflowError):
        pass
    return order, big, [at for at in entries if at + entry <= len(content)]


def change_tiff_entry(chance: random.Random, content: bytearray) -> None:
    """Change the tag, type, count or value of one entry, or one of the numbers that it points to."""
    order, big, entries = tiff_entries(content)
    if not entries:
        return
    at = chance.choice(entries)
    number = "Q" if big else "I"
    room = struct.calcsize(number)
    most = (1 << 8 * room) - 1
    what = chance.randrange(6)
    if what == 0:
        struct.pack_into(order + "H", content, at, chance.choice(TIFF_CODES))
    elif what == 1:
        struct.pack_into(order + "H", content, at + 2, chance.choice((*range(19), 255)))
    elif what == 2:
        struct.pack_into(order + number, content, at + 4, chance.choice((*TIFF_VALUES, *NUMBERS)) & most)
    elif what == 3:
        letter = chance.choice("HHI")
        value = chance.choice((*TIFF_VALUES, *NUMBERS)) & (0xFFFF if letter == "H" else 0xFFFFFFFF)
        struct.pack_into(order + letter, content, at + 4 + room, value)
    elif what == 4:  # a little more or less
        (value,) = struct.unpack_from(order + "H", content, at + 4 + room)
        struct.pack_into(order + "H", content, at + 4 + room, (value + chance.choice((-2, -1, 1, 2))) & 0xFFFF)
    else:
        (place_of_values,) = struct.unpack_from(order + number, content, at + 4 + room)
        if place_of_values + 4 <= len(content):
            struct.pack_into(order + "H", content, place_of_values, chance.choice(TIFF_VALUES))


def dicom_elements(content: bytearray) -> list[tuple[int, int, int, int, bool]]:
    """Of each element: its first byte, that of its length, the bytes of the length, its value, whether it has a VR."""
    found: list[tuple[int, int, int, int, bool]] = []
    at = 132
    while at + 8 <= len(content) and len(found) < 500:
        group, _ = struct.unpack_from("<HH", content, at)
        vr = bytes(content[at + 4 : at + 6])
        explicit = vr.isalpha() and vr.isupper() and group != 0xFFFE
        if explicit and vr in (b"OB", b"OW", b"SQ", b"UN", b"UT", b"OF", b"OD", b"OL", b"UC", b"UR", b"SV", b"UV"):
            where, size, value = at + 8, 4, at + 12
        elif explicit:
            where, size, value = at + 6, 2, at + 8
        else:
            where, size, value = at + 4, 4, at + 8
        if value > len(content):
            break
        length = int.from_bytes(content[where : where + size], "little")
        found.append((at, where, size, value, explicit))
        inside = length == 0xFFFFFFFF or vr == b"SQ" or group == 0xFFFE
        at = value if inside else value + length
    return found


def change_dicom_element(chance: random.Random, content: bytearray) -> None:
    """Change the tag, VR, length or value of one element, or leave it out."""
    elements = dicom_elements(content)
    if not elements:
        return
    at, where, size, value, explicit = chance.choice(elements)
    length = int.from_bytes(content[where : where + size], "little")
    what = chance.randrange(6)
    if what == 0:
        other = chance.choice(elements)[0]
        content[at : at + 4] = content[other : other + 4]
    elif what == 1 and explicit:
        content[at + 4 : at + 6] = chance.choice(VRS)
    elif what == 2:
        changed = chance.choice((0, 1, 2, length + 1, length + 2, max(0, length - 2), 0xFFFE, (1 << 8 * size) - 1))
        content[where : where + size] = (changed & ((1 << 8 * size) - 1)).to_bytes(size, "little")
    elif what == 3 and length == 2:
        content[value : value + 2] = chance.choice((0, 1, 2, 7, 8, 11, 12, 15, 16, 32, 34, 40, 65535)).to_bytes(
            2, "little"
        )
    elif what == 4 and length < 200:
        word = chance.choice(DICOM_NUMBERS)
        content[where : where + size] = len(word).to_bytes(size, "little")
        content[value : value + length] = word
    elif what == 5 and length < 2000:
        del content[at : value + length]


def by_field(content: bytes) -> Any:
    """The change that knows the fields of such a file; None where there is none."""
    if content[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return change_tiff_entry
    return change_dicom_element if content[128:132] == b"DICM" else None


CHANGES = (flip_bits, flip_bits, set_bytes, cut, copy_piece, leave_out, set_number, set_number, set_word)


def mutated(chance: random.Random, content: bytes) -> bytes:
    """The content changed in one to four places; inside its packing as often as outside, check sums mended as often."""
    inside = content[:2] == b"\x1f\x8b" and chance.random() < 0.6
    changed = bytearray(gzip.decompress(content) if inside else content)
    fields = by_field(content)
    for _ in range(chance.choice((1, 1, 2, 4))):
        if changed:
            change = fields if fields is not None and chance.random() < 0.5 else chance.choice(CHANGES)
            change(chance, changed)
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
