# SPDX-License-Identifier: GPL-3.0-or-later
"""Store the pieces of a surface that are read several times, some in memory and the rest in an unnamed file."""

from __future__ import annotations

import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import OutputError
from ...progress import Step, Steps, WithResult
from ..triangle_mesh import Pieces, Surface

VERTEX_BYTES = 36  # A vertex has two ends of alpha and a normal.
FACE_BYTES = 16  # A triangle has three vertices and the number of its component.
VAR_TMP = Path("/var/tmp")  # On disk where /tmp is memory.


@dataclass(frozen=True)
class _InFile:
    """Arrays that lie one after the other in the file."""

    start: int
    kinds: tuple[tuple[tuple[int, ...], np.dtype[Any]], ...]


class Spool:
    """Arrays that are read several times. Closing it, as leaving a `with` does, removes the file.

    Parameters
    ----------
    most_bytes : float
        Bytes that may stay in memory; an array that does not fit goes to the file. By default all stay.
    folder : Path, optional
        Folder of the file; by default where the system keeps temporary files on disk.
    """

    def __init__(self, most_bytes: float = math.inf, folder: Path | None = None) -> None:
        self.most_bytes, self.folder = most_bytes, folder
        self.held_bytes = self.file_bytes = 0
        self._entries: list[list[NDArray[Any]] | _InFile | None] = []
        self._file: IO[bytes] | None = None

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Release all arrays and the file."""
        self._entries.clear()
        if self._file is not None:
            self._file.close()
            self._file = None

    def put(self, *arrays: NDArray[Any]) -> int:
        """Keep arrays, and return the number under which `get` gives them.

        Raises
        ------
        OutputError
            If the file cannot be written.
        """
        size = sum(array.nbytes for array in arrays)
        if self.held_bytes + size <= self.most_bytes:
            self.held_bytes += size
            self._entries.append(list(arrays))
        else:
            start = self.file_bytes
            for array in arrays:
                self._transfer(np.ascontiguousarray(array), start, write=True)
                start += array.nbytes
            self._entries.append(_InFile(self.file_bytes, tuple((array.shape, array.dtype) for array in arrays)))
            self.file_bytes = start
        return len(self._entries) - 1

    def get(self, number: int, last: bool = False) -> list[NDArray[Any]]:
        """Return the arrays of a number; `last` releases them."""
        entry = self._entries[number]
        assert entry is not None, "they were released"
        if last:
            self._entries[number] = None
        if isinstance(entry, list):
            return entry
        arrays, start = [np.empty(shape, dtype) for shape, dtype in entry.kinds], entry.start
        for array in arrays:
            self._transfer(array, start, write=False)
            start += array.nbytes
        return arrays

    def _transfer(self, array: NDArray[Any], start: int, write: bool) -> None:
        """Write an array to the file, or read it; the system may do less than it is asked for at once."""
        if not array.size:
            return
        folder = self.folder or Path()
        try:
            folder = self.folder or temporary_folder()
            if self._file is None:
                # Without a buffer: closing one writes again what a full disk has refused.
                self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # noqa: SIM115
            file: Any = self._file
            file.seek(start)
            bytes_left = array.data.cast("B")
            while len(bytes_left):
                done = file.write(bytes_left) if write else file.readinto(bytes_left)
                if not done:
                    raise OSError("its end is missing")
                bytes_left = bytes_left[done:]
        except OSError as error:
            reason = error.strerror or str(error)
            raise OutputError(
                f"no room in {folder} for the pieces of the surface after {start / 2**20:.3g} MiB ({reason}); "
                "free space there, use a larger stride or choose a region"
            ) from error


def temporary_folder() -> Path:
    """Return the folder of temporary files on disk: TMPDIR, or one that is not a /tmp in memory."""
    on_disk = "TMPDIR" not in os.environ and os.name == "posix" and os.access(VAR_TMP, os.W_OK)
    return VAR_TMP if on_disk else Path(tempfile.gettempdir())


class SpooledPieces:
    """The pieces of a surface in a spool.

    Parameters
    ----------
    spool : Spool
    """

    def __init__(self, spool: Spool) -> None:
        self.spool = spool
        self._numbers: list[int] = []
        self._result: int | None = None

    def take_steps(self, pieces: Pieces) -> Steps[None]:
        """Take all pieces, and the result of their maker."""
        source = WithResult(pieces)
        for item in source:
            if isinstance(item, Step):
                yield item
            else:
                normals = () if item.normals is None else (item.normals,)
                self._numbers.append(self.spool.put(item.midpoints, item.linear, item.faces, *normals))
        self._result = source.result

    def pieces_steps(self, last: bool = False) -> Pieces:
        """Yield the pieces, and return the result of their maker; `last` releases them."""
        for number, entry in enumerate(self._numbers):
            yield Step(number / len(self._numbers))
            yield Surface(*self.spool.get(entry, last))
        return self._result
