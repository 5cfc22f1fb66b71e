# SPDX-License-Identifier: GPL-3.0-or-later
"""Match the components of a label at two times by the overlap of their samples, in RAS+ mm.

The grids may differ. Each sample of either grid is looked up in the other one at its position, so that a component
between the samples of a coarse grid is matched too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..arrays import Doubles, Indices
from ..mesh.topology import Groups
from ..progress import PAUSE, Steps
from ..volume.affine import index_to_index, transform_points
from .components import MeasuredLabel

AT_ONCE = 1 << 18  # Look up this many samples at once.


@dataclass(frozen=True, eq=False)
class Matches:
    """Groups of components that overlap.

    Parameters
    ----------
    groups : list of (before, after)
        Positions of components connected by overlaps; one of the two may be empty.
    seen_before, seen_after : (components,) float64
        Share of each component's samples inside the other volume.
    """

    groups: list[tuple[tuple[int, ...], tuple[int, ...]]]
    seen_before: Doubles
    seen_after: Doubles


def matches_steps(before: MeasuredLabel, after: MeasuredLabel, least_share: float) -> Steps[Matches]:
    """Match the components of a label.

    Parameters
    ----------
    before, after : MeasuredLabel
    least_share : float
        Overlaps of less than this share of the smaller component do not count, 0 to 1.
    """
    first, second = len(before.components), len(after.components)
    seen_before, there, samples = yield from _looked_up_steps(before, after)
    seen_after, back, samples_back = yield from _looked_up_steps(after, before)
    keys = np.concatenate([there[:, 0] * second + there[:, 1], back[:, 1] * second + back[:, 0]])
    shared_mm3 = np.concatenate([samples * before.volume.voxel_mm3, samples_back * after.volume.voxel_mm3])
    at_first, at_second = np.divmod(keys, max(second, 1))
    smaller = np.minimum(_voxels_mm3(before)[at_first], _voxels_mm3(after)[at_second])
    linked = shared_mm3 >= least_share * smaller
    groups = Groups(first + second)
    for at, to in zip(at_first[linked].tolist(), at_second[linked].tolist(), strict=True):
        groups.join(at, first + to)
    parts = [
        (tuple(at for at in own if at < first), tuple(at - first for at in own if at >= first))
        for own in groups.lists()
    ]
    return Matches(parts, seen_before, seen_after)


def _voxels_mm3(label: MeasuredLabel) -> Doubles:
    return np.array([each.voxels for each in label.components], np.float64) * label.volume.voxel_mm3


def _looked_up_steps(label: MeasuredLabel, target: MeasuredLabel) -> Steps[tuple[Doubles, Indices, Indices]]:
    """Return the share of each component inside the target's volume, overlapping pairs (n, 2), and their samples, (n,).

    A pair is a component of the label and one of the target.
    """
    count, target_count = len(label.components), len(target.components)
    pair_keys, shared = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    seen = np.zeros(count, np.int64)
    matrix = index_to_index(label.volume.affine, target.volume.affine)
    size = np.array(target.volume.size)
    box = np.array(target.box)  # (3, 2)
    runs = label.runs
    lengths = np.cumsum(runs.stop - runs.start)
    total = int(lengths[-1]) if len(lengths) else 0
    cuts = [0, *np.searchsorted(lengths, np.arange(AT_ONCE, total, AT_ONCE)).tolist(), len(lengths)]
    for start, stop in pairwise(cuts):
        z, y, x, component = (along[start:stop] for along in (runs.z, runs.y, runs.start, runs.component))
        block = replace(runs, z=z, y=y, start=x, stop=runs.stop[start:stop], component=component)
        z, y, x, component = block.samples(np.ones(count, bool))
        at = transform_points(matrix, np.stack([x, y, z], axis=1))
        nearest = np.floor(at + 0.5).astype(np.int64)
        inside = ((nearest >= 0) & (nearest < size)).all(axis=1)
        seen += np.bincount(component[inside], minlength=count)
        inside &= ((nearest >= box[:, 0]) & (nearest < box[:, 1])).all(axis=1)
        x, y, z = (nearest[inside] - box[:, 0]).T
        number = target.numbers[z, y, x].astype(np.int64)
        pairs = component[inside][number >= 0] * target_count + number[number >= 0]
        pair, times = np.unique(pairs, return_counts=True)
        pair_keys.append(pair)
        shared.append(times)
        yield PAUSE
    pair, where = np.unique(np.concatenate(pair_keys), return_inverse=True)
    times = np.zeros(len(pair), np.int64)
    np.add.at(times, where, np.concatenate(shared))
    share = seen / np.array([each.voxels for each in label.components], np.float64)
    return share, np.stack(np.divmod(pair, max(target_count, 1)), axis=1), times
