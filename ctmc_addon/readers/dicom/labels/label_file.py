# SPDX-License-Identifier: GPL-3.0-or-later
"""Open segmentations and structure sets, and convert the values of their elements.

Only elements that make labels are read, none about the patient.
"""

from __future__ import annotations

import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ....core import ReadError
from ...optional_imports import needed, quiet, reason
from ..deflated import DEFLATED, unpacks_without_end
from ..header import EXPLICIT_BIG, IMPLICIT_LITTLE
from .elements import Damaged, Elements, ElementWalker, after_meta
from .references import Reference

MOST_SHOWN = 20  # An error shows this many letters of a damaged value.


@contextmanager
def opened(path: Path) -> Iterator[tuple[ElementWalker, str]]:
    """Give a file's walker and transfer syntax; turn `Damaged` into a `ReadError` that names the file."""
    try:
        with path.open("rb") as file:
            syntax, start = after_meta(file)
            stream: IO[bytes] = file
            if syntax == DEFLATED:
                if unpacks_without_end(file):
                    raise ReadError(f"{path.name} unpacks to far more bytes than its size allows; copy it again")
                file.seek(start)
                stream = io.BytesIO(inflated(file.read()))
            if syntax == EXPLICIT_BIG:
                raise ReadError(f"{path.name} is stored in big endian, which is retired; convert it to little endian")
            head = file.read(8)[4:6] if not syntax else b""
            stream.seek(0 if syntax == DEFLATED else start)
            implicit = syntax == IMPLICIT_LITTLE or (not syntax and not head.isalpha())
            size = stream.seek(0, 2)
            stream.seek(0 if syntax == DEFLATED else start)
            yield ElementWalker(stream, size, implicit), syntax
    except Damaged as error:
        raise ReadError(f"{path.name} is truncated or damaged ({error}); copy or export it again") from error


def inflated(packed: bytes, most: int = 0) -> bytes:
    """Unpack bytes that were deflated without a header.

    Parameters
    ----------
    packed : bytes
    most : int
        Return no more bytes than these.
    """
    stream = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        plain = stream.decompress(packed, most)
    except zlib.error as error:
        raise Damaged(reason(error)) from error
    if not most and not stream.eof:
        raise Damaged("its deflated elements end too early")
    return plain


def decimals(value: bytes) -> NDArray[np.float64]:
    """Return the decimal numbers of a DS element."""
    words = value.rstrip(b"\0 ").split(b"\\")
    try:
        return np.fromiter(map(float, words), np.float64, len(words))
    except ValueError as error:
        raise Damaged(f"'{shown(value)}' instead of numbers") from error


def numbers(value: bytes, count: int) -> tuple[float, ...]:
    """Return decimal numbers of a size that occurs.

    Parameters
    ----------
    value : bytes
        A DS element.
    count : int
        How many there must be.

    Raises
    ------
    Damaged
        If there are others.
    """
    numbers = tuple(decimals(value).tolist())
    if len(numbers) != count or not all(abs(number) <= 1e6 for number in numbers):  # nor NaN
        raise Damaged(f"{len(numbers)} numbers such as {numbers[0]:g} instead of {count} in mm")
    return numbers


def whole(value: bytes) -> int:
    """Return the whole number of an IS element."""
    try:
        return int(value.rstrip(b"\0"))
    except ValueError as error:  # of too many digits too
        raise Damaged(f"'{shown(value)}' instead of a whole number") from error


def shown(value: bytes) -> str:
    """Return the beginning of a damaged value, for an error."""
    text = value.rstrip(b"\0 ").decode("ascii", "replace")
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."


def unsigned(value: bytes) -> tuple[int, ...]:
    """Return the numbers of 16 bits of a US element."""
    return tuple(int.from_bytes(value[at : at + 2], "little") for at in range(0, len(value) // 2 * 2, 2))


def first_unsigned(elements: Elements, tag: int, default: int) -> int:
    """Return the first number of 16 bits of an element.

    Parameters
    ----------
    elements : mapping of int to Any
        Elements by tag.
    tag : int
    default : int
        Returned where the element is missing or empty.
    """
    return (*unsigned(elements.get(tag, b"")), default)[0]


def uid(value: bytes) -> str:
    """Return a UID without its padding."""
    return value.rstrip(b"\0 ").decode("ascii", "replace")


def texts(elements: Elements) -> Any:
    """Return a function that decodes texts by the SpecificCharacterSet of the dataset `elements`."""
    charset = needed("pydicom.charset", "pydicom", "DICOM")
    names = [name.strip().decode("ascii", "replace") for name in elements.get(0x00080005, b"").split(b"\\")]

    def decoded(value: bytes) -> str:
        with quiet():
            try:
                text = charset.decode_bytes(value, charset.convert_encodings(names), set())
            except (LookupError, ValueError):
                text = value.decode("latin-1")
        return str(text)

    return decoded


def reference_of(elements: Elements, series: list[Elements], instances: int, uids: str = "") -> Reference:
    """Return the reference of a dataset to its series.

    Parameters
    ----------
    elements : mapping of int to Any
        Its elements.
    series : list of mapping
        The sequence's items with the series' UID.
    instances : int
        Tag of the sequence in them that names images.
    uids : str
        UID of the frame of reference, where the dataset's own is not meant.
    """
    named = [image[0x00081155] for item in series for image in item.get(instances, ()) if 0x00081155 in image]
    return Reference(
        frozenset(uid(item[0x0020000E]) for item in series if item.get(0x0020000E)),
        frozenset(map(uid, named)),
        uids or uid(elements.get(0x00200052, b"")),
    )
