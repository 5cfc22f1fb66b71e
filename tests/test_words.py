# SPDX-License-Identifier: GPL-3.0-or-later
"""The words of the sources: how docstrings begin, which names are none, one meaning for each class name."""

from __future__ import annotations

import ast
import re
import tokenize
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.once
ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ctmc_addon"
SOURCES = sorted(PACKAGE.rglob("*.py"))
OTHER_SOURCES = [path for folder in ("tests", "benchmarks", "tools") for path in sorted((ROOT / folder).rglob("*.py"))]
RIDDLE = re.compile(r"(Return |Yield )?[Ww]hat\b|Of |Those |So many|There (is|are|stand)")  # Beginnings of docstrings.
# The thing that is meant is the name: `components` instead of `found`, `is_finite` instead of `known`.
NO_NAMES = {
    *("alone", "beside", "chosen", "found", "gone", "known", "looks", "made", "one", "others", "said", "say", "some"),
    *("told", "together", "wanted"),
}
SAVED = {"ctmc_addon/ui/properties/surface/structures.py chosen"}  # Blender files hold this property.
CALLED_BY_NAME = {"slab_result"}  # Workers on other machines call it.
WORDS = re.compile(r"\w+")
SENTENCE = re.compile(r"[A-Z0-9`].*\s.*\.")
DIRECTIVE = re.compile(r"(noqa|type|fmt|ruff)\b")


@cache
def all_nodes():
    """Every node of the package, with its file."""
    return [(path, node) for path in SOURCES for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]


def nodes(*kinds):
    """Every node of these kinds, with its file from the root."""
    return [(path.relative_to(ROOT).as_posix(), node) for path, node in all_nodes() if isinstance(node, kinds)]


def test_no_docstring_begins_with_a_riddle():
    documented = nodes(ast.FunctionDef, ast.ClassDef, ast.Module)
    texts = ((path, getattr(node, "name", ""), ast.get_docstring(node) or "") for path, node in documented)
    assert [(path, name, text.splitlines()[0]) for path, name, text in texts if RIDDLE.match(text)] == []


def names_of(node):
    if isinstance(node, ast.Name):
        return node.id if isinstance(node.ctx, ast.Store) else ""
    return node.arg if isinstance(node, ast.arg) else node.name


def test_names_are_nouns():
    named = ((path, names_of(node)) for path, node in nodes(ast.Name, ast.arg, ast.FunctionDef))
    assert sorted({f"{path} {name}" for path, name in named if name in NO_NAMES} - SAVED) == []


def test_a_class_name_has_one_meaning():
    places = defaultdict(list)
    for path, node in nodes(ast.ClassDef):
        places[node.name].append(path)
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}


def test_types_of_arrays_are_defined_once():
    aliases = (
        (path, target.id)
        for path, node in nodes(ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and target.id in {"Floats", "Doubles", "Flags", "Ints", "Indices", "Bytes"}
    )
    assert {path for path, _ in aliases} == {"ctmc_addon/core/arrays.py"}


def test_comments_of_constants_are_sentences():
    ends = {
        (path, node.end_lineno)
        for path, node in nodes(ast.Assign)
        if isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper()
    }
    riddles = []
    for path in SOURCES:
        with tokenize.open(path) as file:
            comments = [token for token in tokenize.generate_tokens(file.readline) if token.type == tokenize.COMMENT]
        for comment in comments:
            place, text = (path.relative_to(ROOT).as_posix(), comment.start[0]), comment.string.lstrip("# ")
            if place in ends and not DIRECTIVE.match(text) and not SENTENCE.fullmatch(text.partition("  # ")[0]):
                riddles.append((*place, text))
    assert riddles == []


def test_a_function_that_no_other_file_uses_is_private():
    files = [set(WORDS.findall(path.read_text(encoding="utf-8"))) for path in SOURCES + OTHER_SOURCES]
    uses = Counter(word for words in files for word in words)
    public = [
        (path, node.name)
        for path, module in nodes(ast.Module)
        for node in module.body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    ]
    assert [(path, name) for path, name in public if uses[name] == 1 and name not in CALLED_BY_NAME] == []
