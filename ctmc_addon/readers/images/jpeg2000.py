# SPDX-License-Identifier: GPL-3.0-or-later
"""Read the depth and sign of a JPEG 2000 slice, whose values Pillow spreads over 8 or 16 bits: ITU T.800, annex A."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError

CODESTREAM = b"\xff\x4f\xff\x51"  # The markers SOC and SIZ.
END = b"\xff\xd9"
COMPONENT = 42  # This byte of the codestream has depth and sign of the first component.
HARMLESS = 1 << 20  # This many pixels are decoded in no time.
MOST_PIXELS_OF_A_BYTE = 1000  # Strong compression of a CT slice has 200.
MOST_HEADER = 1 << 16  # Bytes before the codestream.
MOST_BEHIND = 1 << 16  # Bytes after it.


class Depth(NamedTuple):
    """The depth and sign of the stored values of a JPEG 2000 picture."""

    bits: int
    signed: bool

    @property
    def dtype(self) -> np.dtype[Any]:
        """Return the type that holds the values."""
        return np.dtype(f"{'i' if self.signed else 'u'}{1 if self.bits <= 8 else 2}")

    def as_stored(self, pixels: NDArray[Any]) -> NDArray[Any]:
        """Convert Pillow's values, which begin at 0 and fill their type, to those stored in the file."""
        spread = 8 * pixels.dtype.itemsize - self.bits
        values = pixels.astype(np.int32) >> spread
        return (values - (1 << (self.bits - 1)) if self.signed else values).astype(self.dtype)


def check_pixels(path: Path, pixels: int) -> None:
    """Refuse a slice with far more pixels than its bytes can hold: its decoder would make room for all of them.

    Parameters
    ----------
    path : Path
    pixels : int
        Rows times columns, as its header says.

    Raises
    ------
    ReadError
        If they are too many.
    """
    size = path.stat().st_size
    if pixels > HARMLESS and pixels > MOST_PIXELS_OF_A_BYTE * size:
        raise ReadError(f"{path.name} claims {pixels} pixels in {size} bytes; copy or export it again")


def depth_of(path: Path) -> Depth:
    """Return depth and sign; raise `ReadError` for a truncated slice, of which decoders would make a picture too."""
    with path.open("rb") as file:
        head = file.read(MOST_HEADER)
        file.seek(max(0, file.seek(0, 2) - MOST_BEHIND))
        tail = file.read()
    at = head.find(CODESTREAM)
    component = head[at + COMPONENT] if 0 <= at < len(head) - COMPONENT else 0xFF
    bits = (component & 0x7F) + 1
    if bits > 16:
        raise ReadError(f"{path.name} is not a readable JPEG 2000 file of at most 16 bits; copy or export it again")
    ended = tail.rstrip(b"\x00").endswith(END) if at == 0 else END in tail
    if not ended:
        raise ReadError(f"{path.name} is truncated: the end of its pixels is missing; copy it again")
    return Depth(bits, bool(component & 0x80))
