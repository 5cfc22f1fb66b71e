# SPDX-License-Identifier: GPL-3.0-or-later
"""Return the stored pixels of slices in turn; a process decodes compressed ones, because damaged files crash it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, groupby
from types import TracebackType
from typing import Any

from numpy.typing import NDArray

from ....core import ReadError, Step, Steps
from ...decoding.process import DecoderEnded, DecodingProcess, started_steps
from ...optional_imports import quiet
from ..header import UNCOMPRESSED, Slice
from .pixels import stored_frames, syntax_name

RLE = "1.2.840.10008.1.2.5"  # Slow, because pydicom unpacks RLE in Python.


class StoredPixels:
    """The stored pixels of `slices`, fastest in their order; a context, which ends the process.

    Where no process can be started, or none is needed, everything is decoded here: the values are the same.
    """

    def __init__(self, slices: Sequence[Slice]) -> None:
        self.slices = slices
        self.process: DecodingProcess | None = None
        self.asked: int | None = None  # slice that the process decodes
        self.here: Iterator[NDArray[Any]] | None = None
        self.following = -1  # slice that `here` gives next
        self.decodes_here = not any(_needs_process(ct_slice) for ct_slice in slices)

    def __enter__(self) -> StoredPixels:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, frames: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.close()
        self.process, self.asked = None, None

    def slice_steps(self, number: int, step: Step) -> Steps[NDArray[Any]]:
        """Return a slice's pixels, (rows, columns) as stored; `step` is yielded while another process decodes."""
        if not self.decodes_here and self.process is None:
            self.process = yield from started_steps(max(each.image.rows * each.image.columns for each in self.slices))
            self.decodes_here = self.process is None
        if self.process is None:
            return self._decoded_here(number)
        if self.asked not in (None, number):  # the one behind the last is not wanted
            yield from self._picture_steps(self.process, step)
        if self.asked is None:
            self._ask(self.process, number)
        stored = yield from self._picture_steps(self.process, step)
        if number + 1 < len(self.slices):  # it is decoded while this one is put in its place
            self._ask(self.process, number + 1)
        return stored

    def _decoded_here(self, number: int) -> NDArray[Any]:
        with quiet():
            if self.here is None or number != self.following:
                self.here = frames_of(self.slices[number:])
            self.following = number + 1
            return next(self.here)

    def _ask(self, process: DecodingProcess, number: int) -> None:
        ct_slice = self.slices[number]
        process.ask({"path": str(ct_slice.image.path.absolute()), "frame": ct_slice.frame})
        self.asked = number

    def _picture_steps(self, process: DecodingProcess, step: Step) -> Steps[NDArray[Any]]:
        assert self.asked is not None, "the caller asks"
        ct_slice, self.asked = self.slices[self.asked], None
        try:
            return (yield from process.picture_steps((ct_slice.image.rows, ct_slice.image.columns), step))
        except DecoderEnded as error:
            raise ReadError(
                f"the pixels of {ct_slice.name} ({syntax_name(ct_slice.image.pixels.syntax)}) ended the process that "
                f"decodes them ({error}); the file is damaged: copy it again"
            ) from error


def _needs_process(ct_slice: Slice) -> bool:
    """Return whether a slice is decoded by a library in C."""
    return ct_slice.image.pixels.syntax not in (*UNCOMPRESSED, RLE)


def frames_of(slices: Sequence[Slice]) -> Iterator[NDArray[Any]]:
    """Yield the pixels of slices that are decoded in this process.

    A file is opened once for frames that follow one another.

    Parameters
    ----------
    slices : sequence of Slice

    Returns
    -------
    iterator of (rows, columns) arrays
    """
    groups = groupby(slices, key=lambda ct_slice: ct_slice.image)
    return chain.from_iterable(stored_frames(image, [each.frame for each in group]) for image, group in groups)
