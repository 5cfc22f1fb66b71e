# SPDX-License-Identifier: GPL-3.0-or-later
"""Make the surfaces of one input and name them: one, or one for each label or time."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..core import (
    HOLD,
    VERSION,
    Budget,
    MadeSurface,
    Reconstruction,
    ReconstructionSettings,
    SettingsError,
    Stages,
    Steps,
    SurfaceRequest,
    Volume,
    make_surfaces_steps,
    structure_names,
)
from ..core.maps import MapRequest
from ..core.solid import SolidRequest
from ..core.volume import ALL, chosen_labels_steps, region_box
from .flags.arguments import UsageError
from .flags.combined import with_structures
from .flags.maps import AskedMaps
from .flags.solid import NOTHING
from .surface_writer import SurfaceWriter


def open_words(number: int, opened: int) -> str:
    """Return the number of surfaces and of open ones as text, with the remedy.

    Examples
    --------
    >>> open_words(3, 0), open_words(1, 1)
    ('3', '1, open: --close-border closes it at the border')
    >>> open_words(3, 2)
    '3, 2 of them open: --close-border closes them at the border'
    """
    if not opened:
        return str(number)
    which, what = (f"{opened} of them open", "them") if number > 1 else ("open", "it")
    return f"{number}, {which}: --close-border closes {what} at the border"


@dataclass(frozen=True)
class Surfaces:
    """Surfaces made from one input.

    Parameters
    ----------
    name : str
        Of the input; of the collection that holds several surfaces.
    results : tuple of Reconstruction
    names : tuple of str
        Of each surface, all different; empty where there is one that goes by the input's name.
    left_out : tuple of str
        A sentence for each that could not be made.
    times : tuple of int
        Of each surface, from 1 on, rising; empty where they are not of several times.
    files : tuple of Path
        Where each surface is written already, its mesh gone; empty where all are held.
    """

    name: str
    results: tuple[Reconstruction, ...]
    names: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    times: tuple[int, ...] = ()
    files: tuple[Path, ...] = ()

    @property
    def are_several(self) -> bool:
        """Return whether the surfaces have names of their own: they were asked for as several, whatever came of it."""
        return bool(self.names)

    @property
    def titles(self) -> tuple[str, ...]:
        """Return a title for each surface, even for a single one: the name of its label if it has one."""
        first = self.results[0]
        has_name = first.settings.label is not None or first.label_name
        return self.names or (structure_names(self.results) if has_name else (self.name,))

    @property
    def notes(self) -> list[str]:
        """Return the notes of all surfaces, those on single parts of a solid, and those on what was left out."""
        shared = [note for note in self.results[0].notes if all(note in result.notes for result in self.results)]
        of_parts: dict[str, list[str]] = {}
        for name, result in zip(self.titles, self.results, strict=True):
            for note in () if result.solid is None and result.printing is None else result.notes:
                if note not in shared:
                    of_parts.setdefault(note, []).append(name)
        return [*shared, *(f"{', '.join(names)}: {note}" for note, names in of_parts.items()), *self.left_out]

    def report(self) -> dict[str, Any]:
        """Return plain data for JSON: the report of one surface, or a list of reports with names."""
        if not self.are_several:
            return self.results[0].report()
        surfaces = [result.report() | {"name": name} for name, result in zip(self.names, self.results, strict=True)]
        for surface, time in zip(surfaces, self.times):  # noqa: B905  (there may be no times)
            surface["time"] = time
        return {
            "name": self.name,
            "version": VERSION,
            "surfaces": surfaces,
            "interfaces": self.interfaces,
            "notes": self.notes,
        }

    @property
    def interfaces(self) -> list[dict[str, Any]]:
        """Return plain data of every pair of labels that share triangles, the lower label first."""
        return [
            {"labels": [label, neighbor.label], "triangles": neighbor.triangles, "area_mm2": neighbor.area_mm2}
            for result in self.results
            if (label := result.settings.label) is not None
            for neighbor in result.neighbors
            if label < neighbor.label
        ]


def surfaces_steps(
    volume: Volume,
    settings: ReconstructionSettings,
    choices: Sequence[int | str],
    budget: Budget,
    writer: SurfaceWriter | None = None,
    written_bytes: int = 0,
    require_room_for: Callable[[int], None] = lambda _: None,
    maps: AskedMaps | None = None,
    solid: SolidRequest = NOTHING,
) -> Steps[Surfaces]:
    """Make a surface of every label that is chosen by number, name or `all`; without choices the one of the settings.

    Parameters
    ----------
    writer : SurfaceWriter, optional
        Writes each surface as it is made; without one all are held.
    written_bytes : int
        Of a triangle of a held surface, while Blender writes it.
    require_room_for : callable
        Told how many labels there are before they are made; raises where they cannot be written.
    maps : AskedMaps, optional
        Maps to make on every surface; there is no writer then.
    solid : SolidRequest
        Shapes every surface, whose parts are returned; there is no writer then.

    Raises
    ------
    CtmcError
        As `reconstruct_labels_steps` and `solid_parts_steps`.
    """
    stages = Stages({"Finding the labels": 1, "Reconstructing": 30})
    finding, making = stages.shares
    mapping = (yield from maps.request_steps(volume, budget)) if maps else None
    several = may_be_several(choices)
    if choices:
        box = region_box(volume, settings)
        labels = yield from stages.run(finding, chosen_labels_steps(volume, choices, box, budget.threads))
        solid, count = with_structures(solid, labels, volume.label_names)
        require_room_for(count)
        several = several or len(labels) > 1
        settings = replace(settings, label=labels[0])
    if solid:
        if mapping is not None and any(quantity.needs_full for quantity in mapping.quantities):
            raise SettingsError(
                "the map deviation is a distance to the surface before simplification, and a solid has other changes "
                "too; leave out --deviation, or the flags of the solid"
            )
        runs = [replace(settings, label=label) for label in labels] if choices else [settings]
        requests = [SurfaceRequest(run, written_bytes=written_bytes) for run in runs]
        shaping = _solid_steps(volume, requests, solid, budget, mapping, several, all_needed=ALL not in choices)
        return (yield from stages.run(making, shaping))
    if not several:
        sink = HOLD if writer is None else writer.sink_of(settings.label)
        request = SurfaceRequest(settings, sink, written_bytes=written_bytes)
        working = make_surfaces_steps(volume, [request], budget, all_needed=True, maps=mapping)
        [surface] = yield from stages.run(making, working)
        assert isinstance(surface, MadeSurface), "an error is raised"
        return (yield from for_bed_steps(surface_of(volume, surface, writer), solid, budget))
    from ..core import reconstruct_labels_steps

    requested = None if ALL in choices else labels
    sink_of = (lambda _: HOLD) if writer is None else writer.sink_of
    labelling = reconstruct_labels_steps(volume, settings, requested, budget, sink_of, mapping)
    finished = yield from stages.run(making, labelling)
    files = () if writer is None else tuple(writer.path_of(result.settings.label) for result in finished.surfaces)
    names, left_out = structure_names(finished.surfaces), tuple(finished.left_out)
    surfaces = Surfaces(volume.name, tuple(finished.surfaces), names, left_out, files=files)
    return (yield from for_bed_steps(surfaces, solid, budget))


def for_bed_steps(surfaces: Surfaces, solid: SolidRequest, budget: Budget) -> Steps[Surfaces]:
    """Return surfaces with facts for print where a solid changes none of them: where it is the bed of a printer."""
    if solid == NOTHING:
        return surfaces
    from ..core.solid import printed_steps

    results = [replace(result, solid=solid) for result in surfaces.results]
    return replace(surfaces, results=tuple((yield from printed_steps(results, solid, budget))))


def _solid_steps(
    volume: Volume,
    requests: Sequence[SurfaceRequest],
    solid: SolidRequest,
    budget: Budget,
    maps: MapRequest | None,
    several: bool,
    all_needed: bool,
) -> Steps[Surfaces]:
    """Make the parts of a solid; `several` labels have names of their own, even if one part comes of them."""
    from ..core.solid import solid_parts_steps

    making = solid_parts_steps(volume, requests, solid, budget, maps=maps, all_needed=all_needed)
    parts, left_out = yield from making
    are_named = len(parts) > 1 or (several and not solid.combinations) or bool(left_out)
    return Surfaces(volume.name, tuple(parts), structure_names(parts) if are_named else (), tuple(left_out))


def surface_of(volume: Volume, surface: MadeSurface, writer: SurfaceWriter | None) -> Surfaces:
    """Return one surface that goes by the input's name; a `writer` has written it."""
    files = () if writer is None else (writer.path_of(surface.result.settings.label),)
    return Surfaces(volume.name, (surface.result,), files=files)


def may_be_several(choices: Sequence[int | str]) -> bool:
    """Return whether choices ask for several labels, before anything is known of the volume."""
    return len(choices) > 1 or ALL in choices


def explode_of(args: argparse.Namespace, several: bool) -> float:
    """Return the shift that --explode gives the farthest of several surfaces, mm; 0 without the flag.

    Raises
    ------
    UsageError
        If there is one surface.
    """
    explode = float(getattr(args, "explode", 0.0))
    if explode and not several:
        raise UsageError("--explode moves several surfaces of one time apart, and there is one; give several labels")
    return explode
