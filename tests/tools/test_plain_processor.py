# SPDX-License-Identifier: GPL-3.0-or-later
"""One result on every processor: seven works under several of them, played by the one that is there."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.once
WORKS = Path(__file__).resolve().parents[1] / "works.py"


def test_seven_works_have_one_digest_each_on_every_processor(load_tool):
    """Each processor has a process of its own, which chooses as it starts."""
    plain = load_tool("plain_processor").plain_environment(sys.executable)
    settings = [{}, plain]
    if platform.machine() in ("x86_64", "AMD64"):
        settings += [{"OPENBLAS_CORETYPE": core} for core in ("Nehalem", "Sandybridge", "Haswell")]
    own = {name: value for name, value in os.environ.items() if name not in plain}
    command = [sys.executable, str(WORKS)]
    running = [
        subprocess.Popen(command, env={**own, **each}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for each in settings
    ]
    outputs = [process.communicate() for process in running]
    assert [said for _, said in outputs] == [""] * len(settings)
    digests = [json.loads(printed) for printed, _ in outputs]
    assert len(digests[0]) == len(set(digests[0].values())) == 7
    assert digests == [digests[0]] * len(settings)


def test_a_plain_processor_has_no_version_left_to_choose(load_tool):
    tool = load_tool("plain_processor")
    plain = tool.plain_environment(sys.executable)
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", tool.CHOSEN_FEATURES],
        env={**os.environ, **plain},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout.strip(), done.stderr) == ("", "")
