# SPDX-License-Identifier: GPL-3.0-or-later
"""Read bytes of a plain or compressed file straight into an array, with steps for progress and cancel."""

from __future__ import annotations

import bz2
import gzip
import zlib
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Step, Steps
from ..optional_imports import reason
from .zlib_stream import ZlibFile

CHUNK = 2**20  # Gzip unpacks this many bytes in about 0.005 s.
MOST_PADDING = 2**24  # At most this many bytes after the values are unpacked to reach the check sum.
PACKED = (gzip.GzipFile, bz2.BZ2File, ZlibFile)
STREAM_ERRORS = (OSError, EOFError, ValueError, zlib.error)  # Files, gzip and bz2 raise these.


def is_packed(path: Path) -> bool:
    """Return whether the first bytes say gzip or bzip2."""
    with path.open("rb") as file:
        head = file.read(3)
    return head[:2] == b"\x1f\x8b" or head == b"BZh"


def opened(path: Path) -> IO[bytes]:
    """Return the file for reading, unpacked on the way if its first bytes say gzip or bzip2."""
    if not is_packed(path):
        return path.open("rb")
    with path.open("rb") as file:
        gzipped = file.read(2) == b"\x1f\x8b"
    return cast(IO[bytes], gzip.open(path, "rb") if gzipped else bz2.open(path, "rb"))


def unpacked(stream: IO[bytes], encoding: str) -> IO[bytes]:
    """Return the rest of an open file, unpacked by `encoding` (gzip, gz, bzip2 or bz2)."""
    opener = gzip.open if encoding.startswith("gz") else bz2.open
    return cast(IO[bytes], opener(stream, "rb"))


def fill_steps(array: NDArray[Any], stream: IO[bytes], name: str) -> Steps[None]:
    """Read an array full from a stream.

    Parameters
    ----------
    array : contiguous array
        Is filled.
    stream : binary file
    name : str
        Of the file, for errors.

    Raises
    ------
    ReadError
        If the stream has too few bytes.
    """
    flat = memoryview(array.reshape(-1, order="A").view(np.uint8).data)
    done = 0
    while done < len(flat):
        yield Step(done / len(flat), f"Reading {name}")
        try:
            count = stream.readinto(flat[done : done + CHUNK])  # type: ignore[attr-defined]
        except STREAM_ERRORS as error:
            raise ReadError(
                f"{name} is truncated or damaged after {done} of {len(flat)} bytes ({reason(error)}); copy it again"
            ) from error
        if not count:
            raise ReadError(f"{name} is truncated: {done} of {len(flat)} bytes of values are there; copy it again")
        done += count


def check_end_steps(stream: IO[bytes], name: str) -> Steps[None]:
    """Reach the check sum that ends a compressed stream, after the last value."""
    if not isinstance(stream, PACKED):
        return
    for _ in range(0, MOST_PADDING, CHUNK):
        yield Step(1.0, f"Checking {name}")
        try:
            if not stream.read(CHUNK):
                return
        except STREAM_ERRORS as error:
            raise ReadError(f"{name} is truncated or damaged ({reason(error)}); copy it again") from error
    raise ReadError(f"{name} unpacks to far more bytes than its header says; export it again")


def skip_steps(stream: IO[bytes], count: int, name: str) -> Steps[None]:
    """Pass over bytes of a stream.

    Parameters
    ----------
    stream : binary file
    count : int
        Bytes.
    name : str
        Of the file, for errors.

    Raises
    ------
    ReadError
        If the stream has fewer bytes.
    """
    if not isinstance(stream, PACKED):
        stream.seek(count, 1)
        return
    left = count
    while left > 0:
        yield Step(0.0, f"Reading {name}")
        try:
            passed = len(stream.read(min(CHUNK, left)))
        except STREAM_ERRORS as error:
            raise ReadError(f"{name} is truncated or damaged ({reason(error)}); copy it again") from error
        if not passed:
            raise ReadError(f"{name} is truncated: it has fewer values than its header says; copy it again")
        left -= passed
