# SPDX-License-Identifier: GPL-3.0-or-later
"""Small batches for tests: their cases, and what their folder says."""

import json
import re
import struct
import sys
import time

import numpy as np
from shapes import distance_mm

from ctmc_addon.cli.batch import process as batch_process

FLAGS = ["--threshold", "50", "--spacing", "0.5"]


def ball(radius, size=20):
    """Return a ball at 50 and above, its radius in voxels."""
    return (50 + 20 * (radius - distance_mm((size,) * 3))).clip(0, 200).astype(np.uint8)


def wait_until(condition, seconds=90):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come about"
        time.sleep(0.05)


def summary(folder):
    return json.loads((folder / "summary.json").read_text("utf-8"))


def page_content(page):
    """What the script of a summary's page shows."""
    return json.loads(re.search(r'<script type="application/json" id="batch">(.*?)</script>', page, re.DOTALL)[1])


def states(folder):
    return {row["case"]: row["status"] for row in summary(folder)}


def whole(folder):
    """Whether every file is complete: an STL as long as it says, a JSON that can be read."""
    for path in folder.rglob("*.stl"):
        content = path.read_bytes()
        assert len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0], path
    for path in folder.rglob("*.json"):
        json.loads(path.read_text("utf-8"))
    return True


def written_at(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("*.json") if path.name != "summary.json"}


def in_place_of_a_case(monkeypatch, script):
    monkeypatch.setattr(batch_process, "command", lambda: [sys.executable, "-c", script])
