"""One DICOM frame's pixels: from the file's bytes to grey values in a slice of the volume.

Uncompressed pixels are read straight from the file; everything else is pydicom's, with pylibjpeg.
Rescaling happens in the type of the output (DICOM PS3.3 C.11.1: value = slope * stored + intercept).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError
from ..optional_imports import needed, quiet, reason
from .frames import FrameGeometry
from .header import DEFLATED, WHAT, ImageFile, pydicom_errors


class DoesNotFit(Exception):
    """A value outside the output's type; the volume is read again into a wider one."""


class SliceRead(NamedTuple):
    """What was seen while one slice was filled."""

    lowest: float  # of the pixels that are no padding; infinity where there are none
    padded: int


def check_codec(image: ImageFile) -> None:
    """Say which library is missing for a compressed file's transfer syntax, before anything is decoded."""
    pixels = needed("pydicom.pixels", "pydicom", WHAT)
    name = syntax_name(image.pixels.syntax)
    try:
        with quiet():
            decoder = pixels.get_decoder(image.pixels.syntax)
    except pydicom_errors() as error:
        raise ReadError(
            f"{image.path.name} is compressed as '{name}', which pydicom cannot decode; export it uncompressed"
        ) from error
    if not decoder.is_available:
        raise ReadError(
            f"{image.path.name} is compressed as '{name}', and the library for it is missing; "
            "install pylibjpeg with pylibjpeg-libjpeg and pylibjpeg-openjpeg"
        )


def syntax_name(syntax: str) -> str:
    """The transfer syntax in words, or its UID where it is a private one."""
    with quiet():
        return str(needed("pydicom.uid", "pydicom", WHAT).UID(syntax).name)


def stored_pixels(image: ImageFile, frame: int, out: NDArray[Any]) -> NDArray[Any]:
    """Pixels as stored, (rows, columns), unused high bits removed; in the memory of `out` where they fit into it."""
    pixels = image.pixels
    if pixels.start is None or pixels.allocated not in (8, 16, 32):
        return _decoded(image, frame)
    dtype = np.dtype(f"{'>' if pixels.big_endian else '<'}{'i' if pixels.signed else 'u'}{pixels.allocated // 8}")
    found = out.view(dtype) if out.dtype.itemsize == dtype.itemsize else np.empty(out.shape, dtype)
    start = frame * found.nbytes
    with image.path.open("rb") as file:
        file.seek(pixels.start + start)
        there = file.readinto(found.reshape(-1).view(np.uint8).data)
    if there < found.nbytes or pixels.size < start + found.nbytes:
        there = min(start + there, pixels.size)
        wanted = len(image.frames) * found.nbytes
        raise ReadError(f"{image.path.name} is truncated: {there} of {wanted} bytes of pixels; copy it again")
    if not dtype.isnative:
        found = found.byteswap(inplace=True).view(dtype.newbyteorder("="))
    shift = pixels.allocated - pixels.stored
    if shift > 0:  # PS3.5 8.1.1: bits above BitsStored may hold anything
        np.left_shift(found, shift, out=found)
        np.right_shift(found, shift, out=found)
    return found


def _decoded(image: ImageFile, frame: int) -> NDArray[Any]:
    pydicom = needed("pydicom", "pydicom", WHAT)
    index = frame if len(image.frames) > 1 else None
    try:
        # pydicom finds the pixels by their place in the file, which deflated files do not have.
        source = pydicom.dcmread(image.path) if image.pixels.syntax == DEFLATED else image.path
        found: NDArray[Any] = pydicom.pixels.pixel_array(source, index=index)
    except pydicom_errors() as error:
        name = syntax_name(image.pixels.syntax)
        raise ReadError(
            f"the pixels of {image.path.name} ({name}) are truncated or damaged ({reason(error)}); copy it again"
        ) from error
    if found.shape != (image.rows, image.columns):
        raise ReadError(
            f"the pixels of {image.path.name} are {found.shape}, and its header says "
            f"{(image.rows, image.columns)}; copy it again"
        )
    return found


def output_type(frames: list[FrameGeometry], floating: bool) -> tuple[Any, ...]:
    """Types to try for the volume, the smallest first: integers stay integers where slopes allow it."""
    whole = all(frame.slope.is_integer() and frame.intercept.is_integer() for frame in frames)
    return (np.int16, np.int32, np.float32) if whole and not floating else (np.float32,)


def padding_mark(dtype: Any) -> Any:
    """What stands for padding until the lowest real value is known.

    The type's own lowest value: a real pixel that holds it is then the lowest anyway.
    """
    return np.iinfo(dtype).min if np.issubdtype(dtype, np.integer) else np.float32(-np.inf)


def fill_slice(image: ImageFile, frame: int, out: NDArray[Any]) -> SliceRead:
    """Decode and rescale one frame into `out` (rows, columns); padding becomes `padding_mark`."""
    stored = stored_pixels(image, frame, out)
    geometry = image.frames[frame]
    padding: NDArray[np.bool_] | None = None
    real = stored
    if image.pixels.padding is not None:
        low, high = image.pixels.padding
        padding = (stored >= low) & (stored <= high) if low < high else stored == low
        padding = padding if padding.any() else None
    if padding is not None:
        real = stored[~padding]
    if not real.size:
        out[...] = padding_mark(out.dtype)
        return SliceRead(float("inf"), stored.size)
    ends = [
        real.min().item() * geometry.slope + geometry.intercept,
        real.max().item() * geometry.slope + geometry.intercept,
    ]
    _rescale(stored, geometry.slope, geometry.intercept, min(ends), max(ends), out)
    if padding is None:
        return SliceRead(min(ends), 0)
    out[padding] = padding_mark(out.dtype)
    return SliceRead(min(ends), int(padding.sum()))


def _rescale(stored: NDArray[Any], slope: float, intercept: float, low: float, high: float, out: NDArray[Any]) -> None:
    if out.dtype.kind == "f":
        out[...] = stored.astype(np.float64) * slope + intercept
        return
    limits = np.iinfo(out.dtype)
    if low < limits.min or high > limits.max:
        raise DoesNotFit
    if (slope, intercept) == (1.0, 0.0) and np.may_share_memory(stored, out):
        return
    if slope == 1.0 and stored.dtype.itemsize == out.dtype.itemsize:
        # Integers wrap: where the sum fits, so does the sum of wrapped terms.
        np.add(stored.view(out.dtype), np.array(int(intercept)).astype(out.dtype), out=out)
        return
    # Padding may not fit and wraps; it is overwritten next.
    out[...] = (stored.astype(np.int64) * int(slope) + int(intercept)).astype(out.dtype)
