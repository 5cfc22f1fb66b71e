"""Bytes of a file, plain or compressed, straight into an array, with steps for progress and cancel."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from numpy.typing import NDArray

from ..core import ReadError, Step, Steps
from .optional_imports import BROKEN, reason

CHUNK = 2**20  # about 0.005 s of unpacking gzip


def opened(path: Path) -> IO[bytes]:
    """The file for reading, unpacked on the way if its first bytes say gzip or bzip2."""
    with path.open("rb") as file:
        head = file.read(3)
    if head[:2] == b"\x1f\x8b":
        return cast(IO[bytes], gzip.open(path, "rb"))
    return cast(IO[bytes], bz2.open(path, "rb")) if head == b"BZh" else path.open("rb")


def unpacked(stream: IO[bytes], encoding: str) -> IO[bytes]:
    """What follows in an open file, unpacked by `encoding` (gzip, gz, bzip2 or bz2)."""
    opener = gzip.open if encoding.startswith("gz") else bz2.open
    return cast(IO[bytes], opener(stream, "rb"))


def fill_steps(array: NDArray[Any], stream: IO[bytes], name: str) -> Steps[None]:
    """Read `array` (contiguous) full from `stream`; too few bytes are a `ReadError` that names the file."""
    flat = memoryview(array.reshape(-1, order="A").view(np.uint8).data)
    done = 0
    while done < len(flat):
        yield Step(done / len(flat), f"Reading {name}")
        try:
            count = stream.readinto(flat[done : done + CHUNK])  # type: ignore[attr-defined]
        except BROKEN as error:
            raise ReadError(
                f"{name} is truncated or damaged after {done} of {len(flat)} bytes ({reason(error)}); copy it again"
            ) from error
        if not count:
            raise ReadError(f"{name} is truncated: {done} of {len(flat)} bytes of values are there; copy it again")
        done += count


def check_end(stream: IO[bytes], name: str) -> None:
    """Reach the check sum that ends a compressed stream, after the last value."""
    if isinstance(stream, gzip.GzipFile | bz2.BZ2File):
        try:
            stream.read(1)
        except BROKEN as error:
            raise ReadError(f"{name} is truncated or damaged ({reason(error)}); copy it again") from error


def skip(stream: IO[bytes], count: int, name: str) -> None:
    """Pass over `count` bytes."""
    try:
        stream.seek(count, 1)
    except BROKEN as error:
        raise ReadError(f"{name} is truncated or damaged ({reason(error)}); copy it again") from error
