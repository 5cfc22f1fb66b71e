import doctest

import pytest

from ctmc_addon.cli import arguments, output


@pytest.mark.parametrize("module", [arguments, output], ids=lambda module: module.__name__)
def test_every_example_gives_what_it_says(module, capsys):
    failed, attempted = doctest.testmod(module)
    assert attempted > 0
    assert failed == 0, capsys.readouterr().out
