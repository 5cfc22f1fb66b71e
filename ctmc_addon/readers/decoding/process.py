# SPDX-License-Identifier: GPL-3.0-or-later
"""Start the decoding process, ask it for one picture after the other, and end it.

Decoders of compressed pixels are written in C; a file made for it makes them crash, hang or use up the memory. In a
process of their own that ends nothing but itself. It is this Python with the same modules, it is asked in lines of
JSON, and it answers with plain numbers: nothing it says is run.
"""

from __future__ import annotations

import json
import os
import re
import select
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import BOOT, ReadError, Step, Steps, ending, first_request, interpreter

WORKER = Path(__file__).with_name("worker.py")
TICK = 0.02  # Seconds between two checks for an answer.
START_SECONDS = 60.0
PICTURE_SECONDS = 8.0  # A picture may take this long; a larger one, for each MEGAPIXEL.
MEGAPIXEL = 1 << 20
MEMORY = 2 << 30  # Bytes that the process may address, beside those for each pixel.
MEMORY_OF_A_PIXEL = 64
LONGEST_LINE = 1 << 16
PIECE = 1 << 20


class DecoderEnded(Exception):
    """The process crashed, or was ended because it took too long; the text has the reason."""


class DecodingProcess:
    """A process that decodes; `started` makes it, and `close` must be called at the end.

    Parameters
    ----------
    pixels : int
        Of the largest picture that will be asked for: memory and time are limited by it.
    """

    def __init__(self, command: list[str], pixels: int) -> None:
        self.seconds = PICTURE_SECONDS * max(1.0, pixels / MEGAPIXEL)
        self.received = bytearray()
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
        )
        self.ask(first_request(WORKER, MEMORY + MEMORY_OF_A_PIXEL * pixels))

    def ask(self, request: Mapping[str, Any]) -> None:
        """Send a request; the answer to the one before must have been taken."""
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(json.dumps(request).encode("ascii") + b"\n")
        except OSError:
            pass  # it has ended, which the wait for its answer will say

    def ready_steps(self) -> Steps[bool]:
        """Wait until the process has loaded its libraries; False where it cannot."""
        try:
            yield from self._line_steps(Step(0.0, "Starting the decoder"), START_SECONDS)
        except DecoderEnded:
            return False
        return True

    def picture_steps(self, shape: tuple[int, int], step: Step) -> Steps[NDArray[Any]]:
        """Return the picture asked for last, (rows, columns); `step` is yielded while it is decoded.

        Raises
        ------
        ReadError
            The worker's sentence.
        DecoderEnded
            If the process crashed or took too long.
        """
        line = yield from self._line_steps(step, self.seconds)
        try:
            answer = json.loads(line)
            sentence, defect, name = answer.get("sentence"), answer.get("defect"), str(answer.get("dtype"))
            size = tuple(answer.get("shape", ()))
        except (ValueError, AttributeError, TypeError) as error:
            raise DecoderEnded("its answer could not be read") from error
        if sentence is not None:
            raise ReadError(str(sentence))
        if defect is not None:
            raise RuntimeError(f"in the decoding process:\n{defect}")
        if size != shape or not re.fullmatch(r"[<>=|][iuf][1248]", name):
            raise DecoderEnded("it answered with another picture")
        picture = np.empty(shape, name)
        yield from self._fill_steps(memoryview(picture.reshape(-1).view(np.uint8).data), step)
        return picture

    def _line_steps(self, step: Step, seconds: float) -> Steps[bytes]:
        end = time.monotonic() + seconds
        while b"\n" not in self.received and len(self.received) < LONGEST_LINE:
            piece = self._available()
            self.received += piece
            if not piece:
                yield step
                if time.monotonic() > end:
                    self.process.kill()
                    raise DecoderEnded(f"it took longer than {seconds:.0f} s")
        line, _, rest = self.received.partition(b"\n")
        self.received = rest
        return bytes(line)

    def _fill_steps(self, target: memoryview, step: Step) -> Steps[None]:
        """Read the bytes of a picture, which the process writes in one go."""
        done = min(len(self.received), len(target))
        target[:done] = self.received[:done]
        del self.received[:done]
        end = time.monotonic() + self.seconds
        while done < len(target):
            piece = self._available()[: len(target) - done]
            target[done : done + len(piece)] = piece
            done += len(piece)
            if not piece:
                yield step
                if time.monotonic() > end:
                    self.process.kill()
                    raise DecoderEnded("it stopped in the middle of an answer")

    def _available(self) -> bytes:
        """Wait up to `TICK` seconds and return the bytes written so far; `DecoderEnded` if the output has ended."""
        assert self.process.stdout is not None
        handle = self.process.stdout.fileno()
        try:
            if not _is_readable(handle):
                return b""
            piece = os.read(handle, PIECE)
        except OSError:  # a broken pipe, on Windows
            piece = b""
        if not piece:
            raise DecoderEnded(f"it {ending(self.process)}")
        return piece

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            try:
                pipe.close()
            except OSError:
                pass


def started_steps(pixels: int) -> Steps[DecodingProcess | None]:
    """Start a process that is ready to decode.

    Parameters
    ----------
    pixels : int
        How many pixels its largest picture has.

    Returns
    -------
    DecodingProcess or None
        None where this system, or whoever runs it, allows no further process.
    """
    python = interpreter()
    if python is None:
        return None
    try:
        process = DecodingProcess([str(python), "-I", "-S", "-c", BOOT], pixels)
    except OSError:
        return None
    ready = False
    try:
        ready = yield from process.ready_steps()
    finally:
        if not ready:
            process.close()
    return process if ready else None


def _is_readable(handle: int) -> bool:
    """Return whether a pipe has something to read or has ended, after at most `TICK` seconds."""
    if sys.platform != "win32":
        return bool(select.select([handle], [], [], TICK)[0])
    import _winapi
    import msvcrt

    if _winapi.PeekNamedPipe(msvcrt.get_osfhandle(handle), 0)[0]:
        return True
    time.sleep(TICK / 4)
    return False
