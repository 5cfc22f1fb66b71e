# SPDX-License-Identifier: GPL-3.0-or-later
"""The properties of reading and of figures are made from their descriptions, and nothing stands beside them unseen."""

from __future__ import annotations

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.blender.figure.spec import FIGURE_SETTINGS, PAGES
from ctmc_addon.core import descriptions
from ctmc_addon.readers import ReadingOptions
from ctmc_addon.ui.properties.ct import reading
from ctmc_addon.ui.properties.render import figure

FIELDS = {name: about for kind in FIGURE_SETTINGS for name, about in descriptions(kind).items()}
OF_THE_PANEL = {"kind", "write_blend", "use_caption", "film", "use_strides", "use_alphas", "use_levels"}
OF_THE_DIALOG = {"filepath", "directory", "files", "again", "listed"}


def said_of(group, name):
    """Name and explanation that Blender shows."""
    shown = group.properties[name]
    return shown.name, shown.description


def test_the_figures_properties_are_its_fields_and_what_the_panel_asks(scene):
    known = set(scene.ctmc_figure.bl_rna.properties.keys()) - {"rna_type", "name"}
    pages = {f"{kind}_{name}" for kind in PAGES for name in figure.OF_EACH_PAGE}
    assert set(figure.panel_properties()) == OF_THE_PANEL
    assert known == OF_THE_PANEL | pages | set(figure.SHOWN) | set(figure.COMPARED) | {"sheet_deviation"}
    assert {*figure.SHOWN, *figure.COMPARED, *figure.OF_EACH_PAGE} <= set(FIELDS)


@pytest.mark.parametrize("name", [*figure.SHOWN, *figure.COMPARED])
def test_a_figures_property_says_what_its_field_says(scene, name):
    about, shown = FIELDS[name], scene.ctmc_figure.bl_rna.properties[name]
    label, text = said_of(scene.ctmc_figure.bl_rna, name)
    assert label.startswith(about.label)
    assert text.startswith(about.text)
    assert about.without in text
    if about.choices:
        assert tuple(item.identifier for item in shown.enum_items) == about.choices
        assert [item.description.lower() for item in shown.enum_items] == [
            about.choice_texts[choice].lower() for choice in about.choices
        ]


@pytest.mark.parametrize("kind", PAGES)
def test_each_page_has_the_limits_of_the_field_and_its_own_default(scene, kind):
    for name in figure.OF_EACH_PAGE:
        shown = scene.ctmc_figure.bl_rna.properties[f"{kind}_{name}"]
        own = getattr(PAGES[kind], name)
        expected = (0.0, 0.0, FIELDS[name].high) if own is None else (own, FIELDS[name].low, FIELDS[name].high)
        assert (shown.default, shown.hard_min, shown.hard_max) == expected
        assert FIELDS[name].text in shown.description


@pytest.mark.usefixtures("scene")
def test_the_dialogs_properties_are_the_reading_options_and_its_files():
    known = set(bpy.ops.ctmc.load.get_rna_type().properties.keys()) - {"rna_type"}
    assert known == OF_THE_DIALOG | {*reading.SHOWN, "flip_axes"}
    hidden = {"allow_outside", "anatomy_colors", "file_colors", "level", "name"}
    assert set(descriptions(ReadingOptions)) == {*reading.SHOWN, *hidden}


@pytest.mark.parametrize("name", reading.SHOWN)
def test_scene_and_dialog_say_of_an_option_what_its_description_says(scene, name):
    about = descriptions(ReadingOptions)[name]
    dialog, kept = bpy.ops.ctmc.load.get_rna_type(), scene.ctmc.bl_rna
    names = [f"flip_{axis}" for axis in "xyz"] if name == "flip" else [name]
    texts = {said_of(dialog, name)[1], *(said_of(kept, one)[1] for one in names)}
    assert len(texts) == 1
    assert texts.pop().startswith(about.text)
    assert said_of(dialog, name)[0] == about.label


def test_the_name_of_a_ct_is_the_options_name(scene):
    label, text = said_of(scene.ctmc.bl_rna, "volume_name")
    about = descriptions(ReadingOptions)["name"]
    assert (label, text) == (about.label, f"{about.text}. Empty = {about.without}")


@pytest.mark.parametrize(
    "options", [ReadingOptions(), ReadingOptions(spacing=(0.7, 0.7, 2.5), flip="xz", series="3", time=4, strict=True)]
)
def test_options_come_back_from_a_scene_as_they_were_typed(scene, options):
    reading.show_options(scene.ctmc, ReadingOptions(spacing=9, flip="y", series=9, time=9, strict=True))
    reading.show_options(scene.ctmc, options)
    assert reading.options_of_scene(scene.ctmc) == options
