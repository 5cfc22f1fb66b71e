"""One PNG, JPEG or BMP slice to grey values as they stand in the file, decoded by imageio with Pillow.

Colour is taken where it is grey, and only then.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ..file_formats import suffix
from ..optional_imports import BROKEN, needed, quiet, reason

DECODED = "PNG, JPEG and BMP"
# Pillow's modes, and the mode to decode them in; None leaves them as they are.
MODES: dict[str, tuple[str | None, str]] = {
    "1": ("L", "uint8"),
    "L": (None, "uint8"),
    "P": ("RGBA", "uint8"),
    "LA": ("RGBA", "uint8"),
    "PA": ("RGBA", "uint8"),
    "RGB": (None, "uint8"),
    "RGBA": (None, "uint8"),
    "RGBX": ("RGB", "uint8"),
    "CMYK": ("RGB", "uint8"),
    "YCbCr": ("RGB", "uint8"),
    "I": (None, "uint16"),
    "I;16": (None, "uint16"),
    "I;16B": (None, "uint16"),
    "I;16L": (None, "uint16"),
}
JPEG_NOISE = 2  # of 255: how far JPEG's rounding parts the channels of a grey picture


class Picture(NamedTuple):
    """What an image file's header says."""

    path: Path
    rows: int
    columns: int
    dtype: np.dtype[Any]
    pages: int
    mode: str  # Pillow's; empty for TIFF
    deep_colour: str  # Pillow's raw mode of 16 bit colour, which it would cut to 8 bits


def picture(path: Path) -> Picture:
    """Read the header alone."""
    pillow = needed("PIL.Image", "Pillow", DECODED)
    try:
        with quiet(), pillow.open(path) as image:
            (columns, rows), mode = image.size, image.mode
            raw = str(image.tile[0][3]) if image.format == "PNG" and image.tile else ""
    except (*BROKEN, pillow.DecompressionBombError) as error:
        raise ReadError(f"{path.name} is no readable image ({reason(error)}); copy it again") from error
    if mode not in MODES:
        raise ReadError(f"{path.name} has pixels of Pillow's type '{mode}'; save it as 8 or 16 bit grey")
    if raw == "LA;16B":
        raise ReadError(f"{path.name} is 16 bit grey with an alpha channel; save it without alpha")
    deep = raw if raw in ("RGB;16B", "RGBA;16B") else ""
    return Picture(path, rows, columns, np.dtype("uint16" if deep else MODES[mode][1]), 1, mode, deep)


def grey_slice(header: Picture) -> NDArray[Any]:
    """Grey values (rows, columns) of a picture of one page."""
    iio = needed("imageio.v3", "imageio", DECODED)
    try:
        if header.deep_colour:
            found = _deep_colour(header)
        else:
            # An open file: imageio would take some names for addresses or archives.
            with header.path.open("rb") as file:
                found = iio.imread(file, plugin="pillow", mode=MODES[header.mode][0])
    except BROKEN as error:
        raise ReadError(f"{header.path.name} is truncated or damaged ({reason(error)}); copy it again") from error
    if found.dtype.kind == "i" and found.min() >= 0 and found.max() <= 65535:
        found = found.astype(np.uint16)  # older Pillow widens 16 bit PNG to int32
    lossy = suffix(header.path) in (".jpg", ".jpeg")
    return grey(found, header.path.name, JPEG_NOISE if lossy else 0)


def _deep_colour(header: Picture) -> NDArray[Any]:
    """16 bit colour PNG in full: Pillow gives a byte of each number at a time, by the byte order it is told."""
    pillow = needed("PIL.Image", "Pillow", "PNG")
    found = np.zeros((header.rows, header.columns, len(header.deep_colour.split(";")[0])), np.uint16)
    for order, shift in (("B", 8), ("L", 0)):
        with pillow.open(header.path) as image:
            image.tile = [(*tile[:3], header.deep_colour[:-1] + order) for tile in image.tile]
            found |= np.asarray(image).astype(np.uint16) << np.uint16(shift)
    return found


def grey(found: NDArray[Any], name: str, tolerance: int) -> NDArray[Any]:
    """(rows, columns) of a picture whose channels, if it has several, are equal and opaque."""
    if found.ndim == 2:
        return found
    channels = found.shape[-1] if found.ndim == 3 else 0
    if channels not in (1, 2, 3, 4):
        raise ReadError(f"{name} has the shape {found.shape}, and a slice is rows x columns; save it as grey")
    if channels in (2, 4) and (found[..., -1] != found[..., -1].max()).any():
        raise ReadError(f"{name} is partly transparent; flatten it to grey without an alpha channel")
    first = found[..., 0]
    for other in range(1, 3 if channels > 2 else 1):
        low, high = np.minimum(first, found[..., other]), np.maximum(first, found[..., other])
        apart = (high - low).max()
        if apart > tolerance:
            raise ReadError(
                f"{name} is coloured (its channels differ by up to {apart:g}); convert the slices to grey values"
            )
    return first
