# SPDX-License-Identifier: GPL-3.0-or-later
"""Read gray values of one PNG, JPEG, JPEG 2000 or BMP slice as stored, by imageio and its Pillow plugin.

Color pictures are read only if all their channels are equal.
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ..optional_imports import needed, reason
from ..registry import HEAD, marked
from .jpeg2000 import check_pixels, depth_of
from .tiff_axes import TiffMetadata

DECODED = "PNG, JPEG, JPEG 2000 and BMP"
KINDS = ("PNG", "JPEG", "JPEG 2000", "BMP", "TIFF")  # A TIFF may have the suffix of another picture.
PILLOW_ERRORS = (
    OSError,
    ValueError,
    EOFError,
    SyntaxError,
    LookupError,
    struct.error,
    zlib.error,
)  # Errors that imageio and Pillow raise, besides Pillow's bomb error.
# The type of the values by that of the pixels; older Pillow widens 16 bits to int32.
DTYPES = {"bool": "uint8", "uint8": "uint8", "uint16": "uint16", "int32": "uint16"}
PNG_DEPTH, PNG_COLOR = 24, 25  # Bytes of a PNG with the bits of a sample and the kind of a pixel.
PNG_GRAY, PNG_PALETTE = 0, 3
SPREAD = {2: 85, 4: 17}  # Pillow multiplies gray values of this many bits by this.
JPEG_NOISE = 2  # JPEG's rounding separates the channels of a gray picture by so much, of 255.


class Picture(NamedTuple):
    """The header of an image file."""

    path: Path
    rows: int
    columns: int
    dtype: np.dtype[Any]
    pages: int
    kind: str  # Name of the format; empty for TIFF.
    decode_as: str | None = None  # Pillow's name of the type to decode to, if it is another
    spread: int = 1  # Pillow multiplies values by it, so that 2 or 4 bits fill 8.
    metadata: TiffMetadata = TiffMetadata()
    page: int = 0  # Number of the page of a TIFF.


def picture(path: Path) -> Picture:
    """Read the header of a picture."""
    iio = needed("imageio.v3", "imageio", DECODED)
    pillow = needed("PIL.Image", "Pillow", DECODED)
    try:
        with path.open("rb") as file:
            head = file.read(HEAD)
            kind = "BMP" if head.startswith(b"BM") else marked(head)
            if kind not in KINDS:  # Pillow would ask Ghostscript for some other kinds.
                raise ReadError(f"{path.name} holds no {DECODED.replace('and', 'or')}; save it as 8 or 16 bit gray PNG")
            file.seek(0)
            with iio.imopen(file, "r", plugin="pillow") as image:
                about = image.properties(index=0)
    except AttributeError as error:  # imageio asks the palette, which is not there
        raise ReadError(f"{path.name} is a palette picture without its palette; copy or export it again") from error
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise ReadError(f"{path.name} is not a readable image ({_image_reason(error)}); copy it again") from error
    rows, columns, *channels = about.shape
    bits, color = head[PNG_DEPTH : PNG_COLOR + 1] if kind == "PNG" else (8, PNG_GRAY)
    if bits == 16 and color not in (PNG_GRAY, PNG_PALETTE):
        raise ReadError(f"{path.name} has 16 bit color or an alpha channel; save it as 16 bit gray without alpha")
    if about.dtype.name not in DTYPES:
        raise ReadError(f"{path.name} has pixels of type {about.dtype}; save it as 8 or 16 bit gray")
    dtype = np.dtype(DTYPES[about.dtype.name])
    if kind == "JPEG 2000":
        check_pixels(path, rows * columns)
        depth = depth_of(path)
        dtype = dtype if channels else depth.dtype
    decode_as = "RGBA" if channels else "L" if about.dtype == bool else None
    return Picture(path, rows, columns, dtype, 1, kind, decode_as, SPREAD.get(bits, 1) if color == PNG_GRAY else 1)


def _image_reason(error: BaseException) -> str:
    """Return Pillow's error text without the object or path that it may name; imageio's own says nothing."""
    cause = error.__cause__ or error
    is_unknown = "cannot identify" in str(cause) or type(cause).__name__ == "InitializationError"
    return "unknown content" if is_unknown else reason(cause)


def gray_slice(header: Picture) -> NDArray[Any]:
    """Return the gray values (rows, columns) of a picture of one page."""
    iio = needed("imageio.v3", "imageio", DECODED)
    pillow = needed("PIL.Image", "Pillow", DECODED)
    try:
        # The bytes: imageio would take some names for addresses or archives.
        content = header.path.read_bytes()
        with pillow.open(io.BytesIO(content)) as image:
            image.verify()  # Check sums of PNG, which imageio passes over.
        pixels = iio.imread(content, plugin="pillow", index=0, mode=header.decode_as)
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise ReadError(
            f"{header.path.name} is truncated or damaged ({_image_reason(error)}); copy it again"
        ) from error
    if pixels.dtype.kind == "i" and pixels.min() >= 0 and pixels.max() <= 65535:
        pixels = pixels.astype(np.uint16)  # older Pillow widens 16 bit PNG to int32
    if header.kind == "JPEG 2000" and header.decode_as is None:
        pixels = depth_of(header.path).as_stored(pixels)
    if header.spread > 1:
        pixels = pixels // np.uint8(header.spread)
    lossy = header.kind in ("JPEG", "JPEG 2000")
    return gray(pixels, header.path.name, JPEG_NOISE if lossy else 0)


def gray(pixels: NDArray[Any], name: str, tolerance: int) -> NDArray[Any]:
    """Return the gray values of a picture.

    Parameters
    ----------
    pixels : (rows, columns) or (rows, columns, channels) integers
    name : str
        Of the file, for errors.
    tolerance : int
        By how much channels may differ.

    Returns
    -------
    (rows, columns) integers

    Raises
    ------
    ReadError
        If the picture is colored or transparent.
    """
    if pixels.ndim == 2:
        return pixels
    channels = pixels.shape[-1] if pixels.ndim == 3 else 0
    if channels not in (1, 2, 3, 4):
        raise ReadError(f"{name} has the shape {pixels.shape}, and a slice is rows x columns; save it as gray")
    if channels in (2, 4) and (pixels[..., -1] != pixels[..., -1].max()).any():
        raise ReadError(f"{name} is partly transparent; flatten it to gray without an alpha channel")
    first = pixels[..., 0]
    for channel in range(1, 3 if channels > 2 else 1):
        low, high = np.minimum(first, pixels[..., channel]), np.maximum(first, pixels[..., channel])
        difference = (high - low).max()
        if difference > tolerance:
            raise ReadError(
                f"{name} is colored (its channels differ by up to {difference:g}); convert the slices to gray values"
            )
    return first
