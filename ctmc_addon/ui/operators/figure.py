"""Figures for print from the sidebar: `ctmc.figure`, and with `_sheet`, `_deviation` and `_turntable` after it.

Each is made in a scene of its own, which is gone when the work is done or stopped; the user's scene, its render
settings and its selection are never changed. Blender renders a picture, or a band of a large one, in one go: between
two of them the work can be stopped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...blender.figure.render import figure_steps, require_png
from ...blender.figure.sheet import deviation_figure_steps, holds_others, sheet_steps
from ...blender.figure.spec import PAGES, Cell, Comparison, FigureStyle, ShownSurface, Turn
from ...blender.figure.styles import require_engine
from ...blender.figure.turntable import is_video, require_turntable, turntable_steps
from ...blender.materials import material_color
from ...blender.studio import angles_of
from ...blender.surface import as_shown, evaluated_triangles, require_provenance, settings_of
from ...core import MeshError, OutputError, Steps
from ...reporting.captions import figure_caption
from ...reporting.parse import parsed_numbers, parsed_strides
from .. import jobs
from ..properties.figure import FRAMES
from ..properties.preferences import machine
from ..properties.settings import as_written
from ..state import session, surfaces, volumes
from ..translations import translate
from .paths import RELATIVE

ESC = (
    "The window waits while Blender renders; Esc stops it between pictures, or bands of a large one, and leaves nothing"
)


class FigureOperator(jobs.LongOperator):
    """What the four share, before `bpy.types.Operator`: a file dialog, a page, a look, work that locks the file."""

    locks = True
    kind = "figure"
    """Its page."""
    named = "figure"
    """At the end of the file's name."""

    filepath: StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE", *RELATIVE})
    check_existing: BoolProperty(default=True, options={"HIDDEN"})
    filter_glob: StringProperty(default="*.png", options={"HIDDEN"})

    def invoke(self: Any, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for a file, then begin in this window."""
        self.windowed = True
        if self.filepath:
            return self.begin(context)
        self.filepath = self.suggestion(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def suggestion(self, context: bpy.types.Context) -> str:
        """A name for the file."""
        return f"{subject(context)}_{self.named}.png"

    def target(self: Any, suffix: str = ".png") -> Path:
        """The file that was chosen, with `suffix` if it has none."""
        path = Path(bpy.path.abspath(self.filepath))
        if not path.name:
            raise OutputError("no file was chosen; give the figure a name")
        return path if path.suffix else path.with_name(path.name + suffix)

    def page(self, chosen: Any) -> Any:
        """The page that was asked for."""
        start = PAGES[self.kind]
        width, dpi = (as_written(getattr(chosen, f"{self.kind}_{name}")) for name in ("width_mm", "dpi"))
        return replace(start, width_mm=width, dpi=dpi, transparent=chosen.transparent)


def subject(context: bpy.types.Context) -> str:
    """What the figure is of, for the name of its file."""
    thing = context.view_layer.objects.active
    volume = volumes.current(context.scene)
    if surfaces.is_surface(thing):
        return bpy.path.clean_name(thing.name)
    return bpy.path.clean_name(volume.name) if volume is not None else "ctmc"


def look_of(chosen: Any, caption: str = "") -> Any:
    """The look that was asked for; `caption` where none was typed."""
    return FigureStyle(
        style=chosen.style,
        engine=chosen.engine,
        azimuth=as_written(chosen.azimuth),
        elevation=as_written(chosen.elevation),
        scale_bar=chosen.scale_bar,
        orientation=chosen.orientation,
        caption=(chosen.caption or caption) if chosen.use_caption else "",
    )


def blend_of(chosen: Any, target: Path) -> Path | None:
    """Where the figure's own scene goes."""
    return target.with_suffix(".blend") if chosen.write_blend else None


def shown_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The selected reconstructions; where there is none, the active one."""
    active = context.view_layer.objects.active
    return surfaces.selected_surfaces(context) or ([active] if surfaces.is_surface(active) else [])


def shown_of(things: Sequence[bpy.types.Object], meshes: Sequence[Any], chosen: Any) -> tuple[ShownSurface, ...]:
    """One surface in its style's colours; of several each in its own, and the outermost seen through."""
    if len(things) == 1:
        return (ShownSurface(things[0]),)
    own = chosen.style != "print"
    return tuple(
        ShownSurface(
            thing,
            thing.name,
            material_color(thing) if own else None,
            as_written(chosen.opacity) if holds_others(mesh, meshes) else 1.0,
        )
        for thing, mesh in zip(things, meshes, strict=True)
    )


def cell_of(context: bpy.types.Context) -> tuple[Cell, str]:
    """The selected surfaces as one cell, and a caption."""
    things = shown_surfaces(context)
    if not things:
        raise MeshError("no reconstructed surface is selected; choose one or several first")
    seen = [evaluated_triangles(thing, context.scene) for thing in things]
    for thing, mesh in zip(things, seen, strict=True):
        if not len(mesh.faces):
            raise MeshError(f"{thing.name} has no triangles to show; choose another surface")
    caption = figure_caption(
        [settings_of(thing) for thing in things],
        require_provenance(things[0]).threshold,
        sum(len(mesh.faces) for mesh in seen),
    )
    return Cell(shown_of(things, seen, context.scene.ctmc_figure)), caption


def told(work: Steps[Any], scene: int, target: Path) -> Steps[jobs.Conclusion]:
    """The work, and what to say when it is done."""
    yield from work

    def conclude() -> str:
        where = session.scene_of(scene)
        if where is not None:
            session.of(where).message = ""
        return translate("Wrote {name}").format(name=target.name)

    return conclude


def has_surfaces(operator: Any, context: bpy.types.Context) -> bool:
    """Whether there is something to show, with the reason if not."""
    things = shown_surfaces(context)
    if not things:
        operator.poll_message_set("Choose a reconstructed surface first")
        return False
    if any(thing.mode == "EDIT" for thing in things):
        operator.poll_message_set("Leave edit mode first")
        return False
    return True


class CTMC_OT_figure(FigureOperator, bpy.types.Operator):
    """Render the selected surfaces."""

    bl_idname = "ctmc.figure"
    bl_label = "Make Figure"
    bl_description = (
        "Render the selected surfaces to a PNG of a size in mm, with scale bar, the patient's axes and a caption, in a "
        f"scene of its own. {ESC}"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface."""
        return jobs.idle(cls) and has_surfaces(cls, context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """All selected surfaces in one figure."""
        scene, chosen, target = context.scene, context.scene.ctmc_figure, self.target()
        cell, caption = cell_of(context)
        page, look = self.page(chosen), look_of(chosen, caption)
        work = figure_steps([cell], target, page, look, blend_of(chosen, target), scene)
        return told(work, scene.session_uid, target)


class CTMC_OT_figure_sheet(FigureOperator, bpy.types.Operator):
    """Reconstruct with several settings, and render them side by side."""

    bl_idname = "ctmc.figure_sheet"
    bl_label = "Make Sheet"
    bl_description = (
        "Reconstruct the CT with the settings of the panel and these changes to them, and render the surfaces side by "
        f"side with triangles, seconds and error, to a PNG. The scene gets no surface from it. {ESC}"
    )
    kind = named = "sheet"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a CT in memory."""
        return jobs.idle(cls) and volumes.has_volume(cls, context)

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """Every setting in a cell."""
        scene, chosen, target = context.scene, context.scene.ctmc_figure, self.target()
        volume, settings = volumes.require_loaded(scene).volume, scene.ctmc.all_settings()[0]
        comparison = comparison_of(chosen)
        comparison.variants(settings)  # checks the limits of all before the work
        require_png(target)
        require_engine(chosen.engine, chosen.sheet_deviation)
        work = sheet_steps(
            volume,
            settings,
            comparison,
            target,
            self.page(chosen),
            look_of(chosen),
            blend_of(chosen, target),
            chosen.sheet_deviation,
            limit_of(chosen),
            machine().threads,
        )
        return told(work, scene.session_uid, target)


def comparison_of(chosen: Any) -> Any:
    """What a sheet compares, as it was typed."""
    return Comparison(
        parsed_strides(chosen.strides) if chosen.use_strides else (),
        parsed_numbers(chosen.alphas, "alphas", "0 0.5 1") if chosen.use_alphas else (),
        parsed_numbers(chosen.levels, "levels", "0 50 90") if chosen.use_levels else (),
    )


def limit_of(chosen: Any) -> float | None:
    """Where the colour bar ends; None finds out."""
    return as_written(chosen.limit_mm) or None


class CTMC_OT_figure_deviation(FigureOperator, bpy.types.Operator):
    """Render the active surface in the colours of its distance to the surface of full resolution."""

    bl_idname = "ctmc.figure_deviation"
    bl_label = "Make Distance Map"
    bl_description = (
        "Render the active surface to a PNG, in the colours of its distance to the surface of full resolution, "
        f"which is reconstructed for it, with a colour bar in mm. {ESC}"
    )
    named = "distances"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface whose CT is in memory."""
        if not (jobs.idle(cls) and has_surfaces(cls, context) and volumes.has_volume(cls, context)):
            return False
        thing = context.view_layer.objects.active
        if not surfaces.is_of_ct(thing, context.scene):
            cls.poll_message_set("Make a surface of this CT active first")
            return False
        return True

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """The active surface, as it is shown."""
        scene, chosen, target = context.scene, context.scene.ctmc_figure, self.target()
        require_png(target)
        require_engine(chosen.engine, distances=True)
        volume, thing = volumes.require_loaded(scene).volume, context.view_layer.objects.active
        work = deviation_figure_steps(
            volume,
            as_shown(thing, scene),
            target,
            self.page(chosen),
            look_of(chosen),
            blend_of(chosen, target),
            limit_of(chosen),
            machine().threads,
        )
        return told(work, scene.session_uid, target)


class CTMC_OT_figure_turntable(FigureOperator, bpy.types.Operator):
    """Render the selected surfaces turning."""

    bl_idname = "ctmc.figure_turntable"
    bl_label = "Make Turntable"
    bl_description = (
        "Render the selected surfaces turning once or more, without a seam, to a film or to PNG frames in a folder. "
        "The window waits while Blender renders a frame; Esc stops it before the next. Frames that are done stay, and "
        "the same turntable goes on with them"
    )
    kind = named = "turntable"

    overwrite: BoolProperty(
        name="Overwrite", description="Begin anew where frames of a turntable are there already", options={"SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a surface."""
        return jobs.idle(cls) and has_surfaces(cls, context)

    def suggestion(self, context: bpy.types.Context) -> str:
        """A film's name, or a folder's."""
        suffix = suffix_of(context.scene.ctmc_figure)
        self.filter_glob = f"*{suffix}" if suffix else ""
        return f"{subject(context)}_{self.named}{suffix}"

    def plan(self, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        """All selected surfaces on one table."""
        scene, chosen = context.scene, context.scene.ctmc_figure
        target, page = self.target(suffix_of(chosen)), self.page(chosen)
        turn = Turn(as_written(chosen.seconds), chosen.fps, chosen.revolutions)
        require_turntable(target, page, resume=True, overwrite=self.overwrite)
        cell, _ = cell_of(context)
        beside = target if is_video(target) else target.with_name(target.name + ".blend")
        work = turntable_steps(
            cell,
            target,
            page,
            look_of(chosen),
            turn,
            blend_of(chosen, beside),
            scene,
            resume=True,
            overwrite=self.overwrite,
        )
        return told(work, scene.session_uid, target)


def suffix_of(chosen: Any) -> str:
    """The suffix of the chosen format; empty for a folder of frames."""
    return "" if chosen.film == FRAMES else str(chosen.film)


# Azimuth and elevation, degrees.
VIEWS = {
    "oblique": (30.0, 20.0),
    "front": (0.0, 0.0),
    "left": (90.0, 0.0),
    "back": (180.0, 0.0),
    "right": (-90.0, 0.0),
    "head": (0.0, 90.0),
    "feet": (0.0, -90.0),
}


class CTMC_OT_figure_view(bpy.types.Operator):
    """Set where the figure's camera stands."""

    bl_idname = "ctmc.figure_view"
    bl_label = "View From"
    bl_description = "Where the camera of figures stands; the head stays up"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012  (Blender reads it from the class)

    side: EnumProperty(
        name="Side",
        description="Where the camera stands",
        items=[
            ("viewport", "This Viewport", "As the viewport looks at it now"),
            ("oblique", "Front and Left", "From the front, a little from the patient's left and from above"),
            ("front", "Front", "Before the patient"),
            ("left", "Left", "At the patient's left"),
            ("back", "Back", "Behind the patient"),
            ("right", "Right", "At the patient's right"),
            ("head", "Head", "Above the head"),
            ("feet", "Feet", "Below the feet"),
        ],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set both angles."""
        chosen, eye = context.scene.ctmc_figure, getattr(context.space_data, "region_3d", None)
        if self.side != "viewport":
            chosen.azimuth, chosen.elevation = VIEWS[self.side]
        elif eye is None:
            self.report({"ERROR"}, translate("There is no 3D viewport to take the view from"))
            return {"CANCELLED"}
        else:
            chosen.azimuth, chosen.elevation = angles_of(eye.view_rotation.to_matrix().col[2])
        return {"FINISHED"}


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_figure, CTMC_OT_figure_sheet, CTMC_OT_figure_deviation, CTMC_OT_figure_turntable, CTMC_OT_figure_view)
)
