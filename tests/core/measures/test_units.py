# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers with a unit are written by units.py alone, so that they follow the object's size everywhere."""

from __future__ import annotations

import ast
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import ctmc_addon
from ctmc_addon.core import length_text, position_text, sizes_text, volume_text

PACKAGE = Path(ctmc_addon.__file__).parent
UNIT = re.compile(r" ?(mm|mm2|mm3|mm²|mm³|cm|cm2|cm³|um|µm|ml)\b")
FIELD = re.compile(r"\{[^{}]*\} ?(mm|mm2|mm3|mm²|mm³|cm|cm2|cm³|um|µm|ml)\b")
PAPER = {"blender/figure/page/layout.py", "cli/figure/common.py"}
"""Millimeters on paper, whatever is drawn."""
STORED = {"readers/images/skyscan_log.py"}
"""A number as a file has it."""


def units_behind_values(tree):
    """Return the lines where a string writes a unit behind a value."""
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            for value, text in pairwise(node.values):
                if isinstance(value, ast.FormattedValue) and isinstance(text, ast.Constant) and UNIT.match(text.value):
                    yield node.lineno
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and FIELD.search(node.value):
            yield node.lineno


@pytest.mark.parametrize("text", ['f"{x:.1f} mm"', 'f"{x} ml"', '"{:.0f} mm".format(x)', '"{x} mm3"'])
def test_the_reader_of_the_sources_sees_a_unit_behind_a_value(text):
    assert list(units_behind_values(ast.parse(text))) == [1]
    assert not list(units_behind_values(ast.parse('f"{x} mmHg {text} of mm"')))


def test_no_other_module_writes_a_unit_behind_a_number():
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        name = path.relative_to(PACKAGE).as_posix()
        lines = sorted(set(units_behind_values(ast.parse(path.read_text("utf-8")))))
        if lines and name != "core/measures/units.py" and name not in PAPER | STORED:
            found[name] = lines
    assert found == {}


@pytest.mark.parametrize("exponent", range(-12, 7))
def test_a_size_has_its_digits_in_some_unit_whatever_it_is(exponent):
    value = 1.234 * 10.0**exponent
    for text, sizes in (
        (volume_text(value), {"ml": 1e3, "mm3": 1.0, "um3": 1e-9}),
        (length_text(value), {"mm": 1.0, "um": 1e-3}),
        (sizes_text([value, value / 2], "mm2").split(" x ")[0], None),
    ):
        number, *unit = text.split()
        if sizes is not None:
            assert float(number) * sizes[unit[0]] == pytest.approx(value, rel=1e-3)
        assert float(number) > 0


@pytest.mark.parametrize("between_mm", [1.0, 0.7, 0.1, 0.004, 0.0005])
def test_places_of_neighboring_samples_differ(between_mm):
    texts = {position_text([at * between_mm], between_mm) for at in range(10)}
    assert len(texts) == 10
    assert {len(text.split(".")[1]) - len(" mm") for text in texts} == {max(1, round(-np.floor(np.log10(between_mm))))}
