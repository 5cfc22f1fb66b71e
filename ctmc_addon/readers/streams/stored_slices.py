# SPDX-License-Identifier: GPL-3.0-or-later
"""Read slices of values stored row after row, plain or packed, and keep requested values only.

No file is mapped into memory: a limit of a process's address space counts what is mapped.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from ...core import ReadError, Step, Steps, finish
from ...core.volume import SliceReader
from .streams import check_end_steps, fill_steps, skip_steps

WORTH_READING = 1 << 16  # Bytes between two rows; reading fewer is faster than skipping them.
BLOCK = 1 << 22  # Bytes read at once.


class RawSlices(SliceReader):
    """Plain values (slices, rows, columns) in C order, from byte `start` of a file on."""

    thread_safe = True  # Every call opens the file for itself.

    def __init__(self, path: Path, start: int, shape: tuple[int, int, int], stored: np.dtype[Any]) -> None:
        self.path, self.start, self.stored = path, start, stored
        self.shape, self.dtype = shape, stored.newbyteorder("=")

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read straight into place where whole slices are asked for, else row by row."""
        item = self.stored.itemsize
        pitch = self.shape[2] * item  # bytes of a row
        slice_bytes = self.shape[1] * pitch
        with self.path.open("rb", buffering=0) as file:
            if (rows, columns) == self.everything[1:] and slices.step == 1 and out.flags.c_contiguous:
                self._read(file, slices.start * slice_bytes, out)
            else:
                for number, target in zip(slices, out, strict=True):
                    self._fill_slice(file, number * slice_bytes, target, rows, columns)
        if not self.stored.isnative:
            out.byteswap(inplace=True)

    def _fill_slice(self, file: Any, first: int, out: NDArray[Any], rows: range, columns: range) -> None:
        """Read some columns of some rows of the slice at byte `first`."""
        item = self.stored.itemsize
        pitch = self.shape[2] * item
        span = columns[-1] + 1 - columns[0]
        passed_over = rows.step * pitch - span * item  # from row to row
        at_once = max(1, BLOCK // (rows.step * pitch)) if passed_over <= WORTH_READING else 1
        for start in range(0, len(rows), at_once):
            block = rows[start : start + at_once]
            reach = (block[-1] - block[0]) * self.shape[2] + span
            values = np.empty(reach, self.dtype)
            self._read(file, first + block[0] * pitch + columns[0] * item, values)
            # Rows as they lie in the file, a view: its last one ends with the last column that was asked for.
            steps = (rows.step * pitch, columns.step * item)
            shape = (len(block), len(columns))
            out[start : start + at_once] = np.ndarray(shape, self.dtype, values, strides=steps)

    def _read(self, file: Any, offset: int, out: NDArray[Any]) -> None:
        file.seek(self.start + offset)
        view = memoryview(out.reshape(-1).view(np.uint8).data)
        done = 0
        while done < len(view):
            count = file.readinto(view[done : done + BLOCK])
            if not count:
                needed = self.start + math.prod(self.shape) * self.stored.itemsize
                stored_bytes = self.path.stat().st_size
                raise ReadError(
                    f"{self.path.name} is truncated: {stored_bytes} of {needed} bytes are there; copy it again"
                )
            done += count


class TransposedSlices(SliceReader):
    """Values whose first axis is the fastest in the file: (columns, rows, slices) of another reader."""

    def __init__(self, stored: SliceReader) -> None:
        self.stored = stored
        columns, rows, slices = stored.shape
        self.shape, self.dtype = (slices, rows, columns), stored.dtype
        self.thread_safe = stored.thread_safe

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read with the axes in reverse order."""
        step = self.stored.at_once
        for start in range(0, len(columns), step):
            window = slice(start, start + step)
            out[..., window] = self.stored.read(columns[window], rows, slices).T

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Return the values as a view of an array in the file's order."""
        return (yield from self.stored.values_steps(columns, rows, slices)).T


class PackedSlices(SliceReader):
    """Values (slices, rows, columns) in C order, in a stream that is unpacked from its start on.

    Parameters
    ----------
    opened : callable
        Opens the stream, at any place before the values; closed by what it puts on the stack.
    start : int
        Bytes to pass over before the values.
    """

    def __init__(
        self,
        path: Path,
        opened: Callable[[ExitStack], IO[bytes]],
        start: int,
        shape: tuple[int, int, int],
        stored: np.dtype[Any],
    ) -> None:
        self.path, self.opened, self.start, self.stored = path, opened, start, stored
        self.shape, self.dtype = shape, stored.newbyteorder("=")
        self._files = ExitStack()
        finalize(self, self._files.close)
        self._stream: IO[bytes] | None = None
        self._next = 0  # slice of the stream

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Unpack up to the slices; earlier ones than were read last from the start again."""
        whole = (rows, columns) == self.everything[1:]
        plane = None if whole and out.flags.c_contiguous else np.empty(self.shape[1:], self.dtype)
        for number, target in zip(slices, out, strict=True):
            values = target if plane is None else plane
            finish(fill_steps(values, self._stream_at(number), self.path.name))
            self._next = number + 1
            if plane is not None:
                target[...] = plane[rows.start : rows.stop : rows.step, columns.start : columns.stop : columns.step]
        if not self.stored.isnative:
            out.byteswap(inplace=True)
        if self._next == self.shape[0] and self._stream is not None:
            finish(check_end_steps(self._stream, self.path.name))
            self._close()

    def pass_to_steps(self, number: int) -> Steps[None]:
        """Unpack up to slice `number`, some slices at a time; behind the last one up to the check sum."""
        first = self._next if self._stream is not None else number if number == self.shape[0] else 0
        for at in range(first, number, self.at_once):
            yield Step(at / self.shape[0], f"Unpacking {self.path.name}")
            self._next_at(at)
        if number < self.shape[0]:
            self._next_at(number)
        elif self._stream is not None:
            self._next_at(number)
            yield from check_end_steps(self._stream, self.path.name)
            self._close()

    def _next_at(self, number: int) -> None:
        """Move the stream to the first byte of a slice."""
        self._stream_at(number)
        self._next = number

    def _stream_at(self, number: int) -> IO[bytes]:
        """Return the stream, moved to the first byte of a slice."""
        if self._stream is None or number < self._next:
            self._close()
            self._stream = self.opened(self._files)
            finish(skip_steps(self._stream, self.start, self.path.name))
        if number > self._next:
            plane = self.shape[1] * self.shape[2] * self.stored.itemsize
            finish(skip_steps(self._stream, (number - self._next) * plane, self.path.name))
        return self._stream

    def _close(self) -> None:
        self._files.close()
        self._stream, self._next = None, 0


class JoinedSlices(SliceReader):
    """Slices of several consecutive files."""

    def __init__(self, readers: Sequence[SliceReader]) -> None:
        self.readers = readers
        self.firsts = [0]
        for reader in readers:
            self.firsts.append(self.firsts[-1] + reader.shape[0])
        self.shape, self.dtype = (self.firsts[-1], *readers[0].shape[1:]), readers[0].dtype
        self.thread_safe = all(reader.thread_safe for reader in readers)

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read from each file in turn."""
        at = 0
        while at < len(slices):
            number = bisect_right(self.firsts, slices[at]) - 1
            first, stop = self.firsts[number], self.firsts[number + 1]
            count = len(range(slices[at], min(stop, slices.stop), slices.step))
            own = slices[at : at + count]
            moved = range(own.start - first, own.stop - first, own.step)
            self.readers[number].fill(out[at : at + count], moved, rows, columns)
            at += count


class TimeSlices(SliceReader):
    """One of several volumes: `slices` slices of another reader, each `step`-th from number `first` on."""

    def __init__(self, stored: SliceReader, first: int, slices: int, step: int = 1) -> None:
        self.stored, self.first, self.step = stored, first, step
        self.shape, self.dtype = (slices, *stored.shape[1:]), stored.dtype
        self.thread_safe = stored.thread_safe

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read the slices of this time from the other reader."""
        start, stop = (self.first + self.step * end for end in (slices.start, slices.stop))
        moved = range(start, stop, self.step * slices.step)
        self.stored.fill(out, moved, rows, columns)

    def values_steps(self, slices: range, rows: range, columns: range) -> Steps[NDArray[Any]]:
        """Read values as steps; reading all slices also unpacks the bytes around them, up to the check sum."""
        checked = self.stored if isinstance(self.stored, PackedSlices) and slices == self.everything[0] else None
        if checked is not None:
            yield from checked.pass_to_steps(self.first)
        values = yield from super().values_steps(slices, rows, columns)
        if checked is not None:
            yield from checked.pass_to_steps(checked.shape[0])
        return values


class InterleavedSlices(SliceReader):
    """One of `count` volumes whose values alternate voxel by voxel along the columns of another reader."""

    def __init__(self, stored: SliceReader, number: int, count: int) -> None:
        self.stored, self.number, self.count = stored, number, count
        slices, rows, columns = stored.shape
        self.shape, self.dtype = (slices, rows, columns // count), stored.dtype
        self.thread_safe = stored.thread_safe

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Read every `count`-th column."""
        start = columns.start * self.count + self.number
        stop = columns[-1] * self.count + self.number + 1
        self.stored.fill(out, slices, rows, range(start, stop, columns.step * self.count))
