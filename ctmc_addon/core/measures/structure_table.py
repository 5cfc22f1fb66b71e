# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of structures: volume, area, components, largest diameter, and the gray values inside, a row each.

Volume, area and components are those of the surface (mesh/measures.py), as reports have them. Gray values are those of
the samples: of a label its own, of a threshold those that it takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

from ..files.atomic_write import csv_text
from ..maps.surface_map import SurfaceMap
from ..mesh.diameter import largest_diameter_steps
from ..mesh.measures import Measures
from ..mesh.triangle_mesh import TriangleMesh
from ..progress import Stages, Steps, finish
from ..settings import ReconstructionSettings
from ..structures import structure_names
from ..volume.region import region_box
from ..volume.statistics.inside import InsideValues, inside_values_steps, range_values_steps
from ..volume.statistics.sampled_inside import SampledValues, sampled_inside_label_steps, sampled_inside_range_steps
from ..volume.value_kind import ValueKind
from ..volume.volume import Volume
from .measures import (
    HU,
    UNKNOWN,
    FinishedSurface,
    Measure,
    Place,
    doses_of,
    map_numbers,
    maps_of,
    measures_in,
    printed_of,
)
from .reconstruction import Reconstruction
from .units import number_text

if TYPE_CHECKING:
    from ..solid.printing.print_facts import PrintFacts

DIGITS = 9  # A number in a CSV has this many digits.


@dataclass(frozen=True)
class StructureRow:
    """Measures of a structure.

    Parameters
    ----------
    name : str
    label : int or None
    threshold : float or None
        Threshold of a structure that is not a label.
    surface : FinishedSurface
        Without gray values where there is no CT, or no sample.
    """

    name: str
    label: int | None
    threshold: float | None
    surface: FinishedSurface

    def columns(self, kind: ValueKind | str = ValueKind.HU) -> dict[str, Any]:
        """Return the columns by their contents; the unit of the gray values, of this kind, is part of the names."""
        unit = ValueKind(kind).column
        measured = [each.table_cells(each.value(self.surface), unit) for each in _measures_of(self.surface, kind)]
        own = {"name": self.name, "label": self.label, f"threshold_{unit}": self.threshold}
        return own | {head: cell for cells in measured for head, cell in cells.items()}

    @property
    def notes(self) -> tuple[str, ...]:
        """Return notes on values that were left out."""
        inside = self.surface.inside
        beyond = getattr(inside, "beyond", 0)
        if inside is None or not beyond:
            return ()
        text = f"{beyond} of {inside.samples + beyond} voxels of {self.name} lie outside the grid of the values"
        return (f"{text} and do not count" if inside.samples else text,)


def _measures_of(surface: FinishedSurface, kind: ValueKind | str) -> tuple[Measure, ...]:
    printed = printed_of([surface])
    return measures_in(Place.TABLE, maps_of([surface]).items(), kind, doses_of([surface]), printed)


def measure_structures(
    results: Sequence[Reconstruction],
    ct: Volume | None = None,
    labels: Volume | None = None,
    names: Sequence[str] = (),
    doses: Sequence[float] = (),
) -> list[StructureRow]:
    """Measure surfaces and the gray values inside.

    Parameters
    ----------
    results : sequence of Reconstruction
        Results with their meshes.
    ct : Volume, optional
        CT whose values are measured, or a dose or PET, on any grid. For a threshold it is the volume that the surface
        was made from.
    labels : Volume, optional
        Volume that the labels were made from; needed for the gray values of labels.
    names : sequence of str
        Name of each; by default that of its label, or of the volume.
    doses : sequence of float
        Doses in Gy; the share of the volume that gets at least each dose is measured.

    Raises
    ------
    VolumeError, LabelError
        If the labels' samples are not samples of the CT, or a label lies outside it.

    Examples
    --------
    >>> import numpy as np
    >>> from ..surfaces.labels import reconstruct_labels
    >>> labels = np.zeros((8, 8, 20), np.uint8)
    >>> labels[2:6, 2:6, 2:6] = 1
    >>> labels = Volume(labels, np.eye(4), kind="label", label_names={1: "box"})
    >>> ct = Volume(np.full((8, 8, 20), 40, np.int16), np.eye(4), kind="HU")
    >>> surfaces = reconstruct_labels(labels, ReconstructionSettings(smoothing="none")).surfaces
    >>> head, box = table_csv(measure_structures(surfaces, ct, labels), ct.kind).splitlines()
    >>> head[:64]
    'name,label,threshold_hu,volume_ml,area_cm2,components,largest_di'
    >>> box
    'box,1,,0.0586666667,0.811878949,1,5.83095189,40,0,4,4,4,0'
    """
    return finish(measure_structures_steps(results, ct, labels, names, doses))


def measure_structures_steps(
    results: Sequence[Reconstruction],
    ct: Volume | None = None,
    labels: Volume | None = None,
    names: Sequence[str] = (),
    doses: Sequence[float] = (),
) -> Steps[list[StructureRow]]:
    """Do what `measure_structures` does, in steps."""
    rows = []
    called = names or structure_names(results)
    stages = Stages(dict.fromkeys(called, 1))
    for name, result in zip(called, results, strict=True):
        about = (name, result.mesh, result.measures, result.settings, result.threshold, ct, labels)
        measuring = structure_row_steps(*about, result.maps, doses, result.printing)
        rows.append((yield from stages.run(name, measuring)))
    return rows


def structure_row_steps(
    name: str,
    mesh: TriangleMesh,
    measures: Measures,
    settings: ReconstructionSettings,
    threshold: float,
    ct: Volume | None = None,
    labels: Volume | None = None,
    maps: tuple[SurfaceMap, ...] = (),
    doses: Sequence[float] = (),
    printing: PrintFacts | None = None,
) -> Steps[StructureRow]:
    """Return the row of a surface in mm whose measures are known, and of the gray values inside.

    Parameters
    ----------
    name : str
    mesh : TriangleMesh
    measures : Measures
    settings : ReconstructionSettings
        Settings that it was made with.
    threshold : float
        Threshold that was used.
    ct, labels : Volume, optional
        As in `measure_structures`.
    maps : tuple of SurfaceMap
    doses : sequence of float
        As in `measure_structures`.
    printing : PrintFacts, optional
        Of a part for print.
    """
    diameter = yield from largest_diameter_steps(mesh.vertices)
    inside = yield from _inside_steps(settings, threshold, ct, labels, doses)
    return StructureRow(
        name=name,
        label=settings.label,
        threshold=threshold if settings.label is None else None,
        surface=FinishedSurface(
            measures=measures,
            largest_diameter_mm=diameter,
            inside=inside,
            maps={each.name: each for each in maps},
            printing=printing,
        ),
    )


def _inside_steps(
    settings: ReconstructionSettings, threshold: float, ct: Volume | None, labels: Volume | None, doses: Sequence[float]
) -> Steps[InsideValues | SampledValues | None]:
    if ct is None:
        return None
    if settings.label is None:
        low, high, box = threshold, settings.upper, region_box(ct, settings)
        if ct.kind.is_sampled:
            return (yield from sampled_inside_range_steps(ct, low, high, box, doses))
        return (yield from range_values_steps(ct, low, high, box))
    if labels is None:
        return None
    box = region_box(labels, settings)
    if ct.kind.is_sampled:
        return (yield from sampled_inside_label_steps(ct, labels, settings.label, box, doses))
    return (yield from inside_values_steps(ct, labels, settings.label, box))


def table_heads(kind: ValueKind | str = ValueKind.HU, rows: Sequence[StructureRow] = ()) -> tuple[str, ...]:
    """Return the names of the columns, with their units; `kind` is that of the CT's values.

    Rows with maps have the columns of these last.

    Examples
    --------
    >>> table_heads("gray value")[2:5]
    ('threshold_gray', 'volume_ml', 'area_cm2')
    """
    every = [StructureRow("", None, None, FinishedSurface()), *rows]
    return tuple(dict.fromkeys(head for row in every for head in row.columns(kind)))


def table_csv(rows: Sequence[StructureRow], kind: ValueKind | str = ValueKind.HU) -> str:
    """Return the table as CSV; unknown values stay empty."""
    lines = [{head: _written(cell) for head, cell in row.columns(kind).items()} for row in rows]
    return csv_text(lines, table_heads(kind, rows))


def table_cells(rows: Sequence[StructureRow], kind: ValueKind | str = ValueKind.HU) -> list[tuple[str, ...]]:
    """Return the table for a person, its heads first, in units that fit; unknown values are a dash."""
    kind = ValueKind(kind)
    shown = [_texts(row, kind) for row in rows]
    heads = tuple(dict.fromkeys([*_texts(StructureRow("", None, None, FinishedSurface()), kind), *chain(*shown)]))
    return [heads, *(tuple(texts.get(head, UNKNOWN) for head in heads) for texts in shown)]


def _texts(row: StructureRow, kind: ValueKind) -> dict[str, str]:
    """Return the cells of a row for a person by their heads."""
    texts = {
        "name": row.name,
        "label": UNKNOWN if row.label is None else str(row.label),
        f"threshold {kind.mark}".rstrip(): UNKNOWN if row.threshold is None else number_text(row.threshold),
    }
    surface = replace(row.surface, maps={})
    for each in _measures_of(surface, kind):
        texts[each.head.replace(HU, kind.mark).rstrip()] = each.text(each.value(surface))
    return texts | _map_texts(row)


def _map_texts(row: StructureRow) -> dict[str, str]:
    """Return the median of each map, and the values between which 90 % lie, by a head that says so."""
    texts = {}
    for name, each in row.surface.maps.items():
        numbers, unit = map_numbers(asdict(each.statistics), each.unit)
        median = f"{numbers.get('median', UNKNOWN)} {unit if numbers else ''}".rstrip()
        between = f" ({numbers['percentile_5']} to {numbers['percentile_95']})" if numbers else ""
        texts[f"{name} (90 %)"] = median + between
    return texts


def _written(value: Any) -> Any:
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else value
