# SPDX-License-Identifier: GPL-3.0-or-later
"""Check a compressed frame by its own headers before it is decoded: its end, its size and its coding.

The decoders give a picture for half a frame too, and make room for whatever size a frame claims.
JPEG's markers are those of ITU T.81 and T.87, JPEG 2000's those of ITU T.800.
"""

from __future__ import annotations

from collections.abc import Iterator

START, END = b"\xff\xd8", b"\xff\xd9"  # The markers SOI and EOI; EOC of JPEG 2000 has the value of EOI.
JPEG_2000 = b"\xff\x4f\xff\x51"  # The markers SOC and SIZ.
BOXES = b"\x00\x00\x00\x0cjP"  # Some writers put a whole JPEG 2000 file here, which DICOM forbids.
MOST_BOXES = 4096  # Bytes in which the codestream of such a file must begin.
# Start of frame: all of 0xC0 to 0xCF that are not DHT, JPG and DAC; 0xF7 is JPEG-LS.
FRAMES = {*range(0xC0, 0xD0), 0xF7} - {0xC4, 0xC8, 0xCC}
WITHOUT_LENGTH = {0x01, *range(0xD0, 0xD9)}
SCAN, CODING, TILE = 0xDA, 0x52, 0x90  # SOS is JPEG's and JPEG-LS's, COD and SOT are JPEG 2000's.
JPEG_LS_FRAME = 0xF7
REVERSIBLE = 1  # JPEG 2000's code of the 5-3 transformation.


def frame_damage(frame: bytes, rows: int, columns: int, samples: int) -> str:
    r"""Describe the damage of a JPEG, JPEG-LS or JPEG 2000 frame; empty for a sound frame and for other kinds.

    Parameters
    ----------
    frame : bytes
        With the byte that makes its length even.
    rows, columns, samples : int
        As the DICOM header has them.

    Examples
    --------
    >>> frame_damage(b"\xff\xd8\xff\xc3\x00\x0b\x10\x00\x05\x00\x07\x01", 5, 7, 1)
    'the end of its pixels is missing'
    """
    size = codestream_size(frame)
    if size is None:
        return ""
    if not frame.rstrip(b"\x00\xff").endswith(END[1:]) or END not in frame[-64:]:
        return "the end of its pixels is missing"
    if size != (size[0] and rows, size[1] and columns, samples):  # 0 is said later in the frame
        return f"its pixels are {size[1]} x {size[0]} x {size[2]}, and its header says {columns} x {rows} x {samples}"
    return ""


def is_reversible(frame: bytes) -> bool:
    r"""Return whether a frame gives the pixels that were compressed: JPEG 2000 of the 5-3 wavelet, JPEG-LS of NEAR 0.

    Parameters
    ----------
    frame : bytes

    Examples
    --------
    >>> start = b"\xff\xd8\xff\xf7\x00\x0b\x10\x00\x05\x00\x07\x01\x01\x11\x00\xff\xda\x00\x08\x01\x01\x00"
    >>> is_reversible(start + b"\x00\x00\x00"), is_reversible(start + b"\x02\x00\x00")
    (True, False)
    """
    frame = codestream(frame)
    segments = {marker: frame[at : at + length] for marker, at, length in reversed(list(segments_of(frame)))}
    if frame.startswith(JPEG_2000):
        coding = segments.get(CODING, b"")  # its length, style, progression, layers, colors, levels and blocks
        return len(coding) > 11 and coding[11] == REVERSIBLE
    scan = segments.get(SCAN, b"")
    return JPEG_LS_FRAME in segments and len(scan) >= 3 and scan[-3] == 0


def codestream(frame: bytes) -> bytes:
    """Return a frame from its first marker on."""
    return frame[max(0, frame.find(JPEG_2000, 0, MOST_BOXES)) :] if frame.startswith(BOXES) else frame


def codestream_size(frame: bytes) -> tuple[int, int, int] | None:
    """Return (rows, columns, samples of a pixel) of a frame's header: zeros if cut off, None for other kinds."""
    frame = codestream(frame)
    if frame.startswith(JPEG_2000):
        right, lower, left, upper = (int.from_bytes(frame[at : at + 4], "big") for at in (8, 12, 16, 20))
        return lower - upper, right - left, int.from_bytes(frame[40:42], "big")
    return _jpeg_size(frame) if frame.startswith(START) else None


def _jpeg_size(frame: bytes) -> tuple[int, int, int]:
    """Return `codestream_size` of JPEG and JPEG-LS, whose start of frame follows other segments."""
    for marker, at, _ in segments_of(frame):
        if marker in FRAMES:
            rows, columns = (int.from_bytes(frame[offset : offset + 2], "big") for offset in (at + 3, at + 5))
            return (rows, columns, frame[at + 7]) if at + 8 <= len(frame) else (0, 0, 0)
    return 0, 0, 0


def segments_of(frame: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield the marker, the first byte behind it and the length of each segment up to the first scan or tile."""
    at = 2
    while at + 4 <= len(frame) and frame[at] == 0xFF:
        marker = frame[at + 1]
        if marker == 0xFF:  # fill bytes
            at += 1
        elif marker in WITHOUT_LENGTH:
            at += 2
        else:
            length = max(2, int.from_bytes(frame[at + 2 : at + 4], "big"))
            yield marker, at + 2, length
            if marker in (SCAN, TILE):
                return
            at += 2 + length
