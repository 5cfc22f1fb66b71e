# SPDX-License-Identifier: GPL-3.0-or-later
"""Check the numbers that describe a DICOM file's pixels, and take values from their bits.

Clauses are those of DICOM PS3.5.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..deflated import DEFLATED
from ..labels.elements import UNDEFINED_LENGTH

SMALLEST_FRAME = 8  # A compressed frame has more bytes than this, the header of its item.
WHOLE_BITS, FLOAT_BITS = (1, 8, 16, 32, 64), {"FloatPixelData": 32, "DoubleFloatPixelData": 64}
# JPEG, JPEG-LS near-lossless, JPEG 2000 and HTJ2K, whose values may be a little beyond those that were compressed.
LOSSY = {f"1.2.840.10008.1.2.4.{number}" for number in (50, 51, 81, 91, 203)}
OVERSHOOT = 1 / 16  # Lossy codecs overshoot by at most this share of the range of values.
MOST_OVERSHOT = 4  # Overshot pixels for each one as near before the end, because errors go both ways.
AROUND = 4  # Both are counted within this many pixels to each side.
FARTHEST = 16  # Connected pixels up to this many away overshot too.


class Pixels(NamedTuple):
    """The storage of a file's pixels."""

    syntax: str  # Transfer syntax UID.
    compressed: bool
    floating: bool
    padding: tuple[int, int] | None  # Stored values from the first to the second mean 'no pixel'.
    start: int  # Byte of the file at which the pixels begin.
    options: Mapping[str, Any]  # Rows, columns, bits and so on for pydicom's decoders.
    high_bit: Any = None  # As in the header; None if it has none.


def unusable_number(options: Mapping[str, Any]) -> str:
    """Describe the first number of a header that no pixels can have; return empty text if all are usable.

    Color images are not read, and of theirs the size alone is checked.

    Parameters
    ----------
    options : mapping of str to object
        As of `Pixels`, with the keyword of the pixels.

    Examples
    --------
    >>> gray = {"rows": 5, "columns": 7, "number_of_frames": 1, "samples_per_pixel": 1, "pixel_keyword": "PixelData"}
    >>> unusable_number(gray | {"bits_allocated": 4096, "bits_stored": 12, "pixel_representation": 0})
    'BitsAllocated is 4096, and it must be 1, 8, 16, 32 or 64'
    """
    for keyword, side in (("Rows", options["rows"]), ("Columns", options["columns"])):
        if not 1 <= side <= 0xFFFF:
            return f"{keyword} is {side}, and it must be from 1 to 65535"
    frames = options["number_of_frames"]
    if frames < 1:
        return f"NumberOfFrames is {frames}, and it must be 1 or more"
    samples = options.get("samples_per_pixel", 1)
    if samples not in (1, 3, 4):
        return f"SamplesPerPixel is {shown(samples)}, and it must be 1"
    if samples != 1:
        return ""
    bits: int = options["bits_allocated"]
    stored, sign = options.get("bits_stored"), options.get("pixel_representation")
    floating = FLOAT_BITS.get(options["pixel_keyword"])
    if floating is not None:
        return "" if bits == floating else f"BitsAllocated is {bits}, and it must be {floating}"
    if bits not in WHOLE_BITS:
        return f"BitsAllocated is {bits}, and it must be 1, 8, 16, 32 or 64"
    if not isinstance(stored, int) or not 1 <= stored <= bits:
        return f"BitsStored is {shown(stored)}, and with BitsAllocated {bits} it must be from 1 to {bits}"
    if not isinstance(sign, int) or sign not in (0, 1):
        return f"PixelRepresentation is {shown(sign)}, and it must be 0 or 1"
    return ""


def shown(number: Any) -> str:
    """Return a number of a header in words; other values are not quoted, because they may be long."""
    return "missing" if number is None else str(number) if isinstance(number, int) else "not one whole number"


def high_bit_notes(all_pixels: Iterable[Pixels]) -> list[str]:
    """Return a note if HighBit is not the highest of BitsStored bits (8.1.1), which does not change the values."""
    counts = Counter(
        (shown(pixels.high_bit), int(pixels.options["bits_stored"]))
        for pixels in all_pixels
        if not pixels.floating and pixels.high_bit not in (None, pixels.options["bits_stored"] - 1)
    )
    if not counts:
        return []
    (high_bit, stored), _ = counts.most_common(1)[0]
    return [
        f"HighBit is {high_bit} (slices: {counts.total()}), and with BitsStored {stored} it must be {stored - 1}: "
        f"the lowest {stored} bits are the value"
    ]


def missing_pixels(pixels: Pixels, length: int, file_bytes: int) -> str:
    """Describe the pixels that are missing from a file; return empty text if none are.

    Parameters
    ----------
    pixels : Pixels
        Their description in the header.
    length : int
        Bytes of the pixel element.
    file_bytes : int
        Bytes of the file.
    """
    options, frames = pixels.options, pixels.options["number_of_frames"]
    if pixels.compressed:
        return f"{frames} frames in {file_bytes} bytes" if frames * SMALLEST_FRAME > file_bytes else ""
    if length == UNDEFINED_LENGTH:
        return f"compressed pixels under the uncompressed transfer syntax {pixels.syntax}"
    halved = "422" in str(options["photometric_interpretation"])  # two color samples for every second pixel
    size = options["rows"] * options["columns"] * (2 if halved else options.get("samples_per_pixel") or 1)
    needed_bytes = (frames * size * options["bits_allocated"] + 7) // 8
    present_bytes = length if pixels.syntax == DEFLATED else min(length, file_bytes - pixels.start)
    return f"{max(0, present_bytes)} of {needed_bytes} bytes of pixels" if present_bytes < needed_bytes else ""


def padding_ends(elements: Any, options: Mapping[str, Any]) -> tuple[int, int] | None:
    """Return the lowest and the highest value of BitsStored bits that means 'no pixel'."""
    padding, limit = elements.get("PixelPaddingValue", None), elements.get("PixelPaddingRangeLimit", None)
    signed, allocated = bool(options.get("pixel_representation", 0)), options["bits_allocated"]
    ends = [as_stored(value, allocated, signed) for value in (padding, padding if limit is None else limit)]
    whole = [end for end in ends if end is not None]
    if len(whole) < 2:
        return None
    bits = options.get("bits_stored") or allocated  # floats have none
    low, high = (_low_bits(end, bits, signed) for end in sorted(whole))
    # A range across a multiple of 2**bits would become the rest of all values.
    return (low, high) if high - low == max(whole) - min(whole) else (min(whole), max(whole))


def as_stored(value: Any, bits: int, signed: bool) -> int | None:
    """Return a padding value as the pixels hold it: scanners write 63536 where signed pixels have -2000.

    Parameters
    ----------
    value : int or bytes or None
        As pydicom gives it.
    bits : int
        Bits of a pixel.
    signed : bool
        Whether pixels are signed.

    Returns
    -------
    int or None
        None where the element is missing or holds no number.

    Examples
    --------
    >>> as_stored(63536, 16, True)
    -2000
    """
    if value is None:
        return None
    number = int.from_bytes(value[: (bits + 7) // 8], "little") if isinstance(value, bytes) else int(value)
    return _low_bits(number, bits, signed)


def _low_bits(number: int, bits: int, signed: bool) -> int:
    """Return the lowest bits of a whole number as a number, the highest of them its sign if it has one."""
    number %= 1 << bits
    return number - (1 << bits) if signed and number >= 1 << (bits - 1) else number


def value_range(pixels: Pixels) -> tuple[int, int]:
    """Return the lowest and the highest whole number that BitsStored bits hold, with or without a sign."""
    bits, signed = (pixels.options[name] for name in ("bits_stored", "pixel_representation"))
    return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)


def value_bits(stored: NDArray[Any], pixels: Pixels, exact: bool = False) -> NDArray[Any]:
    """Return pixels without the bits above BitsStored, which may hold overlays or anything else (PS3.5 8.1.1).

    The highest bit of BitsStored is the sign, if there is one. Values that a lossy codec overshot take the nearest end.

    Parameters
    ----------
    stored : (rows, columns) array
        As a decoder gives them, of at least as many bits; changed in place if it is writable.
    pixels : Pixels
    exact : bool
        Whether the pixels are those that were compressed, although the transfer syntax allows others.

    Examples
    --------
    >>> options = {"bits_stored": 12, "pixel_representation": 1}
    >>> pixels = Pixels("1.2.840.10008.1.2.4.90", True, False, None, 0, options)
    >>> value_bits(np.array([[0xF7FF, 0x0830]], np.uint16).view(np.int16), pixels).tolist()
    [[2047, -2000]]
    """
    unused = 8 * stored.dtype.itemsize - pixels.options["bits_stored"]
    if pixels.floating or unused <= 0:
        return stored
    low, high = value_range(pixels)
    above, below = None, None
    if pixels.syntax in LOSSY and not exact:
        margin = int((high - low) * OVERSHOOT)
        above = _overshot(stored > high, stored > high - margin, stored <= high + margin)
        below = _overshot(stored < low, stored < low + margin, stored >= low - margin)
    out = stored if stored.flags.writeable else None
    shifted = np.left_shift(stored, unused, out=out)
    values = np.right_shift(shifted, unused, out=shifted)
    for pixels_beyond, end in ((above, high), (below, low)):
        if pixels_beyond is not None:
            values[pixels_beyond] = end
    return values


def _overshot(
    beyond: NDArray[np.bool_], past: NDArray[np.bool_], within: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """Return the pixels that a lossy codec pushed beyond an end of the range of values; None without any beyond.

    Errors of a codec are small and go both ways, so a saturated body also has pixels just before the end, and those
    that overshot are connected with them. Overlays on air are just beyond the end too, without such pixels.

    Parameters
    ----------
    beyond : (rows, columns) bool
        Pixels beyond the end.
    past : (rows, columns) bool
        Pixels beyond the end, or less than the largest error before it.
    within : (rows, columns) bool
        Pixels up to the largest error beyond the end, or anywhere before it.
    """
    if not beyond.any():
        return None
    near, small = past & ~beyond, beyond & within
    reached = near & (around(small) <= MOST_OVERSHOT * around(near))
    for _ in range(FARTHEST):
        wider = (around(reached, 1) > 0) & small | reached
        if np.array_equal(wider, reached):
            break
        reached = wider
    return reached & small


def around(mask: NDArray[np.bool_], reach: int = AROUND) -> NDArray[np.int64]:
    """Return the number of pixels of a mask in the square around each pixel, `reach` to each side.

    Examples
    --------
    >>> around(np.array([[True, False, False], [True, False, False]]), 1).tolist()
    [[2, 2, 0], [2, 2, 0]]
    """
    counts = mask.astype(np.int64)
    for axis in (0, 1):
        size = counts.shape[axis]
        sums = np.concatenate([np.zeros_like(counts.take([0], axis)), counts.cumsum(axis)], axis)
        last, first = np.minimum(np.arange(size) + reach + 1, size), np.maximum(np.arange(size) - reach, 0)
        counts = sums.take(last, axis) - sums.take(first, axis)
    return counts
