# SPDX-License-Identifier: GPL-3.0-or-later
"""No placeholder and no unit gets lost in a translation; what is not translated is shown in English."""

from __future__ import annotations

import re

import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.ui import translations

PLACEHOLDER = re.compile(r"\{(\w+)\}")


@pytest.mark.parametrize("name", translations.LOCALES)
def test_translations_keep_placeholders_and_units(name):
    for english, said in translations.table(name).items():
        assert said.strip(), english
        assert sorted(PLACEHOLDER.findall(said)) == sorted(PLACEHOLDER.findall(english)), english
        for unit in ("[mm]", "[HU]", "[%]", "[px]", "[ms]", "[GiB]", "[mm3]"):
            assert (unit in said) == (unit in english), english


def test_the_collector_sees_classes_properties_choices_drawings_and_steps(scene):
    from ui.strings_of_ours import all_strings

    found = all_strings()
    for text in (
        "Reconstruct Surface",
        "Share of the triangles to remove. Larger = fewer triangles",
        "Contrast Vessel",
        "Alpha has no effect on a label that is not smoothed",
        "Load a CT first",
        "Finding active voxels",
    ):
        assert text in found


def test_blender_knows_our_words_while_we_are_registered(scene):
    catalogue = translations.catalogue()
    assert catalogue["de_DE"]["Operator", "Reconstruct Surface"] == "Oberfläche rekonstruieren"
    assert catalogue["zh_HANS"]["*", "Threshold"] == "阈值"
    assert translations.translate("Threshold") == "Threshold"
    assert translations.translate("Never heard of") == "Never heard of"
