# SPDX-License-Identifier: GPL-3.0-or-later
"""Finish every surface, of one field or of labels that touch: stages, notes, description, another simplification.

The only place that names the stages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ..budget import Budget
from ..described import AUTO
from ..mesh.component_limits import ComponentLimits
from ..mesh.face_normals import vertex_normals_steps
from ..mesh.kept_pieces import kept_and_removed_steps
from ..mesh.triangle_mesh import Surface
from ..progress import Stages, Steps
from ..reconstruction import Reconstruction, Stage
from ..settings import ReconstructionSettings
from ..sinks import HOLD, Sink, Taken
from ..volume.volume import Volume
from .request import MadeSurface, Scope

if TYPE_CHECKING:
    from ..mesh.angles.alpha_choice import AlphaChoice
    from ..simplification.component_removal import CollapsedComponents
    from ..simplification.whole import Simplification

# What report.json and a user read.
PREPARING, EXTRACTING, KEEPING = "Preparing values", "Extracting the surface", "Keeping components"
CHOOSING, SIMPLIFYING, AVERAGING, WRITING = "Choosing alpha", "Simplifying", "Averaging normals", "Writing the surface"
LOOKING = "Looking for labels that cross"
LARGEST_COLLAPSED_MM3 = 20.0
"""Simplification removes no component that encloses more."""


def simplified_steps(
    full: Reconstruction, settings: ReconstructionSettings, budget: Budget | None = None
) -> Steps[Reconstruction]:
    """Return a full surface simplified as `settings` ask; their other fields are those it was made with."""
    return (yield from Finish(settings, budget or Budget(), HOLD).simplified_steps(full))


def without_small_steps(
    full: Reconstruction, min_part_mm3: float, keep_parts: int | None = None
) -> Steps[Reconstruction]:
    """Return a full surface without the components below a volume, as if the setting had asked for that.

    With `keep_parts` so many of the largest are left; None leaves that as it is.
    """
    settings = replace(full.settings, min_part_mm3=min_part_mm3)
    if keep_parts is not None:
        settings = replace(settings, keep_parts=keep_parts)
    mesh = full.mesh
    surface = full.surface or Surface(mesh.vertices, mesh.vertices, mesh.faces, mesh.normals)
    alpha = settings.alpha_number
    surface, removed = yield from kept_and_removed_steps(surface, alpha, limits_of(settings))
    mesh = surface.at(alpha)
    return replace(
        full,
        mesh=mesh,
        surface=None if full.surface is None else surface,
        settings=settings,
        full_faces=len(mesh.faces),
        removed_components=full.removed_components + removed,
    )


def remade_steps(full: Reconstruction, settings: ReconstructionSettings, budget: Budget) -> Steps[MadeSurface]:
    """Return the surface that the settings ask for, of a full one of other settings, and the full one of these."""
    if full.surface is not None and full.settings.alpha != settings.alpha:  # the slider has moved since
        full = replace(full, mesh=full.surface.at(settings.alpha_number), settings=settings)
    if limits_of(settings).ask_more_than(limits_of(full.settings)):
        full = yield from without_small_steps(full, settings.min_part_mm3, settings.keep_parts)
    return MadeSurface((yield from simplified_steps(full, settings, budget)), full)


def goals_of(settings: ReconstructionSettings) -> tuple[float | None, int | None, float | None]:
    """Return the reduction, the number of triangles and the maximum error that are asked for."""
    return settings.reduction, settings.target_faces, settings.max_error_mm


def limits_of(settings: ReconstructionSettings) -> ComponentLimits:
    """Return which components are to stay."""
    return ComponentLimits(settings.keep_parts, settings.min_part_mm3)


def weights_of(settings: ReconstructionSettings, sink: Sink, full: bool) -> dict[str, int]:
    """Return the stages that a surface of one field has, and their usual share of the time.

    `full` leaves out what follows the full surface.
    """
    weights = {
        PREPARING: 20,
        EXTRACTING: 42,
        CHOOSING: 20 * (settings.alpha == AUTO),
        KEEPING: 15 * settings.drops_components,
        SIMPLIFYING: 33 * (settings.simplifies_here and not full),
        AVERAGING: 2 * (settings.normals == "mesh" and not full),
        WRITING: 0 if sink.holds else 10,
    }
    return {name: weight for name, weight in weights.items() if weight}


def timed(names: Iterable[str], seconds: Mapping[str, float]) -> tuple[Stage, ...]:
    """Return the stages of these names that have run, in this order."""
    return tuple(Stage(name, seconds[name]) for name in names if name in seconds)


def described(
    volume: Volume,
    scope: Scope,
    settings: ReconstructionSettings,
    taken: Taken,
    *,
    notes: tuple[str, ...],
    slice_steps: int,
    choice: AlphaChoice | None,
    **more: Any,
) -> Reconstruction:
    """Return the reconstruction of a surface that a sink has taken: what volume and settings say of it, and `more`.

    Parameters
    ----------
    scope : Scope
        Where the surface was extracted.
    notes : tuple of str
        Those of the volume among them, that of `choice` not.
    choice : AlphaChoice or None
        How alpha was chosen.
    more
        Fields of `Reconstruction`.
    """
    label = settings.label
    return Reconstruction(
        mesh=taken.mesh,
        surface=taken.surface,
        measured=taken.measured,
        wrong_side=taken.wrong_side,
        settings=settings,
        voxels_visited=scope.voxels_visited(slice_steps),
        spacing_mm=volume.spacing,
        notes=notes if choice is None else (*notes, choice.sentence()),
        name=volume.name,
        slice_steps=slice_steps,
        label_name="" if label is None else volume.label_names.get(label, ""),
        label_color=None if label is None else volume.label_colors.get(label),
        alpha_choice=choice,
        **more,
    )


def simplification_notes(
    settings: ReconstructionSettings,
    full_faces: int,
    faces: int,
    crossings: int | None,
    collapsed: CollapsedComponents,
    handles_cut: int,
) -> tuple[str, ...]:
    """Return the notes on a simplified surface.

    Parameters
    ----------
    full_faces, faces : int
        Triangles before and after simplification; of labels that touch, of all of them.
    crossings : int or None
        Pairs of triangles that cross each other.
    collapsed : CollapsedComponents
        Components that simplification removed.
    handles_cut : int
    """
    notes = []
    if crossings:
        notes.append(f"Pairs of triangles that cross each other: {crossings:,}.")
    if collapsed.count:
        notes.append(f"{collapsed.sentence()}.")
    if handles_cut:
        notes.append(f"Small handles that were cut and capped: {handles_cut:,}.")
    target = settings.target_faces or round(full_faces * (1 - (settings.reduction or 0)))
    if settings.max_error_mm is None and faces > target:
        notes.append(missed_goal(faces, target))
    return tuple(notes)


def missed_goal(faces: int, target: int) -> str:
    """Return the note for a surface that keeps more triangles than it was to have."""
    return (
        f"{faces} triangles are left instead of {target}: no further edge can be removed without moving a border, "
        f"tearing or crossing the surface, or collapsing a component of more than {LARGEST_COLLAPSED_MM3:g} mm3."
    )


class Finish:
    """A surface of one field from its full triangles to the report.

    Attributes
    ----------
    settings : ReconstructionSettings
        With the alpha that was chosen, once it is.
    seconds : dict of str to float
        Of every stage that has run.
    """

    def __init__(self, settings: ReconstructionSettings, budget: Budget, sink: Sink, full: bool = False) -> None:
        self.settings, self.budget, self.sink, self.full = settings, budget, sink, full
        self.stages = Stages(weights_of(settings, sink, full))
        self.seconds: dict[str, float] = {}

    def simplified_steps(self, full: Reconstruction) -> Steps[Reconstruction]:
        """Simplify the full surface that the sink keeps, at its alpha."""
        if self.settings.alpha == AUTO:
            self.settings = replace(self.settings, alpha=full.settings.alpha)
        simplification = None
        if self.settings.simplifies_here:
            from ..simplification.simplify import simplification_steps

            goals = goals_of(self.settings)
            simplifying = simplification_steps(full.mesh, *goals, self.budget, LARGEST_COLLAPSED_MM3)
            simplification = yield from self.stages.run(SIMPLIFYING, simplifying)
            self.seconds[SIMPLIFYING] = self.stages.seconds[SIMPLIFYING]
        return (yield from self.finished_steps(full, simplification))

    def finished_steps(self, full: Reconstruction, simplification: Simplification | None) -> Steps[Reconstruction]:
        """Return the finished reconstruction, with the mesh's own normals if the settings ask for them."""
        mesh, measured, settings = full.mesh, full.measured, self.settings
        result, crossings = full, full.self_intersections
        if simplification is not None:
            mesh, collapsed = simplification.mesh, simplification.collapsed
            if simplification.self_intersections is not None:
                crossings = simplification.self_intersections
            handles = simplification.handles_cut
            notes = simplification_notes(settings, full.full_faces, len(mesh.faces), crossings, collapsed, handles)
            result = replace(
                full,
                surface=None,
                notes=full.notes + notes,
                collapsed_components=collapsed.count,
                collapsed_mm3=collapsed.volume,
            )
        if settings.normals == "mesh" and self.sink.normals and measured is None:
            averaging = vertex_normals_steps(mesh.vertices, mesh.faces)
            mesh = replace(mesh, normals=(yield from self.stages.run(AVERAGING, averaging)))
            self.seconds[AVERAGING] = self.stages.seconds[AVERAGING]
        if not self.sink.holds and measured is None:
            taken = yield from self.stages.run(WRITING, self.sink.mesh_steps(mesh))
            self.seconds[WRITING] = self.stages.seconds[WRITING]
            mesh, measured = taken.mesh, taken.measured
        return replace(
            result,
            mesh=mesh,
            settings=settings,
            stages=full.stages + timed((SIMPLIFYING, AVERAGING, WRITING), self.seconds),
            self_intersections=None if settings.simplifies and not settings.simplifies_here else crossings,
            measured=measured,
        )
