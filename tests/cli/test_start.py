# SPDX-License-Identifier: GPL-3.0-or-later
"""A command imports what it needs, and the version nothing."""

import subprocess
import sys

import pytest

from ctmc_addon.cli import main
from ctmc_addon.cli.program import COMMANDS, WORKER, parser
from ctmc_addon.version import VERSION

SLOW = ("asyncio", "ssl", "subprocess", "tomllib")  # that take long to import
IMPORTED = "; import sys; print(*sys.modules)"


def imported_after(code):
    made = subprocess.run([sys.executable, "-c", code + IMPORTED], capture_output=True, text=True, check=True)
    names = made.stdout.splitlines()[-1].split()
    return {name for name in names if name in ("numpy", *SLOW) or name.startswith("ctmc_addon.cli")}


def test_the_version_is_printed_without_numpy_or_a_command(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"ctmc {VERSION}\n"
    assert imported_after("from ctmc_addon.cli import main; main(['--version'])") == {"ctmc_addon.cli"}


def test_a_command_does_not_import_the_others():
    imported = imported_after("from ctmc_addon.cli.program import run; run(['info', '-h'])")
    imported |= imported_after("from ctmc_addon.cli.program import run; run(['reconstruct', '-h'])")
    assert "ctmc_addon.cli.commands.info" in imported
    assert not imported & set(SLOW)
    for name in ("batch", "experiment", "figure", "phantom", "foam"):
        assert "ctmc_addon.cli" + COMMANDS[name] not in imported


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_found_alone_and_among_all(command):
    for made in (parser(command), *([] if command == WORKER else [parser()])):
        with pytest.raises(SystemExit) as stop:
            made.parse_args([command, "-h"])
        assert stop.value.code == 0


def test_an_unknown_command_is_refused_with_those_for_people(capsys):
    with pytest.raises(SystemExit):
        parser("render").parse_args(["render"])
    said = capsys.readouterr().err
    assert "'reconstruct'" in said
    assert WORKER not in said
