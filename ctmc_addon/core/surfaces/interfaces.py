# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the surfaces of labels that touch as one complex: a wall between two labels is made once.

Label by label -> its field, as for that label alone -> owner of every sample -> triangles between owners -> constants
that keep all volumes -> RAS+ mm
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CtmcError, LabelError, MeshError, ThresholdError
from ..extraction.grid import Axis, make_axes
from ..extraction.interfaces.bands import BandFaces, band_ranges, fill_band, find_band
from ..extraction.interfaces.constants import EXACT_ENOUGH, ROUNDS, measured_pairs_steps, next_constants, next_gain
from ..extraction.interfaces.crossings import ComplexVertices, Crossings, crossings_of
from ..extraction.interfaces.label_samples import LabelSamples, label_samples_steps
from ..extraction.interfaces.owners import Owners, owner_type, owners_bytes, owners_steps
from ..extraction.interfaces.walls import Wall, find_walls, islands_steps, walls_at_once, walls_samples_steps
from ..machine.budget import Budget
from ..machine.parallel import map_steps, side_by_side_steps
from ..mesh.labels.label_complex import ComplexSurface
from ..progress import PAUSE, Stages, Steps, equal_part
from ..settings import ReconstructionSettings
from ..smoothing.methods import smoothing_of
from ..smoothing.prepare import field_steps
from ..smoothing.smooth_field import refined_affine
from ..volume.affine import transform_faces, transform_points
from ..volume.field_values import fetched_steps
from ..volume.volume import Box, Volume
from .each_label import each_label_steps, label_title, no_surface
from .request import Scope, scope_of_labels

FIELDS, WALLS, OWNING, CROSSING, PLACING, KEEPING, MOVING = (
    "Smoothing the labels",
    "Smoothing shared walls",
    "Assigning samples to labels",
    "Joining shared walls",
    "Placing vertices and triangles",
    "Keeping the volumes",
    "Moving to millimeters",
)
STAGES = {FIELDS: 60, WALLS: 20, OWNING: 8, CROSSING: 8, PLACING: 12, KEEPING: 10, MOVING: 2}
REMEDY = "choose a region, fewer labels or slice_steps, or interfaces separate"
VERTEX_BYTES = 300  # Includes its triangles.
POINTS_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False)
class LabelComplex:
    """The surfaces of several labels as one complex, and how they were made.

    Parameters
    ----------
    surface : ComplexSurface
        In RAS+ mm; its sides are the labels' values.
    labels : tuple of int
        Labels with a surface, rising.
    errors : dict of int to CtmcError
        The reason for each label without a surface.
    thresholds : dict of int to float
        Threshold of every label's field.
    notes : dict of int to tuple of str
        Notes on every label.
    wrong_side : dict of int to int
        Samples of the grid inside a label or inside its surface, but not both.
    volumes_mm3, label_mm3 : dict of int to float
        Volume of a label's surface at alpha 1, closed at the border, and of its samples in the same space.
    constants_mm : dict of int to float
        Added to a label's field where it touches others.
    scope : Scope
    """

    surface: ComplexSurface
    labels: tuple[int, ...]
    errors: dict[int, CtmcError]
    thresholds: dict[int, float]
    notes: dict[int, tuple[str, ...]]
    wrong_side: dict[int, int]
    volumes_mm3: dict[int, float]
    label_mm3: dict[int, float]
    constants_mm: dict[int, float]
    scope: Scope


@dataclass(frozen=True, eq=False)
class _LabelField:
    """Field of one label before it meets the others; without samples if labels are not smoothed."""

    samples: LabelSamples | None
    window: Box
    origin: tuple[int, int, int]
    first_slice: int
    threshold: float
    notes: tuple[str, ...]


def complex_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    labels: Sequence[int],
    budget: Budget | None = None,
    all_needed: bool = True,
    scope: Scope | None = None,
) -> Steps[LabelComplex]:
    """Make the surfaces of several labels as one complex.

    Parameters
    ----------
    volume : Volume
    settings : ReconstructionSettings
        Settings of all labels; their own label is ignored.
    labels : sequence of int
    budget : Budget, optional
        Threads and memory; the result does not depend on it.
    all_needed : bool
        Whether a label without a surface raises an error; otherwise it is left out.
    scope : Scope, optional
        Scope of volume and settings, if it is already known.

    Raises
    ------
    CtmcError
        As `reconstruct`.
    """
    scope = scope or scope_of_labels(volume, settings)
    making = _LabelInterfaces(volume, settings, budget or Budget(), all_needed, scope)
    yield from making.fields_steps(labels)
    yield from making.owners_steps()
    yield from making.bands_steps()
    yield from making.constants_steps()
    return (yield from making.result_steps())


class _LabelInterfaces:
    """Make a complex, stage by stage."""

    owners: Owners
    placed: ComplexVertices

    def __init__(
        self, volume: Volume, settings: ReconstructionSettings, budget: Budget, all_needed: bool, scope: Scope
    ) -> None:
        self.all_needed, self.scope, self.slice_steps = all_needed, scope, scope.slice_steps
        self.volume, self.budget = volume.as_labels, budget
        self.settings = replace(settings, threshold=None, label=None)
        self.stages = Stages(STAGES)
        self.smoothing = smoothing_of(replace(self.settings, label=1))
        self.has_distances = self.smoothing.smooths and self.smoothing.keeps_samples
        scope.require_stride()

    def fields_steps(self, labels: Sequence[int]) -> Steps[None]:
        """Make the field of every label by itself."""
        volume, region = self.volume, self.scope.region
        distinct = sorted(set(labels))
        runs = [replace(self.settings, label=label) for label in distinct]

        def work_steps(at: int, own: Budget) -> Steps[_LabelField]:
            field = yield from field_steps(volume, runs[at], own, region=region)
            if self.smoothing.by_slabs:
                field.check()  # Other smoothings have checked it before.
            samples = (yield from label_samples_steps(field)) if self.smoothing.smooths else None
            return _LabelField(samples, field.window, field.origin, field.first_slice, field.threshold, field.notes)

        results = yield from self.stages.run(FIELDS, each_label_steps(volume, region, runs, work_steps, self.budget))
        self.labels: list[int] = []
        self.fields: list[_LabelField] = []
        self.errors: dict[int, CtmcError] = {}
        for label, result in zip(distinct, results, strict=True):
            if isinstance(result, _LabelField):
                self.labels.append(label)
                self.fields.append(result)
            elif not self.all_needed and isinstance(result, (LabelError, MeshError, ThresholdError)):
                self.errors[label] = result
            else:
                raise result
        if not self.fields:
            raise no_surface(volume, self.errors)

    def owners_steps(self) -> Steps[None]:
        """Find the owner of every sample of the grid that all labels share."""
        axes = self._axes()
        count = axes[0].count * axes[1].count * axes[2].count
        indicators, steps = not self.smoothing.keeps_samples, self.slice_steps
        size = " x ".join(str(axis.count) for axis in axes)
        box = _union([field.window for field in self.fields])
        voxels = math.prod(stop - start for start, stop in box)
        needed = owners_bytes(count, voxels, len(self.labels), indicators, steps > 1)
        self.budget.require(needed, f"the common grid of {len(self.labels)} labels, {size} samples,", REMEDY)
        samples = [field.samples for field in self.fields if field.samples is not None]
        own = yield from self.stages.run(OWNING, self._labels_steps())
        self.walls: dict[tuple[int, int], LabelSamples] = {}
        if self.has_distances:
            yield from self.stages.run(WALLS, self._walls_steps(own, samples))
        first_x, first_y, first_z = self.first
        columns, rows = axes[0].index[1:-1] - first_x, axes[1].index[1:-1, None] - first_y
        number = np.zeros((axes[2].count, axes[1].count, axes[0].count), own.dtype)
        layers = []  # Fields decide the owners in these.
        for layer in range(1, axes[2].count - 1):
            slice_, step = divmod(int(axes[2].index[layer]), steps)
            if indicators or step or not 0 <= slice_ - first_z < len(own):
                layers.append(layer)
            else:
                number[layer, 1:-1, 1:-1] = own[slice_ - first_z, rows, columns]

        def filled(slice_: int) -> NDArray[np.bool_] | None:
            below, step = divmod(slice_, steps)
            if not step or not 0 <= below - first_z < len(own) - 1:
                return None
            return (own[below - first_z, rows, columns] > 0) & (own[below - first_z + 1, rows, columns] > 0)

        threads = self.budget.thread_count
        owning = owners_steps(axes, number, layers, samples, self.walls, indicators, filled, threads)
        self.owners = yield from self.stages.run(OWNING, owning)
        self.wrong_side = np.zeros(len(self.labels) + 1, np.int64)
        if indicators:  # else the label owns its samples
            yield from self.stages.run(OWNING, self._compare_steps(own))

    def _labels_steps(self) -> Steps[NDArray[Any]]:
        """Return the label of every voxel in the box of all windows, counted from 1; count their volumes."""
        x, y, z = _union([field.window for field in self.fields])
        self.first = (x[0], y[0], z[0])
        values = np.array(self.labels)
        out = np.empty((z[1] - z[0], y[1] - y[0], x[1] - x[0]), owner_type(len(values)))
        self.goals = np.zeros(len(values) + 1)
        for at, slice_ in enumerate(range(*z)):
            fetched = (yield from fetched_steps(self.volume, [slice_]))[0, slice(*y), slice(*x)].reshape(-1)
            begins = np.flatnonzero(np.concatenate([[True], fetched[1:] != fetched[:-1]]))  # of runs of one value
            value, length = fetched[begins], np.diff(begins, append=fetched.size)
            label = np.searchsorted(values, value).clip(max=len(values) - 1)
            own = np.where(values[label] == value, label + 1, 0).astype(out.dtype)
            out[at] = np.repeat(own, length).reshape(out.shape[1:])
            self.goals += np.bincount(own, length, len(values) + 1) * self._share(slice_)
        sx, sy, sz = self.volume.spacing
        self.goals *= sx * sy * sz / self.slice_steps
        return out

    def _walls_steps(self, own: NDArray[Any], samples: Sequence[LabelSamples]) -> Steps[None]:
        """Smooth the field of every wall, side by side, small walls at once."""
        yield PAUSE
        parts = walls_at_once(find_walls(own))
        small = yield from islands_steps(own)
        spacing, steps = self.volume.spacing, self.slice_steps
        threads = self.budget.thread_count
        at_once = threads if len(parts) > 1 else 1
        budget = self.budget.shared_by(at_once)

        def smooth_steps(walls: Sequence[Wall]) -> Steps[dict[tuple[int, int], LabelSamples]]:
            return (yield from walls_samples_steps(walls, own, small, self.first, samples, spacing, steps, budget))

        works = [lambda walls=walls: smooth_steps(walls) for walls in parts]
        weights = [float(sum(math.prod(stop - start for start, stop in wall.box) for wall in walls)) for walls in parts]
        for smoothed in (yield from side_by_side_steps(works, weights, at_once)):
            self.walls.update(smoothed)

    def _axes(self) -> tuple[Axis, Axis, Axis]:
        """Return the samples of the box around all windows; slices along z are refined."""
        x, y, (low, end) = _union([field.window for field in self.fields])
        steps, closed = self.slice_steps, self.settings.close_border
        first, last = low * steps, (end - 1) * steps
        if closed and steps > 1:  # as the fields of labels that reach the border have it
            copies, crossing = divmod(steps - 1, 2)
            first -= copies + 2 * crossing if low == 0 else copies
            last += copies + 2 * crossing if end == self.volume.size[2] else copies
        return make_axes((x, y, (first, last + 1)), self.settings.stride, True)

    def _compare_steps(self, own: NDArray[Any]) -> Steps[None]:
        """Count the samples whose label is not their owner, for both."""
        x, y, z = self.owners.x, self.owners.y, self.owners.z
        first_x, first_y, first_z = self.first
        rows, columns = y.index[1:-1, None] - first_y, x.index[1:-1] - first_x
        for layer in range(1, z.count - 1):
            owner = self.owners.number[layer, 1:-1, 1:-1]
            label = own[z.index[layer] - first_z, rows, columns]
            differs = label != owner
            if differs.any():
                for either in (label, owner):
                    self.wrong_side += np.bincount(either[differs], minlength=len(self.wrong_side))
            yield PAUSE

    def _share(self, slice_: int) -> float:
        """Return how many refined slices a sample of a slice counts for, closed at the border."""
        steps, closed = self.slice_steps, self.settings.close_border
        low, end = _union([field.window for field in self.fields])[2]
        share = float(steps)
        for is_end, is_last in ((slice_ == low, low == 0), (slice_ == end - 1, end == self.volume.size[2])):
            if is_end:
                beyond = 0.5 if not closed or steps == 1 else steps / 2 if is_last else (steps - 1) // 2 + 0.5
                share += beyond - steps / 2
        return share

    def bands_steps(self) -> Steps[None]:
        """Find crossed edges and triangles, band by band."""
        threads = self.budget.thread_count
        owners = self.owners
        ranges = band_ranges(owners.number.shape)
        finding = map_steps(lambda layers: find_band(owners, *layers), ranges, threads)
        bands = yield from self.stages.run(CROSSING, finding)
        counts = np.array([band.counts for band in bands])  # (bands, lists)
        ends = np.cumsum(counts.reshape(-1))
        starts = (ends - counts.reshape(-1)).reshape(counts.shape)
        total = int(ends[-1])
        if total > np.iinfo(np.int32).max:
            raise MeshError(f"{total} vertices are more than a mesh can number; use a larger stride")
        self.budget.require(total * VERTEX_BYTES, f"a complex of about {2 * total} triangles", REMEDY)
        samples = [field.samples for field in self.fields if field.samples is not None]

        def fill(at: int) -> tuple[BandFaces, list[Crossings]]:
            above = (None, []) if at + 1 == len(bands) else (bands[at + 1], starts[at + 1].tolist())
            faces = fill_band(owners, bands[at], starts[at].tolist(), *above)
            return faces, [crossings_of(owners, bands[at], axis, samples, self.walls) for axis in range(3)]

        filled = yield from self.stages.run(PLACING, map_steps(fill, range(len(bands)), threads))
        self.placed = ComplexVertices([each for _, each in filled], [faces for faces, _ in filled], starts, total)
        self.faces = np.concatenate([faces.faces for faces, _ in filled])
        self.sides = np.concatenate([faces.sides for faces, _ in filled]).astype(np.intp)
        self.on_cap = np.concatenate([faces.on_cap for faces, _ in filled])
        self._group(np.concatenate([band.touching for band in bands]))

    def _group(self, touching: NDArray[np.intp]) -> None:
        """Number the groups of labels that touch; positions of a group are counted from one sample."""
        count = len(self.labels)
        group = np.arange(count + 1)
        for low, high in touching.tolist():
            first, second = sorted((group[low], group[high]))
            group[group == second] = first
        self.group = group
        self.affines: dict[int, NDArray[np.float64]] = {}
        self.origins = np.zeros((count + 1, 3), np.intp)
        for number in range(1, count + 1):
            members = np.flatnonzero(group == number)
            if not len(members):
                continue
            own = [self.fields[member - 1] for member in members.tolist()]
            x, y, z = (min(field.origin[axis] for field in own) for axis in range(3))
            added = max(field.first_slice for field in own)
            size = self.volume.size
            part = self.volume.part(((x, size[0]), (y, size[1]), (z, size[2])))
            self.affines[number] = refined_affine(part.affine, self.slice_steps, added)
            self.origins[members] = x, y, z * self.slice_steps - added
        self.touches = np.bincount(group[1:], minlength=count + 1)[group] > 1
        self.touches[0] = False

    def constants_steps(self) -> Steps[None]:
        """Find the constants of labels that touch."""
        yield from self.stages.run(KEEPING, self._constants_steps())

    def _constants_steps(self) -> Steps[None]:
        count = len(self.labels)
        sx, sy, sz = self.volume.spacing
        sizes = (sx, sy, sz / self.slice_steps)
        keeps = self.has_distances and self.settings.stride == (1, 1, 1)
        free = self.touches & (self.goals > 0) & keeps
        constants = np.zeros(count + 1)
        limit = max(self.volume.spacing) / 2
        self.shares = self._shares(constants)
        threads = self.budget.thread_count
        missing, gain = np.zeros(count + 1), np.ones(count + 1)
        for trial in range(ROUNDS + 1):
            placing = self.placed.positions_steps(self.owners, self.shares, self.origins, threads)
            self.linear = yield from equal_part(placing, 2 * trial, 2 * ROUNDS + 2)
            measuring = measured_pairs_steps(self.linear, self.faces, self.sides, sizes, count, threads)
            self.volumes, areas = yield from equal_part(measuring, 2 * trial + 1, 2 * ROUNDS + 2)
            before, missing = missing, np.where(free, self.goals - self.volumes, 0.0)
            gain = next_gain(gain, before, missing)
            if trial == ROUNDS or not (np.abs(missing) > EXACT_ENOUGH * self.goals).any():
                break
            constants = np.clip(constants + next_constants(missing * gain, areas, free), -limit, limit)
            self.shares = self._shares(constants)
        self.constants = constants

    def _shares(self, constants: NDArray[np.float64]) -> list[list[NDArray[np.float64]]]:
        added = constants if constants.any() else None
        return [[each.shares(added) for each in crossings] for crossings in self.placed.crossings]

    def _notes(self, at: int) -> tuple[str, ...]:
        """Return the notes on a label; one that touches another keeps a volume different from its own."""
        notes = self.fields[at - 1].notes
        return self.smoothing.shared_notes(notes, self.slice_steps) if self.touches[at] else notes

    def result_steps(self) -> Steps[LabelComplex]:
        """Move everything to RAS+ mm."""
        return (yield from self.stages.run(MOVING, self._result_steps()))

    def _result_steps(self) -> Steps[LabelComplex]:
        yield PAUSE
        settings, volume = self.settings, self.volume
        faces, sides, placed = self.faces, self.sides, self.placed
        placing = placed.positions_steps(self.owners, None, self.origins, self.budget.thread_count)
        ends = [(yield from placing), self.linear]
        group, off_edges = self.group[placed.labels], placed.off_edges
        if not settings.close_border and self.on_cap.any():
            faces, sides = faces[~self.on_cap], sides[~self.on_cap]
            used = np.zeros(placed.count, bool)
            used[faces] = True
            faces = (np.cumsum(used, dtype=np.int32) - np.int32(1))[faces]
            ends, group, off_edges = [points[used] for points in ends], group[used], off_edges[used]
        yield PAUSE
        order = np.argsort(group, kind="stable")
        firsts = np.searchsorted(group, np.arange(len(self.labels) + 2), sorter=order)
        for number, affine in self.affines.items():
            for start in range(firsts[number], firsts[number + 1], POINTS_AT_ONCE):
                own = order[start : min(start + POINTS_AT_ONCE, firsts[number + 1])]
                for points in ends:
                    points[own] = transform_points(affine, points[own])
                yield PAUSE
        faces = transform_faces(volume.affine, faces)
        values = np.array([0, *self.labels], np.int32)
        surface = ComplexSurface(ends[0], ends[1], faces, values[sides], off_edges)
        with_surface = set(values[np.flatnonzero(np.bincount(sides.reshape(-1), minlength=2)[1:]) + 1].tolist())
        for label in self.labels:
            if label not in with_surface:
                message = f"no sample of this grid is cut off by {label_title(volume, label)}; use a smaller stride"
                if self.all_needed:
                    raise MeshError(message)
                self.errors[label] = MeshError(message)
        if not with_surface:
            raise no_surface(volume, self.errors)
        numbered = [(at, label) for at, label in enumerate(self.labels, 1) if label in with_surface]
        return LabelComplex(
            surface=surface,
            labels=tuple(label for _, label in numbered),
            errors=self.errors,
            thresholds={label: self.fields[at - 1].threshold for at, label in numbered},
            notes={label: volume.notes + self._notes(at) for at, label in numbered},
            wrong_side={label: int(self.wrong_side[at]) for at, label in numbered},
            volumes_mm3={label: float(self.volumes[at]) for at, label in numbered},
            label_mm3={label: float(self.goals[at]) for at, label in numbered},
            constants_mm={label: float(self.constants[at]) for at, label in numbered},
            scope=self.scope,
        )


def _union(boxes: Sequence[Box]) -> Box:
    """Return the smallest box that holds all of them."""
    x, y, z = ((min(box[axis][0] for box in boxes), max(box[axis][1] for box in boxes)) for axis in range(3))
    return x, y, z
