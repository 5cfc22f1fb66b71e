# SPDX-License-Identifier: GPL-3.0-or-later
"""Every part of the tests runs in `.ci/run`, once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.once
ROOT = Path(__file__).resolve().parents[2]


def test_each_part_of_the_other_blenders_is_a_job_of_ci_once(load_tool):
    tool = load_tool("test_all")
    jobs = re.findall(r'"make test-all BLENDER=(\S+?)(?: PART=(\S+))?"', (ROOT / ".ci" / "run").read_text("utf-8"))
    run = [part for blender, name in jobs for part in tool.chosen([blender, *filter(None, [name])])]
    assert len(jobs) >= 3
    assert sorted(part[:2] for part in run) == sorted(part[:2] for part in tool.PARTS if part.blender != "5.0.1")


def test_words_choose_versions_and_parts(load_tool):
    tool = load_tool("test_all")
    assert tool.chosen([]) == tool.PARTS
    assert [part[:2] for part in tool.chosen(["5.2", "core"])] == [("5.2.3", "core")]
    assert {part.blender for part in tool.chosen(["4.2", "4.5"])} == {"4.2.23", "4.5.15"}
    assert tool.chosen(["4.3"]) == []
