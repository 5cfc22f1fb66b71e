# SPDX-License-Identifier: GPL-3.0-or-later
"""The process that renders a figure's scene, from inside: a task in a line of JSON, until the input ends.

Its end means that whoever asked is gone: then this process goes too, in the midst of a picture if need be.
"""

from __future__ import annotations

import json
import os
import queue
import re
import signal
import sys
import threading
import traceback
from contextlib import suppress
from typing import Any

import bpy

from ...core import CtmcError
from .picture import Picture
from .renderer import MARK
from .video import Video

TASKS = {task.__name__: task for task in (Picture, Video)}
SAMPLES = re.compile(r"Sample (\d+)/(\d+)")  # as Cycles tells them


def serve(blend: str) -> None:
    """Open a .blend, and do tasks with its only scene.

    Parameters
    ----------
    blend : str
        Its path.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever asks is interrupted too, and ends this process
    requests: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    threading.Thread(target=listen, args=(requests,), daemon=True).start()
    out = own_output()
    bpy.ops.wm.open_mainfile(filepath=blend, load_ui=False, use_scripts=False)
    bpy.app.handlers.render_stats.append(lambda text, *_: say(out, {"share": share_of(str(text))}))
    while True:
        answer(requests.get(), out)


def listen(requests: queue.SimpleQueue[dict[str, Any]]) -> None:
    """Take requests from standard input; at its end leave at once."""
    for line in sys.stdin.buffer:
        requests.put(json.loads(line))
    os._exit(0)


def answer(request: dict[str, Any], out: int) -> None:
    """Do a task, and say what came of it."""
    task = TASKS[request["task"]](**request["fields"])
    try:
        task.make(bpy.data.scenes[0])
    except CtmcError as error:
        say(out, {"sentence": str(error)})
    except OSError as error:
        say(out, {"sentence": f"{task.name} cannot be written ({error.strerror or error}); choose another place"})
    except Exception:  # noqa: BLE001  (raised again on the other side)
        say(out, {"defect": traceback.format_exc()[-8000:]})
    else:
        say(out, {"done": True})


def share_of(text: str) -> float | None:
    """Return how much of a picture is rendered; None where Blender does not tell.

    Examples
    --------
    >>> share_of("Remaining: 00:02.79 | Mem: 25M | Sample 320/400"), share_of("Finished")
    (0.8, None)
    """
    found = SAMPLES.search(text)
    return None if found is None else int(found[1]) / max(int(found[2]), 1)


def own_output() -> int:
    """Return standard output for the other side alone, and lead what Blender prints there nowhere."""
    output = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.close(nowhere)
    return output


def say(out: int, words: dict[str, Any]) -> None:
    """Write one line to the other side."""
    with suppress(OSError):  # it is gone, which standard input says too
        os.write(out, b"\n" + MARK + json.dumps(words).encode("ascii") + b"\n")
