# SPDX-License-Identifier: GPL-3.0-or-later
"""The site is built without a warning: every link, picture and anchor leads somewhere, every name has its docstring."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SITE = ROOT / "out" / "site"
pytestmark = pytest.mark.packaging


@pytest.fixture(scope="module")
def pages():
    command = [sys.executable, str(ROOT / "tools" / "make_site.py")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    assert (done.returncode, "WARNING" in said, "ERROR" in said) == (0, False, False), said
    return {path.relative_to(SITE).as_posix(): path.read_text(encoding="utf-8") for path in SITE.rglob("*.html")}


def test_every_picture_of_the_gallery_stands_above_the_command_that_makes_it(pages):
    cards = re.findall(r'<li>\s*<p><img alt="[^"]+"[^>]*src="([^"]+)".*?</li>', pages["gallery.html"], re.DOTALL)
    commands = re.findall(r"<pre>.*?</pre>", pages["gallery.html"], re.DOTALL)
    assert len(cards) == len(commands) > 8
    for path, command in zip(cards, commands, strict=True):
        assert (SITE / path).is_file()
        words = re.sub(r"<[^>]*>", "", command)
        assert f"{Path(path).stem}." in words or f"make {Path(path).parent.name}" in words


def test_the_reference_has_what_scripts_call_with_its_parameters(pages):
    names = re.findall(r'<h3 id="([\w.]+)"', pages["python.html"])
    assert len(names) > 20
    assert {"ctmc_addon.readers.read_volume", "ctmc_addon.core.reconstruct"} <= set(names)
    assert pages["python.html"].count("doc-section-title") > 20


def test_pages_load_nothing_from_elsewhere(pages):
    loaded = {
        address
        for text in pages.values()
        for tag in re.findall(r"<(?:script|img|link|iframe)\b[^>]*>", text)
        for address in re.findall(r'(?:src|href)="(https?:[^"]+)"', tag)
    }
    assert loaded == set()
