# SPDX-License-Identifier: GPL-3.0-or-later
"""No placeholder and no unit gets lost in a translation; what is not translated is shown in English."""

from __future__ import annotations

import ast
import re

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ctmc_addon.core import CtmcError, ReconstructionSettings, Volume, reconstruct
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


def skeletons():
    """Every sentence of the sources as a pattern, in which anything may stand for a value."""
    from ui.strings_of_ours import nodes

    for node in nodes("core", "readers", "blender", "ui"):
        if isinstance(node, ast.JoinedStr):
            parts = [re.escape(p.value) if isinstance(p, ast.Constant) else ".*" for p in node.values]
            yield "".join(parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield re.escape(node.value)


@pytest.mark.once
def test_every_template_is_a_sentence_of_the_sources():
    patterns = {p for p in skeletons() if len(p.replace(".*", "")) >= translations.LEAST_WORDS}
    ours = [re.compile(pattern, re.DOTALL) for pattern in patterns]
    texts = [text.removesuffix(".") for _, text in translations.templates()]  # which may have been put after it
    lost = [text for text in texts if not any(pattern.match(text) for pattern in ours)]
    assert lost == []


def in_german(monkeypatch, sentence):
    table = translations.table("de_DE.toml")
    monkeypatch.setattr(translations, "translate", lambda text: table.get(text, text))
    translations._by_template.cache_clear()
    try:
        return translations.translate_sentence(sentence)
    finally:
        translations._by_template.cache_clear()


def test_a_sentence_is_translated_by_its_template_with_its_names_and_numbers(monkeypatch):
    volume = Volume(np.arange(27, dtype=np.int16).reshape(3, 3, 3), np.eye(4), name="a {b} c")
    with pytest.raises(CtmcError) as refused:
        reconstruct(volume, ReconstructionSettings(threshold=99))
    said = in_german(monkeypatch, str(refused.value))
    assert said.startswith("Der Schwellwert 99 liegt über dem Höchstwert 26 von diesem Volumen (Bereich 0 bis 26); ")
    assert said.endswith("bitte einen in diesem Bereich wählen")
    assert in_german(monkeypatch, "a {b} c is in Edit Mode; leave it first").startswith("a {b} c ist im")
    assert in_german(monkeypatch, "Nobody has said this: 4 of 5 mm") == "Nobody has said this: 4 of 5 mm"


def test_a_sentence_begins_with_a_capital_unless_it_begins_with_a_name():
    translations._by_template.cache_clear()
    templates = [template for _, template in translations.templates()]
    known = next(template for template in templates if template.startswith("no ") or template[:1].islower())
    filled = translations.FIELD.sub("7", known)
    assert translations.translate_sentence(filled)[0].isupper()
    assert translations.translate_sentence("a {b} c is in Edit Mode; leave it first").startswith("a {b} c")
    assert translations.translate_sentence("nobody has said this") == "nobody has said this"


def notes_of_the_sources():
    """Every sentence that CTs and surfaces add to their notes, as a pattern in which anything may stand for a value."""
    from ui.strings_of_ours import name_of, nodes

    rooms = ("maps", "simplification", "smoothing", "solid", "surfaces", "volume")
    for node in nodes("readers", *(f"core/{room}" for room in rooms)):
        if isinstance(node, ast.Call) and name_of(node.func) == "append":
            shown = node if "notes" in ast.unparse(node.func) else None
        elif isinstance(node, ast.AugAssign):
            shown = node.value if "notes" in ast.unparse(node.target) else None
        else:
            shown = node.value if isinstance(node, ast.keyword) and node.arg == "notes" else None
        if shown is not None:
            yield from patterns_in(shown)


def patterns_in(node):
    """The whole strings in an expression, as patterns."""
    if isinstance(node, ast.JoinedStr):
        yield "".join(re.escape(p.value) if isinstance(p, ast.Constant) else ".*" for p in node.values)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield re.escape(node.value)
    else:
        for child in ast.iter_child_nodes(node):
            yield from patterns_in(child)


@pytest.mark.once
@pytest.mark.parametrize("name", ["de_DE.toml", "zh_HANS.toml"])
def test_every_string_of_classes_and_drawings_is_translated(scene, name):
    from ui.strings_of_ours import all_strings

    # The first is drawn as it is; the second is a name from another test.
    assert all_strings() - set(translations.table(name)) <= {"mm3", "Mine"}


@pytest.mark.once
@pytest.mark.parametrize("name", translations.LOCALES)
def test_every_note_is_translated(name):
    keys = list(translations.table(name))
    notes = sorted({note for note in notes_of_the_sources() if note.count("\\ ") > 2})
    assert len(notes) > 40
    lost = [note for note in notes if not any(re.fullmatch(note, key, re.DOTALL) for key in keys)]
    assert lost == []
