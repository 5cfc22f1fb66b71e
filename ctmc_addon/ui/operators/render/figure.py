# SPDX-License-Identifier: GPL-3.0-or-later
"""Make figures for print from the sidebar: `ctmc.figure`, and with `_sheet`, `_deviation` and `_turntable` after it.

Each is made in a separate scene, which is removed when the work is done or stopped; the user's scene, its render
settings and its selection are never changed. Another process renders it, which Esc ends at any moment.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from ....blender.figure.map_colors import scale_of
from ....blender.figure.page.sheet import deviation_figure_steps, sheet_steps
from ....blender.figure.rendering.render import figure_steps, require_png
from ....blender.figure.shown import shown_surfaces as figure_surfaces
from ....blender.figure.spec import (
    PAGES,
    Cell,
    Comparison,
    DistanceMapSettings,
    ExplodedView,
    FigureStyle,
    Page,
    RulerMark,
    Transparency,
    Turn,
)
from ....blender.figure.styles import require_engine
from ....blender.figure.turntable import is_video, require_turntable, turntable_steps
from ....blender.maps import shown_map
from ....blender.rulers import is_ruler, points_of, text_of
from ....blender.slices import is_slice
from ....blender.surface import as_shown, evaluated_triangles, require_provenance, settings_of
from ....blender.tissue import chosen_opacity
from ....core import MeshError, OutputError, Steps
from ....core.files.file_names import file_name, with_suffix
from ....core.volume import structure_color
from ....reporting.captions import figure_caption
from ....reporting.parse import parsed_numbers, parsed_strides
from ... import jobs
from ...properties.preferences import machine
from ...properties.render.figure import FRAMES, values_of
from ...state import session
from ...state.ct import volumes
from ...state.results import surfaces
from ...state.surface import structures
from ...translations import translate
from ..paths import RELATIVE

ESC = "A separate Blender renders it, so this window stays free; Esc stops it and leaves no file"


class _FigureOperator(jobs.LongOperator):
    """Base of the four operators of figures: a file dialog, a page, a style, and work that locks the file.

    Inherited before `bpy.types.Operator`.
    """

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
        return f"{subject(context)}_{self.named}.png"

    def plan(self: Any, context: bpy.types.Context) -> Steps[jobs.Conclusion]:
        path, scene = Path(bpy.path.abspath(self.filepath)), context.scene
        if not path.name:
            raise OutputError("no file was chosen; give the figure a name")
        suffix = _suffix_of(scene.ctmc_figure) if self.kind == "turntable" else ".png"
        target = path.with_name(with_suffix(path.name, suffix))
        work = self.work(context, scene.ctmc_figure, target, page_of(scene.ctmc_figure, self.kind))
        return _concluded_steps(work, scene.session_uid, target)

    def work(self, context: bpy.types.Context, panel: Any, target: Path, page: Page) -> Steps[Any]:
        """Return the steps of this kind of figure."""
        raise NotImplementedError


def _concluded_steps(work: Steps[Any], scene_uid: int, target: Path) -> Steps[jobs.Conclusion]:
    """Do the work and return a conclusion with the message of success."""
    yield from work

    def conclude() -> str:
        scene = session.scene_of(scene_uid)
        if scene is not None:
            session.of(scene).message = ""
        return translate("Wrote {name}").format(name=target.name)

    return conclude


def subject(context: bpy.types.Context) -> str:
    """Return the subject of the figure, for the name of its file."""
    obj, volume = context.view_layer.objects.active, volumes.current(context.scene)
    name = obj.name if surfaces.is_surface(obj) else "ctmc" if volume is None else volume.name
    return file_name(name)


def page_of(panel: Any, kind: str) -> Page:
    """Return the page of the panel for a kind of figure."""
    return replace(PAGES[kind], **values_of(panel, Page, kind))


def style_of(panel: Any, caption: str = "") -> FigureStyle:
    """Return the style of the panel; `caption` is used if none was typed."""
    shown = FigureStyle(**values_of(panel, FigureStyle))
    return replace(shown, caption=(shown.caption or caption or None) if panel.use_caption else "")


def in_map_colors(style: FigureStyle, context: bpy.types.Context) -> FigureStyle:
    """Return a style in the colors of the map that a selected surface shows, the active one's first."""
    active = context.view_layer.objects.active
    objects = sorted(shown_surfaces(context), key=lambda obj: obj != active)
    maps = [stored for stored in map(shown_map, objects) if stored is not None]
    return replace(style, colors=scale_of([each for each in maps if each.name == maps[0].name])) if maps else style


def blend_of(panel: Any, target: Path) -> Path | None:
    """Return the path of the figure's own .blend."""
    return target.with_suffix(".blend") if panel.write_blend else None


def shown_surfaces(context: bpy.types.Context) -> list[bpy.types.Object]:
    """Return the selected reconstructions, or else the active one."""
    active = context.view_layer.objects.active
    return surfaces.selected_surfaces(context) or ([active] if surfaces.is_surface(active) else [])


def _own_opacity(obj: bpy.types.Object) -> float | None:
    """Return the opacity that the user has set for a surface; None if it is that of its name."""
    opacity, label = chosen_opacity(obj), settings_of(obj).label
    by_name = structure_color(label, None, obj.name).opacity
    return None if opacity == by_name < 1.0 else opacity


def cell_of(context: bpy.types.Context) -> tuple[Cell, str]:
    """Return the selected surfaces as one cell, with the slices and rulers that are visible, and a caption."""
    objects = shown_surfaces(context)
    if not objects:
        raise MeshError("no reconstructed surface is selected; choose one or several first")
    meshes = [evaluated_triangles(obj, context.scene) for obj in objects]
    for obj, mesh in zip(objects, meshes, strict=True):
        if not len(mesh.faces):
            raise MeshError(f"{obj.name} has no triangles to show; choose another surface")
    panel = context.scene.ctmc_figure
    explode = ExplodedView(**values_of(panel, ExplodedView)).explode if len(objects) > 1 else 0.0
    spacings_mm = {require_provenance(obj).spacing_mm for obj in objects}
    caption = figure_caption(
        [settings_of(obj) for obj in objects],
        spacings_mm.pop() if len(spacings_mm) == 1 else (),
        require_provenance(objects[0]).threshold,
        sum(len(mesh.faces) for mesh in meshes),
        unit=surfaces.unit_of(objects[0], context.scene),
        explode=explode,
    )
    transparency = Transparency(**values_of(panel, Transparency))
    names = [obj.name for obj in objects] if len(objects) > 1 else []
    opacities = [_own_opacity(obj) for obj in objects]
    shown = figure_surfaces(objects, context.scene, style_of(panel), names, opacities, transparency, explode)
    if explode:  # Slices, distances and angles are true only where the surfaces have their places.
        return Cell(shown), caption
    seen = [obj for obj in context.scene.objects if obj.visible_get() and not obj.hide_render]
    slices = tuple(obj for obj in seen if is_slice(obj))
    marks = tuple(
        RulerMark(tuple(point.to_tuple() for point in points_of(obj)), text_of(obj)) for obj in seen if is_ruler(obj)
    )
    return Cell(shown, slices=slices, rulers=marks), caption


def has_surfaces(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether there is a surface to show, with the reason if not."""
    objects = shown_surfaces(context)
    if not objects:
        operator.poll_message_set("Choose a reconstructed surface first")
        return False
    if any(obj.mode == "EDIT" for obj in objects):
        operator.poll_message_set("Leave Edit Mode first")
        return False
    return True


class CTMC_OT_figure(_FigureOperator, bpy.types.Operator):
    """Render the selected surfaces."""

    bl_idname = "ctmc.figure"
    bl_label = "Make Figure"
    bl_description = (
        "Render the selected surfaces to a PNG with a size in mm, scale bar, the patient's axes and "
        f"a caption; visible slice objects, distances and angles are drawn too. {ESC}"
    )

    needs = (jobs.idle, has_surfaces)

    def work(self, context: bpy.types.Context, panel: Any, target: Path, page: Page) -> Steps[Any]:
        cell, caption = cell_of(context)
        style = in_map_colors(style_of(panel, caption), context)
        return figure_steps([cell], target, page, style, blend_of(panel, target), context.scene, own_process=True)


class CTMC_OT_figure_sheet(_FigureOperator, bpy.types.Operator):
    """Reconstruct with several settings, and render them side by side."""

    bl_idname = "ctmc.figure_sheet"
    bl_label = "Make Sheet"
    bl_description = (
        "Reconstruct the CT with variations of the panel's settings, and render the surfaces side by "
        f"side to a PNG, with triangles, seconds and error. Adds no surface to the scene. {ESC}"
    )
    kind = named = "sheet"

    needs = (jobs.idle, volumes.has_volume)

    def work(self, context: bpy.types.Context, panel: Any, target: Path, page: Page) -> Steps[Any]:
        settings = context.scene.ctmc.all_settings()[0]
        volume = structures.require_volume_of(context.scene, settings)
        comparison = Comparison(
            parsed_strides(panel.strides) if panel.use_strides else (),
            parsed_numbers(panel.alphas, "alphas", "0 0.5 1") if panel.use_alphas else (),
            parsed_numbers(panel.levels, "levels", "0 50 90") if panel.use_levels else (),
        )
        comparison.variants(settings)  # Check all limits before the work.
        require_png(target)
        require_engine(panel.engine, panel.sheet_deviation)
        style, blend = style_of(panel), blend_of(panel, target)
        budget = machine().budget
        distances, limit = panel.sheet_deviation, values_of(panel, DistanceMapSettings)["limit_mm"]
        return sheet_steps(volume, settings, comparison, target, page, style, blend, distances, limit, budget, True)


def is_of_ct(operator: Any, context: bpy.types.Context) -> bool:
    """Return whether the active surface is of the CT in memory, with the reason if not."""
    if not surfaces.is_of_ct(context.view_layer.objects.active, context.scene):
        operator.poll_message_set("Make a surface of this CT active first")
        return False
    return True


class CTMC_OT_figure_deviation(_FigureOperator, bpy.types.Operator):
    """Render the active surface in the colors of its distance to the surface of full resolution."""

    bl_idname = "ctmc.figure_deviation"
    bl_label = "Make Distance Map"
    bl_description = (
        "Render the active surface to a PNG, colored by its distance to the full-resolution surface, with a color bar "
        f"in mm. Reconstructs the full surface first. {ESC}"
    )
    named = "distances"

    needs = (jobs.idle, has_surfaces, volumes.has_volume, is_of_ct)

    def work(self, context: bpy.types.Context, panel: Any, target: Path, page: Page) -> Steps[Any]:
        require_png(target)
        require_engine(panel.engine, colors=True)
        obj = context.view_layer.objects.active
        volume = structures.require_volume_of(context.scene, surfaces.require_settings(obj))
        surface = as_shown(obj, context.scene)
        budget = machine().budget
        style, blend, limit = (
            style_of(panel),
            blend_of(panel, target),
            values_of(panel, DistanceMapSettings)["limit_mm"],
        )
        return deviation_figure_steps(volume, surface, target, page, style, blend, limit, budget, True)


class CTMC_OT_figure_turntable(_FigureOperator, bpy.types.Operator):
    """Render the selected surfaces turning."""

    bl_idname = "ctmc.figure_turntable"
    bl_label = "Make Turntable"
    bl_description = (
        "Render the selected surfaces turning in a seamless loop, to a video or to PNG frames in a "
        "folder. A separate Blender renders them, so this window stays free. Esc stops it; finished "
        "frames stay, and rendering the same turntable again continues with them"
    )
    kind = named = "turntable"

    overwrite: BoolProperty(
        name="Overwrite", description="Start over if frames of a turntable already exist", options={"SKIP_SAVE"}
    )

    needs = (jobs.idle, has_surfaces)

    def suggestion(self, context: bpy.types.Context) -> str:
        suffix = _suffix_of(context.scene.ctmc_figure)
        self.filter_glob = f"*{suffix}" if suffix else ""
        return f"{subject(context)}_{self.named}{suffix}"

    def work(self, context: bpy.types.Context, panel: Any, target: Path, page: Page) -> Steps[Any]:
        turn = Turn(**values_of(panel, Turn))
        require_turntable(target, page, resume=True, overwrite=self.overwrite)
        cell = replace(cell_of(context)[0], rulers=())  # Rulers drawn on the page would not turn.
        blend = blend_of(panel, target if is_video(target) else target.with_name(target.name + ".blend"))
        style, options = (
            in_map_colors(style_of(panel), context),
            {"resume": True, "overwrite": self.overwrite, "own_process": True},
        )
        return turntable_steps(cell, target, page, style, turn, blend, context.scene, **options)


def _suffix_of(panel: Any) -> str:
    """Return the suffix of the format; empty for a folder of frames."""
    return "" if panel.film == FRAMES else str(panel.film)


register, unregister = bpy.utils.register_classes_factory(
    (CTMC_OT_figure, CTMC_OT_figure_sheet, CTMC_OT_figure_deviation, CTMC_OT_figure_turntable)
)
