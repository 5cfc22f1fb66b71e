# SPDX-License-Identifier: GPL-3.0-or-later
"""Walk through the elements of a DICOM dataset, for sequences that are too long for pydicom.

A segmentation has an item for every frame and a structure set one for every contour, tens of thousands of each.
pydicom makes objects of all elements in them, about 1 ms a frame; the walker reads requested elements only.
Little endian, implicit and explicit: DICOM PS3.5, clauses 7.1 and 7.5.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import IO, Any, NamedTuple

from ....core import Step, Steps

ITEM, ITEM_END, SEQUENCE_END = 0xFFFEE000, 0xFFFEE00D, 0xFFFEE0DD
UNDEFINED_LENGTH = 0xFFFFFFFF
PIXELS = (0x7FE00008, 0x7FE00009, 0x7FE00010)  # Float, double and integer pixels end the walk.
LONG_FORM = frozenset((b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"))
LONGEST_VALUE = 1 << 16  # A longer value, in bytes, is damage.
DEEPEST = 16  # Sequences nested deeper are damage.
MOST_ITEMS = 2_000_000
ITEMS_PER_STEP = 256

# Requests map a tag to VALUE (its bytes), LOCATION (the position of its bytes) or the requests within a sequence.
VALUE, LOCATION = "value", "location"
Requested = Mapping[int, Any]
Elements = dict[int, Any]


class ValueLocation(NamedTuple):
    """The position of a value in the file."""

    vr: str  # Empty if the file does not say it.
    start: int
    length: int


class Damaged(Exception):
    """The file ends too early or breaks the rules of its encoding; the text names the byte."""


class ElementWalker:
    """A walker through the elements of an open file.

    Parameters
    ----------
    file : binary file
        At the first element of the dataset.
    size : int
        Bytes of the file.
    implicit : bool
        Whether elements lack their type.
    """

    def __init__(self, file: IO[bytes], size: int, implicit: bool) -> None:
        self.file, self.size, self.implicit = file, size, implicit
        self.at = file.tell()
        self.items = 0

    def dataset_steps(self, requested: Requested) -> Steps[Elements]:
        """Return the requested elements and the position of the pixels, with steps within long sequences."""
        elements: Elements = {}
        while self.at < self.size:
            tag, vr, length = self._header(self.implicit)
            if tag in PIXELS:
                elements[tag] = ValueLocation(vr, self.at, length)
                break
            inner = requested.get(tag)
            if not isinstance(inner, Mapping):
                self._take(elements, tag, vr, length, inner, 0)
                continue
            items: list[Elements] = []
            for item in self._items(length, inner, vr, 1):
                items.append(item)
                if len(items) % ITEMS_PER_STEP == 0:
                    yield Step(min(1.0, self.at / self.size), "Reading headers")
            elements[tag] = items
        return elements

    def _items(self, length: int, requested: Requested, vr: str, depth: int) -> Iterator[Elements]:
        """Yield the items of the sequence whose value begins here."""
        if depth > DEEPEST:
            raise Damaged(f"more than {DEEPEST} nested sequences")
        stop = self._stop(length)
        # PS3.5 6.2.2: a sequence of unknown type and length has implicit elements.
        implicit = self.implicit or (vr == "UN" and length == UNDEFINED_LENGTH)
        while self.at < stop:
            tag, _, item_length = self._header(implicit)
            if tag == SEQUENCE_END:
                return
            if tag != ITEM:
                raise Damaged(f"no item at byte {self.at} of a sequence")
            self.items += 1
            if self.items > MOST_ITEMS:
                raise Damaged(f"more than {MOST_ITEMS} items in sequences")
            yield self._item(item_length, requested, implicit, depth)
        self._check_end(stop, length)

    def _item(self, length: int, requested: Requested, implicit: bool, depth: int) -> Elements:
        stop, outer = self._stop(length), self.implicit
        elements: Elements = {}
        self.implicit = implicit
        while self.at < stop:
            tag, vr, inner_length = self._header(implicit)
            if tag == ITEM_END:
                self.implicit = outer
                return elements
            self._take(elements, tag, vr, inner_length, requested.get(tag), depth)
        self.implicit = outer
        self._check_end(stop, length)
        return elements

    def _take(self, elements: Elements, tag: int, vr: str, length: int, inner: Any, depth: int) -> None:
        """Read or skip one element after its header."""
        if isinstance(inner, Mapping):
            elements[tag] = list(self._items(length, inner, vr, depth + 1))
        elif length == UNDEFINED_LENGTH:
            for _ in self._items(length, {}, vr, depth + 1):
                pass
        else:
            start, end = self.at, self._stop(length)
            if inner == VALUE:
                if length > LONGEST_VALUE:
                    raise Damaged(f"a value of {length} bytes at byte {start}")
                elements[tag] = self.file.read(length)
            else:
                if inner == LOCATION:
                    elements[tag] = ValueLocation(vr, start, length)
                self.file.seek(end)
            self.at = end

    def _header(self, implicit: bool) -> tuple[int, str, int]:
        """Read tag, VR and length of the element that begins here; items of a sequence have no VR."""
        head = self._read(8)
        group, element, length = struct.unpack("<HHI", head)
        tag = group << 16 | element
        if implicit or group == 0xFFFE:
            return tag, "", length
        if head[4:6] in LONG_FORM:
            return tag, head[4:6].decode("ascii"), int.from_bytes(self._read(4), "little")
        return tag, head[4:6].decode("latin-1"), length >> 16

    def _read(self, count: int) -> bytes:
        piece = self.file.read(count)
        self.at += count
        if len(piece) < count:
            raise Damaged(f"the end of the file within an element, after {self.size} bytes")
        return piece

    def _stop(self, length: int) -> int:
        """Return the end of a value of `length` bytes that begins here; the file's end if it is undefined."""
        if length == UNDEFINED_LENGTH:
            return self.size
        if self.at + length > self.size:
            raise Damaged(f"{self.size - self.at} of {length} bytes of a value at byte {self.at}")
        return self.at + length

    def _check_end(self, stop: int, length: int) -> None:
        if self.at != stop or length == UNDEFINED_LENGTH:
            raise Damaged(f"a sequence that does not end where it should, at byte {stop}")


def after_meta(file: IO[bytes]) -> tuple[str, int]:
    """Return the transfer syntax UID and the start of the dataset; the UID is empty without meta information.

    PS3.10, clause 7.1: 128 bytes, 'DICM', then group 2 in explicit little endian.
    """
    file.seek(0)
    if file.read(132)[128:] != b"DICM":
        file.seek(0)
        return "", 0
    syntax, at = "", 132
    while True:
        head = file.read(8)
        if len(head) < 8 or head[:2] != b"\x02\x00":
            file.seek(at)
            return syntax, at
        length = int.from_bytes(head[6:8], "little")
        start = at + 8
        if head[4:6] in LONG_FORM:
            length, start = int.from_bytes(file.read(4), "little"), at + 12
        if head[2:4] == b"\x10\x00":
            syntax = file.read(min(length, 64)).rstrip(b"\0 ").decode("ascii", "replace")
        at = start + length
        file.seek(at)
