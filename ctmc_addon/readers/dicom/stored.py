# SPDX-License-Identifier: GPL-3.0-or-later
"""Stored pixels of slices one after the other: plain ones from here, compressed ones from a process that may die."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, groupby
from types import TracebackType
from typing import Any

from numpy.typing import NDArray

from ...core import ReadError, Step, Steps
from ..decoding.process import DecoderEnded, DecodingProcess, started_steps
from ..optional_imports import quiet
from .header import UNCOMPRESSED, Slice
from .pixels import stored_frames, syntax_name

RLE = "1.2.840.10008.1.2.5"  # unpacked by pydicom's own Python


class StoredPixels:
    """The stored pixels of `slices`, each asked for once and in order; a context, which ends the process.

    Where no process can be started, or none is needed, everything is decoded here: the values are the same.
    """

    def __init__(self, slices: Sequence[Slice]) -> None:
        self.slices = slices
        self.at = 0
        self.process: DecodingProcess | None = None
        self.here: Iterator[NDArray[Any]] | None = None
        if not any(needs_process(ct_slice) for ct_slice in slices):
            self.here = frames_of(slices)

    def __enter__(self) -> StoredPixels:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, frames: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.close()

    def next_steps(self, step: Step) -> Steps[NDArray[Any]]:
        """The next slice's pixels, (rows, columns) as stored; `step` is yielded while another process decodes."""
        if self.here is None and self.process is None:
            self.process = yield from started_steps(max(one.image.rows * one.image.columns for one in self.slices))
            if self.process is None:
                self.here = frames_of(self.slices)
            else:
                self._ask()
        if self.here is not None:
            with quiet():
                return next(self.here)
        assert self.process is not None
        ct_slice = self.slices[self.at]
        try:
            stored = yield from self.process.picture_steps((ct_slice.image.rows, ct_slice.image.columns), step)
        except DecoderEnded as error:
            raise ReadError(
                f"the pixels of {ct_slice.name} ({syntax_name(ct_slice.image.pixels.syntax)}) ended the process that "
                f"decodes them ({error}); the file is damaged: copy it again"
            ) from error
        self.at += 1
        self._ask()  # it decodes while the one before is put in its place
        return stored

    def _ask(self) -> None:
        if self.process is not None and self.at < len(self.slices):
            ct_slice = self.slices[self.at]
            self.process.ask({"path": str(ct_slice.image.path.absolute()), "frame": ct_slice.frame})


def needs_process(ct_slice: Slice) -> bool:
    """Whether a slice is decoded by a library in C."""
    return ct_slice.image.pixels.syntax not in (*UNCOMPRESSED, RLE)


def frames_of(slices: Sequence[Slice]) -> Iterator[NDArray[Any]]:
    """All pixels decoded here; a file is opened once for frames that follow one another."""
    groups = groupby(slices, key=lambda ct_slice: ct_slice.image)
    return chain.from_iterable(stored_frames(image, [one.frame for one in group]) for image, group in groups)
