"""Every string of ours that a person can read in Blender's interface: registered, drawn, messages of steps."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import bpy

from ctmc_addon.ui.properties import figure as figure_properties
from ctmc_addon.ui.properties import preferences
from ctmc_addon.ui.properties import settings as properties
from ctmc_addon.ui.properties import view as view_properties

PACKAGE = Path(__file__).resolve().parents[2] / "ctmc_addon"
# Calls that show their first argument, or the argument of this name.
SHOWN_FIRST = {"say", "poll_message_set"}
SHOWN_NAMED = {"text", "heading"}
GROUPS = (
    properties.CTMCSettings,
    properties.CTMCLabel,
    view_properties.CTMCView,
    figure_properties.CTMCFigure,
    preferences.CTMCPreferences,
)


def our_types() -> Iterator[type]:
    """The classes that the extension has registered, but operators."""
    yield from GROUPS
    for name in dir(bpy.types):
        found = getattr(bpy.types, name)
        if getattr(found, "__module__", "").startswith("ctmc_addon."):
            yield found


def our_properties() -> Iterator[bpy.types.Property]:
    """The properties of those classes and of our operators."""
    for kind in our_types():
        blenders = set(kind.bl_rna.base.properties.keys()) | {"name", "rna_type"}
        yield from (prop for name, prop in kind.bl_rna.properties.items() if name not in blenders)
    for name in dir(bpy.ops.ctmc):
        yield from (
            prop for prop in getattr(bpy.ops.ctmc, name).get_rna_type().properties if prop.identifier != "rna_type"
        )


def registered_strings() -> set[str]:
    """Labels and descriptions of classes, properties and choices."""
    found = set()
    for kind in our_types():
        for name in ("bl_label", "bl_description", "bl_category"):
            found.add(getattr(kind, name, ""))
    for name in dir(bpy.ops.ctmc):
        kind = getattr(bpy.types, f"CTMC_OT_{name}")
        found |= {kind.bl_label, kind.bl_description}
    for prop in our_properties():
        if prop.is_hidden:
            continue
        found |= {prop.name, prop.description}
        if prop.type == "ENUM":
            found |= {text for item in prop.enum_items for text in (item.name, item.description)}
    return found


def literals(node: ast.AST) -> set[str]:
    """The strings in an expression, the pieces of formatted ones left out."""
    inside = {id(one) for part in ast.walk(node) if isinstance(part, ast.JoinedStr) for one in ast.walk(part)}
    constants = (one for one in ast.walk(node) if isinstance(one, ast.Constant) and id(one) not in inside)
    return {one.value for one in constants if isinstance(one.value, str)}


def drawn_strings() -> set[str]:
    """Literals that panels and operators show."""
    found = set()
    for path in (PACKAGE / "ui").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = getattr(node.func, "id", getattr(node.func, "attr", ""))
            shown = list(node.args[:1]) if called in SHOWN_FIRST else []
            shown += [word.value for word in node.keywords if word.arg in SHOWN_NAMED]
            for value in shown:
                # What `say` is asked inside is found there.
                if not (isinstance(value, ast.Call) and called not in SHOWN_FIRST):
                    found |= literals(value)
    return found


def step_strings() -> set[str]:
    """Messages of steps, which status bar and panel show; those with a name or number in them are left out."""
    found = set()
    for room in ("core", "readers", "scene"):
        for path in (PACKAGE / room).glob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                called = getattr(getattr(node, "func", None), "id", "")
                if called == "Step":
                    found |= literals(node.args[1])
                elif called in {"in_batches", "decoded_steps", "pooled_steps", "said"}:
                    found |= {text for arg in node.args for text in literals(arg)}
                elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "MESSAGE":
                    found |= literals(node.value)
    return found


def all_strings() -> set[str]:
    """All of them, without what has no letters or is an address in the code."""
    found = registered_strings() | drawn_strings() | step_strings()
    return {text for text in found if re.search("[A-Za-z]", text) and not text.startswith("CTMC_")}
