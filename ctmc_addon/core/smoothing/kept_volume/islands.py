# SPDX-License-Identifier: GPL-3.0-or-later
"""A constant for each small component of a label, so that an island keeps its volume.

One constant for a whole label follows its largest component, and islands shrink to a few percent or less of their
samples. So the constant of each island is sought before: the island alone is copied into a box, the boxes of all are
stacked along z, and one surface of the stack gives the volumes of all. No volume work is done island by island.

An island's constant is added at its own samples, at the steps between them and the next slice, and at the samples
outside that are neighbors of those: no other value moves its surface. A sample outside that is a neighbor of two
components has the constant of the smaller. The bounds hold as everywhere, so no sample changes sides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...arithmetic import cube_root
from ...arrays import Doubles, Flags, Floats, Ints
from ...extraction.grid import make_grid
from ...extraction.marching_cubes import extract_steps
from ...machine.budget import Budget
from ...mesh.triangle_mesh import Surface
from ...progress import PAUSE, Steps
from ..bounds import NEAREST_ZERO
from ..bricks import WIDTH
from ..label_components import Indices, LabelComponents, label_components_steps
from .refined_label import RefinedLabel
from .volume_constant import area_of_ball

WAYS = ((0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0))  # Steps to neighbors along z, y and x.

LARGEST_ISLAND = 1 << 14  # In voxels; one constant for all keeps larger ones within a few percent.
CLOSE_ENOUGH = 0.03  # An island's volume may be off by this share.
FIRST_GUESS = 1.65  # In voxel sides per root of the number of voxels; islands of livers mostly need this.
MOST_TRIALS = 12
MOST_ROUNDS = 3
STACK_SAMPLES = 1 << 19  # Boxes whose surfaces are made at once have up to this many samples.
SMALLEST_SIDE = 8  # A box has at least this side along x and y.


@dataclass(frozen=True, eq=False)
class _Samples:
    """Samples of the refined grid that islands move, each once, and where each island reads them.

    A voxel of an island has 2 steps - 1 places: its own sample and the steps before and behind it, as far as the next
    slices. Place p of voxel v has the number (2 steps - 1) v + p.

    Parameters
    ----------
    brick, lane, owner : (n,) int32
        Row and column of the bricks' arrays, and the component whose constant is added.
    z, y, x, component : (voxels,) int32
    core : (voxels, 2 steps - 1) int32
        The sample at each place of each voxel, n beyond the ends of the grid.
    rim_place, rim, rim_way : (m,) int32, int32, int8
        Place, neighbor's sample and direction, of `WAYS`, of every neighbor outside of a place. From
        n + 1 on it is a sample that is read as outside, because another component or the border is there.
    """

    brick: Ints
    lane: Ints
    owner: Ints
    z: Ints
    y: Ints
    x: Ints
    component: Ints
    core: Ints
    rim_place: Ints
    rim: Ints
    rim_way: NDArray[np.int8]


def keep_islands_steps(label: RefinedLabel, budget: Budget) -> Steps[None]:
    """Give each small component of a label a constant of its own, in the field before the common constant.

    Where one component has more than half of the samples, the islands' values are final: field and bounds are set to
    them, and the constant that is found afterwards for the whole moves what is not an island. Else it moves all.
    """
    start = label.start
    components = yield from label_components_steps(label.mask)
    voxels = components.voxels
    has_body = 2 * int(voxels[-1]) > int(voxels.sum())
    selected = voxels <= LARGEST_ISLAND
    if has_body:
        selected[-1] = False
    if len(voxels) == 1 or not selected.any():
        return
    samples = yield from _samples_steps(label, components, selected)
    field, low, high = (array[samples.brick, samples.lane] for array in (start.field, start.low, start.high))
    constants = yield from _Solving(label, components, selected, samples).solve_steps(field, low, high, budget)
    moved = field + constants[samples.owner]
    active = samples.brick < label.bricks.active
    at = samples.brick[active], samples.lane[active]
    if has_body:
        moved = np.minimum(np.maximum(moved, low), high)
        start.low[at] = start.high[at] = moved[active]
    start.field[at] = moved[active]


def _samples_steps(label: RefinedLabel, components: LabelComponents, selected: Flags) -> Steps[_Samples]:
    """The samples that the selected components move."""
    mask, steps, inside = label.mask, label.slice_steps, label.inside
    slices, rows, columns = mask.shape
    last, places = (slices - 1) * steps, 2 * steps - 1
    z, y, x, component = (along.astype(np.int32) for along in components.samples(selected))
    yield PAUSE

    def flat(z: Ints, y: Ints, x: Ints) -> Indices:
        return (z.astype(np.int64) * rows + y) * columns + x

    def labeled(z: Ints, y: Ints, x: Ints) -> Flags:
        """Whether samples of the label's grid are inside; none is beyond its border."""
        within = (z >= 0) & (z < slices) & (y >= 0) & (y < rows) & (x >= 0) & (x < columns)
        inside = np.zeros(len(z), bool)
        inside[within] = mask[z[within], y[within], x[within]]
        return inside

    core_z = z[:, None] * steps + np.arange(1 - steps, steps, dtype=np.int32)
    core_flat = np.where((core_z >= 0) & (core_z <= last), flat(core_z, y[:, None], x[:, None]), -1).ravel()
    del core_z
    rims: list[tuple[Ints, NDArray[np.int8], Indices, Flags]] = []  # place, way, flat index, whether it is taken
    for way, (dz, dy, dx) in enumerate(WAYS):
        voxel = np.flatnonzero(~labeled(z + dz, y + dy, x + dx))
        if dz:
            # Behind the first and the last slice of the grid is the border.
            border = (z[voxel] + dz < 0) | (z[voxel] + dz >= slices)
            place = voxel * places + np.where(border, steps - 1, (places - 1) * (dz > 0))
        else:
            place = (voxel[:, None] * places + np.arange(places)).ravel()
        place = place[core_flat[place] >= 0]
        voxel, step = np.divmod(place, places)
        rim_z = (z[voxel] * steps + step + (1 - steps + dz)).astype(np.int32)
        rim_y, rim_x = y[voxel] + np.int32(dy), x[voxel] + np.int32(dx)
        within = (rim_z >= 0) & (rim_z <= last) & (rim_y >= 0) & (rim_y < rows) & (rim_x >= 0) & (rim_x < columns)
        below, step = np.divmod(rim_z, np.int32(steps))
        taken = labeled(below, rim_y, rim_x) | ((step > 0) & labeled(below + 1, rim_y, rim_x))
        index = np.where(within, flat(rim_z, rim_y, rim_x), -1)
        rims.append((place.astype(np.int32), np.full(len(place), way, np.int8), index, taken))
        yield PAUSE
    rim_place, rim_way, rim_flat, taken = (np.concatenate([rim[part] for rim in rims]) for part in range(4))
    del rims

    free = np.flatnonzero(~taken & (rim_flat >= 0))
    valid = np.flatnonzero(core_flat >= 0)
    samples, number = np.unique(np.concatenate([core_flat[valid], rim_flat[free]]), return_inverse=True)
    number = number.ravel().astype(np.int32)
    yield PAUSE
    count = len(samples)
    core = np.full(core_flat.size, count, np.int32)
    core[valid] = number[: len(valid)]
    del core_flat
    rim = core[rim_place] + np.int32(count + 1)
    rim[free] = number[len(valid) :]
    outer = np.flatnonzero(taken & (rim_flat >= 0))
    at = np.minimum(np.searchsorted(samples, rim_flat[outer]), count - 1)
    present = samples[at] == rim_flat[outer]
    rim[outer[present]] = at[present] + (count + 1)
    del rim_flat
    yield PAUSE
    # Of several components that write, the last one stays: the smallest.
    writing = np.concatenate([component[valid // places], component[rim_place[free] // places]])
    order = np.argsort(-writing, kind="stable")
    owner = np.empty(count, np.int32)
    owner[number[order]] = writing[order]

    line, column = np.divmod(samples, columns)
    layer, row = np.divmod(line, rows)
    column += inside.x[0]
    brick = label.bricks.at(layer + inside.z[0] * steps, row + inside.y[0], column // WIDTH)
    yield PAUSE
    brick, lane = brick.astype(np.int32), (column % WIDTH).astype(np.int32)
    return _Samples(brick, lane, owner, z, y, x, component, core.reshape(-1, places), rim_place, rim, rim_way)


class _Solving:
    """Islands whose constants are sought."""

    def __init__(self, label: RefinedLabel, components: LabelComponents, selected: Flags, samples: _Samples) -> None:
        self.samples, self.selected = samples, selected
        self.steps, self.sides, self.adds_slices = label.slice_steps, label.sides, label.adds_slices
        self.nearest, self.limit = np.float32(NEAREST_ZERO * min(label.spacing_mm)), label.limit_mm
        steps, slices = label.slice_steps, len(label.mask)
        low, high = components.boxes()
        self.corner = (low - 1) * (steps, 1, 1)  # of every component's box, z, y, x
        self.size = (high - low + 2) * (steps, 1, 1) + 1
        self.at_first, self.at_last = low[:, 0] == 0, high[:, 0] == slices - 1
        middle = self.sides[0] * self.sides[1] * self.sides[2]
        # At an end of the grid the surface is cut half a refined slice outside, unless slices are added.
        at_end = (components.z == 0) | (components.z == slices - 1)
        weight = np.where(at_end & (not self.adds_slices), (steps + 1) / 2, steps) * (
            components.stop - components.start
        )
        self.goal = middle * np.bincount(components.component, weight, len(selected))

    def solve_steps(self, field: Floats, low: Floats, high: Floats, budget: Budget) -> Steps[Floats]:
        """The constants of all components, (components,) float32; 0 of those that are not selected.

        The neighbors of an island change its volume where they share samples: those are looked at again.
        """
        voxel_mm3 = self.sides[0] * self.sides[1] * self.sides[2] * self.steps
        constant = FIRST_GUESS * cube_root(voxel_mm3) * np.sqrt(voxel_mm3 / self.goal)
        constant[~self.selected] = 0.0
        open_ = self.selected
        for _ in range(MOST_ROUNDS):
            constant = yield from self._round_steps(constant, open_, (field, low, high), budget)
            open_ = self._sharing()
            if not open_.any():
                break
        return constant.astype(np.float32)

    def _sharing(self) -> Flags:
        """Return which components read samples that another one moves."""
        samples = self.samples
        component = samples.component[samples.rim_place // samples.core.shape[1]]
        # A sample beyond the last is one that is read as outside; the two at n are none.
        owner = np.concatenate([samples.owner, [-1], samples.owner, [-1]])[samples.rim]
        sharing = np.zeros(len(self.selected), bool)
        sharing[component[owner != component]] = True
        return sharing

    def _round_steps(
        self, constant: Doubles, open_: Flags, bounds: tuple[Floats, Floats, Floats], budget: Budget
    ) -> Steps[Doubles]:
        """Find constants at which the open components are close enough, from these on; closed ones keep theirs."""
        field, low, high = bounds
        best, best_off = constant.copy(), np.full(len(constant), np.inf)
        below, above = np.full(len(constant), np.nan), np.full(len(constant), np.nan)  # on either side of the goal
        below_volume, above_volume = np.zeros(len(constant)), np.zeros(len(constant))
        for trial in range(MOST_TRIALS):
            added = constant.astype(np.float32)[self.samples.owner]
            values = np.minimum(np.maximum(field + added, low), high)
            volume, area = yield from self._volumes_steps(values, open_, budget)
            off = np.abs(volume - self.goal) / self.goal
            better = open_ & (off < best_off)
            best[better], best_off[better] = constant[better], off[better]
            too_small = open_ & (volume < self.goal)
            too_large = open_ & ~too_small
            below[too_small], below_volume[too_small] = constant[too_small], volume[too_small]
            above[too_large], above_volume[too_large] = constant[too_large], volume[too_large]
            open_ = open_ & (off > CLOSE_ENOUGH)
            if not open_.any():
                break
            # By the area, at least that of a ball, until the goal lies between two; a little more each time.
            step = (self.goal - volume) / np.maximum(area, area_of_ball(self.goal))
            following = constant + step * 1.25**trial
            both = np.isfinite(below) & np.isfinite(above)
            share = (self.goal - below_volume) / np.where(both, above_volume - below_volume, 1.0)
            share = np.clip(share, 0.1, 0.9) if trial % 3 else np.full(len(constant), 0.5)
            following[both] = (below + share * (above - below))[both]
            following = np.clip(following, -self.limit, self.limit)
            open_ = open_ & (following.astype(np.float32) != constant.astype(np.float32))
            constant = np.where(open_, following, best)
        return best

    def _volumes_steps(self, values: Floats, open_: Flags, budget: Budget) -> Steps[tuple[Doubles, Doubles]]:
        """Volume and area, mm3 and mm2, that the surface of every open component has with these values, (n,)."""
        volume, area = np.zeros(len(open_)), np.zeros(len(open_))
        side = np.maximum(self.size[:, 1], self.size[:, 2])
        side = np.maximum(SMALLEST_SIDE, np.left_shift(1, np.frexp(side - 1)[1]))  # a power of two
        beyond = np.full(1, -self.nearest)
        all_values = np.concatenate([values, beyond, -np.abs(values), beyond])  # float32, and below zero from n on
        for length in np.unique(side[open_]):
            group = np.flatnonzero(open_ & (side == length))
            ends = np.cumsum(self.size[group, 0])
            stack = (ends - 1) // max(1, STACK_SAMPLES // int(length) ** 2)
            for number in np.unique(stack):
                part = group[stack == number]
                surface = yield from self._stack_surface_steps(all_values, part, int(length), budget)
                if surface is not None:
                    volume[part], area[part] = self._measured(surface, part)
        return volume, area

    def _stack_surface_steps(
        self, all_values: Floats, part: Indices, length: int, budget: Budget
    ) -> Steps[Surface | None]:
        """The surface of the boxes of these components, stacked along z; None where no value is inside."""
        samples, layer = self.samples, length * length
        layers = self.size[part, 0]
        first = np.full(len(self.selected), np.iinfo(np.int64).min)  # where sample (0, 0, 0) of the grid would be
        z, y, x = self.corner[part].T
        first[part] = (np.cumsum(layers) - layers) * layer - (z * layer + y * length + x)
        in_stack = first > np.iinfo(np.int64).min
        stack = np.full(int(layers.sum()) * layer, -self.nearest, np.float32)
        places = samples.core.shape[1]
        position = first[samples.component] + samples.y.astype(np.int64) * length + samples.x
        position += (samples.z.astype(np.int64) * self.steps + (1 - self.steps)) * layer  # of a voxel's first place

        rim = np.flatnonzero(in_stack[samples.component[samples.rim_place // places]])
        voxel, step = np.divmod(samples.rim_place[rim], places)
        offsets = np.array([dz * layer + dy * length + dx for dz, dy, dx in WAYS])
        stack[position[voxel] + step * np.int64(layer) + offsets[samples.rim_way[rim]]] = all_values[samples.rim[rim]]
        yield PAUSE
        voxel = np.flatnonzero(in_stack[samples.component])
        core = all_values[samples.core[voxel]]  # (voxels, 2 steps - 1)
        # What lies behind the first value below zero, seen from the voxel, stays below zero.
        for way in (core[:, self.steps - 1 :], core[:, self.steps - 1 :: -1]):
            out = np.logical_or.accumulate(way < 0, axis=1)
            way[out & (way >= 0)] = -self.nearest
        at = position[voxel, None] + np.arange(places) * layer
        real = samples.core[voxel] < len(samples.owner)
        stack[at[real]] = core[real]
        yield PAUSE
        if not (stack >= 0).any():
            return None
        boxes = stack.reshape(-1, length, length)
        if self.adds_slices:
            ends = np.cumsum(layers)
            _close_ends(boxes, (ends - layers)[self.at_first[part]] + self.steps, -1, self.steps)
            _close_ends(boxes, ends[self.at_last[part]] - 1 - self.steps, 1, self.steps)
        grid = make_grid(boxes)
        return (yield from extract_steps(grid, 0.0, False, budget))

    def _measured(self, surface: Surface, part: Indices) -> tuple[Doubles, Doubles]:
        """Volume and area of every component of a stack, (part,) each."""
        layers = self.size[part, 0]
        box = np.repeat(np.arange(len(part)), layers)
        begin = (np.cumsum(layers) - layers)[box]  # (layers,)
        points = surface.linear.T.astype(np.float64)  # (3, V)
        of_vertex = box[points[2].astype(np.intp)]
        points[2] -= begin[points[2].astype(np.intp)]
        of = of_vertex[surface.faces[:, 0]]
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (
            [along[surface.faces[:, corner]] * length for along, length in zip(points, self.sides, strict=True)]
            for corner in range(3)
        )
        along_z = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        along_x = (by - ay) * (cz - az) - (cy - ay) * (bz - az)
        along_y = (bz - az) * (cx - ax) - (cz - az) * (bx - ax)
        areas = np.sqrt(along_x * along_x + along_y * along_y + along_z * along_z) / 2
        volumes = along_z * (az + bz + cz) / 6
        volume, area = (np.bincount(of, weights, len(part)).astype(np.float64) for weights in (volumes, areas))
        return volume, area


def _close_ends(boxes: Floats, end: Indices, way: int, steps: int) -> None:
    """Repeat the layers at the end of the grid outwards, as `smooth_field.with_closed_ends` does; in place."""
    values = boxes[end]
    copies = steps // 2
    for copy in range(1, copies + 1):
        boxes[end + way * copy] = values
    boxes[end + way * (copies + 1)] = -np.abs(values) * np.float32(1 if steps % 2 else 1000)
