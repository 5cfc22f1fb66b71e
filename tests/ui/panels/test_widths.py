# SPDX-License-Identifier: GPL-3.0-or-later
"""No word is cut at the sidebar's usual width, in any of the languages, by Blender's own font; numbers have units."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")
import blf
from ui.drawing import drawn
from ui.strings_of_ours import step_strings

from ctmc_addon.core import PRINT_MEASURES
from ctmc_addon.ui import translations
from ctmc_addon.ui.panels import main
from ctmc_addon.ui.panels.results.page import NAMES, fitting

TABLES = {"English": {}, **{name: translations.table(name) for name in translations.LOCALES}}
# Of the 292 pixels that Blender gives the sidebar at first, at its usual size.
NAME = 88  # pixels on the left for the name of a property
BAR = 195  # pixels of the progress bar
HALF = 92  # pixels beside the icon, of one of two buttons side by side
THIRD = 72  # pixels of one of three buttons without an icon
MEASURE = 140  # pixels for the name of a measure in the table of surfaces
FACT = 240  # pixels of a fact of the CT
USUAL = 292.0  # pixels of the sidebar
USUAL_LINE = 225.0  # pixels of a line with a name and its value, without what Blender leaves beside each


@pytest.fixture(scope="module", autouse=True)
def font():
    blf.size(0, 11.0)
    if not blf.dimensions(0, "width")[0]:
        pytest.skip("this Blender measures no text without a window")


def too_wide(texts, limit, table):
    said = {table.get(text, text) for text in texts}
    return {text: round(blf.dimensions(0, text)[0]) for text in said if blf.dimensions(0, text)[0] > limit}


@pytest.mark.parametrize("language", TABLES)
def test_names_on_the_left_are_not_cut(scene, ball_file, language):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    names = set()
    for scene.ctmc.use_label in (False, True):
        for scene.ctmc.goal in ("none", "reduction", "target_faces", "max_error_mm"):
            names |= set(drawn(*main.STEPS).names)
    bpy.ops.ctmc.cut_add()
    scene.ctmc_solid.use_pegs = True
    names |= set(drawn(main.CTMC_PT_surface).names)
    for scene.ctmc_figure.kind in ("figure", "sheet", "deviation", "turntable"):
        names |= set(drawn(main.CTMC_PT_render).names)
    assert {"Least Wall", "Clearance", "Alpha (Shape)", "Simplify To", "Maximum Error", "Frame Rate [fps]"} <= names
    assert too_wide(names, NAME, TABLES[language]) == {}


def test_every_number_but_a_count_has_its_unit(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(1, 1, 2))
    bare = set()
    for scene.ctmc.goal in ("none", "reduction", "target_faces", "max_error_mm"):
        for scene.ctmc_figure.kind in ("figure", "sheet", "deviation", "turntable"):
            bare |= set(drawn(*main.STEPS).bare)
    assert bare <= {"Triangles", "Slice Steps", "Rounds", "Revolutions", "Alpha (Shape)"}


@pytest.mark.parametrize("language", TABLES)
def test_stages_of_a_job_are_not_cut_in_its_bar(language):
    assert too_wide(step_strings(), BAR, TABLES[language]) == {}


@pytest.mark.parametrize("language", TABLES)
def test_buttons_side_by_side_are_not_cut(language):
    pairs = {"Simplify", "Live Preview", "Export", "Command", "Add Slice", "Add Three", "Keep Largest", "Remove Small"}
    pairs |= {"At Cursor", "Auto"}
    pairs |= {"Grow", "Brush", "Eraser", "Scissors", "Margin", "Islands", "Largest Only", "Fill Holes"}
    assert too_wide(pairs, HALF, TABLES[language]) == {}


@pytest.mark.parametrize("language", TABLES)
def test_three_buttons_side_by_side_are_not_cut(language):
    assert too_wide({"Remove", "Keep", "Separate"}, THIRD, TABLES[language]) == {}


@pytest.mark.parametrize("language", TABLES)
def test_names_of_measures_in_the_table_are_not_cut(language):
    names = {"Volume", "Area", "Components", "Largest Diameter", "Mean", "Standard Deviation"}
    names |= {each.label for each in PRINT_MEASURES}
    assert too_wide(names, MEASURE, TABLES[language]) == {}


def test_a_spacing_of_many_digits_is_not_cut(scene, ball_file):
    bpy.ops.ctmc.load(filepath=str(ball_file), spacing=(0.48828125, 0.48828125, 1.14217))
    text = "24 x 24 x 12, 0.488 x 0.488 x 1.14 mm"
    assert text in drawn(main.CTMC_PT_ct).texts
    assert blf.dimensions(0, text.replace("24 x 24", "512 x 512"))[0] <= FACT


@pytest.mark.parametrize("value", ["0.962 mm (95 %: 0.226)", "4.7 mm (95 %: 0.333)", "2,748 (62.5 mm3)"])
def test_a_value_of_results_is_not_cut_beside_its_name(value):
    room = (1 - NAMES) * USUAL_LINE
    assert fitting([("To Full Surface", value)], 400.0) == [("To Full Surface", value)]
    lines = fitting([("To Full Surface", value)], USUAL)
    assert max(blf.dimensions(0, shown)[0] for _, shown in lines) <= room
    assert [name for name, _ in lines] == ["To Full Surface", *[""] * (len(lines) - 1)]
    assert " ".join(shown for _, shown in lines) == (value if len(lines) == 1 else value.replace("(", "").rstrip(")"))
