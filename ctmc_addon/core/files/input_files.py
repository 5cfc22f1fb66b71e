# SPDX-License-Identifier: GPL-3.0-or-later
"""Remember the files that are read, so that no output replaces them.

Readers register the files of their input, and every writer checks before it replaces a file. Either may come first: an
output planned before the work is refused as soon as the input turns out to include it.
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
        # A new file may have the number of a removed one.
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
    """Begin without inputs and outputs, as a command does, and forget those of the block at its end."""
    _current.append(_InputFiles(keeps_plans=True))
    try:
        yield
    finally:
        _current.pop()


def add_inputs(paths: Iterable[PathLike]) -> None:
    """Register files that are read.

    Parameters
    ----------
    paths : iterable of path
        Files, not folders; they need not exist.

    Raises
    ------
    OutputError
        If one of them is a planned output.
    """
    _current[-1].added.update(dict.fromkeys(map(os.path.abspath, paths)))
    for path in _current[-1].planned:
        require_no_input(path)


def plan_output(path: PathLike) -> None:
    """Register a file that will be written, before the work.

    Raises
    ------
    OutputError
        If it is an input.
    """
    require_no_input(path)
    if _current[-1].keeps_plans:
        _current[-1].planned.append(Path(path))


def require_no_input(path: PathLike) -> None:
    """Raise an `OutputError` if `path` is an input, even by a link, a different spelling or a second name."""
    if _current[-1].holds(path):
        raise OutputError(f"{Path(path)} is a file of the input and would be replaced; choose another name or folder")


def _real(path: PathLike) -> str:
    return os.path.normcase(os.path.realpath(path))


def _identity(path: PathLike) -> tuple[int, int] | None:
    with suppress(OSError, ValueError):
        status = Path(path).stat()
        return status.st_dev, status.st_ino
    return None
