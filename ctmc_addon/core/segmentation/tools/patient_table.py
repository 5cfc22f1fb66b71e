# SPDX-License-Identifier: GPL-3.0-or-later
"""The table that a patient lies on: what is behind the body and does not belong to it, in a CT in HU.

The body is anything thick: samples that are not air and lie farther than `CORE_MM` from it, in components at least
as large as of an arm (a tenth of a liter, or `ARM_MM2` through a short scan), and the samples near these. A table top
is thinner, also where it touches the skin. Behind means towards the patient's back: in a column of samples through the
body or beside one, beyond the last sample of the body there; elsewhere beyond the last one of the nearest column. The
table is looked for on samples some 2.5 mm apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Flags
from ...errors import ReadError
from ...measures.units import volume_text
from ...progress import Stages, Steps
from ...volume.slice_reader import SliceReader
from ...volume.value_kind import ValueKind
from ...volume.volume import Volume
from .islands import islands_steps
from .margin import margin_steps

NOT_AIR = -300.0  # A sample of at least this many HU may belong to the body.
AIR = -1000.0  # Removed samples get this many HU.
COARSE_MM = 2.5  # Look at samples this far apart.
CORE_MM = 6.0  # Distance from air: the body has places so far inside, a table top has none.
BODY_MM3, ARM_MM2 = 100_000.0, 600.0  # A core smaller than this, as of a rail, is not part of the body.
STAGES = {"Reading values": 4, "Looking for the table": 6}


@dataclass(frozen=True, eq=False)
class _PatientTable:
    """Position of the table in a CT.

    Parameters
    ----------
    first : integers
        First sample that is removed, counted from the front, of every column that runs front to back: the
        volume's samples (slices, rows, columns) without the axis that does so.
    axis : int
        Axis of (slices, rows, columns) that runs front to back.
    backwards : bool
        Whether its numbers rise towards the front.
    volume_mm3 : float
        Volume of the samples that are removed and are not air, by those that were looked at.
    """

    first: NDArray[np.int32]
    axis: int
    backwards: bool
    volume_mm3: float


def without_table_steps(volume: Volume) -> Steps[Volume]:
    """Return a CT with air behind the body, with a note of how much was removed.

    Parameters
    ----------
    volume : Volume
        In HU, in memory or in a file; the result is so too. Labels are returned as they are.

    Raises
    ------
    ReadError
        If the values are gray values that are not HU.
    """
    if volume.kind == ValueKind.LABEL:
        return volume
    if volume.kind != ValueKind.HU or np.dtype(volume.dtype).kind == "u":
        raise ReadError(
            f"{volume.name} holds {volume.kind}, and a table can be found only in HU; leave out remove_table"
        )
    stages = Stages(STAGES)
    reading, looking = STAGES
    stride = [max(1, min(int(COARSE_MM / mm), size - 1)) for mm, size in zip(volume.spacing, volume.size, strict=True)]
    coarse = yield from stages.run(reading, volume.in_memory_steps((stride[0], stride[1], stride[2])))
    table = yield from stages.run(looking, table_steps(coarse))
    if table is None:
        return replace(volume, notes=(*volume.notes, "No patient table was found"))
    shape = [size for axis, size in enumerate(volume.shape) if axis != table.axis]
    steps = [step for axis, step in enumerate(stride[::-1]) if axis != table.axis]
    count, along = volume.shape[table.axis], stride[2 - table.axis]
    first = _enlarged(table.first, steps, shape) * along
    if table.backwards:  # the first sample that was looked at lies at the back
        first += (count - 1) % along
    note = f"Patient table removed ({volume_text(table.volume_mm3)})"
    reader = _WithoutTable(volume, replace(table, first=first))
    removed = replace(volume, reader=reader, notes=(*volume.notes, note))
    return removed if volume.reader.own_bytes else (yield from removed.in_memory_steps())


def table_steps(ct: Volume) -> Steps[_PatientTable | None]:
    """Find the table of a CT in HU whose samples are a few mm apart; None where nothing is behind the body."""
    side = next(at for at, letter in enumerate(ct.orientation) if letter in "AP")
    axis, backwards = 2 - side, ct.orientation[side] == "A"
    mask: Flags = np.ascontiguousarray(ct.values >= NOT_AIR)
    core = yield from margin_steps(mask, ct.spacing, -CORE_MM)
    length_mm = next(
        size * mm for size, mm, letter in zip(ct.size, ct.spacing, ct.orientation, strict=True) if letter in "SI"
    )
    core = yield from islands_steps(core, ct.voxel_mm3, at_least_mm3=min(BODY_MM3, ARM_MM2 * length_mm))
    body = yield from margin_steps(core, ct.spacing, CORE_MM, within=mask)
    body, mask = (np.moveaxis(each, axis, -1) for each in (body, mask))
    if backwards:
        body, mask = body[..., ::-1], mask[..., ::-1]
    count = body.shape[-1]
    first = np.where(body.any(axis=-1), count - body[..., ::-1].argmax(axis=-1), 0).astype(np.int32)
    if not first.any():
        return None
    first = _filled_columns(first)
    for along in (0, 1):  # what is thick in a column may be thin in the next one, as at the flanks
        width = first.shape[along]
        first = np.max([first.take(np.clip(np.arange(width) + by, 0, width - 1), along) for by in (-1, 0, 1)], axis=0)
    behind = np.count_nonzero(mask & (np.arange(count) >= first[..., None]))
    return _PatientTable(first, axis, backwards, behind * ct.voxel_mm3) if behind else None


def _filled_columns(first: NDArray[np.int32]) -> NDArray[np.int32]:
    """Give columns without the body, 0, the number of the nearest one of their line; empty lines that of the next."""
    filled = first.copy()
    has = first > 0
    lines = np.flatnonzero(has.any(axis=1))
    for line in lines:
        present = np.flatnonzero(has[line])
        middles = np.searchsorted((present[1:] + present[:-1]) / 2, np.arange(first.shape[1]), side="right")
        filled[line] = first[line][present[middles]]
    nearest = lines[np.abs(np.arange(len(first))[:, None] - lines).argmin(axis=1)]
    return np.asarray(filled[nearest])


def _enlarged(first: NDArray[np.int32], steps: list[int], shape: list[int]) -> NDArray[np.int32]:
    """Expand the numbers of every few samples along two axes to all samples: of two neighbors the larger."""
    for axis, (step, size) in enumerate(zip(steps, shape, strict=True)):
        low = np.minimum(np.arange(size) // step, first.shape[axis] - 1)
        high = np.minimum(-(-np.arange(size) // step), first.shape[axis] - 1)
        first = np.maximum(first.take(low, axis), first.take(high, axis))
    return first


class _WithoutTable(SliceReader):
    """Reads the values of another reader, with air instead of a table.

    Parameters
    ----------
    volume : Volume
        Volume that it belongs to.
    table : PatientTable
    """

    def __init__(self, volume: Volume, table: _PatientTable) -> None:
        reader = volume.reader
        self.reader, self.table, self.count = reader, table, volume.shape[table.axis]
        self.start = (0, 0, 0) if volume.box is None else tuple(side[0] for side in volume.box[::-1])
        self.shape, self.dtype = reader.shape, reader.dtype
        self.chunk_slices, self.thread_safe = reader.chunk_slices, reader.thread_safe

    @property
    def own_bytes(self) -> int:
        """Return the bytes of the reader below."""
        return self.reader.own_bytes

    def fill(self, out: NDArray[Any], slices: range, rows: range, columns: range) -> None:
        """Write the values, and air where the table was."""
        self.reader.fill(out, slices, rows, columns)
        table = self.table
        offsets = [np.array(side) - start for side, start in zip((slices, rows, columns), self.start, strict=True)]
        along = offsets.pop(table.axis)
        first = np.expand_dims(table.first[np.ix_(*offsets)], table.axis)
        if table.backwards:
            along = self.count - 1 - along
        shape = [1, 1, 1]
        shape[table.axis] = len(along)
        out[along.reshape(shape) >= first] = AIR
