# SPDX-License-Identifier: GPL-3.0-or-later
"""Compare labels at two times in one frame of reference: find new, gone, grown, shrunk, merged and split components.

Volumes and diameters are those of the surfaces. Components are matched by the overlap of their samples (matching.py);
components connected by overlaps form one row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Doubles
from ..errors import LabelError, MeshError, SettingsError, ThresholdError, VolumeError
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction
from ..measures.units import length_text, mm_text, number_text
from ..progress import Stages, Steps, equal_part, finish
from ..settings import ReconstructionSettings
from ..surfaces.make import make_surfaces_steps
from ..surfaces.request import MadeSurface, SurfaceRequest
from ..volume.labels.extents import ALL
from ..volume.region import region_box, volume_box
from ..volume.volume import Box, Volume
from .components import Component, MeasuredLabel, Point, measured_label_steps
from .distance import with_distance_steps
from .label_pairs import LabelPair, label_pairs_steps
from .limits import IN_VIEW, ChangeLimits, ChangeStatus
from .matching import matches_steps

STAGES = {"Finding the labels": 1, "Reconstructing earlier labels": 8, "Reconstructing later labels": 8, "Comparing": 6}


@dataclass(frozen=True)
class ChangeRow:
    """A component of a label at two times, or several components that merged or split.

    Parameters
    ----------
    name : str
        Name of the label.
    label : int
        Number of the label, in the later volume if it has the label.
    status : ChangeStatus
    before, after : tuple of Component
        One is empty if the component is new, gone or outside.
    days : float, optional
        Days between the volumes.
    distance_mm : (low, high) float, optional
        Range of the signed distance from the later surface to the earlier one of the label, below 0 inside it.
    """

    name: str
    label: int
    status: ChangeStatus
    before: tuple[Component, ...]
    after: tuple[Component, ...]
    days: float | None = None
    distance_mm: tuple[float, float] | None = None

    @property
    def volume_before_mm3(self) -> float | None:
        """Sum of the earlier volumes: 0 for a new component, None for one outside of the earlier volume."""
        return self._volume_mm3(self.before)

    @property
    def volume_after_mm3(self) -> float | None:
        """Sum of the later volumes: 0 for a component that is gone, None for one outside of the later volume."""
        return self._volume_mm3(self.after)

    @property
    def percent(self) -> float | None:
        """Change of the volume in percent of the earlier one; None without an earlier one."""
        first, last = self.volume_before_mm3, self.volume_after_mm3
        return (last / first - 1) * 100 if first and last is not None else None

    @property
    def diameter_before_mm(self) -> float | None:
        """Largest of the earlier diameters; 0 and None as for the volume, None also without a surface."""
        return self._diameter_mm(self.before)

    @property
    def diameter_after_mm(self) -> float | None:
        """Largest of the later diameters; 0 and None as for the volume, None also without a surface."""
        return self._diameter_mm(self.after)

    @property
    def doubling_time_days(self) -> float | None:
        """Days in which the volume doubles at constant growth; None if it does not grow or `days` is None.

        Schwartz 1961, doi:10.1002/1097-0142(196111/12)14:6<1272::AID-CNCR2820140618>3.0.CO;2-H.
        """
        first, last = self.volume_before_mm3, self.volume_after_mm3
        if self.days is None or not first or last is None or last <= first:
            return None
        return self.days * math.log(2) / math.log(last / first)

    @property
    def center_mm(self) -> Point:
        """Mean position of the samples of the later components, else of the earlier ones, RAS+ mm."""
        components = self.after or self.before
        total = sum(each.voxels for each in components)
        x, y, z = (sum(each.center_mm[axis] * each.voxels for each in components) / total for axis in range(3))
        return x, y, z

    def _volume_mm3(self, components: Sequence[Component]) -> float | None:
        if not components and self.status == ChangeStatus.OUTSIDE:
            return None
        return float(sum(each.volume_mm3 for each in components))

    def _diameter_mm(self, components: Sequence[Component]) -> float | None:
        if not components:
            return None if self.status == ChangeStatus.OUTSIDE else 0.0
        return max((each.diameter_mm for each in components if each.diameter_mm is not None), default=None)


@dataclass(frozen=True, eq=False)
class ComparedLabel:
    """The surfaces of a label at two times.

    Parameters
    ----------
    name : str
    before, after : Reconstruction or None
        None if the volume lacks the label or it has no surface. The later surface has the map distance_earlier_mm, its
        signed distance to the earlier one.
    """

    name: str
    before: Reconstruction | None
    after: Reconstruction | None


@dataclass(frozen=True, eq=False)
class LabelChanges:
    """The changes of labels.

    Parameters
    ----------
    rows : tuple of ChangeRow
        Sorted by label, then the later components by size, then components that are gone.
    labels : tuple of ComparedLabel
    notes : tuple of str
        Sentences about the limits and the assumptions.
    """

    rows: tuple[ChangeRow, ...]
    labels: tuple[ComparedLabel, ...]
    notes: tuple[str, ...]


def compare_labels(
    before: Volume,
    after: Volume,
    settings: ReconstructionSettings | None = None,
    labels: Sequence[int | str] | None = None,
    days: float | None = None,
    limits: ChangeLimits | None = None,
    budget: Budget | None = None,
) -> LabelChanges:
    """Compare the components of labels at two times.

    Parameters
    ----------
    before, after : Volume
        Label volumes in one frame of reference (RAS+ mm), on any two grids.
    settings : ReconstructionSettings, optional
        Settings of every surface; their label is ignored. A region is in mm unless the grids are the same.
    labels : sequence of int or str, optional
        Numbers, names or 'all'; by default all. A name may have another number in each volume.
    days : float, optional
        Days between the volumes, for the doubling time.
    limits : ChangeLimits, optional
    budget : Budget, optional
        Threads and memory; by default those of the machine. The result does not depend on it.

    Raises
    ------
    VolumeError
        If the volumes lie apart.
    AbsentLabelError, LabelError
        If neither volume has a label.
    SettingsError
        For days that are not above 0, a threshold, or a region in voxels of two grids.
    CtmcError
        For the reasons of `reconstruct`.

    Examples
    --------
    >>> first, last = np.zeros((8, 12, 20), np.uint8), np.zeros((8, 12, 20), np.uint8)
    >>> first[2:6, 2:6, 2:6], last[2:6, 2:6, 2:10], last[2:6, 2:6, 14:18] = 1, 1, 1
    >>> volumes = [Volume(values, np.eye(4), kind="label") for values in (first, last)]
    >>> for row in compare_labels(*volumes, days=30).rows:
    ...     print(row.status, len(row.before), len(row.after), row.percent and round(row.percent))
    grown 1 1 100
    new 0 1 None
    """
    return finish(compare_labels_steps(before, after, settings, labels, days, limits, budget))


def compare_labels_steps(
    before: Volume,
    after: Volume,
    settings: ReconstructionSettings | None = None,
    labels: Sequence[int | str] | None = None,
    days: float | None = None,
    limits: ChangeLimits | None = None,
    budget: Budget | None = None,
) -> Steps[LabelChanges]:
    """Compare labels as `compare_labels` does, in steps; closing the generator cancels."""
    settings, limits, budget = settings or ReconstructionSettings(), limits or ChangeLimits(), budget or Budget()
    _require_comparable(before, after, settings, days)
    boxes = region_box(before, settings), region_box(after, settings)
    stages = Stages(STAGES)
    finding, *making, comparing = STAGES
    choices = (ALL,) if labels is None else tuple(labels)
    pairing = label_pairs_steps(before, after, choices, boxes, budget.threads)
    pairs = yield from stages.run(finding, pairing)
    surfaces: list[dict[int, Reconstruction]] = []
    for at, (stage, volume) in enumerate(zip(making, (before, after), strict=True)):
        numbers = [number for pair in pairs if (number := (pair.before, pair.after)[at]) is not None]
        surfaces.append((yield from stages.run(stage, _surfaces_steps(volume, settings, numbers, budget))))
    rows: list[ChangeRow] = []
    notes: list[str] = []
    compared = []
    for at, pair in enumerate(pairs):
        both = ComparedLabel(
            pair.name,
            None if pair.before is None else surfaces[0].get(pair.before),
            None if pair.after is None else surfaces[1].get(pair.after),
        )
        measuring = _measured_steps((before, after), pair, boxes, both, settings.drops_components)
        measured = yield from stages.run(comparing, equal_part(measuring, 3 * at, 3 * len(pairs)))
        if both.before is not None and both.after is not None:
            mapping = with_distance_steps(both.after, both.before.mesh, after, budget)
            mapped = yield from stages.run(comparing, equal_part(mapping, 3 * at + 1, 3 * len(pairs)))
            both = replace(both, after=mapped)
        matching = _rows_steps(pair, *measured, both, limits, days)
        label_rows = yield from stages.run(comparing, equal_part(matching, 3 * at + 2, 3 * len(pairs)))
        rows += label_rows
        compared.append(both)
        notes += _notes_of(pair, label_rows, *measured)
    own_notes = _shared_notes((before, after), surfaces)
    return LabelChanges(tuple(rows), tuple(compared), (limits.sentence, *own_notes, *notes))


def _require_comparable(before: Volume, after: Volume, settings: ReconstructionSettings, days: float | None) -> None:
    if days is not None and not 0 < days < math.inf:
        raise SettingsError(f"days must be above 0, not {days:g}; give those from the earlier volume to the later one")
    if settings.threshold is not None:
        raise SettingsError("two volumes are compared by their labels; give a label instead of a threshold")
    same = before.size == after.size and np.array_equal(before.affine, after.affine)
    if settings.region is not None and settings.region_unit == "voxel" and not same:
        raise SettingsError("the two volumes have different voxels, so a voxel region is ambiguous; set region_unit mm")
    low, high = zip(*(_ends_mm(volume) for volume in (before, after)), strict=True)
    apart = np.maximum(low[0], low[1]) - np.minimum(high[0], high[1])
    if apart.max() > 0:
        spans = [
            ", ".join(f"{name} {number_text(a, 3)} to {mm_text(b, 3)}" for name, a, b in zip("xyz", *ends, strict=True))
            for ends in zip(low, high, strict=True)
        ]
        raise VolumeError(
            f"the volumes lie {length_text(float(apart.max()), 3)} apart (before: {spans[0]}; after: {spans[1]}), so "
            "nothing overlaps; give volumes of one frame of reference, or register them first"
        )


def _ends_mm(volume: Volume) -> tuple[Doubles, Doubles]:
    """Return the lowest and the highest corner of a volume's samples, (3,) each."""
    corners = volume_box(volume)
    return corners.min(axis=0), corners.max(axis=0)


def _surfaces_steps(
    volume: Volume, settings: ReconstructionSettings, labels: Sequence[int], budget: Budget
) -> Steps[dict[int, Reconstruction]]:
    """Return the surface of each label that has one."""
    requests = [SurfaceRequest(replace(settings, upper=None, label=label)) for label in labels]
    outcomes = yield from make_surfaces_steps(volume, requests, budget)
    results = {}
    for label, outcome in zip(labels, outcomes, strict=True):
        if isinstance(outcome, MadeSurface):
            results[label] = outcome.result
        elif not isinstance(outcome, (LabelError, MeshError, ThresholdError)):
            raise outcome
    return results


def _measured_steps(
    volumes: tuple[Volume, Volume], pair: LabelPair, boxes: tuple[Box, Box], both: ComparedLabel, drop: bool
) -> Steps[tuple[MeasuredLabel, MeasuredLabel]]:
    measured = []
    results = both.before, both.after
    for at, (volume, label, box, result) in enumerate(zip(volumes, pair[1:], boxes, results, strict=True)):
        measuring = measured_label_steps(volume, label, box, None if result is None else result.mesh, drop)
        measured.append((yield from equal_part(measuring, at, 2)))
    return measured[0], measured[1]


def _rows_steps(
    pair: LabelPair,
    before: MeasuredLabel,
    after: MeasuredLabel,
    both: ComparedLabel,
    limits: ChangeLimits,
    days: float | None,
) -> Steps[list[ChangeRow]]:
    matches = yield from matches_steps(before, after, limits.overlap_percent / 100)
    voxel_mm3 = max(before.volume.voxel_mm3, after.volume.voxel_mm3)
    order = sorted(matches.groups, key=lambda group: (group[1][:1] or (math.inf,), group[0]))
    rows = []
    for first, last in order:
        seen = [*matches.seen_before[list(first)], *matches.seen_after[list(last)]]
        own, later = tuple(before.components[at] for at in first), tuple(after.components[at] for at in last)
        status = limits.status(own, later, voxel_mm3, max(seen) >= IN_VIEW)
        number = pair.number
        assert number is not None, "one of the volumes has the label"
        distance_mm = _distance_mm(both, after, last)
        rows.append(ChangeRow(pair.name, number, status, own, later, days, distance_mm))
    return rows


def _distance_mm(both: ComparedLabel, after: MeasuredLabel, members: Sequence[int]) -> tuple[float, float] | None:
    """Return the lowest and the highest value of the distance map on these later components."""
    if both.after is None or not both.after.maps:
        return None
    values = both.after.maps[0].values[np.isin(after.of_vertex, members)]
    values = values[np.isfinite(values)]
    return (float(values.min()), float(values.max())) if len(values) else None


def _shared_notes(volumes: tuple[Volume, Volume], surfaces: Sequence[dict[int, Reconstruction]]) -> list[str]:
    """Return the notes of both volumes and their surfaces; a note of only one begins with Before or After."""
    each = []
    for volume, results in zip(volumes, surfaces, strict=True):
        own_notes = [result.notes for result in results.values()] or [volume.notes]
        each.append([note for note in own_notes[0] if all(note in notes for notes in own_notes)])
    first, last = each
    shared = [note for note in first if note in last]
    own = [(word, note) for word, notes in (("Before", first), ("After", last)) for note in notes]
    return [*shared, *(f"{word}: {note}" for word, note in own if note not in shared)]


def _notes_of(pair: LabelPair, rows: Sequence[ChangeRow], before: MeasuredLabel, after: MeasuredLabel) -> list[str]:
    """Return the notes on the rows of a label."""
    notes = []
    for when, label in (("before", before), ("after", after)):
        small = [each for each in label.components if each.diameter_mm is None]
        opened = [each for each in label.components if each.diameter_mm is not None and not each.closed]
        if small:
            notes.append(
                f"{_count(small)} of {pair.name} {when}: too small for a surface, so the volume is that of the voxels."
            )
        if opened:
            notes.append(
                f"{_count(opened)} of {pair.name} {when}: open at the border of the volume or region, so the volume is "
                "that of the voxels; close_border closes the surface."
            )
        if label.dropped:
            notes.append(f"{label.dropped} small components of {pair.name} {when} are dropped, as the settings ask.")
    for row in rows:
        if row.status in (ChangeStatus.MERGED, ChangeStatus.SPLIT):
            notes.append(f"{pair.name}: {_named(row.before)} (before) {row.status} into {_named(row.after)} (after).")
    outside = [row for row in rows if row.status == ChangeStatus.OUTSIDE]
    if outside:
        notes.append(f"{pair.name}: {len(outside)} outside, where the other volume has no samples.")
    if before.components and after.components and not any(row.before and row.after for row in rows):
        ends = [np.array([each.center_mm for each in label.components]) for label in (before, after)]
        nearest = math.sqrt(min(float(((ends[1] - at) ** 2).sum(axis=1).min()) for at in ends[0]))
        notes.append(
            f"{pair.name}: no later component overlaps an earlier one; the nearest centers are "
            f"{length_text(nearest, 3)} apart. Check that both volumes are in one frame of reference."
        )
    return notes


def _count(components: Sequence[Component]) -> str:
    numbers = _named(components[:10]) + (" and more" if len(components) > 10 else "")
    return f"{'Component' if len(components) == 1 else 'Components'} {numbers}"


def _named(components: Sequence[Component]) -> str:
    return ", ".join(str(each.number) for each in components)
