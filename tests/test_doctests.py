# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples in the docstrings of the rooms that need no Blender."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for room in ("core", "reporting", "readers", "cli")
    for path in sorted((ROOT / "ctmc_addon" / room).rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", MODULES)
def test_every_example_gives_what_it_says(name, capsys):
    failed, attempted = doctest.testmod(importlib.import_module(name))
    assert attempted > 0
    assert failed == 0, capsys.readouterr().out
