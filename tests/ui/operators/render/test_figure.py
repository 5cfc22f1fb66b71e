# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures from the sidebar: what is written, and that the user's file is as it was, whatever happens."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")
Image = pytest.importorskip("PIL.Image")

from ctmc_addon.blender.figure.rendering.render import figure_steps
from ctmc_addon.blender.figure.spec import (
    PAGES,
    Cell,
    DistanceMapSettings,
    ExplodedView,
    FigureStyle,
    Page,
    ShownSurface,
    Transparency,
    Turn,
)
from ctmc_addon.blender.rulers import add_ruler
from ctmc_addon.blender.slices import is_slice
from ctmc_addon.cli.figure.common import page_of, style_of, values_of
from ctmc_addon.cli.program import parser
from ctmc_addon.ui.operators.render import figure, figure_view
from ctmc_addon.ui.panels.render import figure as figure_panel
from ctmc_addon.ui.properties.render import figure as figure_properties
from ctmc_addon.ui.state import session
from ctmc_addon.ui.state.ct import volumes


@pytest.fixture
def loaded(loaded):
    """The ball, loaded, threshold 100, and small figures asked for."""
    chosen = loaded.ctmc_figure
    chosen.style = "paper"
    chosen.figure_width_mm, chosen.figure_dpi = 40.0, 50.0
    chosen.sheet_width_mm, chosen.sheet_dpi = 90.0, 50.0
    chosen.turntable_width_mm, chosen.turntable_dpi = 30.0, 40.0
    chosen.seconds, chosen.fps = 1.0, 3
    return loaded


@pytest.fixture
def surface(loaded):
    """Its surface, selected."""
    bpy.ops.ctmc.reconstruct()
    return bpy.context.view_layer.objects.active


def test_visible_slices_and_rulers_are_in_the_figure_and_hidden_ones_are_not(surface, tmp_path):
    scene = bpy.context.scene
    bpy.ops.ctmc.add_slice()
    plane = next(obj for obj in scene.objects if is_slice(obj))
    kept, hidden = (add_ruler(scene, "distance", [(0, 0, 0), (end, 0, 0)], "Distance", 0.01) for end in (0.2, 0.3))
    hidden.hide_set(True)
    for obj in scene.objects:
        obj.select_set(obj == surface)
    bpy.context.view_layer.objects.active = surface
    bpy.context.view_layer.update()
    cell, _ = figure.cell_of(bpy.context)
    assert [mark.text for mark in cell.rulers] == ["20.0 mm"]
    assert cell.rulers[0].points[1] == pytest.approx((0.2, 0.0, 0.0), abs=1e-6)
    assert cell.slices == (plane,)
    kept.hide_render = plane.hide_render = True
    cell, _ = figure.cell_of(bpy.context)
    assert (cell.rulers, cell.slices) == ((), ())


def test_several_surfaces_are_moved_apart_without_slices_and_rulers_and_one_stays(surface, tmp_path):
    scene, chosen = bpy.context.scene, bpy.context.scene.ctmc_figure
    other = surface.copy()
    scene.collection.objects.link(other)
    other.location.x += 0.6
    bpy.ops.ctmc.add_slice()
    add_ruler(scene, "distance", [(0, 0, 0), (0.2, 0, 0)], "Distance", 0.01)
    chosen.explode = 25.0
    for several in (False, True):
        for obj in scene.objects:
            obj.select_set(obj == surface or (several and obj == other))
        bpy.context.view_layer.objects.active = surface
        bpy.context.view_layer.update()
        cell, caption = figure.cell_of(bpy.context)
        shifts = [shown.shift for shown in cell.surfaces]
        assert ("exploded by 25 mm" in caption) == several
        assert (len(cell.slices), len(cell.rulers)) == ((0, 0) if several else (1, 1))
        assert shifts == [pytest.approx((x, 0, 0), abs=1e-4) for x in ((-0.25, 0.25) if several else (0.0,))]


def file_state():
    """Every data-block of the file, the render settings, the selection and the scene that is shown."""
    blocks = {
        name: sorted(one.name for one in getattr(bpy.data, name))
        for name in dir(bpy.data)
        if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection) and name != "all_ids"
    }
    scene = bpy.context.scene
    render = {
        prop.identifier: str(getattr(scene.render, prop.identifier))
        for prop in scene.render.bl_rna.properties
        if prop.type in {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"} and not prop.is_readonly
    }
    layer = bpy.context.view_layer
    selected = sorted(thing.name for thing in layer.objects if thing.select_get())
    places = sorted((thing.name, str(thing.matrix_world)) for thing in bpy.data.objects)
    active = layer.objects.active
    return blocks, render, selected, active and active.name, places, scene.name, scene.camera


def names(folder):
    return sorted(one.name for one in folder.iterdir() if not one.name.startswith("ball"))


def picture(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGBA"), np.float64) / 255


def planned(name, filepath, **rest):
    """The work of an operator as a job has it, step by step."""
    kind = getattr(figure, f"CTMC_OT_{name}")
    values = {"filepath": str(filepath), "overwrite": False, **rest}
    holder = SimpleNamespace(**values, kind=kind.kind)
    for key in ("plan", "work"):
        setattr(holder, key, getattr(kind, key).__get__(holder))
    return holder.plan(bpy.context)


def test_a_figure_is_written_with_its_blend_and_the_file_stays_as_it_was(surface, tmp_path):
    before = file_state()
    assert bpy.ops.ctmc.figure(filepath=str(tmp_path / "a")) == {"FINISHED"}
    assert file_state() == before
    assert names(tmp_path) == ["a.blend", "a.png"]
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == round(40 / 25.4 * 50)
        assert image.info["dpi"][0] == pytest.approx(50, abs=0.02)
        assert set(image.info) <= {"dpi", "gamma", "srgb", "chromaticity"}  # nothing of this machine
    seen = picture(tmp_path / "a.png")
    red = (seen[..., 0] > 0.3) & (seen[..., 1] < 0.25)
    assert red.mean() > 0.03
    assert str(tmp_path).encode() not in (tmp_path / "a.blend").read_bytes()


def test_the_panel_and_the_scripts_make_the_same_picture(loaded, surface, tmp_path):
    loaded.ctmc_figure.caption = "A ball"
    bpy.ops.ctmc.figure(filepath=str(tmp_path / "a.png"))
    look = FigureStyle("paper", caption="A ball")
    from ctmc_addon.core import finish

    cell = Cell((ShownSurface(surface),))
    finish(figure_steps([cell], tmp_path / "b.png", Page(40.0, 50.0), look))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_several_surfaces_stand_in_one_figure_each_in_its_color(loaded, surface, tmp_path):
    loaded.ctmc.threshold = 135.0
    bpy.ops.ctmc.reconstruct(new=True)
    inner = bpy.context.view_layer.objects.active
    inner.data.materials[0].diffuse_color = (0.0, 0.0, 0.9, 1.0)
    surface.data.materials[0].diffuse_color = (0.0, 0.9, 0.0, 1.0)
    surface.select_set(True)
    loaded.ctmc_figure.write_blend = False
    cell, caption = figure.cell_of(bpy.context)
    faces = [len(thing.data.polygons) for thing in (surface, inner)]
    surface.select_set(False)
    assert figure.cell_of(bpy.context)[1].startswith("Surface at 135, stride 1 × 1 × 1 px = 1 × 1 × 2 mm, ")
    surface.select_set(True)
    assert caption == f"Stride 1 × 1 × 1 px = 1 × 1 × 2 mm, alpha 1, {sum(faces):,} triangles"
    by_name = {shown.name: shown for shown in cell.surfaces}
    assert by_name[surface.name].opacity == 0.3
    assert by_name[inner.name].opacity == 1.0
    before = file_state()
    bpy.ops.ctmc.figure(filepath=str(tmp_path / "a.png"))
    assert file_state() == before
    assert names(tmp_path) == ["a.png"]
    red, green, blue, _ = np.moveaxis(picture(tmp_path / "a.png"), -1, 0)
    assert (green > red + 0.2).mean() > 0.02
    assert (blue > green + 0.2).mean() > 0.005
    loaded.ctmc_figure.style = "print"
    assert {surface.color for surface in figure.cell_of(bpy.context)[0].surfaces} == {None}


def test_no_background_is_none(loaded, surface, tmp_path):
    loaded.ctmc_figure.transparent, loaded.ctmc_figure.write_blend = True, False
    bpy.ops.ctmc.figure(filepath=str(tmp_path / "a.png"))
    assert (picture(tmp_path / "a.png")[..., 3] == 0).mean() > 0.3


def test_a_sheet_needs_the_ct_alone(loaded, tmp_path):
    chosen = loaded.ctmc_figure
    chosen.strides, chosen.use_levels, chosen.levels = "1 2x1", True, "0 50"
    before = file_state()
    assert bpy.ops.ctmc.figure_sheet(filepath=str(tmp_path / "sheet.png")) == {"FINISHED"}
    assert file_state() == before
    assert names(tmp_path) == ["sheet.blend", "sheet.png"]
    with bpy.data.libraries.load(str(tmp_path / "sheet.blend")) as (there, _):
        copies = [name for name in there.objects if name.startswith("CTMC Figure")]
    assert len(copies) == 4


def test_a_map_of_distances_is_of_the_surface_as_it_is_shown_wherever_it_was_moved(loaded, tmp_path):
    loaded.ctmc.stride = (3, 3, 2)
    loaded.ctmc_figure.write_blend = False
    bpy.ops.ctmc.reconstruct()
    thing = bpy.context.view_layer.objects.active
    before = file_state()
    assert bpy.ops.ctmc.figure_deviation(filepath=str(tmp_path / "a.png")) == {"FINISHED"}
    assert file_state() == before
    thing.location.x += 5.0
    bpy.ops.ctmc.figure_deviation(filepath=str(tmp_path / "b.png"))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    thing.modifiers.new("Mine", "DECIMATE").ratio = 0.3
    bpy.ops.ctmc.figure_deviation(filepath=str(tmp_path / "c.png"))
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "c.png").read_bytes()


def test_a_turntable_is_a_film_or_frames_by_the_format_and_goes_on_where_it_was(loaded, surface, tmp_path):
    before = file_state()
    assert bpy.ops.ctmc.figure_turntable(filepath=str(tmp_path / "loop")) == {"FINISHED"}
    assert names(tmp_path) == ["loop.blend", "loop.mp4"]
    loaded.ctmc_figure.film = figure_properties.FRAMES
    bpy.ops.ctmc.figure_turntable(filepath=str(tmp_path / "frames"))
    made = sorted((tmp_path / "frames").glob("*.png"))
    assert [one.name for one in made] == [f"frame_0000{at}.png" for at in (1, 2, 3)]
    assert (tmp_path / "frames.blend").exists()
    written = made[0].stat().st_mtime_ns
    made[1].unlink()
    bpy.ops.ctmc.figure_turntable(filepath=str(tmp_path / "frames"))
    assert made[0].stat().st_mtime_ns == written
    assert made[1].exists()
    loaded.ctmc_figure.seconds = 2.0
    with pytest.raises(RuntimeError, match="frames of another turntable"):
        bpy.ops.ctmc.figure_turntable(filepath=str(tmp_path / "frames"))
    bpy.ops.ctmc.figure_turntable(filepath=str(tmp_path / "frames"), overwrite=True)
    assert len(list((tmp_path / "frames").glob("*.png"))) == 6
    assert file_state() == before


@pytest.mark.parametrize(
    ("name", "steps"), [("figure", 2), ("figure", 1), ("figure_sheet", 20), ("figure_deviation", 8)]
)
def test_work_that_is_stopped_leaves_nothing(surface, tmp_path, name, steps):
    before = file_state()
    work = planned(name, tmp_path / "a.png")
    for _ in range(steps):
        next(work)
    work.close()
    assert file_state() == before
    assert names(tmp_path) == []


def test_a_sheet_that_is_stopped_while_it_renders_leaves_nothing(loaded, tmp_path):
    before = file_state()
    work = planned("figure_sheet", tmp_path / "a.png")
    for step in work:
        if step.message.startswith("Rendering"):
            break
    assert file_state() != before  # the stage stands
    work.close()
    assert file_state() == before
    assert names(tmp_path) == []


def test_a_turntable_that_is_stopped_keeps_its_whole_frames_alone(surface, tmp_path):
    before = file_state()
    work = planned("figure_turntable", tmp_path / "loop.mp4")
    for step in work:
        if step.message.startswith("Rendering frame 3"):
            break
    work.close()
    assert file_state() == before
    assert sorted(one.name for one in (tmp_path / "loop.frames").iterdir()) == [
        "frame_00001.png", "frame_00002.png", "turntable.json",
    ]  # fmt: skip
    assert not (tmp_path / "loop.mp4").exists()


def test_what_goes_wrong_is_a_sentence_and_leaves_nothing(loaded, surface, tmp_path):
    chosen, before = loaded.ctmc_figure, file_state()

    def refused(name, match, **rest):
        with pytest.raises(RuntimeError, match=match):
            getattr(bpy.ops.ctmc, name)(**{"filepath": str(tmp_path / "a.png"), **rest})
        assert file_state() == before
        assert names(tmp_path) == []

    refused("figure", "no file was chosen", filepath="")
    refused("figure", r"a\.jpg is not a \.png", filepath=str(tmp_path / "a.jpg"))
    refused("figure", "the folder does not exist", filepath=str(tmp_path / "deep" / "a.png"))
    refused("figure_turntable", "is not a video", filepath=str(tmp_path / "a.gif"))
    chosen.transparent = True
    refused("figure_turntable", "a video has a background", filepath=str(tmp_path / "a.mp4"))
    chosen.transparent = False
    chosen.revolutions = 0
    refused("figure_turntable", "revolutions must be from 1 to 100", filepath=str(tmp_path / "a.mp4"))
    chosen.strides = "two"
    refused("figure_sheet", "'two' is not a stride")
    chosen.strides = " "
    refused("figure_sheet", "strides to compare are missing")
    chosen.use_strides = False
    refused("figure_sheet", "give one or two")
    chosen.use_levels, chosen.levels = True, "0 120"
    refused("figure_sheet", "from 0 to 99")
    chosen.levels, chosen.engine = "0 50", "workbench"
    refused("figure_deviation", "Workbench shows no map")
    assert "Workbench shows no map" in session.of(loaded).message


def test_a_users_blend_of_that_name_is_not_replaced(surface, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "day.blend"))
    size = (tmp_path / "day.blend").stat().st_size
    with pytest.raises(RuntimeError, match="already exists and is not a figure"):
        bpy.ops.ctmc.figure(filepath=str(tmp_path / "day.png"))
    assert (tmp_path / "day.blend").stat().st_size == size
    assert not (tmp_path / "day.png").exists()


def test_disabled_buttons_say_why(loaded):
    said = []

    def polled(name):
        kind = getattr(figure, f"CTMC_OT_{name}")
        holder = type("Operator", (), {"poll_message_set": staticmethod(said.append), "needs": kind.needs})
        return kind.poll.__func__(holder, bpy.context)

    for name in ("figure", "figure_turntable", "figure_deviation"):
        assert not polled(name)
    assert set(said) == {"Choose a reconstructed surface first"}
    bpy.ops.ctmc.reconstruct()
    volumes._loaded.clear()
    said.clear()
    for name in ("figure_sheet", "figure_deviation"):
        assert not polled(name)
    assert said == ["Load the CT again first"] * 2
    assert bpy.ops.ctmc.figure.poll()
    bpy.ops.object.mode_set(mode="EDIT")
    said.clear()
    assert not polled("figure")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert said == ["Leave Edit Mode first"]


def test_a_fresh_panel_and_the_command_line_start_from_the_same_figure(scene):
    panel = scene.ctmc_figure
    for kind, words in (("figure", ["figure"]), ("sheet", ["figure", "sheet"]), ("turntable", ["figure", "turntable"])):
        args = parser().parse_args([*words, "ct.nii", "-o", "a.png"])
        assert page_of(args) == figure.page_of(panel, kind) == PAGES[kind]
        assert style_of(args) == figure.style_of(panel) == FigureStyle()
        for described in (Transparency, ExplodedView, DistanceMapSettings, Turn):
            assert described(**values_of(args, described)) == described()
            assert described(**figure_properties.values_of(panel, described)) == described()


def test_the_panel_shows_what_each_kind_asks_for(surface):
    from ui.drawing import drawn

    chosen = bpy.context.scene.ctmc_figure
    asked = {
        "figure": {"style", "figure_width_mm", "figure_dpi", "transparent", "azimuth", "caption"},
        "sheet": {"strides", "use_alphas", "levels", "sheet_width_mm", "sheet_deviation"},
        "deviation": {"limit_mm", "figure_width_mm"},
        "turntable": {"film", "seconds", "fps", "revolutions", "turntable_dpi"},
    }
    for kind, properties in asked.items():
        chosen.kind = kind
        layout = drawn(figure_panel.draw_figure)
        assert properties <= set(layout.shown)
        assert layout.buttons == [figure_panel.OPERATORS[kind]]
    assert "transparent" not in layout.shown


def test_the_camera_takes_sides_of_the_patient(scene):
    chosen = scene.ctmc_figure
    for side, angles in figure_view.VIEWS.items():
        bpy.ops.ctmc.figure_view(side=side)
        assert (chosen.azimuth, chosen.elevation) == angles
    with pytest.raises(RuntimeError, match="no 3D viewport"):
        bpy.ops.ctmc.figure_view(side="viewport")


@pytest.mark.parametrize(("azimuth", "elevation"), [(30.0, 20.0), (-120.0, -60.0), (180.0, 0.0), (0.0, 90.0)])
def test_angles_are_those_of_the_cameras_axes(azimuth, elevation):
    from ctmc_addon.blender.scene.studio import angles_of, view_axes

    assert angles_of(view_axes(azimuth, elevation)[:, 2]) == pytest.approx((azimuth, elevation))
