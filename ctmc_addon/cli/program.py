# SPDX-License-Identifier: GPL-3.0-or-later
"""The parser of `ctmc`, and the exit code of one command."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout

from ..core import VERSION, CtmcError, memory_refusal
from ..core.files.input_files import own_input_files
from .arguments import Parser, UsageError, with_flags
from .batch import case as batch_case
from .batch import command as batch
from .commands import info, reconstruct, settings
from .experiment import command as experiment
from .figure import command as figure
from .phantom import command as phantom
from .phantom import foam

COMMANDS = (info, phantom, foam, reconstruct, batch, experiment, figure, settings, batch_case)


def parser() -> Parser:
    """Return the parser of `ctmc` with a subparser for every command."""
    top = Parser(prog="ctmc", description="CT stacks to surfaces by improved Marching Cubes.")
    top.add_argument("--version", action="version", version=f"ctmc {VERSION}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(commands)
    return top


def run(argv: Sequence[str] | None) -> int:
    """Run one command, and turn what went wrong into an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without the letters of a file's name
    try:
        args = parser().parse_args(argv)
        try:
            with ExitStack() as undo:
                undo.enter_context(own_input_files())
                if getattr(args, "quiet", False):
                    nowhere = undo.enter_context(open(os.devnull, "w", encoding="utf-8"))
                    undo.enter_context(redirect_stdout(nowhere))
                    undo.enter_context(redirect_stderr(nowhere))
                undo.enter_context(memory_refusal("the work", "choose a region, a larger stride or a smaller volume"))
                args.run(args)
        except UsageError as error:
            args.parser.error(with_flags(str(error)))
        sys.stdout.flush()
    except SystemExit as stop:  # argparse has printed help or the usage error
        return stop.code if isinstance(stop.code, int) else 0
    except CtmcError as error:
        print(f"ctmc: {with_flags(' '.join(str(error).split()))}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # `ctmc info ... | head` closes the pipe early, which is not an error.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return 0
