# SPDX-License-Identifier: GPL-3.0-or-later
"""How a process is talked with, and how its end is worded."""

import json
import subprocess
import sys

import pytest

from ctmc_addon.core.machine.own_process import BOOT, PACKAGE, how_it_ended

FATAL = "Fatal Python error: Aborted\n\nThread 0x1:\n\nExtension modules: numpy (total: 1)\n"
ECHOES = """
from ctmc_addon.core.machine.own_process import own_output, requests, send
def serve():
    output = own_output()
    print("chatter", flush=True)
    for request in requests():
        send(output, bytes([request["value"]]) * request["count"])
"""
LISTENS = """
import threading, time
from ctmc_addon.core.machine.own_process import requests
def serve():
    threading.Thread(target=list, args=[requests()], daemon=True).start()
    time.sleep(0.1)
"""


def started(folder, source):
    """A process that serves as the source says, and the line that has it do so."""
    (folder / "served.py").write_text(source)
    path = [str(folder), str(PACKAGE.parent), *(entry for entry in sys.path if entry)]
    first = json.dumps({"path": path, "module": "served", "arguments": []}).encode() + b"\n"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-I", "-S", "-c", BOOT], **pipes), first


def test_requests_sent_with_the_first_are_answered_whole_and_half_a_line_is_none(tmp_path):
    process, first = started(tmp_path, ECHOES)
    asked = [{"value": 7, "count": 300_000}, {"value": 9, "count": 2}]
    lines = b"".join(json.dumps(request).encode() + b"\n" for request in asked)
    said, _ = process.communicate(first + lines + b'{"value": 1', timeout=60)
    assert said == b"\7" * 300_000 + b"\x09" * 2
    assert process.returncode == 0


def test_a_process_ends_while_a_thread_waits_for_requests(tmp_path):
    process, first = started(tmp_path, LISTENS)
    with process:
        process.stdin.write(first)
        process.stdin.flush()
        assert process.wait(60) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize(
    ("status", "printed", "remedy", "words"),
    [
        (0, "", "", "ended with exit code 0"),
        (2, "a\nctmc: no room; choose another place\n\n", "x", "ended with exit code 2: no room; choose another place"),
        (-11, "", "x", "crashed with SIGSEGV"),
        (-6, "what():  std::bad_alloc", "", "crashed with SIGABRT: what():  std::bad_alloc"),
        (-6, FATAL, "", "crashed with SIGABRT: Fatal Python error: Aborted"),
        (-9, "chatter", "", "was ended by SIGKILL"),
        (-9, "chatter", "try fewer jobs", "was ended by SIGKILL; perhaps memory ran out: try fewer jobs"),
        (-15, "", "try fewer jobs", "was ended by SIGTERM"),
        (-4000, "", "", "was ended by signal 4000"),
    ],
)
def test_how_a_process_ended_in_words(status, printed, remedy, words):
    assert how_it_ended(status, printed, remedy) == words
