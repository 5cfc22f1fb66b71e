import os
import signal
import sys

import pytest

from ctmc_addon.cli.blender_host import interrupts_held, silence


@pytest.fixture(autouse=True)
def heard():
    """Python's own handler, also where the tests were started in the background, which ignores the interrupt."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interrupt_waits_for_the_end_of_the_block():
    reached = []

    def held():
        with interrupts_held():
            signal.raise_signal(signal.SIGINT)
            reached.append(True)

    with pytest.raises(KeyboardInterrupt):
        held()
    assert reached == [True]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_an_error_in_the_block_arrives_and_interrupts_work_again():
    with pytest.raises(ValueError, match="broken"), interrupts_held():
        raise ValueError("broken")
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


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
