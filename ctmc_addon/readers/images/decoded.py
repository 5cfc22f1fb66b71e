# SPDX-License-Identifier: GPL-3.0-or-later
"""Decode requested slices only, several at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import finish
from ...core.volume import SliceReader, as_slice
from ..optional_imports import quiet_batches_steps


class DecodedSlices(SliceReader):
    """Slices that `decode` returns by their number, (rows, columns); several threads may call it."""

    def __init__(
        self, decode: Callable[[int], NDArray[Any]], shape: tuple[int, int, int], dtype: np.dtype[Any], threads: int = 1
    ) -> None:
        self.decode, self.shape, self.dtype, self.threads = decode, shape, dtype, threads

    @property
    def at_once(self) -> int:
        """Return two slices for each thread, so that no thread waits long for another."""
        return 2 * self.threads

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Decode each slice, and keep what is asked for of it."""

        def fill_slice(at: int) -> None:
            out[at] = self.decode(slices[at])[as_slice(rows), as_slice(columns)]

        finish(quiet_batches_steps(fill_slice, range(len(slices)), "Decoding slices", self.at_once, self.threads))
