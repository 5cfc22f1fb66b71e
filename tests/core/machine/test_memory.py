# SPDX-License-Identifier: GPL-3.0-or-later
"""What memory there is: the machine's, the control group's, the process's, whichever is least."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from ctmc_addon.core.errors import MemoryLimitError
from ctmc_addon.core.machine import memory
from ctmc_addon.core.machine.memory import NO_THREAD, available_bytes, linux_available, refusal, require

GIB = 2**30


def written(root, files):
    meminfo = f"MemTotal: 99 kB\nMemAvailable: {8 * 2**20} kB\n"
    for name, text in {"proc/meminfo": meminfo, **files}.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


@pytest.mark.parametrize(
    ("files", "gib"),
    [
        ({}, 8),
        ({"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/memory.max": "max\n", "sys/fs/cgroup/memory.current": "5"}, 8),
        (
            {
                "proc/self/cgroup": "0::/\n",
                "sys/fs/cgroup/memory.max": f"{3 * GIB}\n",
                "sys/fs/cgroup/memory.current": f"{2 * GIB}\n",
                "sys/fs/cgroup/memory.stat": f"anon {GIB}\ninactive_file {GIB // 2}\nactive_file {GIB // 2}\n",
            },
            2,
        ),
        (  # the group around is the narrower one
            {
                "proc/self/cgroup": "0::/slurm/job_1\n",
                "sys/fs/cgroup/slurm/job_1/memory.max": f"{7 * GIB}\n",
                "sys/fs/cgroup/slurm/job_1/memory.current": "0\n",
                "sys/fs/cgroup/slurm/memory.max": f"{6 * GIB}\n",
                "sys/fs/cgroup/slurm/memory.current": f"{2 * GIB}\n",
            },
            4,
        ),
        (  # version 1, in a container that has its own group at the mount
            {
                "proc/self/cgroup": "7:cpu,cpuacct:/docker/ab\n4:memory:/docker/ab\n",
                "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{4 * GIB}\n",
                "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{GIB}\n",
                "sys/fs/cgroup/memory/memory.stat": "cache 1\ntotal_inactive_file 0\n",
            },
            3,
        ),
        (  # version 1, most of whose memory caches a file that was read twice
            {
                "proc/self/cgroup": "4:memory:/\n",
                "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{4 * GIB}\n",
                "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{4 * GIB}\n",
                "sys/fs/cgroup/memory/memory.stat": f"total_inactive_file {GIB}\ntotal_active_file {2 * GIB}\n",
            },
            3,
        ),
        (  # version 1 without a limit
            {
                "proc/self/cgroup": "4:memory:/\n",
                "sys/fs/cgroup/memory/memory.limit_in_bytes": f"{2**63 - 4096}\n",
                "sys/fs/cgroup/memory/memory.usage_in_bytes": f"{GIB}\n",
            },
            8,
        ),
        (  # above memory.high the kernel slows the process down
            {
                "proc/self/cgroup": "0::/\n",
                "sys/fs/cgroup/memory.max": "max\n",
                "sys/fs/cgroup/memory.high": f"{5 * GIB}\n",
                "sys/fs/cgroup/memory.current": f"{2 * GIB}\n",
            },
            3,
        ),
        (  # both versions, the second at a mount of its own
            {
                "proc/self/cgroup": "4:memory:/\n0::/job\n",
                "sys/fs/cgroup/unified/job/memory.max": f"{4 * GIB}\n",
                "sys/fs/cgroup/unified/job/memory.current": f"{2 * GIB}\n",
            },
            2,
        ),
        (  # what no kernel writes
            {
                "proc/meminfo": "MemAvailable:\n",
                "proc/self/cgroup": "odd\n\n0\n0::/\n",
                "sys/fs/cgroup/memory.max": f"{3 * GIB}\n",
                "sys/fs/cgroup/memory.current": f"{2 * GIB}\n",
                "sys/fs/cgroup/memory.stat": "\nanon\ninactive_file x\n",
                "proc/self/statm": "\n",
            },
            1,
        ),
        (  # more in use than allowed
            {
                "proc/self/cgroup": "0::/\n",
                "sys/fs/cgroup/memory.max": f"{GIB}\n",
                "sys/fs/cgroup/memory.current": f"{2 * GIB}\n",
            },
            0,
        ),
    ],
)
def test_the_narrowest_limit_decides(tmp_path, files, gib):
    assert linux_available(written(tmp_path, files)) == gib * GIB


def test_the_address_space_of_the_process_is_a_limit(tmp_path, monkeypatch):
    resource = pytest.importorskip("resource")
    page = resource.getpagesize()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (3 * GIB, 3 * GIB))
    root = written(tmp_path, {"proc/self/statm": f"{GIB // page} 5 5 5\n"})
    assert linux_available(root) == 2 * GIB
    assert linux_available(root, address_space=False) == 8 * GIB


def test_work_beyond_the_limit_is_refused_with_both_numbers():
    require(GIB, "a surface", "use a larger stride", 2 * GIB)
    with pytest.raises(MemoryLimitError, match=r"3\.0 GiB.*2\.0 GiB"):
        require(3 * GIB, "a surface", "use a larger stride", 2 * GIB)
    assert (available_bytes() or 1) > 0


def test_memory_below_a_gib_is_given_in_mib():
    with pytest.raises(MemoryLimitError, match=r"about 640 MiB of memory and 20 MiB"):
        require(640 << 20, "smoothing", "choose a region", 20 << 20)


def test_memory_that_the_system_refuses_is_a_sentence_with_the_bytes_asked_for():
    with (
        pytest.raises(MemoryLimitError, match=r"^smoothing needs at least .* GiB more .* the 2\.0 GiB .*; crop$"),
        refusal("smoothing", "crop", 2 * GIB),
    ):
        np.empty(1 << 50, np.float32)
    with pytest.raises(MemoryLimitError, match="more memory than"), refusal("smoothing", "crop"):
        raise RuntimeError(NO_THREAD)
    with pytest.raises(RuntimeError, match=r"^other$"), refusal("smoothing", "crop"):
        raise RuntimeError("other")


def test_the_system_is_asked_for_its_memory_now_and_then(monkeypatch):
    asked = []
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(memory, "linux_available", lambda _: asked.append(1) or len(asked))
    memory.look_again()
    monkeypatch.setattr(memory.time, "monotonic", iter([1.0, 1.0 + memory.LOOK_AGAIN / 2, 2.0]).__next__)
    assert [memory.available_bytes() for _ in range(3)] == [1, 1, 2]


def test_freed_pages_are_given_back_before_anything_is_refused(monkeypatch):
    given_back = []
    monkeypatch.setattr(memory, "give_back", lambda: given_back.append(None))
    monkeypatch.setattr(memory, "available_bytes", lambda: (30 if given_back else 10) << 20)
    memory.require(10 << 20, "this", "do that")
    assert given_back == []
    memory.require(30 << 20, "this", "do that")
    assert given_back == [None]
    given_back.clear()
    with pytest.raises(
        MemoryLimitError, match=r"^this needs about 31 MiB of memory and 30 MiB are available; do that$"
    ):
        memory.require(31 << 20, "this", "do that")


@pytest.mark.parametrize(("gib", "limit", "little"), [(1, None, True), (8, None, False), (8, 8 * GIB, True)])
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have no glibc")
def test_few_freed_pages_are_kept_where_memory_is_short(monkeypatch, gib, limit, little):
    told = {}
    library = SimpleNamespace(mallopt=told.__setitem__)
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda _: library)
    monkeypatch.setattr(memory, "available_bytes", lambda: gib * GIB)
    monkeypatch.setattr(memory, "address_space_available", lambda: limit)
    memory.keep_little()
    assert told == (memory.LITTLE if little else {})
