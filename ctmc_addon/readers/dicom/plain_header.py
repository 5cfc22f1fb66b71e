"""The header of a plain CT slice, read without pydicom: one walk over the file's first bytes.

A series has hundreds of headers, and pydicom takes longer over each than its pixels take. What is not
plain (another kind of image, frames, look-up tables, big endian, deflated, damaged, very long) is left
to pydicom, which says the same of every file that is. Elements: DICOM PS3.5 7.1 to 7.5.
"""

from __future__ import annotations

import struct
from types import SimpleNamespace
from typing import Any, Literal

LONGEST = 1 << 16  # bytes of a file that are looked at
CT_IMAGE_STORAGE = "1.2.840.10008.5.1.4.1.1.2"
PLAIN = [(CT_IMAGE_STORAGE, "CT", bits) for bits in (8, 16)]
IMPLICIT, BIG, DEFLATED = "1.2.840.10008.1.2", "1.2.840.10008.1.2.2", "1.2.840.10008.1.2.1.99"

Kind = Literal["text", "uid", "decimal", "integer", "short"]
ASKED: dict[int, tuple[str, Kind]] = {
    0x00080008: ("ImageType", "text"),
    0x00080016: ("SOPClassUID", "uid"),
    0x00080060: ("Modality", "text"),
    0x0020000E: ("SeriesInstanceUID", "uid"),
    0x00200013: ("InstanceNumber", "integer"),
    0x00200032: ("ImagePositionPatient", "decimal"),
    0x00200037: ("ImageOrientationPatient", "decimal"),
    0x00280002: ("SamplesPerPixel", "short"),
    0x00280004: ("PhotometricInterpretation", "text"),
    0x00280010: ("Rows", "short"),
    0x00280011: ("Columns", "short"),
    0x00280030: ("PixelSpacing", "decimal"),
    0x00280100: ("BitsAllocated", "short"),
    0x00280101: ("BitsStored", "short"),
    0x00280103: ("PixelRepresentation", "short"),
    0x00280120: ("PixelPaddingValue", "short"),
    0x00280121: ("PixelPaddingRangeLimit", "short"),
    0x00281052: ("RescaleIntercept", "decimal"),
    0x00281053: ("RescaleSlope", "decimal"),
    0x00281054: ("RescaleType", "text"),
}
# NumberOfFrames, ModalityLUTSequence, and the functional groups, shared and per frame.
NOT_PLAIN = {0x00280008, 0x00283000, 0x52009229, 0x52009230}
LOOKED_FOR = ASKED.keys() | NOT_PLAIN
NEEDED = ("Rows", "Columns", "SamplesPerPixel", "PhotometricInterpretation")
MEDIA_STORAGE, TRANSFER_SYNTAX, PIXEL_DATA = 0x00020002, 0x00020010, 0x7FE00010
ITEM, ITEM_END, SEQUENCE_END = 0xFFFEE000, 0xFFFEE00D, 0xFFFEE0DD
UNDEFINED = 0xFFFFFFFF

SHORT_LENGTH = frozenset(b"AE AS AT CS DA DS DT FD FL IS LO LT PN SH SL SS ST TM UI UL US".split())  # 2 bytes
LONG_LENGTH = frozenset(b"OB OD OF OL OV OW SQ SV UC UN UR UT UV".split())  # 4 bytes, after two that are zero
ELEMENT = struct.Struct("<HH2sHI")  # group, element, type, and a length of either kind


class PlainHeader(SimpleNamespace):
    """Elements by keyword, and what pydicom's dataset says of a file's encoding, under the same names.

    Elements that are missing or empty are no attributes. `end` is where the pixels' element begins.
    """

    def get(self, keyword: str, default: Any = None) -> Any:
        """The element's value, or `default`."""
        return getattr(self, keyword, default)


def plain_header(head: bytes) -> PlainHeader | None:
    """What a file's first bytes say of a CT slice; None, or a `ValueError`, where pydicom has to be asked."""
    if head[128:132] != b"DICM":
        return None
    meta = elements(head, 132, {MEDIA_STORAGE, TRANSFER_SYNTAX}, explicit=True, group=2)
    if meta is None:
        return None
    syntax, stored_class = (converted(meta[0].get(tag, b""), "uid") for tag in (TRANSFER_SYNTAX, MEDIA_STORAGE))
    if syntax in (None, BIG, DEFLATED):
        return None
    body = elements(head, meta[1], LOOKED_FOR, explicit=syntax != IMPLICIT)
    if body is None or NOT_PLAIN & body[0].keys():
        return None
    values = {ASKED[tag][0]: converted(raw, ASKED[tag][1]) for tag, raw in body[0].items()}
    header = PlainHeader(**{name: value for name, value in values.items() if value is not None})
    kind = (header.get("SOPClassUID", stored_class), header.get("Modality"), header.get("BitsAllocated"))
    if kind not in PLAIN or not all(header.get(name) for name in NEEDED):
        return None
    header.file_meta = {"TransferSyntaxUID": syntax}
    header.original_encoding = (syntax == IMPLICIT, True)  # implicit, little endian
    header.end = body[1]
    return header


def elements(
    head: bytes, at: int, asked: set[int], explicit: bool, group: int | None = None
) -> tuple[dict[int, bytes], int] | None:
    """Values of the elements `asked` for, those in sequences passed over, and where the walk ended.

    It ends at the pixels, or at the first element that is not in `group`; None where it does not come so far.
    """
    found: dict[int, bytes] = {}
    depth = 0  # of sequences and items whose length is not given
    while at + ELEMENT.size <= len(head):
        group_number, number, kind, short, long = ELEMENT.unpack_from(head, at)
        tag = group_number << 16 | number
        if not depth and (tag == PIXEL_DATA if group is None else group_number != group):
            return found, at
        if group_number == 0xFFFE or not explicit:
            if not explicit and kind in SHORT_LENGTH:
                return None  # explicit after all
            start, length = at + 8, int.from_bytes(head[at + 4 : at + 8], "little")
        elif kind in SHORT_LENGTH:
            start, length = at + 8, short
        elif kind in LONG_LENGTH:
            start, length = at + 12, long
        else:
            return None
        if tag in (ITEM_END, SEQUENCE_END):
            depth -= 1
        elif length == UNDEFINED:
            if explicit and kind != b"SQ" and tag != ITEM:
                return None
            depth, length = depth + 1, 0
        elif tag in asked and not depth:
            found[tag] = head[start : start + length]
        at = start + length
    return None


def converted(raw: bytes, kind: Kind) -> Any:
    r"""An element's value as pydicom gives it, None if it is empty; `ValueError` where it is not plain.

    Examples
    --------
    >>> converted(b"0.5\\0.75 ", "decimal"), converted(b"CT", "text"), converted(b"\x00\x02", "short")
    ([0.5, 0.75], 'CT', 512)
    """
    if not raw:
        return None
    if kind == "short":
        if len(raw) != 2:
            raise ValueError(f"{len(raw)} bytes are no short integer")
        return int.from_bytes(raw, "little")
    text = raw.decode("ascii").rstrip(" \0")
    convert: Any = {"text": str, "uid": str.strip, "decimal": float, "integer": int}[kind]
    values = [convert(word) for word in text.split("\\")]
    return values[0] if len(values) == 1 else values
