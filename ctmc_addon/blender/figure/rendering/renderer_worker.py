# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the process that renders a figure's scene: one task per line of JSON, until the input ends.

The input ends when the parent process ends: then this process removes its folder and exits, even in the middle of a
picture.
"""

from __future__ import annotations

import json
import os
import queue
import re
import shutil
import signal
import threading
import traceback
from pathlib import Path
from typing import Any

import bpy

from ....core import CtmcError, own_output, requests, send
from ..video import Video
from .picture import RenderRequest
from .renderer import MARK

TASKS = {task.__name__: task for task in (RenderRequest, Video)}
SAMPLES = re.compile(r"Sample (\d+)/(\d+)")  # The progress that Cycles reports.
REMOVALS = 100  # Blender may be writing into its folder while that is removed.


def serve(blend: str) -> None:
    """Open a .blend, and render tasks with its only scene.

    Parameters
    ----------
    blend : str
        Its path, in the folder of this process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent process is interrupted too, and ends this one.
    tasks: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    listening = threading.Thread(target=listen, args=(tasks, Path(blend).parent), daemon=True)
    listening.start()
    out = own_output()
    try:
        bpy.ops.wm.open_mainfile(filepath=blend, load_ui=False, use_scripts=False)
    except RuntimeError as error:
        why = str(error).strip().removeprefix("Error: ")
        send(out, line({"sentence": f"the scene to render cannot be read back ({why}); choose another folder"}))
        listening.join()  # It may be removing the folder, and ends this process.
    bpy.app.handlers.render_stats.append(lambda text, *_: send(out, line({"share": _share_of(str(text))})))
    while True:
        send(out, line(answer(tasks.get())))


def listen(tasks: queue.SimpleQueue[dict[str, Any]], folder: Path) -> None:
    """Read tasks from standard input; at its end remove the folder and exit at once."""
    for task in requests():
        tasks.put(task)
    for _ in range(REMOVALS):
        shutil.rmtree(folder, ignore_errors=True)
        if not folder.exists():
            break
    os._exit(0)


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Do a task and return the answer to it."""
    task = TASKS[request["task"]](**request["fields"])
    try:
        task.make(bpy.data.scenes[0])
    except CtmcError as error:
        return {"sentence": str(error)}
    except OSError as error:
        return {"sentence": f"{task.name} cannot be written ({error.strerror or error}); choose another place"}
    except Exception:  # noqa: BLE001  (raised again on the other side)
        return {"defect": traceback.format_exc()[-8000:]}
    return {"done": True}


def _share_of(text: str) -> float | None:
    """Return the rendered share of a picture; None where Blender does not report it.

    Examples
    --------
    >>> _share_of("Remaining: 00:02.79 | Mem: 25M | Sample 320/400"), _share_of("Finished")
    (0.8, None)
    """
    match = SAMPLES.search(text)
    return None if match is None else int(match[1]) / max(int(match[2]), 1)


def line(words: dict[str, Any]) -> bytes:
    """Return a line for the parent process, with the mark at its beginning."""
    return b"\n" + MARK + json.dumps(words).encode("ascii") + b"\n"
