# SPDX-License-Identifier: GPL-3.0-or-later
import os
import sys

import pytest

from ctmc_addon.cli.machine.blender_host import silence


def test_nothing_is_heard_from_inside_and_everything_from_outside(capfd):
    os.write(1, b"before ")
    with silence():
        os.write(1, b"inside")
        os.write(2, b"inside")
        print("inside")
        print("inside", file=sys.stderr)
    os.write(1, b"after")
    assert capfd.readouterr() == ("before after", "")


def test_the_streams_come_back_after_an_error(capfd):
    with pytest.raises(ValueError, match="broken"), silence():
        raise ValueError("broken")
    os.write(2, b"heard")
    assert capfd.readouterr().err == "heard"
