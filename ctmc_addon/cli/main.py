"""Parse, run one command, and turn what went wrong into an exit code.

0 is done, 1 a sentence on standard error about the input, 2 usage, 130 interrupted.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence

from ..core import VERSION, CtmcError
from .arguments import figures_named, labels_repeated, single_numbers_repeated, with_flags
from .batch import case as batch_case
from .batch import command as batch
from .commands import info, reconstruct, settings
from .experiment import command as experiment
from .figure import command as figure
from .phantom import command as phantom

COMMANDS = (info, phantom, reconstruct, batch, experiment, figure, settings, batch_case)


def parser() -> argparse.ArgumentParser:
    """The parser of `ctmc` with a subparser for every command."""
    top = argparse.ArgumentParser(
        prog="ctmc", description="CT stacks to surfaces by improved Marching Cubes.", allow_abbrev=False
    )
    top.add_argument("--version", action="version", version=f"ctmc {VERSION}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(commands)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run `ctmc` with these arguments, by default the process's own, and return the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without the letters of a file's name
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        chosen = parser().parse_args(labels_repeated(single_numbers_repeated(figures_named(arguments))))
    except SystemExit as stop:  # argparse has printed help or the usage error
        return stop.code if isinstance(stop.code, int) else 0
    try:
        chosen.run(chosen)
        sys.stdout.flush()
    except CtmcError as error:
        print(f"ctmc: {with_flags(' '.join(str(error).split()))}", file=sys.stderr)
        return 1
    except MemoryError:
        print("ctmc: there is not enough memory; choose a region, a larger stride or a smaller volume", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `ctmc info ... | head`: nobody reads on, which is no mistake
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return 0
