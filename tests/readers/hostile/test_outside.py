# SPDX-License-Identifier: GPL-3.0-or-later
"""Headers that name data files elsewhere: read where the command line allows it, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from ctmc_addon.cli import main
from ctmc_addon.core import ReadError, finish
from ctmc_addon.readers import ReadingOptions, open_volume, read_volume, read_volume_steps

VALUES = np.arange(4 * 5 * 6, dtype=np.int16).reshape(4, 5, 6)
pytestmark = pytest.mark.once


@pytest.fixture(params=["../secret.raw", "absolute"])
def header(request, tmp_path):
    (tmp_path / "secret.raw").write_bytes(VALUES.tobytes())
    folder = tmp_path / "in"
    folder.mkdir()
    name = request.param if request.param != "absolute" else str(tmp_path / "secret.raw")
    text = "NRRD0004\ntype: short\ndimension: 3\nsizes: 6 5 4\nendian: little\nencoding: raw\n"
    (folder / "ct.nhdr").write_text(f"{text}data file: {name}\n\n")
    return folder / "ct.nhdr"


def test_the_command_line_may_allow_it(header, capsys, tmp_path):
    assert main(["info", str(header)]) == 1
    assert "--allow-outside" in capsys.readouterr().err
    assert main(["info", str(header), "--allow-outside"]) == 0
    assert "6 x 5 x 4" in capsys.readouterr().out
    out = tmp_path / "out"
    words = ["batch", str(header), "-o", str(out), "--threshold", "60", "--no-thumbnails"]
    assert main(words) == 1
    assert main([*words, "--resume", "--allow-outside"]) == 0
    with pytest.raises(ReadError, match="--allow-outside"):
        read_volume(header)


def test_the_option_holds_for_the_volume_it_is_given_for_and_for_no_other(header):
    steps = read_volume_steps(header, ReadingOptions(allow_outside=True))
    next(steps)
    with pytest.raises(ReadError, match="--allow-outside"):
        open_volume(header)  # between two steps of a reading that may
    np.testing.assert_array_equal(finish(steps).values, VALUES)
    assert open_volume(header, allow_outside=True).series[0].shape == (4, 5, 6)
    np.testing.assert_array_equal(read_volume(header, allow_outside=True).values, VALUES)
