# SPDX-License-Identifier: GPL-3.0-or-later
"""Every string of ours that a person can read in Blender's interface; run it to list what is not translated.

`PYTHONPATH=tests python -m ui.strings_of_ours`. A string without a translation is shown in English.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path

import bpy

import ctmc_addon
from ctmc_addon.core import PRINT_MEASURES, Place, measures_in
from ctmc_addon.ui import translations
from ctmc_addon.ui.properties import drawing as drawing_properties, maps as map_properties, preferences
from ctmc_addon.ui.properties.ct import view as view_properties
from ctmc_addon.ui.properties.render import figure as figure_properties, studio as studio_properties
from ctmc_addon.ui.properties.surface import settings as properties, solid as solid_properties, structures

PACKAGE = Path(ctmc_addon.__file__).parent
# Calls that show their first argument, or the argument of this name.
SHOWN_FIRST = {"translate", "poll_message_set"}
SHOWN_NAMED = {"text", "heading"}
# Calls whose strings are messages of steps.
STEPS = {"Step", "said", "in_batches", "decoded_steps", "quiet_batches_steps"}
GROUPS = (
    properties.CTMCSettings,
    structures.CTMCLabel,
    structures.CTMCLabelSource,
    view_properties.CTMCView,
    drawing_properties.CTMCDrawing,
    drawing_properties.CTMCDrawnStructure,
    figure_properties.CTMCFigure,
    map_properties.CTMCMap,
    *solid_properties.CLASSES,
    studio_properties.CTMCStudio,
    preferences.CTMCPreferences,
)


def our_types() -> Iterator[type]:
    """The classes that the extension has registered, but operators."""
    yield from GROUPS
    for name in dir(bpy.types):
        kind = getattr(bpy.types, name)
        if getattr(kind, "__module__", "").startswith("ctmc_addon."):
            yield kind


def our_properties() -> Iterator[bpy.types.Property]:
    """The properties of those classes, of our operators and of the window manager."""
    yield bpy.types.WindowManager.bl_rna.properties["ctmc_page"]
    for kind in our_types():
        blenders = set(kind.bl_rna.base.properties.keys()) | {"name", "rna_type"}
        yield from (prop for name, prop in kind.bl_rna.properties.items() if name not in blenders)
    for name in dir(bpy.ops.ctmc):
        yield from (
            prop for prop in getattr(bpy.ops.ctmc, name).get_rna_type().properties if prop.identifier != "rna_type"
        )


def registered_strings() -> set[str]:
    """Labels and descriptions of classes, properties and choices."""
    strings = set()
    for kind in our_types():
        for name in ("bl_label", "bl_description", "bl_category"):
            strings.add(getattr(kind, name, ""))
    for name in dir(bpy.ops.ctmc):
        kind = getattr(bpy.types, f"CTMC_OT_{name}")
        strings |= {kind.bl_label, kind.bl_description}
    for prop in our_properties():
        if prop.is_hidden:
            continue
        strings |= {prop.name, prop.description}
        if prop.type == "ENUM":
            strings |= {text for item in prop.enum_items for text in (item.name, item.description)}
    return strings


def literals(node: ast.AST) -> set[str]:
    """The strings in an expression, the pieces of formatted ones left out."""
    inside = {id(one) for part in ast.walk(node) if isinstance(part, ast.JoinedStr) for one in ast.walk(part)}
    constants = (one for one in ast.walk(node) if isinstance(one, ast.Constant) and id(one) not in inside)
    return {one.value for one in constants if isinstance(one.value, str)}


def sources(*rooms: str) -> Iterator[tuple[str, ast.Module]]:
    """Name and tree of every module in some rooms; presets are scripts, not modules."""
    for path in (path for room in rooms for path in (PACKAGE / room).rglob("*.py")):
        if not (path.parent / "__init__.py").exists():
            continue
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        yield ".".join(parts).removesuffix(".__init__"), ast.parse(path.read_text(encoding="utf-8"))


def nodes(*rooms: str) -> Iterator[ast.AST]:
    """Everything in the sources of some rooms."""
    for _, tree in sources(*rooms):
        yield from ast.walk(tree)


def name_of(node: ast.AST) -> str:
    """What is called or assigned to, without what it stands in."""
    return str(getattr(node, "id", getattr(node, "attr", "")))


def drawn_strings() -> set[str]:
    """Literals that panels and operators show."""
    strings = set()
    for node in nodes("ui"):
        if not isinstance(node, ast.Call):
            continue
        called = name_of(node.func)
        shown = list(node.args[:1]) if called in SHOWN_FIRST else []
        shown += [word.value for word in node.keywords if word.arg in SHOWN_NAMED]
        for value in shown:
            # What is translated inside is collected there.
            if not (isinstance(value, ast.Call) and called not in SHOWN_FIRST):
                strings |= literals(value)
    return strings


def named_constants(module: str) -> dict[str, str]:
    """The strings in capitals that a module defines or imports."""
    known = vars(import_module(module))
    return {name: value for name, value in known.items() if name.isupper() and isinstance(value, str)}


@cache
def step_strings() -> set[str]:
    """Messages of steps and names of stages, which status bar and panel show, if no name or number is in them."""
    rooms = sources("core", "readers", "blender", "ui")
    return {text for module, tree in rooms for text in steps_of(tree, named_constants(module))}


def steps_of(tree: ast.Module, constants: Mapping[str, str]) -> Iterator[str]:
    """The step strings of one module, whose constants are given."""
    for node in ast.walk(tree):
        # Of stages and their weights, or their messages; objects are built by calls.
        if isinstance(node, ast.Dict) and not any(isinstance(value, ast.Call) for value in node.values):
            named = (value.id for value in (*node.keys, *node.values) if isinstance(value, ast.Name))
            yield from (constants[name] for name in named if " " in constants.get(name, ""))
        if isinstance(node, ast.Call) and name_of(node.func) in STEPS:
            yield from (text for arg in node.args for text in literals(arg))
            yield from (constants[arg.id] for arg in node.args if isinstance(arg, ast.Name) and arg.id in constants)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)) and isinstance(node.value, ast.Dict):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(name_of(target).endswith("STAGES") for target in targets):
                yield from (text for key in node.value.keys if key is not None for text in literals(key))
        elif isinstance(node, ast.Call) and name_of(node.func) == "Stages" and isinstance(node.args[0], ast.Dict):
            yield from (text for key in node.args[0].keys if key is not None for text in literals(key))


def measure_strings() -> set[str]:
    """Names of measures that panels show."""
    of_print = [each.name for each in PRINT_MEASURES]
    return {each.label for each in measures_in(Place.PANEL | Place.TABLE, printed=of_print)}


def all_strings() -> set[str]:
    """All of them, without what has no letters or is an address in the code; the extension must be registered."""
    strings = registered_strings() | drawn_strings() | step_strings() | measure_strings()
    return {text for text in strings if re.search("[A-Za-z]", text) and not text.startswith("CTMC_")}


def every_literal() -> set[str]:
    """Every string in the sources, to know which translations nothing asks for."""
    trees = (ast.parse(path.read_text(encoding="utf-8")) for path in PACKAGE.rglob("*.py"))
    return {text for tree in trees for text in literals(tree)}


if __name__ == "__main__":
    ctmc_addon.register()
    ours = all_strings()
    used = ours | every_literal()
    for table in translations.LOCALES:
        known = set(translations.table(table))
        print(f"{table}: {len(ours - known)} of {len(ours)} strings are shown in English, {len(known - used)} unused")
        for heading, strings in (("not translated", ours - known), ("not used", known - used)):
            for text in sorted(strings):
                print(f"  {heading}: {text}")
    ctmc_addon.unregister()
