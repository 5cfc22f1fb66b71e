"""Every string of ours is there in German and in Simplified Chinese, and no placeholder gets lost."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.ui import translations

PLACEHOLDER = re.compile(r"\{(\w+)\}")


def strings():
    """The collector beside this file, loaded while the extension is registered."""
    place = Path(__file__).with_name("strings_of_ours.py")
    spec = importlib.util.spec_from_file_location("strings_of_ours", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.all_strings()


@pytest.mark.parametrize("name", translations.LOCALES)
def test_every_string_of_ours_is_translated(scene, name):
    assert sorted(strings() - set(translations.table(name))) == []


@pytest.mark.parametrize("name", translations.LOCALES)
def test_translations_keep_placeholders_and_units(name):
    for english, said in translations.table(name).items():
        assert said.strip(), english
        assert sorted(PLACEHOLDER.findall(said)) == sorted(PLACEHOLDER.findall(english)), english
        for unit in ("[mm]", "[HU]", "[%]", "[px]", "[ms]", "[GiB]", "[mm3]"):
            assert (unit in said) == (unit in english), english


def test_the_collector_sees_classes_properties_choices_drawings_and_steps(scene):
    found = strings()
    for text in (
        "Reconstruct Surface",
        "Share of the triangles to remove. Larger = fewer triangles",
        "Contrast Vessel",
        "Alpha does nothing on a label that is not softened",
        "Load a CT first",
        "Finding active voxels",
    ):
        assert text in found


def test_blender_knows_our_words_while_we_are_registered(scene):
    catalogue = translations.catalogue()
    assert catalogue["de_DE"]["Operator", "Reconstruct Surface"] == "Oberfläche rekonstruieren"
    assert catalogue["zh_HANS"]["*", "Threshold"] == "阈值"
    assert translations.say("Threshold") == "Threshold"
