# SPDX-License-Identifier: GPL-3.0-or-later
"""Parse the arguments of `ctmc`, run one command and return its exit code."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from importlib import import_module

from ..core import VERSION, CtmcError, keep_little, memory_refusal
from ..core.files.input_files import own_input_files
from .flags.arguments import Parser, UsageError, with_flags
from .terminal import checked_output

WORKER = "batch-case"  # `ctmc batch` starts it; people do not.

# The module of every command, in the order of the help. Only that of the command that is called is imported.
COMMANDS = {
    "info": ".commands.info",
    "phantom": ".phantom.command",
    "foam": ".phantom.foam",
    "segment": ".commands.segment",
    "reconstruct": ".commands.reconstruct",
    "measure": ".commands.measure",
    "batch": ".batch.command",
    "experiment": ".experiment.command",
    "figure": ".figure.command",
    "settings": ".commands.settings",
    WORKER: ".batch.worker",
}


def parser(command: str | None = None) -> Parser:
    """Return the parser of `ctmc`, with a subparser for one command, or for every one for people where it is none."""
    top = Parser(prog="ctmc", description="CT stacks to surfaces by improved Marching Cubes.")
    top.add_argument("--version", action="version", version=f"ctmc {VERSION}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    public = [name for name in COMMANDS if name != WORKER]
    for name in [command] if command in COMMANDS else public:
        import_module(COMMANDS[name], __package__).add_parser(commands)
    return top


def run(argv: Sequence[str] | None) -> int:
    """Run one command, and turn what went wrong into an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal without the letters of a file's name
    try:
        with checked_output():
            arguments = sys.argv[1:] if argv is None else list(argv)
            args = parser(arguments[0] if arguments else None).parse_args(arguments)
            try:
                run_command(args)
            except UsageError as error:
                args.parser.error(with_flags(str(error)))
    except SystemExit as stop:  # argparse has printed help or the usage error
        return stop.code if isinstance(stop.code, int) else 0
    except CtmcError as error:
        print(f"ctmc: {with_flags(' '.join(str(error).split()))}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # `ctmc info ... | head` closes the pipe early, which is not an error.
        pass
    return 0


def run_command(args: argparse.Namespace) -> None:
    """Run the command of parsed flags."""
    keep_little()
    with ExitStack() as undo:
        undo.enter_context(own_input_files())
        if getattr(args, "quiet", False):
            nowhere = undo.enter_context(open(os.devnull, "w", encoding="utf-8"))
            undo.enter_context(redirect_stdout(nowhere))
            undo.enter_context(redirect_stderr(nowhere))
        undo.enter_context(memory_refusal("the work", "choose a region, a larger stride or a smaller volume"))
        args.run(args)
