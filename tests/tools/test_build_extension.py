# SPDX-License-Identifier: GPL-3.0-or-later
"""The wheels in the extension's zips are pinned by version and hash."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

PINS = (Path(__file__).resolve().parents[2] / "tools" / "wheels.txt").read_text(encoding="utf-8")
pytestmark = pytest.mark.once


def test_every_library_has_one_version_and_a_hash_for_each_wheel():
    # 4 platforms: 11 wheels of a compiled library (3 Pythons each, 2 on macOS x64), one of a pure one.
    libraries = re.split(r"^(?=[\w-]+==)", PINS, flags=re.MULTILINE)[1:]
    hashes = {library.partition("==")[0]: re.findall(r"--hash=sha256:([0-9a-f]{64})", library) for library in libraries}
    assert len(hashes) == 12
    assert {len(digests) for digests in hashes.values()} <= {1, 11}
    assert len(hashes["pillow"]) == 11
    assert len(hashes["pydicom"]) == 1


def test_pydicom_is_past_its_path_traversal():
    # CVE-2026-32711: DICOMDIR entries could lead out of their folder before 3.0.2.
    version = re.search(r"^pydicom==([\d.]+)", PINS, re.MULTILINE)
    assert version is not None
    assert tuple(map(int, version[1].split("."))) >= (3, 0, 2)
