# SPDX-License-Identifier: GPL-3.0-or-later
"""Finish surfaces of one field or of labels that touch: alpha, simplification, normals, notes, description.

The only place that names the stages.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ..described import AUTO
from ..machine.budget import Budget
from ..measures.reconstruction import Reconstruction, Stage
from ..measures.units import volume_text
from ..mesh.component_limits import ComponentLimits
from ..mesh.face_normals import vertex_normals_steps
from ..mesh.pieces.kept_pieces import kept_and_removed_steps
from ..mesh.triangle_mesh import Pieces, Surface, TriangleMesh
from ..progress import PAUSE, Stages, Steps
from ..settings import COMPONENTS, ReconstructionSettings, settings_of_stage
from ..simplification.engine.handles import handles_text
from ..sinks import HOLD, Sink, Taken
from ..volume.volume import Volume
from .request import MadeSurface, Scope

if TYPE_CHECKING:
    from ..mesh.angles.alpha_choice import AlphaChoice
    from ..simplification.whole import Simplification

# Names of stages that a user reads, in the panel and in report.json.
PREPARING, EXTRACTING, KEEPING = "Preparing values", "Extracting the surface", "Selecting components"
CHOOSING, SIMPLIFYING, AVERAGING, WRITING = "Choosing alpha", "Simplifying", "Averaging normals", "Writing the surface"
LOOKING = "Looking for labels that cross"
LARGEST_COLLAPSED_MM3 = 20.0
"""Simplification removes no component that encloses more."""


def simplified_steps(
    full: Reconstruction, settings: ReconstructionSettings, budget: Budget | None = None
) -> Steps[Reconstruction]:
    """Return a full surface simplified as `settings` ask; their other fields are those of `full`."""
    finishing = Finish(settings, budget or Budget(), HOLD, weights_of(settings))
    result = yield from finishing.simplified_steps(full)
    return replace(result, stages=full.stages + result.stages)


def without_small_steps(
    full: Reconstruction, min_part_mm3: float, keep_parts: int | None = None
) -> Steps[Reconstruction]:
    """Return a full surface without components below a volume, as if its settings had asked for that.

    `keep_parts` keeps this many of the largest; None leaves that setting as it is.
    """
    settings = replace(full.settings, min_part_mm3=min_part_mm3)
    if keep_parts is not None:
        settings = replace(settings, keep_parts=keep_parts)
    return (yield from _limited_steps(full, settings))


def _limited_steps(full: Reconstruction, settings: ReconstructionSettings) -> Steps[Reconstruction]:
    """Return a full surface with the components of settings that differ from its own in their stage alone."""
    mesh = full.mesh
    surface = full.surface or Surface(mesh.vertices, mesh.vertices, mesh.faces, mesh.normals)
    alpha = settings.alpha_number
    surface, removed = yield from kept_and_removed_steps(surface, alpha, limits_of(settings), full.components)
    yield PAUSE
    mesh = surface.at(alpha)
    return replace(
        full,
        mesh=mesh,
        surface=None if full.surface is None else surface,
        settings=settings,
        full_faces=len(mesh.faces),
        removed_components=full.removed_components + removed,
        components=None,
    )


def remade_steps(full: Reconstruction, settings: ReconstructionSettings, budget: Budget) -> Steps[MadeSurface]:
    """Return the result and the full surface of `settings`, made from a full surface of other settings."""
    if full.surface is not None and settings.alpha not in (AUTO, full.settings.alpha):  # The slider has moved since.
        full = replace(full, mesh=full.surface.at(settings.alpha_number), settings=settings)
    if limits_of(settings).ask_more_than(limits_of(full.settings)):
        asked = {name: getattr(settings, name) for name in settings_of_stage(COMPONENTS)}
        full = yield from _limited_steps(full, replace(full.settings, **asked))
    return MadeSurface((yield from simplified_steps(full, settings, budget)), full)


def goal_of(settings: ReconstructionSettings) -> dict[str, Any]:
    """Return the goal of simplification as keyword arguments of the simplifiers."""
    return {
        "reduction": settings.reduction,
        "target_faces": settings.target_faces,
        "max_error": settings.max_error_mm,
        "largest_component": LARGEST_COLLAPSED_MM3,
    }


def limits_of(settings: ReconstructionSettings) -> ComponentLimits:
    """Return the limits for small components."""
    return ComponentLimits(settings.keep_parts, settings.min_part_mm3)


def weights_of(settings: ReconstructionSettings, sink: Sink = HOLD, full: bool = False) -> dict[str, int]:
    """Return the stages of a surface of one field in their order, and their usual share of the time.

    `full` leaves out the stages that follow the full surface.
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
    """Describe a surface that a sink has taken.

    Parameters
    ----------
    scope : Scope
        Scope of the extraction.
    notes : tuple of str
        Includes the notes of the volume; the note on `choice` is added.
    choice : AlphaChoice or None
        Choice of alpha.
    more
        Further fields of `Reconstruction`.
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


def averaged_steps(mesh: TriangleMesh) -> Steps[TriangleMesh]:
    """Return a mesh with normals that are averaged from its own triangles."""
    return replace(mesh, normals=(yield from vertex_normals_steps(mesh.vertices, mesh.faces)))


class Finish:
    """Run the stages after extraction, for one surface or for several made as one complex.

    Attributes
    ----------
    settings : ReconstructionSettings
        Settings with the alpha that was chosen, once it is.
    choice : AlphaChoice or None
        Choice of alpha.
    """

    def __init__(
        self, settings: ReconstructionSettings, budget: Budget, sink: Sink, weights: Mapping[str, float]
    ) -> None:
        self.settings, self.budget, self.sink = settings, budget, sink
        self.stages = Stages(weights)
        self.choice: AlphaChoice | None = None

    @property
    def ran(self) -> tuple[Stage, ...]:
        """Return the stages that have run, in their order."""
        seconds = self.stages.seconds
        return tuple(Stage(name, seconds[name]) for name in self.stages.shares if name in seconds)

    def choose_alpha_steps(self, pass_at: Callable[[float], Pieces], *, pieces_vary: bool = False) -> Steps[None]:
        """Choose alpha if the settings ask for that.

        Parameters
        ----------
        pass_at : callable
            Gives the pieces of the surface at an alpha, as often as it is called.
        pieces_vary : bool
            Whether these depend on alpha.
        """
        if self.settings.alpha != AUTO:
            return
        from ..mesh.angles.alpha_choice import chosen_alpha_steps, kept_alpha_steps

        angle = self.settings.min_angle_deg
        choosing = kept_alpha_steps(pass_at, angle) if pieces_vary else chosen_alpha_steps(partial(pass_at, 1.0), angle)
        self.choice = yield from self.stages.run(CHOOSING, choosing)
        self.settings = replace(self.settings, alpha=self.choice.alpha)

    def simplified_steps(self, full: Reconstruction) -> Steps[Reconstruction]:
        """Simplify a full surface that is held, at its alpha, and finish it."""
        if self.settings.alpha == AUTO:
            self.settings = replace(self.settings, alpha=full.settings.alpha)
        if not self.settings.simplifies_here:
            return (yield from self.finished_steps(full))
        from ..simplification.simplify import simplification_steps

        simplifying = simplification_steps(full.mesh, budget=self.budget, **goal_of(self.settings))
        simplification = yield from self.stages.run(SIMPLIFYING, simplifying)
        return (yield from self.finished_steps(self.simplified(full, simplification)))

    def simplified(
        self, full: Reconstruction, simplification: Simplification, faces: tuple[int, int] | None = None
    ) -> Reconstruction:
        """Return a surface after simplification, with notes on it.

        Parameters
        ----------
        full : Reconstruction
            The surface before.
        simplification : Simplification
        faces : (before, after) int, optional
            Triangles of all labels that touch; by default those of this surface.
        """
        mesh, collapsed, crossings = simplification.mesh, simplification.collapsed, simplification.self_intersections
        before, after = faces or (full.full_faces, len(mesh.faces))
        if crossings is None:
            crossings = full.self_intersections
        notes = []
        if crossings:
            notes.append(f"Pairs of triangles that cross each other: {crossings:,}.")
        if collapsed.count:
            notes.append(collapsed.sentence())
        if simplification.handles_cut:
            notes.append(handles_text(simplification.handles_cut))
        target = self.settings.target_faces or round(before * (1 - (self.settings.reduction or 0)))
        if self.settings.max_error_mm is None and after > target:
            notes.append(
                f"{after} triangles are left instead of {target}: no further edge can be removed without moving a "
                "border, tearing or crossing the surface, or collapsing a component of more than "
                f"{volume_text(LARGEST_COLLAPSED_MM3)}."
            )
        return replace(
            full,
            mesh=mesh,
            surface=None,
            components=None,
            notes=(*full.notes, *notes),
            collapsed_components=collapsed.count,
            collapsed_mm3=collapsed.volume,
            self_intersections=crossings,
        )

    def finished_steps(self, result: Reconstruction) -> Steps[Reconstruction]:
        """Average normals and write the surface, where the settings and the sink ask for that."""
        mesh, measured, settings = result.mesh, result.measured, self.settings
        if settings.normals == "mesh" and self.sink.normals and measured is None:
            mesh = yield from self.stages.run(AVERAGING, averaged_steps(mesh))
        if not self.sink.holds and measured is None:
            taken = yield from self.stages.run(WRITING, self.sink.mesh_steps(mesh))
            mesh, measured = taken.mesh, taken.measured
        crossings = None if settings.simplifies and not settings.simplifies_here else result.self_intersections
        return replace(
            result, mesh=mesh, settings=settings, stages=self.ran, self_intersections=crossings, measured=measured
        )
