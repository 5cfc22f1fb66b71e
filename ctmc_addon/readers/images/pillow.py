# SPDX-License-Identifier: GPL-3.0-or-later
"""One PNG, JPEG or BMP slice to gray values as they stand in the file, decoded by imageio with Pillow.

Color is taken where it is gray, and only then.
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
from ..file_formats import suffix
from ..optional_imports import needed, reason
from ..registry import FORMATS
from .jpeg2000 import check_pixels, depth_of
from .tiff_axes import TiffMetadata

DECODED = "PNG, JPEG, JPEG 2000 and BMP"
JPEG, JPEG_2000 = FORMATS["JPEG"].suffixes, FORMATS["JPEG 2000"].suffixes
GRAY_MODES = ("L", "I;16")
# Of Pillow's modes those that are decoded in another one, and the type of the values of every mode that is read.
DECODE_AS = {"1": "L", "P": "RGBA", "LA": "RGBA", "PA": "RGBA", "RGBX": "RGB", "CMYK": "RGB", "YCbCr": "RGB"}
DTYPES = dict.fromkeys((*DECODE_AS, "L", "RGB", "RGBA"), "uint8")
DTYPES |= dict.fromkeys(("I", "I;16", "I;16B", "I;16L"), "uint16")
CUT_TO_8_BITS = ("LA;16B", "RGB;16B", "RGBA;16B")  # Pillow's names for what it would lose the low bits of
PILLOW_ERRORS = (
    OSError,
    ValueError,
    EOFError,
    SyntaxError,
    LookupError,
    struct.error,
    zlib.error,
)  # beside its bomb error
SPREAD = {"L;2": 85, "L;4": 17}  # of Pillow's names for gray of 2 and 4 bits
JPEG_NOISE = 2  # of 255: how far JPEG's rounding separates the channels of a gray picture


class Picture(NamedTuple):
    """Return the header of an image file."""

    path: Path
    rows: int
    columns: int
    dtype: np.dtype[Any]
    pages: int
    mode: str  # Pillow's; empty for TIFF
    spread: int = 1  # by which Pillow multiplies the values, so that 2 or 4 bits fill 8
    metadata: TiffMetadata = TiffMetadata()
    page: int = 0  # of a TIFF


def picture(path: Path) -> Picture:
    """Read the header alone."""
    pillow = needed("PIL.Image", "Pillow", DECODED)
    try:
        with path.open("rb") as file, pillow.open(file) as image:
            (columns, rows), mode = image.size, image.mode
            kind = image.format
            lacks_palette = mode in ("P", "PA") and image.palette is None
            stored = str(image.tile[0][3]) if image.format == "PNG" and image.tile else ""
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise ReadError(f"{path.name} is not a readable image ({image_reason(error)}); copy it again") from error
    if lacks_palette:
        raise ReadError(f"{path.name} is a palette picture without its palette; copy or export it again")
    if mode not in DTYPES:
        raise ReadError(f"{path.name} has pixels of Pillow's type '{mode}'; save it as 8 or 16 bit gray")
    if stored in CUT_TO_8_BITS:
        raise ReadError(f"{path.name} has 16 bit color or an alpha channel; save it as 16 bit gray without alpha")
    dtype = np.dtype(DTYPES[mode])
    if kind == "JPEG2000":
        check_pixels(path, rows * columns)
        depth = depth_of(path)
        dtype = depth.dtype if mode in GRAY_MODES else dtype
    return Picture(path, rows, columns, dtype, 1, mode, SPREAD.get(stored, 1))


def image_reason(error: BaseException) -> str:
    """Pillow's complaint, without the object or path that it may name."""
    return "unknown content" if "cannot identify" in str(error) else reason(error)


def gray_slice(header: Picture) -> NDArray[Any]:
    """Gray values (rows, columns) of a picture of one page."""
    iio = needed("imageio.v3", "imageio", DECODED)
    pillow = needed("PIL.Image", "Pillow", DECODED)
    try:
        # The bytes: imageio would take some names for addresses or archives.
        content = header.path.read_bytes()
        with pillow.open(io.BytesIO(content)) as image:
            image.verify()  # check sums of PNG, which decoding passes over
        pixels = iio.imread(content, plugin="pillow", mode=DECODE_AS.get(header.mode))
    except (*PILLOW_ERRORS, pillow.DecompressionBombError) as error:
        raise ReadError(f"{header.path.name} is truncated or damaged ({image_reason(error)}); copy it again") from error
    if pixels.dtype.kind == "i" and pixels.min() >= 0 and pixels.max() <= 65535:
        pixels = pixels.astype(np.uint16)  # older Pillow widens 16 bit PNG to int32
    if suffix(header.path) in JPEG_2000 and header.mode in GRAY_MODES:
        pixels = depth_of(header.path).as_stored(pixels)
    if header.spread > 1:
        pixels = pixels // np.uint8(header.spread)
    lossy = suffix(header.path) in (*JPEG, *JPEG_2000)
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
    for other in range(1, 3 if channels > 2 else 1):
        low, high = np.minimum(first, pixels[..., other]), np.maximum(first, pixels[..., other])
        difference = (high - low).max()
        if difference > tolerance:
            raise ReadError(
                f"{name} is colored (its channels differ by up to {difference:g}); convert the slices to gray values"
            )
    return first
