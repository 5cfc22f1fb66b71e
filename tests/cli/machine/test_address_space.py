# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes whose address space is limited, as by `ulimit -v`: they finish with the same bytes, or say why not."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ctmc_addon.core import ReconstructionSettings, finish, plan_steps
from ctmc_addon.core.phantom import foam

ROOT = Path(__file__).resolve().parents[3]
# The limit is so many bytes beyond what Python takes with all that the command imports.
LIMITED = """
import resource, sys
from ctmc_addon.cli import main, program
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + int(sys.argv[1]), resource.RLIM_INFINITY))
sys.exit(main(sys.argv[2:]))
"""
pytestmark = [
    pytest.mark.usefixtures("scene"),
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems do not limit the address space"),
]


@pytest.fixture(scope="module")
def volume(tmp_path_factory):
    """The path of 23 MB whose surface has 2M triangles."""
    path = tmp_path_factory.mktemp("foam") / "foam.npy"
    np.save(path, foam(100, 480, 150, 1).slab(0, 100))
    return path


def limited(more_bytes, *words):
    command = [sys.executable, "-c", LIMITED, str(more_bytes), *(str(word) for word in words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)


@pytest.mark.once
def test_a_surface_under_a_limit_has_the_bytes_of_one_without(ctmc, volume, tmp_path):
    words = ["reconstruct", volume, "--threshold", "132", "--threads", "1", "--normals", "mesh", "-o"]
    assert ctmc(*words, tmp_path / "free.stl").code == 0
    for mebibytes in (1024, 120):
        done = limited(mebibytes << 20, *words, tmp_path / "limited.stl")
        assert (done.returncode, done.stderr) == (0, "")
        assert (tmp_path / "limited.stl").read_bytes() == (tmp_path / "free.stl").read_bytes()


@pytest.mark.once
def test_a_simplified_surface_is_made_in_the_memory_that_its_plan_asks_for(ctmc, volume, tmp_path):
    settings = ReconstructionSettings(threshold=132.0, reduction=0.95)
    plan = finish(plan_steps(foam(100, 480, 150, 1), settings))
    words = ["reconstruct", volume, "--threshold", "132", "--simplify", "0.95", "--threads", "1", "-o"]
    assert ctmc(*words, tmp_path / "free.stl").code == 0
    done = limited(plan.needed, *words, tmp_path / "limited.stl")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "limited.stl").read_bytes() == (tmp_path / "free.stl").read_bytes()


def test_tiles_are_unpacked_without_a_thread_for_which_there_is_no_memory(ctmc, tmp_path):
    tifffile = pytest.importorskip("tifffile")
    values = foam(100, 480, 150, 1).slab(0, 100)
    tifffile.imwrite(tmp_path / "tiled.tif", values, photometric="minisblack", metadata=None, tile=(64, 64))
    words = ["reconstruct", tmp_path / "tiled.tif", "--threshold", "132", "--stride", "4", "4", "4", "-o"]
    assert ctmc(*words, tmp_path / "free.stl").code == 0
    done = limited(60 << 20, *words, tmp_path / "limited.stl")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "limited.stl").read_bytes() == (tmp_path / "free.stl").read_bytes()


@pytest.mark.once
def test_a_surface_that_is_written_as_it_is_extracted_has_its_report(volume, tmp_path):
    words = ["reconstruct", volume, "--threshold", "132", "--threads", "1", "-o", tmp_path / "a.stl"]
    done = limited(160 << 20, *words, "--report", tmp_path / "a.json")
    assert (done.returncode, done.stderr) == (0, "")
    report = json.loads((tmp_path / "a.json").read_text("utf-8"))
    assert (tmp_path / "a.stl").stat().st_size == 84 + 50 * report["faces"]
    assert report["area_mm2"] > 0
    assert report["files"] == ["a.stl", "a.json"]


def test_blender_is_not_loaded_where_it_would_crash(volume, tmp_path):
    done = limited(900 << 20, "reconstruct", volume, "--threshold", "132", "-o", tmp_path / "a.blend")
    assert done.returncode == 1
    assert re.fullmatch(r"ctmc: writing .blend needs Blender, .* (89[0-9]|900) MiB are available; .*\n", done.stderr)


@pytest.mark.parametrize("flags", [[], ["--simplify", "0.9"]])
def test_too_little_for_anything_is_a_sentence(volume, tmp_path, flags):
    done = limited(20 << 20, "reconstruct", volume, "--threshold", "132", *flags, "-o", tmp_path / "no.stl")
    (said,) = done.stderr.splitlines()
    assert done.returncode == 1
    assert said.startswith("ctmc: ")
    assert "MiB" in said
    assert said.endswith("; give it more memory")
    assert list(tmp_path.iterdir()) == []
