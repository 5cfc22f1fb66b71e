# SPDX-License-Identifier: GPL-3.0-or-later
"""Print to a terminal: the progress line, tables and numbers; and check that a folder is empty."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from pathlib import Path
from typing import Any, TextIO, TypeVar, cast

from ..core import OutputError, Step, Steps, finish
from ..core.files.atomic_write import refused

T = TypeVar("T")
WIDTH = 30
SHARE = 0.05


class Progress:
    """A bar that is drawn over itself on a terminal; elsewhere nothing, or a line now and then.

    Parameters
    ----------
    stream : TextIO, optional
        Standard error by default.
    lines : bool
        Whether a stream that is not a terminal gets a line after every twentieth of the work.
    """

    def __init__(self, stream: TextIO | None = None, lines: bool = False) -> None:
        self.stream = sys.stderr if stream is None else stream
        self.is_terminal = self.stream.isatty()
        self.lines = lines
        self.shown = ""
        self.due = 0.0

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        if self.is_terminal and self.shown:
            self.stream.write("\r\033[K")
            self.stream.flush()

    def __call__(self, step: Step) -> None:
        """Show where the work is."""
        if self.is_terminal:
            done = round(min(max(step.fraction, 0.0), 1.0) * WIDTH)
            line = f"\r\033[K[{'#' * done}{'.' * (WIDTH - done)}] {step.message}"
            if line != self.shown:
                self.stream.write(line)
                self.stream.flush()
                self.shown = line
        elif self.lines and step.fraction >= self.due:
            print(f"{step.fraction:4.0%}  {step.message}", file=self.stream, flush=True)
            self.due = step.fraction + SHARE

    def finish(self, steps: Steps[T]) -> T:
        """Run the steps, showing each, and return their result; an interrupt closes them."""
        try:
            return finish(steps, self)
        finally:
            steps.close()


class _CheckedOutput:
    """A stream whose errors are sentences, such as that of a full disk behind `ctmc info ... > FILE`."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)

    def write(self, text: str) -> int:
        """Write to the stream."""
        with self._refusing():
            return self.stream.write(text)

    def flush(self) -> None:
        """Flush the stream."""
        with self._refusing():
            self.stream.flush()

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            with suppress(OSError), open(os.devnull, "w", encoding="utf-8") as nowhere:
                os.dup2(nowhere.fileno(), self.stream.fileno())  # else Python fails once more when it ends
            if isinstance(error, BrokenPipeError):
                raise
            raise refused(Path("standard output"), error) from error


@contextmanager
def checked_output() -> Iterator[None]:
    """Flush standard output at the end; turn errors into `OutputError`, except that of a closed pipe."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        output = _CheckedOutput(sys.stdout or nowhere)  # none where it was closed, as by `>&-`
        with redirect_stdout(cast(TextIO, output)):
            try:
                yield
            finally:
                output.flush()


def table(rows: Sequence[Sequence[str]], indent: str = "") -> str:
    """Return rows in columns, the first one flush left, the rest flush right.

    Parameters
    ----------
    rows : sequence of sequences of str
    indent : str

    Examples
    --------
    >>> print(table([("stage", "seconds"), ("Reading", "0.41")]))
    stage    seconds
    Reading     0.41
    """
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join(
        indent
        + "  ".join(
            cell.rjust(width) if at else cell.ljust(width)
            for at, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def listing(facts: Sequence[tuple[str, str]]) -> str:
    """Return names and what is known of them, a line each.

    Parameters
    ----------
    facts : sequence of (name, text)
        An empty name continues the one before.
    """
    width = max(len(name) for name, _ in facts)
    return "\n".join(f"{name:{width}}  {fact}".rstrip() for name, fact in facts)


def titled(title: str, lines: Sequence[str]) -> list[tuple[str, str]]:
    """Return lines for `listing`, the title before the first of them."""
    return [(title if not at else "", line) for at, line in enumerate(lines)]


def dimensions(numbers: Sequence[float]) -> str:
    """Return numbers with crosses between them: '0.74 x 0.74 x 5'.

    Parameters
    ----------
    numbers : sequence of float
    """
    return " x ".join(f"{number:.6g}" for number in numbers)


def require_empty(folder: Path, remedy: str) -> None:
    """Raise `OutputError`, with a remedy, for a folder that holds something; what is hidden does not count."""
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    visible = [name for name in names if not name.startswith(".")]
    if visible:
        raise OutputError(f"the folder {folder.name or folder} is not empty (it holds {visible[0]}); {remedy}")
