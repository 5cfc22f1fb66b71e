# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that are read, so that no output replaces one of them.

Readers name the files of their input, and every writer asks before it replaces a file. Either may come first: an output
that is named before the work is refused as soon as the input turns out to hold it.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import OutputError

PathLike = str | os.PathLike[str]


class _InputFiles:
    """Input files and planned outputs of one command, or of a process that may write now and read later.

    Parameters
    ----------
    keeps_plans : bool
        Whether planned outputs are compared with the inputs that come later.
    """

    def __init__(self, keeps_plans: bool) -> None:
        self.keeps_plans = keeps_plans
        self.added: dict[str, None] = {}  # absolute paths, which are looked up when there is something to compare
        self.paths: set[str] = set()  # links followed, in the system's own case
        self.identities: dict[tuple[int, int], str] = {}  # device and number of a file, and its path
        self.planned: list[Path] = []

    def holds(self, path: PathLike) -> bool:
        """Return whether there is a file at `path` and it is an input, by whatever name."""
        identity = _identity(path)
        if identity is None:
            return False
        self._look_up()
        if _real(path) in self.paths:
            return True
        input_path = self.identities.get(identity)
        # A file that was removed may have left its number to another.
        return input_path is not None and _identity(input_path) == identity

    def _look_up(self) -> None:
        for input_path in self.added:
            self.paths.add(_real(input_path))
            identity = _identity(input_path)
            if identity is not None and identity[1]:  # some network disks number no files
                self.identities[identity] = input_path
        self.added = {}


_current = [_InputFiles(keeps_plans=False)]


@contextmanager
def own_input_files() -> Iterator[None]:
    """Begin without inputs and outputs, as a command does, and forget at the end those of the block."""
    _current.append(_InputFiles(keeps_plans=True))
    try:
        yield
    finally:
        _current.pop()


def add_inputs(paths: Iterable[PathLike]) -> None:
    """Say that files are read.

    Parameters
    ----------
    paths : iterable of path
        Files, not folders; those that do not exist do no harm.

    Raises
    ------
    OutputError
        If an output that was planned is one of them.
    """
    _current[-1].added.update(dict.fromkeys(map(os.path.abspath, paths)))
    for path in _current[-1].planned:
        require_no_input(path)


def plan_output(path: PathLike) -> None:
    """Say before the work that a file will be written.

    Raises
    ------
    OutputError
        If it is a file of the input.
    """
    require_no_input(path)
    if _current[-1].keeps_plans:
        _current[-1].planned.append(Path(path))


def require_no_input(path: PathLike) -> None:
    """Raise an `OutputError` if `path` is a file that is read: by a link, another spelling or another name too."""
    if _current[-1].holds(path):
        raise OutputError(f"{Path(path)} is a file of the input and would be replaced; choose another name or folder")


def _real(path: PathLike) -> str:
    return os.path.normcase(os.path.realpath(path))


def _identity(path: PathLike) -> tuple[int, int] | None:
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        return status.st_dev, status.st_ino
    return None
