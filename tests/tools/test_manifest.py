# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's manifest keeps to the rules of Blender's extensions platform, and names who made what is packed."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
# The list of the manual, Extension Licenses.
ACCEPTED = {"GPL-2.0-or-later", "GPL-3.0-or-later", "LGPL-2.1-or-later", "LGPL-3.0-or-later", "MIT", "MIT-0", "Zlib"}
ACCEPTED |= {"BSD-1-Clause", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "MPL-2.0", "Pixar"}
pytestmark = pytest.mark.once


def test_licenses_are_those_that_the_platform_accepts():
    assert {name.removeprefix("SPDX:") for name in MANIFEST["license"]} <= ACCEPTED
    assert not list((ROOT / "ctmc_addon").rglob("OFL*"))


def test_every_library_of_the_zips_has_its_authors_named():
    pins = (ROOT / "tools" / "wheels.txt").read_text(encoding="utf-8")
    libraries = set(re.findall(r"^([\w-]+)==", pins, re.MULTILINE)) | {"three.js", "fflate", "FreeFont"}
    named = "\n".join(MANIFEST["copyright"])
    assert {library for library in libraries if library not in named} == set()
    assert all(re.match(r"\d{4}(-\d{4})? \S", line) for line in MANIFEST["copyright"])


def test_the_tagline_fits_the_listing():
    assert len(MANIFEST["tagline"]) <= 64
    assert MANIFEST["tagline"][-1].isalnum()


def test_the_address_is_the_same_wherever_it_stands(load_tool, tmp_path):
    set_address = load_tool("set_address")
    assert len(set(set_address.addresses())) == 1
    for name, _, _ in set_address.PLACES:
        shutil.copyfile(ROOT / name, tmp_path / name)
    for url in ("https://host/owner/first", "https://host/owner/second"):
        set_address.set_address(url, tmp_path)
        assert set(set_address.addresses(tmp_path)) == {url}
    assert tomllib.loads((tmp_path / "blender_manifest.toml").read_text("utf-8"))["website"] == url
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text("utf-8"))["project"]
    assert project["urls"]["Homepage"] == url
    assert project["dynamic"] == ["version"]
    assert f'repository-code: "{url}"\n' in (tmp_path / "CITATION.cff").read_text("utf-8")
