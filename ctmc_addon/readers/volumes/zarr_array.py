# SPDX-License-Identifier: GPL-3.0-or-later
"""Read one array of a Zarr store, version 2 or 3, by zarr: its description, and its values some chunks at a time.

zarr-specs.readthedocs.io describes both versions. The names of codecs are looked at before zarr is asked, and one that
is not in `CODECS` is refused, as one of zarr's unpickles what it reads.
"""

from __future__ import annotations

import itertools
import json
import lzma
import math
import os
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import NO_THREAD, ReadError, Step, Steps, require_memory
from ...core.volume import SliceReader, as_slice
from ..optional_imports import needed, quiet, reason
from ..streams.packed_size import bytes_to_look_at, unpacks_beyond

MOST_JSON = 1 << 24  # Bytes of one metadata file.
MOST_AXES = 8
LONGEST = 1 << 40  # Samples along an axis.
MOST_COUNTED = 100_000  # At most this many chunks are counted in the file system.
WIDEST = 16  # A filter may turn a value into this many bytes.
BLOCK = 1 << 24  # This many bytes are decoded at once if chunks have fewer.
RUN = 1 << 26  # This many bytes are checked at once.
MOST_KEPT = 1 << 28  # At most this many bytes of a layer of chunks are kept for the next call.
# Of numcodecs (version 2) and of zarr (version 3), where those of numcodecs are called 'numcodecs.zlib'.
SIZES = {"b": (1,), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (4, 8)}  # The bytes of a value, by its kind.
CODECS = {
    *("blosc", "zlib", "gzip", "zstd", "lz4", "bz2", "lzma", "shuffle", "bitround", "delta", "fixedscaleoffset"),
    *("quantize", "packbits", "astype", "crc32", "crc32c", "adler32", "fletcher32", "jenkins_lookup3"),
    *("bytes", "endian", "transpose", "sharding_indexed"),
}
# What zarr and its codecs were seen to raise on damaged metadata and chunks, around calls of zarr alone.
ZARR_ERRORS = (ValueError, TypeError, LookupError, AttributeError, RuntimeError, EOFError, ArithmeticError)
DAMAGE = (*ZARR_ERRORS, AssertionError, zlib.error, lzma.LZMAError)


class ArrayHeader(NamedTuple):
    """The description of an array."""

    folder: Path
    array: Any  # The array of zarr.
    shape: tuple[int, ...]
    chunks: tuple[int, ...]  # Sides of a chunk, which is decoded at once.
    grid: int  # Number of files with all values: chunks, or shards of several chunks.
    dtype: np.dtype[Any]  # Type in the machine's byte order.
    codec: str  # Codec that packed the files; empty for none and for shards.
    name: str  # Name for messages.

    @property
    def chunk_bytes(self) -> int:
        """Return how many bytes a decoded chunk has."""
        return math.prod(self.chunks) * self.dtype.itemsize


def read_json(path: Path, name: str) -> dict[str, Any]:
    """Return the object in a metadata file; empty if the file is missing.

    Raises
    ------
    ReadError
        If the file is too long or not an object in JSON; `name` is what it says of the store.
    """
    if not path.is_file():
        return {}
    try:
        metadata = json.loads(path.read_bytes()) if path.stat().st_size <= MOST_JSON else None
    except (ValueError, RecursionError):
        metadata = None
    if not isinstance(metadata, dict):
        raise ReadError(f"{path.name} of {name} is not readable metadata of Zarr; export or copy it again")
    return metadata


def array_header(folder: Path, name: str) -> ArrayHeader:
    """Return the description of the array in a folder, as zarr opens it.

    Raises
    ------
    ReadError
        If there is no array, or its sizes, type or codecs are not those of a readable one.
    """
    third = read_json(folder / "zarr.json", name)
    about = third or read_json(folder / ".zarray", name)
    if not about or third.get("node_type", "array") != "array":
        raise ReadError(f"{name} is missing: there is no array in {folder.name}; copy the whole store again")
    ids = _codec_ids([about.get(key) for key in ("codecs", "compressor", "filters")])
    unknown = next((word for word in ids if word.removeprefix("numcodecs.") not in CODECS), None)
    if unknown is not None:
        raise ReadError(
            f"{name} is packed by the codec '{unknown[:60]}', which is not read; save it with Blosc or Zstandard"
        )
    zarr = needed("zarr", "zarr", "OME-Zarr")
    try:
        with quiet():
            array = zarr.open_array(str(folder), mode="r", zarr_format=3 if third else 2)
            shape, chunks, shards = tuple(array.shape), tuple(array.chunks), array.shards
            dtype = np.dtype(array.dtype).newbyteorder("=")
    except DAMAGE as error:
        if _is_without_thread(error):
            raise MemoryError(NO_THREAD) from error
        raise ReadError(
            f"{name} has metadata that zarr does not read ({reason(error)}); export it again as int16 or float32"
        ) from error
    files = shards or chunks
    for sides in (shape, files, chunks):
        if not 0 < len(sides) <= MOST_AXES or len(sides) != len(shape) or not all(0 < side < LONGEST for side in sides):
            raise ReadError(
                f"{name} has the shape {shape} and chunks of {sides}, which is not a volume; export it again"
            )
    if dtype.kind not in "biuf" or dtype.itemsize not in SIZES[dtype.kind]:
        raise ReadError(f"{name} holds values of type {str(dtype)[:60]}; convert them to int16 or float32")
    count = math.prod(-(-size // side) for size, side in zip(shape, files, strict=True))
    return ArrayHeader(folder, array, shape, chunks, count, dtype, "" if shards else outermost(about), name)


def outermost(about: Mapping[str, Any]) -> str:
    """Return the codec that packed last, except check sums."""
    codecs = [about.get("compressor"), *listed(about, "codecs")]
    words = [str(codec.get("id", codec.get("name"))) for codec in codecs if isinstance(codec, dict)]
    packing = [word.removeprefix("numcodecs.") for word in words if "crc32" not in word]
    return packing[-1] if packing else ""


def listed(about: Mapping[str, Any], key: str) -> list[Any]:
    """Return the list of that name; empty where there is none."""
    entries = about.get(key)
    return entries if isinstance(entries, list) else []


def _codec_ids(codecs: Any, depth: int = 0) -> Iterator[str]:
    """Yield the names of all codecs, at any depth of their configurations."""
    if isinstance(codecs, dict):
        for key, value in codecs.items():
            if key in ("id", "name"):
                yield str(value)
            elif isinstance(value, dict | list):
                yield from _codec_ids(value, depth + 1) if depth < MOST_AXES else ["nested too deep"]
    elif isinstance(codecs, list):
        for codec in codecs:
            yield from (
                [codec]
                if isinstance(codec, str)
                else _codec_ids(codec, depth + 1)
                if depth < MOST_AXES
                else ["nested too deep"]
            )


def missing_note(header: ArrayHeader, fill: Any) -> list[str]:
    """Return a note on missing chunk files: a store leaves out chunks of the fill value.

    Raises
    ------
    ReadError
        If none is there.
    """
    if header.grid > MOST_COUNTED and any(_chunk_files(header.folder)):
        return []
    count = sum(1 for _ in _chunk_files(header.folder))
    if not count:
        raise ReadError(f"{header.name} has none of its {header.grid} chunks; copy the whole store again")
    if count >= header.grid:
        return []
    missing = f"{header.grid - count} of {header.grid} chunks are not in the store"
    return [f"{missing}: they have its fill value {float(fill or 0):g}"]


def _chunk_files(folder: Path) -> Iterator[str]:
    """Yield the files below an array's folder that are not metadata."""
    for _, _, files in os.walk(folder):
        yield from (file for file in files if not file.startswith(".") and file != "zarr.json")


class ZarrSlices(SliceReader):
    """A volume in an array: three of its axes, at one index of each remaining axis.

    Parameters
    ----------
    header : ArrayHeader
    axes : (z, y, x)
        Which axes of the array are those of the volume.
    at : mapping of int to int
        The index along every other axis.
    """

    def __init__(self, header: ArrayHeader, axes: tuple[int, int, int], at: dict[int, int]) -> None:
        self.header, self.axes, self.at = header, axes, at
        z, y, x = axes
        self.shape = (header.shape[z], header.shape[y], header.shape[x])
        self.dtype = header.dtype
        self.chunk_slices = min(header.chunks[z], self.shape[0])
        self.array = header.array
        self._kept: tuple[range, range, range, NDArray[Any]] | None = None

    @property
    def at_once(self) -> int:
        """Return the slices of a layer of chunks, or fewer if those are large."""
        return min(self.chunk_slices, max(1, RUN // (self.shape[1] * self.shape[2] * self.dtype.itemsize)))

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Decode the chunks; the rest of a layer that is left off in its midst is kept for the next call."""
        for first, own, stop in self._layers(slices):
            target = out[first : first + len(own)]
            ahead = range(own.start, stop, own.step)
            size = len(ahead) * len(rows) * len(columns) * self.dtype.itemsize
            if self._is_kept(own, rows, columns):
                pass
            elif len(ahead) == len(own) or size > MOST_KEPT:
                self._decode(target, own, rows, columns)
                continue
            else:
                self._kept = None  # before the next layer takes memory
                values = np.empty((len(ahead), len(rows), len(columns)), self.dtype)
                self._decode(values, ahead, rows, columns)
                self._kept = (ahead, rows, columns, values)
            assert self._kept is not None, "it was kept before or is so now"
            kept, _, _, values = self._kept
            target[...] = values[kept.index(own[0]) :][:: own.step // kept.step][: len(own)]

    def runs_steps(self, visit: Callable[[NDArray[Any]], bool]) -> Steps[None]:
        """Hand all values to `visit` if the slices fit in memory: a store need not hold all that its metadata claim."""
        sides = f"{self.shape[2]} x {self.shape[1]} x {self.at_once}"
        size = self.at_once * self.shape[1] * self.shape[2] * self.dtype.itemsize
        require_memory(size, f"looking at {self.header.name} ({sides})", "choose another level")
        yield from super().runs_steps(visit)

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Read values as steps, a layer of chunks at a time, straight into place."""
        out = np.empty((len(slices), len(rows), len(columns)), self.dtype)
        for first, own, _ in self._layers(slices):
            yield Step(first / len(slices), "Reading slices")
            self._decode(out[first : first + len(own)], own, rows, columns)
        return out

    def _is_kept(self, slices: range, rows: range, columns: range) -> bool:
        if self._kept is None or self._kept[1:3] != (rows, columns) or slices.step % self._kept[0].step:
            return False
        return slices[0] in self._kept[0] and slices[-1] in self._kept[0]

    def _layers(self, slices: range) -> Iterator[tuple[int, range, int]]:
        """Yield each layer of chunks: the number of its first slice, its slices, and its end."""
        side, first = self.header.chunks[self.axes[0]], 0
        while first < len(slices):
            stop = min((slices[first] // side + 1) * side, self.shape[0])
            own = slices[first : first + len(range(slices[first], min(stop, slices.stop), slices.step))]
            yield first, own, stop
            first += len(own)

    def _decode(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read slices of one layer, some chunks at a time."""
        _, y, x = (self.header.chunks[axis] for axis in self.axes)
        chunks = max(1, BLOCK // self.header.chunk_bytes)
        across = columns[-1] // x - columns[0] // x + 1
        for row, own_rows in _chunk_ranges(rows, y * max(1, chunks // across)):
            for column, own_columns in _chunk_ranges(columns, x * min(chunks, across)):
                block = self._selected(slices, own_rows, own_columns)
                out[:, row : row + len(own_rows), column : column + len(own_columns)] = block

    def _selected(self, slices: range, rows: range, columns: range) -> NDArray[Any]:
        """Return the values (slices, rows, columns) by zarr."""
        index: dict[int, int | slice] = dict(self.at)
        index |= dict(zip(self.axes, map(as_slice, (slices, rows, columns)), strict=True))
        if self.header.codec:
            self._check_unpacked(slices, rows, columns)
        try:
            with quiet():
                values = np.asarray(self.array[tuple(index[axis] for axis in range(len(index)))])
        except DAMAGE as error:
            raise damaged(self.header.name, error) from error
        except OSError as error:  # of gzip and bz2, which have no number
            if error.errno is not None:
                raise
            raise damaged(self.header.name, error) from error
        return values.transpose(np.argsort(np.argsort(self.axes)))

    def _check_unpacked(self, slices: range, rows: range, columns: range) -> None:
        """Refuse chunks that unpack to far more than their values."""
        numbers = {axis: [at // self.header.chunks[axis]] for axis, at in self.at.items()}
        for axis, own in zip(self.axes, (slices, rows, columns), strict=True):
            side = self.header.chunks[axis]
            numbers[axis] = list(range(own[0] // side, own[-1] // side + 1))
        most = WIDEST * math.prod(self.header.chunks) + BLOCK
        for chunk in itertools.product(*(numbers[axis] for axis in range(len(numbers)))):
            key = self.array.metadata.encode_chunk_key(chunk)
            path = self.header.folder / key
            content = b""
            if path.is_file():
                with path.open("rb") as file:
                    content = file.read(bytes_to_look_at(path.stat().st_size, self.header.codec, most))
            if unpacks_beyond(content, self.header.codec, most):
                raise ReadError(
                    f"chunk {key} of {self.header.name} unpacks to far more bytes than its size allows; export it again"
                )


def _chunk_ranges(numbers: range, side: int) -> Iterator[tuple[int, range]]:
    """Yield the numbers in each stretch of `side`, counted from 0, and the first one's place among all.

    Examples
    --------
    >>> list(_chunk_ranges(range(3, 10, 2), 4))
    [(0, range(3, 5, 2)), (1, range(5, 9, 2)), (3, range(9, 11, 2))]
    """
    first = 0
    while first < len(numbers):
        stop = (numbers[first] // side + 1) * side
        own = numbers[first : first + len(range(numbers[first], min(stop, numbers.stop), numbers.step))]
        yield first, own
        first += len(own)


def damaged(name: str, error: Exception) -> Exception:
    """Return the error for chunks that zarr cannot read."""
    if _is_without_thread(error):
        return MemoryError(NO_THREAD)
    return ReadError(f"{name} is truncated or damaged ({reason(error)}); copy it again")


def _is_without_thread(error: Exception) -> bool:
    """Return whether zarr could not start a thread."""
    return isinstance(error, RuntimeError) and str(error) == NO_THREAD
