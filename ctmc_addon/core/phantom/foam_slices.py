# SPDX-License-Identifier: GPL-3.0-or-later
"""An open foam as a micro-CT sees it, of any size, made slice by slice.

A gyroid whose waves are parabolas and whose pores vary a little in size, with an edge a few voxels wide and noise. Only
+ - * / and whole numbers decide a voxel, so every machine makes the same values.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SettingsError
from ..volume.slice_reader import SliceReader
from ..volume.volume import Volume

FOAM_THRESHOLD = 132.0  # The gray value between solid and pores.
LOW, HIGH, NOISE = 20.0, 236.0, 8  # Gray values of pores and solid, and how many values noise adds.
EDGE = 1 / 24  # A pore gains this contrast with each voxel of its width.
SPACING_MM = 0.02
MOST_SAMPLES = 1 << 40


class _FoamSlices(SliceReader):
    """The slices of a foam.

    Parameters
    ----------
    slices, size : int
        Rows and columns are equal.
    pore : int
        Width of a pore and its walls, in voxels.
    seed : int
    """

    def __init__(self, slices: int, size: int, pore: int, seed: int) -> None:
        if min(slices, size) < 2 or slices * size * size > MOST_SAMPLES:
            raise SettingsError(f"a foam has at least 2 slices and rows, and no {slices} x {size} x {size} voxels")
        if pore < 4:
            raise SettingsError(f"pores of {pore} voxels cannot be told apart; give 4 or more")
        self.shape, self.dtype = (slices, size, size), np.dtype(np.uint8)
        self.contrast = np.float32(60 * pore * EDGE)
        random = _hashed(np.arange(6, dtype=np.uint32), seed)  # phases of the waves along x, y, z, twice
        self.waves = [
            _waves(np.arange(count), pore, float(phase) / 2**32, float(bend) / 2**32)
            for count, phase, bend in zip((size, size, slices), random[:3], random[3:], strict=True)
        ]
        at = np.arange(size * size, dtype=np.uint32).reshape(size, size)
        self.noise = (_hashed(at, seed + 1) >> np.uint32(24)).astype(np.uint8) % np.uint8(NOISE)

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Write the values."""
        (sine_x, cosine_x), (sine_y, cosine_y), (sine_z, cosine_z) = self.waves
        size = self.shape[1]
        x, y = np.array(columns), np.array(rows)
        plane = sine_x[x] * cosine_y[y, None]
        for layer, z in zip(out, slices, strict=True):
            gyroid = plane + (sine_y[y] * cosine_z[z])[:, None]
            gyroid += sine_z[z] * cosine_x[x]
            gyroid *= self.contrast
            gyroid += np.float32((LOW + HIGH) / 2)
            np.clip(gyroid, np.float32(LOW), np.float32(HIGH), out=gyroid)
            layer[...] = gyroid
            # Noise of one slice, shifted to another place in every slice.
            layer += self.noise[(y + 7919 * z) % size][:, (x + 4099 * z) % size]


def foam(slices: int, size: int, pore: int = 64, seed: int = 0) -> Volume:
    """Return a foam of any size, whose values are made when they are fetched.

    Examples
    --------
    >>> foam(1000, 2000).slab(500, 502).shape
    (2, 2000, 2000)
    """
    affine = np.diag([SPACING_MM, SPACING_MM, SPACING_MM, 1.0])
    return Volume(_FoamSlices(slices, size, pore, seed), affine, name=f"foam-{seed}")


def _waves(at: NDArray[Any], pore: int, phase: float, bend: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return a pair of waves like sine and cosine along an axis; longer waves shift it to and fro."""
    turns = at / pore + phase + 0.11 * _sine(at / (math.pi * pore) + bend)
    return _sine(turns).astype(np.float32), _sine(turns + 0.25).astype(np.float32)


def _sine(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """A parabola up and one down for each turn."""
    share = turns - np.floor(turns)
    half = share - 0.5 * (share >= 0.5)
    return np.where(share < 0.5, 16.0, -16.0) * half * (0.5 - half)


def _hashed(numbers: NDArray[np.uint32], seed: int) -> NDArray[np.uint32]:
    """Return a random number for every number; the finalizer of MurmurHash3, public domain."""
    mixed = numbers + np.uint32(seed * 0x9E3779B9 & 0xFFFFFFFF)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        mixed ^= mixed >> np.uint32(shift)
        mixed *= np.uint32(factor)
    return mixed ^ (mixed >> np.uint32(16))
