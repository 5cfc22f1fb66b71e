# SPDX-License-Identifier: GPL-3.0-or-later
"""The version stands in one place."""

import tomllib
from pathlib import Path

from ctmc_addon.version import VERSION

ROOT = Path(__file__).resolve().parents[2]


def test_manifest_citation_and_package_have_one_version():
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == VERSION
    assert f"\nversion: {VERSION}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
