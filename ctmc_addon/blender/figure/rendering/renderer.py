# SPDX-License-Identifier: GPL-3.0-or-later
"""Render a figure's scene, in this process or in a separate Blender that can be ended at any moment.

Nothing interrupts Blender while it renders: neither Ctrl-C nor Esc nor a window that wants to be drawn is heard before
the picture is done. A process of its own gets the scene as a .blend in a hidden folder beside the output. Closing the
steps ends it and removes the folder, so that nothing is left; it does both itself where whoever started it is gone.
"""

from __future__ import annotations

import json
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Protocol

import bpy

from ....core import BOOT, OutputError, Step, Steps, ending, first_request, interpreter, temporary_files_in
from ....core.files.atomic_write import refused
from ....core.files.temporary_names import temporary_name
from ...output_files import require_room
from ..page.compose import FigureScene
from ..video import Video
from .picture import RenderRequest

Task = RenderRequest | Video
WORKER = Path(__file__).with_name("renderer_worker.py")
MARK = b"ctmc-renderer "  # Begins each answer of the process, because Blender prints to the same stream.
SCENE = "scene.blend"
TICK = 0.02  # Seconds between two checks for an answer.


class Renderer(Protocol):
    """Render tasks one after the other.

    Parameters
    ----------
    folder : Path
        Folder for incomplete files; it is removed at the end.
    """

    folder: Path

    def make_steps(self, task: Task, step: Step) -> Steps[None]:
        """Do a task and yield its step, with the finished share of the task if known."""
        ...


@contextmanager
def renderer_of(figure: FigureScene, output: Path, own_process: bool) -> Iterator[Renderer]:
    """Provide a renderer of a figure's scene, with a hidden folder next to the output.

    A process of its own has a copy of the scene: the figure is removed from this file as soon as that is written.

    Raises
    ------
    OutputError
        If the folder cannot be made, or no process can be started.
    """
    folder = output.with_name(temporary_name())
    try:
        try:
            folder.mkdir(0o700)
        except OSError as error:
            raise refused(output, error) from error
        if not own_process:
            yield _ThisProcess(figure.scene, folder)
            return
        copy = folder / SCENE
        copy.touch()
        write_scene(figure, copy)
        figure.remove()
        process = _RenderProcess(folder)
        try:
            yield process
        finally:
            process.close()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _ThisProcess:
    """Render in this process: quick to start, but not interruptible during a task."""

    def __init__(self, scene: bpy.types.Scene, folder: Path) -> None:
        self.scene = scene
        self.folder = folder

    def make_steps(self, task: Task, step: Step) -> Steps[None]:
        yield step
        task.make(self.scene)


class _RenderProcess:
    """Render in a separate Blender that has opened the scene in `folder`; `close` must be called at the end."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.answers: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self.errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  (closed with the process)
        try:
            self.process = subprocess.Popen(
                command(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.errors,
                env=temporary_files_in(str(folder.resolve())),
                # Ctrl-C in a terminal reaches every process in its group; this one is ended by `close`.
                start_new_session=True,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except OSError as error:
            self.errors.close()
            raise OutputError(
                f"no process could be started to render ({error.strerror}); close other programs"
            ) from error
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()
        self._send(_greeting(folder / SCENE))

    def make_steps(self, task: Task, step: Step) -> Steps[None]:
        """Do a task and yield its step meanwhile.

        Raises
        ------
        OutputError
            With the message of the process, or its exit code.
        """
        self._send({"task": type(task).__name__, "fields": task._asdict()})
        while True:
            yield step
            try:
                line = self.answers.get(timeout=TICK)
            except queue.Empty:
                continue
            if line is None:
                how = ending(self.process, self.errors, remedy="make a smaller picture")
                raise OutputError(f"the figure could not be rendered: its process {how}")
            try:
                answer = json.loads(line)
            except ValueError as error:
                raise RuntimeError(f"the rendering process reported {line!r}") from error
            if "sentence" in answer:
                raise OutputError(answer["sentence"])
            if "defect" in answer:
                raise RuntimeError(f"in the rendering process:\n{answer['defect']}")
            if "done" in answer:
                return
            message = step.message.partition(", ")[0]
            step = step if answer["share"] is None else Step(step.fraction, f"{message}, {answer['share']:.0%}")

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        self.reader.join()
        self.errors.close()
        assert self.process.stdin is not None
        with suppress(OSError):
            self.process.stdin.close()

    def _send(self, request: dict[str, Any]) -> None:
        assert self.process.stdin is not None
        with suppress(OSError):  # The process has ended; waiting for its answer reports that.
            self.process.stdin.write(json.dumps(request).encode("ascii") + b"\n")
            self.process.stdin.flush()

    def _read(self) -> None:
        """Queue the lines of the process, and None at its end."""
        assert self.process.stdout is not None
        try:
            with self.process.stdout as stream:
                for line in stream:
                    _, mark, answer = line.rpartition(MARK)
                    if mark:
                        self.answers.put(answer)
        finally:
            self.answers.put(None)


def command() -> list[str]:
    """Return the command of the process: a second Blender inside Blender, else this Python, which has bpy."""
    if bpy.app.binary_path:
        return [
            *(bpy.app.binary_path, "--background", "--factory-startup"),
            *("--python-exit-code", "1", "--python-expr", BOOT),
        ]
    return [str(interpreter() or sys.executable), "-I", "-S", "-c", BOOT]


def _greeting(blend: Path) -> dict[str, Any]:
    """Return the first request: the module to run, the .blend, and the module search path."""
    request = first_request(WORKER, str(blend.resolve()))
    if not bpy.app.binary_path:
        # Loading bpy adds its own scripts, among which another module bpy would be found first.
        scripts = Path(bpy.utils.resource_path("LOCAL"))
        request["path"] = [entry for entry in request["path"] if scripts not in Path(entry).parents]
    return request


def write_scene(figure: FigureScene, path: Path) -> None:
    """Write the figure's scene to an existing, empty .blend."""
    figure.scene.render.filepath = "//"
    vertices = sum(len(copy.data.vertices) for copies in figure.copies for copy in copies)
    require_room(path, 500_000 + 120 * vertices)
    bpy.data.libraries.write(str(path), {figure.scene}, path_remap="RELATIVE_ALL")
