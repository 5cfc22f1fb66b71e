# SPDX-License-Identifier: GPL-3.0-or-later
"""A mask slice by slice in a few bytes each, to be kept in a file: what undo, saving and autosave then hold.

Each slice is packed by itself, so a stroke packs only the slices that it touched, and states are compared by slice.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping

import numpy as np

from ..arrays import Flags
from ..errors import SettingsError

LEVEL = 1  # The level of zlib: a slice of bits is small already, and a stroke waits for it.


def packed_slices(mask: Flags, numbers: Iterable[int]) -> dict[int, bytes]:
    """Return some slices of a mask, a bit for each sample and deflated; an empty slice is no bytes.

    Examples
    --------
    >>> mask = np.zeros((3, 4, 5), bool)
    >>> mask[1, 2, 3] = True
    >>> packed = packed_slices(mask, range(3))
    >>> [len(packed[number]) > 0 for number in range(3)]
    [False, True, False]
    >>> bool((unpacked_mask(packed, mask.shape) == mask).all())
    True
    """
    return {
        number: zlib.compress(np.packbits(mask[number]).tobytes(), LEVEL) if mask[number].any() else b""
        for number in numbers
    }


def unpack_into(mask: Flags, packed: Mapping[int, bytes]) -> None:
    """Put packed slices into a mask in place; those that are not named stay.

    Raises
    ------
    SettingsError
        If they are not of a mask of this shape.
    """
    samples = mask.shape[1] * mask.shape[2]
    for number, content in packed.items():
        try:
            bits = np.frombuffer(zlib.decompress(content) if content else bytes(-(-samples // 8)), np.uint8)
        except zlib.error as error:
            raise SettingsError(f"slice {number} of a drawing is broken ({error}); open an older .blend") from error
        if len(bits) != -(-samples // 8) or not 0 <= number < len(mask):
            raise SettingsError(f"slice {number} was not drawn on a grid of {mask.shape}; load the CT it was drawn on")
        mask[number] = np.unpackbits(bits, count=samples).reshape(mask.shape[1:])


def unpacked_mask(packed: Mapping[int, bytes], shape: tuple[int, ...]) -> Flags:
    """Return the mask that has only these slices."""
    mask = np.zeros(shape, bool)
    unpack_into(mask, packed)
    return mask
