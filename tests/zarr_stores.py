# SPDX-License-Identifier: GPL-3.0-or-later
"""OME-Zarr stores for the tests: written by zarr, and of version 2 by hand."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np

LENGTHS = {"z": 2.0, "y": 0.5, "x": 0.7}
SHIFTS = {"z": 10.0, "y": 20.0, "x": -30.0}


def multiscales(version, axes="zyx", levels=1, unit="millimeter", **more):
    """The metadata of an image whose level n has every 2^n-th sample along z, y and x."""
    types = {"t": {"type": "time"}, "c": {"type": "channel"}}
    space = {"type": "space", **({"unit": unit} if unit else {})}
    datasets = []
    for level in range(levels):
        scale = [LENGTHS.get(axis, 1.0) * (2**level if axis in LENGTHS else 1) for axis in axes]
        shift = [SHIFTS.get(axis, 0.0) for axis in axes]
        transforms = [{"type": "scale", "scale": scale}, {"type": "translation", "translation": shift}]
        datasets.append({"path": str(level), "coordinateTransformations": transforms})
    named = [{"name": axis, **types.get(axis, space)} for axis in axes]
    return {**({"version": version} if version == "0.4" else {}), "axes": named, "datasets": datasets, **more}


def attributes(version, **about):
    """What OME-Zarr says, where its version has it."""
    return about if version == "0.4" else {"ome": {"version": version, **about}}


def save_store(
    folder, values, version="0.5", axes="zyx", levels=1, chunks=None, about=None, unit="millimeter", **options
):
    """Write a store by zarr; `about` is said of it beside its multiscales, `options` go to its arrays."""
    import zarr

    group = zarr.open_group(str(folder), mode="w", zarr_format=2 if version == "0.4" else 3)
    for level in range(levels):
        part = values[tuple(slice(None, None, 2**level if axis in LENGTHS else 1) for axis in axes)]
        sides = tuple(min(side, size) for side, size in zip(chunks or part.shape, part.shape, strict=True))
        array = group.create_array(str(level), shape=part.shape, chunks=sides, dtype=part.dtype, **options)
        array[...] = part
    images = [multiscales(version, axes, levels, unit)]
    group.attrs.update(attributes(version, multiscales=images, **(about or {})))
    return Path(folder)


def save_by_hand(folder, values, chunks, dtype=None, separator="/", skip=(), attrs=None, **metadata):
    """Write a store of Zarr 2 and OME-Zarr 0.4 without zarr: plain chunks, those in `skip` left out."""
    folder = Path(folder)
    (folder / "0").mkdir(parents=True)
    stored = np.dtype(dtype or values.dtype)
    array = {"zarr_format": 2, "shape": list(values.shape), "chunks": list(chunks), "dtype": stored.str, "order": "C"}
    array |= {"compressor": None, "filters": None, "fill_value": 0, "dimension_separator": separator, **metadata}
    (folder / ".zgroup").write_text('{"zarr_format": 2}')
    (folder / ".zattrs").write_text(json.dumps(attrs or {"multiscales": [multiscales("0.4")]}))
    (folder / "0" / ".zarray").write_text(json.dumps(array))
    counts = [-(-size // side) for size, side in zip(values.shape, chunks, strict=True)]
    for number in itertools.product(*map(range, counts)):
        if number in skip:
            continue
        window = tuple(slice(at * side, (at + 1) * side) for at, side in zip(number, chunks, strict=True))
        chunk = np.zeros(chunks, stored)
        part = values[window]
        chunk[tuple(map(slice, part.shape))] = part
        path = folder / "0" / separator.join(map(str, number))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(chunk.tobytes())
    return folder
