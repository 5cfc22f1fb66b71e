# SPDX-License-Identifier: GPL-3.0-or-later
"""The header of a plain DICOM slice: one gray frame, little endian, its elements once each and in order.

Nearly all CT is stored so, and pydicom takes some four times as long for it. Anything else is left to pydicom, which
mends it or says what is wrong with it. Elements: DICOM PS3.5 7.1; sequences: 7.5; fragments: A.4.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from functools import lru_cache
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .frames import OWN_KEYWORDS

IMPLICIT_LITTLE, EXPLICIT_LITTLE = "1.2.840.10008.1.2", "1.2.840.10008.1.2.1"
COMPRESSED = re.compile(r"1\.2\.840\.10008\.1\.2\.(?:4\.[0-9]+|5)")
CLASSES = {f"1.2.840.10008.5.1.4.1.1.{number}" for number in (2, 4, 7)}  # CT, MR and secondary captures
LONGEST_HEADER = 1 << 16  # bytes before the pixels
MOST_FRAGMENTS = 64
UNDEFINED_LENGTH = 0xFFFFFFFF
SHORT = frozenset(b"AE AS AT CS DA DS DT FD FL IS LO LT PN SH SL SS ST TM UI UL US".split())  # lengths of 2 bytes
LONG = frozenset(b"OB OD OF OL OV OW SQ SV UC UN UR UT UV".split())  # of 4, behind 2 unused ones

PLAIN = {  # keyword and value representation by tag
    0x00020000: ("FileMetaInformationGroupLength", "UL"),
    0x00020002: ("MediaStorageSOPClassUID", "UI"),
    0x00020010: ("TransferSyntaxUID", "UI"),
    0x00080005: ("SpecificCharacterSet", "CS"),
    0x00080008: ("ImageType", "CS"),
    0x00080016: ("SOPClassUID", "UI"),
    0x00080018: ("SOPInstanceUID", "UI"),
    0x00080032: ("AcquisitionTime", "TM"),
    0x00080033: ("ContentTime", "TM"),
    0x00080060: ("Modality", "CS"),
    0x0008103E: ("SeriesDescription", "LO"),
    0x00181060: ("TriggerTime", "DS"),
    0x00181210: ("ConvolutionKernel", "SH"),
    0x0020000E: ("SeriesInstanceUID", "UI"),
    0x00200011: ("SeriesNumber", "IS"),
    0x00200012: ("AcquisitionNumber", "IS"),
    0x00200013: ("InstanceNumber", "IS"),
    0x00200032: ("ImagePositionPatient", "DS"),
    0x00200037: ("ImageOrientationPatient", "DS"),
    0x00200052: ("FrameOfReferenceUID", "UI"),
    0x00200100: ("TemporalPositionIdentifier", "IS"),
    0x00280002: ("SamplesPerPixel", "US"),
    0x00280004: ("PhotometricInterpretation", "CS"),
    0x00280008: ("NumberOfFrames", "IS"),
    0x00280010: ("Rows", "US"),
    0x00280011: ("Columns", "US"),
    0x00280030: ("PixelSpacing", "DS"),
    0x00280100: ("BitsAllocated", "US"),
    0x00280101: ("BitsStored", "US"),
    0x00280102: ("HighBit", "US"),
    0x00280103: ("PixelRepresentation", "US"),
    0x00280120: ("PixelPaddingValue", "US"),
    0x00280121: ("PixelPaddingRangeLimit", "US"),
    0x00281052: ("RescaleIntercept", "DS"),
    0x00281053: ("RescaleSlope", "DS"),
    0x00281054: ("RescaleType", "LO"),
}
OTHERS = {  # a file that has one of these is not plain
    0x00280006: "PlanarConfiguration",
    0x00283000: "ModalityLUTSequence",
    0x52009229: "SharedFunctionalGroupsSequence",
    0x52009230: "PerFrameFunctionalGroupsSequence",
    0x7FE00001: "ExtendedOffsetTable",
    0x7FE00002: "ExtendedOffsetTableLengths",
    0x7FE00008: "FloatPixelData",
    0x7FE00009: "DoubleFloatPixelData",
}
SEVERAL = ("ImageType", "ConvolutionKernel", "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing")
SIGNED_TOO = ("PixelPaddingValue", "PixelPaddingRangeLimit")  # US or SS
NOT_SLICES = {"SEG", "RTSTRUCT", "RTDOSE", "RTPLAN", "SR", "PR", "KO", "REG", "DOC"}  # modalities
NEEDED = ("Rows", "Columns", "BitsAllocated", "BitsStored", "PixelRepresentation")
META_GROUPS, GROUPS, ITEM_GROUP = range(0x0002, 0x0003), range(0x0004, 0x7FE1), 0xFFFE
PIXEL_DATA = 0x7FE00010
ITEM, ITEM_END, SEQUENCE_END = 0xFFFEE000, 0xFFFEE00D, 0xFFFEE0DD
TRAILING_PADDING = 0xFFFCFFFC
CHARACTERS = re.compile(r"ISO(?:_IR| 2022 IR) (?:6|100|101|109|110|126|127|138|144|148|166|192)")  # ASCII in all
BYTES = {"US": 2, "UL": 4}
VALUES = {
    "UI": re.compile(rb"[0-9.]{0,64}\0?"),
    "CS": re.compile(rb"[ -~]*\0?"),
    "TM": re.compile(rb"[0-9.:]* *\0?"),
    "IS": re.compile(rb" *(?:0|-?[1-9][0-9]{0,8}) *\0?"),
    "DS": re.compile(rb" *[-+]?(?:[0-9]{1,30}\.?|[0-9]{0,30}\.[0-9]{1,30})(?:[eE][-+]?[0-9]{1,2})? *\0?"),
}
VALUES["LO"] = VALUES["SH"] = VALUES["CS"]


class Element(NamedTuple):
    """A data element of the outermost dataset."""

    tag: int
    representation: str  # of its value; empty where it is implicit
    start: int  # byte of the value
    length: int  # bytes of the value, or `UNDEFINED_LENGTH`


class PlainHeader(NamedTuple):
    """What a plain slice says of itself."""

    elements: dict[str, Any]  # by keyword; None where an element is empty
    syntax: str  # transfer syntax UID
    compressed: bool
    pixels: Element
    moved: bool = False  # whether `OWN_KEYWORDS` alone differ from those of the header before


class NotPlainError(Exception):
    """The file is of another kind, or broken."""


def need(condition: bool) -> None:
    """Leave the file to pydicom unless `condition` holds."""
    if not condition:
        raise NotPlainError


class PlainHeaders:
    """Headers of plain slices, one after the other.

    Slices of a series mostly differ in a few values that are as long as those of the slice before. Where all bytes
    between the values are the same, so are the elements, and only the values that differ are taken.
    """

    def __init__(self) -> None:
        self.layout: Layout | None = None  # of the header before

    def read(self, file: IO[bytes]) -> PlainHeader | None:
        """Return the header of a plain slice, None where pydicom has to look; leaves `file` at its start."""
        try:
            content = file.read(LONGEST_HEADER if self.layout is None else self.layout.content.size)
            layout = None if self.layout is None else _laid_out_as(self.layout, content, file)
            if layout is None:
                content += file.read(LONGEST_HEADER - len(content))
                layout = _parsed(content, file)
            if not layout.header.moved:  # of `OWN_KEYWORDS` nothing is checked
                check(layout.header)
            self.layout = layout
        except (NotPlainError, struct.error):  # struct's where the file ends
            return None
        finally:
            file.seek(0)
        return layout.header


class Layout(NamedTuple):
    """Where the values of a header lie, the unused bytes at its start among them."""

    header: PlainHeader
    content: NDArray[np.uint8]  # all bytes before those of the pixels
    starts: NDArray[np.int64]  # of each value, rising
    stops: NDArray[np.int64]
    elements: list[Element | None]  # of each value; None where none is taken, as within sequences


def _laid_out_as(layout: Layout, content: bytes, file: IO[bytes]) -> Layout | None:
    """Return the layout with the values of a file that begins with `content`, None where its elements lie elsewhere."""
    if len(content) < layout.content.size:
        return None
    own = np.frombuffer(content, np.uint8, layout.content.size)
    differing = np.flatnonzero(own != layout.content)
    values = np.searchsorted(layout.starts, differing, "right") - 1
    if (differing >= layout.stops[values]).any():  # behind a value
        return None
    header = layout.header
    elements, changed = header.elements.copy(), set()
    for at in set(values.tolist()):
        element = layout.elements[at]
        if element is not None:
            _take(element, content, elements)
            changed.add(PLAIN[element.tag][0])
    if elements["TransferSyntaxUID"] != header.syntax:
        return None
    _check_end(file, header.pixels, header.compressed)
    return layout._replace(header=header._replace(elements=elements, moved=changed <= OWN_KEYWORDS), content=own)


def _parsed(content: bytes, file: IO[bytes]) -> Layout:
    """Return how the header of a file that begins with `content` is laid out."""
    need(content[128:132] == b"DICM")
    elements: dict[str, Any] = {}
    at = 132
    values: list[tuple[int, int, Element | None]] = [(0, 128, None)]
    for element in elements_of(content, at, True, META_GROUPS, values):
        _take(element, content, elements)
        at = element.start + element.length
    syntax = str(elements.get("TransferSyntaxUID"))
    compressed = COMPRESSED.fullmatch(syntax) is not None
    need(compressed or syntax in (IMPLICIT_LITTLE, EXPLICIT_LITTLE))
    explicit = syntax != IMPLICIT_LITTLE
    need(explicit == content[at + 4 : at + 6].isalpha())  # some files are stored in another way than they say
    for element in elements_of(content, at, explicit, GROUPS, values):
        if element.tag == PIXEL_DATA:
            break
        _take(element, content, elements)
    need(element.tag == PIXEL_DATA)
    _check_end(file, element, compressed)
    starts, stops, passed = zip(*values, strict=True)
    taken = [element if element is not None and element.tag in PLAIN else None for element in passed]
    header = PlainHeader(elements, syntax, compressed, pixels=element)
    before = np.frombuffer(content, np.uint8, element.start)
    return Layout(header, before, np.array(starts), np.array(stops), taken)


def _check_end(file: IO[bytes], pixels: Element, compressed: bool) -> None:
    """Leave a file to pydicom unless it ends with its pixels, or with whole padding behind them."""
    file_bytes = file.seek(0, 2)
    end = fragments_end(file, pixels.start) if compressed else pixels.start + pixels.length
    if end != file_bytes:
        file.seek(end)
        if pixels.representation:
            tag, kind, length = struct.unpack("<I4sI", file.read(12))
            need(kind == b"OB\0\0")
        else:
            tag, length = struct.unpack("<II", file.read(8))
        need(tag == TRAILING_PADDING and file.tell() + length == file_bytes)


def elements_of(
    content: bytes, at: int, explicit: bool, groups: range, values: list[tuple[int, int, Element | None]]
) -> Iterator[Element]:
    """Yield the elements of the outermost dataset from byte `at` on, as long as they are of some groups.

    `values` gets the first byte of every value that is passed over, the byte behind it, and its element; None within
    sequences.
    """
    last = 0
    ends: list[int] = []  # the tags that end the sequences and items of undefined length around
    representation = b""
    while True:
        group, number, length = struct.unpack_from("<HHI", content, at)
        if group not in groups and not ends:
            return
        tag = group << 16 | number
        at += 8
        element = None
        if group == ITEM_GROUP:
            if tag != ITEM:
                need(tag == ends.pop() and length == 0)
                continue
            need(ends[-1] == SEQUENCE_END)
            inner_end = ITEM_END
        else:
            if explicit:
                representation = content[at - 4 : at - 2]
                if representation in SHORT:
                    length >>= 16
                else:
                    need(representation in LONG)
                    (length,) = struct.unpack_from("<I", content, at)
                    at += 4
            if not ends:
                need(tag > last)
                last = tag
                element = Element(tag, representation.decode(), at, length)
                yield element
            else:
                need(ends[-1] == ITEM_END)
            inner_end = SEQUENCE_END
        if length != UNDEFINED_LENGTH:
            values.append((at, at + length, element))
            at += length
        else:
            need(group == ITEM_GROUP or representation in (b"", b"SQ"))
            ends.append(inner_end)


def _take(element: Element, content: bytes, elements: dict[str, Any]) -> None:
    """Add an element's value to `elements`, if it is wanted."""
    tag, representation, start, length = element
    need(tag not in OTHERS)
    if tag not in PLAIN:
        return
    keyword, own = PLAIN[tag]
    value = content[start : start + length]
    need(len(value) == length)
    need(representation in ("", own) or (representation == "SS" and keyword in SIGNED_TOO))
    elements[keyword] = value_of(own, keyword in SEVERAL, value)


@lru_cache(1024)
def value_of(representation: str, several: bool, value: bytes) -> Any:
    """Return a value as numbers or text; None where it is empty.

    Parameters
    ----------
    representation : str
        Of two letters.
    several : bool
        Whether more than one value may stand there: these are a list, unless there is one.
    value : bytes
        As stored.
    """
    if not value:
        return None
    if representation in BYTES:
        need(len(value) == BYTES[representation])
        return int.from_bytes(value, "little")
    pieces = value.split(b"\\") if several else [value]
    need(all(map(VALUES[representation].fullmatch, pieces)))
    need(several or b"\\" not in value)
    kind = {"IS": int, "DS": float}.get(representation, str)
    values = [kind(piece.decode().rstrip(" \0")) for piece in pieces]
    return values if len(values) > 1 else values[0]


def fragments_end(file: IO[bytes], at: int) -> int:
    """Return the byte behind compressed pixels: fragments from byte `at` on, as items with their lengths."""
    for _ in range(MOST_FRAGMENTS):
        file.seek(at)
        group, number, length = struct.unpack("<HHI", file.read(8))
        at += 8
        if group << 16 | number == SEQUENCE_END:
            return at
        need(group << 16 | number == ITEM and length != UNDEFINED_LENGTH)
        at += length
    raise NotPlainError


def check(header: PlainHeader) -> None:
    """Leave anything but one gray frame to pydicom."""
    elements, pixels = header.elements, header.pixels
    need(header.compressed == (pixels.length == UNDEFINED_LENGTH) and pixels.representation in ("", "OB", "OW"))
    kinds = {elements.get(keyword, None) for keyword in ("SOPClassUID", "MediaStorageSOPClassUID")} - {None, ""}
    need(len(kinds) == 1 and kinds < CLASSES)
    need(CHARACTERS.fullmatch(elements.get("SpecificCharacterSet", None) or "ISO_IR 6") is not None)
    need(elements.get("NumberOfFrames", 1) == elements.get("SamplesPerPixel", None) == 1)
    need(elements.get("PhotometricInterpretation", None) in ("MONOCHROME1", "MONOCHROME2"))
    need(elements.get("Modality", None) not in NOT_SLICES)
    need(all(elements.get(keyword, None) is not None for keyword in NEEDED))
    # Values of padding are unsigned here, from which those of 8 and 16 bits follow.
    need(elements["BitsAllocated"] in (8, 16) or not any(keyword in elements for keyword in SIGNED_TOO))
