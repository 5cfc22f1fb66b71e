# SPDX-License-Identifier: GPL-3.0-or-later
"""One volume on a real cluster of two worker processes."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module", autouse=True)
def distributed():
    return pytest.importorskip("distributed", reason="dask.distributed is not installed")


def reconstruct(*words):
    command = [sys.executable, "-m", "ctmc_addon", "reconstruct", *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def write_foam(path, slices=360):
    """Foam in a corner of 166 MB, of which a worker gets a part at a time."""
    z, y, x = np.indices((slices, 60, 50), np.float32) / 4
    values = np.zeros((slices, 360, 320), np.float32)
    values[:, :60, :50] = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    np.save(path, values)


@pytest.mark.once
def test_a_lost_worker_costs_its_slab_and_the_bytes_are_those_of_one_machine(cluster, tmp_path):
    write_foam(tmp_path / "foam.npy")
    words = (tmp_path / "foam.npy", "--threshold", "0.3", "--normals", "gradient")
    here = reconstruct(*words, "-o", tmp_path / "here.ply")
    assert (here.returncode, here.stderr) == (0, "")
    address = cluster.stdout.readline().strip()
    assert address.startswith("tcp://127.0.0.1:")
    cluster.stdin.write("kill one\n")
    cluster.stdin.flush()
    there = reconstruct(*words, "-o", tmp_path / "there.ply", "--scheduler", address)
    assert cluster.stdout.readline().strip() == "killed"
    assert (there.returncode, there.stderr) == (0, "")
    assert (tmp_path / "there.ply").read_bytes() == (tmp_path / "here.ply").read_bytes()


@pytest.mark.once
def test_what_a_worker_refuses_is_one_sentence(cluster, tmp_path):
    write_foam(tmp_path / "foam.npy", 8)
    address = cluster.stdout.readline().strip()
    values = np.load(tmp_path / "foam.npy")
    values[3, 20, 20] = np.nan
    np.save(tmp_path / "foam.npy", values)
    done = reconstruct(tmp_path / "foam.npy", "--threshold", "0.3", "-o", tmp_path / "a.stl", "--scheduler", address)
    assert done.returncode == 1
    assert done.stderr.startswith("ctmc: ")
    assert "--nan-as" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "a.stl").exists()


def test_a_scheduler_that_is_not_there_is_said_before_anything_is_read(tmp_path):
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3), np.uint8))
    done = reconstruct(tmp_path / "a.npy", "-o", tmp_path / "a.stl", "--scheduler", "nowhere")
    assert done.returncode == 1
    assert "is not a scheduler's address" in done.stderr
