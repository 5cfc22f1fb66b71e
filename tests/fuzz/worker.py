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
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from ctmc_addon.core import Budget, CtmcError, finish
from ctmc_addon.readers import read_surface_steps, read_volume
from ctmc_addon.readers.surface_files import SURFACE_SUFFIXES

from .peers import disagreement

MEMORY = 2 << 30  # bytes of address space
SECONDS = 10.0
LIBRARIES = ("imageio.v3", "nibabel", "nibabel.nifti2", "nrrd", "PIL.Image", "pydicom.pixels", "tifffile", "zarr")


class Look(NamedTuple):
    """What came of reading a path."""

    verdict: str  # 'volume', 'surface', 'not compared', 'refused', 'differs', 'traceback', 'memory', 'hang' or 'killed'
    text: str  # the sentence, or what names the defect
    seconds: float = 0.0

    @property
    def is_defect(self) -> bool:
        """Whether the path did what no file may do."""
        return self.verdict not in ("volume", "surface", "not compared", "refused")


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
    return look_at_all([path])[0]


def look_at_all(paths: Sequence[Path]) -> list[Look]:
    """Read the paths one after the other in a fork; one that ends it gets a new one for the rest."""
    looks: list[Look] = []
    while len(looks) < len(paths):
        looks += _until_the_fork_ends(paths[len(looks) :])
    return looks


def _until_the_fork_ends(paths: Sequence[Path]) -> list[Look]:
    """What was said of the first paths, at least of one: the last may be the one that ended the fork."""
    end, start = os.pipe()
    pid = os.fork()
    if not pid:
        os.close(end)
        _read_and_leave(paths, start)
    os.close(start)
    looks: list[Look] = []
    said, begun, late = b"", time.monotonic(), False
    while len(looks) < len(paths):
        left = begun + SECONDS - time.monotonic()
        late = left <= 0 or not select.select([end], [], [], left)[0]
        piece = b"" if late else os.read(end, 1 << 16)
        if not piece:
            break
        *lines, said = (said + piece).split(b"\n")
        for line in lines:
            looks.append(Look(*json.loads(line)))
            begun = time.monotonic()
    os.close(end)
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    _, status = os.waitpid(pid, 0)
    seconds = time.monotonic() - begun
    if late:
        looks.append(Look("hang", f"more than {SECONDS:g} s", seconds))
    elif len(looks) < len(paths):
        looks.append(Look("killed", f"signal {os.WTERMSIG(status)}" if os.WIFSIGNALED(status) else "left", seconds))
    return looks


def _read_and_leave(paths: Sequence[Path], out: int) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    null = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):
        os.dup2(null, stream)
    for path in paths:
        begun = time.monotonic()
        verdict, text = what_comes_of(path)
        os.write(out, json.dumps((verdict, text, time.monotonic() - begun)).encode() + b"\n")
    time.sleep(60)  # until it is ended


def what_comes_of(path: Path) -> tuple[str, str]:
    """The verdict on a path and its text, as of `Look`."""
    try:
        if path.suffix in SURFACE_SUFFIXES:
            mesh = finish(read_surface_steps(path))
            return "surface", f"{len(mesh.vertices)} vertices, {len(mesh.faces)} triangles"
        volume = read_volume(path, budget=Budget(1))
        found = disagreement(path, volume)
        if found:
            return ("not compared", found[1:]) if found.startswith("?") else ("differs", found)
        return "volume", f"{volume.values.shape} {volume.values.dtype}"
    except CtmcError as error:
        text = str(error)
        several = "\n" in text
        return ("traceback", f"a sentence of several lines: {text!r}") if several else ("refused", text)
    except MemoryError as error:
        return "memory", last_frames(error)
    except BaseException as error:  # noqa: BLE001  (every kind is what is looked for)
        return "traceback", last_frames(error)


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
