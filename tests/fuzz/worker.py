# SPDX-License-Identifier: GPL-3.0-or-later
"""Read one path in a process of its own with limits on memory and time, and say what came of it.

The process is forked from one that has loaded every library, so that each look takes milliseconds. For systems that
can fork; where it cannot, there is no fuzzing.
"""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from pathlib import Path
from typing import NamedTuple

from ctmc_addon.core import CtmcError
from ctmc_addon.readers import read_volume

MEMORY = 2 << 30  # bytes of address space
SECONDS = 10.0
LIBRARIES = ("imageio.v3", "nibabel", "nibabel.nifti2", "nrrd", "PIL.Image", "pydicom.pixels", "tifffile")


class Look(NamedTuple):
    """What came of reading a path."""

    verdict: str  # 'volume', 'refused', 'traceback', 'memory', 'hang' or 'killed'
    text: str  # the sentence, or what names the defect
    seconds: float = 0.0

    @property
    def is_defect(self) -> bool:
        """Whether the path did what no file may do."""
        return self.verdict not in ("volume", "refused")


def load_libraries() -> None:
    """Import what the readers import when they need it, and every decoder behind it."""
    for name in LIBRARIES:
        __import__(name)
    from PIL import Image

    Image.init()
    for name in ("libjpeg", "openjpeg"):
        __import__(name)


def look_at(path: Path) -> Look:
    """Read `path` in a fork, ended after `SECONDS`."""
    end, start = os.pipe()
    begun = time.monotonic()
    pid = os.fork()
    if not pid:
        os.close(end)
        _read_and_leave(path, start)
    os.close(start)
    said, late = b"", False
    while True:
        left = begun + SECONDS - time.monotonic()
        if left <= 0 or not select.select([end], [], [], left)[0]:
            late = True
            break
        piece = os.read(end, 1 << 16)
        if not piece:
            break
        said += piece
    os.close(end)
    if late:
        _frames_then_kill(pid)
    _, status = os.waitpid(pid, 0)
    seconds = time.monotonic() - begun
    if late:
        return Look("hang", f"more than {SECONDS:g} s", seconds)
    if not said:
        return Look("killed", f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else "left early", seconds)
    return Look(*json.loads(said), seconds)


def _frames_then_kill(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


def _read_and_leave(path: Path, out: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(null, stream)
    try:
        volume = read_volume(path, threads=1)
        answer = ("volume", f"{volume.values.shape} {volume.values.dtype}")
    except CtmcError as error:
        text = str(error)
        answer = ("refused", text) if "\n" not in text else ("traceback", f"a sentence of several lines: {text!r}")
    except MemoryError as error:
        answer = ("memory", last_frames(error))
    except BaseException as error:  # noqa: BLE001  (every kind is what is looked for)
        answer = ("traceback", last_frames(error))
    os.write(out, json.dumps(answer).encode())
    os._exit(0)


def last_frames(error: BaseException) -> str:
    """The error's type, and where it was raised: the last line of ours and the last line of all."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "ctmc_addon" in frame.filename]
    shown = dict.fromkeys(f"{Path(frame.filename).name}:{frame.lineno}" for frame in (*ours[-1:], *frames[-1:]))
    return f"{type(error).__name__} at {' < '.join(reversed(shown))}: {str(error)[:80]}"


def main() -> None:
    """Look at every path of the command line."""
    load_libraries()
    for name in sys.argv[1:]:
        look = look_at(Path(name))
        print(f"{look.verdict:9} {look.seconds:5.2f} {name}: {look.text}", flush=True)


if __name__ == "__main__":
    main()
