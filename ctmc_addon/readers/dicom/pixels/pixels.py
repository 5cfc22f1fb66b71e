# SPDX-License-Identifier: GPL-3.0-or-later
"""Read or decode the pixels of one DICOM frame, and scale them into a slice of the volume.

pydicom and pylibjpeg decode; uncompressed pixels are read as they are stored.

Rescaling happens in the type of the output (DICOM PS3.3 C.11.1: value = slope * stored + intercept).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError
from ...optional_imports import needed, quiet, reason
from ..deflated import DEFLATED
from ..frames import FrameGeometry
from ..header import EXPLICIT_LITTLE, IMPLICIT_LITTLE, PIXEL_KEYWORDS, ImageFile, pydicom_errors
from .codestream import frame_damage, is_reversible
from .pixel_format import value_bits

# The types of pixels by their representation, 1 with a sign, and their bits.
LITTLE_ENDIAN = {(sign, bits): np.dtype(f"<{'ui'[sign]}{bits // 8}") for sign in (0, 1) for bits in (8, 16, 32)}


class DoesNotFit(Exception):
    """A value outside the output's type; the volume is read again into a wider one."""


class SliceRead(NamedTuple):
    """The range and the padding of one slice that was filled."""

    lowest: float  # Lowest pixel that is not padding; infinity without one.
    padded: int


def check_codec(image: ImageFile) -> None:
    """Raise a `ReadError` before decoding if the library for a file's transfer syntax is missing."""
    pixels = needed("pydicom.pixels", "pydicom", "DICOM")
    name = syntax_name(image.pixels.syntax)
    try:
        with quiet():
            decoder = pixels.get_decoder(image.pixels.syntax)
    except NotImplementedError as error:
        raise ReadError(
            f"{image.path.name} is compressed as '{name}', which pydicom cannot decode; export it uncompressed"
        ) from error
    if not decoder.is_available:
        raise ReadError(
            f"{image.path.name} is compressed as '{name}', and the library for it is missing; "
            "install pylibjpeg with pylibjpeg-libjpeg and pylibjpeg-openjpeg"
        )


def syntax_name(syntax: str) -> str:
    """Return the transfer syntax in words, or its UID where it is a private one."""
    with quiet():  # a damaged one
        return str(needed("pydicom.uid", "pydicom", "DICOM").UID(syntax).name)


def stored_frames(image: ImageFile, frames: Sequence[int]) -> Iterator[NDArray[Any]]:
    """Yield the pixels as stored, unused high bits removed; the file is opened once.

    Parameters
    ----------
    image : ImageFile
    frames : sequence of int
        Numbers of the frames, from 0 on.

    Returns
    -------
    iterator of (rows, columns) arrays

    Raises
    ------
    ReadError
        If pixels are missing, damaged or compressed in a way that no installed library unpacks.
    """
    syntax, options = image.pixels.syntax, image.pixels.options
    plain = plain_type(image)
    if plain is not None:
        yield from plain_frames(image, frames, plain)
        return
    pydicom = needed("pydicom", "pydicom", "DICOM")
    try:
        decoder = needed("pydicom.pixels", "pydicom", "DICOM").get_decoder(syntax)
        with image.path.open("rb") as file:
            source: Any = file
            exact = [False] * len(frames)
            if syntax == DEFLATED:  # its pixels are at their place only when the file is unpacked
                source = pydicom.dcmread(file, specific_tags=list(PIXEL_KEYWORDS))[options["pixel_keyword"]].value
            else:
                if image.pixels.compressed:
                    exact = _checked_codestreams(image, frames, file)
                file.seek(image.pixels.start)
            options = {**options, "view_only": True, "correct_unused_bits": False}
            decoded = decoder.iter_array(source, indices=frames, **options)
            for (stored, _), is_exact in zip(decoded, exact, strict=True):
                if stored.shape != (image.rows, image.columns):
                    raise ReadError(
                        f"the pixels of {image.path.name} are {stored.shape}, and its header says "
                        f"{(image.rows, image.columns)}; copy it again"
                    )
                native = stored if stored.dtype.isnative else stored.astype(stored.dtype.newbyteorder("="))
                yield value_bits(native, image.pixels, is_exact)
    except pydicom_errors() as error:
        if isinstance(error, OSError) and error.errno is not None:  # the system's
            raise
        why = reason(error)
        if why.startswith("Unable to decode"):  # It lists the decoders that pydicom tried.
            raise ReadError(
                f"the pixels of {image.path.name} ({syntax_name(syntax)}) cannot be decoded: they are damaged, or "
                "pylibjpeg does not support them; copy the file again, or export it uncompressed"
            ) from error
        raise ReadError(
            f"the pixels of {image.path.name} ({syntax_name(syntax)}) are truncated or damaged ({why}); copy it again"
        ) from error


def plain_type(image: ImageFile) -> np.dtype[Any] | None:
    """Return the type of pixels that can be read as stored; None if pydicom has to decode them."""
    pixels, options = image.pixels, image.pixels.options
    as_in_memory = pixels.syntax in (IMPLICIT_LITTLE, EXPLICIT_LITTLE) and image.gray and not pixels.floating
    return LITTLE_ENDIAN.get((options["pixel_representation"], options["bits_allocated"])) if as_in_memory else None


def plain_frames(image: ImageFile, frames: Sequence[int], dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    """Yield `stored_frames` of the type that `plain_type` gives."""
    count = image.rows * image.columns
    with image.path.open("rb", buffering=0) as file:
        for number in frames:
            file.seek(image.pixels.start + number * count * dtype.itemsize)
            stored = np.fromfile(file, dtype, count)
            if stored.size < count:
                raise ReadError(
                    f"the pixels of {image.path.name} ({syntax_name(image.pixels.syntax)}) are truncated or damaged "
                    f"({stored.size} of {count}); copy it again"
                )
            plane = stored.reshape(image.rows, image.columns).astype(dtype.newbyteorder("="), copy=False)
            yield value_bits(plane, image.pixels)


def _checked_codestreams(image: ImageFile, frames: Sequence[int], file: Any) -> list[bool]:
    """Check frames before they are decoded; return for each whether it gives exactly the compressed pixels.

    Raises
    ------
    ReadError
        If a frame is cut off, or of another size than the header says.
    """
    encaps = needed("pydicom.encaps", "pydicom", "DICOM")
    options = image.pixels.options
    exact = []
    for number in frames:
        file.seek(image.pixels.start)
        frame = encaps.get_frame(
            file, number, extended_offsets=options.get("extended_offsets"), number_of_frames=options["number_of_frames"]
        )
        damage = frame_damage(frame, image.rows, image.columns, int(options.get("samples_per_pixel") or 1))
        if damage:
            raise ReadError(
                f"the pixels of {image.path.name} ({syntax_name(image.pixels.syntax)}) are truncated or damaged "
                f"({damage}); copy it again"
            )
        exact.append(is_reversible(frame))
    return exact


def output_types(frames: list[FrameGeometry], floating: bool) -> tuple[Any, ...]:
    """Return the types to try for the volume, the smallest first: integers stay integers if slopes allow it."""
    whole = all(frame.slope.is_integer() and frame.intercept.is_integer() for frame in frames)
    return (np.int16, np.int32, np.float32) if whole and not floating else (np.float32,)


def padding_mark(dtype: Any) -> Any:
    """Return the value that marks padding until the lowest real value is known.

    The type's own lowest value: a real pixel that holds it is then the lowest anyway.
    """
    return np.iinfo(dtype).min if np.issubdtype(dtype, np.integer) else np.float32(-np.inf)


def real_ends(
    stored: NDArray[Any], geometry: FrameGeometry, padding: tuple[int, int] | None
) -> tuple[float, float, NDArray[np.bool_] | None]:
    """Return the range of the pixels that are not padding.

    Parameters
    ----------
    stored : (rows, columns) integers
    geometry : FrameGeometry
        It has slope and intercept.
    padding : (low, high) int, optional
        Stored values that are padding.

    Returns
    -------
    lowest and highest scaled value, and a (rows, columns) bool array of padding or None
    """
    real, padded = stored, None
    if padding is not None:
        low, high = padding
        padded = (stored >= low) & (stored <= high) if low < high else stored == low
        if padded.any():
            real = stored[~padded]
        else:
            padded = None
    if not real.size:
        return float("inf"), float("-inf"), padded
    ends = [end.item() * geometry.slope + geometry.intercept for end in (real.min(), real.max())]
    return min(ends), max(ends), padded


def fill_slice(
    stored: NDArray[Any],
    geometry: FrameGeometry,
    padding: tuple[int, int] | None,
    out: NDArray[Any],
    fits: bool = False,
) -> SliceRead:
    """Rescale one frame; padding becomes `padding_mark`.

    Parameters
    ----------
    stored : (rows, columns) integers
    geometry : FrameGeometry
        It has slope and intercept.
    padding : (low, high) int, optional
        Stored values that are padding.
    out : (rows, columns) int16, int32 or float32
        Is filled.
    fits : bool
        Whether it is known that there is no padding and that all values fit; they are not looked at then.

    Raises
    ------
    DoesNotFit
        If a value is outside the type of `out`.
    """
    if fits:
        _rescale(stored, geometry.slope, geometry.intercept, out)
        return SliceRead(float("inf"), 0)
    low, high, padded = real_ends(stored, geometry, padding)
    if not low > high:  # as where all is padding; floats may be NaN
        if out.dtype.kind == "i" and (low < np.iinfo(out.dtype).min or high > np.iinfo(out.dtype).max):
            raise DoesNotFit
        _rescale(stored, geometry.slope, geometry.intercept, out)
    if padded is None:
        return SliceRead(low, 0)
    out[padded] = padding_mark(out.dtype)
    return SliceRead(low, int(padded.sum()))


def _rescale(stored: NDArray[Any], slope: float, intercept: float, out: NDArray[Any]) -> None:
    if out.dtype.kind == "f":
        out[...] = stored.astype(np.float64) * slope + intercept
        return
    # Integers wrap: where the result fits, so does that of wrapped terms. Padding may not fit; it is overwritten next.
    same_size = stored.dtype.itemsize == out.dtype.itemsize
    whole = stored.view(out.dtype) if same_size else stored.astype(out.dtype)
    if (slope, intercept) == (1.0, 0.0):
        out[...] = whole
        return
    factor, summand = np.array([int(slope), int(intercept)]).astype(out.dtype)
    np.add(whole if slope == 1.0 else whole * factor, summand, out=out)
