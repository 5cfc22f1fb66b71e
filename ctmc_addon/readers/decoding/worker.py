# SPDX-License-Identifier: GPL-3.0-or-later
"""Run the decoding process: read requests as lines of JSON and write pictures as plain bytes until the input ends.

A request names a DICOM file and one of its frames.
"""

from __future__ import annotations

import json
import signal
import sys
import traceback
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core import CtmcError, ReadError, finish, own_output, requests, send
from ..dicom.header import ImageFile, read_dose_header, read_header
from ..dicom.labels.classes import DOSE, SEGMENTATION, object_class
from ..dicom.labels.segmentation_header import header_steps
from ..dicom.pixels.pixels import stored_frames
from ..optional_imports import needed, quiet


def serve(memory: int) -> None:
    """Answer requests on standard input until it ends.

    Parameters
    ----------
    memory : int
        Bytes that this process may address, where the system can hold it to that.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever asks is interrupted too, and ends this process
    out = own_output()  # libraries may print
    limit_memory(memory)
    needed("pydicom.pixels", "pydicom", "DICOM")
    send(out, line({"ready": True}))
    for request in requests():
        send(out, answer(request))


def limit_memory(most: int) -> None:
    """Let allocations beyond `most` bytes fail; not on Windows, and macOS does not keep to it."""
    if sys.platform == "win32":
        return
    import resource

    try:
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        within = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(resource.RLIMIT_AS, (within, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    except (OSError, ValueError):
        pass


def answer(request: dict[str, Any]) -> bytes:
    """Return the picture of one request, or why there is none."""
    path = Path(request["path"])
    try:
        with quiet():
            picture = np.ascontiguousarray(decoded(path, request["frame"]))
    except CtmcError as error:
        return line({"sentence": str(error)})
    except OSError as error:
        return line({"sentence": f"{path.name} cannot be read ({error.strerror or error}); check the file"})
    except MemoryError:
        return line({"sentence": f"{path.name} needs more memory to decode than its size allows; copy it again"})
    except Exception:  # noqa: BLE001  (raised again on the other side)
        return line({"defect": traceback.format_exc()[-8000:]})
    return line({"shape": picture.shape, "dtype": picture.dtype.str}) + picture.tobytes()


def decoded(path: Path, frame: int) -> NDArray[Any]:
    """Decode one frame of a file to pixels as stored, (rows, columns)."""
    return next(stored_frames(header_of(path), [frame]))


@lru_cache(1)
def header_of(path: Path) -> ImageFile:
    """Return the header, kept for a file's next frame."""
    kind = object_class(path)
    if kind == SEGMENTATION:
        return finish(header_steps(path)).image
    header = (read_dose_header if kind == DOSE else read_header)(path)
    if not isinstance(header, ImageFile):
        raise ReadError(f"{path.name} has changed since it was opened; read it again")
    return header


def line(words: dict[str, Any]) -> bytes:
    """Return a line of JSON."""
    return json.dumps(words).encode("ascii") + b"\n"
