# SPDX-License-Identifier: GPL-3.0-or-later
import json
import socket
import struct
import subprocess
import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from shapes import distance_mm

from ctmc_addon.cli.machine import scheduler

ROOT = Path(__file__).resolve().parents[3]
pytestmark = [pytest.mark.usefixtures("scene"), pytest.mark.once]


@pytest.fixture(scope="module", autouse=True)
def distributed():
    return pytest.importorskip("distributed", reason="dask.distributed is not installed")


def test_a_lost_workers_case_is_done_elsewhere_with_the_same_files(cluster, tmp_path):
    ball = (9 - distance_mm((20, 20, 20))).clip(0).astype(np.float32)
    for name in ("a", "b", "c"):
        np.save(tmp_path / f"{name}.npy", ball)
    (tmp_path / "d.npy").write_bytes(b"noise")
    address = cluster.stdout.readline().strip()
    assert address.startswith("tcp://127.0.0.1:")
    words = ["batch", str(tmp_path / "*.npy"), "-o", str(tmp_path / "out"), "--threshold", "2", "--no-thumbnails"]
    cluster.stdin.write("kill one\n")
    cluster.stdin.flush()
    command = [sys.executable, "-m", "ctmc_addon", *words, "--scheduler", address]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert cluster.stdout.readline().strip() == "killed"
    assert (done.returncode, done.stderr) == (1, "ctmc: 1 of 4 cases failed: d\n")
    assert "2 at tcp://" in done.stdout
    rows = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert [(row["case"], row["status"]) for row in rows] == [
        ("a", "done"),
        ("b", "done"),
        ("c", "done"),
        ("d", "failed"),
    ]
    assert len({row["faces"] for row in rows[:3]}) == 1
    for name in ("a", "b", "c"):
        content = (tmp_path / "out" / f"{name}.stl").read_bytes()
        assert len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0] == 84 + 50 * rows[0]["faces"]
    there = {path.name for path in (tmp_path / "out").iterdir()}
    assert there == {"a.json", "a.stl", "b.json", "b.stl", "c.json", "c.stl", "d.json", "summary.csv", "summary.html",
                     "summary.json"}  # fmt: skip


def test_the_extension_calls_no_scheduler(monkeypatch):
    monkeypatch.setattr(scheduler, "__name__", "bl_ext.user_default.ctmc.ctmc_addon.cli.scheduler")
    monkeypatch.setattr("asyncio.run", None)
    with pytest.raises(scheduler.CtmcError, match="the Blender extension does not use the network"):
        scheduler.Scheduler("tcp://127.0.0.1:8786")


def test_a_scheduler_that_does_not_answer_is_said_with_the_time(refused, tmp_path, monkeypatch):
    monkeypatch.setattr(scheduler, "PATIENCE", 1.0)
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3), np.uint8))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    sentence = refused("batch", tmp_path, "-o", tmp_path / "out", "--scheduler", f"tcp://127.0.0.1:{port}")
    assert f"the scheduler tcp://127.0.0.1:{port} did not answer within " in sentence
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("reply", "words"),
    [
        (b"", "did not answer within "),  # a scheduler that hangs
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "is not a dask scheduler; check the port"),  # its web page
    ],
)
def test_what_takes_the_call_and_is_no_scheduler_is_given_up(refused, tmp_path, monkeypatch, reply, words):
    monkeypatch.setattr(scheduler, "PATIENCE", 1.0)
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3), np.uint8))
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as lines:

        def answer():
            line = lines.enter_context(server.accept()[0])
            line.sendall(reply)

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        port = server.getsockname()[1]
        sentence = refused("batch", tmp_path, "-o", tmp_path / "out", "--scheduler", f"tcp://127.0.0.1:{port}")
        thread.join(timeout=10)
    assert f"tcp://127.0.0.1:{port} {words}" in sentence
    assert not (tmp_path / "out").exists()


def test_without_distributed_the_extra_is_named(refused, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    np.save(tmp_path / "a.npy", np.zeros((3, 3, 3), np.uint8))
    assert "pip install 'ctmc-addon[cluster]'" in refused(
        "batch", tmp_path, "-o", tmp_path / "out", "--scheduler", "h:1"
    )
